//! Work in a thread of its own: Python's thread waits, looks for Ctrl-C and tells progress.

use crate::bad;
use hil_sim::error::BadInput;
use model_discrepancy::verdict::Step;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// How long Ctrl-C may go unnoticed.
const LOOK: Duration = Duration::from_millis(50);

/// Ends work that nobody waits for any more, by unwinding its threads.
struct Abandoned;

enum Message<T> {
    Step(Step),
    Done(std::thread::Result<Result<T, BadInput>>),
}

/// Does `work`, which tells what it is doing, and passes that on to `progress`: the name of the
/// stage, the sets of effects that it tries, and the effects of the set that is tried, if one is.
///
/// # Errors
/// What `work` or `progress` returned, or Ctrl-C: then the work ends at its next step.
pub fn run<T: Send + 'static>(
    py: Python,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&(dyn Fn(Step) + Sync)) -> Result<T, BadInput> + Send + 'static,
) -> PyResult<T> {
    let (sender, mut receiver) = channel();
    let abandoned = Arc::new(AtomicBool::new(false));
    let is_abandoned = Arc::clone(&abandoned);
    let tells = progress.is_some();
    std::thread::spawn(move || {
        let steps: Sender<Message<T>> = sender.clone();
        let watch = move |step| {
            if is_abandoned.load(Ordering::Relaxed) {
                // Not a panic: nothing is printed.
                resume_unwind(Box::new(Abandoned));
            }
            if tells {
                // Nobody may listen any more.
                let _ = steps.send(Message::Step(step));
            }
        };
        let done = catch_unwind(AssertUnwindSafe(|| work(&watch)));
        let _ = sender.send(Message::Done(done));
    });
    let mut stage = (String::new(), 0);
    loop {
        // It is of this thread, and goes along.
        let (message, own) = py.detach(move || (receiver.recv_timeout(LOOK), receiver));
        receiver = own;
        let told = match message {
            Ok(Message::Done(Ok(done))) => return done.map_err(|error| bad(&error)),
            Ok(Message::Done(Err(panic))) => resume_unwind(panic),
            Ok(Message::Step(step)) => told(py, progress.as_ref(), &mut stage, step),
            Err(RecvTimeoutError::Timeout) => Ok(()),
            // The thread sends before it ends.
            Err(RecvTimeoutError::Disconnected) => Ok(()),
        };
        if let Err(error) = told.and_then(|()| py.check_signals()) {
            abandoned.store(true, Ordering::Relaxed);
            return Err(error);
        }
    }
}

fn told(
    py: Python,
    progress: Option<&Py<PyAny>>,
    stage: &mut (String, usize),
    step: Step,
) -> PyResult<()> {
    let Some(progress) = progress else {
        return Ok(());
    };
    let tried = match step {
        Step::Stage(name, sets) => {
            *stage = (name.to_owned(), sets);
            Vec::new()
        }
        Step::Try(effects) => effects,
    };
    progress.call1(py, (&stage.0, stage.1, tried))?;
    Ok(())
}
