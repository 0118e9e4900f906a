//! Soak test with random use: no drift, no overflow, no fault. The long run (overflows are
//! checked): `SOAK_HOURS=24 cargo test -p hil-sim --test soak -- --nocapture`.

#[path = "board/soak.rs"]
mod soak;

use model_core::controller::Controller;
use model_core::settings::{Settings, SettingsValues};

/// Simulated hours; the environment variable SOAK_HOURS overrides them.
const HOURS: f64 = 0.5;

#[test]
fn hours_of_random_use_cause_no_drift_and_no_fault() {
    let hours = std::env::var("SOAK_HOURS").map_or(HOURS, |hours| hours.parse().expect("hours"));
    let settings = Settings::new(SettingsValues::reference()).expect("the reference is valid");
    let mut controller = Controller::new(settings);
    soak::soak(hours, &settings, |sensors| controller.tick(sensors));
}
