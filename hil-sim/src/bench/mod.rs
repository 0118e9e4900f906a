//! The test bench: the controller in the closed loop, in this program or on a board, and what is
//! recorded and played on it.

pub mod board_report;
pub mod closed_loop;
pub mod compensate;
pub mod hil;
pub mod link;
pub mod player;
pub mod port;
pub mod recorder;
pub mod replay;
pub mod settings_file;
pub mod test_signal;
pub mod view;
