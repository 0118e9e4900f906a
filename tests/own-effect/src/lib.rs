//! A catalogue with one effect more: its file, and one line here. `simulate`, `diagnose`, `check`,
//! `compensate` and the reports read the catalogue; the tests simulate, diagnose, list, check and
//! compensate it as any other effect.

pub mod pulley_eccentricity;

use muscle_plant::effects::Catalogue;

/// The effects of muscle-plant and [`pulley_eccentricity`].
pub fn catalogue() -> Catalogue {
    Catalogue::standard().with(&pulley_eccentricity::KIND)
}
