//! The parameters of the rig: the nominal values that a tool gets, and the true values, which
//! differ from them within the tolerances.

use std::fmt::Write as _;

use rand::RngExt;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::Serialize;

/// Parameters of a rig, named as in `rig.toml`.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)] // the names and units are those of rig.toml
pub struct Rig {
    pub alpha_m2: f64,
    pub beta_m2: f64,
    pub gamma_n: f64,
    pub volume_d1_m3: f64,
    pub volume_d2_m3: f64,
    pub volume_d3_m3: f64,
    pub initial_length_m: f64,
    pub mass_kg: f64,
    pub viscous_damping_ns_per_m: f64,
    pub coulomb_friction_n: f64,
    pub static_friction_n: f64,
    pub flow_gain_kg_per_pa_s: f64,
    pub supply_pressure_pa: f64,
    pub ambient_temperature_k: f64,
    pub atmospheric_pressure_pa: f64,
    pub heat_transfer_charging_w_per_m2_k: f64,
    pub heat_transfer_discharging_w_per_m2_k: f64,
}

impl Default for Rig {
    /// The paper's rig with the numbers that reproduce its figures.
    fn default() -> Self {
        Self {
            alpha_m2: 3.7718e-3,
            beta_m2: -1.39e-3,
            gamma_n: -183.0,
            volume_d1_m3: -9.90e-4,
            volume_d2_m3: 7.005e-4,
            volume_d3_m3: 2.30e-5,
            initial_length_m: 0.3,
            mass_kg: 12.0,
            viscous_damping_ns_per_m: 45.0,
            coulomb_friction_n: 4.5,
            static_friction_n: 7.0,
            flow_gain_kg_per_pa_s: 1.3e-7,
            supply_pressure_pa: 5.0e5,
            ambient_temperature_k: 293.0,
            atmospheric_pressure_pa: 101_325.0,
            heat_transfer_charging_w_per_m2_k: 120.0,
            heat_transfer_discharging_w_per_m2_k: 80.0,
        }
    }
}

/// A nominal value known only to a relative one-sigma.
struct Tolerance {
    section: &'static str,
    key: &'static str,
    relative: f64,
}

/// A nominal rig, its tolerances, and the true rig behind it.
pub(crate) struct Pair {
    pub(crate) nominal: Rig,
    pub(crate) actual: Rig,
    tolerances: Vec<Tolerance>,
}

/// The paper's lever and gain. No simulated record depends on it; `compensate` and the settings of
/// a board do.
const ASSIST: &str = "\n[assist]\ngain = 20.0\ninput_stiffness_n_per_m = 200.0\n\
                      lever_length_m = 0.3\npulley_diameter_m = 0.1\n";

/// Rounded to `digits` significant digits, so that the text of `rig.toml` is the exact value.
pub(crate) fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1)
        .parse()
        .expect("a formatted float parses")
}

/// A nominal rig: the paper's muscle scaled in section, with another load and valve.
fn nominal(rng: &mut Pcg64) -> Rig {
    let mut rig = Rig::default();
    let section = rng.random_range(0.85..1.2);
    for value in [
        &mut rig.alpha_m2,
        &mut rig.beta_m2,
        &mut rig.gamma_n,
        &mut rig.volume_d1_m3,
        &mut rig.volume_d2_m3,
        &mut rig.volume_d3_m3,
        &mut rig.mass_kg,
    ] {
        *value = rounded(*value * section, 4);
    }
    rig.mass_kg = rounded(rig.mass_kg * rng.random_range(0.8..1.25), 3);
    let fast: f64 = rng.random_range(0.0..1.0);
    rig.flow_gain_kg_per_pa_s = rounded(3.0e-8 * (1.5e-7_f64 / 3.0e-8).powf(fast), 3);
    rig.viscous_damping_ns_per_m = rounded(rng.random_range(35.0..70.0), 2);
    rig.ambient_temperature_k = rounded(rng.random_range(288.0..299.0), 4);
    rig
}

fn tolerances(rng: &mut Pcg64) -> Vec<Tolerance> {
    // section, key, least and greatest relative one-sigma, how often the key has a tolerance
    const RANGES: [(&str, &str, f64, f64, f64); 9] = [
        ("muscle", "alpha_m2", 0.005, 0.02, 1.0),
        ("muscle", "beta_m2", 0.005, 0.02, 0.7),
        ("muscle", "gamma_n", 0.01, 0.03, 0.9),
        ("load", "viscous_damping_ns_per_m", 0.03, 0.15, 1.0),
        ("load", "coulomb_friction_n", 0.03, 0.1, 1.0),
        ("load", "static_friction_n", 0.03, 0.1, 1.0),
        ("valve", "flow_gain_kg_per_pa_s", 0.01, 0.05, 1.0),
        ("gas", "heat_transfer_charging_w_per_m2_k", 0.05, 0.2, 0.5),
        (
            "gas",
            "heat_transfer_discharging_w_per_m2_k",
            0.05,
            0.2,
            0.5,
        ),
    ];
    let mut kept = Vec::new();
    for (section, key, least, greatest, often) in RANGES {
        let relative = rounded(rng.random_range(least..greatest), 2);
        if rng.random_bool(often) {
            kept.push(Tolerance {
                section,
                key,
                relative,
            });
        }
    }
    kept
}

impl Pair {
    /// A nominal rig and a true one, each toleranced value off by a draw of its tolerance.
    pub(crate) fn draw(rng: &mut Pcg64) -> Self {
        Self::around(nominal(rng), rng)
    }

    /// A true rig around a nominal one.
    pub(crate) fn around(nominal: Rig, rng: &mut Pcg64) -> Self {
        let tolerances = tolerances(rng);
        let mut actual = nominal.clone();
        for tolerance in &tolerances {
            let normal: f64 = StandardNormal.sample(rng);
            // beyond 2.5 sigma a value would be called out of tolerance by its maker
            let off = 1.0 + tolerance.relative * normal.clamp(-2.5, 2.5);
            *actual.value_mut(tolerance.key) *= off;
        }
        actual.static_friction_n = actual.static_friction_n.max(actual.coulomb_friction_n);
        Self {
            nominal,
            actual,
            tolerances,
        }
    }

    /// The text of `rig.toml`: the nominal rig and its tolerances.
    pub(crate) fn toml(&self) -> String {
        let mut text = self.nominal.toml();
        let mut section = "";
        for tolerance in &self.tolerances {
            if tolerance.section != section {
                section = tolerance.section;
                let _ = writeln!(text, "\n[tolerance.{section}]");
            }
            let _ = writeln!(text, "{} = {:?}", tolerance.key, tolerance.relative);
        }
        text
    }
}

impl Rig {
    fn value_mut(&mut self, key: &str) -> &mut f64 {
        match key {
            "alpha_m2" => &mut self.alpha_m2,
            "beta_m2" => &mut self.beta_m2,
            "gamma_n" => &mut self.gamma_n,
            "viscous_damping_ns_per_m" => &mut self.viscous_damping_ns_per_m,
            "coulomb_friction_n" => &mut self.coulomb_friction_n,
            "static_friction_n" => &mut self.static_friction_n,
            "flow_gain_kg_per_pa_s" => &mut self.flow_gain_kg_per_pa_s,
            "heat_transfer_charging_w_per_m2_k" => &mut self.heat_transfer_charging_w_per_m2_k,
            "heat_transfer_discharging_w_per_m2_k" => {
                &mut self.heat_transfer_discharging_w_per_m2_k
            }
            _ => unreachable!("no tolerance on {key}"),
        }
    }

    fn toml(&self) -> String {
        let mut text = String::from("schema = 1\n\n[muscle]\n");
        let mut put = |line: &str, value: f64| {
            let _ = writeln!(text, "{line} = {value:?}");
        };
        put("alpha_m2", self.alpha_m2);
        put("beta_m2", self.beta_m2);
        put("gamma_n", self.gamma_n);
        put("volume_d1_m3", self.volume_d1_m3);
        put("volume_d2_m3", self.volume_d2_m3);
        put("volume_d3_m3", self.volume_d3_m3);
        put("initial_length_m", self.initial_length_m);
        put("\n[load]\nkind = \"weight\"\nmass_kg", self.mass_kg);
        put("viscous_damping_ns_per_m", self.viscous_damping_ns_per_m);
        put("coulomb_friction_n", self.coulomb_friction_n);
        put("static_friction_n", self.static_friction_n);
        put(
            "\n[valve]\nflow_gain_kg_per_pa_s",
            self.flow_gain_kg_per_pa_s,
        );
        put("supply_pressure_pa", self.supply_pressure_pa);
        put("\n[gas]\nambient_temperature_k", self.ambient_temperature_k);
        put("atmospheric_pressure_pa", self.atmospheric_pressure_pa);
        put(
            "heat_transfer_charging_w_per_m2_k",
            self.heat_transfer_charging_w_per_m2_k,
        );
        put(
            "heat_transfer_discharging_w_per_m2_k",
            self.heat_transfer_discharging_w_per_m2_k,
        );
        text += ASSIST;
        text
    }
}
