//! Errors of the firmware or the wiring, in the order in which they were detected.

use crate::time::{Time, to_ns};

/// One kind of error of the firmware or the wiring.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BoardError {
    /// Time of the first occurrence.
    pub time_ns: u64,
    /// Address of the instruction at the first occurrence.
    pub pc: u32,
    /// Count of occurrences.
    pub count: u64,
    /// Description.
    pub text: String,
}

/// The list of errors, to which every peripheral adds.
#[derive(Debug, Default)]
pub struct Errors {
    /// The errors, each description once.
    pub list: Vec<BoardError>,
}

impl Errors {
    /// Adds an error, or increments the count of an error with the same text.
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

/// Context of a register access.
pub struct Context<'a> {
    /// The time of the access.
    pub now: Time,
    /// Address of the accessing instruction.
    pub pc: u32,
    /// The list of errors.
    pub errors: &'a mut Errors,
}

impl Context<'_> {
    /// Records an error.
    pub fn error(&mut self, text: impl Into<String>) {
        self.errors.add(self.now, self.pc, text.into());
    }
}

#[cfg(test)]
pub(crate) fn test_context(errors: &mut Errors, now: Time) -> Context<'_> {
    Context { now, pc: 0, errors }
}
