//! The PC's end of the serial link (docs/link.md): asks, answers, and hardware in the loop tick by
//! tick over a wire that may lose, damage and repeat bytes, or be unplugged.
//!
//! A [`Port`] moves bytes and may lose them; everything that follows from lost ones is here. Time
//! is the board's: an emulated one lets it pass only while the PC waits.

use model_core::device::{Command, SimulatedSensors};
use model_core::io::{Output, Sensors};
use model_core::link::{
    Decoder, FRAME_LEN_MAX, FromDevice, Identity, Source, Telemetry, ToDevice, Written, encode,
};
use model_core::settings::SettingsValues;
use model_core::supervisor::Mode;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Without telemetry for so long, what was sent is sent again.
const REPEAT_AFTER: Duration = Duration::from_millis(30);
/// An answer takes at most so long; then the question is asked again.
const ANSWER_WAIT: Duration = Duration::from_millis(250);
/// How often a question is asked.
const QUESTIONS: usize = 20;
/// Storing settings may erase a sector, which takes up to 4 s.
const STORE_WAIT: Duration = Duration::from_secs(6);
/// Telemetry between two attempts to begin hardware in the loop.
const ENTER_EVERY: usize = 4;
/// A board that still reads its pins after so many ticks refuses.
const ENTER_TICKS_MAX: usize = 100;
/// So many repeated messages without effect mean that the first one had its effect.
const REPEATED_WITHOUT_EFFECT: usize = 20;
/// Telemetry this much older than the last one is the line's echo; older yet is another life.
const ECHO_TICKS: i32 = 16;

/// The wire is gone for good. A serial port that comes back is none of this.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct PortError(pub String);

/// A way to a board.
pub trait Port {
    /// Sends; what cannot be sent is lost.
    ///
    /// # Errors
    /// Nothing will ever come of this port again.
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError>;

    /// Waits until something has come, at most `wait`; appends it to `received`, and returns how
    /// long that took on the board's clock.
    ///
    /// # Errors
    /// Nothing will ever come of this port again.
    fn receive(&mut self, received: &mut Vec<u8>, wait: Duration) -> Result<Duration, PortError>;

    /// What the board has logged, and what has happened to the port, since the last call.
    fn take_log(&mut self) -> Vec<String> {
        Vec::new()
    }
}

impl Port for Box<dyn Port + Send> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        (**self).send(bytes)
    }

    fn receive(&mut self, received: &mut Vec<u8>, wait: Duration) -> Result<Duration, PortError> {
        (**self).receive(received, wait)
    }

    fn take_log(&mut self) -> Vec<String> {
        (**self).take_log()
    }
}

/// Why the board could not be had to do something.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The port.
    #[error(transparent)]
    Port(#[from] PortError),
    /// Nothing that answers as it should.
    #[error("no answer from the board for {0:.0} s")]
    NoAnswer(f64),
    /// It is assisting, holding, or letting the weight down.
    #[error("the board is armed (mode {0}): vent it first")]
    Armed(Mode),
    /// It did not take the settings.
    #[error("the board has not stored the settings: {0:?}")]
    NotStored(Written),
    /// The user has had enough.
    #[error("stopped")]
    Stopped,
}

/// How the line fared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct LinkCounts {
    /// Frames from the board that were damaged.
    pub frames_rejected: u64,
    /// Ticks whose telemetry did not come.
    pub telemetry_lost: u64,
    /// Messages that were sent again.
    pub messages_repeated: u64,
    /// Ticks of the board without a message for it, with hardware in the loop.
    pub silent_ticks: u64,
}

/// What one tick with hardware in the loop gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// What the controller decided.
    pub output: Output,
    /// The tick's telemetry; none if it was lost and only the output could be had later.
    pub telemetry: Option<Telemetry>,
    /// The controller has begun anew before this tick: after a reset, or half a second of silence.
    pub began_anew: bool,
}

/// The PC's end.
pub struct Client<P> {
    port: P,
    decoder: Decoder,
    received: Vec<u8>,
    pending: VecDeque<FromDevice>,
    last_tick: Option<u32>,
    /// How many ticks' telemetry was missing before the last one.
    gap_ticks: u32,
    sequence: u32,
    /// The last one that a controller in the loop gave.
    output: Output,
    counts: LinkCounts,
    give_up: Duration,
    stop: Arc<AtomicBool>,
}

impl<P: Port> Client<P> {
    /// An end that gives up after `give_up` without any telemetry, or once `stop` is set.
    pub fn new(port: P, give_up: Duration, stop: Arc<AtomicBool>) -> Client<P> {
        Client {
            port,
            decoder: Decoder::new(),
            received: Vec::new(),
            pending: VecDeque::new(),
            last_tick: None,
            gap_ticks: 0,
            sequence: 0,
            output: Output::default(),
            counts: LinkCounts::default(),
            give_up,
            stop,
        }
    }

    /// How the line has fared.
    pub fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// See [`Port::take_log`].
    pub fn take_log(&mut self) -> Vec<String> {
        self.port.take_log()
    }

    /// Sends a message.
    ///
    /// # Errors
    /// The port is gone.
    pub fn send(&mut self, message: &ToDevice) -> Result<(), LinkError> {
        let mut buffer = [0; FRAME_LEN_MAX];
        // Every message fits: model-core tests it.
        let frame = encode(message, &mut buffer).unwrap_or_default();
        // The zero before clears what may be left of a broken frame.
        let bytes = [&[0], frame].concat();
        Ok(self.port.send(&bytes)?)
    }

    /// The next message; none if there is none within `wait`.
    ///
    /// # Errors
    /// The port is gone, or the user wants to stop.
    pub fn next(&mut self, wait: Duration) -> Result<Option<FromDevice>, LinkError> {
        let mut waited = Duration::ZERO;
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Err(LinkError::Stopped);
            }
            while let Some(message) = self.pending.pop_front() {
                if self.is_news(&message) {
                    return Ok(Some(message));
                }
            }
            if waited >= wait {
                return Ok(None);
            }
            self.received.clear();
            waited += self.port.receive(&mut self.received, wait - waited)?;
            for byte in &self.received {
                match self.decoder.push(*byte) {
                    Some(Ok(message)) => self.pending.push_back(message),
                    Some(Err(_)) => self.counts.frames_rejected += 1,
                    None => {}
                }
            }
        }
    }

    /// False for telemetry that the line has repeated. Counts what is missing.
    fn is_news(&mut self, message: &FromDevice) -> bool {
        let FromDevice::Telemetry(told) = message else {
            return true;
        };
        let ahead = self
            .last_tick
            .map_or(1, |last| told.tick.wrapping_sub(last) as i32);
        if (-ECHO_TICKS..=0).contains(&ahead) {
            return false;
        }
        // Behind: the board has been reset, and nothing is known of what was before.
        self.gap_ticks = if ahead > 0 { ahead as u32 - 1 } else { 0 };
        self.counts.telemetry_lost += u64::from(self.gap_ticks);
        self.last_tick = Some(told.tick);
        true
    }

    /// The next telemetry; none if there is none within `wait`. Other messages are dropped.
    fn telemetry(&mut self, wait: Duration) -> Result<Option<Telemetry>, LinkError> {
        loop {
            match self.next(wait)? {
                Some(FromDevice::Telemetry(told)) => return Ok(Some(told)),
                Some(_) => {}
                None => return Ok(None),
            }
        }
    }

    fn ask<T>(
        &mut self,
        question: ToDevice,
        answer: fn(FromDevice) -> Option<T>,
    ) -> Result<T, LinkError> {
        for _ in 0..QUESTIONS {
            self.send(&question)?;
            if let Some(found) = self.find(ANSWER_WAIT, answer)? {
                return Ok(found);
            }
        }
        let waited = ANSWER_WAIT * QUESTIONS as u32;
        Err(LinkError::NoAnswer(waited.as_secs_f64()))
    }

    /// The first message of a kind within the time of `wait`, told by telemetry and by silence.
    fn find<T>(
        &mut self,
        wait: Duration,
        answer: fn(FromDevice) -> Option<T>,
    ) -> Result<Option<T>, LinkError> {
        const TICK: Duration = Duration::from_millis(10);
        let mut waited = Duration::ZERO;
        while waited < wait {
            match self.next(TICK)? {
                None | Some(FromDevice::Telemetry(_)) => waited += TICK,
                Some(message) => {
                    if let Some(found) = answer(message) {
                        return Ok(Some(found));
                    }
                }
            }
        }
        Ok(None)
    }

    /// Who is there.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn identity(&mut self) -> Result<Identity, LinkError> {
        self.ask(ToDevice::Identify, |message| match message {
            FromDevice::Identity(identity) => Some(identity),
            _ => None,
        })
    }

    /// The settings in force.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn settings(&mut self) -> Result<SettingsValues, LinkError> {
        self.ask(ToDevice::ReadSettings, |message| match message {
            FromDevice::Settings(values) => Some(values),
            _ => None,
        })
    }

    /// Has the board store `values` and restart with them.
    ///
    /// # Errors
    /// It refuses, or has other ones afterwards.
    pub fn write_settings(&mut self, values: &SettingsValues) -> Result<(), LinkError> {
        let mut told = Written::FlashFailed;
        for _ in 0..3 {
            self.send(&ToDevice::WriteSettings(*values))?;
            let written = self.find(STORE_WAIT, |message| match message {
                FromDevice::Written(written) => Some(written),
                // It has restarted, and the answer was lost.
                FromDevice::Identity(_) => Some(Written::Stored),
                _ => None,
            })?;
            told = written.unwrap_or(told);
            // What counts is what is in force.
            if self.settings()? == *values {
                return Ok(());
            }
            if matches!(told, Written::Armed | Written::Invalid) {
                break;
            }
        }
        Err(LinkError::NotStored(told))
    }

    /// Begins hardware in the loop with a new controller, whatever was before; returns the
    /// telemetry that proves it.
    ///
    /// # Errors
    /// The board is armed, or nobody answers.
    pub fn begin_anew(&mut self) -> Result<Telemetry, LinkError> {
        let mut quiet = Duration::ZERO;
        let mut tick = 0;
        loop {
            if tick % ENTER_EVERY == 0 || !quiet.is_zero() {
                self.send(&ToDevice::Command(Command::LeaveHil))?;
                self.send(&ToDevice::Command(Command::EnterHil))?;
            }
            let Some(told) = self.telemetry_or_give_up(&mut quiet)? else {
                continue;
            };
            tick += 1;
            // The proof: in the loop, and the controller has not ticked yet.
            if told.source == Source::Silence && told.output == Output::default() {
                self.output = told.output;
                return Ok(told);
            }
            if told.source == Source::Pins && tick > ENTER_TICKS_MAX {
                return Err(LinkError::Armed(told.output.mode));
            }
        }
    }

    /// As [`Client::telemetry`]; `quiet` adds up how long there was none.
    fn telemetry_or_give_up(
        &mut self,
        quiet: &mut Duration,
    ) -> Result<Option<Telemetry>, LinkError> {
        let told = self.telemetry(REPEAT_AFTER)?;
        if told.is_some() {
            *quiet = Duration::ZERO;
        } else {
            *quiet += REPEAT_AFTER;
            if *quiet >= self.give_up {
                return Err(LinkError::NoAnswer(quiet.as_secs_f64()));
            }
        }
        Ok(told)
    }

    /// One tick with hardware in the loop: the controller reads `sensors` once, whatever the line
    /// does. Begins hardware in the loop anew where the board has left it.
    ///
    /// # Errors
    /// Nobody answers any more.
    pub fn exchange(&mut self, sensors: &Sensors) -> Result<Answer, LinkError> {
        self.sequence = self.sequence.wrapping_add(1);
        let message = ToDevice::Command(Command::Sensors(SimulatedSensors {
            sequence: self.sequence,
            sensors: *sensors,
        }));
        let mut began_anew = false;
        let mut quiet = Duration::ZERO;
        // Telemetry was missing since the message was sent, and how often it was sent since.
        let mut repeated_since_gap = None;
        self.send(&message)?;
        loop {
            let told = self.telemetry_or_give_up(&mut quiet)?;
            if let Some(told) = told {
                if self.gap_ticks > 0 {
                    repeated_since_gap = repeated_since_gap.or(Some(0));
                }
                match told.source {
                    Source::Link(sequence) if sequence == self.sequence => {
                        return Ok(self.answered(told.output, Some(told), began_anew));
                    }
                    Source::Link(_) => continue,
                    Source::Silence if !self.is_another_controller(&told) => {
                        self.counts.silent_ticks += 1;
                        if let Some(repeated) = repeated_since_gap {
                            // It was read in a tick whose telemetry is lost; silence repeats the
                            // last output.
                            let is_new = told.output != self.output;
                            if is_new || repeated >= REPEATED_WITHOUT_EFFECT {
                                return Ok(self.answered(told.output, None, began_anew));
                            }
                        }
                    }
                    Source::Pins | Source::Silence => {
                        self.begin_anew()?;
                        began_anew = true;
                        repeated_since_gap = None;
                    }
                }
            }
            self.counts.messages_repeated += 1;
            repeated_since_gap = repeated_since_gap.map(|repeated| repeated + 1);
            self.send(&message)?;
        }
    }

    /// A controller that has not ticked, though ours has.
    fn is_another_controller(&self, told: &Telemetry) -> bool {
        told.output == Output::default() && self.output != Output::default()
    }

    fn answered(
        &mut self,
        output: Output,
        telemetry: Option<Telemetry>,
        began_anew: bool,
    ) -> Answer {
        self.output = output;
        Answer {
            output,
            telemetry,
            began_anew,
        }
    }

    /// Ends hardware in the loop; if this is lost, the board's patience ends it.
    ///
    /// # Errors
    /// The port is gone.
    pub fn leave(&mut self) -> Result<(), LinkError> {
        self.send(&ToDevice::Command(Command::LeaveHil))?;
        // An emulated board hears only while time passes.
        self.received.clear();
        self.port.receive(&mut self.received, REPEAT_AFTER)?;
        Ok(())
    }
}
