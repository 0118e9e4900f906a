//! A diagnosis of files: of a rig and of records, with all that is said of them beside it.

use super::diagnosis::{Diagnosed, Options, diagnose};
use super::provenance::provenance;
use crate::error::BadInput;
use crate::output::{utc, written_at};
use crate::record::Record;
use crate::record::check::check;
use crate::rig::{FileHash, Rig};
use model_discrepancy::verdict::Watch;

/// The files of a diagnosis.
pub struct Files<'a> {
    /// The rig, the name of its file, and its text.
    pub rig: (&'a Rig, &'a str, &'a str),
    /// The records to fit, and those to predict.
    pub records: [&'a [Record]; 2],
    /// Their files.
    pub hashes: [Vec<FileHash>; 2],
    /// The rig's file.
    pub rig_hash: FileHash,
    /// A rig without tolerances is exact.
    pub exact: bool,
}

/// Diagnoses `files`: the result, and the file of the fitted rig.
///
/// # Errors
/// The rig does not tell how well its values are known, or as of [`diagnose`].
pub fn diagnose_files(
    files: Files,
    options: &Options,
    watch: Watch,
) -> Result<(Diagnosed, String), BadInput> {
    let date = utc(written_at()?);
    let (rig, name, text) = files.rig;
    check_tolerances(rig, name, files.exact)?;
    check_apart(&files.hashes)?;
    let [fit, validate] = files.records;
    let mut diagnosed = diagnose(rig, fit, validate, options, watch)?;
    let warnings = &mut diagnosed.diagnosis.warnings;
    if rig.tolerances.is_empty() {
        warnings
            .push("the rig has no tolerances: the verdict rests on its values being exact".into());
    }
    warnings.extend(in_doubt(rig, fit.iter().chain(validate)));
    let rewritten = diagnosed.fitted.rewritten(text);
    let from = provenance(&diagnosed.diagnosis, date, files.rig_hash, files.hashes);
    let rewritten = rewritten
        .and_then(|rewritten| from.around(&rewritten))
        .map_err(|error| rig.bad_file(&error.to_string()))?;
    diagnosed.diagnosis.warnings.extend(refused(&rewritten));
    Ok((diagnosed, rewritten))
}

/// What was accepted although it cannot be in the unit that its name says, as warnings.
fn in_doubt<'a>(
    rig: &'a Rig,
    records: impl Iterator<Item = &'a Record> + 'a,
) -> impl Iterator<Item = String> + 'a {
    let of_rig = rig.check_units().err().into_iter();
    let of_records = records.flat_map(|record| {
        let doubted = check(record).units(record, Some(rig));
        doubted
            .into_iter()
            .map(|finding| finding.refusal(record))
            .collect::<Vec<_>>()
    });
    of_rig
        .chain(of_records)
        .map(|error| format!("accepted: {error}"))
}

/// What is expected of a rig without tolerances.
fn untold(path: &str) -> String {
    format!(
        "[tolerance.*] tables, which say how well its values are known (`hil-sim rig tolerances \
         {path}` prints those of uncalibrated values, to paste at its end), or --exact if all are \
         exact"
    )
}

/// Checks that there is a record to fit and one to predict, and that these differ.
fn check_apart([fit, validate]: &[Vec<FileHash>; 2]) -> Result<(), BadInput> {
    for (records, used_to) in [(fit, "fit"), (validate, "validate")] {
        if records.is_empty() {
            return Err(BadInput::file(used_to, "at least one record, found none"));
        }
    }
    let is_fitted = |own: &&FileHash| fit.iter().any(|other| other.sha256 == own.sha256);
    match validate.iter().find(is_fitted) {
        Some(own) => Err(BadInput::file(
            own.file.clone(),
            "a record that is not fitted too",
        )),
        None => Ok(()),
    }
}

/// Checks that a rig tells how well its values are known, or is said to be exact.
fn check_tolerances(rig: &Rig, path: &str, exact: bool) -> Result<(), BadInput> {
    match (rig.tolerances.is_empty(), exact) {
        (true, false) => Err(rig.bad_file(&untold(path))),
        (false, true) => Err(rig.bad_file(
            "no [tolerance.*] tables with --exact, which says that every value is exact",
        )),
        (true, true) | (false, false) => Ok(()),
    }
}

/// What other commands say of the fitted rig if they refuse it, as where digits that are left out
/// take a value past another.
fn refused(fitted: &str) -> Option<String> {
    let refused = Rig::parse("rig.fitted.toml", fitted).err()?;
    Some(format!(
        "other commands refuse the fitted rig: {refused}; a smaller tolerance of the value keeps \
         it from there"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fitted_rig_that_is_no_rig_is_told() {
        assert_eq!(refused(Rig::REFERENCE_TOML), None);
        let other =
            Rig::REFERENCE_TOML.replacen("volume_d1_m3 = -9.90e-4", "volume_d1_m3 = -1e-2", 1);
        assert_ne!(other, Rig::REFERENCE_TOML);
        let told = refused(&other).expect("refused");
        assert!(told.contains("a volume above 0"), "{told}");
    }
}
