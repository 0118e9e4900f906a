//! Writing a rig file: changes keep comments and everything that stays the same.

use super::Rig;
use crate::own_effect;
use muscle_plant::effects::Effect;

impl Rig {
    /// `text`, the rig's file, with the nominal values that have a tolerance and the effects of
    /// this rig; comments and everything that stays the same are kept. Changed values have six
    /// significant digits.
    ///
    /// # Errors
    /// The text is not TOML.
    pub fn rewritten(&self, text: &str) -> Result<String, toml_edit::TomlError> {
        let mut document: toml_edit::DocumentMut = text.parse()?;
        let mut rig = self.clone();
        for tolerance in &self.tolerances {
            let value = rig
                .value_mut(&tolerance.section, &tolerance.key)
                .map(|value| *value);
            let item = document
                .get_mut(&tolerance.section)
                .and_then(|section| section.get_mut(&tolerance.key));
            if let (Some(value), Some(item)) = (value, item.and_then(|item| item.as_value_mut()))
                && item.as_float() != Some(value)
            {
                set_value(item, rounded(value));
            }
        }
        let effects = document.get("effect");
        let tables = effects.and_then(|item| item.as_array_of_tables());
        let mut written = tables.map_or(0, |tables| tables.len());
        let inline = effects.and_then(|item| item.as_array());
        if let Some(inline) = inline.map(toml_edit::Array::len) {
            if inline == self.effects.len() {
                written = inline;
            } else {
                // TOML does not allow `[[effect]]` after an array: write all effects as tables.
                document.remove("effect");
            }
        }
        // The files may not be beside what is written.
        document.remove(own_effect::FILES_KEY);
        for (name, declared) in &self.own_effects {
            let own = document
                .entry(own_effect::KEY)
                .or_insert_with(implicit_table);
            own[name] = declared.clone();
        }
        let mut text = document.to_string();
        for effect in self.effects.iter().skip(written) {
            if !text.ends_with("\n\n") {
                text += if text.ends_with('\n') { "\n" } else { "\n\n" };
            }
            let mut effect = effect.clone();
            for value in &mut effect.values {
                *value = rounded(*value);
            }
            text += &effect_toml(&effect);
        }
        Ok(text)
    }
}

/// The rig file `text` with other numbers and their tolerances (section, key, value, relative
/// standard deviation), and without some keys of a section; comments are kept.
///
/// # Errors
/// The text is not TOML.
pub fn set_numbers<'a>(
    text: &str,
    numbers: impl Iterator<Item = (&'a str, &'a str, f64, f64)>,
    (section_without, without): (&str, &[&str]),
) -> Result<String, toml_edit::TomlError> {
    let mut document: toml_edit::DocumentMut = text.parse()?;
    for (section, key, number, relative_sigma) in numbers {
        set_number(&mut document[section][key], number);
        let tolerances = document.entry("tolerance").or_insert_with(implicit_table);
        if tolerances.get(section).is_none() {
            tolerances[section] = toml_edit::table();
        }
        let item = &mut tolerances[section][key];
        set_number(item, relative_sigma);
        // The reason behind it is that of another number.
        if let Some(value) = item.as_value_mut() {
            value.decor_mut().set_suffix("");
        }
    }
    for key in without {
        let tolerances = document.get_mut("tolerance");
        let tolerances = tolerances.and_then(|tolerances| tolerances.get_mut(section_without));
        remove(tolerances, key);
        remove(document.get_mut(section_without), key);
    }
    Ok(document.to_string())
}

fn remove(table: Option<&mut toml_edit::Item>, key: &str) {
    if let Some(table) = table.and_then(|table| table.as_table_like_mut()) {
        table.remove(key);
    }
}

fn implicit_table() -> toml_edit::Item {
    let mut table = toml_edit::Table::new();
    table.set_implicit(true);
    toml_edit::Item::Table(table)
}

/// Replaces a number and keeps the comment behind it.
fn set_number(item: &mut toml_edit::Item, number: f64) {
    if item.is_none() {
        *item = toml_edit::value(number);
    }
    if let Some(value) = item.as_value_mut() {
        set_value(value, number);
    }
}

/// `value` with six significant digits. No estimate is known to more than four; but two of them
/// balance each other, as α and β, and four digits of each would move a force by its noise.
fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

fn set_value(value: &mut toml_edit::Value, number: f64) {
    let decor = value.decor().clone();
    *value = float_toml(number).parse().unwrap_or_else(|_| number.into());
    *value.decor_mut() = decor;
}

/// The shortest decimal that reads back as `value`; scientific where the exponent is below −4 or
/// above 5.
pub(super) fn float_toml(value: f64) -> String {
    if value == 0.0 || (1e-4..1e6).contains(&value.abs()) {
        format!("{value:?}")
    } else {
        format!("{value:e}")
    }
}

/// The effect as a section of a rig file, which reads back as the same values.
pub fn effect_toml(effect: &Effect) -> String {
    let mut text = format!("[[effect]]\nname = \"{}\"\n", effect.kind.name);
    // The first form is the default.
    if effect.form.name != effect.kind.forms[0].name {
        text += &format!("form = \"{}\"\n", effect.form.name);
    }
    for (parameter, value) in effect.form.parameters.iter().zip(&effect.values) {
        text += &format!("{} = {}\n", parameter.name, float_toml(*value));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_calibrated_value_keeps_its_comment() {
        let text = format!(
            "{}\n[tolerance.muscle]\nalpha_m2 = 0.01\n",
            Rig::REFERENCE_TOML
        );
        let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
        assert_eq!(rig.rewritten(&text).as_ref(), Ok(&text), "unchanged");
        // A byte order mark would be refused below other text.
        let marked = rig.rewritten(&format!("\u{feff}{text}"));
        assert_eq!(marked.as_ref(), Ok(&text));
        *rig.value_mut("muscle", "alpha_m2").expect("the key") = 4e-3;
        let rewritten = rig.rewritten(&text).expect("TOML");
        assert_eq!(rewritten, text.replace("3.7718e-3", "0.004"));
    }

    #[test]
    fn a_value_has_only_the_digits_that_count() {
        let written = [
            (8.428_792_370_084_272e-8, "8.428792370084272e-8"),
            (-9.999e-5, "-9.999e-5"),
            (1e-4, "0.0001"),
            (-0.001_39, "-0.00139"),
            (0.0, "0.0"),
            (12.0, "12.0"),
            (5e5, "500000.0"),
            (1e6, "1e6"),
        ];
        for (value, text) in written {
            assert_eq!(float_toml(value), text);
        }
        let text = format!(
            "{}\n[tolerance.valve]\nflow_gain_kg_per_pa_s = 0.1\n",
            Rig::REFERENCE_TOML
        );
        let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
        let value = rig.value_mut("valve", "flow_gain_kg_per_pa_s");
        *value.expect("the key") = written[0].0;
        let rewritten = rig.rewritten(&text).expect("TOML");
        let expected = "flow_gain_kg_per_pa_s = 8.42879e-8 ";
        assert!(rewritten.contains(expected), "{rewritten}");
    }

    proptest::proptest! {
        #[test]
        fn a_value_reads_back_as_the_same_number(value in proptest::num::f64::NORMAL) {
            let read: toml_edit::Value = float_toml(value).parse().expect("TOML");
            proptest::prop_assert_eq!(read.as_float(), Some(value));
        }
    }

    #[test]
    fn an_effect_is_added_to_those_of_an_array() {
        let array = "schema = 1\neffect = [{ name = \"leak\", conductance_kg_per_pa_s = 4e-9 }]\n";
        let text = Rig::REFERENCE_TOML.replace("schema = 1\n", array);
        let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
        assert_eq!(rig.rewritten(&text).as_ref(), Ok(&text));
        rig.effects.push(rig.effects[0].clone());
        rig.effects[1].values[0] = 5.000_000_123e-9;
        let both = rig.rewritten(&text).expect("TOML");
        let read = Rig::parse("rig.toml", &both).expect("a rig");
        assert_eq!(read.effects.len(), 2);
        assert_eq!(read.effects[1].values, [5e-9]);
    }
}
