//! A controller in this program.

use crate::bench::port::ControllerPort;
use crate::bench::tick::Tick;
use crate::error::BadInput;
use model_core::io::{Output, Sensors};

/// A function as the controller, and the ticks so far.
pub(crate) struct InProcess<F> {
    controller: F,
    pub(crate) ticks: Vec<Tick>,
}

impl<F: FnMut(&Sensors) -> Output> InProcess<F> {
    pub(crate) fn new(controller: F) -> InProcess<F> {
        InProcess {
            controller,
            ticks: Vec::new(),
        }
    }
}

impl<F: FnMut(&Sensors) -> Output> ControllerPort for InProcess<F> {
    type Error = BadInput;

    fn tick(&mut self, sensors: &Sensors) -> Result<Output, BadInput> {
        Ok((self.controller)(sensors))
    }

    fn observe(&mut self, tick: Tick) -> Result<(), BadInput> {
        self.ticks.push(tick);
        Ok(())
    }
}
