//! What numbers of a rig of this kind can be: limits from physics, each with its reason.
//!
//! A number beyond such a limit is in another unit than its name says, or of another quantity.
//! Limits are set so that no rig, however odd, is beyond them, and that the units of the trade,
//! which differ by factors of a hundred and more, are.

/// No braided muscle contracts by more: its threads, at an angle θ₀ to the axis, push no further at
/// cos² θ = 1/3, so that ε ≤ 1 − 1/(√3 cos θ₀) < 1 − 1/√3 = 0.423 (Chou and Hannaford 1996). The
/// rest is for a zero of the sensor off by some percent of the length.
pub(crate) const CONTRACTION_MAX: f64 = 0.45;
/// Nor is a braided muscle stretched by more than 1/cos θ₀ − 1, at which its threads are along the
/// axis: 0.15 at 30°, the widest angle of the trade \[-\].
pub(crate) const STRETCH_MAX: f64 = 0.15;
/// A muscle that is used moves by more than this share of its length \[-\]: a tenth of its stroke
/// of 20 %.
pub(crate) const CONTRACTION_USED: f64 = 0.02;
/// No pneumatic muscle does anything below this pressure: the bladder must first be stretched to
/// the braid, for which 10 to 60 kPa are needed. It is 1 MPa in kPa, so that no muscle's pressure
/// in kPa, psi, bar or MPa exceeds it \[Pa\].
pub(crate) const PRESSURE_IDLE_PA: f64 = 1e3;
/// The least pressure at which a muscle works \[Pa\].
pub(crate) const PRESSURE_WORKING_PA_MIN: f64 = 8e3;
/// What the supplies of pneumatic muscles have at most \[Pa\]: compressors of two stages.
pub(crate) const PRESSURE_WORKING_PA_MAX: f64 = 1.6e6;
/// What muscles are run at if nothing else is known, half a compressed-air net's 6 bar \[Pa\].
pub(crate) const PRESSURE_TYPICAL_PA: f64 = 3e5;
/// Tubing, fittings and bladders burst below \[Pa\].
pub(crate) const PRESSURE_BURST_PA: f64 = 1e7;
/// The least noise of a gauge of 1 bar or more: 10 ppm, a step of a converter of 17 bits \[Pa\].
pub(crate) const GAUGE_NOISE_PA_MIN: f64 = 1.0;
/// Air pressure where people live or mine: 5.1 km above the sea to 4 km below \[Pa\].
pub(crate) const ATMOSPHERE_PA: [f64; 2] = [4.5e4, 1.7e5];
/// Rows further apart than this miss every motion of a muscle, the slowest of which takes seconds
/// \[s\]: no logger that follows a motion is so slow. 500 Hz with the time in ms.
pub(crate) const PERIOD_S_MAX: f64 = 2.0;
/// Rows further apart than this may be of a slow logger, or in ms of a fast one \[s\].
pub(crate) const PERIOD_S_DOUBTFUL: f64 = 0.2;
/// Rows closer than this are in minutes, hours or days \[s\]: a logger of 100 kHz sees nothing of a
/// muscle that one of 10 kHz does not.
pub(crate) const PERIOD_S_MIN: f64 = 1e-5;
/// Days since 1900 as spreadsheets count them, from the year 1982 to 2091.
pub(crate) const DATES_D: [f64; 2] = [3e4, 7e4];
/// Valve and line bring the pressure to 63 % of a step within \[s\]: V/(R T K_G) of the paper's
/// slow valve is 0.1 s, of the largest muscle with it 1 s.
pub(crate) const LAG_S_MAX: f64 = 2.0;
/// An arm reaches no further than \[m\].
pub(crate) const REACH_M: f64 = 1.0;
/// Longest lever and widest pulley of a device for one person \[m\].
pub(crate) const LEVER_M_MAX: f64 = 2.0;
/// Muscle forces of rig and record differ by less than this factor with any effect: units by more.
pub(crate) const FORCE_FACTOR: f64 = 30.0;
/// Air flows out of an opening of area A at the speed of sound at most: ρ c A, 1.2 kg/m³ · 343 m/s
/// for each 101 kPa \[kg/(s·m²·Pa)\].
pub(crate) const SONIC_FLOW_KG_PER_PA_S_M2: f64 = 4.1e-3;
/// V₀/(L α): Eq 1 has α = 3 A/tan² θ₀ and V₀ = A L, so that it is tan² θ₀/3, from 0.024 at 15° to
/// 0.16 at 35°. Walls, ends and fits of Eq 1 change it by less than a factor of ten.
pub(crate) const VOLUME_RATIO: [f64; 2] = [0.024 / 10.0, 0.163 * 10.0];
/// Muscles of one kilometre, or thinner than a hair, are none: length and diameter \[m\].
pub(crate) const LENGTH_M: [f64; 2] = [0.01, 20.0];
pub(crate) const DIAMETER_M: [f64; 2] = [1e-3, 0.2];
/// A standard deviation beyond the value itself says nothing about it: it is in percent.
pub(crate) const TOLERANCE_MAX: f64 = 1.0;

/// Units of pressure that are taken for Pa.
pub(crate) const PRESSURE_UNITS: [(&str, f64); 4] = [
    ("kPa", 1e3),
    ("psi", 6_894.757_293_168_361),
    ("bar", 1e5),
    ("MPa", 1e6),
];

/// The unit whose size is nearest to `factor` in the logarithm, of those that `fits`.
pub(crate) fn nearest<'a>(
    units: &[(&'a str, f64)],
    factor: f64,
    fits: impl Fn(f64) -> bool,
) -> Option<(&'a str, f64)> {
    let distance = |size: f64| (size / factor).ln().abs();
    let fitting = units.iter().filter(|(_, size)| fits(*size));
    fitting
        .min_by(|one, other| distance(one.1).total_cmp(&distance(other.1)))
        .copied()
}
