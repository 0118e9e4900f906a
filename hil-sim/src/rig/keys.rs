//! The keys of a rig file that hold a number: one table that reading, error messages, calibration
//! and tests use.

use super::Rig;
use model_core::muscle::Volume;
use muscle_plant::nominal::{Gas, Load, Valve, Weight};

/// Masses that a muscle may carry \[kg\].
pub const MASS_KG: std::ops::RangeInclusive<f64> = 1e-3..=1e5;

/// How well a nominal value is known if it was not calibrated on the rig.
#[derive(Clone, Copy, Debug)]
pub struct DefaultTolerance {
    /// Relative standard deviation \[-\].
    pub relative_sigma: f64,
    /// Where the standard deviation comes from.
    pub source: &'static str,
}

/// One key of a rig file that holds a number.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Section of the file.
    pub section: &'static str,
    /// Name of the key in its section.
    pub name: &'static str,
    /// SI unit; `-` for a ratio.
    pub unit: &'static str,
    /// Smallest value that is physically possible.
    pub min: f64,
    /// Largest value that is physically possible.
    pub max: f64,
    /// Why the range ends there. A value outside means that the file is wrong.
    pub source: &'static str,
    /// Tolerance of a value that was not calibrated; `None` if the diagnosis does not use the key.
    pub tolerance: Option<DefaultTolerance>,
    /// The value in a rig; `None` if the rig lacks the part that the key belongs to.
    pub value: fn(&mut Rig) -> Option<&mut f64>,
}

macro_rules! keys {
    ($($section:ident.$name:ident, $unit:expr, $min:expr, $max:expr, $source:expr
       $(; tolerance $sigma:expr, $why:expr)? => $value:expr;)*) => {
        &[$(Key {
            section: stringify!($section),
            name: stringify!($name),
            unit: $unit,
            min: $min,
            max: $max,
            source: $source,
            tolerance: keys!(@tolerance $($sigma, $why)?),
            value: $value,
        }),*]
    };
    (@tolerance) => { None };
    (@tolerance $sigma:expr, $why:expr) => {
        Some(DefaultTolerance { relative_sigma: $sigma, source: $why })
    };
}

/// Every key that holds a number, in the order of the file.
pub const KEYS: &[Key] = keys! {
    muscle.alpha_m2, "m²", 1e-9, 10.0, "diameters D of 10 µm to 1 m: 11 D² at a braid angle of 25°";
        tolerance 0.05, "braid angle θ known to 0.5° at 25°: 2 Δθ / (sin θ cos θ)"
        => |rig| Some(&mut rig.nominal.muscle.alpha_m2);
    muscle.beta_m2, "m²", -10.0, 10.0, "magnitudes as of alpha_m2";
        tolerance 0.04, "braid angle θ known to 0.5° at 25°: 2 Δθ / tan θ"
        => |rig| Some(&mut rig.nominal.muscle.beta_m2);
    muscle.gamma_n, "N", -1e5, 1e5, "weight of 10 t, as of coulomb_friction_n";
        tolerance 0.1, "rubber of ±5 Shore A: modulus within ±20 %, taken as two sigma"
        => |rig| Some(&mut rig.nominal.muscle.gamma_n);
    muscle.volume_d1_m3, "m³", -10.0, 10.0, "magnitudes as of volume_d3_m3";
        tolerance 0.05, "diameter measured to 2.5 %, squared"
        => |rig| Some(&mut volume(rig)?.d1_m3);
    muscle.volume_d2_m3, "m³", -10.0, 10.0, "magnitudes as of volume_d3_m3";
        tolerance 0.05, "diameter measured to 2.5 %, squared"
        => |rig| Some(&mut volume(rig)?.d2_m3);
    muscle.volume_d3_m3, "m³", 1e-12, 10.0, "0.001 mm³ to 10 m³";
        tolerance 0.05, "diameter measured to 2.5 %, squared"
        => |rig| Some(&mut volume(rig)?.d3_m3);
    muscle.initial_length_m, "m", 1e-3, 100.0, "1 mm to 100 m";
        tolerance 0.01, "end of the free length at the clamps known to 3 mm in 300 mm"
        => |rig| Some(&mut rig.nominal.muscle.initial_length_m);
    load.mass_kg, "kg", *MASS_KG.start(), *MASS_KG.end(), "1 g to 100 t";
        tolerance 0.005, "workshop scale: 50 g in 10 kg"
        => |rig| Some(&mut weight(rig)?.mass_kg);
    load.viscous_damping_ns_per_m, "N·s/m", 0.0, 1e6, "0: none; to the weight of 100 t at 1 m/s";
        tolerance 0.3, "decay of a free oscillation, to which Coulomb friction contributes"
        => |rig| Some(&mut weight(rig)?.viscous_damping_ns_per_m);
    load.coulomb_friction_n, "N", 0.0, 1e5, "0: none; to the weight of 10 t";
        tolerance 0.2, "varies with lubrication and side load of the guide"
        => |rig| Some(&mut weight(rig)?.coulomb_friction_n);
    load.static_friction_n, "N", 0.0, 1e5, "as of coulomb_friction_n";
        tolerance 0.2, "varies with lubrication and side load of the guide"
        => |rig| Some(&mut weight(rig)?.static_friction_n);
    valve.flow_gain_kg_per_pa_s, "kg/(Pa·s)", 1e-14, 1e-3, "1e-9 to 100 kg/s at 1 bar";
        tolerance 0.1, "nominal flow rate of a catalogue"
        => |rig| Some(&mut valve(rig)?.flow_gain_kg_per_pa_s);
    valve.supply_pressure_pa, "Pa", 1.0, 1e8, "1 Pa to 1000 bar";
        tolerance 0.016, "gauge of class 1.6 (EN 837-1) at half scale: 3.2 %, taken as two sigma"
        => |rig| Some(&mut valve(rig)?.supply_pressure.0);
    gas.ambient_temperature_k, "K", 150.0, 500.0, "air is an ideal gas, and rubber does not melt";
        tolerance 0.01, "room temperature over a day: 3 K in 293 K"
        => |rig| Some(&mut gas(rig)?.ambient_temperature_k);
    gas.atmospheric_pressure_pa, "Pa", 1e3, 1e6, "30 km of altitude to a chamber of 10 bar";
        tolerance 0.01, "weather: 1 kPa at a known altitude"
        => |rig| Some(&mut gas(rig)?.atmospheric_pressure.0);
    gas.heat_transfer_charging_w_per_m2_k, "W/(m²·K)", 0.0, 1e6, "0: adiabatic; forced convection";
        tolerance 0.3, "correlations of convection in pipes are off by up to 25 %, here by more"
        => |rig| Some(&mut gas(rig)?.heat_transfer_charging_w_per_m2_k);
    gas.heat_transfer_discharging_w_per_m2_k, "W/(m²·K)", 0.0, 1e6, "as while charging";
        tolerance 0.3, "as while charging"
        => |rig| Some(&mut gas(rig)?.heat_transfer_discharging_w_per_m2_k);
    assist.gain, "-", 0.0, 1e4, "0: no assist; to 10 kN for 1 N"
        => |rig| Some(&mut rig.assist.as_mut()?.gain);
    assist.input_stiffness_n_per_m, "N/m", 1e-3, 1e6, "1 mN/m to a rigid lever, 1 N/µm"
        => |rig| Some(&mut rig.assist.as_mut()?.input_stiffness_n_per_m);
    assist.lever_length_m, "m", 1e-3, 100.0, "as of initial_length_m"
        => |rig| Some(&mut rig.assist.as_mut()?.lever_length_m);
    assist.pulley_diameter_m, "m", 1e-3, 100.0, "as of initial_length_m"
        => |rig| Some(&mut rig.assist.as_mut()?.pulley_diameter_m);
};

/// The keys of `rig` whose values have a tolerance if they were not calibrated.
pub fn uncalibrated(rig: &Rig) -> impl Iterator<Item = (&'static Key, DefaultTolerance)> {
    let mut rig = rig.clone();
    let keys = KEYS
        .iter()
        .filter(move |key| (key.value)(&mut rig).is_some());
    keys.filter_map(|key| Some((key, key.tolerance?)))
}

/// Tables of the tolerances that the values of `rig` have if they were not calibrated, each with
/// its reason.
pub fn default_tolerances(rig: &Rig) -> String {
    let mut text = String::from(
        "# How well the values are known that were not calibrated on this rig: relative standard\n\
         # deviations. A value not listed is exact.\n",
    );
    let mut section = "";
    for (key, tolerance) in uncalibrated(rig) {
        if key.section != section {
            let between = if section.is_empty() { "" } else { "\n" };
            section = key.section;
            text += &format!("{between}[tolerance.{section}]\n");
        }
        let line = format!("{} = {}", key.name, tolerance.relative_sigma);
        text += &format!("{line:<31} # {}\n", tolerance.source);
    }
    text
}

fn volume(rig: &mut Rig) -> Option<&mut Volume<f64>> {
    rig.nominal.volume.as_mut()
}

fn weight(rig: &mut Rig) -> Option<&mut Weight> {
    match &mut rig.nominal.load {
        Load::Weight(weight) => Some(weight),
        Load::Prescribed => None,
    }
}

fn valve(rig: &mut Rig) -> Option<&mut Valve> {
    rig.nominal.valve.as_mut()
}

fn gas(rig: &mut Rig) -> Option<&mut Gas> {
    rig.nominal.gas.as_mut()
}

/// The keys of `section`, in the order of the file.
pub(super) fn of_section(section: &str) -> impl Iterator<Item = &'static Key> {
    KEYS.iter().filter(move |key| key.section == section)
}

/// The sections that have a key of which `wanted` is true, each once.
pub(super) fn sections(wanted: fn(&Key) -> bool) -> Vec<&'static str> {
    let mut sections: Vec<_> = KEYS
        .iter()
        .filter(|key| wanted(key))
        .map(|key| key.section)
        .collect();
    sections.dedup();
    sections
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::shown;

    /// What `hil-sim rig new` writes has a tolerance for each value that may have one.
    #[test]
    fn the_template_lists_all_default_tolerances() {
        let rig = Rig::parse("rig.toml", &Rig::template()).expect("a rig");
        let listed = rig.tolerances.iter();
        let listed = listed.map(|own| (&own.section[..], &own.key[..], own.relative_sigma));
        let all = KEYS
            .iter()
            .filter_map(|key| Some((key.section, key.name, key.tolerance?.relative_sigma)));
        assert!(listed.eq(all));
    }

    #[test]
    fn default_tolerances_are_ratios_with_a_source() {
        for key in KEYS {
            let name = (key.section, key.name);
            assert!(!key.source.is_empty() && key.min < key.max, "{name:?}");
            // The diagnosis calibrates the plant, which does not include the lever.
            assert_eq!(key.tolerance.is_none(), key.section == "assist", "{name:?}");
            if let Some(tolerance) = key.tolerance {
                let sigma = tolerance.relative_sigma;
                assert!(sigma > 0.0 && sigma <= 1.0, "{name:?}");
                assert!(!tolerance.source.is_empty(), "{name:?}");
            }
        }
    }

    #[test]
    fn each_key_reads_its_own_value() {
        // Each value is changed on its own, and only the value at its accessor changes.
        let mut reference = Rig::reference();
        for key in KEYS {
            let value = *(key.value)(&mut reference).expect("the reference rig is complete");
            let old = line_of_key(key, Rig::REFERENCE_TOML);
            let changed = value * 1.001;
            let text = Rig::REFERENCE_TOML.replace(&old, &format!("{} = {changed:e}", key.name));
            let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
            for other in KEYS {
                let expected = match (other.section, other.name) == (key.section, key.name) {
                    true => changed,
                    false => *(other.value)(&mut reference).expect("a value"),
                };
                assert_eq!(
                    (other.value)(&mut rig),
                    Some(&mut { expected }),
                    "{}",
                    key.name
                );
            }
        }
    }

    #[test]
    fn values_outside_their_range_are_refused() {
        for key in KEYS {
            let old = line_of_key(key, Rig::REFERENCE_TOML);
            let wrong = [
                key.min - key.min.abs().max(1.0),
                2.0 * key.max,
                f64::INFINITY,
            ];
            for value in wrong {
                let new = format!("{} = {value:?}", key.name);
                let text = Rig::REFERENCE_TOML.replace(&old, &new);
                let error = Rig::parse("rig.toml", &text).expect_err("a value out of range");
                let place = format!("key `{}.{}`", key.section, key.name);
                assert_eq!(error.place, Some(place));
                let (min, max) = (shown(key.min), shown(key.max));
                let range = format!("a number from {min} to {max}, found");
                assert!(error.expected.starts_with(&range), "{error}");
            }
        }
    }

    /// `name = value` as it stands in `text`.
    fn line_of_key(key: &Key, text: &str) -> String {
        let start = format!("{} = ", key.name);
        let line = text.lines().find(|line| line.starts_with(&start));
        let line = line.expect("the key");
        line.split('#').next().unwrap_or(line).trim_end().into()
    }
}
