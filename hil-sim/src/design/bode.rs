//! Bode plots of the linearised circuit.

use super::Linearisation;
use crate::report::{Axis, Marker, Plot, Series};

/// `count` equally spaced values from `from` to `to`.
pub(crate) fn linspace(from: f64, to: f64, count: usize) -> Vec<f64> {
    let step = (to - from) / (count - 1) as f64;
    (0..count)
        .map(|number| from + step * number as f64)
        .collect()
}

/// Bode plots of the pressure control G for each of `lines`, with a marker at ω₂, and of the weight
/// on the muscle H for the first.
pub(crate) fn bode(lines: &[(String, Linearisation)]) -> Vec<Plot> {
    let frequencies: Vec<f64> = linspace(-1.0, 2.0, 301)
        .into_iter()
        .map(|exponent| 10_f64.powf(exponent))
        .collect();
    let response = |value: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let omegas = frequencies.iter().map(|hz| 2.0 * std::f64::consts::PI * hz);
        omegas.map(value).collect()
    };
    let mut gains = Vec::new();
    let mut phases = Vec::new();
    for (name, linear) in lines {
        let gain = response(&|omega| 20.0 * linear.pressure_response(omega).norm().log10());
        let phase = response(&|omega| linear.pressure_response(omega).arg().to_degrees());
        gains.push(Series::new(
            &format!("G, {name}"),
            frequencies.clone(),
            gain,
        ));
        phases.push(Series::new(
            &format!("G, {name}"),
            frequencies.clone(),
            phase,
        ));
    }
    let mut markers = Vec::new();
    if let Some((_, linear)) = lines.first() {
        let static_gain = linear.contraction_response(0.0).norm();
        let gain = response(&|omega| {
            20.0 * (linear.contraction_response(omega).norm() / static_gain).log10()
        });
        let phase = response(&|omega| linear.contraction_response(omega).arg().to_degrees());
        gains.push(Series::new("H/H(0)", frequencies.clone(), gain).dashed());
        phases.push(Series::new("H", frequencies.clone(), phase).dashed());
        let natural_hz = linear.omega2_rad_per_s / (2.0 * std::f64::consts::PI);
        markers.push(Marker {
            vertical: true,
            value: natural_hz,
            label: format!("ω₂ {natural_hz:.1} Hz"),
        });
    }
    let plot = |title: &str, caption: &str, y: Axis, series: Vec<Series>| Plot {
        title: title.into(),
        caption: caption.into(),
        x: Axis::new("frequency", "Hz", 1.0).log(),
        y,
        series,
        markers: markers.clone(),
        sync: Some("bode".into()),
    };
    vec![
        plot(
            "Gain of pressure control G and of weight on muscle H",
            "A valve is fast enough if G is still near 0 dB at the resonance of H.",
            Axis::new("gain", "dB", 1.0),
            gains,
        ),
        plot(
            "Phase of G and H",
            "The phase lag of G at ω₂ is the delay that the person feels.",
            Axis::new("phase", "°", 1.0),
            phases,
        ),
    ]
}
