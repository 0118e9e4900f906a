//! The performance level of an architecture by the simplified procedure of ISO 13849-1:2015, 4.5.4,
//! table 7.

use super::source::{Architecture, Component};

const HOURS_PER_YEAR: f64 = 8760.0;
/// Highest mean time of a channel that counts \[years\] (4.5.2); category 4, which nothing here
/// reaches, has more.
const YEARS_MAX: f64 = 100.0;
/// Least points against failures of common cause (annex F).
const CCF_MIN: u32 = 65;

/// Mean time to a dangerous failure \[years\]: 10⁹ h over FIT, or B10d over a tenth of the
/// operations in a year (annex C).
pub fn years(component: &Component) -> f64 {
    match (component.fit, component.b10d, component.operations_per_year) {
        (Some(fit), None, None) => 1e9 / fit / HOURS_PER_YEAR,
        (None, Some(b10d), Some(operations)) => b10d / (0.1 * operations),
        _ => panic!(
            "{}: `fit`, or `b10d` and `operations_per_year`",
            component.id
        ),
    }
}

/// Mean time of a channel \[years\]: the sum of the parts' rates (annex D.1), each by `factor`.
fn channel_years(channel: &[String], components: &[Component], factor: f64) -> f64 {
    let rates = channel.iter().map(|id| {
        let found = components.iter().find(|component| component.id == *id);
        1.0 / (factor * years(found.unwrap_or_else(|| panic!("no component {id}"))))
    });
    1.0 / rates.sum::<f64>()
}

/// A channel's mean time that counts \[years\], of two channels by annex D.2.
pub fn symmetric_years(architecture: &Architecture, components: &[Component], factor: f64) -> f64 {
    let of = |channel: &Vec<String>| channel_years(channel, components, factor).min(YEARS_MAX);
    match (architecture.category.as_str(), &architecture.channels[..]) {
        ("3", [one, two]) => {
            let (one, two) = (of(one), of(two));
            2.0 / 3.0 * (one + two - 1.0 / (1.0 / one + 1.0 / two))
        }
        (_, [one, ..]) => of(one),
        _ => 0.0,
    }
}

/// The level, or none. Each part's mean time is taken `factor` times.
pub fn level(
    architecture: &Architecture,
    components: &[Component],
    factor: f64,
) -> Option<&'static str> {
    let years = symmetric_years(architecture, components, factor);
    let time = match years {
        30.0.. => 2,
        10.0.. => 1,
        3.0.. => 0,
        _ => return None,
    };
    let is_medium = architecture.coverage >= 0.9;
    let has_coverage = architecture.coverage >= 0.6 && architecture.ccf >= CCF_MIN;
    let row = match architecture.category.as_str() {
        "B" => [Some("a"), Some("b"), Some("b")],
        "1" => [None, None, Some("c")],
        "2" if has_coverage && tests_itself(architecture, components, factor) => match is_medium {
            false => [Some("a"), Some("b"), Some("c")],
            true => [Some("b"), Some("c"), Some("d")],
        },
        "3" if has_coverage => match is_medium {
            false => [Some("b"), Some("c"), Some("d")],
            true => [Some("c"), Some("d"), Some("d")],
        },
        _ => [None; 3],
    };
    row[time]
}

/// The test equipment of category 2 lasts at least half as long as the channel (4.5.4).
fn tests_itself(architecture: &Architecture, components: &[Component], factor: f64) -> bool {
    let years: Vec<f64> = architecture
        .channels
        .iter()
        .map(|channel| channel_years(channel, components, factor))
        .collect();
    matches!(years[..], [channel, equipment] if equipment > 0.5 * channel)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn component(id: &str, years: f64) -> Component {
        Component {
            id: id.into(),
            fit: Some(1e9 / HOURS_PER_YEAR / years),
            b10d: None,
            operations_per_year: None,
            source: String::new(),
        }
    }

    fn architecture(category: &str, coverage: f64, ccf: u32) -> Architecture {
        Architecture {
            name: String::new(),
            function: String::new(),
            category: category.into(),
            channels: vec![vec!["a".into()], vec!["b".into()]],
            coverage,
            ccf,
            why: String::new(),
        }
    }

    /// Table 7, row by row, and both sides of the limits.
    #[test]
    fn levels_are_those_of_the_table() {
        let level_of = |category, coverage, ccf, years| {
            let components = [component("a", years), component("b", years)];
            level(&architecture(category, coverage, ccf), &components, 1.0)
        };
        let columns = [
            ("B", 0.0, [Some("a"), Some("b"), Some("b")]),
            ("1", 0.0, [None, None, Some("c")]),
            ("2", 0.6, [Some("a"), Some("b"), Some("c")]),
            ("2", 0.9, [Some("b"), Some("c"), Some("d")]),
            ("3", 0.6, [Some("b"), Some("c"), Some("d")]),
            ("3", 0.9, [Some("c"), Some("d"), Some("d")]),
        ];
        for (category, coverage, expected) in columns {
            let found = [4.0, 20.0, 50.0].map(|years| level_of(category, coverage, 65, years));
            assert_eq!(found, expected, "category {category}, coverage {coverage}");
            assert_eq!(level_of(category, coverage, 65, 2.9), None);
        }
        assert_eq!(level_of("3", 0.59, 65, 50.0), None);
        assert_eq!(level_of("3", 0.9, 64, 50.0), None);
    }

    /// The examples of annex D: ten parts in series, and channels of 3 and 100 years.
    #[test]
    fn mean_times_are_those_of_the_annex() {
        let cycles = Component {
            fit: None,
            b10d: Some(2e6),
            operations_per_year: Some(2e5),
            ..component("a", 1.0)
        };
        assert!((years(&cycles) - 100.0).abs() < 1e-9);
        let components = [component("a", 3.0), component("b", 100.0)];
        let symmetric = symmetric_years(&architecture("3", 0.6, 65), &components, 1.0);
        assert!((symmetric - 66.7).abs() < 0.1, "{symmetric}");
        let series = ["a", "b"].map(String::from);
        let expected = 1.0 / (1.0 / 3.0 + 1.0 / 100.0);
        assert!((channel_years(&series, &components, 1.0) - expected).abs() < 1e-9);
    }
}
