//! The paper's figures 1, 2 and 5 from the model.

use super::{FIG_2_CONTRACTION, VALVES, with_flow_gain};
use crate::bench::tick::TICK_S;
use crate::design::{self, bode::linspace};
use crate::error::BadInput;
use crate::report::{Axis, Marker, Plot, Series};
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use muscle_plant::simulation::{Drive, Initial, Plant, Simulated, Simulation, TOLERANCE};
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;

/// Fig 1: contraction over pressure at constant load, and the width of the loop due to friction.
pub(super) fn fig_1(rig: &Rig) -> Result<(Plot, f64), BadInput> {
    let pressures = linspace(0.0, 5e5, 251);
    let mut lines = Vec::new();
    let weight_n = design::weight(rig)?.mass_kg * GRAVITY_M_PER_S2;
    for force_n in [50.0, weight_n, 200.0] {
        let at = |pressure_pa: &f64| {
            let mass_kg = force_n / GRAVITY_M_PER_S2;
            design::equilibrium(&rig.nominal.muscle, GaugePa(*pressure_pa), mass_kg).unwrap_or(0.0)
        };
        let contractions = pressures.iter().map(at).collect();
        let name = format!("Eq 1, {force_n:.0} N");
        lines.push(Series::new(&name, pressures.clone(), contractions).dashed());
    }
    // Up and down at 10 kPa/s, with the complete plant including friction.
    let plant = rig.plant(Simulated::LOAD_ONLY)?;
    let initial = at_rest(0.0, GaugePa(0.0), &plant);
    let mut simulation = Simulation::new(plant, &initial, &Drive::default(), TOLERANCE);
    let mut branches = [Vec::new(), Vec::new()];
    for (branch, rate_pa_per_s) in branches.iter_mut().zip([1e4, -1e4]) {
        let drive = Drive {
            pressure_rate_pa_per_s: rate_pa_per_s,
            ..Drive::default()
        };
        for _ in 0..250 {
            branch.push(simulation.contraction());
            let advanced = simulation.advance(&drive, simulation.time_s() + 0.2);
            advanced.map_err(|error| rig.unsolvable(error))?;
        }
        branch.push(simulation.contraction());
    }
    let [up, mut down] = branches;
    down.reverse();
    let widths = up.iter().zip(&down).map(|(up, down)| down - up);
    let width = widths.fold(0.0, f64::max);
    lines.push(Series::new("plant, rising", pressures.clone(), up));
    lines.push(Series::new("plant, falling", pressures, down));
    let plot = Plot {
        title: "Fig 1: pressure and contraction at constant load".into(),
        caption: format!(
            "Friction opens the plant's loop by at most {width:.3} in ε at equal pressure; the \
             paper's muscle shows up to 0.05, its own hysteresis, which the model leaves out."
        ),
        x: Axis::new("gauge pressure", "kPa", 1e-3),
        y: Axis::new("contraction", "%", 100.0),
        series: lines,
        markers: Vec::new(),
        sync: None,
    };
    Ok((plot, width))
}

fn at_rest(contraction: f64, pressure: GaugePa<f64>, plant: &Plant) -> Initial {
    Initial {
        time_s: 0.0,
        contraction,
        contraction_rate_per_s: 0.0,
        pressure,
        temperature_k: plant.ambient_temperature_k,
    }
}

/// Fig 2: volume over contraction.
pub(super) fn fig_2(rig: &Rig) -> Result<(Plot, f64), BadInput> {
    let volume = rig.require_volume()?;
    let contractions = linspace(0.0, 0.3, 61);
    let ratio = |contraction: f64| volume.volume_m3(contraction) / volume.volume_m3(0.0);
    let ratios = contractions
        .iter()
        .map(|contraction| ratio(*contraction))
        .collect();
    let plot = Plot {
        title: "Fig 2: volume and contraction".into(),
        caption: format!(
            "V(0.25)/V(0) = {:.2}; the paper: «6 times larger».",
            ratio(FIG_2_CONTRACTION)
        ),
        x: Axis::new("contraction", "%", 100.0),
        y: Axis::new("V/V(0)", "", 1.0),
        series: vec![Series::new("V/V(0)", contractions, ratios)],
        markers: vec![Marker {
            vertical: true,
            value: FIG_2_CONTRACTION,
            label: "25 %".into(),
        }],
        sync: None,
    };
    Ok((plot, ratio(FIG_2_CONTRACTION)))
}

/// Fig 5: steps of the reference pressure, both valves.
pub(super) fn fig_5(rig: &Rig) -> Result<Vec<Plot>, BadInput> {
    let mut pressures = Vec::new();
    let mut contractions = Vec::new();
    let weight = design::weight(rig)?;
    let start = GaugePa(2e5);
    let contraction =
        design::equilibrium(&rig.nominal.muscle, start, weight.mass_kg).unwrap_or(0.0);
    for (name, gain) in VALVES {
        let rig = with_flow_gain(rig, gain)?;
        let plant = rig.plant(Simulated::WHOLE)?;
        let initial = at_rest(contraction, start, &plant);
        let mut drive = Drive {
            reference: start,
            ..Drive::default()
        };
        let mut simulation = Simulation::new(plant, &initial, &drive, TOLERANCE);
        let (mut times, mut p, mut c) = (Vec::new(), Vec::new(), Vec::new());
        for tick in 0..600_u32 {
            let time_s = f64::from(tick) * 0.5 * TICK_S;
            drive.reference = if (0.2..1.6).contains(&time_s) {
                GaugePa(4e5)
            } else {
                start
            };
            times.push(time_s);
            p.push(simulation.pressure().0);
            c.push(simulation.contraction());
            let advanced = simulation.advance(&drive, f64::from(tick + 1) * 0.5 * TICK_S);
            advanced.map_err(|error| rig.unsolvable(error))?;
        }
        pressures.push(Series::new(name, times.clone(), p));
        contractions.push(Series::new(name, times, c));
    }
    let caption = format!(
        "200 → 400 → 200 kPa with {} kg. Dip and bump are due to the muscle's change of volume.",
        weight.mass_kg
    );
    let plot = |title: &str, caption: &str, y: Axis, series: Vec<Series>| Plot {
        title: title.into(),
        caption: caption.into(),
        x: Axis::new("time", "s", 1.0),
        y,
        series,
        markers: Vec::new(),
        sync: Some("fig 5".into()),
    };
    Ok(vec![
        plot(
            "Fig 5: step of the reference, pressure",
            &caption,
            Axis::new("gauge pressure", "kPa", 1e-3),
            pressures,
        ),
        plot(
            "Fig 5: step of the reference, contraction",
            "The weight oscillates at ω₂ on the stiffness of the muscle until friction holds it.",
            Axis::new("contraction", "%", 100.0),
            contractions,
        ),
    ])
}
