//! Variables of MATLAB files, with the feature `matlab`.

use super::BadInput;
use super::source::Variable;
use matfile::{MatFile, NumericData};

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
        Ok(Some((version_5(name, bytes)?, "MATLAB 5")))
    } else {
        Ok(None)
    }
}

/// The numeric arrays of a MATLAB file of version 5 to 7.
fn version_5(name: &str, bytes: &[u8]) -> Result<Vec<Variable>, BadInput> {
    let file = MatFile::parse(bytes)
        .map_err(|error| BadInput::file(name, format!("a MATLAB file, {error}")))?;
    let arrays = file.arrays().iter().filter(|array| array.size().len() == 2);
    let variables = arrays.map(|array| Variable {
        name: array.name().into(),
        height: array.size()[0],
        width: array.size()[1],
        values: numbers(array.data()),
    });
    Ok(variables.collect())
}

fn numbers(data: &NumericData) -> Vec<f64> {
    // Measured values are exact in 53 bits.
    macro_rules! to_f64 {
        ($real:ident) => {
            $real.iter().map(|value| *value as f64).collect()
        };
    }
    match data {
        NumericData::Int8 { real, .. } => to_f64!(real),
        NumericData::UInt8 { real, .. } => to_f64!(real),
        NumericData::Int16 { real, .. } => to_f64!(real),
        NumericData::UInt16 { real, .. } => to_f64!(real),
        NumericData::Int32 { real, .. } => to_f64!(real),
        NumericData::UInt32 { real, .. } => to_f64!(real),
        NumericData::Int64 { real, .. } => to_f64!(real),
        NumericData::UInt64 { real, .. } => to_f64!(real),
        NumericData::Single { real, .. } => to_f64!(real),
        NumericData::Double { real, .. } => real.clone(),
    }
}

/// Largest compression ratio of deflate.
const PACKED_MAX: u64 = 1032;

/// The numeric arrays of a MATLAB file of version 7.3, which is HDF5 with a group for each struct.
/// A field of a struct is named `struct.field`.
fn version_7(name: &str, bytes: &[u8]) -> Result<Vec<Variable>, BadInput> {
    let bad = |error: hdf5_pure::Error| BadInput::file(name, format!("an HDF5 file, {error}"));
    let file = hdf5_pure::File::from_bytes(bytes.to_vec()).map_err(bad)?;
    let mut variables = Vec::new();
    let mut groups = vec![(String::new(), file.root())];
    while let Some((prefix, group)) = groups.pop() {
        for found in group.datasets().map_err(bad)? {
            let dataset = group.dataset(&found).map_err(bad)?;
            let shape = dataset.shape().map_err(bad)?;
            // Rows and columns are exchanged: MATLAB stores arrays by columns.
            let [width, height] = shape[..] else {
                continue;
            };
            // A damaged file may claim any size, for which memory would be allocated.
            let size = width.saturating_mul(height);
            if size > PACKED_MAX.saturating_mul(bytes.len() as u64) {
                let expected =
                    format!("at most as many numbers as fit in it, found {size} in `{found}`");
                return Err(BadInput::file(name, expected));
            }
            let Ok(values) = dataset.read_f64() else {
                continue;
            };
            variables.push(Variable {
                name: format!("{prefix}{found}"),
                height: height as usize,
                width: width as usize,
                values,
            });
        }
        for found in group.groups().map_err(bad)? {
            // MATLAB stores the contents of cell arrays in groups whose names begin with `#`.
            if !found.starts_with('#') {
                let inner = group.group(&found).map_err(bad)?;
                groups.push((format!("{prefix}{found}."), inner));
            }
        }
    }
    Ok(variables)
}
