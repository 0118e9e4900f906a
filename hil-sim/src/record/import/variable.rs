//! Variables of files that have more than columns.

use std::borrow::Cow;

/// What a file has that is not CSV.
#[cfg_attr(
    not(feature = "formats"),
    expect(dead_code, reason = "no format has one")
)]
pub(super) enum Content {
    Variables {
        variables: Vec<Variable>,
        format: &'static str,
        /// What there is to say about it.
        notes: Vec<String>,
    },
    /// Rows of cells as CSV.
    Text {
        text: String,
        format: &'static str,
        notes: Vec<String>,
    },
}

/// One variable of a MATLAB file or a log, column by column.
pub(super) struct Variable {
    pub(super) name: String,
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) values: Values,
}

/// The numbers of a variable.
pub(super) enum Values {
    /// They are here.
    #[cfg_attr(
        not(feature = "formats"),
        expect(dead_code, reason = "no format has them")
    )]
    Read(Vec<f64>),
    /// They are read when they are asked for.
    #[cfg(feature = "formats")]
    Stored(Box<hdf5_pure::Dataset>),
}

impl Values {
    /// The numbers, of which there are `count`.
    #[cfg_attr(
        not(feature = "formats"),
        expect(unused_variables, reason = "they are here")
    )]
    pub(super) fn get(&self, count: usize, numbers_max: usize) -> Result<Cow<'_, [f64]>, String> {
        match self {
            Values::Read(values) => Ok(Cow::Borrowed(values)),
            #[cfg(feature = "formats")]
            Values::Stored(dataset) => stored(dataset, count, numbers_max).map(Cow::Owned),
        }
    }
}

impl Variable {
    /// Whether it has one row or one column.
    pub(super) fn is_vector(&self) -> bool {
        self.height == 1 || self.width == 1
    }

    /// Its name, as a mapping may have it.
    pub(super) fn words(&self) -> String {
        if self.is_vector() {
            self.name.clone()
        } else {
            format!("{}(:,1) to (:,{})", self.name, self.width)
        }
    }
}

/// The numbers of a dataset, of which there are `count`.
///
/// # Errors
/// A damaged dataset, or one whose chunks are larger than `numbers_max`.
#[cfg(feature = "formats")]
fn stored(
    dataset: &hdf5_pure::Dataset,
    count: usize,
    numbers_max: usize,
) -> Result<Vec<f64>, String> {
    // Memory is allocated for whole chunks.
    let chunk = dataset.chunk_shape().map_err(|error| error.to_string())?;
    let chunk = chunk.unwrap_or_default();
    let chunk = chunk
        .iter()
        .fold(1_u64, |size, edge| size.saturating_mul(*edge));
    if chunk > numbers_max as u64 {
        return Err(format!(
            "chunks of at most {numbers_max} numbers, found {chunk}"
        ));
    }
    let values = dataset
        .read_f64()
        .map_err(|error| format!("a dataset that can be read, {error}"))?;
    match values.len() == count {
        true => Ok(values),
        false => Err(format!("{count} numbers, found {}", values.len())),
    }
}
