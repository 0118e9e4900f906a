//! What is claimed: docs/safety-case/case.toml.

use serde::Deserialize;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    pub hazard: Vec<Hazard>,
    pub requirement: Vec<Requirement>,
    pub hardware: Vec<Hardware>,
    pub component: Vec<Component>,
    pub function: Vec<Function>,
    pub architecture: Vec<Architecture>,
    pub checklist: Vec<Checklist>,
    pub uncovered: Uncovered,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hazard {
    pub id: String,
    pub text: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Requirement {
    pub id: String,
    pub text: String,
    /// Hazards that it keeps away.
    pub hazards: Vec<String>,
    /// The safety function that the campaign switches off.
    pub switch: Option<String>,
    /// File and item: `path#item`.
    pub code: Vec<String>,
    /// Reasons that it latches.
    #[serde(default)]
    pub reasons: Vec<String>,
    /// The campaign's kinds of fault that show it.
    #[serde(default)]
    pub kinds: Vec<String>,
    /// File and test: `path#test`.
    pub tests: Vec<String>,
    /// What is not kept.
    pub gap: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hardware {
    pub case: String,
    pub part: String,
    pub reaches: String,
}

/// A part and its rate of dangerous failures: FIT, or cycles and how many a year.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Component {
    pub id: String,
    /// Dangerous failures in 10⁹ h.
    pub fit: Option<f64>,
    /// Cycles after which a tenth of the parts has failed dangerously.
    pub b10d: Option<f64>,
    pub operations_per_year: Option<f64>,
    pub source: String,
}

/// A safety function in the sense of ISO 13849.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Function {
    pub id: String,
    pub text: String,
    /// The required performance level.
    pub required: String,
    pub why: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Architecture {
    pub name: String,
    pub function: String,
    pub category: String,
    /// Components of each channel; of category 2 the second is the test equipment.
    pub channels: Vec<Vec<String>>,
    /// Mean diagnostic coverage.
    pub coverage: f64,
    /// Points of annex F.
    pub ccf: u32,
    pub why: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checklist {
    pub standard: String,
    pub items: Vec<Item>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Item {
    pub topic: String,
    /// `met`, `part`, `rig` or `no`.
    pub is: String,
    pub how: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Uncovered {
    pub items: Vec<String>,
}

/// The repository's folder.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

impl Source {
    pub fn read() -> Source {
        let path = repository().join("docs/safety-case/case.toml");
        let text = std::fs::read_to_string(&path).expect("docs/safety-case/case.toml");
        toml_edit::de::from_str(&text).unwrap_or_else(|error| panic!("case.toml: {error}"))
    }
}
