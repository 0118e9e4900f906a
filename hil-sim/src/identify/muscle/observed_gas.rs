//! The gas of a record, predicted from row to row from the measured pressure.
//!
//! What an effect does to the pressure depends on that pressure. So the plant is not run freely: in
//! each row its pressure is corrected to the measured one, without its noise, and what the plant
//! makes of the effect until the next row adds up as the nominal gas lets it. The result is linear
//! in the effect's size at the rig's own pressure, however large that size is.

use super::prepared::Prepared;
use super::residuals::gas_pressures_pa;
use crate::record::PRESSURE_PA;
use crate::rig::Rig;

/// Half widths of the means that take the noise out, in rows.
const REACHES: [usize; 7] = [0, 1, 2, 4, 8, 16, 32];
/// Standard errors by which a wider mean differs if the signal changes within it.
const CHANGE_ERRORS: f64 = 3.0;
/// Change of pressure in the difference quotient \[Pa\].
const STEP_PA: f64 = 1e3;

/// The gas of one record.
pub(super) struct ObservedGas {
    measured_pa: Vec<f64>,
    /// The measured pressure without noise, from which the next row is predicted.
    corrected_pa: Vec<f64>,
    /// The prediction of the nominal rig.
    predicted_pa: Vec<f64>,
    /// Share of an error of the pressure that is left a row later \[-\].
    kept: Vec<f64>,
}

impl ObservedGas {
    /// Of `record` with `rig`; `None` without a reference, or a solution.
    pub(super) fn new(record: &Prepared, rig: &Rig) -> Option<ObservedGas> {
        let measured_pa = record.gas.as_ref()?.column(PRESSURE_PA)?.to_vec();
        let free_pa = gas_pressures_pa(record, rig.clone(), None)?;
        let differences = measured_pa.iter().zip(&free_pa).map(|(a, b)| a - b);
        let differences: Vec<f64> = differences.collect();
        let smooth = without_noise(&differences, record.noise.pressure_pa);
        let corrected = free_pa.iter().zip(&smooth).map(|(a, b)| a + b);
        let corrected_pa: Vec<f64> = corrected.collect();
        let predicted_pa = gas_pressures_pa(record, rig.clone(), Some(&corrected_pa))?;
        let moved_pa: Vec<f64> = corrected_pa.iter().map(|pa| pa + STEP_PA).collect();
        let moved_pa = gas_pressures_pa(record, rig.clone(), Some(&moved_pa))?;
        let pairs = moved_pa.iter().zip(&predicted_pa);
        Some(ObservedGas {
            kept: pairs.map(|(moved, own)| (moved - own) / STEP_PA).collect(),
            measured_pa,
            corrected_pa,
            predicted_pa,
        })
    }

    /// Simulated less measured pressure, row by row \[Pa\]; NaN where it was not measured.
    pub(super) fn residuals_pa(&self) -> Vec<f64> {
        let pairs = self.predicted_pa.iter().zip(&self.corrected_pa);
        let errors_pa = self.accumulated(pairs.map(|(a, b)| a - b));
        let of = |(row, error_pa)| error_pa + self.corrected_pa[row] - self.measured_pa[row];
        errors_pa.into_iter().enumerate().map(of).collect()
    }

    /// By how much the pressure of `rig` is higher than the nominal one, row by row \[Pa\].
    pub(super) fn change_pa(&self, record: &Prepared, rig: &Rig) -> Option<Vec<f64>> {
        let moved_pa = gas_pressures_pa(record, rig.clone(), Some(&self.corrected_pa))?;
        let pairs = moved_pa.iter().zip(&self.predicted_pa);
        Some(self.accumulated(pairs.map(|(moved, own)| moved - own)))
    }

    /// What of a zero of the sensor shows, row by row \[-\]: the plant begins at what it reads.
    pub(super) fn zero_shares(&self) -> Vec<f64> {
        self.accumulated(self.kept.iter().map(|kept| 1.0 - kept))
    }

    /// What changes of the predictions add up to.
    fn accumulated(&self, changes_pa: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut sum_pa = 0.0;
        let rows = changes_pa.zip(&self.kept).enumerate();
        rows.map(|(row, (change_pa, kept))| {
            // The first row is where the plant begins.
            sum_pa = if row == 0 {
                0.0
            } else {
                kept * sum_pa + change_pa
            };
            sum_pa
        })
        .collect()
    }
}

/// Means over as many rows as the signal does not change in by more than its noise; gaps are
/// bridged.
fn without_noise(values: &[f64], noise: f64) -> Vec<f64> {
    let mean = |row: usize, reach: usize| {
        let reach = reach.min(row).min(values.len() - 1 - row);
        let present = values[row - reach..=row + reach]
            .iter()
            .filter(|v| !v.is_nan());
        let (sum, count) = present.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        (count > 0.0).then(|| (sum / count, noise / f64::sqrt(count)))
    };
    let smooth = |row: usize| {
        let mut best: Option<(f64, f64)> = None;
        for wider in REACHES.iter().filter_map(|reach| mean(row, *reach)) {
            if best.is_some_and(|(value, error)| (wider.0 - value).abs() > CHANGE_ERRORS * error) {
                break;
            }
            best = Some(wider);
        }
        best.map_or(0.0, |(value, _)| value)
    };
    (0..values.len()).map(smooth).collect()
}

#[cfg(test)]
mod tests {
    use super::super::residuals::pressures_pa;
    use super::*;
    use crate::identify::inputs::Inputs;
    use crate::record::{CONTRACTION, PRESSURE_REF_PA, Record};
    use muscle_plant::effects::Effect;
    use muscle_plant::nominal::Load;

    /// Steps of the reference between 1 and 3 bar on a clamped muscle, and its pressure with the
    /// effects of `rig`.
    fn prepared(rig: &Rig) -> Prepared {
        let time_s: Vec<f64> = (0..1500).map(|row| 0.01 * f64::from(row)).collect();
        let mut record = Record::new(time_s.clone());
        let reference_pa = |t: &f64| if (t / 1.5) as i32 % 2 == 0 { 1e5 } else { 3e5 };
        record.set(PRESSURE_REF_PA, time_s.iter().map(reference_pa).collect());
        record.set(
            CONTRACTION,
            time_s.iter().map(|t| 0.1 + 1e-3 * t.sin()).collect(),
        );
        record.set(PRESSURE_PA, vec![1e5; time_s.len()]);
        let mut clamped = rig.clone();
        clamped.nominal.load = Load::Prescribed;
        let inputs = Inputs::new(&clamped, &record).expect("inputs");
        let pressure_pa = pressures_pa(&clamped, inputs, &record, None).expect("a pressure");
        record.set(PRESSURE_PA, pressure_pa);
        let prepared = Prepared::all(&Rig::reference(), [&record].into_iter(), None);
        let mut prepared = prepared.expect("prepared").remove(0);
        // As simulated, it has none; its steps look like some.
        prepared.noise.pressure_pa = 1.0;
        prepared
    }

    fn rms(values: &[f64]) -> f64 {
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    fn with(effect: &str, values: &[f64]) -> Rig {
        let mut rig = Rig::reference();
        let kind = rig.catalogue.find(effect).expect("an effect");
        let form = &kind.forms[0];
        let values = values.to_vec();
        rig.effects.push(Effect { kind, form, values });
        rig
    }

    #[test]
    fn a_nominal_rig_has_no_residual() {
        let nominal = Rig::reference();
        let record = prepared(&nominal);
        let gas = ObservedGas::new(&record, &nominal).expect("a gas");
        // The contraction is smoothed before it drives the plant: 10 Pa of 200 kPa.
        assert!(
            rms(&gas.residuals_pa()) < 10.0,
            "{}",
            rms(&gas.residuals_pa())
        );
    }

    /// The nominal rig's residual is what the effect is said to do, with the other sign: also of a
    /// dead zone, which is not linear in its width, and of a lag, which changes the pressure by
    /// half a step.
    #[test]
    fn a_large_effect_changes_what_the_nominal_rig_misses() {
        for (effect, value) in [
            ("valve-dead-zone", 8e3),
            ("valve-lag", 0.05),
            ("leak", 2e-9),
        ] {
            let rig = with(effect, &[value]);
            let record = prepared(&rig);
            let gas = ObservedGas::new(&record, &Rig::reference()).expect("a gas");
            let residuals_pa = gas.residuals_pa();
            let changes_pa = gas.change_pa(&record, &rig).expect("a change");
            let pairs = residuals_pa.iter().zip(&changes_pa);
            let left_pa: Vec<f64> = pairs.map(|(residual, change)| residual + change).collect();
            let share = rms(&left_pa) / rms(&residuals_pa);
            assert!(share < 0.01, "{effect}: {share}");
        }
    }

    #[test]
    fn means_end_where_the_signal_changes() {
        let signal = |row: i32| f64::from(u8::from(row >= 100)) * 50.0;
        let noise = |row: i32| (f64::from(row) * 12.9898).sin() * std::f64::consts::SQRT_2;
        let values: Vec<f64> = (0..200).map(|row| signal(row) + noise(row)).collect();
        let smooth = without_noise(&values, 1.0);
        let error = |row: usize| (smooth[row] - signal(row as i32)).abs();
        // Beside the change the narrowest mean may have a row of the other side in three.
        assert!(
            (0..200)
                .filter(|row| !(99..101).contains(row))
                .all(|row| error(row) < 1.5)
        );
        let far: Vec<f64> = (40..60).map(error).collect();
        assert!(rms(&far) < 0.3, "{}", rms(&far));
    }
}
