//! Sizes of what is compensated, and the settings that follow from them.

use super::hysteresis_loop;
use super::trial::Trial;
use super::{OFF_BY, Stage};
use crate::error::BadInput;
use model_core::compensation::Compensation;
use model_core::settings::Settings;
use muscle_plant::effects::CompensationMethod;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;

/// Distance over which friction without presliding is reversed \[m\]: 80 counts of the encoder.
const FRICTION_REACH_M: f64 = 1e-3;
/// Largest pressure that lead and dead zone add \[Pa\]: a tenth of the paper's supply.
const PRESSURE_PA_MAX: f32 = 5e4;

/// The part of a size that is applied.
#[derive(Clone, Copy)]
enum Scaling {
    /// A share of it: too large a force or pressure drives the motion.
    Share,
    /// A multiple of it: too short a distance is too steep for the loop.
    Longer,
    /// All of it.
    Full,
}

const HYSTERESIS_AREA: usize = 0;
const HYSTERESIS_REACH: usize = 1;
const FRICTION: usize = 2;
const FRICTION_REACH: usize = 3;
const PAYLOAD: usize = 4;
const FILLING: usize = 5;
const EXHAUSTING: usize = 6;
const LEAD: usize = 7;
const SENSOR_OFFSET: usize = 8;
const SENSOR_GAIN: usize = 9;

/// For each of the above.
const SCALINGS: [Scaling; 10] = [
    Scaling::Share,
    Scaling::Longer,
    Scaling::Share,
    Scaling::Longer,
    Scaling::Share,
    Scaling::Share,
    Scaling::Share,
    Scaling::Share,
    Scaling::Full,
    Scaling::Full,
];

/// A value for each of the above, in the units of the settings; 0: not compensated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sizes([f64; SCALINGS.len()]);

impl Sizes {
    /// The sizes that `stage` needs for the effects of the rig; `None` if none of them uses it.
    pub fn for_stage(trial: &Trial, stage: Stage) -> Result<Option<Sizes>, BadInput> {
        let mut effects = stage.effects(trial.rig).peekable();
        if effects.peek().is_none() {
            return Ok(None);
        }
        let mut sizes = Sizes::default();
        let values = &mut sizes.0;
        for effect in effects {
            match effect.kind.compensation {
                CompensationMethod::Friction(added) => {
                    values[FRICTION] += added(effect).coulomb_n;
                    values[FRICTION_REACH] += added(effect).presliding_m;
                }
                CompensationMethod::Payload(mass_kg) => values[PAYLOAD] += mass_kg(effect),
                CompensationMethod::ValveDeadZone(widths) => {
                    values[FILLING] += widths(effect).filling_pa;
                    values[EXHAUSTING] += widths(effect).exhausting_pa;
                }
                CompensationMethod::PressureSensorOffset(offset_pa) => {
                    values[SENSOR_OFFSET] += offset_pa(effect);
                }
                CompensationMethod::PressureSensorGain(error) => {
                    values[SENSOR_GAIN] += error(effect);
                }
                // Fitted below for all hystereses together.
                CompensationMethod::HysteresisLoop => {}
                CompensationMethod::Lag | CompensationMethod::Unavailable(_) => {}
            }
        }
        match stage {
            Stage::Hysteresis => {
                (values[HYSTERESIS_AREA], values[HYSTERESIS_REACH]) =
                    hysteresis_loop::fitted(trial)?;
            }
            Stage::Friction => {
                values[FRICTION_REACH] = values[FRICTION_REACH].max(FRICTION_REACH_M)
            }
            _ => {}
        }
        Ok(Some(sizes))
    }

    /// A lead \[s\] alone.
    pub fn lead(lead_s: f64) -> Sizes {
        Sizes::default().with_lead(lead_s)
    }

    /// These sizes with a lead \[s\].
    pub fn with_lead(mut self, lead_s: f64) -> Sizes {
        self.0[LEAD] = lead_s;
        self
    }

    /// Whether there is a lead.
    pub fn have_lead(&self) -> bool {
        self.0[LEAD] > 0.0
    }

    /// These sizes with those of `others` that are not 0: forces and pressures times `share`,
    /// distances times `longer`.
    pub fn with(mut self, others: &Sizes, share: f64, longer: f64) -> Sizes {
        for ((value, other), scaling) in self.0.iter_mut().zip(others.0).zip(SCALINGS) {
            if other != 0.0 {
                *value = match scaling {
                    Scaling::Share => share * other,
                    Scaling::Longer => longer * other,
                    Scaling::Full => other,
                };
            }
        }
        self
    }

    /// Whether they contain a distance.
    pub fn have_distance(&self) -> bool {
        let mut values = self.0.iter().zip(SCALINGS);
        values.any(|(value, scaling)| *value != 0.0 && matches!(scaling, Scaling::Longer))
    }

    /// The settings `plain` with this compensation. Its force is limited to the sum of the sizes,
    /// its pressure to [`PRESSURE_PA_MAX`].
    pub fn settings(&self, plain: &Settings) -> Result<Settings, BadInput> {
        let mut values = *plain.values();
        let value = |index: usize| self.0[index] as f32;
        values.load_kg += value(PAYLOAD);
        let load_n = value(FRICTION) + value(PAYLOAD).abs() * GRAVITY_M_PER_S2 as f32;
        let hysteresis_n = value(HYSTERESIS_AREA) * values.pressure_pa_max;
        let shaped = value(LEAD) > 0.0 || value(FILLING) > 0.0 || value(EXHAUSTING) > 0.0;
        values.compensation = Compensation {
            hysteresis_area_m2: value(HYSTERESIS_AREA),
            hysteresis_reach: value(HYSTERESIS_REACH),
            friction_n: value(FRICTION),
            friction_reach_m: value(FRICTION_REACH),
            payload_kg: value(PAYLOAD),
            force_n_max: load_n.max(hysteresis_n),
            lead_s: value(LEAD),
            dead_zone_filling_pa: value(FILLING),
            dead_zone_exhausting_pa: value(EXHAUSTING),
            pressure_pa_max: if shaped { PRESSURE_PA_MAX } else { 0.0 },
        };
        let scale = &mut values.pressure_sensor;
        scale.zero_count += value(SENSOR_OFFSET) / scale.per_count;
        scale.per_count /= 1.0 + value(SENSOR_GAIN);
        Settings::new(values).map_err(|error| BadInput::file("compensation", error.to_string()))
    }

    /// All combinations of these sizes with every value off by [`OFF_BY`], up or down.
    pub fn corners(&self) -> Vec<Sizes> {
        let active: Vec<usize> = (0..SCALINGS.len()).filter(|i| self.0[*i] != 0.0).collect();
        let corner = |bits: usize| {
            let mut corner = *self;
            for (bit, index) in active.iter().enumerate() {
                let up = bits >> bit & 1 == 1;
                corner.0[*index] *= 1.0 + if up { OFF_BY } else { -OFF_BY };
            }
            corner
        };
        (0..1_usize << active.len()).map(corner).collect()
    }
}
