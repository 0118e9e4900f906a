//! Whoever answers: a person at a terminal, a script, or a test.

use crate::bench::error::Error;

/// A question.
#[derive(Clone, Debug)]
pub struct Question {
    /// Its name, for scripts.
    pub name: &'static str,
    /// What to do, and what to answer.
    pub text: String,
}

/// Whoever answers.
pub trait Person {
    /// The answer to `question`, a line without its end.
    ///
    /// # Errors
    /// There is no answer any more.
    fn ask(&mut self, question: &Question) -> Result<String, Error>;

    /// Takes note of a text.
    fn tell(&mut self, text: &str);
}
