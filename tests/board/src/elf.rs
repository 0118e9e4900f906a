//! Reads segments and symbols of an ELF file.

use object::{Object, ObjectSymbol, elf, read::elf::FileHeader};

/// The reason why a file cannot be run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BadElf(pub String);

impl std::fmt::Display for BadElf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "not a firmware for this board: {}", self.0)
    }
}

impl std::error::Error for BadElf {}

/// The bytes to flash, with their load addresses.
pub fn load_segments(data: &[u8]) -> Result<Vec<(u32, Vec<u8>)>, BadElf> {
    let bad = |error: object::Error| BadElf(error.to_string());
    let header = elf::FileHeader32::<object::Endianness>::parse(data).map_err(bad)?;
    let endian = header.endian().map_err(bad)?;
    let mut segments = vec![];
    for program in header.program_headers(endian, data).map_err(bad)? {
        use object::read::elf::ProgramHeader as _;
        if program.p_type(endian) == elf::PT_LOAD && program.p_filesz(endian) > 0 {
            let bytes = program
                .data(endian, data)
                .map_err(|()| BadElf("cut short".into()))?;
            segments.push((program.p_paddr(endian), bytes.to_vec()));
        }
    }
    Ok(segments)
}

/// Names and addresses of the symbols.
pub fn symbols(data: &[u8]) -> Vec<(String, u32)> {
    let Ok(file) = object::File::parse(data) else {
        return vec![];
    };
    let named = |s: object::Symbol| Some((s.name().ok()?.to_string(), s.address() as u32));
    file.symbols().filter_map(named).collect()
}
