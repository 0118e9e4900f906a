//! Writing a rig file: changes keep comments and everything that stays the same.

use super::Rig;
use muscle_plant::effects::Effect;

impl Rig {
    /// `text`, the rig's file, with the nominal values that have a tolerance and the effects of
    /// this rig; comments and everything that stays the same are kept.
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
            if let (Some(value), Some(item)) = (value, item.and_then(|item| item.as_value_mut())) {
                let decor = item.decor().clone();
                *item = value.into();
                *item.decor_mut() = decor;
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
        let mut text = document.to_string();
        for effect in self.effects.iter().skip(written) {
            if !text.ends_with("\n\n") {
                text += if text.ends_with('\n') { "\n" } else { "\n\n" };
            }
            text += &effect_toml(effect);
        }
        Ok(text)
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
        text += &format!("{} = {value:?}\n", parameter.name);
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
        assert_eq!(
            rig.rewritten(&text).as_ref(),
            Ok(&text.replace("3.7718e-3", "0.0037718"))
        );
        *rig.value_mut("muscle", "alpha_m2").expect("the key") = 4e-3;
        let rewritten = rig.rewritten(&text).expect("TOML");
        assert_eq!(rewritten, text.replace("3.7718e-3", "0.004"));
    }

    #[test]
    fn an_effect_is_added_to_those_of_an_array() {
        let array = "schema = 1\neffect = [{ name = \"leak\", conductance_kg_per_pa_s = 4e-9 }]\n";
        let text = Rig::REFERENCE_TOML.replace("schema = 1\n", array);
        let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
        assert_eq!(rig.rewritten(&text).as_ref(), Ok(&text));
        rig.effects.push(rig.effects[0].clone());
        let both = rig.rewritten(&text).expect("TOML");
        let read = Rig::parse("rig.toml", &both).expect("a rig");
        assert_eq!(read.effects.len(), 2);
        assert_eq!(read.effects[1].values, [4e-9]);
    }
}
