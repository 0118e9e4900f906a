//! Words for the values of an enum: what records, JSON and messages call them.

/// Gives an enum its words from one table: `name`, `from_name`, `NAMED` (the table itself) and
/// `Display`.
///
/// The words are part of the record's format. They do not follow from the variants' identifiers, so
/// that renaming a variant leaves files readable.
macro_rules! names {
    ($type:ident: $($name:literal = $value:path $(, $inner:path)?;)*) => {
        impl $type {
            /// Every value, with its name in records.
            pub const NAMED: &'static [($type, &'static str)] =
                &[$(($value $(($inner))?, $name)),*];

            /// The word for this value in records.
            pub fn name(self) -> &'static str {
                match self {
                    $($value $(($inner))? => $name,)*
                }
            }

            /// The value that `name` stands for in records, if any.
            pub fn from_name(name: &str) -> Option<$type> {
                match name {
                    $($name => Some($value $(($inner))?),)*
                    _ => None,
                }
            }
        }

        impl core::fmt::Display for $type {
            fn fmt(&self, f: &mut core::fmt::Formatter) -> core::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

pub(crate) use names;
