//! Dimensions of units: exponents of kilogram, metre, second and kelvin.

use std::fmt;
use winnow::Parser;
use winnow::combinator::{Infix, Postfix, alt, delimited, dispatch, expression, fail};
use winnow::error::ContextError;
use winnow::token::{any, take_while};

/// Exponents of kg, m, s and K.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dimension([f64; 4]);

/// The units that are read, all of them coherent: a value in one is the same number in base units.
const UNITS: &[(&str, [f64; 4])] = &[
    ("1", [0.0; 4]),
    ("-", [0.0; 4]),
    ("kg", [1.0, 0.0, 0.0, 0.0]),
    ("m", [0.0, 1.0, 0.0, 0.0]),
    ("s", [0.0, 0.0, 1.0, 0.0]),
    ("K", [0.0, 0.0, 0.0, 1.0]),
    ("Hz", [0.0, 0.0, -1.0, 0.0]),
    ("N", [1.0, 1.0, -2.0, 0.0]),
    ("Pa", [1.0, -1.0, -2.0, 0.0]),
    ("J", [1.0, 2.0, -2.0, 0.0]),
    ("W", [1.0, 2.0, -3.0, 0.0]),
];

impl Dimension {
    /// That of a number.
    pub const NONE: Dimension = Dimension([0.0; 4]);

    /// Reads a unit: `N`, `kg/(Pa·s)`, `m²`, `1/s`.
    ///
    /// # Errors
    /// What was expected.
    pub fn of_unit(unit: &str) -> Result<Dimension, String> {
        product.parse(unit).map_err(|_| {
            let known: Vec<_> = UNITS.iter().map(|(name, _)| *name).collect();
            format!(
                "a unit of {}, with · / ( ) ² ³ and ^, found \"{unit}\"",
                known.join(", ")
            )
        })
    }

    /// Exponents of kg, m, s and K.
    pub fn exponents(self) -> [f64; 4] {
        self.0
    }

    /// That of a product.
    pub fn times(self, other: Dimension) -> Dimension {
        Dimension(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }

    /// That of a power.
    pub fn to_power(self, power: f64) -> Dimension {
        Dimension(self.0.map(|exponent| exponent * power))
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // The name of a unit where it has one.
        let named = UNITS.iter().find(|(_, exponents)| *exponents == self.0);
        if let Some((name, _)) = named {
            return write!(f, "[{name}]");
        }
        let bases = ["kg", "m", "s", "K"].iter().zip(self.0);
        let factors = bases.filter(|(_, exponent)| *exponent != 0.0);
        let factors: Vec<_> = factors
            .map(|(base, exponent)| match exponent {
                1.0 => (*base).to_owned(),
                exponent => format!("{base}^{exponent}"),
            })
            .collect();
        write!(f, "[{}]", factors.join("·"))
    }
}

fn product(input: &mut &str) -> Result<Dimension, ContextError> {
    expression(alt((delimited('(', product, ')'), symbol)))
        .infix(dispatch! {any;
            '·' | '*' => Infix::Left(10, |_: &mut _, a: Dimension, b| Ok(a.times(b))),
            '/' => Infix::Left(10, |_: &mut _, a: Dimension, b: Dimension| {
                Ok(a.times(b.to_power(-1.0)))
            }),
            _ => fail,
        })
        .postfix(dispatch! {any;
            '²' => Postfix(12, |_: &mut _, a: Dimension| Ok(a.to_power(2.0))),
            '³' => Postfix(12, |_: &mut _, a: Dimension| Ok(a.to_power(3.0))),
            '^' => Postfix(12, |input: &mut &str, a: Dimension| {
                let digits = take_while(1.., |letter: char| "-0123456789".contains(letter));
                let power: f64 = digits.parse_to().parse_next(input)?;
                Ok(a.to_power(power))
            }),
            _ => fail,
        })
        .parse_next(input)
}

fn symbol(input: &mut &str) -> Result<Dimension, ContextError> {
    take_while(1.., |letter: char| {
        letter.is_ascii_alphabetic() || "1-".contains(letter)
    })
    .verify_map(|name: &str| {
        let unit = UNITS.iter().find(|(known, _)| *known == name);
        unit.map(|(_, exponents)| Dimension(*exponents))
    })
    .parse_next(input)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_products_of_base_units() {
        for (unit, exponents) in [
            ("kg/(Pa·s)", [0.0, 1.0, 1.0, 0.0]),
            ("W/(m²·K)", [1.0, 0.0, -3.0, -1.0]),
            ("N·s/m", [1.0, 0.0, -1.0, 0.0]),
            ("1/s", [0.0, 0.0, -1.0, 0.0]),
            ("m^-2", [0.0, -2.0, 0.0, 0.0]),
            ("-", [0.0; 4]),
        ] {
            assert_eq!(Dimension::of_unit(unit), Ok(Dimension(exponents)), "{unit}");
        }
        for wrong in ["", "bar", "N·", "kPa", "(N", "N m", "%"] {
            let error = Dimension::of_unit(wrong).expect_err(wrong);
            assert!(error.starts_with("a unit of 1, -, kg"), "{error}");
        }
    }
}
