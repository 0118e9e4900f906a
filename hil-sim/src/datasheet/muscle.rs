//! Eq 1 fitted to a table of forces over contraction and pressure, as catalogues have it.

use super::fit::{fit, groups};
use super::table::{self, Quantity};
use crate::error::BadInput;
use crate::plausible::{CONTRACTION_USED, PRESSURE_WORKING_PA_MIN};
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
    /// The points that were fitted, a curve for each pressure, by contraction.
    pub curves: Vec<Vec<Point>>,
    /// Points that are left out because a slack muscle does not pull, which Eq 1 does not say.
    pub slack: usize,
    /// The fitted constants.
    pub muscle: Muscle<f64>,
    /// Standard deviations of α \[m²\], β \[m²\] and γ \[N\] by the fit alone; `None` if it needs
    /// every curve.
    pub sigmas: Option<[f64; 3]>,
    /// Root mean square of the table's forces less the fitted ones \[N\].
    pub misfit_n: f64,
    /// The point with the largest misfit.
    pub worst: Point,
}

impl MuscleFit {
    /// The points that were fitted.
    pub fn points(&self) -> impl Iterator<Item = &Point> {
        self.curves.iter().flatten()
    }
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
    let (points, at_pressure) = pulling(points);
    let contractions: Vec<f64> = points.iter().map(|at| at.contraction).collect();
    let rows: Vec<[f64; 3]> = points
        .iter()
        .map(|at| {
            let shortened = 1.0 - at.contraction;
            [shortened * shortened * at.pressure_pa, at.pressure_pa, 1.0]
        })
        .collect();
    let forces_n: Vec<f64> = points.iter().map(|at| at.force_n).collect();
    let groupings = [
        at_pressure,
        groups(&contractions),
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
    let highest_pa = points.iter().fold(0.0_f64, |pa, at| pa.max(at.pressure_pa));
    if highest_pa < PRESSURE_WORKING_PA_MIN {
        return Err(format!(
            "pressures of a muscle, found none above {highest_pa:.3} Pa: is the column in bar, kPa \
             or MPa? Its name has the unit, as `pressure_bar`"
        ));
    }
    let largest = points
        .iter()
        .fold(0.0_f64, |most, at| most.max(at.contraction));
    if largest < CONTRACTION_USED {
        return Err(format!(
            "contractions of a muscle, found none above {largest:.2e}: is the column a ratio? Its \
             name has the unit, as `contraction` or `contraction_percent`"
        ));
    }
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
        curves: curves(&points, &groupings[0]),
    })
}

/// The force of Eq 1 at the contraction and pressure of a point \[N\].
pub(super) fn force_n(muscle: &Muscle<f64>, at: &Point) -> f64 {
    muscle.force_n(at.contraction, GaugePa(at.pressure_pa))
}

/// The points at which the muscle pulls, and the curve of each, by curve and then contraction. A
/// point without a force stands where the muscle is slack, also the first one: where in between it
/// stopped pulling is not known, and a force of 0 there would bend Eq 1.
fn pulling(mut points: Vec<Point>) -> (Vec<Point>, Vec<u64>) {
    points.retain(|at| at.force_n > 0.0);
    let pressures_pa: Vec<f64> = points.iter().map(|at| at.pressure_pa).collect();
    let mut by_curve: Vec<_> = groups(&pressures_pa).into_iter().zip(points).collect();
    by_curve.sort_by(|(curve, at), (other_curve, other)| {
        let by_contraction = at.contraction.total_cmp(&other.contraction);
        curve.cmp(other_curve).then(by_contraction)
    });
    let (curves, points) = by_curve.into_iter().unzip();
    (points, curves)
}

/// The points of each curve.
fn curves(points: &[Point], at_pressure: &[u64]) -> Vec<Vec<Point>> {
    let both: Vec<_> = at_pressure.iter().zip(points).collect();
    let curves = both.chunk_by(|(one, _), (other, _)| one == other);
    let points = |curve: &[(&u64, &Point)]| curve.iter().map(|(_, at)| **at).collect();
    curves.map(points).collect()
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

    fn assert_exact(fit: &MuscleFit) {
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

    /// Also where a table has the zeros of a slack muscle, of which the first of each pressure
    /// would move α by −11 % and β by −23 %.
    #[test]
    fn a_table_of_eq_1_gives_its_constants() {
        let points = table(|_, _| 0.0);
        let fit = fitted(points.clone(), 0.3).expect("a fit");
        assert_exact(&fit);
        let slack = points.iter().filter(|at| at.force_n == 0.0).count();
        assert!(slack > 5, "{slack}");
        assert_eq!((fit.slack, fit.points().count()), (slack, 40 - slack));
    }

    /// Readings of a test bench scatter about the pressures and contractions that were meant: they
    /// have the standard deviations of the table without that scatter, to the 2 % by which the
    /// points move.
    #[test]
    fn curves_are_found_in_measured_pressures() {
        let error_n = |contraction: f64, _| 20.0 * (30.0 * contraction).sin();
        let mut points = table(error_n);
        let whole = fitted(points.clone(), 0.3).expect("a fit");
        for (place, at) in points.iter_mut().enumerate() {
            let share = [0.3, -0.2, 0.5, -0.4, 0.1][place % 5];
            at.pressure_pa += 1e3 * share;
            at.contraction += 1e-3 * share;
        }
        let fit = fitted(points, 0.3).expect("a fit");
        let lengths = |fit: &MuscleFit| fit.curves.iter().map(Vec::len).collect::<Vec<_>>();
        assert_eq!(lengths(&fit), lengths(&whole));
        let [found, expected] = [&fit, &whole].map(|fit| fit.sigmas.expect("sigmas"));
        for (found, expected) in found.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
        }
    }

    /// Eq 1 at one pressure alone has no γ: neither of two curves can be left out.
    #[test]
    fn two_curves_have_no_standard_deviations() {
        let points = table(|_, _| 0.0).into_iter();
        let two = points.filter(|at| at.pressure_pa >= 4e5).collect();
        let fit = fitted(two, 0.3).expect("a fit");
        assert_exact(&fit);
        assert_eq!(fit.sigmas, None);
    }

    /// Errors of 20 N that the forces at one contraction share, as those of a diagram or of a
    /// bladder: the true constant is within two standard deviations in 95 of 100 tables, less
    /// three times the binomial scatter of 2.2. Nor do they cover anything: the largest of three
    /// jackknives, each of which is about right on average, is less than twice the scatter.
    #[test]
    fn the_tolerances_cover_errors_that_points_share() {
        let truth = Rig::reference().nominal.muscle;
        let normal = Normal::new(0.0, 20.0).expect("a deviation");
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let mut covered = [0; 3];
        let (mut scatter, mut stated) = ([0.0; 3], [0.0; 3]);
        for _ in 0..100 {
            let errors_n: Vec<f64> = (0..41).map(|_| normal.sample(&mut random)).collect();
            let points = table(|contraction, _| errors_n[(100.0 * contraction) as usize]);
            let fit = fitted(points, 0.3).expect("a fit");
            let sigmas = fit.sigmas.expect("sigmas");
            let off = [
                fit.muscle.alpha_m2 - truth.alpha_m2,
                fit.muscle.beta_m2 - truth.beta_m2,
                fit.muscle.gamma_n - truth.gamma_n,
            ];
            for (place, off) in off.into_iter().enumerate() {
                covered[place] += u32::from(off.abs() < 2.0 * sigmas[place]);
                scatter[place] += off * off;
                stated[place] += sigmas[place] * sigmas[place];
            }
        }
        assert!(covered.iter().all(|count| *count >= 88), "{covered:?}");
        for (stated, scatter) in stated.iter().zip(scatter) {
            let ratio = (stated / scatter).sqrt();
            assert!(ratio < 2.0, "{ratio}");
        }
    }

    #[test]
    fn pressures_in_another_unit_than_the_column_says_are_refused() {
        let at = |(contraction, pressure_pa, force_n)| Point {
            contraction,
            pressure_pa,
            force_n,
        };
        // In bar.
        let points = [
            (0.0, 1.0, 55.0),
            (0.0, 2.0, 294.0),
            (0.1, 2.0, 150.0),
            (0.1, 3.0, 320.0),
            (0.2, 3.0, 200.0),
        ];
        let error = fitted(points.map(at).to_vec(), 0.3).expect_err("no muscle");
        assert!(
            error.contains("none above 3.000 Pa: is the column in bar"),
            "{error}"
        );
    }

    #[test]
    fn ratios_in_a_column_of_percent_are_refused() {
        let mut points = table(|_, _| 0.0);
        for at in &mut points {
            at.contraction *= 0.01;
        }
        let error = fitted(points, 0.3).expect_err("no muscle");
        assert!(error.contains("is the column a ratio"), "{error}");
    }

    #[test]
    fn points_that_do_not_determine_eq_1_are_refused() {
        let all = table(|_, _| 0.0);
        let at_one_pressure = all.iter().filter(|at| at.pressure_pa == 5e5);
        let at_one_contraction = all.iter().filter(|at| at.contraction == 0.1);
        let vented = all.iter().map(|at| Point {
            pressure_pa: 0.0,
            force_n: at.force_n + 1.0,
            ..*at
        });
        let swapped = all.iter().map(|at| Point {
            contraction: 0.3 - at.contraction,
            ..*at
        });
        for (points, says) in [
            (at_one_pressure.copied().collect(), "do not determine"),
            (at_one_contraction.copied().collect(), "do not determine"),
            (vented.collect(), "do not determine"),
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
