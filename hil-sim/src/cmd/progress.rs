//! Progress bars, drawn only with the feature `terminal`.

#[cfg(feature = "terminal")]
pub use drawn::Progress;
#[cfg(not(feature = "terminal"))]
pub use hidden::Progress;

#[cfg(feature = "terminal")]
mod drawn {
    use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
    use std::time::Duration;

    /// A progress bar: drawn on a terminal after one second, cleared when it is dropped.
    pub struct Progress(ProgressBar);

    impl Progress {
        /// Begins `doing`, of `length` steps.
        pub fn new(doing: &'static str, length: u64) -> Progress {
            let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::hidden());
            // The template is constant; if it were invalid, the default style would be used.
            if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} %, {eta}") {
                bar.set_style(style);
            }
            bar.set_message(doing);
            if super::super::is_quiet() {
                return Progress(bar);
            }
            let later = bar.clone();
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_secs(1));
                if !later.is_finished() {
                    later.set_draw_target(ProgressDrawTarget::stderr());
                    later.enable_steady_tick(Duration::from_millis(200));
                }
            });
            Progress(bar)
        }

        /// A step is done.
        pub fn step(&self) {
            self.0.inc(1);
        }

        /// Another stage begins, of `length` steps.
        pub fn stage(&self, doing: &'static str, length: u64) {
            self.0.set_length(length);
            self.0.set_position(0);
            self.0.set_message(doing);
        }

        /// Shows what is being done.
        pub fn say(&self, doing: String) {
            self.0.set_message(doing);
        }
    }

    impl Drop for Progress {
        fn drop(&mut self) {
            self.0.finish_and_clear();
        }
    }
}

#[cfg(not(feature = "terminal"))]
mod hidden {
    /// Replaces the progress bar, and draws nothing.
    pub struct Progress;

    impl Progress {
        /// Begins a task.
        pub fn new(_: &'static str, _: u64) -> Progress {
            Progress
        }

        /// A step is done.
        pub fn step(&self) {}

        /// Another stage begins.
        pub fn stage(&self, _: &'static str, _: u64) {}

        /// What is being done.
        pub fn say(&self, _: String) {}
    }
}
