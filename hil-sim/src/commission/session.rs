//! A session: the steps in their order, each repeated until it is right or accepted.

use crate::bench::error::Error;
use crate::bench::port::client::{Client, Transport};
use crate::commission::cause::{Cause, Step};
use crate::commission::curve::Curve;
use crate::commission::lift::Lift;
use crate::commission::person::{Person, Question};
use crate::commission::readings::Readings;
use crate::commission::scale::Line;
use crate::report::{Plot, Table};
use crate::rig::Rig;
use model_core::link::Identity;
use model_core::muscle::Muscle;
use model_core::settings::SettingsValues;
use muscle_plant::nominal::Load;

/// What a step saw.
#[derive(Clone, Debug)]
pub struct Seen {
    /// The step.
    pub step: Step,
    /// What was looked at, what it saw, what was expected.
    pub rows: Vec<[String; 3]>,
    /// What is probably wrong.
    pub causes: Vec<Cause>,
    /// The causes were accepted.
    pub accepted: bool,
    /// Plots for the report.
    pub plots: Vec<Plot>,
}

impl Seen {
    pub(super) fn new(step: Step) -> Seen {
        Seen {
            step,
            rows: Vec::new(),
            causes: Vec::new(),
            accepted: false,
            plots: Vec::new(),
        }
    }

    pub(super) fn row(&mut self, what: &str, saw: String, expected: String) {
        self.rows.push([what.into(), saw, expected]);
    }

    pub(super) fn add(&mut self, cause: Option<Cause>) {
        if let Some(cause) = cause.filter(|cause| !self.causes.contains(cause)) {
            self.causes.push(cause);
        }
    }

    /// The rows as a table.
    pub fn table(&self) -> Table {
        Table {
            caption: String::new(),
            columns: ["", "seen", "expected"].map(String::from).into(),
            rows: self.rows.iter().map(|row| row.to_vec()).collect(),
        }
    }

    /// What it saw, what was expected and what is probably wrong, as text.
    pub fn words(&self) -> String {
        let rows = self
            .rows
            .iter()
            .map(|[what, saw, expected]| format!("  {what}: {saw}; expected {expected}\n"));
        let causes = self
            .causes
            .iter()
            .map(|cause| format!("  Probably wrong: {}. {}.\n", cause.words(), cause.remedy()));
        rows.chain(causes).collect()
    }
}

/// What the steps have measured beside the settings.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// The bridge's line.
    pub bridge: Option<Line>,
    /// The pressure sensor's line.
    pub pressure: Option<Line>,
    /// The valve's curve.
    pub curve: Option<Curve>,
    /// The slow lift.
    pub lift: Option<Lift>,
    /// The slow triangles.
    pub friction: Option<Lift>,
}

/// A session with one board and one person.
pub struct Session<'a, P, W> {
    pub(super) client: &'a mut Client<P>,
    pub(super) person: &'a mut W,
    /// The rig as it is supposed to be.
    pub(super) rig: Rig,
    pub(super) identity: Identity,
    /// Settings that the board has, and keeps until the end.
    pub(super) old: SettingsValues,
    /// Settings as measured so far.
    pub values: SettingsValues,
    pub(super) rest: Readings,
    /// What the steps have measured.
    pub measured: Measured,
    /// What the steps saw, the last time each.
    pub seen: Vec<Seen>,
}

/// What a step gives: what it saw, and the settings that follow.
pub(super) type Given = (Seen, SettingsValues, Measured);

impl<'a, P: Transport, W: Person> Session<'a, P, W> {
    /// A session on the rig that `rig` describes. The settings' own muscle and load are used if
    /// `stored`, for a check of the settings.
    ///
    /// # Errors
    /// The rig has no weight, no valve; the board does not answer.
    pub fn new(
        client: &'a mut Client<P>,
        person: &'a mut W,
        rig: &Rig,
        stored: bool,
    ) -> Result<Session<'a, P, W>, Error> {
        rig.require_valve()?;
        let Load::Weight(weight) = rig.nominal.load else {
            return Err(rig
                .bad("load.kind", "a weight, which is to be lifted")
                .into());
        };
        let identity = client.identity()?;
        let old = client.settings()?;
        let mut values = old;
        if !stored {
            let muscle = &rig.nominal.muscle;
            values.muscle = Muscle {
                alpha_m2: muscle.alpha_m2 as f32,
                beta_m2: muscle.beta_m2 as f32,
                gamma_n: muscle.gamma_n as f32,
                initial_length_m: muscle.initial_length_m as f32,
            };
            values.load_kg = weight.mass_kg as f32;
        }
        Ok(Session {
            client,
            person,
            rig: rig.clone(),
            identity,
            old,
            values,
            rest: Readings::default(),
            measured: Measured::default(),
            seen: Vec::new(),
        })
    }

    /// Goes through `steps`; false if the person has given up. The board then has its old settings.
    ///
    /// # Errors
    /// The link fails, or there are no more answers.
    pub fn run(&mut self, steps: &[Step]) -> Result<bool, Error> {
        let checks = steps == Step::CHECK;
        for (number, step) in steps.iter().enumerate() {
            let heading = step.heading();
            let of = steps.len();
            self.person
                .tell(&format!("\nStep {} of {of}: {heading}\n", number + 1));
            if !self.until_right(*step, checks)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Whether the person agrees.
    ///
    /// # Errors
    /// There are no more answers.
    pub fn agrees(&mut self, text: &str) -> Result<bool, Error> {
        Ok(self.choose("write", text, &["y", "n"])? == "y")
    }

    /// Stores `values` on the board.
    ///
    /// # Errors
    /// The link fails, or the board refuses.
    pub fn store(&mut self, values: &SettingsValues) -> Result<(), Error> {
        Ok(self.client.write_settings(values)?)
    }

    /// Repeats a step until it is right or accepted; false if the person has given up.
    fn until_right(&mut self, step: Step, checks: bool) -> Result<bool, Error> {
        loop {
            let (mut seen, values, measured) = self.step(step, checks)?;
            self.person.tell(&seen.words());
            // A check measures nothing that could be stored.
            let acceptable = !checks && seen.causes.iter().all(|cause| cause.may_be_accepted());
            let answer = match (seen.causes.is_empty(), acceptable) {
                (true, _) => self.choose("next", "Right. Enter: go on, r: repeat", &["", "r"])?,
                (false, true) => {
                    let text = "r: repeat, a: accept what was measured, q: end";
                    self.choose("finding", text, &["r", "a", "q"])?
                }
                (false, false) => self.choose("finding", "r: repeat, q: end", &["r", "q"])?,
            };
            seen.accepted = answer == "a";
            self.seen.retain(|before| before.step != step);
            self.seen.push(seen);
            match answer {
                "r" => {}
                "q" => return Ok(false),
                _ => {
                    self.values = values;
                    self.measured = measured;
                    return Ok(true);
                }
            }
        }
    }

    fn step(&mut self, step: Step, checks: bool) -> Result<Given, Error> {
        match step {
            Step::Start => self.start(checks),
            Step::Stop => self.emergency_stop(),
            Step::Wiring => self.wiring(),
            Step::Bridge => self.bridge(),
            Step::Pressure => self.pressure(),
            Step::Encoder => self.encoder(),
            Step::Valve => self.valve(),
            Step::Lift => self.lift(checks),
            Step::Friction => self.friction(),
        }
    }

    /// One of `answers`; asks again until it is.
    pub(super) fn choose<'b>(
        &mut self,
        name: &'static str,
        text: &str,
        answers: &[&'b str],
    ) -> Result<&'b str, Error> {
        loop {
            let question = Question {
                name,
                text: text.into(),
            };
            let answer = self.person.ask(&question)?;
            let answer = answer.trim().to_ascii_lowercase();
            if let Some(known) = answers.iter().find(|known| **known == answer) {
                return Ok(known);
            }
            let known = answers.join(", ");
            self.person
                .tell(&format!("  expected one of «{known}», found «{answer}»\n"));
        }
    }

    /// Waits until the person has done what `text` says.
    pub(super) fn wait(&mut self, name: &'static str, text: &str) -> Result<(), Error> {
        self.choose(name, &format!("{text} (Enter)"), &[""])?;
        Ok(())
    }

    /// A number from `min` to `max`; asks again until it is one.
    pub(super) fn number(
        &mut self,
        name: &'static str,
        text: &str,
        (min, max): (f64, f64),
    ) -> Result<f64, Error> {
        loop {
            let text = text.into();
            let answer = self.person.ask(&Question { name, text })?;
            match answer.trim().parse() {
                Ok(value) if (min..=max).contains(&value) => return Ok(value),
                _ => self.person.tell(&format!(
                    "  expected a number from {min:?} to {max:?}, found «{answer}»\n"
                )),
            }
        }
    }
}
