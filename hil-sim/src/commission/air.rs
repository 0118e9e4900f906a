//! Air under the program's control: trial settings, a play that watches each tick, and the old
//! settings again.

use crate::bench::error::Error;
use crate::bench::port::client::{Client, LinkError, Transport};
use crate::commission::curve::{HOLD_TICKS, LEVELS};
use crate::commission::lift::{Known, TOP_M, WRONG_WAY_M};
use model_core::constants::GRAVITY_M_PER_S2;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::{Source, Telemetry, ToDevice};
use model_core::pressure::GaugePa;
use model_core::settings::SettingsValues;
use model_core::signal::{COUNT_MAX, DacCount};
use model_core::supervisor::{Fault, Mode};

/// Ticks after which a board that has not begun to play is given up: longer than its self-check.
const START_TICKS: usize = 700;
/// Ticks after which a board that vents is given up.
const VENT_TICKS: usize = 1500;
/// Rate of the reference where nothing can move \[Pa/s\].
const FAST_PA_PER_S: f64 = 1e5;
/// Rate of the slow lift \[Pa/s\]: 4 mm/s of the paper's weight.
const SLOW_PA_PER_S: f64 = 5e3;
/// Share of the pressure at which the muscle begins to pull up to which the rate is fast.
const FAST_SHARE: f64 = 0.7;
/// Ticks at the top and at the bottom of a lift: until the weight is at rest.
const REST_TICKS: usize = 100;
/// Travel that ends a play on the plugged hose \[m\].
const PLUGGED_TRAVEL_M: f64 = 1e-3;
/// Highest reference of the staircase over the highest one that is allowed: at that one itself
/// noise would trip the board's force balance.
const TOP_SHARE: f64 = 0.97;
/// Reference of the first level at which the pressure is compared with it \[Pa\].
const FIRST_LOOK_PA: f64 = 5e4;
/// Travel that shows that the encoder lives \[m\].
const SEEN_M: f64 = 3e-4;
const TICK_S: f64 = 0.01;

/// The next request of a play.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Next {
    /// Bring the reference to this pressure \[Pa\].
    To(f64),
    /// The play is over: let the weight down.
    Vent,
}

/// A play of which each tick depends on the ones before.
pub trait Course {
    /// The request after `tick`, which was played.
    fn next(&mut self, tick: &Telemetry) -> Next;
}

/// What a play has given.
#[derive(Clone, Debug, Default)]
pub struct Played {
    /// Its ticks, from the self-check on.
    pub ticks: Vec<Telemetry>,
    /// The fault that has ended it.
    pub fault: Option<Fault>,
    /// The board began to play.
    pub begun: bool,
    /// The course came to its end.
    pub finished: bool,
}

/// `values` with the limits that hold on a supply of `supply_pa`.
pub fn limited(values: SettingsValues, supply_pa: f64) -> SettingsValues {
    let full_scale_pa = values.valve_drive.pressure(DacCount::new(COUNT_MAX)).0;
    let sensor_pa = values.pressure_sensor.ends().1;
    let supply_pa = supply_pa as f32;
    let pressure_pa_max = values
        .pressure_pa_max
        .min(supply_pa)
        .min(full_scale_pa)
        .min(0.88 * sensor_pa);
    SettingsValues {
        supply_pressure_pa: supply_pa,
        pressure_pa_max,
        pressure_trip_pa: values
            .pressure_trip_pa
            .min(0.99 * sensor_pa)
            .max(1.05 * pressure_pa_max),
        play_pressure_pa_max: values.play_pressure_pa_max.min(pressure_pa_max),
        pressure_error_pa_max: values.pressure_error_pa_max.min(0.9 * pressure_pa_max),
        ..values
    }
}

/// Trial settings: with them the weight moves by millimetres and the lever does nothing useful, so
/// that a board that keeps them by accident is safe.
fn trial(values: SettingsValues, travel_m: f64) -> SettingsValues {
    let contraction_max = (travel_m / f64::from(values.muscle.initial_length_m)).max(0.01) as f32;
    SettingsValues {
        play_pressure_pa_max: values.pressure_pa_max,
        contraction_max,
        contraction_trip: 1.5 * contraction_max,
        ..values
    }
}

/// Trial settings for the plugged hose: no weight is on the air, so that neither force nor pressure
/// need to follow.
pub fn plugged(values: SettingsValues) -> SettingsValues {
    let trial = trial(values, PLUGGED_TRAVEL_M);
    let most_n = trial.muscle.force_n(0.0, GaugePa(trial.pressure_pa_max));
    SettingsValues {
        force_error_n_max: 0.999 * (most_n - trial.load_kg * GRAVITY_M_PER_S2 as f32),
        pressure_error_pa_max: 0.95 * trial.pressure_pa_max,
        ..trial
    }
}

/// Trial settings for the slow lift.
pub fn lifting(values: SettingsValues) -> SettingsValues {
    trial(values, TOP_M + 1e-3)
}

/// Listens to `ticks` ticks from the pins.
///
/// # Errors
/// The link fails.
pub fn listen<P: Transport>(
    client: &mut Client<P>,
    ticks: usize,
) -> Result<Vec<Telemetry>, LinkError> {
    // What came while nobody listened is older than the answer to this.
    client.identity()?;
    let mut heard = Vec::new();
    while heard.len() < ticks {
        let tick = client.next_tick()?;
        match tick.source {
            Source::Pins => heard.push(tick),
            _ => client.send(&ToDevice::Command(Command::LeaveHil))?,
        }
    }
    Ok(heard)
}

/// Plays `course` with the settings `trial`, and stores `old` again.
///
/// # Errors
/// The link fails, or the user has stopped the program: then the weight has been let down, and
/// `old` is stored, unless the link fails.
pub fn play<P: Transport>(
    client: &mut Client<P>,
    (trial, old): (&SettingsValues, &SettingsValues),
    course: &mut dyn Course,
) -> Result<Played, Error> {
    let played = client
        .write_settings(trial)
        .and_then(|()| play_on(client, course));
    if matches!(played, Err(LinkError::Stopped)) {
        client.resume();
    }
    if played.is_err() {
        let_down(client)?;
    }
    client.write_settings(old)?;
    Ok(played?)
}

fn request<P: Transport>(client: &mut Client<P>, request: Request) -> Result<(), LinkError> {
    client.send(&ToDevice::Command(Command::Request(request)))
}

fn let_down<P: Transport>(client: &mut Client<P>) -> Result<(), LinkError> {
    for _ in 0..VENT_TICKS {
        request(client, Request::Vent)?;
        if client.next_tick()?.output.pressure_ref.0 <= 0.0 {
            break;
        }
    }
    Ok(())
}

fn play_on<P: Transport>(
    client: &mut Client<P>,
    course: &mut dyn Course,
) -> Result<Played, LinkError> {
    let mut played = Played::default();
    let (mut waited, mut vented) = (0, 0);
    loop {
        let tick = client.next_tick()?;
        played.ticks.push(tick);
        match tick.output.mode {
            Mode::SelfCheck | Mode::Ready if !played.begun => {
                waited += 1;
                if waited > START_TICKS {
                    return Ok(played);
                }
                request(client, Request::Play(0))?;
            }
            Mode::Playing => {
                played.begun = true;
                match course.next(&tick) {
                    Next::To(pa) => request(client, Request::Play(pa.max(0.0).round() as u32))?,
                    Next::Vent => {
                        played.finished = true;
                        request(client, Request::Vent)?;
                    }
                }
            }
            Mode::Venting => {
                played.fault = played.fault.or(tick.output.fault);
                vented += 1;
                if tick.output.pressure_ref.0 <= 0.0 || vented > VENT_TICKS {
                    return Ok(played);
                }
            }
            _ => return Ok(played),
        }
    }
}

/// A staircase on the plugged hose, up to `top_pa` and down.
pub struct Staircase {
    top_pa: f64,
    values: SettingsValues,
    home: Option<Telemetry>,
    level: usize,
    held: usize,
    reference_pa: f64,
    /// The weight has moved.
    pub moved: bool,
}

impl Staircase {
    /// A staircase on a rig with the settings `values`.
    pub fn new(values: &SettingsValues) -> Staircase {
        Staircase {
            top_pa: TOP_SHARE * f64::from(values.pressure_pa_max),
            values: *values,
            home: None,
            level: 0,
            held: 0,
            reference_pa: 0.0,
            moved: false,
        }
    }

    fn level_pa(&self) -> f64 {
        let up = self.level.min(2 * LEVELS - self.level.min(2 * LEVELS));
        self.top_pa * up as f64 / LEVELS as f64
    }
}

impl Course for Staircase {
    fn next(&mut self, tick: &Telemetry) -> Next {
        let home = *self.home.get_or_insert(*tick);
        let counts = tick.sensors.encoder.since(home.sensors.encoder);
        let travel_m = f64::from(counts) * f64::from(self.values.encoder_m_per_count);
        if travel_m.abs() > PLUGGED_TRAVEL_M {
            self.moved = true;
            return Next::Vent;
        }
        let wanted_pa = self.level_pa();
        let step_pa = FAST_PA_PER_S * TICK_S;
        let change_pa = (wanted_pa - self.reference_pa).clamp(-step_pa, step_pa);
        self.reference_pa += change_pa;
        if change_pa == 0.0 {
            self.held += 1;
        }
        if self.held >= HOLD_TICKS {
            let pressure_pa = f64::from(self.values.pressure_sensor.value(tick.sensors.pressure));
            let ratio = pressure_pa / wanted_pa;
            // Without air, or without a hold on it, no more is asked for.
            if wanted_pa > FIRST_LOOK_PA && !(0.3..=1.7).contains(&ratio) {
                return Next::Vent;
            }
            (self.level, self.held) = (self.level + 1, 0);
        }
        match self.level > 2 * LEVELS {
            true => Next::Vent,
            false => Next::To(self.reference_pa),
        }
    }
}

/// A slow lift, up to [`TOP_M`] and down again.
pub struct SlowLift {
    known: Known,
    /// Highest measured pressure \[Pa\].
    limit_pa: f64,
    cycles: usize,
    home: Option<Telemetry>,
    reference_pa: f64,
    rising: bool,
    rest: usize,
}

impl SlowLift {
    /// A lift of `cycles` triangles, in which the pressure stays below `limit_pa`.
    pub fn new(known: &Known, limit_pa: f64, cycles: usize) -> SlowLift {
        SlowLift {
            known: *known,
            limit_pa,
            cycles,
            home: None,
            reference_pa: 0.0,
            rising: true,
            rest: 0,
        }
    }
}

impl Course for SlowLift {
    fn next(&mut self, tick: &Telemetry) -> Next {
        let home = *self.home.get_or_insert(*tick);
        let travel_m = self.known.travel_m(tick, &home);
        let fast_pa = FAST_SHARE * self.known.begins_pa().min(self.known.lifts_pa());
        if travel_m < -WRONG_WAY_M {
            return Next::Vent;
        }
        if self.rest > 0 {
            self.rest -= 1;
            return Next::To(self.reference_pa);
        }
        let pressure_pa = f64::from(
            self.known
                .values
                .pressure_sensor
                .value(tick.sensors.pressure),
        );
        // Once motion is read, the top of the lift is its limit, and this one a reserve.
        let seen = travel_m > SEEN_M;
        let limit_pa = self.limit_pa + if seen { self.known.unseen_pa() } else { 0.0 };
        let beyond = pressure_pa > limit_pa || self.reference_pa > 2.0 * limit_pa;
        if self.rising && (travel_m >= TOP_M || beyond) {
            (self.rising, self.rest) = (false, REST_TICKS);
        }
        let low = travel_m < 0.3 * TOP_M && self.cycles > 1;
        if !self.rising && (low || travel_m <= 0.0 || self.reference_pa < fast_pa) {
            if self.cycles <= 1 || travel_m <= 0.0 {
                return Next::Vent;
            }
            self.cycles -= 1;
            (self.rising, self.rest) = (true, REST_TICKS);
        }
        let rate = match self.rising && self.reference_pa < fast_pa {
            true => 0.2 * FAST_PA_PER_S,
            false => SLOW_PA_PER_S,
        };
        self.reference_pa += if self.rising { rate } else { -rate } * TICK_S;
        Next::To(self.reference_pa)
    }
}
