//! The controller's hysteresis loop that is nearest to that of a rig.

use super::trial::{Trial, experiment};
use crate::error::BadInput;
use model_core::compensation::{Compensation, CompensationState};
use model_core::pressure::GaugePa;
use muscle_plant::effects::CompensationMethod;

/// Least-squares fit of the controller's loop to the force that the hystereses of the rig take in
/// its closed loop, in whatever form they are: area over pressure \[m²\] and presliding distance
/// \[-\].
pub(super) fn fitted(trial: &Trial) -> Result<(f64, f64), BadInput> {
    let mut rig = trial.rig.clone();
    rig.effects
        .retain(|effect| matches!(effect.kind.compensation, CompensationMethod::HysteresisLoop));
    let ticks = trial.run(&rig, trial.plain, &experiment())?;
    let muscle = trial.plain.values().muscle;
    let fit = |presliding_distance: f64| {
        let unit_loop = Compensation {
            hysteresis_area_m2: 1.0,
            hysteresis_reach: presliding_distance as f32,
            force_n_max: f32::INFINITY,
            ..Compensation::OFF
        };
        let mut memory = CompensationState::default();
        let (mut squares, mut product, mut total) = (0.0, 0.0, 0.0);
        for tick in &ticks {
            memory.follow(&unit_loop, &muscle, tick.contraction as f32);
            let shape = f64::from(memory.hysteresis_n(&unit_loop, GaugePa(tick.pressure.0 as f32)));
            let taken_n =
                rig.nominal.muscle.force_n(tick.contraction, tick.pressure) - tick.force_n;
            squares += shape * shape;
            product += shape * taken_n;
            total += taken_n * taken_n;
        }
        let area_m2 = if squares > 0.0 {
            product / squares
        } else {
            0.0
        };
        (
            total - area_m2 * product,
            area_m2.max(0.0),
            presliding_distance,
        )
    };
    // From 0.001 to beyond the stroke, in steps of 12 %.
    let distances = (0..56).map(|step| 1e-3 * 1.12_f64.powi(step));
    let best = distances.map(fit).min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(best.map_or((0.0, 0.0), |(_, area_m2, distance)| (area_m2, distance)))
}
