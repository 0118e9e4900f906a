//! Use of the stack and of the tick period; scripts/budget.sh prints the output of this test.

use crate::rig::{MS, Rig};
use crate::timing::{HandlerRun, spread_over_phases, ticks};
use emulated_board::Cost;
use model_core::compensation::Compensation;
use model_core::device::{Command, SimulatedSensors};
use model_core::io::{Request, Sensors};
use model_core::link::ToDevice;
use model_core::sampling::SCANS;
use model_core::settings::SettingsValues;
use model_core::supervisor::Mode;

/// 1 % of 10 ms, at the clock of the board; an instruction takes at least one cycle.
pub fn instructions_max(rig: &Rig) -> u64 {
    rig.board.core_clock_hz() / 100 / 100
}
/// Access control register of the flash, whose lowest field is the count of wait states.
const FLASH_ACR: u32 = 0x4002_3c00;
/// Entry and exit of an exception with the floating-point registers (Arm 100166, 3.9.1): 12 cycles
/// and 17 words, each way.
const EXCEPTION_CYCLES: u64 = 2 * (12 + 17);
/// What the DMA keeps the core from: three cycles for each of its transfers within a scan's period:
/// four conversions, and the bytes of the link, 93 a millisecond each way.
const DMA_CYCLES: u64 = 3 * (4 + 2 * 93);
/// Pattern with which cortex-m-rt fills the stack.
const PAINT: [u8; 4] = [0xCC; 4];

/// Size of the stack, and the maximum used since the reset or the last repaint \[bytes\].
pub fn stack(rig: &Rig) -> (usize, usize) {
    let symbol = |name| rig.board.symbol(name).expect("a symbol of memory.x");
    let (low, high) = (symbol("_stack_end"), symbol("_stack_start"));
    let size = (high - low) as usize;
    let bytes = rig.board.read_memory(low, size);
    let free = bytes.chunks(4).take_while(|word| **word == PAINT).count();
    (size, size - 4 * free)
}

/// Fills the free part of the stack with the pattern, which restarts the measurement.
fn repaint(rig: &mut Rig) {
    let low = rig
        .board
        .symbol("_stack_end")
        .expect("a symbol of memory.x");
    let free = (rig.board.sp() - low) as usize / PAINT.len();
    rig.board.write_ram(low, &PAINT.repeat(free));
}

/// Causes log entries, rejected settings, requests of all kinds, and more simulated sensor messages
/// than a tick can use, most of them outdated.
fn keep_busy(rig: &mut Rig) {
    let invalid = SettingsValues {
        gain: f32::NAN,
        ..SettingsValues::reference()
    };
    rig.send(&ToDevice::WriteSettings(invalid));
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(100);
    rig.board.set_encoder(1 << 20);
    rig.run_ms(2_000);
    rig.send(&ToDevice::Command(Command::Request(Request::Reset)));
    rig.run_ms(1_000);
    let sensors = |sequence| {
        ToDevice::Command(Command::Sensors(SimulatedSensors {
            sequence,
            sensors: Sensors::default(),
        }))
    };
    rig.send(&ToDevice::Command(Command::EnterHil));
    for round in 1..100 {
        rig.send(&sensors(round));
        for _ in 0..14 {
            rig.send(&sensors(round / 2));
        }
        rig.send(&ToDevice::Identify);
        rig.send(&ToDevice::ReadSettings);
        rig.run_ms(10);
    }
}

/// All parts of the compensation, with typical values.
const COMPENSATION: Compensation = Compensation {
    hysteresis_area_m2: 6e-5,
    hysteresis_reach: 0.03,
    friction_n: 8.0,
    friction_reach_m: 1e-3,
    payload_kg: 1.0,
    force_n_max: 40.0,
    lead_s: 0.02,
    dead_zone_filling_pa: 8e3,
    dead_zone_exhausting_pa: 8e3,
    pressure_pa_max: 5e4,
};

/// Of ticks: the most instructions, and the most cycles on a real core.
#[derive(Clone, Copy)]
struct Longest {
    instructions: u64,
    cycles: u64,
    /// The counts of those cycles.
    cost: Cost,
}

/// Of the exceptions recorded since the last call.
fn longest(rig: &mut Rig) -> Longest {
    let wait_states = wait_states(rig);
    let ticks = ticks(&rig.board.exceptions());
    let cycles = |tick: &&HandlerRun| tick.cost.cycles(wait_states);
    let slowest = ticks.iter().max_by_key(cycles).expect("ticks");
    Longest {
        instructions: ticks.iter().map(|t| t.instructions).max().expect("ticks"),
        cycles: slowest.cost.cycles(wait_states) + EXCEPTION_CYCLES + DMA_CYCLES,
        cost: slowest.cost,
    }
}

fn wait_states(rig: &mut Rig) -> u64 {
    let wait_states = u64::from(rig.board.read_register(FLASH_ACR) & 0xf);
    assert!(wait_states > 0);
    wait_states
}

/// The longest ticks while assisting at rest with a vented muscle, which evaluates Eq 8.
fn assisting(compensation: Compensation) -> Longest {
    let mut rig = Rig::after_ms(15);
    let values = SettingsValues {
        compensation,
        ..SettingsValues::reference()
    };
    rig.store(values);
    rig.run_ms(1_500);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(100);
    rig.board.exceptions();
    rig.board.count_loads();
    rig.board.trace_exceptions(true);
    rig.run_ms(1_000);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
    rig.assert_no_errors();
    longest(&mut rig)
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn tick_and_stack_are_within_their_budgets() {
    let mut rig = Rig::after_ms(15);
    let allowed = instructions_max(&rig);
    // Interrupts are masked during start-up: no task adds to the stack.
    let started = stack(&rig).1;
    repaint(&mut rig);
    rig.board.count_loads();
    rig.board.trace_exceptions(true);
    rig.run_ms(1_000);
    let idle = longest(&mut rig).instructions;
    keep_busy(&mut rig);
    let loaded = longest(&mut rig);
    let busy = loaded.instructions;
    println!(
        "tick   {idle:6} of {allowed:6} instructions: {:.3} % of 10 ms at {} MHz; \
         {busy} under maximum load of the link",
        idle as f64 / allowed as f64,
        allowed / 100
    );
    assert!(idle < busy && busy < allowed);
    let [plain, compensating] = [Compensation::OFF, COMPENSATION].map(assisting);
    let compensated = compensating.instructions;
    println!(
        "tick   {:6} instructions assisting, {compensated} with every compensation",
        plain.instructions
    );
    assert!(compensated < allowed);

    // On a real core the tick must end before the next scan begins.
    let slowest = if loaded.cycles > compensating.cycles {
        loaded
    } else {
        compensating
    };
    println!(
        "tick   {:6} cycles at most on a real core: {:.1} % of 10 ms; {:?}",
        slowest.cycles,
        slowest.cycles as f64 / allowed as f64,
        slowest.cost
    );
    assert!(slowest.cycles > busy && slowest.cycles < 100 * allowed / SCANS as u64);

    // Link task and tick have each had their maximum, perhaps not at the same time. Both at the
    // same time need less than twice the maximum seen.
    let (size, served) = stack(&rig);
    // Ticks are masked while settings are stored: they do not add to the stack.
    rig.run_ms(1_000);
    rig.send(&ToDevice::WriteSettings(SettingsValues::reference()));
    let mut stored = 0;
    while rig.board.resets().is_empty() {
        rig.board.run_for(MS / 100);
        stored = stored.max(stack(&rig).1);
    }
    let bound = started.max(stored).max(2 * served);
    println!(
        "stack  {bound:6} of {size:6} bytes at most: {started} starting, {stored} storing \
         settings, {served} otherwise"
    );
    assert!(bound < size);
    let (_, jitter_ns) = spread_over_phases();
    let percent = |instructions: u64| instructions as f64 / allowed as f64;
    println!(
        "row {compensated}, {:.2} % | {busy}, {:.2} % | {jitter_ns} ns | {bound} of {size}",
        percent(compensated),
        percent(busy)
    );
    rig.assert_no_errors();
}
