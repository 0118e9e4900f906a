//! The settings that a board needs for a rig, and storing them on a board.

use crate::bench::error::Error;
use crate::bench::port::client::{Client, Transport};
use crate::error::BadInput;
use crate::rig::Rig;
use model_core::error::SettingsError;
use model_core::muscle::Muscle;
use model_core::settings::{Settings, SettingsValues};
use muscle_plant::nominal::Load;

/// The settings of a board on `rig`: the rig's muscle, gain, load and supply, with the electronics
/// and limits of [`SettingsValues::reference`].
///
/// # Errors
/// A section of the rig is missing, or a value is outside the limits of a board.
pub fn from_rig(rig: &Rig) -> Result<Settings, BadInput> {
    from_rig_and_board(rig, &SettingsValues::reference())
}

/// As [`from_rig`], with the electronics and limits of `board`.
///
/// # Errors
/// As [`from_rig`].
pub fn from_rig_and_board(rig: &Rig, board: &SettingsValues) -> Result<Settings, BadInput> {
    let mut values = *board;
    let (muscle, assist, valve) = (
        &rig.nominal.muscle,
        rig.require_assist()?,
        rig.require_valve()?,
    );
    values.muscle = Muscle {
        alpha_m2: muscle.alpha_m2 as f32,
        beta_m2: muscle.beta_m2 as f32,
        gamma_n: muscle.gamma_n as f32,
        initial_length_m: muscle.initial_length_m as f32,
    };
    values.gain = assist.gain as f32;
    if let Load::Weight(weight) = &rig.nominal.load {
        values.load_kg = weight.mass_kg as f32;
    }
    let supply_pa = valve.supply_pressure.0 as f32;
    values.supply_pressure_pa = supply_pa;
    values.pressure_pa_max = values.pressure_pa_max.min(supply_pa);
    values.play_pressure_pa_max = values.play_pressure_pa_max.min(values.pressure_pa_max);
    Settings::new(values).map_err(|error| {
        let (SettingsError::OutOfRange { name, .. } | SettingsError::Contradiction { name, .. }) =
            error
        else {
            return rig.bad_file(&format!("a rig a board can run, {error}"));
        };
        let key = match name {
            "gain" => "assist.gain",
            "supply_pressure_pa" | "pressure_pa_max" => "valve.supply_pressure_pa",
            "contraction_max" => "muscle.beta_m2",
            "load_kg" | "force_error_n_max" => "load.mass_kg",
            name if name.starts_with("muscle.") => name,
            _ => "assist",
        };
        rig.bad(key, &format!("a rig a board can run, {error}"))
    })
}

/// Ensures that the board at `port` has the settings of `rig`, and returns them. The board's
/// electronics and limits are kept.
///
/// # Errors
/// The board has other settings and `may_write` is false; the rig does not fit; the link fails.
pub fn ensure_from_rig<P: Transport>(
    client: &mut Client<P>,
    rig: &Rig,
    port: &str,
    may_write: bool,
) -> Result<Settings, Error> {
    let wanted = from_rig_and_board(rig, &client.settings()?)?;
    ensure(client, wanted, port, "the rig", may_write)
}

/// Ensures that the board at `port` has the settings `wanted`, and returns them. `source` says in
/// an error where they come from.
///
/// # Errors
/// The board has other settings and `may_write` is false; the link fails.
pub fn ensure<P: Transport>(
    client: &mut Client<P>,
    wanted: Settings,
    port: &str,
    source: &str,
    may_write: bool,
) -> Result<Settings, Error> {
    if *wanted.values() != client.settings()? {
        if !may_write {
            let expected = format!(
                "a board with the settings of {source}, found others: \
                 --write-settings stores them on the board"
            );
            return Err(BadInput::file(port, expected).into());
        }
        client.write_settings(wanted.values())?;
    }
    Ok(wanted)
}
