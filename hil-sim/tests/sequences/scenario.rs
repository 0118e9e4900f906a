//! The scenarios of an audit that found the first campaign too narrow.

use super::case::Case;
use super::event::{Event, What};
use super::run::{Ran, run};
use hil_sim::faults::ablation::SafetyFunction;
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
    }
}

pub fn scenarios() -> Vec<Scenario> {
    [air_and_load(), lever_and_valve(), limbs()]
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
            "every second tick missed, payload lost",
            "no reason",
            vec![
                (What::TicksHalting(2), 2.4, 6.0),
                (What::Exchanged(0.05), 2.5, 6.0),
            ],
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
        Scenario {
            foot_m: Some(0.02),
            port: true,
            ..of(
                "a foot below, the valve leaks to the exhaust, with a valve in the port",
                "–",
                vec![
                    (What::Pushes(0.1), 1.5, 9.8),
                    (What::ValveAjar(0.1, 0.2), 3.0, 9.8),
                ],
            )
        },
    ]
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
            ..Case::with(events.collect(), seed)
        }
    });
    cases
        .map(|case| {
            let outcome = run(&case, without);
            (case, outcome)
        })
        .collect()
}
