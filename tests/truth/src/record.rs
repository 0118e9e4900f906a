//! Simulates the record of a drive: the run, the sensors' noise, and the text.

use rand::distr::Distribution;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::Serialize;

use crate::drive::Drive;
use crate::hidden::{Hidden, Moment, Reading};
use crate::machine::Machine;
use crate::rig::Rig;

/// Longest step of the integrator; a tenth of the fastest of its time constants.
pub(crate) const STEP_S: f64 = 1.0e-4;
/// Rest before each run, in which the filled muscle reaches its steady state.
const REST_S: f64 = 6.0;

/// One sensor: gaussian noise, then rounding to its steps.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Sensor {
    /// One sigma, before rounding.
    pub sigma: f64,
    /// Step of the converter or the encoder.
    pub step: f64,
}

impl Sensor {
    /// Root mean square of noise and rounding together.
    #[must_use]
    pub fn noise(&self) -> f64 {
        self.sigma.hypot(self.step / 12.0_f64.sqrt())
    }

    pub(crate) fn sense(&self, value: f64, rng: &mut Pcg64) -> f64 {
        let normal: f64 = StandardNormal.sample(rng);
        ((value + self.sigma * normal) / self.step).round() * self.step
    }
}

/// The rig's sensors, in the columns' units.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Sensors {
    /// Of the muscle's pressure, Pa.
    pub pressure_pa: Sensor,
    /// Of the contraction.
    pub contraction: Sensor,
    /// Of the muscle's force, N.
    pub force_n: Sensor,
}

impl Default for Sensors {
    /// Twelve bits over 1 MPa; 10 µm on 0.3 m; a load cell.
    fn default() -> Self {
        Self {
            pressure_pa: Sensor {
                sigma: 240.0,
                step: 1.0e6 / 4096.0,
            },
            contraction: Sensor {
                sigma: 2.8e-5,
                step: 1.0e-5 / 0.3,
            },
            force_n: Sensor {
                sigma: 0.5,
                step: 0.1,
            },
        }
    }
}

/// A drive, and the number of its samples before the record begins.
pub(crate) struct Run {
    pub(crate) drive: Drive,
    pub(crate) unrecorded: usize,
}

/// The shut-off valve, implemented as an effect before all others: while it is shut the flow is
/// zero.
struct ShutOffValve<'a> {
    drive: &'a Drive,
    start_s: f64,
}

impl Hidden for ShutOffValve<'_> {
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        if self.drive.is_shut(now.time_s + self.start_s) {
            0.0
        } else {
            flow
        }
    }
}

impl Run {
    /// Readings of noiseless sensors at the record's samples.
    pub(crate) fn simulate(&self, rig: &Rig, effects: &[&dyn Hidden]) -> Vec<Reading> {
        self.simulate_in_steps(rig, effects, STEP_S)
    }

    pub(crate) fn simulate_in_steps(
        &self,
        rig: &Rig,
        effects: &[&dyn Hidden],
        step_s: f64,
    ) -> Vec<Reading> {
        let drive = &self.drive;
        // the record's own time begins at its first sample
        let start_s = self.unrecorded as f64 * drive.period_s;
        let rest_steps = (REST_S / step_s).round() as usize;
        let steps_a_sample = (drive.period_s / step_s).round() as usize;
        let steps = (drive.reference_pa.len() - 1) * steps_a_sample;
        let first_s = -start_s - REST_S;
        let shut_off_valve = ShutOffValve { drive, start_s };
        let mut parts: Vec<&dyn Hidden> = Vec::new();
        if !drive.shut.is_empty() {
            parts.push(&shut_off_valve);
        }
        parts.extend(effects);
        let mut machine = Machine::at_rest(rig, &parts, first_s, drive.reference_pa[0]);
        let mut readings = Vec::new();
        for i in 0..=rest_steps + steps {
            let done = i.checked_sub(rest_steps);
            if done == Some(0) {
                machine.settle();
            }
            if let Some(done) = done
                && done % steps_a_sample == 0
                && done / steps_a_sample >= self.unrecorded
            {
                readings.push(machine.reading());
            }
            let mut command_s = (i as f64 + 0.5) * step_s - REST_S - start_s;
            for effect in effects {
                command_s = effect.command_time_s(command_s);
            }
            machine.step(step_s, drive.at(command_s + start_s));
        }
        let finite = |r: &Reading| (r.pressure_pa + r.contraction + r.force_n).is_finite();
        assert!(readings.iter().all(finite), "the run went astray");
        readings
    }

    /// The record as text, with noise.
    pub(crate) fn csv(
        &self,
        readings: &[Reading],
        sensors: &Sensors,
        with_force: bool,
        rng: &mut Pcg64,
    ) -> String {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let mut header = vec!["time_s", "pressure_ref_pa", "pressure_pa", "contraction"];
        if with_force {
            header.push("force_n");
        }
        let shut = self.drive.shut.get(self.unrecorded..).unwrap_or_default();
        if !shut.is_empty() {
            header.push("valve_open");
        }
        writer.write_record(&header).expect("memory takes it");
        let references = &self.drive.reference_pa[self.unrecorded..];
        for (i, (reading, reference_pa)) in readings.iter().zip(references).enumerate() {
            let mut row = vec![
                format!("{:.4}", i as f64 * self.drive.period_s),
                format!("{reference_pa:.0}"),
                format!("{:.2}", sensors.pressure_pa.sense(reading.pressure_pa, rng)),
                format!("{:.7}", sensors.contraction.sense(reading.contraction, rng)),
            ];
            // drawn in any case, so that the same case without force has the same noise
            let force_n = sensors.force_n.sense(reading.force_n, rng);
            if with_force {
                row.push(format!("{force_n:.2}"));
            }
            if let Some(shut) = shut.get(i) {
                row.push(u8::from(!shut).to_string());
            }
            writer.write_record(&row).expect("memory takes it");
        }
        let bytes = writer.into_inner().expect("memory takes it");
        String::from_utf8(bytes).expect("numbers are text")
    }
}
