//! The units in which other programs' files may have the quantities of a record.

use super::{
    CONTRACTION, FINGER_M, FORCE_N, INPUT_FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, SUPPLY_PA,
    TEMPERATURE_K, VALVE_OPEN,
};

/// A unit: its name, its size in the SI unit, and the SI value of its zero.
pub(crate) type Unit = (&'static str, f64, f64);

/// Units of pressure. The zero is that of the source: `offset` turns absolute into gauge pressure.
pub(crate) const PRESSURE: &[Unit] = &[
    ("Pa", 1.0, 0.0),
    ("hPa", 100.0, 0.0),
    ("mbar", 100.0, 0.0),
    ("kPa", 1e3, 0.0),
    ("bar", 1e5, 0.0),
    ("MPa", 1e6, 0.0),
    ("psi", 6_894.757_293_168_361, 0.0),
];
pub(crate) const RATIO: &[Unit] = &[("1", 1.0, 0.0), ("%", 0.01, 0.0)];
pub(crate) const FORCE: &[Unit] = &[
    ("N", 1.0, 0.0),
    ("mN", 1e-3, 0.0),
    ("kN", 1e3, 0.0),
    ("kgf", 9.806_65, 0.0),
    ("lbf", 4.448_221_615_260_5, 0.0),
];
pub(super) const LENGTH: &[Unit] = &[
    ("m", 1.0, 0.0),
    ("cm", 1e-2, 0.0),
    ("mm", 1e-3, 0.0),
    ("um", 1e-6, 0.0),
    ("in", 0.0254, 0.0),
];
const TEMPERATURE: &[Unit] = &[
    ("K", 1.0, 0.0),
    ("degC", 1.0, 273.15),
    ("degF", 5.0 / 9.0, 273.15 - 160.0 / 9.0),
];
pub(super) const TIME: &[Unit] = &[
    ("s", 1.0, 0.0),
    ("ms", 1e-3, 0.0),
    ("us", 1e-6, 0.0),
    ("min", 60.0, 0.0),
    ("h", 3600.0, 0.0),
    ("d", 86_400.0, 0.0),
];

/// The columns that a file can be mapped to, besides the time, and their units; the first is the
/// record's.
pub(super) const TARGETS: [(&str, &[Unit]); 9] = [
    (PRESSURE_REF_PA, PRESSURE),
    (PRESSURE_PA, PRESSURE),
    (CONTRACTION, RATIO),
    (FORCE_N, FORCE),
    (FINGER_M, LENGTH),
    (INPUT_FORCE_N, FORCE),
    (SUPPLY_PA, PRESSURE),
    (TEMPERATURE_K, TEMPERATURE),
    (VALVE_OPEN, RATIO),
];
