//! The scenarios of an audit that found the first campaign too narrow.

use super::case::{Case, rig_of_muscle};
use super::event::{Event, What};
use super::run::{Ran, run};
use hil_sim::faults::ablation::SafetyFunction;
use hil_sim::rig::Rig;
use rayon::prelude::*;

/// A scenario of the audit.
pub struct Scenario {
    pub name: &'static str,
    /// What the audit found.
    pub before: &'static str,
    pub events: Vec<(What, f64, f64)>,
    pub hand_m: Option<f64>,
    pub foot_m: Option<f64>,
    /// The rig has the valve in the muscle's port.
    pub port: bool,
    pub rig: Rig,
}

/// A scenario without a limb.
fn of(name: &'static str, before: &'static str, events: Vec<(What, f64, f64)>) -> Scenario {
    Scenario {
        name,
        before,
        events,
        hand_m: None,
        foot_m: None,
        port: false,
        rig: Rig::reference(),
    }
}

pub fn scenarios() -> Vec<Scenario> {
    [
        air_and_load(),
        lever_and_valve(),
        ticks_and_memory(),
        limbs(),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn air_and_load() -> Vec<Scenario> {
    vec![
        of(
            "a snag of 1 s",
            "0.77–0.80 m/s",
            vec![(What::Snag, 2.0, 3.0)],
        ),
        of(
            "a snag of 2 s",
            "0.77–0.80 m/s",
            vec![(What::Snag, 2.0, 4.0)],
        ),
        of(
            "valve shut for 0.6 s",
            "0.70 m/s",
            vec![(What::ValveShut, 2.0, 2.6)],
        ),
        of(
            "valve shut for 2 s",
            "0.79 m/s",
            vec![(What::ValveShut, 2.0, 4.0)],
        ),
        of(
            "supply 0.3 and 1, every 0.4 s",
            "0.73 m/s",
            vec![(What::Supply(0.3, Some(0.4)), 1.5, 5.0)],
        ),
        of(
            "a helper, 100 N for 0.5 s",
            "0.83 m/s",
            vec![(What::Force(100.0), 2.5, 3.0)],
        ),
        of(
            "a helper, 118 N for 1 s",
            "1.51 m/s",
            vec![(What::Force(118.0), 2.5, 3.5)],
        ),
    ]
}

fn lever_and_valve() -> Vec<Scenario> {
    let alone = |what| vec![(What::LetsGo, 1.25, 9.8), (what, 1.3, 9.8)];
    vec![
        of(
            "a hand, ±60 mm at 2 Hz",
            "0.70 m/s",
            vec![(What::Shakes(0.06, 2.0), 1.5, 5.0)],
        ),
        of(
            "DAC bit 10 at 0",
            "0.75 m/s",
            vec![(What::DacBit(10), 2.5, 6.0)],
        ),
        of(
            "valve at 0.6 of the supply",
            "up to 1.3 m/s",
            vec![(What::ValveAt(0.6), 2.5, 6.0)],
        ),
        of(
            "gauge creeps 3 N/s to 7 N, nobody there",
            "88 mm, no reason",
            alone(What::GaugeCreep(3.0, 7.0)),
        ),
        of(
            "ripple of 6 N at 99.9 Hz, nobody there",
            "67 mm, no reason",
            alone(What::GaugeRipple(6.0, 99.9)),
        ),
        of(
            "gauge 7 N off, nobody there",
            "–",
            alone(What::GaugeZero(7.0)),
        ),
    ]
}

fn ticks_and_memory() -> Vec<Scenario> {
    let halting = |every, what| vec![(What::TicksHalting(every), 2.4, 9.8), what];
    let lost = (What::Exchanged(0.05), 2.5, 6.0);
    vec![
        of(
            "every second tick missed",
            "no reason",
            vec![(What::TicksHalting(2), 2.4, 9.8)],
        ),
        of(
            "every second tick missed, payload lost",
            "no reason",
            halting(2, lost),
        ),
        of(
            "every second tick missed, payload doubled",
            "no reason",
            halting(2, (What::Exchanged(2.0), 2.5, 6.0)),
        ),
        of(
            "every second tick missed, a snag of 1 s",
            "0.80 m/s",
            halting(2, (What::Snag, 2.5, 3.5)),
        ),
        of(
            "one of ten ticks missed, payload lost",
            "a reason in 7 of 16",
            halting(10, lost),
        ),
        of(
            "a bit of the reference flips in two copies",
            "1.76 m/s",
            vec![(What::FlipTwo(28), 2.5, 3.0)],
        ),
        of(
            "another bit of the reference flips in each copy",
            "0.80 m/s",
            vec![(What::FlipAll(20), 2.5, 3.0)],
        ),
    ]
}

fn limbs() -> Vec<Scenario> {
    let lets_go = (What::LetsGo, 3.0, 9.8);
    vec![
        Scenario {
            hand_m: Some(0.03),
            ..of(
                "a hand above the weight",
                "231–293 N, above 140 N for 166–326 ms",
                vec![],
            )
        },
        Scenario {
            hand_m: Some(0.03),
            ..of("the same, then lets go", "–", vec![lets_go])
        },
        Scenario {
            hand_m: Some(0.03),
            ..of(
                "the same, the lever stays up, then the emergency stop",
                "–",
                vec![(What::Pushes(0.09), 1.5, 9.8), (What::Stops, 3.0, 9.8)],
            )
        },
        Scenario {
            foot_m: Some(0.02),
            ..of(
                "a foot below, then lets go",
                "335 N, then 125 N, no retreat",
                vec![lets_go],
            )
        },
    ]
}

/// A scenario in which a safety function keeps a bound of the body.
pub struct Needed {
    pub function: SafetyFunction,
    pub scenario: Scenario,
    /// The rig has an enabling device.
    pub enabling: bool,
    /// The bound that is violated without the function.
    pub bound: &'static str,
}

const HEIGHT: &str = "height not asked for";
const RELEASED: &str = "not released";

/// Of each safety function one.
pub fn needed() -> Vec<Needed> {
    let of_gauge = gauge().map(|(function, scenario)| Needed {
        function,
        scenario,
        enabling: false,
        bound: HEIGHT,
    });
    let others = [
        a_hand_above(),
        a_foot_below(),
        a_foot_below_a_fast_weight(),
        a_fast_weight(),
        at_rest(),
    ];
    of_gauge
        .into_iter()
        .chain(others.into_iter().flatten())
        .collect()
}

/// Of the gauge, with nobody at the lever and no enabling device.
fn gauge() -> [(SafetyFunction, Scenario); 3] {
    let alone = |what| vec![(What::LetsGo, 1.25, 9.8), (what, 1.3, 9.8)];
    [
        (
            SafetyFunction::SensorRange,
            of(
                "a wire of the gauge opens, nobody there",
                "–",
                alone(What::GaugeOpens(100.0)),
            ),
        ),
        (
            SafetyFunction::SensorStep,
            of(
                "the gauge jumps by 18 N, nobody there",
                "–",
                alone(What::GaugeZero(18.0)),
            ),
        ),
        (
            SafetyFunction::SelfCheck,
            of(
                "something lies on the lever from the start on, nobody there",
                "–",
                vec![(What::GaugeZero(10.0), 0.0, 9.8), (What::LetsGo, 1.25, 9.8)],
            ),
        ),
    ]
}

/// A hand is 30 mm above the weight.
fn a_hand_above() -> Vec<Needed> {
    let hand = |name, events| Scenario {
        hand_m: Some(0.03),
        ..of(name, "–", events)
    };
    let pulls = |to_m| (What::Pushes(to_m), 1.5, 9.8);
    vec![
        Needed {
            function: SafetyFunction::SensorStuck,
            scenario: hand(
                "a hand above, the gauge freezes, the person lets go",
                vec![
                    pulls(0.09),
                    (What::GaugeFrozen, 2.4, 9.8),
                    (What::LetsGo, 2.6, 9.8),
                ],
            ),
            enabling: false,
            bound: RELEASED,
        },
        Needed {
            function: SafetyFunction::WeightWatch,
            scenario: hand("a hand above, the lever is pulled up", vec![pulls(0.12)]),
            enabling: true,
            bound: "lasting force",
        },
        Needed {
            function: SafetyFunction::EmergencyStop,
            scenario: hand(
                "a hand above, the lever stays up, somebody presses the emergency stop",
                vec![pulls(0.09), (What::Stops, 3.0, 9.8)],
            ),
            enabling: true,
            bound: RELEASED,
        },
    ]
}

/// A foot gets below the weight while it is lifted, to this height \[m\].
fn foot(foot_m: f64, name: &'static str, events: Vec<(What, f64, f64)>) -> Scenario {
    Scenario {
        foot_m: Some(foot_m),
        ..of(name, "–", events)
    }
}

/// On a rig with an enabling device.
fn enabled(function: SafetyFunction, bound: &'static str, scenario: Scenario) -> Needed {
    Needed {
        function,
        scenario,
        enabling: true,
        bound,
    }
}

fn a_foot_below() -> Vec<Needed> {
    let lets_go = vec![(What::LetsGo, 3.0, 9.8)];
    let lowered = "a foot below, the person lets go";
    vec![
        enabled(
            SafetyFunction::VentRamp,
            "transient force",
            foot(0.02, lowered, lets_go.clone()),
        ),
        enabled(
            SafetyFunction::Retreat,
            RELEASED,
            foot(0.02, lowered, lets_go),
        ),
        enabled(
            SafetyFunction::PressureWatch,
            RELEASED,
            Scenario {
                port: true,
                ..foot(
                    0.02,
                    "a foot below, the valve leaks to the exhaust, with a valve in the port",
                    vec![
                        (What::Pushes(0.1), 1.5, 9.8),
                        (What::ValveAjar(0.1, 0.2), 3.0, 9.8),
                    ],
                )
            },
        ),
        enabled(
            SafetyFunction::MissedTicks,
            RELEASED,
            Scenario {
                rig: rig_of_muscle(0.7, 1.0),
                ..foot(
                    0.055,
                    "two of three ticks missed, later a foot below, a muscle of 0.7 times the area",
                    vec![
                        (What::TicksLeft(3), 1.6, 9.8),
                        (What::Pushes(0.08), 1.6, 3.0),
                        (What::Pushes(0.12), 3.0, 9.8),
                        (What::LetsGo, 5.0, 9.8),
                    ],
                )
            },
        ),
    ]
}

/// With a foot below what is driven by the supply or by the lever.
fn a_foot_below_a_fast_weight() -> Vec<Needed> {
    vec![
        enabled(
            SafetyFunction::SpeedTrip,
            "transient force",
            foot(
                0.033,
                "the supply falls to a fifth every 0.3 s, a foot below",
                vec![(What::Supply(0.2, Some(0.3)), 1.5, 5.0)],
            ),
        ),
        enabled(
            SafetyFunction::ContactEnergy,
            "transient force",
            foot(
                0.03,
                "the lever is shaken by ±50 mm at 2.4 Hz, then let go, a foot below",
                vec![
                    (What::Pushes(0.07), 1.4, 9.8),
                    (What::Shakes(0.05, 2.4), 2.6, 3.6),
                    (What::LetsGo, 3.6, 9.8),
                ],
            ),
        ),
    ]
}

fn a_fast_weight() -> Vec<Needed> {
    let by = |function, scenario| Needed {
        function,
        scenario,
        enabling: true,
        bound: "speed up",
    };
    vec![
        by(
            SafetyFunction::ReferenceSpeed,
            of(
                "the lever is pulled to its end at once",
                "–",
                vec![(What::Pushes(0.12), 1.5, 9.8)],
            ),
        ),
        by(
            SafetyFunction::MemoryVote,
            of(
                "a bit of the reference flips, in one copy",
                "–",
                vec![(What::Flip(28), 2.5, 3.0)],
            ),
        ),
    ]
}

/// Nothing was asked for. Of the reference muscle, the pressure watch finds a pressure before it
/// lifts the weight; a muscle of twice the diameter lifts it with 51 kPa.
fn at_rest() -> Vec<Needed> {
    let of_valve = Needed {
        function: SafetyFunction::RestWatch,
        scenario: Scenario {
            port: true,
            rig: rig_of_muscle(4.0, 1.0),
            ..of(
                "the valve does not close while ready, a muscle of 4 times the area, with a valve \
                 in the port",
                "–",
                vec![
                    (What::LetsGo, 0.0, 9.8),
                    (What::ValveAjar(0.17, 0.2), 1.0, 9.8),
                ],
            )
        },
        enabling: true,
        bound: HEIGHT,
    };
    // With less than what the pressure watch finds.
    let of_dac = Needed {
        function: SafetyFunction::ReadBack,
        scenario: Scenario {
            port: true,
            rig: rig_of_muscle(1.5, 1.0),
            ..of(
                "the DAC drifts by 80 kPa, nobody there, a muscle of 1.5 times the area, with a \
                 valve in the port",
                "–",
                vec![
                    (What::LetsGo, 1.25, 9.8),
                    (What::DacDrift(0.1, 0.16), 1.6, 9.8),
                ],
            )
        },
        enabling: false,
        bound: HEIGHT,
    };
    vec![of_valve, of_dac]
}

pub fn of_scenario(
    scenario: &Scenario,
    enabling: bool,
    without: Option<SafetyFunction>,
) -> Vec<Ran> {
    let seeds = (0..16).into_par_iter();
    let cases = seeds.map(|seed| {
        let events = scenario.events.iter().map(|(what, from_s, to_s)| Event {
            what: *what,
            during_s: *from_s..*to_s,
        });
        Case {
            enabling,
            hand_m: scenario.hand_m,
            foot_m: scenario.foot_m,
            port: scenario.port,
            ..Case::with(scenario.rig.clone(), events.collect(), seed)
        }
    });
    cases
        .map(|case| {
            let outcome = run(&case, without);
            (case, outcome)
        })
        .collect()
}
