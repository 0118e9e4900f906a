//! Trying an effect before it is taken: what the plant cannot simulate is told where it is written.

use super::expression::Expression;
use super::term::{Change, Given, OwnTerm, Place, SENSOR, VALUES_MAX};
use crate::error::shown;
use muscle_plant::effects::Parameter;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// The shortest time constant that the plant resolves \[s\].
const SHORTEST_S: f64 = 2e-5;
/// Lines through the range of the inputs along which an expression is tried, and points of each.
const LINES: usize = 64;
const POINTS: usize = 16;
/// Halvings of a line about a jump: what is left of one is no slope.
const HALVINGS: u32 = 40;
/// Share of an expression's size that is a jump if it is left then; a root's corner leaves 1e-6.
const JUMP: f64 = 1e-3;

/// Inputs and states.
type Values = [f64; VALUES_MAX];

/// The range in which an input is tried.
fn range(name: &str) -> (f64, f64) {
    match name {
        "time_s" => (0.0, 300.0),
        "contraction" => (-0.05, 0.35),
        "contraction_rate_per_s" => (-1.0, 1.0),
        // A sensor or a reference is off by some kPa where the muscle is vented.
        "pressure_pa" | "pressure_ref_pa" => (-2e4, 6e5),
        "force_per_pressure_m2" => (1e-4, 1e-2),
        "force_n" => (-100.0, 2000.0),
        "speed_m_per_s" => (-0.5, 0.5),
        "initial_length_m" => (0.1, 1.0),
        "coulomb_friction_n" | "static_friction_n" => (0.0, 100.0),
        // It may droop below the pressure in the muscle.
        "supply_pa" => (2e5, 1e6),
        "atmospheric_absolute_pa" => (9.5e4, 1.05e5),
        "temperature_k" | "ambient_temperature_k" => (250.0, 350.0),
        "heat_transfer_w_per_m2_k" => (0.0, 500.0),
        "drawn_kg_per_s" => (-5e-3, 5e-3),
        _ => (-1.0, 1.0),
    }
}

/// Checks that the term can be simulated at the typical values and at the ends of the ranges of its
/// parameters.
///
/// # Errors
/// What was expected, and what was found where.
pub(super) fn check(
    bind: &impl Fn(&[f64]) -> OwnTerm,
    parameters: &[Parameter],
    place: &Place,
    names: &[&str],
) -> Result<(), String> {
    let typical: Vec<f64> = parameters.iter().map(|own| own.typical).collect();
    let lines = lines(&bind(&typical), names);
    no_jump(&bind(&typical), place, &lines, names)?;
    let mut tried = vec![(typical.clone(), String::from("at typical values"))];
    for (index, own) in parameters.iter().enumerate() {
        for end in [own.min, own.max] {
            let mut values = typical.clone();
            values[index] = end;
            tried.push((values, format!("with {} = {}", own.name, shown(end))));
        }
    }
    for (values, which) in &tried {
        resolved(&bind(values), &lines, names).map_err(|why| format!("{why} {which}"))?;
    }
    readable(&bind(&typical), place, &lines)?;
    let neutral = parameters
        .iter()
        .map(|own| own.neutral.unwrap_or(own.typical));
    let neutral: Vec<f64> = neutral.collect();
    // What a state adds depends on how it came about.
    if neutral != typical && bind(&typical).states.is_empty() {
        vanishes(&bind(&neutral), &bind(&typical), &lines)?;
    }
    Ok(())
}

/// Pairs of points in the range of inputs and states, with the same direction of motion.
fn lines(term: &OwnTerm, names: &[&str]) -> Vec<[Values; 2]> {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let first = VALUES_MAX - term.states.len();
    let mut point = |direction: f64| -> Values {
        std::array::from_fn(|index| {
            let (low, high) = match index.checked_sub(first) {
                Some(state) => (
                    -2.0 * term.states[state].typical,
                    2.0 * term.states[state].typical,
                ),
                None => range(names[index]),
            };
            match names[index] {
                "direction" => direction,
                // Half of them at an end or at 0, where roots, logarithms and quotients end.
                _ => match random.random_range(0..6) {
                    0 => low,
                    1 => high,
                    2 => 0.0_f64.clamp(low, high),
                    _ => random.random_range(low..=high),
                },
            }
        })
    };
    let direction = |line: usize| if line.is_multiple_of(2) { 1.0 } else { -1.0 };
    (0..LINES)
        .map(|line| [point(direction(line)), point(direction(line))])
        .collect()
}

fn between([a, b]: &[Values; 2], share: f64) -> Values {
    std::array::from_fn(|index| a[index] + share * (b[index] - a[index]))
}

/// The expressions that the plant's equations contain.
fn in_equations<'a>(term: &'a OwnTerm, place: &Place) -> impl Iterator<Item = &'a Expression> {
    // A reading goes into no equation.
    let is_reading = place.adds == SENSOR.adds;
    let adds = term.adds.iter().flatten().filter(move |_| !is_reading);
    let rates = term.states.iter().filter_map(|own| match &own.change {
        Change::Rate(rate, _) => Some(rate),
        Change::Update(_) => None,
    });
    adds.chain(rates)
}

fn no_jump(
    term: &OwnTerm,
    place: &Place,
    lines: &[[Values; 2]],
    names: &[&str],
) -> Result<(), String> {
    for expression in in_equations(term, place) {
        let size = lines
            .iter()
            .flatten()
            .map(|values| expression.value(values).abs());
        let size = size.fold(0.0, f64::max);
        for line in lines {
            let value = |share: f64| expression.value(&between(line, share));
            for step in 0..POINTS {
                let mut low = step as f64 / POINTS as f64;
                let mut high = (step + 1) as f64 / POINTS as f64;
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + high);
                    let of_low = (value(middle) - value(low)).abs();
                    if of_low > (value(high) - value(middle)).abs() {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                if (value(high) - value(low)).abs() > JUMP * size {
                    return Err(format!(
                        "expressions without jumps but at reversals (`direction`), found one at \
                         {}: the integrator would not know when it comes; a steep `tanh` is none",
                        at(&between(line, high), names)
                    ));
                }
            }
        }
    }
    Ok(())
}

/// The inputs of a point, in words.
fn at(values: &Values, names: &[&str]) -> String {
    let named = names
        .iter()
        .zip(values)
        .filter(|(name, _)| !name.is_empty());
    let shown =
        named.map(|(name, value)| format!("{name} = {}", crate::error::significant(*value)));
    shown.collect::<Vec<_>>().join(", ")
}

/// Checks that all numbers are finite and that the states are not too fast.
fn resolved(term: &OwnTerm, lines: &[[Values; 2]], names: &[&str]) -> Result<(), String> {
    let first = VALUES_MAX - term.states.len();
    for values in lines.iter().flatten() {
        let changes = term.states.iter().map(|own| match &own.change {
            Change::Rate(to, _) | Change::Update(to) => to,
        });
        let steady = term.states.iter().map(|own| &own.steady);
        let all = term.adds.iter().flatten().chain(changes).chain(steady);
        if let Some(wrong) = all
            .map(|all| all.value(values))
            .find(|value| !value.is_finite())
        {
            return Err(format!(
                "finite numbers, found {wrong} at {},",
                at(values, names)
            ));
        }
        let states = term.states.iter().zip(&values[first..]);
        let states: Vec<f64> = states.map(|(own, value)| value / own.typical).collect();
        let fastest_s = 1.0 / term.fastest_per_s(&Given(values[0], *values), &states);
        if fastest_s < SHORTEST_S {
            return Err(format!(
                "states with time constants of at least {SHORTEST_S:e} s, found {fastest_s:.1e} s"
            ));
        }
    }
    Ok(())
}

/// Checks that a reading can be turned into what was read: it changes by less than its input does.
fn readable(term: &OwnTerm, place: &Place, lines: &[[Values; 2]]) -> Result<(), String> {
    if place.adds != SENSOR.adds {
        return Ok(());
    }
    for (added, (name, _)) in term.adds.iter().zip(place.adds) {
        let input = place.inputs.iter().position(|(input, _)| input == name);
        let (Some(added), Some(input)) = (added, input) else {
            continue;
        };
        for values in lines.iter().flatten() {
            let step = 1e-6 * range(name).1;
            let mut moved = *values;
            moved[input] += step;
            let slope = (added.value(&moved) - added.value(values)) / step;
            if slope.abs() >= 1.0 {
                return Err(format!(
                    "a change of {name} that grows by less than {name} itself, found {slope:.2} \
                     times: the reading could not be inverted (an algebraic loop)"
                ));
            }
        }
    }
    Ok(())
}

/// Checks that nothing is added at the neutral values.
fn vanishes(neutral: &OwnTerm, typical: &OwnTerm, lines: &[[Values; 2]]) -> Result<(), String> {
    for (neutral, typical) in neutral.adds.iter().zip(&typical.adds) {
        let (Some(neutral), Some(typical)) = (neutral, typical) else {
            continue;
        };
        let largest = |expression: &Expression| {
            let values = lines
                .iter()
                .flatten()
                .map(|values| expression.value(values).abs());
            values.fold(0.0, f64::max)
        };
        let (left, size) = (largest(neutral), largest(typical));
        if left > 1e-9 * size {
            return Err(format!(
                "nothing to be added where all parameters are `neutral`, found {left:.2e}"
            ));
        }
    }
    Ok(())
}
