//! Values of a rig that cannot be in the units that their names say.

use super::{Key, Rig};
use crate::error::{BadInput, shown};
use crate::plausible::{
    ATMOSPHERE_PA, DIAMETER_M, LENGTH_M, LEVER_M_MAX, PRESSURE_IDLE_PA, PRESSURE_TYPICAL_PA,
    PRESSURE_UNITS, SONIC_FLOW_KG_PER_PA_S_M2, TOLERANCE_MAX, VOLUME_RATIO, nearest,
};
use model_core::constants::GRAVITY_M_PER_S2;
use muscle_plant::nominal::Load;

/// The freezing point of water \[K\].
const CELSIUS_K: f64 = 273.15;
/// The standard atmosphere \[Pa\].
const STANDARD_PA: f64 = 101_325.0;
/// Most muscles and levers are as long within a factor of five \[m\].
const LENGTH_TYPICAL_M: f64 = 0.3;
/// So are areas and volumes of muscles of 5 to 60 mm within factors of 50: about those of one of
/// 20 mm, α = 11 D² \[m²\] and 0.3 m × π D²/4 \[m³\].
const AREA_TYPICAL_M2: f64 = 4.4e-3;
const VOLUME_TYPICAL_M3: f64 = 1e-4;
/// Units of the trade by the SI unit in a key's name.
const UNITS: [(&str, &[(&str, f64)]); 6] = [
    ("Pa", &PRESSURE_UNITS),
    ("m", &[("cm", 1e-2), ("mm", 1e-3)]),
    ("m²", &[("cm²", 1e-4), ("mm²", 1e-6)]),
    ("m³", &[("cm³", 1e-6), ("l", 1e-3), ("mm³", 1e-9)]),
    ("kg", &[("g", 1e-3)]),
    ("kg/(Pa·s)", &[("kg/(bar·s)", 1e-5), ("kg/(kPa·s)", 1e-3)]),
];

/// The end of a message on a `value` outside the range of `key`: the unit of the trade in which it
/// would be within, if there is one.
pub(super) fn likely_unit(key: &Key, value: f64) -> String {
    let within = |value: f64| (key.min..=key.max).contains(&value);
    if key.unit == "K" {
        let kelvin = value + CELSIUS_K;
        let likely = within(kelvin).then(|| most_likely("°C", kelvin));
        return likely.unwrap_or_default();
    }
    let units = units_of(key.unit);
    // The largest unit that fits, unless the usual size is known.
    let usual = match key.unit {
        "Pa" if key.name == "atmospheric_pressure_pa" => STANDARD_PA / value,
        "Pa" => PRESSURE_TYPICAL_PA / value,
        "m" => LENGTH_TYPICAL_M / value,
        "m²" => AREA_TYPICAL_M2 / value,
        "m³" => VOLUME_TYPICAL_M3 / value,
        _ => f64::MAX,
    };
    nearest(units, usual, |size| within(value * size))
        .map_or_else(String::new, |(unit, size)| most_likely(unit, value * size))
}

/// The units of the trade in place of an SI unit.
fn units_of(si: &str) -> &'static [(&'static str, f64)] {
    let units = UNITS.iter().find(|(unit, _)| *unit == si);
    units.map_or(&[], |(_, units)| *units)
}

fn most_likely(unit: &str, value: f64) -> String {
    // Without the rounding errors of the conversion.
    let digits = format!("{value:.9e}").parse().unwrap_or(value);
    format!(", most likely {unit}: write {}", shown(digits))
}

impl Rig {
    /// Refuses values that cannot be in the units that their names say: a supply that cannot lift
    /// the weight, a volume that is none of the muscle's, a tolerance in percent.
    ///
    /// # Errors
    /// There are such values.
    pub fn check_units(&self) -> Result<(), BadInput> {
        let pressures = [self.supply_unit(), self.atmosphere_unit()];
        let is_supplied = pressures[0].is_none();
        let found = pressures.into_iter().chain([
            self.volume_unit(),
            self.braid_sign(),
            self.rubber_sign().filter(|_| is_supplied),
            self.weight_unit().filter(|_| is_supplied),
            self.flow_unit().filter(|_| is_supplied),
            self.lever_unit(),
            self.tolerance_unit(),
        ]);
        match found.flatten().reduce(BadInput::and) {
            None => Ok(()),
            Some(mut error) => {
                error.expected += "; --accept takes the rig as it is";
                Err(error)
            }
        }
    }

    fn weight_n(&self) -> Option<f64> {
        match self.nominal.load {
            Load::Weight(weight) => Some(weight.mass_kg * GRAVITY_M_PER_S2),
            Load::Prescribed => None,
        }
    }

    /// The muscle's force at rest length with `pressure_pa`.
    fn rest_force_n(&self, pressure_pa: f64) -> f64 {
        let muscle = self.nominal.muscle;
        (muscle.alpha_m2 + muscle.beta_m2) * pressure_pa + muscle.gamma_n
    }

    /// A supply in bar, kPa, psi or MPa.
    fn supply_unit(&self) -> Option<BadInput> {
        let supply_pa = self.nominal.valve?.supply_pressure.0;
        if supply_pa > PRESSURE_IDLE_PA {
            return None;
        }
        let least_n = self.weight_n().unwrap_or(0.0);
        let carries = |size: f64| self.rest_force_n(size * supply_pa) > least_n;
        let unit = nearest(&PRESSURE_UNITS, PRESSURE_TYPICAL_PA / supply_pa, carries);
        let likely = unit.map_or_else(String::new, |(unit, size)| {
            most_likely(unit, size * supply_pa)
        });
        let force_n = self.rest_force_n(supply_pa);
        let expected = format!(
            "a gauge pressure in Pa with which the muscle pulls, found {supply_pa} with \
             {force_n:.1} N at rest length{likely}"
        );
        Some(self.bad("valve.supply_pressure_pa", &expected))
    }

    /// An atmosphere in hPa.
    fn atmosphere_unit(&self) -> Option<BadInput> {
        let found_pa = self.nominal.gas?.atmospheric_pressure.0;
        let [min, max] = ATMOSPHERE_PA;
        if (min..=max).contains(&found_pa) {
            return None;
        }
        let likely = match (min..=max).contains(&(100.0 * found_pa)) {
            true => most_likely("hPa", 100.0 * found_pa),
            false => String::new(),
        };
        let expected = format!(
            "an absolute pressure in Pa that people live at, {min:e} to {max:e}, found \
             {found_pa}{likely}"
        );
        Some(self.bad("gas.atmospheric_pressure_pa", &expected))
    }

    /// Length, volume or areas in other units: V₀ ∝ L α.
    fn volume_unit(&self) -> Option<BadInput> {
        let muscle = self.nominal.muscle;
        let volume_m3 = self.nominal.volume?.d3_m3;
        let (length_m, alpha_m2) = (muscle.initial_length_m, muscle.alpha_m2);
        let fits = |volume_m3: f64, length_m: f64, alpha_m2: f64| {
            let diameter_m = (volume_m3 / length_m * 4.0 / std::f64::consts::PI).sqrt();
            let within = |[min, max]: [f64; 2], value: f64| (min..=max).contains(&value);
            within(VOLUME_RATIO, volume_m3 / (length_m * alpha_m2))
                && within(LENGTH_M, length_m)
                && within(DIAMETER_M, diameter_m)
        };
        let ratio = volume_m3 / (length_m * alpha_m2);
        if (VOLUME_RATIO[0]..=VOLUME_RATIO[1]).contains(&ratio) {
            return None;
        }
        let units = |si| units_of(si).iter();
        let lengths = units("m").map(|(unit, size)| {
            let value = size * length_m;
            (
                "initial_length_m",
                *unit,
                value,
                fits(volume_m3, value, alpha_m2),
            )
        });
        let volumes = units("m³").map(|(unit, size)| {
            let value = size * volume_m3;
            (
                "volume_d3_m3",
                *unit,
                value,
                fits(value, length_m, alpha_m2),
            )
        });
        let areas = units("m²").map(|(unit, size)| {
            let value = size * alpha_m2;
            ("alpha_m2", *unit, value, fits(volume_m3, length_m, value))
        });
        let mut candidates = lengths.chain(areas).chain(volumes);
        let (key, likely) = candidates.find(|(.., fits)| *fits).map_or_else(
            || ("volume_d3_m3", String::new()),
            |(key, unit, value, _)| (key, most_likely(unit, value)),
        );
        let [min, max] = VOLUME_RATIO;
        let expected = format!(
            "a volume, length and alpha_m2 of one braided muscle (volume_d3_m3 from {min:.1e} to \
             {max:.1} times initial_length_m × alpha_m2), found {ratio:.2e} times{likely}"
        );
        Some(self.bad(&format!("muscle.{key}"), &expected))
    }

    /// The sign of β: the pressure on a braided muscle's end pushes.
    fn braid_sign(&self) -> Option<BadInput> {
        let beta_m2 = self.nominal.muscle.beta_m2;
        if beta_m2 <= 0.0 {
            return None;
        }
        let expected = format!(
            "a negative area: a braid at an angle θ has beta_m2 = -π D²/(4 sin² θ), found \
             {}, most likely of the other sign",
            shown(beta_m2)
        );
        Some(self.bad("muscle.beta_m2", &expected))
    }

    /// The sign of γ: a vented muscle that lifts its weight.
    fn rubber_sign(&self) -> Option<BadInput> {
        let (gamma_n, weight_n) = (self.nominal.muscle.gamma_n, self.weight_n()?);
        if gamma_n <= weight_n {
            return None;
        }
        let expected = format!(
            "less than the weight of {weight_n:.1} N, which no muscle without pressure lifts, \
             found {}, most likely of the other sign",
            shown(gamma_n)
        );
        Some(self.bad("muscle.gamma_n", &expected))
    }

    /// A mass in grams, or a weight that the muscle cannot lift.
    fn weight_unit(&self) -> Option<BadInput> {
        let weight_n = self.weight_n()?;
        let supply_pa = self.nominal.valve?.supply_pressure.0;
        let force_n = self.rest_force_n(supply_pa);
        if force_n > weight_n {
            return None;
        }
        let mass_kg = weight_n / GRAVITY_M_PER_S2;
        // In grams it would be a load for which one takes such a muscle.
        let likely = match (0.01 * force_n..force_n).contains(&(1e-3 * weight_n)) {
            true => most_likely("g", 1e-3 * mass_kg),
            false => String::new(),
        };
        let expected = format!(
            "a weight that the muscle lifts, {force_n:.1} N at rest length with the supply's \
             {supply_pa} Pa, found {weight_n:.1} N{likely}"
        );
        Some(self.bad("load.mass_kg", &expected))
    }

    /// A flow gain for each kPa or bar: more than flows through a hole as wide as the muscle.
    fn flow_unit(&self) -> Option<BadInput> {
        let gain = self.nominal.valve?.flow_gain_kg_per_pa_s;
        let length_m = self.nominal.muscle.initial_length_m;
        let most = SONIC_FLOW_KG_PER_PA_S_M2 * self.nominal.volume?.d3_m3 / length_m;
        // The gain is for each pascal of the error of pressure, which may be a tenth of the
        // pressure when the valve is wide open.
        let most = 10.0 * most;
        if gain <= most {
            return None;
        }
        let units = [("kg/(kPa·s)", 1e-3), ("kg/(bar·s)", 1e-5)];
        let fitting = units.into_iter().find(|(_, size)| size * gain <= most);
        let likely =
            fitting.map_or_else(String::new, |(unit, size)| most_likely(unit, size * gain));
        let expected = format!(
            "at most ten times what flows through a hole as wide as the muscle, {most:.1e} \
             kg/(Pa·s), found {gain:e}{likely}; `hil-sim rig new --valve Q=…` converts l/min"
        );
        Some(self.bad("valve.flow_gain_kg_per_pa_s", &expected))
    }

    /// Lever and pulley in cm or mm.
    fn lever_unit(&self) -> Option<BadInput> {
        let assist = self.assist?;
        let lengths = [
            ("assist.lever_length_m", assist.lever_length_m),
            ("assist.pulley_diameter_m", assist.pulley_diameter_m),
        ];
        let (key, found_m) = lengths.into_iter().find(|(_, m)| *m > LEVER_M_MAX)?;
        let likely = most_likely("cm", 1e-2 * found_m);
        let expected = format!("at most {LEVER_M_MAX} m for one person, found {found_m}{likely}");
        Some(self.bad(key, &expected))
    }

    /// A tolerance in percent.
    fn tolerance_unit(&self) -> Option<BadInput> {
        let wide = |own: &&super::Tolerance| own.relative_sigma > TOLERANCE_MAX;
        let found = self.tolerances.iter().find(wide)?;
        let sigma = found.relative_sigma;
        let key = format!("tolerance.{}.{}", found.section, found.key);
        let likely = most_likely("percent", 0.01 * sigma);
        let expected = format!("a relative standard deviation of at most 1, found {sigma}{likely}");
        Some(self.bad(&key, &expected))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a rig is told in which `old` is `new`.
    fn told(old: &str, new: &str) -> Option<String> {
        let template = Rig::template();
        assert!(template.contains(old), "{old}");
        let text = template.replace(old, new);
        let error = match Rig::parse("rig.toml", &text) {
            Ok(rig) => rig.check_units().err()?,
            Err(error) => error,
        };
        Some(error.to_string())
    }

    /// What to write, what the message names, and what it says.
    const OTHER_UNITS: &[[&str; 3]] = &[
        ["supply_pressure_pa = 5.0", "valve.supply", "bar: write 5e5"],
        ["supply_pressure_pa = 500", "valve.supply", "kPa: write 5e5"],
        ["supply_pressure_pa = 0.5", "valve.supply", "MPa: write 5e5"],
        [
            "supply_pressure_pa = 72.5",
            "valve.supply",
            "psi: write 4.99",
        ],
        ["initial_length_m = 300", "initial_length", "mm: write 0.3"],
        ["initial_length_m = 30", "initial_length", "cm: write 0.3"],
        ["volume_d3_m3 = 2.3e-2", "volume_d3", "l: write 2.3e-5"],
        ["volume_d3_m3 = 23", "volume_d3", "cm³: write 2.3e-5"],
        ["alpha_m2 = 3771.8", "alpha", "mm²: write 0.0037718"],
        ["alpha_m2 = 37.718", "alpha", "cm²: write 0.0037718"],
        ["beta_m2 = 1.39e-3", "muscle.beta", "of the other sign"],
        ["gamma_n = 183.0", "muscle.gamma", "of the other sign"],
        ["mass_kg = 12000", "load.mass_kg", "g: write 12"],
        ["mass_kg = 150", "load.mass_kg", "found 1471.0 N;"],
        [
            "atmospheric_pressure_pa = 1013.25",
            "gas",
            "hPa: write 1.01325e5",
        ],
        [
            "atmospheric_pressure_pa = 1.013",
            "gas",
            "bar: write 1.013e5",
        ],
        [
            "atmospheric_pressure_pa = 101.325",
            "gas",
            "kPa: write 1.01325e5",
        ],
        ["ambient_temperature_k = 20", "gas", "°C: write 293.15"],
        ["pulley_diameter_m = 10", "assist.pulley", "cm: write 0.1"],
        [
            "flow_gain_kg_per_pa_s = 1.3e-4",
            "valve.flow",
            "kg/(kPa·s): write 1.3e-7",
        ],
    ];

    #[test]
    fn a_value_in_another_unit_is_named_with_the_number_to_write() {
        for [line, key, likely] in OTHER_UNITS {
            let name = line.split(" = ").next().expect("a key");
            let old = Rig::REFERENCE_TOML
                .lines()
                .find(|old| old.starts_with(name));
            let message = told(old.expect("the key"), line).expect("refused");
            assert!(
                message.contains(key) && message.contains(likely),
                "{line}: {message}"
            );
        }
        let message = told("alpha_m2 = 0.05 ", "alpha_m2 = 5 ").expect("refused");
        let likely = "tolerance.muscle.alpha_m2`: expected a relative standard deviation of at \
                      most 1, found 5, most likely percent: write 0.05";
        assert!(message.contains(likely), "{message}");
        assert_eq!(told("mass_kg = 12.0", "mass_kg = 20.0"), None);
    }
}
