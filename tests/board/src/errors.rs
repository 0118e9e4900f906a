//! What a real board would have ignored, faulted on or done wrongly, in the order it was found.

use crate::time::{Time, to_ns};

/// One kind of mistake the firmware (or the wiring) made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BoardError {
    /// When it happened first.
    pub time_ns: u64,
    /// The instruction that was running then.
    pub pc: u32,
    /// How often it happened.
    pub count: u64,
    /// What happened.
    pub text: String,
}

/// The list that every peripheral writes to.
#[derive(Debug, Default)]
pub struct Errors {
    /// Each text once.
    pub list: Vec<BoardError>,
}

impl Errors {
    /// Adds `text`, or counts it up if it is there.
    pub fn add(&mut self, now: Time, pc: u32, text: String) {
        match self.list.iter_mut().find(|error| error.text == text) {
            Some(error) => error.count += 1,
            None => self.list.push(BoardError {
                time_ns: to_ns(now),
                pc,
                count: 1,
                text,
            }),
        }
    }
}

/// What a peripheral may know of its surroundings while a register is accessed.
pub struct Context<'a> {
    /// The time of the access.
    pub now: Time,
    /// The instruction that accesses.
    pub pc: u32,
    /// Where mistakes go.
    pub errors: &'a mut Errors,
}

impl Context<'_> {
    /// Records a mistake.
    pub fn error(&mut self, text: impl Into<String>) {
        self.errors.add(self.now, self.pc, text.into());
    }
}

#[cfg(test)]
pub(crate) fn quiet(errors: &mut Errors, now: Time) -> Context<'_> {
    Context { now, pc: 0, errors }
}
