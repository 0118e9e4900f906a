//! Ctrl-C.

use hil_sim::output::complete_writing;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Exit status of an interrupted program, as shells have it: 128 + SIGINT.
const INTERRUPTED: i32 = 130;

/// Set by the first interrupt while a board is connected, whose run then ends in order.
static STOP: Mutex<Option<Arc<AtomicBool>>> = Mutex::new(None);

/// What the program says if it has to end before it could put things in order.
static LAST_WORDS: Mutex<Option<&'static str>> = Mutex::new(None);

/// From now on Ctrl-C ends the program with status 130, and a file that
/// [`hil_sim::output::write_atomically`] writes is the new one or the old one. A record of a board
/// is written as it comes, and ends with the last rows that were written.
pub fn handle() {
    // If the handler cannot be set, an interrupt ends the program immediately.
    let _ = ctrlc::set_handler(|| {
        let asked = STOP.lock().ok().and_then(|stop| stop.clone());
        if asked.is_some_and(|stop| !stop.swap(true, Ordering::Relaxed)) {
            return;
        }
        if let Some(words) = LAST_WORDS.lock().ok().and_then(|words| *words) {
            eprintln!("{words}");
        }
        let _complete = complete_writing();
        std::process::exit(INTERRUPTED);
    });
}

/// From now on a Ctrl-C that finds `stop` clear sets it, and one that finds it set ends the
/// program.
pub fn ask_first(stop: &Arc<AtomicBool>) {
    if let Ok(mut asked) = STOP.lock() {
        *asked = Some(Arc::clone(stop));
    }
}

/// From now on a Ctrl-C that ends the program prints `words`: no destructor runs.
pub fn last_words(words: Option<&'static str>) {
    if let Ok(mut last) = LAST_WORDS.lock() {
        *last = words;
    }
}
