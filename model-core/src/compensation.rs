//! Compensation of effects that are not in the paper's equations. Off unless the settings switch it
//! on.
//!
//! Before Eq 8, forces are added: to F_c those of friction and of another weight, and that of the
//! muscle's hysteresis. After Eq 8, the reference leads by the lag of the pressure and is moved
//! beyond the valve's dead zone. All terms are bounded, and every limit of the supervisor comes
//! after them. Sensors are corrected by their scales, not here.

use crate::constants::{GRAVITY_M_PER_S2, TICK_S};
use crate::muscle::Muscle;
use crate::number::{Number, limited};
use crate::pressure::GaugePa;
use serde::{Deserialize, Serialize};

/// Elements of the hysteresis: with fewer, the corners between them are felt.
const ELEMENTS: usize = 3;
/// Share of the lead over which the pressure's rate is averaged: a smaller one passes noise.
const LEAD_FILTER: f32 = 0.25;
/// Error, as a share of the dead zone's width, at which its inverse is complete, on either side.
const DEAD_ZONE_ROUNDING: f32 = 0.25;

/// The settings of the compensation; all 0: none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// Half the width of the muscle's loop of force against contraction, over its pressure \[m²\].
    pub hysteresis_area_m2: f32,
    /// Contraction from rest after which that loop has its whole width \[-\].
    pub hysteresis_reach: f32,
    /// Friction of the load \[N\].
    pub friction_n: f32,
    /// Presliding distance: travel after a reversal until friction has its full value \[m\].
    pub friction_reach_m: f32,
    /// Mass of the payload in addition to the nominal mass; may be negative \[kg\].
    pub payload_kg: f32,
    /// Largest force for the load, and for hysteresis \[N\].
    pub force_n_max: f32,
    /// Lag and delay of the pressure behind its reference \[s\].
    pub lead_s: f32,
    /// Error that does not open the valve's supply port \[Pa\].
    pub dead_zone_filling_pa: f32,
    /// Error that does not open the valve's exhaust port \[Pa\].
    pub dead_zone_exhausting_pa: f32,
    /// Largest pressure for lag and dead zone together \[Pa\].
    pub pressure_pa_max: f32,
}

impl Compensation {
    /// No compensation.
    pub const OFF: Compensation = Compensation {
        hysteresis_area_m2: 0.0,
        hysteresis_reach: 0.0,
        friction_n: 0.0,
        friction_reach_m: 0.0,
        payload_kg: 0.0,
        force_n_max: 0.0,
        lead_s: 0.0,
        dead_zone_filling_pa: 0.0,
        dead_zone_exhausting_pa: 0.0,
        pressure_pa_max: 0.0,
    };
}

/// The contraction of a slider that is dragged behind the muscle's by a spring: one element of a
/// Maxwell-slip (Prandtl–Ishlinskii) sum. It needs no speed, so it does not flicker at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Slider(f32);

impl Slider {
    /// The slider after the contraction has come to `contraction`.
    fn dragged(self, contraction: f32, reach: f32) -> Slider {
        Slider(
            self.0
                .at_least(contraction - reach)
                .at_most(contraction + reach),
        )
    }

    /// Stretch of the spring over the one at which the slider moves: 1 while the muscle contracts,
    /// −1 while it extends.
    fn share(self, contraction: f32, reach: f32) -> f32 {
        if reach > 0.0 {
            limited((contraction - self.0) / reach, 1.0)
        } else {
            0.0
        }
    }
}

/// State of the compensation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompensationState {
    contraction: f32,
    hysteresis: [Slider; ELEMENTS],
    friction: Slider,
    /// Eq 8 one tick ago \[Pa\], while assisting.
    law_pa: Option<f32>,
    /// Its rate, averaged \[Pa/s\].
    rate_pa_per_s: f32,
}

/// Reach of element `number` of the hysteresis: spread evenly.
fn element_reach(values: &Compensation, number: usize) -> f32 {
    values.hysteresis_reach * ((number as f32 + 0.5) / ELEMENTS as f32)
}

/// Reach of friction as a contraction \[-\].
fn friction_reach(values: &Compensation, muscle: &Muscle<f32>) -> f32 {
    values.friction_reach_m / muscle.initial_length_m
}

impl CompensationState {
    /// One tick later, the muscle's contraction being `contraction`.
    pub fn follow(&mut self, values: &Compensation, muscle: &Muscle<f32>, contraction: f32) {
        self.contraction = contraction;
        for (number, slider) in self.hysteresis.iter_mut().enumerate() {
            *slider = slider.dragged(contraction, element_reach(values, number));
        }
        self.friction = self
            .friction
            .dragged(contraction, friction_reach(values, muscle));
    }

    /// Force of friction and payload \[N\], to add to F_c:
    /// F_f s + M_p g, with s from −1 to 1 the direction.
    pub fn load_n(&self, values: &Compensation, muscle: &Muscle<f32>) -> f32 {
        let reach = friction_reach(values, muscle);
        let friction_n = values.friction_n * self.friction.share(self.contraction, reach);
        let payload_n = values.payload_kg * GRAVITY_M_PER_S2 as f32;
        limited(friction_n + payload_n, values.force_n_max)
    }

    /// Force of the muscle's hysteresis \[N\], to add to the force of Eq 8:
    /// A P s, with s from −1 to 1 the mean stretch of the elements.
    pub fn hysteresis_n(&self, values: &Compensation, pressure: GaugePa<f32>) -> f32 {
        let mut sum = 0.0;
        for (number, slider) in self.hysteresis.iter().enumerate() {
            sum += slider.share(self.contraction, element_reach(values, number));
        }
        let size_n = values.hysteresis_area_m2 * pressure.0.at_least(0.0);
        limited(size_n * (sum / ELEMENTS as f32), values.force_n_max)
    }

    /// Reference pressure \[Pa\] where Eq 8 gives P_r = `law_pa` and P is `pressure`:
    /// P_r + τ dP_r/dt, moved on by the dead zone's width in the error's direction.
    pub(crate) fn pressure_pa(
        &mut self,
        values: &Compensation,
        law_pa: f32,
        pressure: GaugePa<f32>,
    ) -> f32 {
        let change_pa = law_pa - self.law_pa.unwrap_or(law_pa);
        let share = TICK_S / TICK_S.at_least(LEAD_FILTER * values.lead_s);
        self.rate_pa_per_s += share * (change_pa / TICK_S - self.rate_pa_per_s);
        self.law_pa = Some(law_pa);
        let lead_pa = values.lead_s * self.rate_pa_per_s;
        let error_pa = law_pa + lead_pa - pressure.0;
        let width_pa = if error_pa > 0.0 {
            values.dead_zone_filling_pa
        } else {
            values.dead_zone_exhausting_pa
        };
        let beyond_pa = limited(error_pa / DEAD_ZONE_ROUNDING, width_pa);
        law_pa + limited(lead_pa + beyond_pa, values.pressure_pa_max)
    }

    /// Restarts the lead: the last value of Eq 8 is no longer valid.
    pub(crate) fn restart_lead(&mut self) {
        self.law_pa = None;
        self.rate_pa_per_s = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::SettingsValues;
    use proptest::prelude::*;

    const MUSCLE: Muscle<f32> = SettingsValues::reference().muscle;
    const EVERY_PART: Compensation = Compensation {
        hysteresis_area_m2: 6e-5,
        hysteresis_reach: 0.03,
        friction_n: 8.0,
        friction_reach_m: 1e-3,
        payload_kg: 1.0,
        force_n_max: 40.0,
        lead_s: 0.02,
        dead_zone_filling_pa: 8e3,
        dead_zone_exhausting_pa: 4e3,
        pressure_pa_max: 5e4,
    };

    /// The state after these contractions.
    fn after(values: &Compensation, way: &[f32]) -> CompensationState {
        let mut state = CompensationState::default();
        for contraction in way {
            state.follow(values, &MUSCLE, *contraction);
        }
        state
    }

    /// Within what f32 leaves of a contraction of 0.2 over an element's reach, 1e-5 of 18 N.
    fn close(a: f32, b: f32) -> bool {
        (a - b).abs() < 1e-3
    }

    fn hysteresis_n(way: &[f32]) -> f32 {
        after(&EVERY_PART, way).hysteresis_n(&EVERY_PART, GaugePa(3e5))
    }

    #[test]
    fn without_compensation_nothing_is_added() {
        let mut state = after(&Compensation::OFF, &[0.0, 0.2, 0.1]);
        assert_eq!(state.load_n(&Compensation::OFF, &MUSCLE), 0.0);
        assert_eq!(state.hysteresis_n(&Compensation::OFF, GaugePa(3e5)), 0.0);
        for law_pa in [0.0, 1e5, 3e5] {
            let asked_pa = state.pressure_pa(&Compensation::OFF, law_pa, GaugePa(2e5));
            assert_eq!(asked_pa, law_pa);
        }
    }

    /// 6e-5 m² at 300 kPa are 18 N either way: complete after the reach from rest, reversed after
    /// twice the reach.
    #[test]
    fn hysteresis_is_a_closed_loop() {
        assert!(close(hysteresis_n(&[0.0, 0.03]), 18.0));
        assert!(close(hysteresis_n(&[0.0, 0.2, 0.14]), -18.0));
        // A minor loop comes back to where it began.
        let major = [0.0, 0.2, 0.15];
        let minor = [0.0, 0.2, 0.15, 0.16, 0.15];
        assert!(close(hysteresis_n(&major), hysteresis_n(&minor)));
        // None without pressure, nor from a vacuum that a sensor reports by error.
        let state = after(&EVERY_PART, &major);
        assert_eq!(state.hysteresis_n(&EVERY_PART, GaugePa(-1e5)), 0.0);
    }

    #[test]
    fn friction_keeps_its_direction_at_rest_and_does_not_flicker() {
        let load_n = |way: &[f32]| after(&EVERY_PART, way).load_n(&EVERY_PART, &MUSCLE);
        let payload_n = 9.80665;
        assert!(close(load_n(&[0.0, 0.1, 0.1, 0.1]), 8.0 + payload_n));
        assert!(close(load_n(&[0.0, 0.1, 0.05]), -8.0 + payload_n));
        // Up and down by one of the encoder's counts, 12.5 µm of the reach's 1 mm.
        let count = 12.5e-6 / 0.3;
        let flicker_n = load_n(&[0.0, 0.1]) - load_n(&[0.0, 0.1, 0.1 - count]);
        assert!((flicker_n - 8.0 * 0.0125).abs() < 1e-3, "{flicker_n}");
    }

    /// On a ramp of 100 kPa/s the reference leads by 20 ms, which are 2 kPa. The dead zone's
    /// inverse is complete from a quarter of its width on.
    #[test]
    fn reference_leads_and_is_moved_beyond_the_dead_zone() {
        let lead = Compensation {
            dead_zone_filling_pa: 0.0,
            dead_zone_exhausting_pa: 0.0,
            ..EVERY_PART
        };
        let mut state = CompensationState::default();
        let ahead_pa = |tick: u8| {
            let law_pa = 2e5 + 1e3 * f32::from(tick);
            state.pressure_pa(&lead, law_pa, GaugePa(law_pa)) - law_pa
        };
        let ahead_pa: Vec<f32> = (0..3).map(ahead_pa).collect();
        assert_eq!(ahead_pa[0], 0.0);
        assert!((ahead_pa[2] - 2e3).abs() < 1.0, "{ahead_pa:?}");
        let beyond_pa = |error_pa: f32| {
            let asked_pa =
                CompensationState::default().pressure_pa(&EVERY_PART, 2e5, GaugePa(2e5 - error_pa));
            asked_pa - 2e5
        };
        assert_eq!(
            [2e3, 1e4, -1e3, -1e4].map(beyond_pa),
            [8e3, 8e3, -4e3, -4e3]
        );
        assert_eq!([1e3, 0.0, -500.0].map(beyond_pa), [4e3, 0.0, -2e3]);
    }

    /// Any number, infinity and NaN included.
    fn any() -> impl Strategy<Value = f32> {
        prop_oneof![
            proptest::num::f32::ANY,
            Just(f32::NAN),
            Just(f32::INFINITY),
            -1e6_f32..1e6,
        ]
    }

    proptest! {
        #[test]
        fn every_input_gives_a_bounded_output(
            way in proptest::collection::vec(any(), 1..8),
            pressures in proptest::collection::vec((0.0_f32..5e5, any()), 1..8),
        ) {
            let values = &Compensation { force_n_max: 10.0, ..EVERY_PART };
            let mut state = after(values, &way);
            let force_n_max = values.force_n_max;
            prop_assert!(state.load_n(values, &MUSCLE).abs() <= force_n_max);
            for (law_pa, pressure_pa) in pressures {
                let pressure = GaugePa(pressure_pa);
                prop_assert!(state.hysteresis_n(values, pressure).abs() <= force_n_max);
                let asked_pa = state.pressure_pa(values, law_pa, pressure);
                // Half a pascal for the rounding of f32.
                prop_assert!((asked_pa - law_pa).abs() <= values.pressure_pa_max + 0.5);
            }
        }
    }
}
