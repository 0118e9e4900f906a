//! The archive of an FMU: model description, shared libraries, the rig, and the licence.

use super::{Experiment, MODEL_IDENTIFIER, Model, RIG_FILE, STARTS_FILE};
use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;

/// File name of the shared library on this platform.
pub fn library_name() -> String {
    format!("{DLL_PREFIX}{MODEL_IDENTIFIER}{DLL_SUFFIX}")
}

const LICENCE: &str = include_str!("../../../LICENSE-MIT");
/// A function that every shared library of an FMU exports.
const SYMBOL: &[u8] = b"fmi3InstantiateCoSimulation";

/// The platform tuple of FMI and the extension of a shared library, from its first bytes; `None` if
/// it is none of a platform that is known.
fn platform(library: &[u8]) -> Option<(&'static str, &'static str)> {
    let word = |at: usize| {
        Some(u16::from_le_bytes([
            *library.get(at)?,
            *library.get(at + 1)?,
        ]))
    };
    if library.starts_with(b"\x7fELF") {
        return match word(18)? {
            62 => Some(("x86_64-linux", "so")),
            183 => Some(("aarch64-linux", "so")),
            _ => None,
        };
    }
    if library.starts_with(b"MZ") {
        let header = usize::from(word(0x3c)?);
        return (word(header + 4)? == 0x8664).then_some(("x86_64-windows", "dll"));
    }
    // Mach-O of 64 bits and its CPU.
    match (library.get(..4)?, word(4)?, word(6)?) {
        ([0xcf, 0xfa, 0xed, 0xfe], 7, 0x0100) => Some(("x86_64-darwin", "dylib")),
        ([0xcf, 0xfa, 0xed, 0xfe], 12, 0x0100) => Some(("aarch64-darwin", "dylib")),
        _ => None,
    }
}

/// The FMU of a model with a name and a default experiment, and shared libraries, one per platform.
/// The same parts give the same bytes.
///
/// # Errors
/// The number of the library that is none, and what was expected.
pub fn package(
    model: &Model,
    name: &str,
    experiment: Experiment,
    libraries: &[Vec<u8>],
) -> Result<Vec<u8>, (usize, String)> {
    let (description, starts) = (model.description(name, experiment), model.starts());
    let mut files = vec![
        ("modelDescription.xml".to_owned(), description.as_bytes()),
        (format!("resources/{RIG_FILE}"), model.text().as_bytes()),
        (format!("resources/{STARTS_FILE}"), starts.as_bytes()),
        (
            "documentation/licenses/license.txt".to_owned(),
            LICENCE.as_bytes(),
        ),
    ];
    for (number, library) in libraries.iter().enumerate() {
        let is_fmu = library.windows(SYMBOL.len()).any(|bytes| bytes == SYMBOL);
        let Some((platform, extension)) = platform(library).filter(|_| is_fmu) else {
            let expected = "a shared library of the crate `fmu` for Linux, Windows or macOS";
            return Err((number, expected.into()));
        };
        let name = format!("binaries/{platform}/{MODEL_IDENTIFIER}.{extension}");
        if files.iter().any(|(known, _)| *known == name) {
            return Err((number, format!("one library for {platform}, found another")));
        }
        files.push((name, library));
    }
    // Writing to memory does not fail below 4 GB.
    archive(&files).map_err(|error| (0, format!("files that fit in an archive, {error}")))
}

fn archive(files: &[(String, &[u8])]) -> zip::result::ZipResult<Vec<u8>> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in files {
        let options = SimpleFileOptions::default().last_modified_time(zip::DateTime::default());
        archive.start_file(name.as_str(), options)?;
        archive.write_all(bytes)?;
    }
    Ok(archive.finish()?.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    #[test]
    fn a_library_tells_its_platform() {
        let mut elf = b"\x7fELF".to_vec();
        elf.resize(64, 0);
        assert_eq!(platform(&elf), None);
        elf[18] = 62;
        assert_eq!(platform(&elf), Some(("x86_64-linux", "so")));
        elf[18] = 183;
        assert_eq!(platform(&elf), Some(("aarch64-linux", "so")));
        let mut dll = b"MZ".to_vec();
        dll.resize(0x88, 0);
        dll[0x3c] = 0x80;
        dll[0x84..0x86].copy_from_slice(&[0x64, 0x86]);
        assert_eq!(platform(&dll), Some(("x86_64-windows", "dll")));
        let dylib = [0xcf, 0xfa, 0xed, 0xfe, 12, 0, 0, 1];
        assert_eq!(platform(&dylib), Some(("aarch64-darwin", "dylib")));
        assert_eq!(platform(b"#!/bin/sh"), None);
    }

    #[test]
    fn a_library_of_something_else_is_refused() {
        let model = Model::new("rig.toml", Rig::REFERENCE_TOML).expect("a model");
        let package =
            |libraries: &[Vec<u8>]| package(&model, "rig", Experiment::default(), libraries);
        let mut elf = b"\x7fELF".to_vec();
        elf.resize(64, 0);
        elf[18] = 62;
        let other = package(&[elf.clone()]).expect_err("no FMU");
        assert_eq!(other.0, 0);
        elf.extend_from_slice(SYMBOL);
        let one = package(&[elf.clone()]).expect("an FMU");
        assert_eq!(package(&[elf.clone()]), Ok(one), "the same bytes");
        let twice = package(&[elf.clone(), elf]).expect_err("the same platform");
        assert_eq!(
            twice,
            (1, "one library for x86_64-linux, found another".into())
        );
    }
}
