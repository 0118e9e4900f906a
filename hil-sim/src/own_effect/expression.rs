//! Expressions of effects of one's own: numbers, names, `+ - * / ^`, parentheses and functions.
//!
//! `^` binds before a sign (−a^2 = −(a^2)) and to the right (a^b^c = a^(b^c)), as in mathematics.

use super::dimension::Dimension;
use std::fmt;
use winnow::Parser;
use winnow::combinator::{Infix, Prefix, alt, cut_err, delimited, expression, fail, preceded};
use winnow::error::{ContextError, ErrMode, StrContext, StrContextValue};
use winnow::token::take_while;

/// The longest expression that is read, in bytes: nested parentheses take some stack each.
const LENGTH_MAX: usize = 1000;

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    Negative,
    Abs,
    Sqrt,
    Exp,
    Ln,
    Sin,
    Cos,
    Tanh,
    /// −1, 0 or 1.
    Sign,
}

/// A function of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Operation {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
}

/// The names of functions that are called.
const FUNCTIONS: &[(&str, Function)] = &[
    ("abs", Function::Abs),
    ("sqrt", Function::Sqrt),
    ("exp", Function::Exp),
    ("ln", Function::Ln),
    ("sin", Function::Sin),
    ("cos", Function::Cos),
    ("tanh", Function::Tanh),
    ("sign", Function::Sign),
];
const OPERATIONS: &[(&str, Operation)] = &[("min", Operation::Min), ("max", Operation::Max)];

/// An expression over a list of names.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Expression {
    Number(f64),
    /// The name at this index of the list.
    Name(usize),
    Of(Function, Box<Expression>),
    Pair(Operation, Box<[Expression; 2]>),
}

use Expression::{Name, Number, Of, Pair};

impl Function {
    fn value(self, x: f64) -> f64 {
        match self {
            Function::Negative => -x,
            Function::Abs => x.abs(),
            Function::Sqrt => x.sqrt(),
            Function::Exp => x.exp(),
            Function::Ln => x.ln(),
            Function::Sin => x.sin(),
            Function::Cos => x.cos(),
            Function::Tanh => x.tanh(),
            Function::Sign if x == 0.0 => 0.0,
            Function::Sign => x.signum(),
        }
    }
}

impl Operation {
    fn value(self, a: f64, b: f64) -> f64 {
        match self {
            Operation::Add => a + b,
            Operation::Subtract => a - b,
            Operation::Multiply => a * b,
            Operation::Divide => a / b,
            // Of a number, most often 2.
            Operation::Power if b.fract() == 0.0 && b.abs() <= 16.0 => a.powi(b as i32),
            Operation::Power => a.powf(b),
            Operation::Min => a.min(b),
            Operation::Max => a.max(b),
        }
    }
}

fn pair(operation: Operation, a: Expression, b: Expression) -> Expression {
    use Operation::{Add, Divide, Multiply, Subtract};
    match (operation, &a, &b) {
        (_, Number(a), Number(b)) => Number(operation.value(*a, *b)),
        (Add, Number(0.0), _) => b,
        (Add | Subtract, _, Number(0.0)) => a,
        (Subtract, Number(0.0), _) => of(Function::Negative, b),
        (Multiply | Divide, Number(0.0), _) | (Multiply, _, Number(0.0)) => Number(0.0),
        (Multiply, Number(1.0), _) => b,
        (Multiply | Divide, _, Number(1.0)) => a,
        _ => Pair(operation, Box::new([a, b])),
    }
}

fn of(function: Function, a: Expression) -> Expression {
    match a {
        Number(a) => Number(function.value(a)),
        a => Of(function, Box::new(a)),
    }
}

impl Expression {
    /// Reads an expression over `names`.
    ///
    /// # Errors
    /// What was expected, and what was found.
    pub fn parse(text: &str, names: &[&str]) -> Result<Expression, String> {
        if text.len() > LENGTH_MAX {
            let found = text.len();
            return Err(format!("at most {LENGTH_MAX} characters, found {found}"));
        }
        let parsed = preceded(space, sum(names)).parse(text);
        parsed.map_err(|error| {
            let found = text[error.offset()..].split_whitespace().next();
            let found = found.map_or_else(|| "its end".into(), |word| format!("`{word}`"));
            let wanted = error.inner().context().find_map(|context| match context {
                StrContext::Expected(StrContextValue::Description(words)) => Some(*words),
                _ => None,
            });
            match wanted {
                Some(UNKNOWN) => {
                    let word: String = text[error.offset()..].chars().take_while(in_word).collect();
                    let known = names.iter().copied().chain(function_names());
                    let known: Vec<_> = known.filter(|name| !name.is_empty()).collect();
                    crate::error::one_of(&known, &word)
                }
                Some(wanted) => format!("{wanted}, found {found}"),
                // What stands before it wants an operand, or is one.
                None => {
                    let before = text[..error.offset()].trim_end().chars().last();
                    let is_open = before.is_none_or(|before| "+-*/^(,".contains(before));
                    let wanted = if is_open {
                        "a number, a name or `(`"
                    } else {
                        "an operator"
                    };
                    format!("{wanted}, found {found}")
                }
            }
        })
    }

    /// Its value, with a value for each name that it contains.
    pub fn value(&self, values: &[f64]) -> f64 {
        match self {
            Number(number) => *number,
            Name(index) => values[*index],
            Of(function, a) => function.value(a.value(values)),
            Pair(operation, pair) => {
                let [a, b] = &**pair;
                operation.value(a.value(values), b.value(values))
            }
        }
    }

    /// The same with numbers in the place of some names, and computed where it only has numbers.
    pub fn with(&self, number: &impl Fn(usize) -> Option<f64>) -> Expression {
        match self {
            Number(value) => Number(*value),
            Name(index) => number(*index).map_or(Name(*index), Number),
            Of(function, a) => of(*function, a.with(number)),
            Pair(operation, both) => {
                let [a, b] = &**both;
                pair(*operation, a.with(number), b.with(number))
            }
        }
    }

    /// Whether it contains a name of which `is` is true.
    pub fn any(&self, is: &impl Fn(usize) -> bool) -> bool {
        match self {
            Number(_) => false,
            Name(index) => is(*index),
            Of(_, a) => a.any(is),
            Pair(_, pair) => pair.iter().any(|part| part.any(is)),
        }
    }

    /// The derivative with respect to the name at `index`; `None` where that stands in a function
    /// with a corner or in an exponent.
    pub fn derivative(&self, index: usize) -> Option<Expression> {
        use Operation::{Add, Divide, Multiply, Power, Subtract};
        if !self.any(&|name| name == index) {
            return Some(Number(0.0));
        }
        let times = |a, b| pair(Multiply, a, b);
        Some(match self {
            Number(_) => Number(0.0),
            Name(_) => Number(1.0),
            Of(function, a) => {
                let slope = a.derivative(index)?;
                let inner = (**a).clone();
                let outer = match function {
                    Function::Negative => Number(-1.0),
                    Function::Exp => self.clone(),
                    Function::Sqrt => pair(Divide, Number(0.5), self.clone()),
                    Function::Ln => pair(Divide, Number(1.0), inner),
                    Function::Sin => of(Function::Cos, inner),
                    Function::Cos => of(Function::Negative, of(Function::Sin, inner)),
                    Function::Tanh => {
                        pair(Subtract, Number(1.0), times(self.clone(), self.clone()))
                    }
                    Function::Abs | Function::Sign => return None,
                };
                times(outer, slope)
            }
            Pair(operation, both) => {
                let [a, b] = &**both;
                let slopes = [a.derivative(index)?, b.derivative(index)?];
                let [of_a, of_b] = slopes;
                match operation {
                    Add | Subtract => pair(*operation, of_a, of_b),
                    Multiply => pair(Add, times(of_a, b.clone()), times(a.clone(), of_b)),
                    Divide => {
                        let lost = times(self.clone(), of_b);
                        pair(Divide, pair(Subtract, of_a, lost), b.clone())
                    }
                    Power if of_b == Number(0.0) => {
                        let less = pair(Power, a.clone(), pair(Subtract, b.clone(), Number(1.0)));
                        times(times(b.clone(), less), of_a)
                    }
                    Power | Operation::Min | Operation::Max => return None,
                }
            }
        })
    }

    /// Its dimension, with the dimension of each name; `None` where it contains a name without one.
    /// A quantity may be raised to a number, also one that is computed or that `number` gives.
    ///
    /// # Errors
    /// The operation that the dimensions do not allow, in words.
    pub fn dimension(
        &self,
        of: &[Option<Dimension>],
        names: &[&str],
        number: &impl Fn(usize) -> Option<f64>,
    ) -> Result<Option<Dimension>, String> {
        use Operation::{Divide, Multiply, Power};
        let shown = |part: &Expression| part.shown(names).to_string();
        Ok(match self {
            // Nothing has any dimension.
            Number(0.0) => None,
            Number(_) => Some(Dimension::NONE),
            Name(index) => of[*index],
            Of(Function::Negative | Function::Abs, a) => a.dimension(of, names, number)?,
            Of(Function::Sqrt, a) => a
                .dimension(of, names, number)?
                .map(|found| found.to_power(0.5)),
            Of(function, a) => match a.dimension(of, names, number)? {
                Some(found) if found != Dimension::NONE && *function != Function::Sign => {
                    let of = shown(a);
                    return Err(format!(
                        "a number in the place of `{of}`, which is in {found}"
                    ));
                }
                _ => Some(Dimension::NONE),
            },
            Pair(operation, pair) => {
                let [a, b] = &**pair;
                let found = [
                    a.dimension(of, names, number)?,
                    b.dimension(of, names, number)?,
                ];
                match (operation, found) {
                    (Multiply, [Some(a), Some(b)]) => Some(a.times(b)),
                    (Divide, [Some(a), Some(b)]) => Some(a.times(b.to_power(-1.0))),
                    (Multiply | Divide, _) => None,
                    (Power, [base, exponent]) => match (base, b.with(number)) {
                        _ if exponent.is_some_and(|found| found != Dimension::NONE) => {
                            return Err(format!("a number as exponent, found `{}`", shown(b)));
                        }
                        (Some(base), Number(power)) => Some(base.to_power(power)),
                        (Some(base), _) if base != Dimension::NONE => {
                            let exponent = shown(b);
                            return Err(format!("a number as exponent, found `{exponent}`"));
                        }
                        _ => base,
                    },
                    (_, [Some(of_a), Some(of_b)]) if of_a != of_b => {
                        return Err(format!(
                            "one unit, found {of_a} in `{}` and {of_b} in `{}`: if a number in \
                             it is a quantity, declare it as a constant with its unit",
                            shown(a),
                            shown(b)
                        ));
                    }
                    (_, [a, b]) => a.or(b),
                }
            }
        })
    }

    /// It as text, which reads back as the same expression.
    pub fn shown<'a>(&'a self, names: &'a [&'a str]) -> Shown<'a> {
        Shown(self, names)
    }
}

/// An expression with its names.
pub(super) struct Shown<'a>(&'a Expression, &'a [&'a str]);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Shown(expression, names) = self;
        match expression {
            Number(number) if *number < 0.0 => write!(f, "({number:?})"),
            Number(number) => write!(f, "{number:?}"),
            Name(index) => f.write_str(names[*index]),
            Of(Function::Negative, a) => write!(f, "(-{})", Shown(a, names)),
            Of(function, a) => {
                let named = FUNCTIONS.iter().find(|(_, known)| known == function);
                let name = named.map_or("", |(name, _)| name);
                write!(f, "{name}({})", Shown(a, names))
            }
            Pair(operation, pair) => {
                let [a, b] = &**pair;
                let (a, b) = (Shown(a, names), Shown(b, names));
                match operation {
                    Operation::Add => write!(f, "({a} + {b})"),
                    Operation::Subtract => write!(f, "({a} - {b})"),
                    Operation::Multiply => write!(f, "{a} * {b}"),
                    Operation::Divide => write!(f, "{a} / ({b})"),
                    Operation::Power => write!(f, "({a})^({b})"),
                    Operation::Min => write!(f, "min({a}, {b})"),
                    Operation::Max => write!(f, "max({a}, {b})"),
                }
            }
        }
    }
}

/// Whether a word is the name of a function or a number.
pub(super) fn is_reserved(word: &str) -> bool {
    word == "pi" || function_names().any(|name| name == word)
}

/// The names of all functions.
fn function_names<'a>() -> impl Iterator<Item = &'a str> {
    let functions = FUNCTIONS.iter().map(|(name, _)| *name);
    functions.chain(OPERATIONS.iter().map(|(name, _)| *name))
}

type Read<T> = Result<T, ErrMode<ContextError>>;

/// The description of an unknown name, whose message lists those that are known.
const UNKNOWN: &str = "a known name";

fn in_word(letter: &char) -> bool {
    letter.is_ascii_alphanumeric() || *letter == '_'
}

fn space(input: &mut &str) -> Read<()> {
    take_while(0.., char::is_whitespace)
        .void()
        .parse_next(input)
}

/// `token` and the space behind it.
fn token<'a>(token: char) -> impl Parser<&'a str, char, ErrMode<ContextError>> {
    (token, space).map(|(token, ())| token)
}

fn sum<'a>(names: &[&str]) -> impl Parser<&'a str, Expression, ErrMode<ContextError>> {
    move |input: &mut &'a str| {
        use Operation::{Add, Divide, Multiply, Power, Subtract};
        expression(|input: &mut &'a str| operand(input, names))
            .prefix(alt((
                token('-').map(|_| Prefix(14, |_: &mut _, a| Ok(negative(a)))),
                token('+').map(|_| Prefix(14, |_: &mut _, a| Ok(a))),
            )))
            .infix(alt((
                token('+').map(|_| Infix::Left(10, |_: &mut _, a, b| Ok(as_written(Add, a, b)))),
                token('-')
                    .map(|_| Infix::Left(10, |_: &mut _, a, b| Ok(as_written(Subtract, a, b)))),
                token('*')
                    .map(|_| Infix::Left(12, |_: &mut _, a, b| Ok(as_written(Multiply, a, b)))),
                token('/').map(|_| Infix::Left(12, |_: &mut _, a, b| Ok(as_written(Divide, a, b)))),
                token('^').map(|_| Infix::Right(16, |_: &mut _, a, b| Ok(as_written(Power, a, b)))),
            )))
            .parse_next(input)
    }
}

/// Without computing anything, so that a message shows what was written.
fn as_written(operation: Operation, a: Expression, b: Expression) -> Expression {
    Pair(operation, Box::new([a, b]))
}

fn negative(a: Expression) -> Expression {
    match a {
        Number(number) => Number(-number),
        a => Of(Function::Negative, Box::new(a)),
    }
}

/// A number, a name, a call, or an expression in parentheses.
fn operand(input: &mut &str, names: &[&str]) -> Read<Expression> {
    let first = input.chars().next();
    match first {
        Some('(') => {
            let inner = |input: &mut &_| sum(names).parse_next(input);
            delimited(
                token('('),
                cut_err(inner),
                cut_err(token(')').context(CLOSING)),
            )
            .parse_next(input)
        }
        Some(letter) if letter.is_ascii_digit() || letter == '.' => number(input),
        Some(letter) if letter.is_ascii_alphabetic() || letter == '_' => named(input, names),
        _ => fail.parse_next(input),
    }
}

const CLOSING: StrContext = StrContext::Expected(StrContextValue::Description("`)`"));
const OPENING: StrContext = StrContext::Expected(StrContextValue::Description("`(`"));
const COMMA: StrContext =
    StrContext::Expected(StrContextValue::Description("`,` and a second argument"));

fn number(input: &mut &str) -> Read<Expression> {
    let value = winnow::ascii::float.parse_next(input)?;
    space(input)?;
    Ok(Number(value))
}

fn named(input: &mut &str, names: &[&str]) -> Read<Expression> {
    let begin = *input;
    let word: &str = take_while(1.., |letter: char| in_word(&letter)).parse_next(input)?;
    space(input)?;
    if let Some(index) = names.iter().position(|name| *name == word) {
        return Ok(Name(index));
    }
    if word == "pi" {
        return Ok(Number(std::f64::consts::PI));
    }
    let argument = |input: &mut &_| cut_err(sum(names)).parse_next(input);
    let close = cut_err(token(')').context(CLOSING));
    if let Some((_, function)) = FUNCTIONS.iter().find(|(name, _)| *name == word) {
        let open = cut_err(token('(').context(OPENING));
        let inner = delimited(open, argument, close).parse_next(input)?;
        return Ok(Of(*function, Box::new(inner)));
    }
    if let Some((_, operation)) = OPERATIONS.iter().find(|(name, _)| *name == word) {
        cut_err(token('(').context(OPENING)).parse_next(input)?;
        let first = argument(input)?;
        cut_err(token(',').context(COMMA)).parse_next(input)?;
        let second = argument(input)?;
        cut_err(token(')').context(CLOSING)).parse_next(input)?;
        return Ok(as_written(*operation, first, second));
    }
    *input = begin;
    let unknown = StrContext::Expected(StrContextValue::Description(UNKNOWN));
    cut_err(fail.context(unknown)).parse_next(input)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: &[&str] = &["a", "b", "tau_s"];

    fn value(text: &str) -> f64 {
        let read = Expression::parse(text, NAMES).unwrap_or_else(|error| panic!("{text}: {error}"));
        read.value(&[2.0, 3.0, 0.5])
    }

    #[test]
    fn expressions_have_the_precedence_of_mathematics() {
        for (text, expected) in [
            ("-a^2", -4.0),
            ("2 - a^2", -2.0),
            ("a^b^2", 512.0),
            ("2^-a", 0.25),
            ("a-b-1", -2.0),
            ("a/b*3", 2.0),
            ("-(a + b)*2", -10.0),
            ("3*-a", -6.0),
            ("1.5e-3*a + 2E2", 200.003),
            ("max(a, min(b, 10))^2 / (b)", 3.0),
            (" exp( ln(a) ) + sqrt(4)*abs(-1) ", 4.0),
            ("sin(pi/6) + cos(0) + tanh(0)", 1.5),
            ("sign(a - b) + sign(a - a)", -1.0),
            ("1/tau_s", 2.0),
        ] {
            let found = value(text);
            assert!((found - expected).abs() < 1e-12, "{text}: {found}");
        }
    }

    #[test]
    fn what_is_no_expression_is_refused_in_words() {
        for (text, expected) in [
            ("", "a number, a name or `(`, found its end"),
            ("a +", "a number, a name or `(`, found its end"),
            ("a b", "an operator, found `b`"),
            ("(a + b", "`)`, found its end"),
            ("max(a)", "`,` and a second argument, found `)`"),
            ("sqrt a", "`(`, found `a`"),
            ("a ** 2", "a number, a name or `(`, found `*`"),
            ("a > b", "an operator, found `>`"),
            ("tau", "found \"tau\": did you mean tau_s?"),
            ("1.2.3", "an operator, found `.3`"),
        ] {
            let error = Expression::parse(text, NAMES).expect_err(text);
            assert!(error.ends_with(expected), "{text}: {error}");
        }
        for deep in [
            "(".repeat(999),
            "-".repeat(999),
            "2^".repeat(499),
            "(".repeat(5000),
        ] {
            assert!(Expression::parse(&deep, NAMES).is_err());
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_an_expression_or_an_error(text in "[-a-b0-9e.+*/^(), minxp]{0,60}") {
            drop(Expression::parse(&text, NAMES));
        }
    }

    /// The derivative against a central difference, whose error is h² f‴/6 and ε f/h.
    #[test]
    fn derivatives_are_those_of_differences() {
        for text in [
            "a*b/tau_s",
            "b/(a + tau_s)",
            "exp(-a/b)*sin(a*b)",
            "(a + b)^3 - sqrt(a)",
            "ln(a) + tanh(a/b) + cos(a)",
            "max(b, tau_s)*a",
        ] {
            let read = Expression::parse(text, NAMES).expect("an expression");
            let slope = read.derivative(0).expect("a derivative");
            let at = |a: f64| read.value(&[a, 3.0, 0.5]);
            let difference = (at(2.0 + 1e-5) - at(2.0 - 1e-5)) / 2e-5;
            let found = slope.value(&[2.0, 3.0, 0.5]);
            assert!(
                (found - difference).abs() < 1e-7 * (1.0 + found.abs()),
                "{text}"
            );
        }
        let corner = Expression::parse("abs(a)", NAMES).expect("an expression");
        assert_eq!(corner.derivative(0), None);
    }

    #[test]
    fn an_expression_reads_back_from_its_text() {
        for text in [
            "-a^2 - (b - 1)/tau_s/a",
            "max(a, -b)^(a - 1)*exp(-(a + b))",
            "2e-9*a",
        ] {
            let read = Expression::parse(text, NAMES).expect("an expression");
            let again = Expression::parse(&read.shown(NAMES).to_string(), NAMES).expect("again");
            assert_eq!(
                again.value(&[2.0, 3.0, 0.5]),
                read.value(&[2.0, 3.0, 0.5]),
                "{text}"
            );
        }
    }

    #[test]
    fn dimensions_are_checked() {
        let [metre, second] = ["m", "s"].map(|unit| Dimension::of_unit(unit).ok());
        let of = [metre, second, None];
        let dimension = |text: &str| {
            let read = Expression::parse(text, NAMES).expect("an expression");
            read.dimension(&of, NAMES, &|index| (index == 2).then_some(2.0))
        };
        let speed = Dimension::of_unit("m/s").ok();
        assert_eq!(dimension("a/b"), Ok(speed));
        assert_eq!(dimension("max(a/b, 0)"), Ok(speed));
        assert_eq!(dimension("sqrt(a^2 + 4*a*a)"), Ok(metre));
        assert_eq!(dimension("a*tau_s"), Ok(None), "a name without a unit");
        assert_eq!(dimension("(a*a)^(1/2)"), Ok(metre));
        assert_eq!(dimension("(a/b)^tau_s*b*b"), dimension("a*a"), "a constant");
        for (text, expected) in [
            ("a + b", "one unit, found [m] in `a` and [s] in `b`"),
            ("a - 1", "one unit, found [m] in `a` and [1] in `1.0`"),
            ("exp(a)", "a number in the place of `a`, which is in [m]"),
            ("a^b", "a number as exponent, found `b`"),
        ] {
            let error = dimension(text).expect_err(text);
            assert!(error.starts_with(expected), "{text}: {error}");
        }
    }
}
