//! Names of the values of an enum in records, JSON and messages.

/// Gives an enum its names from one table: `name`, `from_name`, `NAMED` (the table itself) and
/// `Display`.
///
/// The names are part of the record's format. They do not depend on the variants' identifiers, so
/// that files stay readable if a variant is renamed.
macro_rules! names {
    ($type:ident: $($name:literal = $value:path $(, $inner:path)?;)*) => {
        impl $type {
            /// Every value, with its name in records.
            pub const NAMED: &'static [($type, &'static str)] =
                &[$(($value $(($inner))?, $name)),*];

            /// The name of this value in records.
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
