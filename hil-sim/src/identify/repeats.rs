//! How well a bench repeats itself: what no model of its records can explain.
//!
//! Runs of a clamped muscle at one length are compared at equal pressure, rising and falling apart.
//! What they differ by is mounting, zeros, run-in and memory: the *pure error* of a test for lack
//! of fit (Draper & Smith 1998, ch. 2). An effect that explains less than it cannot be told.

use crate::record::{CONTRACTION, FORCE_N, PRESSURE_PA, Record};

/// Lengths are the same within this \[-\]: a fifth of what an offset of the encoder usually is.
const SAME_CONTRACTION: f64 = 1e-3;
/// The pressure has turned when it came back by this share of its range, and forces are compared at
/// pressures that are so far apart.
const SHARE: f64 = 0.05;

/// Rows in an interval of pressure, their mean pressure \[Pa\] and mean force \[N\].
#[derive(Clone, Copy, Default)]
struct Node {
    rows: f64,
    pressure_pa: f64,
    force_n: f64,
}

impl Node {
    fn add(&mut self, pressure_pa: f64, force_n: f64) {
        self.rows += 1.0;
        self.pressure_pa += (pressure_pa - self.pressure_pa) / self.rows;
        self.force_n += (force_n - self.force_n) / self.rows;
    }
}

/// A run of a clamped muscle.
struct Run {
    contraction: f64,
    /// Force against pressure, rising and falling.
    curves: [Vec<Node>; 2],
}

/// Standard deviation of the force from run to run at the same length, pressure and direction
/// \[N\]; `None` where no two records of a clamped muscle can be compared.
pub fn force_repeatability_n<'a>(records: impl Iterator<Item = &'a Record>) -> Option<f64> {
    let records: Vec<&Record> = records.collect();
    let pressures = records
        .iter()
        .filter_map(|record| record.column(PRESSURE_PA));
    let most_pa = pressures.flatten().copied().fold(0.0, f64::max);
    let runs: Vec<Run> = records
        .iter()
        .filter_map(|record| run(record, SHARE * most_pa))
        .collect();
    let (mut squares, mut rows) = (0.0, 0.0);
    for (number, one) in runs.iter().enumerate() {
        for other in &runs[number + 1..] {
            if (one.contraction - other.contraction).abs() > SAME_CONTRACTION {
                continue;
            }
            for (one, other) in one.curves.iter().zip(&other.curves) {
                for (off_n, weight) in differences_n(one, other) {
                    squares += weight * off_n * off_n;
                    rows += weight;
                }
            }
        }
    }
    // The difference of two has twice the variance of one.
    (rows > 0.0).then(|| (0.5 * squares / rows).sqrt())
}

fn run(record: &Record, step_pa: f64) -> Option<Run> {
    let contraction = record.column(CONTRACTION)?;
    let mut present = contraction.iter().filter(|value| !value.is_nan());
    let first = *present.next()?;
    if present.any(|value| (value - first).abs() > SAME_CONTRACTION) || step_pa <= 0.0 {
        return None;
    }
    let rows = record
        .column(PRESSURE_PA)?
        .iter()
        .zip(record.column(FORCE_N)?);
    let mut curves: [Vec<Node>; 2] = Default::default();
    let (mut least_pa, mut most_pa, mut falling) = (f64::INFINITY, f64::NEG_INFINITY, false);
    for (pressure_pa, force_n) in rows.filter(|(p, f)| !p.is_nan() && !f.is_nan()) {
        (least_pa, most_pa) = (least_pa.min(*pressure_pa), most_pa.max(*pressure_pa));
        let turned = if falling {
            pressure_pa - least_pa > step_pa
        } else {
            most_pa - pressure_pa > step_pa
        };
        if turned {
            falling = !falling;
            (least_pa, most_pa) = (*pressure_pa, *pressure_pa);
        }
        let place = (pressure_pa / step_pa).max(0.0) as usize;
        let curve = &mut curves[usize::from(falling)];
        curve.resize(curve.len().max(place + 1), Node::default());
        curve[place].add(*pressure_pa, *force_n);
    }
    for curve in &mut curves {
        curve.retain(|node| node.rows > 0.0);
    }
    Some(Run {
        contraction: first,
        curves,
    })
}

/// What one curve is off another where that has neighbours on both sides \[N\], and of how many
/// rows: few pass while the pressure moves fast and the force is behind.
fn differences_n(one: &[Node], other: &[Node]) -> Vec<(f64, f64)> {
    let off = |node: &Node| {
        let after = other.partition_point(|of| of.pressure_pa < node.pressure_pa);
        let (from, to) = (other.get(after.checked_sub(1)?)?, other.get(after)?);
        let share = (node.pressure_pa - from.pressure_pa) / (to.pressure_pa - from.pressure_pa);
        let force_n = from.force_n + share * (to.force_n - from.force_n);
        Some((
            node.force_n - force_n,
            node.rows.min(from.rows).min(to.rows),
        ))
    };
    one.iter().filter_map(off).collect()
}
