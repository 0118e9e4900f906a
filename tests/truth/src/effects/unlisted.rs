//! Effects that are in no catalogue of a diagnosis.

use std::f64::consts::TAU;

use serde::Serialize;

use super::{Drawn, Form, between, scale};
use crate::hidden::{Hidden, Load, Moment, Reading};
use crate::machine::GRAVITY_M_PER_S2;

/// Whether `time_s` falls into one of the pulses.
fn in_pulse(time_s: f64, period_s: f64, width_s: f64) -> bool {
    time_s.rem_euclid(period_s) < width_s
}

/// A force that is periodic in the position, as of a rack or a chain.
#[derive(Serialize)]
struct Cogging {
    amplitude_n: f64,
    pitch: f64,
}

impl Hidden for Cogging {
    fn load(&self, load: &mut Load, now: &Moment, _: &[f64], _: &mut [f64]) {
        load.pull_n += self.amplitude_n * (TAU * now.contraction / self.pitch).sin();
    }
}

pub(super) const COGGING: &[Form] = &[Form::new("sine", |size, _, rng| {
    Drawn::new(Cogging {
        amplitude_n: scale(size, 2.0, 25.0),
        pitch: between(rng, 0.008, 0.03),
    })
})];

/// A part of the weight is a pendulum.
#[derive(Serialize)]
struct SwingingPayload {
    swinging_kg: f64,
    length_m: f64,
    start_rad: f64,
    damping_per_s: f64,
}

/// States: angle and its rate.
impl Hidden for SwingingPayload {
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x[0] = self.start_rad;
        x[1] = 0.0;
    }
    fn load(&self, load: &mut Load, _: &Moment, x: &[f64], dx: &mut [f64]) {
        dx[0] = x[1];
        dx[1] = -GRAVITY_M_PER_S2 / self.length_m * x[0].sin() - self.damping_per_s * x[1];
        // the string passes on its pull's upright part only, and bears the turning; what the
        // muscle's motion does to the swing is left out
        load.mass_kg -= self.swinging_kg * x[0].sin().powi(2);
        load.pull_n += self.swinging_kg * self.length_m * x[1] * x[1] * x[0].cos();
    }
}

pub(super) const SWINGING_PAYLOAD: &[Form] = &[Form::new("pendulum", |size, rig, rng| {
    Drawn::new(SwingingPayload {
        swinging_kg: rig.mass_kg * between(rng, 0.4, 0.8),
        length_m: between(rng, 0.25, 0.8),
        start_rad: scale(size, 0.2, 0.8),
        damping_per_s: between(rng, 0.005, 0.03),
    })
})];

/// Impulses on the load, as of knocks.
#[derive(Serialize)]
struct ForcePulses {
    pulse_n: f64,
    period_s: f64,
    width_s: f64,
}

impl Hidden for ForcePulses {
    fn load(&self, load: &mut Load, now: &Moment, _: &[f64], _: &mut [f64]) {
        if in_pulse(now.time_s, self.period_s, self.width_s) {
            load.pull_n += self.pulse_n;
        }
    }
}

pub(super) const FORCE_PULSES: &[Form] = &[Form::new("periodic", |size, _, rng| {
    Drawn::new(ForcePulses {
        pulse_n: scale(size, 6.0, 50.0),
        period_s: between(rng, 1.7, 4.5),
        width_s: between(rng, 0.06, 0.25),
    })
})];

/// Vibration of the floor.
#[derive(Serialize)]
struct FloorVibration {
    acceleration_m_per_s2: f64,
    frequency_hz: f64,
    mass_kg: f64,
}

impl Hidden for FloorVibration {
    fn load(&self, load: &mut Load, now: &Moment, _: &[f64], _: &mut [f64]) {
        let swing = (TAU * self.frequency_hz * now.time_s).sin();
        load.pull_n += self.mass_kg * self.acceleration_m_per_s2 * swing;
    }
}

pub(super) const FLOOR_VIBRATION: &[Form] = &[Form::new("sine", |size, rig, rng| {
    Drawn::new(FloorVibration {
        acceleration_m_per_s2: scale(size, 0.4, 2.0),
        frequency_hz: between(rng, 1.3, 7.0),
        mass_kg: rig.mass_kg,
    })
})];

/// Higher friction of the guide near one contraction, as of dirt.
#[derive(Serialize)]
struct PositionFriction {
    coulomb_n: f64,
    centre: f64,
    width: f64,
}

impl Hidden for PositionFriction {
    fn load(&self, load: &mut Load, now: &Moment, _: &[f64], _: &mut [f64]) {
        let off = (now.contraction - self.centre) / self.width;
        let here_n = self.coulomb_n * (-off * off).exp();
        load.coulomb_n += here_n;
        load.static_n += here_n;
    }
}

pub(super) const POSITION_FRICTION: &[Form] = &[Form::new("dirty-stretch", |size, _, rng| {
    Drawn::new(PositionFriction {
        coulomb_n: scale(size, 6.0, 50.0),
        centre: between(rng, 0.12, 0.22),
        width: between(rng, 0.01, 0.03),
    })
})];

/// Occasional disturbances of the reference.
#[derive(Serialize)]
struct PressurePulses {
    pulse_pa: f64,
    period_s: f64,
    width_s: f64,
}

impl Hidden for PressurePulses {
    fn reference_pa(&self, reference_pa: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let on = in_pulse(now.time_s, self.period_s, self.width_s);
        if on {
            reference_pa + self.pulse_pa
        } else {
            reference_pa
        }
    }
}

pub(super) const PRESSURE_PULSES: &[Form] = &[Form::new("periodic", |size, _, rng| {
    Drawn::new(PressurePulses {
        pulse_pa: scale(size, 2.0e3, 40.0e3),
        period_s: between(rng, 1.7, 4.5),
        width_s: between(rng, 0.05, 0.2),
    })
})];

/// A valve with coarse steps and stiction.
#[derive(Serialize)]
struct StickingValve {
    step_pa: f64,
    held_pa: f64,
}

impl StickingValve {
    fn moved_pa(&self, command_pa: f64, at_pa: f64) -> f64 {
        if (command_pa - at_pa).abs() > self.held_pa {
            (command_pa / self.step_pa).round() * self.step_pa
        } else {
            at_pa
        }
    }
}

/// State: where the valve is held.
impl Hidden for StickingValve {
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = now.command_pa;
    }
    fn reference_pa(&self, _: f64, now: &Moment, x: &[f64], _: &mut [f64]) -> f64 {
        self.moved_pa(now.command_pa, x[0])
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        x[0] = self.moved_pa(now.command_pa, x[0]);
    }
}

pub(super) const STICKING_VALVE: &[Form] = &[Form::new("quantised", |size, _, rng| {
    let step_pa = scale(size, 3.0e3, 25.0e3);
    Drawn::new(StickingValve {
        step_pa,
        held_pa: step_pa * between(rng, 1.0, 2.0),
    })
})];

/// The valve shuts repeatedly for a short time.
#[derive(Serialize)]
struct ValveDropout {
    period_s: f64,
    width_s: f64,
}

impl Hidden for ValveDropout {
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        if in_pulse(now.time_s, self.period_s, self.width_s) {
            0.0
        } else {
            flow
        }
    }
}

pub(super) const VALVE_DROPOUT: &[Form] = &[Form::new("periodic", |size, _, rng| {
    Drawn::new(ValveDropout {
        period_s: between(rng, 1.7, 4.5),
        width_s: scale(size, 0.04, 0.5),
    })
})];

/// Variation of the ambient temperature, which also changes the rubber.
#[derive(Serialize)]
struct AmbientDrift {
    swing_k: f64,
    period_s: f64,
    force_share_per_k: f64,
}

impl AmbientDrift {
    fn warmer_k(&self, time_s: f64) -> f64 {
        self.swing_k * (TAU * time_s / self.period_s).sin()
    }
}

impl Hidden for AmbientDrift {
    fn ambient_k(&self, ambient_k: f64, time_s: f64) -> f64 {
        ambient_k + self.warmer_k(time_s)
    }
    fn force_n(&self, force_n: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        force_n * (1.0 - self.force_share_per_k * self.warmer_k(now.time_s))
    }
}

pub(super) const AMBIENT_DRIFT: &[Form] = &[Form::new("sine", |size, _, rng| {
    Drawn::new(AmbientDrift {
        swing_k: scale(size, 3.0, 15.0),
        period_s: between(rng, 9.0, 25.0),
        force_share_per_k: between(rng, 0.003, 0.006),
    })
})];

/// A damaged encoder line: counts are lost in one range and direction.
#[derive(Serialize)]
struct LostCounts {
    lost_share: f64,
    from: f64,
    to: f64,
}

/// States: what the encoder has lost so far, and where it was last.
impl Hidden for LostCounts {
    fn states(&self) -> usize {
        2
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        let jammed = now.contraction.min(self.to) - x[1].max(self.from);
        x[0] += self.lost_share * jammed.max(0.0);
        x[1] = now.contraction;
    }
    fn read(&self, reading: &mut Reading, _: &Moment, x: &[f64]) {
        reading.contraction -= x[0];
    }
}

pub(super) const LOST_COUNTS: &[Form] = &[Form::new("one-way", |size, _, rng| {
    let from = between(rng, 0.12, 0.2);
    Drawn::new(LostCounts {
        lost_share: scale(size, 0.01, 0.2),
        from,
        to: from + between(rng, 0.01, 0.03),
    })
})];

/// An eccentric encoder wheel.
#[derive(Serialize)]
struct EncoderEccentricity {
    amplitude: f64,
    pitch: f64,
}

impl Hidden for EncoderEccentricity {
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        reading.contraction += self.amplitude * (TAU * now.contraction / self.pitch).sin();
    }
}

pub(super) const ENCODER_ECCENTRICITY: &[Form] = &[Form::new("sine", |size, _, rng| {
    Drawn::new(EncoderEccentricity {
        amplitude: scale(size, 0.1e-3, 2.0e-3),
        pitch: between(rng, 0.02, 0.05),
    })
})];

/// Interference on the pressure's cable.
#[derive(Serialize)]
struct PressureHum {
    amplitude_pa: f64,
    frequency_hz: f64,
}

impl Hidden for PressureHum {
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        reading.pressure_pa += self.amplitude_pa * (TAU * self.frequency_hz * now.time_s).sin();
    }
}

pub(super) const PRESSURE_HUM: &[Form] = &[Form::new("sine", |size, _, rng| {
    Drawn::new(PressureHum {
        amplitude_pa: scale(size, 0.5e3, 8.0e3),
        frequency_hz: between(rng, 0.3, 6.0),
    })
})];
