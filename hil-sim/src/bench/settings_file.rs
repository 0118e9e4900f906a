//! A board's settings as TOML, with all names, units and values of [`SettingsValues`].

use crate::error::BadInput;
use crate::input::read_text;
use crate::output::utc;
use model_core::limits::{LIMITS, safety_hash};
use model_core::link::{Change, Signature};
use model_core::settings::{Settings, SettingsValues};
use std::path::Path;
use std::time::Duration;

/// The settings as TOML, which reads back to the same values.
pub fn to_toml(values: &SettingsValues) -> String {
    // By way of JSON, whose writer gives an f32 its shortest exact digits. A plain struct of
    // numbers is valid in both formats.
    let json = serde_json::to_string(values).unwrap_or_default();
    let value: serde_json::Value = serde_json::from_str(&json).unwrap_or_default();
    let toml = toml_edit::ser::to_string_pretty(&value).unwrap_or_default();
    format!("# Settings of the board; SI units. See docs/compensation.md.\n{toml}")
}

/// Who has changed settings, and when, as text.
pub fn signed(signature: &Signature) -> String {
    let name = signature.author.iter().take_while(|byte| **byte != 0);
    let name: Vec<u8> = name.copied().collect();
    let printable = |letter: char| if letter.is_control() { '?' } else { letter };
    let name: String = String::from_utf8_lossy(&name)
        .chars()
        .map(printable)
        .collect();
    let who = if name.is_empty() {
        "nobody named"
    } else {
        &name
    };
    let when = match signature.utc_s {
        0 => "at an unknown time".into(),
        utc_s => utc(Duration::from_secs(utc_s.into())).to_string(),
    };
    let how = match signature.is_confirmed {
        true => "confirmed at the device",
        false => "outside the safety block",
    };
    format!("by {who}, {when}, {how}")
}

/// A change of settings as text: who and when, and each value that differs from those `before`.
pub fn changed(change: &Change, before: Option<&SettingsValues>) -> String {
    let hash = safety_hash(&change.values);
    let signed = signed(&change.signature);
    let mut text = format!("{:5}  safety block {hash:08x}, {signed}\n", change.number);
    for limit in LIMITS {
        let new = (limit.value)(&change.values);
        match before.map(limit.value) {
            Some(old) if old != new => text += &format!("       {}: {old} → {new}\n", limit.name),
            _ => {}
        }
    }
    text
}

/// Reads and checks settings.
///
/// # Errors
/// The file is missing or is not TOML; a key is missing, unknown or of another type; a value is out
/// of range.
pub fn read(path: &Path) -> Result<Settings, BadInput> {
    let file = path.display().to_string();
    parse(&file, &read_text(path, "a readable TOML file")?)
}

/// As [`read`], from the `text` of `file`.
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

    /// A setting that is not in the table would have no limits, and be in no block.
    #[test]
    fn every_setting_has_its_limits() {
        fn names(prefix: &str, value: &serde_json::Value) -> Vec<String> {
            let serde_json::Value::Object(fields) = value else {
                return vec![prefix.into()];
            };
            let dot = if prefix.is_empty() { "" } else { "." };
            let named = |(name, value): (&String, _)| names(&format!("{prefix}{dot}{name}"), value);
            fields.iter().flat_map(named).collect()
        }
        let json = serde_json::to_value(SettingsValues::reference()).expect("JSON");
        let mut found = names("", &json);
        let mut listed: Vec<_> = model_core::limits::LIMITS
            .iter()
            .map(|limit| limit.name.to_owned())
            .collect();
        found.sort();
        listed.sort();
        assert_eq!(found, listed);
    }

    #[test]
    fn settings_read_back_from_toml_are_equal() {
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
    fn an_error_names_the_bad_setting() {
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
