//! Where residuals live: against direction, pressure, rate, time.

use super::engine::{Hypothesis, Model};
use serde::Serialize;

/// Bins of a coordinate.
const BINS: usize = 5;
/// A coordinate tells when something is left if one of its bins has this many times the mean.
const TELLS: f64 = 1.5;

/// How large the residuals of a block are against one coordinate.
#[derive(Clone, Debug, Serialize)]
pub struct Profile {
    /// The coordinate's name.
    pub coordinate: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Its bins: from, to, mean square of residuals in units of the noise.
    pub bins: Vec<[f64; 3]>,
}

impl Profile {
    /// The bin that stands out, and how many times the mean it has.
    fn outstanding(&self) -> Option<(&[f64; 3], f64)> {
        let mean = self.bins.iter().map(|bin| bin[2]).sum::<f64>() / self.bins.len() as f64;
        let largest = self.bins.iter().max_by(|a, b| a[2].total_cmp(&b[2]))?;
        Some((largest, largest[2] / mean))
    }

    /// Where the bin that stands out is, in words.
    fn words(&self, bin: &[f64; 3]) -> String {
        let number = |value: f64| match self.unit {
            "Pa" | "Pa/s" => format!("{:.0}", value / 1e3),
            "s" => format!("{value:.0}"),
            _ => format!("{value:.3}"),
        };
        let unit = match self.unit {
            "Pa" => " kPa",
            "Pa/s" => " kPa/s",
            "s" => " s",
            "1/s" => " 1/s",
            _ => "",
        };
        match (self.coordinate, bin[0].total_cmp(&0.0)) {
            ("direction", std::cmp::Ordering::Less) => "while extending".into(),
            ("direction", std::cmp::Ordering::Greater) => "while contracting".into(),
            ("direction", _) => "at rest".into(),
            (name, _) if bin[0] == bin[1] => format!("at a {name} of {}{unit}", number(bin[0])),
            (name, _) => format!(
                "at a {name} of {} to {}{unit}",
                number(bin[0]),
                number(bin[1])
            ),
        }
    }
}

/// The residuals of `block` under `hypothesis` against each coordinate, over all records.
pub fn profiles<M: Model>(model: &M, hypothesis: &Hypothesis, block: usize) -> Vec<Profile> {
    let mut squares: Vec<f64> = Vec::new();
    let mut coordinates: Vec<(&'static str, &'static str, Vec<f64>)> = Vec::new();
    for record in 0..model.records() {
        let fit = &hypothesis.fit;
        let Some(residuals) = model.residuals(record, block, &fit.nominal, &fit.effects) else {
            continue;
        };
        squares.extend(residuals.outside().map(|r| r * r));
        for (place, coordinate) in model.context(record, block).into_iter().enumerate() {
            if coordinates.len() == place {
                coordinates.push((coordinate.name, coordinate.unit, Vec::new()));
            }
            coordinates[place].2.extend(coordinate.values);
        }
    }
    let profile = |(coordinate, unit, values): (&'static str, &'static str, Vec<f64>)| {
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
        // A direction, and a length at which a bench has held the muscle.
        let same: Vec<_> = order.chunk_by(|a, b| values[*a] == values[*b]).collect();
        let groups: Vec<&[usize]> = if same.len() <= BINS {
            same
        } else {
            order.chunks(order.len().div_ceil(BINS).max(1)).collect()
        };
        let bin = |group: &[usize]| {
            let mean = group.iter().map(|i| squares[*i]).sum::<f64>() / group.len() as f64;
            [values[group[0]], values[group[group.len() - 1]], mean]
        };
        Profile {
            coordinate,
            unit,
            bins: groups.into_iter().map(bin).collect(),
        }
    };
    coordinates.into_iter().map(profile).collect()
}

/// When the residuals of `profiles` are largest, in words.
pub fn when(profiles: &[Profile]) -> String {
    let mut telling: Vec<(&Profile, &[f64; 3], f64)> = profiles
        .iter()
        .filter_map(|profile| {
            profile
                .outstanding()
                .map(|(bin, times)| (profile, bin, times))
        })
        .filter(|(_, _, times)| *times > TELLS)
        .collect();
    telling.sort_by(|a, b| b.2.total_cmp(&a.2));
    telling.truncate(2);
    let words = telling
        .iter()
        .map(|(profile, bin, times)| format!("{} ({times:.1} times the mean)", profile.words(bin)));
    let words: Vec<String> = words.collect();
    if words.is_empty() {
        "throughout".into()
    } else {
        format!("mostly {}", words.join(" and "))
    }
}
