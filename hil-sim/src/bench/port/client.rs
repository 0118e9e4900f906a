//! The client of a board's serial link (docs/link.md): queries, settings, and hardware in the loop
//! tick by tick, over a line that may lose, damage and repeat bytes, or be unplugged.
//!
//! A [`Transport`] moves bytes and may lose them; the client detects and repairs the losses. Time
//! is the board's: on an emulated board it passes only while the PC waits.

use model_core::device::{Command, SimulatedSensors};
use model_core::io::{Output, Sensors};
use model_core::link::{
    Author, Change, Decoder, FRAME_LEN_MAX, FromDevice, Identity, Signature, Source, Telemetry,
    ToDevice, Written, encode,
};
use model_core::settings::SettingsValues;
use model_core::supervisor::Mode;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Time without telemetry after which a message is sent again.
const REPEAT_AFTER: Duration = Duration::from_millis(30);
/// Time to wait for an answer before a query is sent again.
const ANSWER_WAIT: Duration = Duration::from_millis(250);
/// How often a query is sent.
const QUERIES: usize = 20;
/// Time to wait for the answer when settings are stored: erasing a sector takes up to 4 s.
const STORE_WAIT: Duration = Duration::from_secs(6);
/// Telemetry messages between two attempts to enter hardware in the loop.
const ENTER_EVERY: usize = 4;
/// Ticks after which a board that still reads its pins is taken to refuse hardware in the loop.
const ENTER_TICKS_MAX: usize = 100;
/// Number of repeated messages without effect after which the first one must have been received.
const REPEATED_WITHOUT_EFFECT: usize = 20;
/// Telemetry that is older than the last one by up to so many ticks is an echo of the line; if it
/// is older still, the board has been reset.
const ECHO_TICKS: i32 = 16;

/// The transport has failed permanently. A serial port that may come back does not fail.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct TransportError(pub String);

/// Moves bytes to and from a board.
pub trait Transport {
    /// Sends bytes; bytes that cannot be sent are lost.
    ///
    /// # Errors
    /// The transport has failed permanently.
    fn send(&mut self, bytes: &[u8]) -> Result<(), TransportError>;

    /// Waits at most `wait` for bytes, appends them to `received`, and returns the time that has
    /// passed on the board's clock.
    ///
    /// # Errors
    /// The transport has failed permanently.
    fn receive(
        &mut self,
        received: &mut Vec<u8>,
        wait: Duration,
    ) -> Result<Duration, TransportError>;

    /// Lines that the board has logged and events of the transport since the last call.
    fn take_log(&mut self) -> Vec<String> {
        Vec::new()
    }
}

impl Transport for Box<dyn Transport + Send> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), TransportError> {
        (**self).send(bytes)
    }

    fn receive(
        &mut self,
        received: &mut Vec<u8>,
        wait: Duration,
    ) -> Result<Duration, TransportError> {
        (**self).receive(received, wait)
    }

    fn take_log(&mut self) -> Vec<String> {
        (**self).take_log()
    }
}

/// Why the board did not do what it was asked for.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The transport has failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// No valid answer.
    #[error("no answer from the board for {0:.0} s")]
    NoAnswer(f64),
    /// The board is assisting, holding, or letting the weight down.
    #[error("the board is armed (mode {0}): vent it first")]
    Armed(Mode),
    /// Nobody has held the button.
    #[error(
        "the board has not stored the settings, as they change its safety block and its button was \
         not held for 2 s while the lamp flickered: run it again, and hold the button"
    )]
    NotConfirmed,
    /// The board did not store the settings.
    #[error("the board has not stored the settings: {0:?}")]
    NotStored(Written),
    /// The user has stopped the program.
    #[error("stopped")]
    Stopped,
}

/// Errors on the line.
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

/// The board's answer to one tick with hardware in the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// The controller's output.
    pub output: Output,
    /// The tick's telemetry; none if it was lost and only the output could be obtained later.
    pub telemetry: Option<Telemetry>,
    /// The controller has restarted before this tick: after a reset, or half a second of silence.
    pub restarted: bool,
}

/// What a person has to do for [`Client::write_settings`].
const HOLD_BUTTON: &str = "These settings change the board's safety block. Hold the board's button \
                           for 2 s while its lamp flickers: it waits for 30 s.";
/// Time for that: the board's, and a second more.
const CONFIRM_WAIT: Duration = Duration::from_secs(31);

fn written(message: FromDevice) -> Option<Written> {
    match message {
        FromDevice::Written(written) => Some(written),
        // The board has restarted, and its answer was lost.
        FromDevice::Identity(_) => Some(Written::Stored),
        _ => None,
    }
}

fn written_at_last(message: FromDevice) -> Option<Written> {
    written(message).filter(|written| *written != Written::AwaitsButton)
}

/// The first bytes of a name, for [`Client::with_person`].
pub fn author(name: &str) -> Author {
    let mut end = name.len().min(Author::default().len());
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    let mut author = Author::default();
    author[..end].copy_from_slice(&name.as_bytes()[..end]);
    author
}

/// The client of one board.
pub struct Client<P> {
    transport: P,
    decoder: Decoder,
    received: Vec<u8>,
    pending: VecDeque<FromDevice>,
    last_tick: Option<u32>,
    /// Number of ticks without telemetry before the last one.
    gap_ticks: u32,
    sequence: u32,
    /// The last output of a controller in the loop.
    output: Output,
    counts: LinkCounts,
    give_up: Duration,
    stop: Arc<AtomicBool>,
    /// Who changes settings.
    author: Author,
    /// Tells a person what to do at the board.
    tell: fn(&str),
}

impl<P: Transport> Client<P> {
    /// A client that fails after the time `give_up` without any telemetry, or once `stop` is set.
    pub fn new(transport: P, give_up: Duration, stop: Arc<AtomicBool>) -> Client<P> {
        Client {
            transport,
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
            author: author("hil-sim"),
            tell: |_| {},
        }
    }

    /// The client with the name of who changes settings, and with a way to tell a person what to do
    /// at the board.
    pub fn with_person(mut self, name: &str, tell: fn(&str)) -> Client<P> {
        (self.author, self.tell) = (author(name), tell);
        self
    }

    /// Errors on the line so far.
    pub fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// See [`Transport::take_log`].
    pub fn take_log(&mut self) -> Vec<String> {
        self.transport.take_log()
    }

    /// Goes on after [`LinkError::Stopped`], to leave the board in a safe state.
    pub fn resume(&mut self) {
        self.stop.store(false, Ordering::Relaxed);
    }

    /// Sends a message.
    ///
    /// # Errors
    /// The transport has failed.
    pub fn send(&mut self, message: &ToDevice) -> Result<(), LinkError> {
        let mut buffer = [0; FRAME_LEN_MAX];
        // Every message fits, which model-core tests.
        let frame = encode(message, &mut buffer).unwrap_or_default();
        // The leading zero ends the rest of a broken frame.
        let bytes = [&[0], frame].concat();
        Ok(self.transport.send(&bytes)?)
    }

    /// The next message; none if none comes within `wait`.
    ///
    /// # Errors
    /// The transport has failed, or the user has stopped the program.
    pub fn next(&mut self, wait: Duration) -> Result<Option<FromDevice>, LinkError> {
        let mut waited = Duration::ZERO;
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Err(LinkError::Stopped);
            }
            while let Some(message) = self.pending.pop_front() {
                if self.is_new(&message) {
                    return Ok(Some(message));
                }
            }
            if waited >= wait {
                return Ok(None);
            }
            self.received.clear();
            waited += self.transport.receive(&mut self.received, wait - waited)?;
            for byte in &self.received {
                match self.decoder.push(*byte) {
                    Some(Ok(message)) => self.pending.push_back(message),
                    Some(Err(_)) => self.counts.frames_rejected += 1,
                    None => {}
                }
            }
        }
    }

    /// False for telemetry that the line has repeated. Counts missing telemetry.
    fn is_new(&mut self, message: &FromDevice) -> bool {
        let FromDevice::Telemetry(telemetry) = message else {
            return true;
        };
        let ahead = self
            .last_tick
            .map_or(1, |last| telemetry.tick.wrapping_sub(last) as i32);
        if (-ECHO_TICKS..=0).contains(&ahead) {
            return false;
        }
        // If it is behind, the board has been reset, and the number of lost ticks is unknown.
        self.gap_ticks = if ahead > 0 { ahead as u32 - 1 } else { 0 };
        self.counts.telemetry_lost += u64::from(self.gap_ticks);
        self.last_tick = Some(telemetry.tick);
        true
    }

    /// The next telemetry; none if none comes within `wait`. Other messages are dropped.
    fn telemetry(&mut self, wait: Duration) -> Result<Option<Telemetry>, LinkError> {
        loop {
            match self.next(wait)? {
                Some(FromDevice::Telemetry(telemetry)) => return Ok(Some(telemetry)),
                Some(_) => {}
                None => return Ok(None),
            }
        }
    }

    fn ask<T>(
        &mut self,
        query: ToDevice,
        answer: fn(FromDevice) -> Option<T>,
    ) -> Result<T, LinkError> {
        for _ in 0..QUERIES {
            self.send(&query)?;
            if let Some(found) = self.find(ANSWER_WAIT, answer)? {
                return Ok(found);
            }
        }
        let waited = ANSWER_WAIT * QUERIES as u32;
        Err(LinkError::NoAnswer(waited.as_secs_f64()))
    }

    /// The first message of a kind within the time `wait`, which telemetry and silence measure.
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

    /// The board's identity.
    ///
    /// # Errors
    /// The board does not answer.
    pub fn identity(&mut self) -> Result<Identity, LinkError> {
        self.ask(ToDevice::Identify, |message| match message {
            FromDevice::Identity(identity) => Some(identity),
            _ => None,
        })
    }

    /// The settings in force.
    ///
    /// # Errors
    /// The board does not answer.
    pub fn settings(&mut self) -> Result<SettingsValues, LinkError> {
        self.ask(ToDevice::ReadSettings, |message| match message {
            FromDevice::Settings(values) => Some(values),
            _ => None,
        })
    }

    /// Stores `values` on the board, which restarts with them.
    ///
    /// # Errors
    /// The board refuses, or has other settings afterwards.
    pub fn write_settings(&mut self, values: &SettingsValues) -> Result<(), LinkError> {
        let mut result = Written::FlashFailed;
        for _ in 0..3 {
            self.send(&ToDevice::Sign(self.signature()))?;
            self.send(&ToDevice::WriteSettings(*values))?;
            let mut written = self.find(STORE_WAIT, written)?;
            if written == Some(Written::AwaitsButton) {
                (self.tell)(HOLD_BUTTON);
                written = self.find(CONFIRM_WAIT, written_at_last)?;
            }
            result = written.unwrap_or(result);
            // The settings in force decide.
            if self.settings()? == *values {
                return Ok(());
            }
            match result {
                Written::NotConfirmed | Written::AwaitsButton => {
                    return Err(LinkError::NotConfirmed);
                }
                Written::Armed | Written::Invalid => break,
                Written::Stored | Written::FlashFailed => {}
            }
        }
        Err(LinkError::NotStored(result))
    }

    /// The settings so many changes before those in force, with who has changed them and when; none
    /// if the board does not have them any more.
    ///
    /// # Errors
    /// The board does not answer.
    pub fn change(&mut self, back: u16) -> Result<Option<Change>, LinkError> {
        self.ask(ToDevice::ReadChange(back), |message| match message {
            FromDevice::Change(change) => Some(change),
            _ => None,
        })
    }

    fn signature(&self) -> Signature {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        Signature {
            utc_s: now.map_or(0, |time| time.as_secs() as u32),
            author: self.author,
            is_confirmed: false,
        }
    }

    /// Enters hardware in the loop with a restarted controller, whatever the state before; returns
    /// the telemetry that confirms it.
    ///
    /// # Errors
    /// The board is armed, or does not answer.
    pub fn restart_in_loop(&mut self) -> Result<Telemetry, LinkError> {
        let mut quiet = Duration::ZERO;
        let mut tick = 0;
        loop {
            if tick % ENTER_EVERY == 0 || !quiet.is_zero() {
                self.send(&ToDevice::Command(Command::LeaveHil))?;
                self.send(&ToDevice::Command(Command::EnterHil))?;
            }
            let Some(telemetry) = self.telemetry_or_give_up(&mut quiet)? else {
                continue;
            };
            tick += 1;
            // In the loop, and the controller has not ticked yet.
            if telemetry.source == Source::Silence && telemetry.output == Output::default() {
                self.output = telemetry.output;
                return Ok(telemetry);
            }
            if telemetry.source == Source::Pins && tick > ENTER_TICKS_MAX {
                return Err(LinkError::Armed(telemetry.output.mode));
            }
        }
    }

    /// The telemetry of the next tick. Other messages are dropped.
    ///
    /// # Errors
    /// None comes for the time after which the client gives up.
    pub fn next_tick(&mut self) -> Result<Telemetry, LinkError> {
        let mut quiet = Duration::ZERO;
        loop {
            if let Some(telemetry) = self.telemetry_or_give_up(&mut quiet)? {
                return Ok(telemetry);
            }
        }
    }

    /// As [`Client::telemetry`]; `quiet` is the time since the last telemetry.
    fn telemetry_or_give_up(
        &mut self,
        quiet: &mut Duration,
    ) -> Result<Option<Telemetry>, LinkError> {
        let telemetry = self.telemetry(REPEAT_AFTER)?;
        if telemetry.is_some() {
            *quiet = Duration::ZERO;
        } else {
            *quiet += REPEAT_AFTER;
            if *quiet >= self.give_up {
                return Err(LinkError::NoAnswer(quiet.as_secs_f64()));
            }
        }
        Ok(telemetry)
    }

    /// One tick with hardware in the loop: the controller reads `sensors` exactly once, whatever
    /// the line loses or repeats. Enters hardware in the loop again if the board has left it.
    ///
    /// # Errors
    /// The board no longer answers.
    pub fn exchange(&mut self, sensors: &Sensors) -> Result<Answer, LinkError> {
        self.sequence = self.sequence.wrapping_add(1);
        let message = ToDevice::Command(Command::Sensors(SimulatedSensors {
            sequence: self.sequence,
            sensors: *sensors,
        }));
        let mut restarted = false;
        let mut quiet = Duration::ZERO;
        // If telemetry was lost since the message was sent: how often it was sent since then.
        let mut repeated_since_gap = None;
        self.send(&message)?;
        loop {
            if let Some(telemetry) = self.telemetry_or_give_up(&mut quiet)? {
                if self.gap_ticks > 0 {
                    repeated_since_gap = repeated_since_gap.or(Some(0));
                }
                match telemetry.source {
                    Source::Link(sequence) if sequence == self.sequence => {
                        let output = telemetry.output;
                        return Ok(self.answered(output, Some(telemetry), restarted));
                    }
                    Source::Link(_) => continue,
                    Source::Silence if !self.has_restarted(&telemetry) => {
                        self.counts.silent_ticks += 1;
                        if let Some(repeated) = repeated_since_gap {
                            // The message was read in a tick whose telemetry is lost; telemetry of
                            // silence repeats the last output.
                            let is_new = telemetry.output != self.output;
                            if is_new || repeated >= REPEATED_WITHOUT_EFFECT {
                                return Ok(self.answered(telemetry.output, None, restarted));
                            }
                        }
                    }
                    Source::Pins | Source::Silence => {
                        self.restart_in_loop()?;
                        restarted = true;
                        repeated_since_gap = None;
                    }
                }
            }
            self.counts.messages_repeated += 1;
            repeated_since_gap = repeated_since_gap.map(|repeated| repeated + 1);
            self.send(&message)?;
        }
    }

    /// True if the controller has not ticked since its start, though it had ticked before.
    fn has_restarted(&self, telemetry: &Telemetry) -> bool {
        telemetry.output == Output::default() && self.output != Output::default()
    }

    fn answered(
        &mut self,
        output: Output,
        telemetry: Option<Telemetry>,
        restarted: bool,
    ) -> Answer {
        self.output = output;
        Answer {
            output,
            telemetry,
            restarted,
        }
    }

    /// Leaves hardware in the loop; if the message is lost, the board leaves it after a timeout.
    ///
    /// # Errors
    /// The transport has failed.
    pub fn leave(&mut self) -> Result<(), LinkError> {
        self.send(&ToDevice::Command(Command::LeaveHil))?;
        // An emulated board receives only while time passes.
        self.received.clear();
        self.transport.receive(&mut self.received, REPEAT_AFTER)?;
        Ok(())
    }
}
