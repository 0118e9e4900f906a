//! Design of the circuit: the plant linearised at an equilibrium (Eqs 10 and 11), the required flow
//! gain of the valve, and the permitted stiffness of the input.
//!
//! If F lags F_c, "human feels strange". To avoid this, the paper requires that the pressure
//! control (G, bandwidth ω₁) is faster than the weight on the stiffness of the muscle (H, ω₂).

pub mod bode;
pub mod report;

use crate::error::BadInput;
use crate::rig::Rig;
use model_core::assist::Assist;
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;
use muscle_plant::nominal::{Load, Weight};
use muscle_plant::simulation::{CONTRACTION, Drive, NOMINAL_STATES, Regime, Simulated};
use muscle_plant::subsystem::gas::{GAS_CONSTANT_J_PER_KG_K, HEAT_RATIO};
use muscle_plant::subsystem::load::{GRAVITY_M_PER_S2, Motion};
use nalgebra::{Complex, Matrix4, SMatrix, Schur, Vector4};
use serde::Serialize;

/// Linearisation of the circuit at an equilibrium with a freely hanging weight and without
/// friction: the quantities of Eqs 10 and 11.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Linearisation {
    /// Equilibrium pressure P_o (gauge) \[Pa\].
    pub pressure_pa: f64,
    /// Mass of the weight \[kg\].
    pub mass_kg: f64,
    /// Equilibrium contraction ε₀ \[-\].
    pub contraction: f64,
    /// ω₁ = K_G κRθ/V_o \[rad/s\].
    pub omega1_rad_per_s: f64,
    /// ω₂ = √(f_c/ML) \[rad/s\].
    pub omega2_rad_per_s: f64,
    /// ζ = C/(2Mω₂) \[-\].
    pub damping_ratio: f64,
    /// f_p = ∂F/∂P \[m²\].
    pub force_per_pressure_m2: f64,
    /// f_c = −∂F/∂ε \[N\].
    pub stiffness_n: f64,
    /// κ V_c P_o/V_o \[Pa\], P_o absolute: the pressure drop per contraction.
    pub compression_pa: f64,
    /// f_p/(M L) \[1/(Pa·s²)\].
    pub lift_per_pa_s2: f64,
    /// The flow gain that makes ω₁ = ω₂ \[kg/(Pa·s)\].
    pub flow_gain_needed_kg_per_pa_s: f64,
}

/// Contraction at which a muscle under `pressure` carries `mass_kg` \[-\], Eq 1 solved for ε;
/// `None` if it does not lift the mass (ε < 0) or would contract completely.
pub fn equilibrium(muscle: &Muscle<f64>, pressure: GaugePa<f64>, mass_kg: f64) -> Option<f64> {
    let force_n = mass_kg * GRAVITY_M_PER_S2;
    let squared = ((force_n - muscle.gamma_n) / pressure.0 - muscle.beta_m2) / muscle.alpha_m2;
    let contraction = 1.0 - squared.sqrt();
    (pressure.0 > 0.0 && (0.0..1.0).contains(&contraction)).then_some(contraction)
}

/// The weight of `rig`.
///
/// # Errors
/// The rig's load is prescribed.
pub fn weight(rig: &Rig) -> Result<&Weight, BadInput> {
    match &rig.nominal.load {
        Load::Weight(weight) => Ok(weight),
        Load::Prescribed => Err(rig.bad(
            "load.kind",
            "\"weight\" for this command, found \"prescribed\"",
        )),
    }
}

/// The linearisation of `rig`'s circuit at an equilibrium pressure with a mass, or `None` if
/// there is no such equilibrium.
///
/// # Errors
/// The rig has no weight, valve, gas or volume.
pub fn linearise(
    rig: &Rig,
    pressure: GaugePa<f64>,
    mass_kg: f64,
) -> Result<Option<Linearisation>, BadInput> {
    let weight = weight(rig)?;
    let (valve, gas, volume) = (
        rig.require_valve()?,
        rig.require_gas()?,
        rig.require_volume()?,
    );
    let Some(contraction) = equilibrium(&rig.nominal.muscle, pressure, mass_kg) else {
        return Ok(None);
    };
    let length_m = rig.nominal.muscle.initial_length_m;
    let volume_m3 = volume.volume_m3(contraction);
    let stiffness_n = rig.nominal.muscle.stiffness_n(contraction, pressure);
    let force_per_pressure_m2 = rig.nominal.muscle.force_per_pressure_m2(contraction);
    let omega2_rad_per_s = (stiffness_n / (mass_kg * length_m)).sqrt();
    let specific_energy_j_per_kg = HEAT_RATIO * GAS_CONSTANT_J_PER_KG_K * gas.ambient_temperature_k;
    let absolute = pressure.to_absolute(gas.atmospheric_pressure);
    Ok(Some(Linearisation {
        pressure_pa: pressure.0,
        mass_kg,
        contraction,
        omega1_rad_per_s: valve.flow_gain_kg_per_pa_s * specific_energy_j_per_kg / volume_m3,
        omega2_rad_per_s,
        damping_ratio: weight.viscous_damping_ns_per_m / (2.0 * mass_kg * omega2_rad_per_s),
        force_per_pressure_m2,
        stiffness_n,
        compression_pa: HEAT_RATIO * volume.slope_m3(contraction) * absolute.0 / volume_m3,
        lift_per_pa_s2: force_per_pressure_m2 / (mass_kg * length_m),
        flow_gain_needed_kg_per_pa_s: omega2_rad_per_s * volume_m3 / specific_energy_j_per_kg,
    }))
}

impl Linearisation {
    fn oscillator(&self, s: Complex<f64>) -> Complex<f64> {
        let omega2 = self.omega2_rad_per_s;
        s * s + s * (2.0 * self.damping_ratio * omega2) + omega2 * omega2
    }

    /// G(jω) = P/P_r, Eq 10 with the errata's last term: ω₁D/((s + ω₁)D + (f_p/ML)κV_cP_o/V_o·s),
    /// where D = s² + 2ζω₂s + ω₂².
    pub fn pressure_response(&self, omega_rad_per_s: f64) -> Complex<f64> {
        let s = Complex::new(0.0, omega_rad_per_s);
        let oscillator = self.oscillator(s);
        let coupling = s * (self.lift_per_pa_s2 * self.compression_pa);
        oscillator * self.omega1_rad_per_s / ((s + self.omega1_rad_per_s) * oscillator + coupling)
    }

    /// H(jω) = ε/P \[1/Pa\], Eq 11: (f_p/ML)/(s² + 2ζω₂s + ω₂²).
    pub fn contraction_response(&self, omega_rad_per_s: f64) -> Complex<f64> {
        let s = Complex::new(0.0, omega_rad_per_s);
        Complex::from(self.lift_per_pa_s2) / self.oscillator(s)
    }
}

/// Rates of the four nominal states, linearised numerically at the equilibrium: ∂ẏ/∂y, ∂ẏ/∂P_r.
/// Without friction and the rig's effects, while the muscle charges.
///
/// # Errors
/// As [`linearise`].
pub fn jacobian(rig: &Rig, at: &Linearisation) -> Result<(Matrix4<f64>, Vector4<f64>), BadInput> {
    let mut nominal = rig.clone();
    nominal.effects.clear();
    let mut plant = nominal.plant(Simulated::WHOLE)?;
    let regime = Regime {
        motion: Motion::Rising,
        charging: true,
    };
    if let Some(load) = &mut plant.load {
        load.weight.mass_kg = at.mass_kg;
        load.weight.coulomb_friction_n = 0.0;
    }
    let pressure = GaugePa(at.pressure_pa);
    let absolute = pressure.to_absolute(plant.atmospheric);
    let state = [at.contraction, 0.0, absolute.0, plant.ambient_temperature_k];
    let rates = |state: &[f64; NOMINAL_STATES], reference: GaugePa<f64>| {
        let drive = Drive {
            reference,
            ..Drive::default()
        };
        Vector4::from(plant.rates(0.0, &drive, regime, state))
    };
    // Central differences: the equations are at most quadratic here, so steps may be large.
    let steps = [1e-5, 1e-4, 10.0, 1e-2];
    let mut by_state = Matrix4::zeros();
    for (column, step) in steps.into_iter().enumerate() {
        let (mut above, mut below) = (state, state);
        above[column] += step;
        below[column] -= step;
        let difference = rates(&above, pressure) - rates(&below, pressure);
        by_state.set_column(column, &(difference / (2.0 * step)));
    }
    let step = 10.0;
    let above = rates(&state, GaugePa(pressure.0 + step));
    let below = rates(&state, GaugePa(pressure.0 - step));
    Ok((by_state, (above - below) / (2.0 * step)))
}

/// Limit of the iterations for the poles, more than any loop of five states needs.
const ITERATIONS_MAX: usize = 10_000;

/// Spectral radius of the sampled closed loop at an equilibrium; the loop is stable below 1.
///
/// The loop is Eqs 6–8 every `period_s` with a zero-order hold and `delay_ticks` (0 or 1) whole
/// ticks of delay, around the plant of [`jacobian`]. Infinite if a pole is not finite.
fn spectral_radius(
    (by_state, by_reference): &(Matrix4<f64>, Vector4<f64>),
    feedback_pa: f64,
    period_s: f64,
    delay_ticks: usize,
) -> f64 {
    // The exponential of [A B; 0 0] contains both matrices of the plant with a zero-order hold.
    let mut joint = SMatrix::<f64, 5, 5>::zeros();
    joint
        .fixed_view_mut::<4, 4>(0, 0)
        .copy_from(&(by_state * period_s));
    joint
        .fixed_view_mut::<4, 1>(0, 4)
        .copy_from(&(by_reference * period_s));
    if joint.iter().any(|value| !value.is_finite()) {
        return f64::INFINITY;
    }
    let held = joint.exp();
    let mut loop_matrix = SMatrix::<f64, 5, 5>::zeros();
    loop_matrix
        .fixed_view_mut::<4, 4>(0, 0)
        .copy_from(&held.fixed_view::<4, 4>(0, 0));
    let input = held.fixed_view::<4, 1>(0, 4);
    if delay_ticks == 0 {
        for row in 0..4 {
            loop_matrix[(row, CONTRACTION)] += input[row] * feedback_pa;
        }
    } else {
        // The fifth state is the reference of the previous tick.
        loop_matrix.fixed_view_mut::<4, 1>(0, 4).copy_from(&input);
        loop_matrix[(4, CONTRACTION)] = feedback_pa;
    }
    if loop_matrix.iter().any(|value| !value.is_finite()) {
        return f64::INFINITY;
    }
    Schur::try_new(loop_matrix, f64::EPSILON, ITERATIONS_MAX).map_or(f64::INFINITY, |schur| {
        let poles = schur.complex_eigenvalues();
        poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max)
    })
}

/// Examined range of K_s·K \[N/m\]. Below it the delayed control law reduces the stiffness of the
/// muscle by more than the lever adds, and only friction holds the weight.
pub const STIFFNESS_GAIN_N_PER_M: std::ops::RangeInclusive<f64> = 20.0..=2e6;

/// The largest product K_s·K \[N/m\] with which the sampled loop is stable at the equilibrium, to
/// 0.1 %: 0 if it is unstable at the lowest of [`STIFFNESS_GAIN_N_PER_M`], `None` if it is stable
/// at all of them.
///
/// # Errors
/// As [`linearise`].
pub fn stiffness_gain_limit_n_per_m(
    rig: &Rig,
    assist: &Assist<f64>,
    at: &Linearisation,
    period_s: f64,
    delay_ticks: usize,
) -> Result<Option<f64>, BadInput> {
    let jacobian = jacobian(rig, at)?;
    let travel_m = assist.lever_travel_m(rig.nominal.muscle.initial_length_m);
    let stable = |stiffness_gain_n_per_m: f64| {
        // dP_r/dε of Eqs 6–8 at P_r = P: the control law cancels the stiffness f_c of the muscle
        // and adds that of the lever.
        let lever_n = stiffness_gain_n_per_m * travel_m;
        let feedback_pa = (at.stiffness_n - lever_n) / at.force_per_pressure_m2;
        spectral_radius(&jacobian, feedback_pa, period_s, delay_ticks) < 1.0
    };
    let mut low = *STIFFNESS_GAIN_N_PER_M.start();
    if !stable(low) {
        return Ok(Some(0.0));
    }
    // Upwards in steps of 5 %, up to the first loss of stability.
    let mut high = 1.05 * low;
    while stable(high) {
        (low, high) = (high, high * 1.05);
        if high > *STIFFNESS_GAIN_N_PER_M.end() {
            return Ok(None);
        }
    }
    while high - low > 1e-3 * low {
        let middle = 0.5 * (low + high);
        if stable(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(Some(low))
}
