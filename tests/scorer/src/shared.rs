//! Forms and parameters that the generator of the truth and the measured tool have in common.
//!
//! Both were written independently, with different names of forms and parameters, and some
//! different units. This table relates them.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Parameters by name.
pub type Parameters = BTreeMap<String, f64>;

/// The tool's parameters, from the generator's.
type Translation = fn(&dyn Fn(&str) -> f64) -> Vec<(&'static str, f64)>;

/// A form of the truth that the tool has too.
pub struct Shared {
    /// The effect.
    pub effect: &'static str,
    /// The form, as the generator calls it.
    pub truth_form: &'static str,
    /// The form, as the tool calls it.
    pub form: &'static str,
    /// Whether it is the effect's first form, which a rig need not name.
    pub first: bool,
    /// The tool's parameters, from the generator's.
    values: Translation,
}

const fn first(
    effect: &'static str,
    truth_form: &'static str,
    form: &'static str,
    values: Translation,
) -> Shared {
    Shared {
        effect,
        truth_form,
        form,
        first: true,
        values,
    }
}

const fn not_first(shared: Shared) -> Shared {
    Shared {
        first: false,
        ..shared
    }
}

/// All shared forms.
pub static SHARED: [Shared; 18] = [
    first("dead-band", "sharp", "sharp", |of| {
        vec![("pressure_pa", of("threshold_pa"))]
    }),
    first("friction", "coulomb", "coulomb", |of| {
        vec![("force_n", of("coulomb_n"))]
    }),
    first("payload", "rigid", "mass", |of| {
        vec![("mass_kg", of("mass_kg"))]
    }),
    first("backlash", "sharp", "play", |of| {
        vec![("play_m", of("gap_m"))]
    }),
    not_first(first("backlash", "graded", "graded", |of| {
        vec![("play_m", of("gap_m"))]
    })),
    first("valve-lag", "first-order", "first-order", |of| {
        vec![("time_constant_s", of("time_constant_s"))]
    }),
    not_first(first("valve-lag", "second-order", "second-order", |of| {
        let time_constant_s = 1.0 / (TAU * of("frequency_hz"));
        vec![
            ("time_constant_s", time_constant_s),
            ("damping_ratio", of("damping")),
        ]
    })),
    first("valve-dead-zone", "sharp", "sharp", |of| {
        vec![("half_width_pa", of("width_pa"))]
    }),
    first("flow-limit", "iso6358", "choked-orifice", |of| {
        vec![
            ("filling_conductance_kg_per_pa_s", of("fill_kg_per_pa_s")),
            ("exhausting_conductance_kg_per_pa_s", of("vent_kg_per_pa_s")),
            ("critical_ratio", of("critical_ratio")),
        ]
    }),
    first("transport-delay", "pure", "pure", |of| {
        vec![("delay_s", of("delay_s"))]
    }),
    not_first(first("line-dynamics", "ringing", "sensor-tube", |of| {
        let period_s = 1.0 / of("frequency_hz");
        vec![("period_s", period_s), ("damping_ratio", of("damping"))]
    })),
    not_first(first(
        "line-dynamics",
        "ringing-turbulent",
        "turbulent-sensor-tube",
        |of| {
            vec![
                ("period_s", 1.0 / of("frequency_hz")),
                ("damping_ratio", of("damping")),
                ("turbulent_damping_per_pa", 0.5 * of("turbulent_per_pa")),
            ]
        },
    )),
    first("leak", "linear", "linear", |of| {
        vec![("conductance_kg_per_pa_s", of("conductance_kg_per_pa_s"))]
    }),
    first("heat-exchange", "scaled", "factor", |of| {
        vec![("factor", of("factor"))]
    }),
    first("pressure-sensor-gain", "linear", "proportional", |of| {
        vec![("gain_error", of("gain") - 1.0)]
    }),
    first("pressure-sensor-offset", "constant", "constant", |of| {
        vec![("offset_pa", of("offset_pa"))]
    }),
    first("pressure-sensor-drift", "steady", "linear", |of| {
        vec![("drift_pa_per_s", of("drift_pa_per_s"))]
    }),
    first("contraction-sensor-offset", "constant", "constant", |of| {
        vec![("offset", of("offset"))]
    }),
];

impl Shared {
    /// The tool's form that corresponds to this form of the truth, if any.
    pub fn find(effect: &str, truth_form: &str) -> Option<&'static Shared> {
        let is = |shared: &&Shared| shared.effect == effect && shared.truth_form == truth_form;
        SHARED.iter().find(is)
    }

    /// The true values under the tool's names; NaN, which no interval contains, for a missing one.
    pub fn values(&self, standard: &Parameters) -> Vec<(&'static str, f64)> {
        (self.values)(&|name| standard.get(name).copied().unwrap_or(f64::NAN))
    }

    /// Whether `form`, as a fitted rig has it, is this one.
    pub fn is_form(&self, form: Option<&str>) -> bool {
        form.map_or(self.first, |form| form == self.form)
    }
}

/// The form of each effect in a rig's text, where it names one.
pub fn forms(rig_toml: &str) -> BTreeMap<String, String> {
    let Ok(rig) = rig_toml.parse::<toml_edit::DocumentMut>() else {
        // an unreadable rig is reported when it is simulated
        return BTreeMap::new();
    };
    let effects = rig.get("effect").and_then(|item| item.as_array_of_tables());
    let word = |table: &toml_edit::Table, key| Some(table.get(key)?.as_str()?.to_owned());
    let form = |table| Some((word(table, "name")?, word(table, "form")?));
    effects.into_iter().flatten().filter_map(form).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hil_sim::rig::Rig;

    #[test]
    fn every_standard_form_of_the_truth_is_shared() {
        for entry in truth::CATALOGUE {
            for form in entry.forms.iter().filter(|form| !form.standard.is_empty()) {
                let shared = Shared::find(entry.name, form.name);
                let shared = shared.unwrap_or_else(|| panic!("{}: {}", entry.name, form.name));
                let value = |name: &&str| ((*name).to_owned(), 0.75);
                let standard = form.standard.iter().map(value).collect();
                let values = shared.values(&standard);
                assert_eq!(values.len(), form.standard.len());
                assert!(
                    values.iter().all(|(_, value)| value.is_finite()),
                    "{}",
                    entry.name
                );
            }
        }
    }

    #[test]
    fn the_tool_knows_all_shared_names() {
        let reference = include_str!("../../../hil-sim/src/rig/reference_rig.toml");
        for shared in &SHARED {
            let kind = muscle_plant::effects::Catalogue::standard().find(shared.effect);
            let form = kind.and_then(|kind| kind.form(shared.form));
            let form = form.unwrap_or_else(|| panic!("{} {}", shared.effect, shared.form));
            for (name, _) in (shared.values)(&|_| 0.5) {
                let mut known = form.parameters.iter();
                assert!(known.any(|own| own.name == name), "{} {name}", shared.form);
            }
            let keys = form
                .parameters
                .iter()
                .map(|own| format!("{} = {:?}\n", own.name, own.typical));
            let (effect, form) = (shared.effect, shared.form);
            let head = format!("[[effect]]\nname = \"{effect}\"\nform = \"{form}\"\n");
            let text = format!("{reference}\n{head}{}", keys.collect::<String>());
            Rig::parse("rig.toml", &text).expect("a rig");
        }
    }

    #[test]
    fn units_and_names_are_converted() {
        let standard = [("frequency_hz", 10.0), ("damping", 0.3)].map(|(n, v)| (n.to_owned(), v));
        let ringing = Shared::find("line-dynamics", "ringing").expect("shared");
        let values = ringing.values(&standard.into());
        assert_eq!(values, [("period_s", 0.1), ("damping_ratio", 0.3)]);
        assert!(ringing.is_form(Some("sensor-tube")) && !ringing.is_form(None));
        // 2ζ + κ|ẋ|/ω is 2(ζ + κ/2 · swing)
        let turbulent = Shared::find("line-dynamics", "ringing-turbulent").expect("shared");
        let bend = [("turbulent_per_pa".to_owned(), 4e-6)];
        let values = turbulent.values(&bend.into());
        assert_eq!(values[2], ("turbulent_damping_per_pa", 2e-6));
        let leak = Shared::find("leak", "linear").expect("shared");
        assert!(leak.is_form(None) && leak.is_form(Some("linear")));
        assert!(!leak.is_form(Some("orifice")));
        assert!(leak.values(&Parameters::new())[0].1.is_nan());
        assert!(Shared::find("leak", "crack").is_none());
    }

    #[test]
    fn forms_are_read_from_a_fitted_rig() {
        let text =
            "a = 1\n[[effect]]\nname = \"leak\"\nform = \"orifice\"\n[[effect]]\nname = \"x\"";
        assert_eq!(
            forms(text),
            [("leak".to_owned(), "orifice".to_owned())].into()
        );
        assert!(forms("a = ").is_empty() && forms("a = 1").is_empty());
    }
}
