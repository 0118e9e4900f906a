//! A board's settings as TOML: the names, units and values of [`SettingsValues`], all of them.

use crate::error::BadInput;
use model_core::settings::{Settings, SettingsValues};
use std::path::Path;

/// The settings as TOML, which reads back to the same values.
pub fn to_toml(values: &SettingsValues) -> String {
    // Through JSON, whose writer gives an f32 the fewest digits that are that f32. A plain struct
    // of numbers is both JSON and TOML.
    let json = serde_json::to_string(values).unwrap_or_default();
    let value: serde_json::Value = serde_json::from_str(&json).unwrap_or_default();
    let toml = toml_edit::ser::to_string_pretty(&value).unwrap_or_default();
    format!("# Settings of the board; SI units. See docs/compensation.md.\n{toml}")
}

/// Reads and checks settings.
///
/// # Errors
/// No such file, no TOML, a key that is missing, unknown or of another type, a value out of range.
pub fn read(path: &Path) -> Result<Settings, BadInput> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path)
        .map_err(|error| BadInput::file(&*file, format!("a file that can be read, {error}")))?;
    parse(&file, &text)
}

/// As [`read`], from `text`.
///
/// # Errors
/// As [`read`].
pub fn parse(file: &str, text: &str) -> Result<Settings, BadInput> {
    let values: SettingsValues = toml_edit::de::from_str(text).map_err(|error| {
        let line = error
            .span()
            .map(|span| 1 + text[..span.start].matches('\n').count());
        BadInput {
            file: file.into(),
            line,
            place: None,
            expected: format!("a board's settings, {}", error.message()),
        }
    })?;
    Settings::new(values).map_err(|error| BadInput::file(file, format!("settings, {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_survives_the_file() {
        let mut values = SettingsValues::reference();
        values.muscle.alpha_m2 = f32::from_bits(values.muscle.alpha_m2.to_bits() + 1);
        values.compensation.lead_s = 0.022_5;
        let text = to_toml(&values);
        assert_eq!(
            *parse("settings.toml", &text).expect("settings").values(),
            values
        );
        assert!(text.contains("lead_s = 0.0225"), "{text}");
    }

    #[test]
    fn bad_settings_are_named() {
        let text = to_toml(&SettingsValues::reference());
        let errors = [
            (text.replace("lead_s = 0.0", "lead_s = 9.0"), "lead_s"),
            (text.replace("lead_s = 0.0", "lead_s = true"), "f32"),
            (text.replace("lead_s = 0.0\n", ""), "lead_s"),
        ];
        for (text, expected) in errors {
            let error = parse("settings.toml", &text)
                .expect_err("refused")
                .to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
