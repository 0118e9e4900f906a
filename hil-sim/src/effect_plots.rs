//! The signature of an effect as plots: the paper's rig with it and without it.

use crate::error::BadInput;
use crate::report::{Axis, Plot, Role, Series};
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use muscle_plant::effects::{Effect, EffectKind};
use muscle_plant::simulation::{Drive, Initial, Simulated, Simulation, TOLERANCE};

/// Interval of the simulated rows \[s\].
const STEP_S: f64 = 0.01;
/// Length of the test signal \[s\].
const LENGTH_S: f64 = 32.0;
/// A signal that no form changes by this share of its range is not shown.
const VISIBLE_SHARE: f64 = 1e-3;

/// Reference pressure of the test signal \[Pa\]: a vented zero, a step that is held, three
/// triangles, four steps close to the supply in quick succession, and vented again.
fn reference_pa(time_s: f64) -> f64 {
    match time_s {
        ..2.0 => 0.0,
        ..12.0 => 3e5,
        ..24.0 => {
            let share = ((time_s - 12.0) / 4.0).fract();
            2e5 + 2e5 * (1.0 - (2.0 * share - 1.0).abs())
        }
        ..28.0 if ((2.0 * time_s) as u32).is_multiple_of(2) => 4.9e5,
        ..30.0 => 1.5e5,
        _ => 0.0,
    }
}

/// The signals that are shown: title, unit, and factor from SI units.
const SIGNALS: [(&str, &str, f64); 3] = [
    ("pressure", "kPa", 1e-3),
    ("contraction", "%", 100.0),
    ("force", "N", 1.0),
];

/// The readings of the sensors with an effect, row by row.
fn readings(effect: Option<Effect>) -> Result<[Vec<f64>; 3], BadInput> {
    let mut rig = Rig::reference();
    rig.effects.extend(effect);
    let plant = rig.plant(Simulated::WHOLE)?;
    let drive = |time_s: f64| Drive {
        reference: GaugePa(reference_pa(time_s)),
        ..Drive::default()
    };
    let initial = Initial::vented(&plant);
    let mut simulation = Simulation::new(plant, &initial, &drive(0.0), TOLERANCE);
    let mut columns = [(); 3].map(|()| Vec::new());
    for time_s in times_s() {
        let reading = simulation.read();
        let values = [reading.pressure.0, reading.contraction, reading.force_n];
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(value);
        }
        let advanced = simulation.advance(&drive(time_s), time_s + STEP_S);
        advanced.map_err(|error| rig.unsolvable(error))?;
    }
    Ok(columns)
}

fn times_s() -> Vec<f64> {
    let rows = (LENGTH_S / STEP_S) as u32;
    (0..rows).map(|row| f64::from(row) * STEP_S).collect()
}

/// Plots of the signals that the effect changes, and of its change, with one line for each form at
/// its typical values.
///
/// # Errors
/// The plant with the effect cannot be simulated.
pub fn plots(kind: &'static EffectKind) -> Result<Vec<Plot>, BadInput> {
    let nominal = readings(None)?;
    let forms = kind.forms.iter();
    let with = forms.map(|form| Ok((form.name, readings(Some(Effect::typical(kind, form)))?)));
    let with = with.collect::<Result<Vec<_>, BadInput>>()?;
    let time_s = times_s();
    let line = |name: &str, y: &[f64]| Series::thinned(name, &time_s, y);
    let mut plots = Vec::new();
    for (place, (signal, unit, factor)) in SIGNALS.into_iter().enumerate() {
        let nominal = &nominal[place];
        let low = nominal.iter().copied().fold(f64::INFINITY, f64::min);
        let high = nominal.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let changes: Vec<(&str, Vec<f64>)> = with
            .iter()
            .map(|(form, readings)| {
                let change = readings[place].iter().zip(nominal);
                (
                    *form,
                    change.map(|(with, nominal)| with - nominal).collect(),
                )
            })
            .collect();
        let visible = |change: &f64| change.abs() > VISIBLE_SHARE * (high - low);
        if !changes.iter().any(|(_, change)| change.iter().any(visible)) {
            continue;
        }
        let plot = |title: String, caption: &str, series| Plot {
            title,
            caption: caption.into(),
            x: Axis::new("time", "s", 1.0),
            y: Axis::new(signal, unit, factor),
            series,
            markers: Vec::new(),
            sync: Some("signature".into()),
        };
        let mut lines = vec![line("without", nominal).role(Role::Nominal)];
        lines.extend(
            with.iter()
                .map(|(form, readings)| line(form, &readings[place])),
        );
        plots.push(plot(
            format!("Reading of {signal}"),
            "The paper's rig without and with each form at its typical values.",
            lines,
        ));
        plots.push(plot(
            format!("Change of {signal}"),
            "The reading with the effect less the one without it.",
            changes
                .iter()
                .map(|(form, change)| line(form, change))
                .collect(),
        ));
    }
    Ok(plots)
}

#[cfg(test)]
mod tests {
    use super::*;
    use muscle_plant::effects::{Catalogue, leak, pressure_sensor_offset};

    fn shown(kind: &'static EffectKind) -> Vec<Plot> {
        plots(kind).expect("simulated")
    }

    /// A leak g lowers a held pressure by g/(K_G + g): 4e-9 of 1.34e-7 kg/(Pa·s) of 300 kPa.
    #[test]
    fn a_leak_shows_in_the_held_pressure() {
        let plots = shown(&leak::KIND);
        let change = plots
            .iter()
            .find(|plot| plot.title == "Change of pressure")
            .expect("a plot");
        let linear = &change.series[0];
        let row = linear
            .x
            .iter()
            .position(|time_s| *time_s >= 11.0)
            .expect("a row");
        let expected_pa = -3e5 * 4e-9 / 1.34e-7;
        assert!(
            (linear.y[row] / expected_pa - 1.0).abs() < 0.01,
            "{}",
            linear.y[row]
        );
    }

    #[test]
    fn every_effect_shows_somewhere() {
        for kind in Catalogue::standard().kinds() {
            let plots = shown(kind);
            assert!(!plots.is_empty(), "{}", kind.name);
            for plot in &plots {
                let finite = |series: &Series| series.y.iter().all(|value| value.is_finite());
                assert!(
                    plot.series.iter().all(finite),
                    "{} {}",
                    kind.name,
                    plot.title
                );
            }
        }
        // A sensor's offset does not move the weight.
        let titles: Vec<_> = shown(&pressure_sensor_offset::KIND)
            .into_iter()
            .map(|plot| plot.title)
            .collect();
        assert_eq!(titles, ["Reading of pressure", "Change of pressure"]);
    }
}
