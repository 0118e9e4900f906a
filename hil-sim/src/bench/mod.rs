//! The test bench: the closed loop with the controller in this program or on a board, test signals,
//! records of ticks, replay and compensation.

pub mod assist_run;
pub mod board_report;
pub mod board_settings;
pub mod closed_loop;
pub mod compensate;
pub mod error;
pub mod hil;
pub(crate) mod instruments;
pub mod person;
pub mod player;
pub mod port;
pub mod recorder;
pub mod replay;
pub mod settings_file;
pub mod test_signal;
pub mod tick;
pub mod tracking;
pub mod view;
