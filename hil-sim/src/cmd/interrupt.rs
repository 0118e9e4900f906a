//! Ctrl-C.

use hil_sim::output::complete_writing;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Exit status of an interrupted program, as shells have it: 128 + SIGINT.
const INTERRUPTED: i32 = 130;

/// Set by the first interrupt while a board is connected, whose run then ends in order.
static STOP: Mutex<Option<Arc<AtomicBool>>> = Mutex::new(None);

/// From now on Ctrl-C ends the program with status 130, and a file that is being written is
/// complete or absent.
pub fn handle() {
    // If the handler cannot be set, an interrupt ends the program immediately.
    let _ = ctrlc::set_handler(|| {
        let asked = STOP.lock().ok().and_then(|stop| stop.clone());
        if asked.is_some_and(|stop| !stop.swap(true, Ordering::Relaxed)) {
            return;
        }
        let _complete = complete_writing();
        std::process::exit(INTERRUPTED);
    });
}

/// From now on the first Ctrl-C sets `stop`, and the second one ends the program.
pub fn ask_first(stop: &Arc<AtomicBool>) {
    if let Ok(mut asked) = STOP.lock() {
        *asked = Some(Arc::clone(stop));
    }
}
