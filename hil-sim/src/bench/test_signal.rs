//! Test signals: reference pressures whose records make effects distinguishable.
//!
//! | part | makes distinguishable |
//! |---|---|
//! | zero | sensor offsets, dead band and γ: no force on the muscle |
//! | triangles | hysteresis (equal at three rates, minor loops) from creep, friction and lag |
//! | holds | creep, leak, heat exchange and drift: 60 s after steps up and down |
//! | shut-holds | leak from sensor gain and the valve's dead zone: the valve cannot refill |
//! | multisine | lag, dead time and line dynamics: a spectrum |
//! | sweep | flow limit and dead zone of the valve from its lag: steps of growing size |

use crate::design::equilibrium;
use crate::error::BadInput;
use crate::record::{PRESSURE_REF_PA, Record, VALVE_OPEN};
use crate::rig::Rig;
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;
use model_core::settings::SettingsValues;
use muscle_plant::nominal::{Load, Weight};
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use serde::Serialize;
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

/// Rows per second: one per tick of the board.
pub const RATE_HZ: f64 = 100.0;
/// Default of the largest contraction of a muscle with a weight.
pub const CONTRACTION_MAX: f64 = 0.3;
/// Time for the user to open the shut-off valve before the reference moves \[s\].
const OPENING_S: f64 = 5.0;
/// Highest reference as a share of the supply pressure: above it the valve's flow is too small.
const SUPPLY_SHARE: f64 = 0.95;
/// Largest contraction as a share of the contraction at which ∂F/∂P of Eq 1 is zero.
const CONTRACTION_SHARE: f64 = 0.85;

/// A part of a test signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// Vented, at rest
    Zero,
    /// Triangles at three rates, with minor loops
    Triangles,
    /// Steps with holds of 60 s, the valve controlling
    Holds,
    /// Steps with holds of 60 s, the shut-off valve between valve and muscle shut
    ShutHolds,
    /// Sum of sines from 0.1 to 6.4 Hz
    Multisine,
    /// Steps of growing size
    Sweep,
}

impl Part {
    /// Its name on the command line.
    pub fn name(self) -> String {
        let value = clap::ValueEnum::to_possible_value(&self);
        value.map_or_else(String::new, |value| value.get_name().into())
    }

    /// All parts.
    pub fn all() -> &'static [Part] {
        clap::ValueEnum::value_variants()
    }

    /// The parts that need no shut-off valve.
    pub const DEFAULT: [Part; 5] = [
        Part::Zero,
        Part::Triangles,
        Part::Holds,
        Part::Multisine,
        Part::Sweep,
    ];
}

/// Limits of a test signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Lowest pressure of the working range (gauge) \[Pa\], at which a weight is off its stop.
    pub low_pa: f64,
    /// Highest pressure of the working range (gauge) \[Pa\].
    pub high_pa: f64,
    /// Fastest change of the reference, at least 100 \[Pa/s\]; if none, the limit of the board's
    /// reference settings.
    pub rate_pa_per_s_max: Option<f64>,
    muscle: Muscle<f64>,
    /// The hanging weight, unless the load is prescribed.
    swing: Option<Swing>,
}

/// A weight on a muscle, which overshoots after a step of the pressure.
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

    /// Contraction at rest; 0 on the stop.
    fn contraction(&self, pressure_pa: f64) -> f64 {
        let mass_kg = self.force_n / GRAVITY_M_PER_S2;
        equilibrium(&self.muscle, GaugePa(pressure_pa), mass_kg).unwrap_or(0.0)
    }
}

impl Limits {
    /// The limits of `rig`: its supply pressure, the largest contraction of the muscle, at most
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
        let stroke = 1.0 - (-muscle.beta_m2 / muscle.alpha_m2).max(0.0).sqrt();
        let swing = Swing {
            muscle,
            force_n: mass_kg * GRAVITY_M_PER_S2,
            contraction_max: contraction_max.min(CONTRACTION_SHARE * stroke),
        };
        let friction_pa = static_friction_n / muscle.force_per_pressure_m2(0.0);
        limits.low_pa = (swing.pressure_pa(0.0) + friction_pa).ceil();
        let highest_pa = swing.pressure_pa(swing.contraction_max);
        limits.high_pa = limits.high_pa.min(highest_pa).floor();
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

    /// Fastest change of the reference at `pressure_pa` \[Pa/s\].
    pub fn rate_pa_per_s(&self, pressure_pa: f64) -> f64 {
        self.rate_pa_per_s_max.unwrap_or_else(|| {
            let speed_m_per_s = SettingsValues::reference().reference_speed_m_per_s_max;
            // The board allows at least the rate of a muscle at its full length.
            let speed_m_per_s = f64::from(speed_m_per_s);
            let pressure = GaugePa(pressure_pa);
            self.muscle
                .moving_rate_pa_per_s(speed_m_per_s, 0.0, pressure)
        })
    }

    /// Largest change from one row to the next, in whole pascals.
    fn row_change_pa(&self, pressure_pa: f64) -> f64 {
        (self.rate_pa_per_s(pressure_pa) / RATE_HZ).floor()
    }

    /// Range of pressures for one step from `from_pa`. An undamped weight overshoots its new
    /// equilibrium by the size of the step: it must neither pass the largest contraction nor hit
    /// the stop.
    fn step_range(&self, from_pa: f64) -> RangeInclusive<f64> {
        let Some(swing) = &self.swing else {
            return self.low_pa..=self.high_pa;
        };
        let from = swing.contraction(from_pa);
        let low_pa = swing.pressure_pa(0.5 * from).max(self.low_pa);
        let high_pa = swing.pressure_pa(0.5 * (from + swing.contraction_max));
        low_pa..=high_pa.min(self.high_pa)
    }

    /// The middle of the working range, and the largest step to either side of it.
    fn middle(&self) -> (f64, f64) {
        let middle_pa = 0.5 * (self.low_pa + self.high_pa);
        let Some(swing) = &self.swing else {
            return (middle_pa, 0.5 * (self.high_pa - self.low_pa));
        };
        // A step from one side to the other overshoots to three times its amplitude, the half width
        // of the range.
        let [low, high] = [self.low_pa, self.high_pa].map(|pa| swing.contraction(pa));
        let (middle, part) = (0.5 * (low + high), (high - low) / 6.0);
        let middle_pa = swing.pressure_pa(middle);
        let up_pa = swing.pressure_pa(middle + part) - middle_pa;
        (
            middle_pa,
            up_pa.min(middle_pa - swing.pressure_pa(middle - part)),
        )
    }
}

/// A test signal while it is written.
struct Writer {
    limits: Limits,
    reference_pa: Vec<f64>,
    open: Vec<bool>,
    is_open: bool,
}

/// A test signal.
#[derive(Clone, Debug)]
pub struct TestSignal {
    /// `pressure_ref_pa` and, if the shut-off valve is to be shut, `valve_open`; one row per tick
    /// of the board.
    pub record: Record,
    /// Its parts, and the start of each \[s\].
    pub parts: Vec<(Part, f64)>,
}

/// A test signal, for programs.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Its file.
    pub experiment: String,
    /// Its length \[s\].
    pub length_s: f64,
    /// The lowest and the highest pressure to work with (gauge) \[Pa\].
    pub pressure_pa_low: f64,
    /// See `pressure_pa_low`.
    pub pressure_pa_high: f64,
    /// Its parts.
    pub parts: Vec<PartSummary>,
}

/// A part of a test signal.
#[derive(Clone, Debug, Serialize)]
pub struct PartSummary {
    /// Its name.
    pub part: String,
    /// When it begins \[s\].
    pub begins_s: f64,
}

impl TestSignal {
    /// The signal within `limits`, written to `file`.
    pub fn summary(&self, limits: &Limits, file: &str) -> Summary {
        let parts = self.parts.iter().map(|(part, begins_s)| PartSummary {
            part: part.name(),
            begins_s: *begins_s,
        });
        Summary {
            experiment: file.into(),
            length_s: self.record.time_s().last().copied().unwrap_or(0.0),
            pressure_pa_low: limits.low_pa,
            pressure_pa_high: limits.high_pa,
            parts: parts.collect(),
        }
    }
}

/// Writes `parts` one after the other, within `limits`; vented at both ends.
pub fn test_signal(limits: &Limits, parts: &[Part]) -> TestSignal {
    let mut writer = Writer {
        limits: *limits,
        reference_pa: vec![0.0],
        open: vec![true],
        is_open: true,
    };
    let mut starts = Vec::new();
    for part in parts {
        starts.push((*part, writer.time_s()));
        writer.write(*part);
    }
    writer.ramp(0.0, 2.0);
    writer.hold(2.0);
    let rows = writer.reference_pa.len();
    let mut record = Record::new((0..rows).map(|row| row as f64 / RATE_HZ).collect());
    record.set(PRESSURE_REF_PA, writer.reference_pa);
    if writer.open.contains(&false) {
        let open = writer.open.iter().map(|open| f64::from(*open));
        record.set(VALVE_OPEN, open.collect());
    }
    TestSignal {
        record,
        parts: starts,
    }
}

impl Writer {
    fn time_s(&self) -> f64 {
        (self.reference_pa.len() - 1) as f64 / RATE_HZ
    }

    fn last_pa(&self) -> f64 {
        self.reference_pa.last().copied().unwrap_or(0.0)
    }

    /// Adds `duration_s` of `shape`, a function of the time since its start, within pressure and
    /// rate limits, in whole pascals.
    fn draw(&mut self, duration_s: f64, shape: impl Fn(f64) -> f64) {
        for row in 1..=(duration_s * RATE_HZ).round() as usize {
            let wanted_pa = shape(row as f64 / RATE_HZ).round();
            let wanted_pa = wanted_pa.clamp(0.0, self.limits.high_pa);
            let last_pa = self.last_pa();
            let change_pa_max = self.limits.row_change_pa(last_pa);
            let change_pa = (wanted_pa - last_pa).clamp(-change_pa_max, change_pa_max);
            self.reference_pa.push(last_pa + change_pa);
            self.open.push(self.is_open);
        }
    }

    fn hold(&mut self, duration_s: f64) {
        let pa = self.last_pa();
        self.draw(duration_s, |_| pa);
    }

    /// A ramp of `duration_s`, or longer if the rate limit requires it.
    fn ramp(&mut self, to_pa: f64, duration_s: f64) {
        let from_pa = self.last_pa();
        // The rate limit is lowest at the lower end.
        let change_pa_max = self.limits.row_change_pa(from_pa.min(to_pa));
        let rows = (duration_s * RATE_HZ)
            .max((to_pa - from_pa).abs() / change_pa_max)
            .ceil();
        let duration_s = rows / RATE_HZ;
        self.draw(duration_s, |time_s| match time_s / duration_s {
            share if share < 1.0 => from_pa + share * (to_pa - from_pa),
            _ => to_pa,
        });
    }

    /// A step towards `to_pa`, limited to the allowed range, and a hold.
    fn step(&mut self, to_pa: f64, duration_s: f64) {
        let range = self.limits.step_range(self.last_pa());
        let to_pa = to_pa.clamp(*range.start(), *range.end());
        self.draw(duration_s, |_| to_pa);
    }

    /// A slow ramp to `to_pa`, and a hold until the weight is at rest.
    fn approach(&mut self, to_pa: f64) {
        self.ramp(to_pa, 4.0);
        self.hold(2.0);
    }

    fn write(&mut self, part: Part) {
        match part {
            Part::Zero => {
                self.ramp(0.0, 2.0);
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

    /// The levels of the steps: up twice, and back.
    fn levels(&mut self) -> [f64; 4] {
        let Limits {
            low_pa, high_pa, ..
        } = self.limits;
        self.approach(low_pa.max(0.2 * high_pa));
        let middle_pa = 0.5 * (low_pa + high_pa);
        [middle_pa, high_pa, middle_pa, low_pa]
    }

    /// Twice up and down over the range, first with a minor loop in each direction; then twice
    /// more, each time four times as fast.
    fn triangles(&mut self) {
        let Limits {
            low_pa, high_pa, ..
        } = self.limits;
        self.approach(low_pa);
        for ramp_s in [16.0, 4.0, 1.0] {
            for turns in [true, true, false, false] {
                let from_pa = self.last_pa();
                let to_pa = if from_pa > low_pa { low_pa } else { high_pa };
                let level = |share: f64| from_pa + share * (to_pa - from_pa);
                if turns {
                    self.ramp(level(0.6), 0.6 * ramp_s);
                    self.ramp(level(0.3), 0.3 * ramp_s);
                    self.ramp(to_pa, 0.7 * ramp_s);
                } else {
                    self.ramp(to_pa, ramp_s);
                }
            }
        }
    }

    /// Seven octaves, each with half the amplitude of the one below, so that all change equally
    /// fast, with Schroeder's phases (1970) for a low crest factor.
    fn multisine(&mut self) {
        const OCTAVES: i32 = 7;
        let (middle_pa, part_pa) = self.limits.middle();
        self.approach(middle_pa);
        let sum = |time_s: f64| -> f64 {
            let octaves = (0..OCTAVES).map(|octave| {
                let phase = -PI * f64::from(octave * (octave + 1)) / f64::from(OCTAVES);
                let frequency_hz = 0.1 * f64::from(1 << octave);
                (TAU * frequency_hz * time_s + phase).sin() / f64::from(1 << octave)
            });
            octaves.sum()
        };
        // The period is 10 s; the sum of the amplitudes is below 2.
        let first_pa = middle_pa + 0.5 * part_pa * sum(0.0);
        self.ramp(first_pa, 2.0);
        self.draw(60.0, |time_s| middle_pa + 0.5 * part_pa * sum(time_s));
    }

    /// Steps around the middle, each size twice as large as the one before.
    fn sweep(&mut self) {
        let (middle_pa, part_pa) = self.limits.middle();
        self.approach(middle_pa);
        for halvings in (0..5).rev() {
            let size_pa = part_pa / f64::from(1 << halvings);
            for sign in [1.0, -1.0, 1.0, -1.0] {
                self.draw(2.0, |_| middle_pa + sign * size_pa);
            }
        }
        self.draw(2.0, |_| middle_pa);
    }
}
