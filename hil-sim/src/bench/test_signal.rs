//! The drive of the next experiment: a reference pressure that separates what one record alone
//! cannot tell apart.
//!
//! | part | separates |
//! |---|---|
//! | zero | sensor offsets, dead band and γ: nothing pulls |
//! | triangles | hysteresis (the same at three rates, minor loops) from creep, friction and lag |
//! | holds | creep, leak, heat and drift: 60 s after a step, up and down |
//! | shut-holds | leak from sensor gain and dead zone of the valve, which does not refill |
//! | multisine | lag, delay and line: one spectrum |
//! | sweep | flow limit and dead zone of the valve from its lag: steps that grow |

use crate::design::equilibrium;
use crate::error::BadInput;
use crate::record::{PRESSURE_REF_PA, Record, VALVE_OPEN};
use crate::rig::Rig;
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;
use model_core::settings::SettingsValues;
use muscle_plant::nominal::{Load, Weight};
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

/// Rows a second: one a tick of the board.
pub const RATE_HZ: f64 = 100.0;
/// Contraction that a weight is not to pass, if nobody says another.
pub const CONTRACTION_MAX: f64 = 0.3;
/// So long the reference waits for whoever opens a cock \[s\].
const OPENING_S: f64 = 5.0;
/// Of the supply pressure: nearer to it no valve gets in time.
const SUPPLY_SHARE: f64 = 0.95;
/// A muscle pulls no further than where ∂F/∂P of Eq 1 is zero, and hardly beyond this share.
const REACH_SHARE: f64 = 0.85;

/// One kind of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// Vented, at rest
    Zero,
    /// Triangles at three rates, with minor loops
    Triangles,
    /// Steps with holds of 60 s, the valve working
    Holds,
    /// Steps with holds of 60 s, a cock between valve and muscle shut
    ShutHolds,
    /// Sines from 0.1 to 6.4 Hz together
    Multisine,
    /// Steps that grow
    Sweep,
}

impl Part {
    /// The parts that need nothing but the valve.
    pub const USUAL: [Part; 5] = [
        Part::Zero,
        Part::Triangles,
        Part::Holds,
        Part::Multisine,
        Part::Sweep,
    ];
}

/// Where a drive may go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Pressures between which the muscle works (gauge) \[Pa\]: a weight is off its stop at the
    /// lower one.
    pub low_pa: f64,
    /// See `low_pa`.
    pub high_pa: f64,
    /// Fastest change of the reference, at least 100 \[Pa/s\]; what the reference settings of the
    /// board allow if there is none.
    pub rate_pa_per_s_max: Option<f64>,
    muscle: Muscle<f64>,
    /// What carries the weight, unless the load is prescribed.
    swing: Option<Swing>,
}

/// A weight on a muscle, as far as steps of the pressure throw it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Swing {
    muscle: Muscle<f64>,
    force_n: f64,
    contraction_max: f64,
}

impl Swing {
    fn pressure_pa(&self, contraction: f64) -> f64 {
        (self.force_n - self.muscle.gamma_n) / self.muscle.force_per_pressure_m2(contraction)
    }

    /// Where it rests; 0 on its stop.
    fn contraction(&self, pressure_pa: f64) -> f64 {
        let mass_kg = self.force_n / GRAVITY_M_PER_S2;
        let found = equilibrium(&self.muscle, GaugePa(pressure_pa), mass_kg);
        found.unwrap_or(0.0)
    }
}

impl Limits {
    /// The limits of `rig`: its supply pressure, the contraction the muscle can reach, at most
    /// `contraction_max`, and the fastest change that the board allows.
    ///
    /// # Errors
    /// The rig has no valve, or its supply does not lift its weight.
    pub fn of(rig: &Rig, contraction_max: f64) -> Result<Limits, BadInput> {
        let muscle = rig.nominal.muscle;
        let mut limits = Limits {
            low_pa: 0.0,
            high_pa: (SUPPLY_SHARE * rig.require_valve()?.supply_pressure.0).floor(),
            rate_pa_per_s_max: None,
            muscle,
            swing: None,
        };
        let Load::Weight(Weight {
            mass_kg,
            static_friction_n,
            ..
        }) = rig.nominal.load
        else {
            return Ok(limits);
        };
        let reach = 1.0 - (-muscle.beta_m2 / muscle.alpha_m2).max(0.0).sqrt();
        let swing = Swing {
            muscle,
            force_n: mass_kg * GRAVITY_M_PER_S2,
            contraction_max: contraction_max.min(REACH_SHARE * reach),
        };
        let friction_pa = static_friction_n / muscle.force_per_pressure_m2(0.0);
        limits.low_pa = (swing.pressure_pa(0.0) + friction_pa).ceil();
        let most_pa = swing.pressure_pa(swing.contraction_max);
        limits.high_pa = limits.high_pa.min(most_pa).floor();
        limits.swing = Some(swing);
        if limits.high_pa <= limits.low_pa {
            let expected = format!(
                "a supply that lifts the weight, at least {:.0} Pa, found {:.0} Pa to work with",
                limits.low_pa, limits.high_pa
            );
            return Err(rig.bad("valve.supply_pressure_pa", &expected));
        }
        Ok(limits)
    }

    /// Fastest change of the reference where it is `pressure_pa` \[Pa/s\].
    pub fn rate_pa_per_s(&self, pressure_pa: f64) -> f64 {
        self.rate_pa_per_s_max.unwrap_or_else(|| {
            let speed_m_per_s = SettingsValues::reference().reference_speed_m_per_s_max;
            // The board allows no less than on a muscle at its full length.
            let speed_m_per_s = f64::from(speed_m_per_s);
            let pressure = GaugePa(pressure_pa);
            self.muscle
                .moving_rate_pa_per_s(speed_m_per_s, 0.0, pressure)
        })
    }

    /// The same a row, in whole pascals.
    fn row_pa(&self, pressure_pa: f64) -> f64 {
        (self.rate_pa_per_s(pressure_pa) / RATE_HZ).floor()
    }

    /// Pressures that one step from `from_pa` may go to. A weight that swings without damping goes
    /// as far beyond where it will rest as it came from: neither beyond the greatest contraction,
    /// nor onto the stop.
    fn steps(&self, from_pa: f64) -> RangeInclusive<f64> {
        let Some(swing) = &self.swing else {
            return self.low_pa..=self.high_pa;
        };
        let from = swing.contraction(from_pa);
        let low_pa = swing.pressure_pa(0.5 * from).max(self.low_pa);
        let high_pa = swing.pressure_pa(0.5 * (from + swing.contraction_max));
        low_pa..=high_pa.min(self.high_pa)
    }

    /// The middle, and how far steps may go to either side of it.
    fn middle(&self) -> (f64, f64) {
        let middle_pa = 0.5 * (self.low_pa + self.high_pa);
        let Some(swing) = &self.swing else {
            return (middle_pa, 0.5 * (self.high_pa - self.low_pa));
        };
        // From one side to the other and as far again takes three of four quarters.
        let contractions = [self.low_pa, self.high_pa].map(|pa| swing.contraction(pa));
        let [low, high] = contractions;
        let (middle, part) = (0.5 * (low + high), (high - low) / 6.0);
        let middle_pa = swing.pressure_pa(middle);
        let up_pa = swing.pressure_pa(middle + part) - middle_pa;
        (
            middle_pa,
            up_pa.min(middle_pa - swing.pressure_pa(middle - part)),
        )
    }
}

/// A drive while it is written.
struct Pen {
    limits: Limits,
    reference_pa: Vec<f64>,
    open: Vec<bool>,
    is_open: bool,
}

/// A drive.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// `pressure_ref_pa` and, where a cock is to be shut, `valve_open`; a row a tick of the board.
    pub record: Record,
    /// Its parts, and when each begins \[s\].
    pub parts: Vec<(Part, f64)>,
}

/// Writes `parts` one after the other, within `limits`; vented at both ends.
pub fn experiment(limits: &Limits, parts: &[Part]) -> Experiment {
    let mut pen = Pen {
        limits: *limits,
        reference_pa: vec![0.0],
        open: vec![true],
        is_open: true,
    };
    let mut begins = Vec::new();
    for part in parts {
        begins.push((*part, pen.time_s()));
        pen.write(*part);
    }
    pen.go(0.0, 2.0);
    pen.hold(2.0);
    let rows = pen.reference_pa.len();
    let mut record = Record::new((0..rows).map(|row| row as f64 / RATE_HZ).collect());
    record.set(PRESSURE_REF_PA, pen.reference_pa);
    if pen.open.contains(&false) {
        let open = pen.open.iter().map(|open| f64::from(*open));
        record.set(VALVE_OPEN, open.collect());
    }
    Experiment {
        record,
        parts: begins,
    }
}

impl Pen {
    fn time_s(&self) -> f64 {
        (self.reference_pa.len() - 1) as f64 / RATE_HZ
    }

    fn last_pa(&self) -> f64 {
        self.reference_pa.last().copied().unwrap_or(0.0)
    }

    /// A shape of `duration_s` over the time since it began, within pressure and rate limits, in
    /// whole pascals.
    fn draw(&mut self, duration_s: f64, shape: impl Fn(f64) -> f64) {
        for row in 1..=(duration_s * RATE_HZ).round() as usize {
            let wanted_pa = shape(row as f64 / RATE_HZ).round();
            let wanted_pa = wanted_pa.clamp(0.0, self.limits.high_pa);
            let last_pa = self.last_pa();
            let most_pa = self.limits.row_pa(last_pa);
            let change_pa = (wanted_pa - last_pa).clamp(-most_pa, most_pa);
            self.reference_pa.push(last_pa + change_pa);
            self.open.push(self.is_open);
        }
    }

    fn hold(&mut self, duration_s: f64) {
        let pa = self.last_pa();
        self.draw(duration_s, |_| pa);
    }

    /// A ramp, slower where the limit of the rate asks for it.
    fn go(&mut self, to_pa: f64, duration_s: f64) {
        let from_pa = self.last_pa();
        // It is slowest at the lower end.
        let most_pa = self.limits.row_pa(from_pa.min(to_pa));
        let rows = (duration_s * RATE_HZ)
            .max((to_pa - from_pa).abs() / most_pa)
            .ceil();
        let duration_s = rows / RATE_HZ;
        self.draw(duration_s, |time_s| match time_s / duration_s {
            share if share < 1.0 => from_pa + share * (to_pa - from_pa),
            _ => to_pa,
        });
    }

    /// A step towards `to_pa`, as far as it may go, and a hold.
    fn step(&mut self, to_pa: f64, duration_s: f64) {
        let steps = self.limits.steps(self.last_pa());
        let to_pa = to_pa.clamp(*steps.start(), *steps.end());
        self.draw(duration_s, |_| to_pa);
    }

    /// From wherever it is, slowly, and until it rests.
    fn settle(&mut self, to_pa: f64) {
        self.go(to_pa, 4.0);
        self.hold(2.0);
    }

    fn write(&mut self, part: Part) {
        match part {
            Part::Zero => {
                self.go(0.0, 2.0);
                self.hold(10.0);
            }
            Part::Triangles => self.triangles(),
            Part::Holds => {
                for to_pa in self.levels() {
                    self.step(to_pa, 60.0);
                }
            }
            Part::ShutHolds => {
                for to_pa in self.levels() {
                    self.step(to_pa, 10.0);
                    self.is_open = false;
                    self.hold(60.0);
                    self.is_open = true;
                    self.hold(OPENING_S);
                }
            }
            Part::Multisine => self.multisine(),
            Part::Sweep => self.sweep(),
        }
    }

    /// Where steps go: up twice, and back.
    fn levels(&mut self) -> [f64; 4] {
        let Limits {
            low_pa, high_pa, ..
        } = self.limits;
        self.settle(low_pa.max(0.2 * high_pa));
        let middle_pa = 0.5 * (low_pa + high_pa);
        [middle_pa, high_pa, middle_pa, low_pa]
    }

    /// Twice up and down over the range, first with a minor loop on each leg; four times as fast,
    /// and again.
    fn triangles(&mut self) {
        let Limits {
            low_pa, high_pa, ..
        } = self.limits;
        self.settle(low_pa);
        for leg_s in [16.0, 4.0, 1.0] {
            for turns in [true, true, false, false] {
                let from_pa = self.last_pa();
                let to_pa = if from_pa > low_pa { low_pa } else { high_pa };
                let at = |share: f64| from_pa + share * (to_pa - from_pa);
                if turns {
                    self.go(at(0.6), 0.6 * leg_s);
                    self.go(at(0.3), 0.3 * leg_s);
                    self.go(to_pa, 0.7 * leg_s);
                } else {
                    self.go(to_pa, leg_s);
                }
            }
        }
    }

    /// Octaves, each half as large as the one below, for equal speed of the reference; their phases
    /// are Schroeder's (1970), which keep the sum flat.
    fn multisine(&mut self) {
        const OCTAVES: i32 = 7;
        let (middle_pa, part_pa) = self.limits.middle();
        self.settle(middle_pa);
        let sum = |time_s: f64| -> f64 {
            let octaves = (0..OCTAVES).map(|octave| {
                let phase = -PI * f64::from(octave * (octave + 1)) / f64::from(OCTAVES);
                let frequency_hz = 0.1 * f64::from(1 << octave);
                (TAU * frequency_hz * time_s + phase).sin() / f64::from(1 << octave)
            });
            octaves.sum()
        };
        // It repeats after 10 s; no sum of these is above 2.
        let begins_pa = middle_pa + 0.5 * part_pa * sum(0.0);
        self.go(begins_pa, 2.0);
        self.draw(60.0, |time_s| middle_pa + 0.5 * part_pa * sum(time_s));
    }

    /// Steps about the middle, each size twice as large as the one before.
    fn sweep(&mut self) {
        let (middle_pa, part_pa) = self.limits.middle();
        self.settle(middle_pa);
        for halvings in (0..5).rev() {
            let size_pa = part_pa / f64::from(1 << halvings);
            for sign in [1.0, -1.0, 1.0, -1.0] {
                self.draw(2.0, |_| middle_pa + sign * size_pa);
            }
        }
        self.draw(2.0, |_| middle_pa);
    }
}
