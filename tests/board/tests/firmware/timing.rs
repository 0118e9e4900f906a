//! Period, jitter and duration of the tick.

use crate::budget::instructions_max;
use crate::rig::{MS, Rig, TICK_EXCEPTION, TICK_NS};
use emulated_board::{Cost, ExceptionEvent};
use model_core::link::{Decoder, FromDevice, ToDevice};

/// Control register of TIM2, which starts the conversions.
const TIM2_CR1: u32 = 0x4000_0000;
/// Control and event generation of TIM3, the link task's timer.
const TIM3_CR1: u32 = 0x4000_0400;
const TIM3_EGR: u32 = 0x4000_0414;
/// Exception number of the link's task.
const LINK_EXCEPTION: usize = 16 + 29;

/// One run of an exception's handler.
pub struct HandlerRun {
    /// Time of the entry.
    pub time_ns: u64,
    /// Time from entry to return.
    pub duration_ns: u64,
    /// Instructions from entry to return.
    pub instructions: u64,
    /// What they take at most.
    pub cost: Cost,
}

/// Runs of the handler of `exception` in `events`, which may begin and end within one; such a run
/// is left out. Includes what preempts them.
pub fn runs(events: &[ExceptionEvent], exception: usize) -> Vec<HandlerRun> {
    let of_handler: Vec<_> = events
        .iter()
        .filter(|e| e.exception == exception)
        .skip_while(|e| !e.entered)
        .collect();
    of_handler
        .chunks_exact(2)
        .map(|pair| HandlerRun {
            time_ns: pair[0].time_ns,
            duration_ns: pair[1].time_ns - pair[0].time_ns,
            instructions: pair[1].instructions - pair[0].instructions,
            cost: pair[1].cost.since(&pair[0].cost),
        })
        .collect()
}

/// Runs of the tick in `events`.
pub fn ticks(events: &[ExceptionEvent]) -> Vec<HandlerRun> {
    runs(events, TICK_EXCEPTION)
}

/// Spread of the ticks relative to a grid of 10 ms.
fn jitter_ns(ticks: &[HandlerRun]) -> u64 {
    let offsets = ticks
        .iter()
        .zip(0..)
        .map(|(tick, n)| tick.time_ns - n * TICK_NS);
    let (low, high) = offsets.fold((u64::MAX, 0), |(low, high), o| (low.min(o), high.max(o)));
    high - low
}

/// Ticks in two seconds; calls `each_ms` every millisecond.
fn record_ticks(rig: &mut Rig, mut each_ms: impl FnMut(&mut Rig, u64)) -> Vec<HandlerRun> {
    rig.board.trace_exceptions(true);
    for ms in 0..2_000 {
        each_ms(rig, ms);
        rig.run_ms(1);
    }
    ticks(&rig.board.exceptions())
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn ticks_have_a_period_of_10_ms_and_take_less_than_one_percent() {
    let mut rig = Rig::after_ms(15);
    let ticks = record_ticks(&mut rig, |_, _| {});
    assert_eq!(ticks.len(), 200);
    let jitter_ns = jitter_ns(&ticks);
    let longest = ticks.iter().map(|t| t.instructions).max().unwrap_or(0);
    println!("jitter {jitter_ns} ns, longest tick {longest} instructions");
    assert!(jitter_ns < 100, "{jitter_ns} ns");
    assert!(
        longest < instructions_max(&rig),
        "{longest} instructions are more than 1 % of 10 ms"
    );
    let telemetry = rig.telemetry();
    assert!(telemetry.iter().all(|t| t.timing.missed_ticks == 0));
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn telemetry_reports_jitter_and_duration_within_the_same_bounds() {
    let mut rig = Rig::after_ms(500);
    let allowed = instructions_max(&rig) as u32;
    for telemetry in rig.telemetry() {
        // A microsecond.
        assert!(
            telemetry.timing.late_cycles < allowed / 100,
            "{:?}",
            telemetry.timing
        );
        // The first tick has none before it. The others take a thousand instructions at least.
        assert!(
            telemetry.tick == 1 || telemetry.timing.busy_cycles > 1_000,
            "{:?}",
            telemetry.timing
        );
        assert!(
            telemetry.timing.busy_cycles < allowed,
            "{:?}",
            telemetry.timing
        );
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn flooding_the_link_delays_no_tick() {
    let mut rig = Rig::after_ms(15);
    let mut seed = 1_u64;
    let flood = |rig: &mut Rig, ms: u64| {
        // the full rate is 93 bytes per millisecond: half noise, half requests
        while rig.board.link_unsent() < 200 {
            let noise: Vec<u8> = (0..40).map(|_| next(&mut seed)).collect();
            rig.board.link_send(&noise);
            rig.board.link_send(&[0]);
            rig.send(&if ms.is_multiple_of(2) {
                ToDevice::Identify
            } else {
                ToDevice::ReadSettings
            });
        }
    };
    let ticks = record_ticks(&mut rig, flood);
    let jitter_ns = jitter_ns(&ticks);
    let longest = ticks.iter().map(|t| t.instructions).max().unwrap_or(0);
    println!("jitter {jitter_ns} ns, longest tick {longest} instructions");
    assert_eq!(ticks.len(), 200);
    assert!(jitter_ns < 2_000, "{jitter_ns} ns");
    rig.run_ms(50);
    rig.telemetry();
    let last = rig.last_telemetry();
    assert_eq!((last.timing.missed_ticks, last.output.fault), (0, None));
    assert!(rig.identity().frames_rejected > 100);
    rig.assert_no_errors();
}

/// The largest values are those that the telemetry has had, and the load is the bytes counted here.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn telemetry_reports_the_worst_tick_and_the_load_of_the_link() {
    let mut rig = Rig::after_ms(15);
    rig.board.link_receive();
    let mut seen = vec![];
    let mut bytes = 0;
    let mut decoder = Decoder::new();
    for _ in 0..3_000 {
        rig.run_ms(1);
        for received in rig.board.link_receive() {
            bytes += 1;
            if let Some(Ok(FromDevice::Telemetry(telemetry))) = decoder.push(received.byte) {
                seen.push(telemetry.timing);
            }
        }
    }
    let last = seen.last().expect("telemetry");
    assert_eq!(
        Some(last.busy_cycles_max),
        seen.iter().map(|t| t.busy_cycles).max()
    );
    assert_eq!(
        Some(last.late_cycles_max),
        seen.iter().map(|t| t.late_cycles).max()
    );
    assert!(
        last.busy_cycles_max > last.busy_cycles,
        "the first tick is longer"
    );
    // 92 160 bytes a second. Lengths of frames vary by a byte or two.
    let counted = bytes as f64 / 3.0 / 92.16;
    let off = f64::from(last.link_per_mille) - counted;
    assert!(
        off.abs() < 2.0,
        "{} of 1000, counted {counted}",
        last.link_per_mille
    );
    // The busier direction counts.
    for _ in 0..2_100 {
        rig.board.link_send(&[1; 46]);
        rig.run_ms(1);
    }
    let load = rig.last_telemetry().timing.link_per_mille;
    assert!((495..=500).contains(&load), "{load}");
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn telemetry_of_every_tick_arrives_within_four_milliseconds() {
    let mut rig = Rig::after_ms(15);
    rig.messages();
    rig.board.trace_exceptions(true);
    rig.run_ms(1_000);
    let ticks = ticks(&rig.board.exceptions());
    let telemetry = rig.messages();
    // The first tick and its telemetry are over after 5 ms, and the others follow every 10 ms: none
    // is under way at 15 ms or a second later.
    assert_eq!((ticks.len(), telemetry.len()), (100, 100));
    for (tick, (time_ns, _)) in ticks.iter().zip(telemetry) {
        let delay_ns = time_ns.saturating_sub(tick.time_ns);
        assert!((1..4 * MS).contains(&delay_ns), "{delay_ns} ns");
    }
}

/// The next pseudo-random byte (xorshift).
fn next(seed: &mut u64) -> u8 {
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    *seed as u8
}

/// The core sleeps meanwhile: the clock by which the ticks are judged must not.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn ticks_that_never_started_are_counted() {
    let mut rig = Rig::after_ms(500);
    let tick_ns = rig.next_tick_ns();
    rig.board.run_until(tick_ns + MS);
    rig.telemetry();
    rig.board.write_register(TIM2_CR1, 0);
    rig.board.run_for(30 * MS);
    rig.board.write_register(TIM2_CR1, 1);
    rig.run_ms(20);
    let telemetry = rig.telemetry();
    let missed = telemetry.iter().map(|t| t.timing.missed_ticks).max();
    assert_eq!(missed, Some(3));
    let last = telemetry.last().expect("telemetry").timing;
    assert_eq!((last.missed_ticks, last.missed_ticks_total), (0, 3));
}

/// Ticks that began within the link's task, and the spread of all ticks \[ns\], with the task at
/// many phases of the tick. TIM3 requests it at a fixed phase, which is chance on a real board.
pub fn spread_over_phases() -> (usize, u64) {
    let mut rig = Rig::after_ms(15);
    let mut overlapped = 0;
    let mut starts = vec![];
    for step in 0..60 {
        let tick_ns = rig.next_tick_ns();
        // The task waits until it has much to do.
        rig.board.run_until(tick_ns - MS);
        let running = rig.board.read_register(TIM3_CR1);
        rig.board.write_register(TIM3_CR1, 0);
        rig.send(&ToDevice::ReadSettings);
        rig.send(&ToDevice::Identify);
        rig.board.run_until(tick_ns - 2_000 - step * 1_000);
        rig.board.exceptions();
        rig.board.trace_exceptions(true);
        rig.board.write_register(TIM3_EGR, 1);
        rig.board.write_register(TIM3_CR1, running);
        rig.board.run_for(MS);
        let events = rig.board.exceptions();
        let entered = |exception| {
            let event = events
                .iter()
                .find(|e| e.entered && e.exception == exception);
            event.map(|e| e.time_ns)
        };
        let link_left = events
            .iter()
            .find(|e| !e.entered && e.exception == LINK_EXCEPTION)
            .map(|e| e.time_ns);
        let tick = entered(TICK_EXCEPTION).expect("a tick");
        let link = entered(LINK_EXCEPTION).expect("the link's task");
        overlapped += usize::from(link < tick && Some(tick) < link_left);
        starts.push(tick % TICK_NS);
    }
    let spread_ns = starts
        .iter()
        .max()
        .zip(starts.iter().min())
        .map(|(a, b)| a - b);
    (overlapped, spread_ns.expect("ticks"))
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn link_task_delays_no_tick_whatever_its_phase() {
    let (overlapped, spread_ns) = spread_over_phases();
    println!("{overlapped} ticks within the link's task, spread {spread_ns} ns");
    assert!(overlapped > 0);
    // A tick waits at most for a critical section of the queues.
    assert!(spread_ns < 1_000, "{spread_ns} ns");
}
