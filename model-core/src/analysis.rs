//! Analysis of a tick's sensors: which readings are plausible, whether they are consistent, and
//! what the supervisor has to know. It has no effect but on the state that it returns.

use crate::io::{Request, Sensors};
use crate::limits::{
    ADC_VALID, EMPTIED_TICKS, ENCODER_HELD, FLICKER_COUNTS, PRESSURE_PA_MIN, STOP_CONTRACTION,
};
use crate::number::Number;
use crate::plausibility::{Bounds, SensorMonitor, SensorStatus};
use crate::retreat::{Observed, Retreat, may_retreat};
use crate::settings::SettingsValues;
use crate::signal::AdcCount;
use crate::state::{State, limited_pa};
use crate::supervisor::{Fault, Findings, Mode};
use core::ops::RangeInclusive;

/// Limits of plausible readings.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadingLimits {
    /// Plausible counts of the bridge and of the pressure sensor.
    pub adc_valid: RangeInclusive<u16>,
    /// Lowest plausible pressure, gauge \[Pa\].
    pub pressure_pa_min: f32,
    /// Lowest plausible travel of the muscle from home \[m\].
    pub travel_m_min: f32,
    /// Largest change of the finger force in a tick \[N\].
    pub bridge_step_n_max: f32,
    /// Largest change of the pressure in a tick \[Pa\].
    pub pressure_step_pa_max: f32,
    /// Largest travel in a tick \[m\].
    pub encoder_step_m_max: f32,
    /// So many equal readings of an ADC in a row are a standstill; 0: never.
    pub stuck_ticks: u16,
    /// Largest pressure change, off the stop, without a count from the encoder \[Pa\], and largest
    /// change of the muscle's force \[N\].
    pub encoder_stuck_pa: f32,
    /// See `encoder_stuck_pa`.
    pub encoder_held_n: f32,
}

impl ReadingLimits {
    /// The limits that follow from a rig's settings.
    pub fn new(values: &SettingsValues) -> ReadingLimits {
        let (of_weight, of_tolerance) = ENCODER_HELD;
        ReadingLimits {
            adc_valid: ADC_VALID,
            pressure_pa_min: PRESSURE_PA_MIN,
            travel_m_min: -STOP_CONTRACTION * values.muscle.initial_length_m,
            bridge_step_n_max: values.bridge_step_n_max,
            pressure_step_pa_max: values.pressure_step_pa_max,
            encoder_step_m_max: values.encoder_step_m_max,
            stuck_ticks: values.stuck_ticks,
            encoder_stuck_pa: values.encoder_stuck_pa,
            encoder_held_n: (of_weight * values.weight_n())
                .at_least(of_tolerance * values.force_error_n_max),
        }
    }
}

/// The state with the new readings, and the findings for the supervisor.
///
/// The memory's condition is not analysed here: `memory_damaged` is false.
pub fn analyse(
    values: &SettingsValues,
    limits: &ReadingLimits,
    state: &State,
    sensors: &Sensors,
) -> (State, Findings) {
    let (mut next, statuses) = read(values, limits, state, sensors);
    take_experiment_request(&mut next, &statuses, sensors);
    let unready = match state.mode {
        Mode::SelfCheck => check_window(values, &mut next, &statuses, sensors),
        _ => check_rest(values, &mut next),
    };
    check_voltage(values, &mut next, sensors);
    check_consistency(values, &mut next, sensors);
    check_port(values, &mut next, &statuses);
    check_retreat(values, &mut next, &statuses);
    next.missed
        .add_ticks(sensors.missed_ticks.into(), missed_limit(values));
    let findings = findings(values, &next, &statuses, unready, sensors);
    (next, findings)
}

/// Ticks that may be missed: as many as in a row, and as readings may be suspect.
fn missed_limit(values: &SettingsValues) -> u8 {
    values.missed_ticks_max.saturating_add(values.suspect_ticks)
}

/// Ticks since the last one.
fn ticks(sensors: &Sensors) -> u16 {
    u16::from(sensors.missed_ticks).saturating_add(1)
}

/// Status of the bridge, the pressure sensor and the encoder.
type Statuses = [SensorStatus; 3];

/// The state with the new readings, and the sensors' statuses.
fn read(
    values: &SettingsValues,
    limits: &ReadingLimits,
    state: &State,
    sensors: &Sensors,
) -> (State, Statuses) {
    let mut next = *state;
    // Missed ticks widen the bounds of plausible readings, not those of the command.
    let ticks = f32::from(ticks(sensors));
    let bounds = |count: AdcCount, step_max: f32| Bounds {
        out_of_range: !limits.adc_valid.contains(&count.0),
        at_standstill: false,
        step_max,
        stuck_ticks: limits.stuck_ticks,
        suspect_ticks: values.suspect_ticks,
        ticks,
    };
    let (count, bridge_n) = (sensors.bridge, values.bridge.value(sensors.bridge));
    let bridge_bounds = bounds(count, limits.bridge_step_n_max);
    let (bridge, bridge_status) = state.bridge.next(count.0.into(), bridge_n, &bridge_bounds);

    let count = sensors.pressure;
    let pressure_pa = values.pressure_sensor.value(count);
    let mut pressure_bounds = bounds(count, limits.pressure_step_pa_max);
    pressure_bounds.out_of_range |= pressure_pa < limits.pressure_pa_min;
    let (pressure, pressure_status) =
        state
            .pressure
            .next(count.0.into(), pressure_pa, &pressure_bounds);

    let travel = sensors.encoder.since(state.home);
    let travel_m = travel as f32 * values.encoder_m_per_count;
    let moved = sensors.encoder.since(state.moved_to).unsigned_abs() > FLICKER_COUNTS;
    let encoder_bounds = Bounds {
        // Home is not known before the self-check has found it.
        out_of_range: state.mode != Mode::SelfCheck && travel_m < limits.travel_m_min,
        at_standstill: !moved && stands_still(values, limits, state, pressure.value(), travel_m),
        step_max: limits.encoder_step_m_max,
        stuck_ticks: 0,
        suspect_ticks: values.suspect_ticks,
        ticks,
    };
    let (encoder, encoder_status) =
        state
            .encoder
            .next(sensors.encoder.0, travel_m, &encoder_bounds);
    if moved || state.mode == Mode::SelfCheck {
        next.moved_to = sensors.encoder;
        next.moved_at_pa = pressure.value();
        next.moved_at_valve_pa = valve_pa(state, pressure.value());
    }
    // Without a memory of what was commanded, the ramp down begins at what the muscle has. After
    // hardware in the loop, with a fault from before it, the valve was at 0 V and stays there.
    if state.mode == Mode::Venting && !state.pressure.has_begun() && state.fault.is_none() {
        next.pressure_ref_pa = limited_pa(values, pressure.value());
    }
    next.bridge = bridge;
    next.pressure = pressure;
    next.encoder = encoder;
    (next, [bridge_status, pressure_status, encoder_status])
}

/// A pressure \[Pa\], limited to what a sound valve makes of the reference.
fn valve_pa(state: &State, pressure_pa: f32) -> f32 {
    state
        .follower
        .limited_pa(state.pressure_ref_pa, pressure_pa)
}

/// True if the pressure has changed by more than static friction can hold since the encoder moved,
/// as the sensor reads it and as a sound valve makes it: a sensor that is off says nothing about
/// the encoder. What the muscle does not pull with moves nothing: the weight rests on something, as
/// on its stop. There it rests until it is lifted, which the force balance detects; an encoder with
/// play does not return to the same count there.
fn stands_still(
    values: &SettingsValues,
    limits: &ReadingLimits,
    state: &State,
    pressure_pa: f32,
    travel_m: f32,
) -> bool {
    let muscle = &values.muscle;
    let contraction = travel_m / muscle.initial_length_m;
    // A pressure that does not follow its reference says nothing about the encoder.
    if contraction < STOP_CONTRACTION || !state.follower.is_calm() {
        return false;
    }
    let area_m2 = muscle.force_per_pressure_m2(contraction);
    // Below this pressure the muscle does not pull.
    let least_pa = -muscle.gamma_n / area_m2;
    let held_pa = limits
        .encoder_stuck_pa
        .at_most(limits.encoder_held_n / area_m2);
    let has_changed = |from_pa: f32, to_pa: f32| {
        libm::fabsf(to_pa.at_least(least_pa) - from_pa.at_least(least_pa)) > held_pa
    };
    area_m2 > 0.0
        && has_changed(state.moved_at_pa, pressure_pa)
        && has_changed(state.moved_at_valve_pa, valve_pa(state, pressure_pa))
}

/// Takes over an experiment's request. On a suspect reading the pressure may only fall.
fn take_experiment_request(next: &mut State, statuses: &Statuses, sensors: &Sensors) {
    let passed = next.silent_ticks.saturating_add(sensors.missed_ticks);
    next.silent_ticks = passed.saturating_add(1);
    if let Request::Play(pressure_pa) = sensors.request {
        next.played_pa = pressure_pa as f32;
        next.silent_ticks = 0;
    }
    if statuses.contains(&SensorStatus::Suspect) {
        next.played_pa = next.played_pa.at_most(next.pressure_ref_pa);
    }
}

/// Extends the self-check's window of undisturbed ticks or restarts it; returns the disturbance.
fn check_window(
    values: &SettingsValues,
    next: &mut State,
    statuses: &Statuses,
    sensors: &Sensors,
) -> Option<Fault> {
    let bridge_n = next.bridge.value();
    let moved = sensors.encoder.since(next.home).unsigned_abs() > FLICKER_COUNTS;
    let disturbance = if next.pressure.value() > values.vented_pa {
        Some(Fault::NotVented)
    } else if libm::fabsf(bridge_n) > values.tare_n_max {
        Some(Fault::LoadedLever)
    } else if moved || statuses.contains(&SensorStatus::Suspect) {
        Some(Fault::NotStill)
    } else {
        None
    };
    if disturbance.is_some() {
        next.window_ticks = 0;
        next.window_sum_n = 0.0;
        next.home = sensors.encoder;
        next.encoder = SensorMonitor::default();
    } else {
        next.window_ticks = next.window_ticks.saturating_add(1);
        next.window_sum_n += bridge_n;
    }
    disturbance
}

/// Detects whether a muscle that waits for a request has pressure, or has lifted.
fn check_rest(values: &SettingsValues, next: &mut State) -> Option<Fault> {
    let lifted = contraction(values, next) > STOP_CONTRACTION;
    let has_pressure = next.pressure.value() > values.vented_pa;
    let disturbed = next.mode == Mode::Ready && (lifted || has_pressure);
    next.uncommanded.add(disturbed, values.suspect_ticks);
    disturbed.then_some(Fault::Uncommanded)
}

/// Compares the valve's voltage with the one that the last tick has set.
fn check_voltage(values: &SettingsValues, next: &mut State, sensors: &Sensors) {
    let is_right = next.valve.may_be_read_as(sensors.read_back);
    let wrong_ticks = if is_right { 0 } else { ticks(sensors) };
    next.voltage.add_ticks(wrong_ticks, values.suspect_ticks);
}

/// Compares the readings with each other and with the reference.
fn check_consistency(values: &SettingsValues, next: &mut State, sensors: &Sensors) {
    let (pressure_pa, ticks) = (next.pressure.value(), ticks(sensors));
    if next.mode == Mode::SelfCheck {
        (next.follower, next.balance) = Default::default();
        return;
    }
    let reference_pa = next.pressure_ref_pa;
    next.follower = next.follower.next(values, reference_pa, pressure_pa, ticks);
    let contraction = contraction(values, next);
    next.balance = next.balance.next(values, contraction, pressure_pa, ticks);
}

/// Whether the pressure sensor is right, as far as can be known.
fn is_pressure_known(state: &State, status: SensorStatus) -> bool {
    status == SensorStatus::Good && !matches!(state.fault, Some(Fault::Pressure(_)))
}

/// The pressure that the muscle may have at most \[Pa\]: on the ramp down what the sensor tells,
/// limited to what a sound valve makes, as it may be off, and without a sensor that of the slowest
/// valve; otherwise what the sensor tells, too.
fn most_pa(state: &State, status: SensorStatus) -> f32 {
    let read_pa = if is_pressure_known(state, status) {
        state.pressure.value()
    } else {
        f32::MAX
    };
    let valve_pa = valve_pa(state, read_pa);
    match state.mode {
        Mode::Venting => valve_pa,
        _ => valve_pa.at_least(read_pa),
    }
}

/// Closes the port's valve on the ramp down if the pressure does not obey the valve, whatever the
/// reason is that was latched before.
fn check_port(values: &SettingsValues, next: &mut State, statuses: &Statuses) {
    let [_, pressure, _] = *statuses;
    let is_astray = next.follower.has_failed(values) && is_pressure_known(next, pressure);
    if next.mode == Mode::Venting && is_astray {
        next.port_open = false;
    }
}

/// Begins a retreat, or ends one.
fn check_retreat(values: &SettingsValues, next: &mut State, statuses: &Statuses) {
    if matches!(next.mode, Mode::SelfCheck | Mode::Ready) {
        // Nothing was lifted yet.
        next.retreat = Retreat::default();
        return;
    }
    let [_, pressure, encoder] = *statuses;
    let observed = next.balance.motion().map(|motion| Observed {
        motion,
        acceleration_m_per_s2: next.balance.acceleration_m_per_s2(),
        pressure_pa: most_pa(next, pressure),
        reference_pa: next.pressure_ref_pa,
    });
    let is_good = encoder == SensorStatus::Good;
    let is_allowed = may_retreat(next.mode, next.fault) && is_good && next.port_open;
    next.retreat = next.retreat.next(values, observed.as_ref(), is_allowed);
}

/// ε \[-\], from home.
fn contraction(values: &SettingsValues, state: &State) -> f32 {
    state.encoder.value() / values.muscle.initial_length_m
}

fn findings(
    values: &SettingsValues,
    next: &State,
    statuses: &Statuses,
    unready: Option<Fault>,
    sensors: &Sensors,
) -> Findings {
    let [bridge, pressure, encoder] = *statuses;
    let pressure_pa = next.pressure.value();
    let contraction = contraction(values, next);
    let pressure_failed = matches!(next.fault, Some(Fault::Pressure(_)))
        || matches!(pressure, SensorStatus::Failed(_));
    let empty = if pressure_failed {
        next.empty_ticks >= EMPTIED_TICKS
    } else {
        pressure_pa <= values.vented_pa
    };
    Findings {
        bridge,
        pressure,
        encoder,
        contraction,
        request: sensors.request,
        vented: next.pressure_ref_pa == 0.0 && empty,
        unready,
        mode_ticks: next.mode_ticks,
        window_ticks: next.window_ticks,
        silent_ticks: next.silent_ticks,
        awaits_reading: next.awaits_reading,
        latched: next.fault.is_some(),
        memory_damaged: false,
        over_pressure: pressure_pa > values.pressure_trip_pa,
        over_contraction: contraction > values.contraction_trip,
        ticks_missed: sensors.missed_ticks > values.missed_ticks_max
            || next.missed.is_full(missed_limit(values)),
        uncommanded: next.uncommanded.is_full(values.suspect_ticks),
        voltage_astray: next.voltage.is_full(values.suspect_ticks),
        pressure_astray: next.follower.has_failed(values),
        too_fast: next.balance.is_too_fast(),
        // A light weight that something carries is within the balance's tolerance.
        force_astray: next.balance.has_failed(values) || next.retreat.rests_on_something(),
    }
}
