//! Variables of MATLAB files.

mod version_5;

use super::super::variable::Values;
use super::{BadInput, Variable, numbers_max};
use hdf5_pure::{DType, Group};

/// Datasets and groups of one HDF5 file, and groups within each other: files of data loggers have
/// hundreds and three, links back to a group have no end.
const OBJECTS_MAX: usize = 2_000;
const DEPTH_MAX: usize = 8;

/// The variables of the file `name` and its format; `None` if the bytes are not of MATLAB.
///
/// # Errors
/// The file is damaged.
pub(super) fn read(
    name: &str,
    bytes: &[u8],
) -> Result<Option<(Vec<Variable>, &'static str)>, BadInput> {
    if hdf5_pure::is_hdf5_bytes(bytes) {
        Ok(Some((version_7(name, bytes)?, "MATLAB 7.3")))
    } else if bytes.starts_with(b"MATLAB 5.0") {
        let variables = version_5::read(bytes, numbers_max(bytes.len()));
        let variables = variables
            .map_err(|expected| BadInput::file(name, format!("a MATLAB file, {expected}")))?;
        Ok(Some((variables, "MATLAB 5")))
    } else {
        Ok(None)
    }
}

/// The numeric arrays of a MATLAB file of version 7.3, which is HDF5 with a group for each struct,
/// or of another HDF5 file. A field of a struct is named `struct.field`. Their values are read when
/// they are asked for.
fn version_7(name: &str, bytes: &[u8]) -> Result<Vec<Variable>, BadInput> {
    let bad = |error: hdf5_pure::Error| BadInput::file(name, format!("an HDF5 file, {error}"));
    let file = hdf5_pure::File::from_bytes(bytes.to_vec()).map_err(bad)?;
    let (mut variables, mut objects) = (Vec::new(), 0);
    let mut groups: Vec<(String, Group, usize)> = vec![(String::new(), file.root(), 0)];
    while let Some((prefix, group, depth)) = groups.pop() {
        let datasets = group.iter_datasets().map_err(bad)?;
        objects += 1 + datasets.len();
        if objects > OBJECTS_MAX || depth > DEPTH_MAX {
            let expected = format!(
                "at most {OBJECTS_MAX} datasets and groups, {DEPTH_MAX} deep, found more: do \
                 groups link back to others?"
            );
            return Err(BadInput::file(name, expected));
        }
        for (found, dataset) in datasets {
            // MATLAB stores arrays by columns: rows and columns are exchanged.
            let (height, width) = match dataset.shape().map_err(bad)?[..] {
                [rows] => (rows, 1),
                [width, height] => (height, width),
                _ => continue,
            };
            if is_number(&dataset) {
                variables.push(Variable {
                    name: format!("{prefix}{found}"),
                    height: usize::try_from(height).unwrap_or(usize::MAX),
                    width: usize::try_from(width).unwrap_or(usize::MAX),
                    values: Values::Stored(Box::new(dataset)),
                });
            }
        }
        for (found, inner) in group.iter_groups().map_err(bad)? {
            // MATLAB stores the contents of cell arrays in groups whose names begin with `#`.
            if !found.starts_with('#') {
                groups.push((format!("{prefix}{found}."), inner, depth + 1));
            }
        }
    }
    Ok(variables)
}

fn is_number(dataset: &hdf5_pure::Dataset) -> bool {
    use DType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let number = dataset.dtype();
    number.is_ok_and(|of| matches!(of, F32 | F64 | I8 | I16 | I32 | I64 | U8 | U16 | U32 | U64))
}
