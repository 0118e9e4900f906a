//! Eq 1 fitted to a table of forces over contraction and pressure, as catalogues have it.

use super::fit::fit;
use super::table::{self, Quantity};
use crate::error::BadInput;
use crate::record::units::{FORCE, PRESSURE, RATIO};
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;
use std::f64::consts::PI;
use std::path::Path;

/// A point of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Contraction ε \[-\].
    pub contraction: f64,
    /// Pressure (gauge) \[Pa\].
    pub pressure_pa: f64,
    /// Force F \[N\].
    pub force_n: f64,
}

/// A table of forces, and Eq 1 fitted to it.
#[derive(Clone, Debug)]
pub struct MuscleFit {
    /// The points that were fitted, by pressure and then contraction.
    pub points: Vec<Point>,
    /// Points that are left out because a slack muscle does not pull, which Eq 1 does not say.
    pub slack: usize,
    /// The fitted constants.
    pub muscle: Muscle<f64>,
    /// Standard deviations of α \[m²\], β \[m²\] and γ \[N\] by the fit alone.
    pub sigmas: [f64; 3],
    /// Root mean square of the table's forces less the fitted ones \[N\].
    pub misfit_n: f64,
    /// The point with the largest misfit.
    pub worst: Point,
}

/// Reads the table at `path`, and fits Eq 1 for a muscle of `initial_length_m`.
///
/// # Errors
/// The table is malformed, or its points do not determine Eq 1.
pub fn read(path: &Path, initial_length_m: f64) -> Result<MuscleFit, BadInput> {
    let quantity = |name, units, range| Quantity { name, units, range };
    let quantities = [
        quantity("contraction", RATIO, (-0.2, 0.6)),
        quantity("pressure", PRESSURE, (0.0, 1e8)),
        quantity("force", FORCE, (-1e5, 1e6)),
    ];
    let point = |(_, [contraction, pressure_pa, force_n]): (usize, [f64; 3])| Point {
        contraction,
        pressure_pa,
        force_n,
    };
    let points = table::read(path, quantities)?.into_iter().map(point);
    fitted(points.collect(), initial_length_m)
        .map_err(|expected| BadInput::file(path.display().to_string(), expected))
}

/// Eq 1 fitted to `points`, or what is expected of them.
fn fitted(points: Vec<Point>, initial_length_m: f64) -> Result<MuscleFit, String> {
    let count = points.len();
    let points = pulling(points);
    let rows: Vec<[f64; 3]> = points
        .iter()
        .map(|at| {
            let shortened = 1.0 - at.contraction;
            [shortened * shortened * at.pressure_pa, at.pressure_pa, 1.0]
        })
        .collect();
    let forces_n: Vec<f64> = points.iter().map(|at| at.force_n).collect();
    let groupings = [
        points.iter().map(|at| at.pressure_pa.to_bits()).collect(),
        points.iter().map(|at| at.contraction.to_bits()).collect(),
        (0..points.len() as u64).collect(),
    ];
    let fit = (points.len() > 3)
        .then(|| fit(&rows, &forces_n, &groupings))
        .flatten()
        .ok_or_else(|| {
            format!(
                "four points with a force, at two contractions and two pressures or more, found {} \
                 that do not determine Eq 1",
                points.len()
            )
        })?;
    let [alpha_m2, beta_m2, gamma_n] = fit.values;
    if alpha_m2 <= 0.0 || alpha_m2 + beta_m2 <= 0.0 {
        return Err(format!(
            "forces that rise with the pressure and fall with the contraction, found alpha = \
             {alpha_m2:.3e} m² and beta = {beta_m2:.3e} m² as their fit"
        ));
    }
    let muscle = Muscle {
        alpha_m2,
        beta_m2,
        gamma_n,
        initial_length_m,
    };
    let misfit = |at: &Point| at.force_n - force_n(&muscle, at);
    let worst = points
        .iter()
        .copied()
        .max_by(|a, b| misfit(a).abs().total_cmp(&misfit(b).abs()));
    Ok(MuscleFit {
        slack: count - points.len(),
        muscle,
        sigmas: fit.sigmas,
        misfit_n: fit.rms,
        // There are more than three points.
        worst: worst.unwrap_or(points[0]),
        points,
    })
}

/// The force of Eq 1 at the contraction and pressure of a point \[N\].
pub(super) fn force_n(muscle: &Muscle<f64>, at: &Point) -> f64 {
    muscle.force_n(at.contraction, GaugePa(at.pressure_pa))
}

/// The points at which the muscle pulls, by pressure and then contraction: those with a force, and
/// of each pressure the first without one after one with a force, where the muscle just stops
/// pulling.
fn pulling(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| {
        let by_pressure = a.pressure_pa.total_cmp(&b.pressure_pa);
        by_pressure.then(a.contraction.total_cmp(&b.contraction))
    });
    let mut kept: Vec<Point> = Vec::new();
    for point in points {
        let pulls_before = kept
            .last()
            .is_some_and(|last| last.pressure_pa == point.pressure_pa && last.force_n > 0.0);
        if point.force_n > 0.0 || (pulls_before && point.force_n == 0.0) {
            kept.push(point);
        }
    }
    kept
}

/// α and β \[m²\] of an ideal braid without rubber: F = πD²P/4 (3(1−ε)²/tan²θ − 1/sin²θ), Chou and
/// Hannaford 1996, with the diameter and the angle between thread and axis at rest.
pub fn ideal_m2(diameter_m: f64, braid_angle_rad: f64) -> [f64; 2] {
    let area_m2 = PI / 4.0 * diameter_m * diameter_m;
    [
        3.0 * area_m2 / braid_angle_rad.tan().powi(2),
        -area_m2 / braid_angle_rad.sin().powi(2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64Mcg;

    /// The forces of the paper's muscle, where it pulls, and its slack as zeros.
    fn table(error_n: impl Fn(f64, f64) -> f64) -> Vec<Point> {
        let muscle = Rig::reference().nominal.muscle;
        let mut points = Vec::new();
        for pressure_pa in [1e5, 2e5, 3e5, 4e5, 5e5] {
            for contraction in [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4] {
                let force_n = muscle.force_n(contraction, GaugePa(pressure_pa));
                let force_n = (force_n + error_n(contraction, pressure_pa)).max(0.0);
                points.push(Point {
                    contraction,
                    pressure_pa,
                    force_n,
                });
            }
        }
        points
    }

    #[test]
    fn a_table_of_eq_1_gives_its_constants() {
        // A zero of the table stands where the muscle is slack already: without them Eq 1 is exact.
        let points: Vec<_> = table(|_, _| 0.0)
            .into_iter()
            .filter(|at| at.force_n > 0.0)
            .collect();
        let fit = fitted(points, 0.3).expect("a fit");
        let (found, truth) = (fit.muscle, Rig::reference().nominal.muscle);
        for (found, truth) in [
            (found.alpha_m2, truth.alpha_m2),
            (found.beta_m2, truth.beta_m2),
            (found.gamma_n, truth.gamma_n),
        ] {
            assert!((found / truth - 1.0).abs() < 1e-9, "{found} {truth}");
        }
        assert!(fit.misfit_n < 1e-6, "{}", fit.misfit_n);
    }

    #[test]
    fn slack_points_do_not_count() {
        let points = table(|_, _| 0.0);
        let fit = fitted(points.clone(), 0.3).expect("a fit");
        // At each pressure at most one zero is kept.
        for pressure_pa in [1e5, 2e5, 3e5, 4e5, 5e5] {
            let zeros = fit
                .points
                .iter()
                .filter(|at| at.pressure_pa == pressure_pa && at.force_n == 0.0);
            assert!(zeros.count() <= 1);
        }
        assert_eq!(fit.slack + fit.points.len(), points.len());
        assert!(fit.slack > 0);
    }

    /// Errors of 20 N that the forces at one contraction share, as those of a diagram or of a
    /// bladder: the true constant is within two standard deviations in 95 of 100 tables, less
    /// three times the binomial scatter of 2.2.
    #[test]
    fn the_tolerances_cover_errors_that_points_share() {
        let truth = Rig::reference().nominal.muscle;
        let normal = Normal::new(0.0, 20.0).expect("a deviation");
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let mut covered = [0; 3];
        for _ in 0..100 {
            let errors_n: Vec<f64> = (0..41).map(|_| normal.sample(&mut random)).collect();
            let points = table(|contraction, _| errors_n[(100.0 * contraction) as usize]);
            let points = points.into_iter().filter(|at| at.force_n > 0.0);
            let fit = fitted(points.collect(), 0.3).expect("a fit");
            let off = [
                fit.muscle.alpha_m2 - truth.alpha_m2,
                fit.muscle.beta_m2 - truth.beta_m2,
                fit.muscle.gamma_n - truth.gamma_n,
            ];
            for ((covered, off), sigma) in covered.iter_mut().zip(off).zip(fit.sigmas) {
                *covered += u32::from(off.abs() < 2.0 * sigma);
            }
        }
        assert!(covered.iter().all(|count| *count >= 88), "{covered:?}");
    }

    #[test]
    fn points_that_do_not_determine_eq_1_are_refused() {
        let all = table(|_, _| 0.0);
        let at_one_pressure = all.iter().filter(|at| at.pressure_pa == 5e5);
        let at_one_contraction = all.iter().filter(|at| at.contraction == 0.1);
        let swapped = all.iter().map(|at| Point {
            contraction: 0.3 - at.contraction,
            ..*at
        });
        for (points, says) in [
            (at_one_pressure.copied().collect(), "do not determine"),
            (at_one_contraction.copied().collect(), "do not determine"),
            (Vec::new(), "found 0"),
            (swapped.collect::<Vec<_>>(), "fall with the contraction"),
        ] {
            let expected = fitted(points, 0.3).expect_err("no fit");
            assert!(expected.contains(says), "{expected}");
        }
    }

    #[test]
    fn an_ideal_braid_pulls_to_its_neutral_angle() {
        let angle_rad = 25_f64.to_radians();
        let [alpha_m2, beta_m2] = ideal_m2(0.02, angle_rad);
        // At 54.7° a thread is in balance: cos² = 1/3.
        let shortened = (1.0 / 3.0_f64).sqrt() / angle_rad.cos();
        let force_per_pressure = alpha_m2 * shortened * shortened + beta_m2;
        assert!(force_per_pressure.abs() < 1e-12 * alpha_m2);
        // 11 D² at 25°, as the range of `alpha_m2` has it.
        assert!((alpha_m2 / (11.0 * 0.02 * 0.02) - 1.0).abs() < 0.03);
    }
}
