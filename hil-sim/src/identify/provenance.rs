//! Where the fitted rig of a diagnosis comes from: the tool, the verdict and the files.

use super::diagnosis::Diagnosis;
use crate::rig::{FileHash, FoundEffect, Provenance, UsedRecord};
use sha2::{Digest, Sha256};
use std::path::Path;
use toml_edit::Datetime;

/// The file at `path`, which contained `bytes`, with its SHA-256 as `sha256sum` writes it.
pub fn file_hash(path: &Path, bytes: &[u8]) -> FileHash {
    let name = path.file_name().unwrap_or(path.as_os_str());
    let sha256 = Sha256::digest(bytes);
    FileHash {
        file: name.to_string_lossy().into_owned(),
        sha256: sha256.iter().map(|byte| format!("{byte:02x}")).collect(),
    }
}

/// Where the rig that `diagnosis` fitted at `date` comes from.
pub fn provenance(
    diagnosis: &Diagnosis,
    date: Datetime,
    nominal_rig: FileHash,
    [fit, validate]: [Vec<FileHash>; 2],
) -> Provenance {
    let used = |files: Vec<FileHash>, used_to: &'static str| {
        files.into_iter().map(move |source| UsedRecord {
            source,
            used_to: used_to.into(),
        })
    };
    let effects = diagnosis.effects.iter().map(|named| FoundEffect {
        name: named.name.into(),
        form: named.form.into(),
        probability: named.probability,
        alternatives: named.alternatives.iter().map(|&n| n.into()).collect(),
        ci95: named
            .parameters
            .iter()
            .map(|(&key, estimate)| (key.into(), estimate.ci95))
            .collect(),
    });
    Provenance {
        tool: "hil-sim".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        date,
        verdict: diagnosis.verdict.name().into(),
        nominal_rig,
        records: used(fit, "fit").chain(used(validate, "validate")).collect(),
        effects: effects.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_the_hash_that_others_compute() {
        // The digest of "abc" is the first example of FIPS 180-2, appendix B.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let hash = file_hash(Path::new("rigs/rig.toml"), b"abc");
        assert_eq!((&hash.file[..], &hash.sha256[..]), ("rig.toml", abc));
    }
}
