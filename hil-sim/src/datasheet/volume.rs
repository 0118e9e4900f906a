//! The volume of a muscle, Eq 2, from its braid's geometry or from measured volumes.

use super::fit::{fit, groups};
use super::table::{self, Quantity};
use crate::error::BadInput;
use crate::record::units::{RATIO, Unit};
use model_core::muscle::Volume;
use std::f64::consts::PI;
use std::path::Path;

const VOLUME: &[Unit] = &[
    ("m3", 1.0, 0.0),
    ("l", 1e-3, 0.0),
    ("ml", 1e-6, 0.0),
    ("cm3", 1e-6, 0.0),
];

/// Points of the geometry to which Eq 2 is fitted.
const POINTS: usize = 101;

/// A volume over contraction, and Eq 2 fitted to it.
#[derive(Clone, Debug)]
pub struct VolumeFit {
    /// Contractions \[-\] and volumes \[m³\].
    pub points: Vec<(f64, f64)>,
    /// The fitted constants.
    pub volume: Volume<f64>,
    /// Standard deviations of the constants by the fit alone \[m³\]; `None` for a geometry, and if
    /// every contraction is needed.
    pub sigmas: Option<[f64; 3]>,
    /// Root mean square of the difference to the points \[m³\].
    pub misfit_m3: f64,
}

/// A cylinder with the braid's threads around it.
#[derive(Clone, Copy, Debug)]
pub struct Braid {
    /// Length at rest \[m\].
    pub length_m: f64,
    /// Diameter of the air at rest \[m\].
    pub diameter_m: f64,
    /// Angle between a thread and the axis at rest \[rad\].
    pub angle_rad: f64,
}

impl Braid {
    /// The contraction at which the threads are in balance and the muscle stops pulling: the angle
    /// is 54.7°, cos² = 1/3.
    pub fn contraction_max(&self) -> f64 {
        1.0 - (1.0_f64 / 3.0).sqrt() / self.angle_rad.cos()
    }

    /// Volume at a contraction \[m³\]. Threads of constant length turn: cos θ = (1−ε) cos θ₀ and
    /// D = D₀ sin θ/sin θ₀, hence V = πD₀²L₀/4 (1−ε)(1 − (1−ε)² cos²θ₀)/sin²θ₀.
    pub fn volume_m3(&self, contraction: f64) -> f64 {
        let shortened = 1.0 - contraction;
        let cosine = shortened * self.angle_rad.cos();
        let widened = (1.0 - cosine * cosine) / self.angle_rad.sin().powi(2);
        PI / 4.0 * self.diameter_m.powi(2) * self.length_m * shortened * widened
    }

    /// Eq 2 fitted to the geometry, from no contraction to `contraction_max`.
    pub fn fitted(&self, contraction_max: f64) -> Option<VolumeFit> {
        let points = (0..POINTS).map(|place| {
            let contraction = contraction_max * place as f64 / (POINTS - 1) as f64;
            (contraction, self.volume_m3(contraction))
        });
        fitted(points.collect(), false)
    }
}

/// Reads a table of volumes over contraction, and fits Eq 2.
///
/// # Errors
/// The table is malformed, or its points do not determine Eq 2.
pub fn read(path: &Path) -> Result<VolumeFit, BadInput> {
    let quantity = |name, units, range| Quantity { name, units, range };
    let quantities = [
        quantity("contraction", RATIO, (-0.2, 0.6)),
        quantity("volume", VOLUME, (1e-12, 10.0)),
    ];
    let rows = table::read(path, quantities)?.into_iter();
    let points: Vec<_> = rows.map(|(_, [contraction, v])| (contraction, v)).collect();
    fitted(points, true).ok_or_else(|| {
        let expected = "volumes at four contractions or more, of which the one at 0 is positive";
        BadInput::file(path.display().to_string(), expected)
    })
}

fn fitted(points: Vec<(f64, f64)>, measured: bool) -> Option<VolumeFit> {
    let rows: Vec<_> = points.iter().map(|(c, _)| [c * c, *c, 1.0]).collect();
    let volumes: Vec<_> = points.iter().map(|(_, volume_m3)| *volume_m3).collect();
    let alone = match measured {
        true => {
            let contractions: Vec<f64> = points.iter().map(|(c, _)| *c).collect();
            vec![groups(&contractions)]
        }
        false => Vec::new(),
    };
    let fit = fit(&rows, &volumes, &alone)?;
    let [d1_m3, d2_m3, d3_m3] = fit.values;
    let enough = points.len() > 3 && d3_m3 > 0.0;
    enough.then_some(VolumeFit {
        points,
        volume: Volume {
            d1_m3,
            d2_m3,
            d3_m3,
        },
        sigmas: fit.sigmas,
        misfit_m3: fit.rms,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const BRAID: Braid = Braid {
        length_m: 0.3,
        diameter_m: 0.02,
        angle_rad: 0.436_332,
    };

    /// By virtual work an ideal braid without rubber has F dy = −P dV, dy = −L dε.
    #[test]
    fn the_volume_does_the_work_of_the_force() {
        let [alpha_m2, beta_m2] = super::super::muscle::ideal_m2(0.02, BRAID.angle_rad);
        for contraction in [0.0, 0.1, 0.2, 0.3] {
            let step = 1e-5;
            let slope_m3 = (BRAID.volume_m3(contraction + step)
                - BRAID.volume_m3(contraction - step))
                / (2.0 * step);
            let force_per_pressure_m2 = alpha_m2 * (1.0 - contraction).powi(2) + beta_m2;
            let expected = force_per_pressure_m2 * BRAID.length_m;
            assert!((slope_m3 / expected - 1.0).abs() < 1e-6, "{contraction}");
        }
    }

    /// The geometry is a cubic with d³V/dε³ = 6 V₀ cos²θ/sin²θ. The best parabola over a range of
    /// half-width h about ε_m leaves V₀ cos²θ/sin²θ h³ (x³ − 0.6 x), x = (ε − ε_m)/h: 0.4 of the
    /// factor at the ends and 0.4/√7 RMS. 101 points in place of a continuum weigh the ends by some
    /// 2 % more.
    #[test]
    fn eq_2_follows_the_geometry() {
        let at_rest_m3 = PI / 4.0 * 0.02 * 0.02 * 0.3;
        for (angle_deg, contraction_max) in [(25.0_f64, 0.30), (25.0, 0.363), (20.0, 0.386)] {
            let braid = Braid {
                angle_rad: angle_deg.to_radians(),
                ..BRAID
            };
            let fit = braid.fitted(contraction_max).expect("a fit");
            let half = 0.5 * contraction_max;
            let cubic_m3 = at_rest_m3 / braid.angle_rad.tan().powi(2) * half.powi(3);
            let off_m3 = |(contraction, volume_m3): &(f64, f64)| {
                (fit.volume.volume_m3(*contraction) - volume_m3).abs()
            };
            let most_m3 = fit.points.iter().map(off_m3).fold(0.0, f64::max);
            let rms_m3 = 0.4 / 7_f64.sqrt() * cubic_m3;
            for (found, expected) in [(most_m3, 0.4 * cubic_m3), (fit.misfit_m3, rms_m3)] {
                assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
            }
            assert_eq!(fit.sigmas, None);
        }
        assert!((BRAID.volume_m3(0.0) / at_rest_m3 - 1.0).abs() < 1e-12);
        assert!((BRAID.contraction_max() - 0.363).abs() < 1e-3);
    }

    #[test]
    fn volumes_that_do_not_determine_eq_2_are_refused() {
        assert!(fitted(vec![(0.0, 1e-4); 4], true).is_none());
        let at = |contraction| (contraction, BRAID.volume_m3(contraction));
        // Of three contractions none can be left out.
        let three = fitted(vec![at(0.0), at(0.1), at(0.1), at(0.2)], true).expect("a fit");
        assert_eq!(three.sigmas, None);
        let four = fitted([0.0, 0.1, 0.2, 0.3].map(at).to_vec(), true).expect("a fit");
        assert!(four.sigmas.is_some());
    }
}
