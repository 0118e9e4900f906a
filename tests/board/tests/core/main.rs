//! The core: exceptions, faults, sleep and flash stalls, tested with small assembly programs.
//!
//! clang assembles the programs; building the engine needs it, too.

mod assembler;

use assembler::board;
use emulated_board::{Board, Cost, ResetCause};

const MS: u64 = 1_000_000;
/// Address at which the programs store their results.
const RESULTS: u32 = 0x2000_1000;

fn words(board: &Board, count: usize) -> Vec<u32> {
    let bytes = board.read_memory(RESULTS, 4 * count);
    bytes
        .chunks_exact(4)
        .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
        .collect()
}

fn texts(board: &Board) -> Vec<&str> {
    board.errors().iter().map(|e| e.text.as_str()).collect()
}

#[test]
fn pending_interrupts_run_by_priority_and_chain_without_a_return() {
    // interrupts 1 and 2 have priority 0x40 and 0x20: 2 first, then 1, then back
    let mut board = board(
        "reset:
            const r4, 0xe000e400
            const r5, 0x00204000
            str r5, [r4]
            const r4, 0xe000e100
            movs r5, #6
            str r5, [r4]
            const r6, 0x20001000
            cpsid i
            const r4, 0xe000e200
            str r5, [r4]
            cpsie i
            mov r7, #3
            str r7, [r6], #4
            b .
        irq1: mrs r0, ipsr
            str r0, [r6], #4
            bx lr
        irq2: mrs r0, ipsr
            str r0, [r6], #4
            bx lr",
    );
    board.trace_exceptions(true);
    board.run_until(MS);
    assert_eq!(words(&board, 3), [18, 17, 3]);
    let events = board.exceptions();
    // six cycles of 16 MHz
    let chained_ns = events[2].time_ns - events[1].time_ns;
    assert_eq!((events.len(), chained_ns), (4, 375), "{events:?}");
    assert_eq!(texts(&board), Vec::<&str>::new());
}

#[test]
fn more_urgent_interrupt_preempts_and_registers_are_restored() {
    let mut board = board(
        "reset:
            const r4, 0xe000e400
            const r5, 0x00204000
            str r5, [r4]
            const r4, 0xe000e100
            movs r5, #6
            str r5, [r4]
            const r6, 0x20001000
            const r4, 0xe000e200
            movs r0, #10
            movs r1, #11
            mov r12, #12
            movs r5, #2
            adds r7, r5, #0
            cmp r5, #2
            str r5, [r4]
            nop
            nop
            ite eq
            moveq r7, #1
            movne r7, #2
            stm r6!, {r0, r1, r7, r12}
            b .
        irq1: push {r4, lr}
            movs r5, #4
            str r5, [r4]
            nop
            nop
            movs r0, #0
            str r0, [r6], #4
            cmp r0, #1
            pop {r4, pc}
        irq2: movs r1, #0
            movs r0, #5
            str r0, [r6], #4
            mov r12, #0
            bx lr",
    );
    board.run_until(MS);
    assert_eq!(words(&board, 6), [5, 0, 10, 11, 1, 12]);
    assert_eq!(texts(&board), Vec::<&str>::new());
}

#[test]
fn floating_point_registers_survive_an_interrupt() {
    let mut board = board(
        "reset:
            const r0, 0xe000ed88
            const r1, 0x00f00000
            str r1, [r0]
            const r4, 0xe000e100
            movs r5, #2
            str r5, [r4]
            const r6, 0x20001000
            const r0, 0x3fc00000
            vmov s0, r0
            vmov s15, r0
            const r4, 0xe000e200
            str r5, [r4]
            nop
            nop
            vadd.f32 s0, s0, s15
            vstr s0, [r6]
            mrs r0, control
            and r0, #4
            str r0, [r6, #4]
            b .
        irq1: mrs r0, control
            and r0, #4
            str r0, [r6, #8]
            vsub.f32 s0, s0, s0
            vmov.f32 s15, s0
            bx lr",
    );
    board.run_until(MS);
    assert_eq!(words(&board, 3), [3.0_f32.to_bits(), 4, 0]);
    assert_eq!(texts(&board), Vec::<&str>::new());
}

#[test]
fn floating_point_needs_its_unit_enabled() {
    let mut board = board(
        "reset: vmov s0, r0
            b .
        hard_fault: const r6, 0x20001000
            const r4, 0xe000ed28
            ldr r0, [r4]
            ldr r1, [r4, #4]
            stm r6!, {r0, r1}
            b .",
    );
    board.run_until(MS);
    assert_eq!(words(&board, 2), [1 << 19, 1 << 30]);
}

#[test]
fn faults_reach_the_hard_fault_handler_with_their_cause() {
    let handler = "hard_fault: const r6, 0x20001000
            const r4, 0xe000ed28
            ldr r0, [r4]
            ldr r1, [sp, #24]
            stm r6!, {r0, r1}
            b .";
    let cases = [
        ("nop\n udf #0", 1 << 16, 2),
        ("const r0, 0x30000000\n ldr r1, [r0]", 1 << 9 | 1 << 15, 8),
        ("const r0, 0x1fffff00\n str r0, [r0]", 1 << 9 | 1 << 15, 8),
        ("const r0, 0x30000001\n bx r0", 1 << 8, 0x2800_0000 - 0x200),
        ("bkpt #0", 0, 0),
    ];
    for (program, cfsr, offset) in cases {
        let mut board = board(&format!("reset: {program}\n b .\n {handler}"));
        board.run_until(MS);
        let expected = [cfsr, 0x0800_0200 + offset];
        assert_eq!(
            words(&board, 2),
            expected,
            "{program}: {}",
            board.error_report()
        );
    }
}

#[test]
fn bus_fault_has_its_own_handler_once_enabled() {
    let mut board = board(
        "reset: const r0, 0xe000ed24
            const r1, 0x00020000
            str r1, [r0]
            const r0, 0x30000000
            ldr r1, [r0]
            b .
        bus_fault: const r6, 0x20001000
            const r4, 0xe000ed38
            ldr r0, [r4]
            mrs r1, ipsr
            stm r6!, {r0, r1}
            b .",
    );
    board.run_until(MS);
    assert_eq!(words(&board, 2), [0x3000_0000, 5]);
}

#[test]
fn stack_below_the_ram_causes_a_fault_and_a_handler_that_pushes_locks_up() {
    let overflow = "reset: const r0, 0x20000004
            mov sp, r0
            push {r0, r1}
            b .
        hard_fault:";
    let mut pushes = board(&format!("{overflow} push {{r0, lr}}\n b ."));
    pushes.run_until(MS);
    assert!(pushes.is_locked_up());
    let mut resets_the_stack = board(&format!(
        "{overflow} const r1, 0x20001000
            mov sp, r1
            push {{r0, lr}}
            b ."
    ));
    resets_the_stack.run_until(MS);
    assert!(!resets_the_stack.is_locked_up());
}

#[test]
fn wfi_sleeps_until_an_interrupt_even_if_it_is_masked() {
    let mut board = board(
        "reset: cpsid i
            const r4, 0xe000e010
            const r5, 159999
            str r5, [r4, #4]
            movs r5, #7
            str r5, [r4]
            const r6, 0x20001000
            movs r0, #0
            str r0, [r6]
        again: wfi
            ldr r0, [r6]
            adds r0, #1
            str r0, [r6]
            cpsie i
            cpsid i
            b again
        sys_tick: bx lr",
    );
    // 160 000 cycles of 16 MHz are 10 ms
    board.run_until(105 * MS);
    assert_eq!(words(&board, 1), [10]);
    assert!(board.is_asleep());
    assert!(board.instructions() < 200);
}

#[test]
fn erasing_stalls_code_in_flash_and_programming_is_permanent() {
    let mut board = board(
        "reset: const r4, 0x40023c00
            const r0, 0x45670123
            str r0, [r4, #4]
            const r0, 0xcdef89ab
            str r0, [r4, #4]
            @ sector 1, x32
            const r0, 0x0001020a
            str r0, [r4, #16]
            const r6, 0x20001000
            ldr r0, [r4, #12]
            str r0, [r6]
            const r0, 0x00000201
            str r0, [r4, #16]
            const r5, 0x08004000
            const r0, 0x12345678
            str r0, [r5]
            ldr r0, [r5]
            str r0, [r6, #4]
            ldr r0, [r5, #4]
            str r0, [r6, #8]
            movs r0, #1
            str r0, [r6, #12]
            b .",
    );
    board.run_until(250 * MS);
    assert!(board.is_flash_busy());
    assert_ne!(words(&board, 4)[3], 1);
    board.run_until(251 * MS);
    assert_eq!(words(&board, 4), [0, 0x1234_5678, u32::MAX, 1]);
    assert_eq!(texts(&board), Vec::<&str>::new());
}

#[test]
fn reset_request_and_watchdog_restart_the_program_and_ram_is_kept() {
    let mut board = board(
        "reset: const r6, 0x20001000
            ldr r0, [r6]
            adds r0, #1
            str r0, [r6]
            const r4, 0x40023874
            ldr r1, [r4]
            str r1, [r6, #4]
            cmp r0, #2
            beq dog
            const r4, 0xe000ed0c
            const r0, 0x05fa0004
            str r0, [r4]
            b .
        dog: const r4, 0x40003000
            const r0, 0xcccc
            str r0, [r4]
            b .",
    );
    board.power_cut();
    board.write_ram(RESULTS, &1_u32.to_le_bytes());
    board.power_on();
    board.run_until(515 * MS);
    let causes: Vec<_> = board.resets().iter().map(|r| r.cause).collect();
    assert_eq!(causes[..2], [ResetCause::Power, ResetCause::Watchdog]);
    // 4096 counts of 32 kHz / 4
    let timeout_ms = (board.resets()[1].time_ns - board.resets()[0].time_ns) as f64 * 1e-6;
    assert!((timeout_ms - 512.0).abs() < 0.1, "{timeout_ms} ms");
    assert_eq!(causes[2], ResetCause::Software);
    assert_eq!(words(&board, 2)[1] >> 24, 0x3e);
}

#[test]
fn instructions_take_one_cycle_and_runs_are_identical() {
    let run = || {
        let mut board = board(
            "reset: movs r0, #0
            loop: adds r0, #1
                b loop",
        );
        for step in 1..=100 {
            board.run_until(step * 12_345);
        }
        (board.instructions(), board.time_ns())
    };
    let (instructions, time_ns) = run();
    assert_eq!((instructions, time_ns), run());
    assert!(
        (instructions as f64 - time_ns as f64 * 0.016).abs() < 2.0,
        "{instructions}"
    );
}

/// In the handler: 2 cycles of the load from the flash, 2 + 2 of two of the RAM, 4 of the branch,
/// 12 of the division, 1 of the move, 4 of the return. It is branched to, as is the label.
#[test]
fn cost_is_that_of_the_executed_path() {
    let mut board = board(
        "reset:
            const r4, 0xe000e100
            movs r5, #2
            const r6, 0x20001000
            const r3, 0xe000e200
            mov r1, #3
            str r5, [r4]
            str r5, [r3]
            b .
            .balign 16
        irq1: ldr r0, value
            str r0, [r6]
            ldr r2, [r6]
            b label
            .balign 16
        label: udiv r0, r0, r1
            mov r0, #1
            bx lr
            .balign 4
        value: .word 42",
    );
    board.count_loads();
    board.trace_exceptions(true);
    board.run_until(MS);
    assert_eq!(words(&board, 1), [42]);
    let [entered, left] = board.exceptions()[..] else {
        panic!("an interrupt")
    };
    let cost = left.cost.since(&entered.cost);
    let expected = Cost {
        core_cycles: 2 + 2 + 2 + 4 + 12 + 1 + 4,
        branches: 2,
        // after the load
        lines: 1,
        loads: 1,
        registers: 0,
    };
    assert_eq!(cost, expected);
}

#[test]
fn interrupts_do_not_split_it_blocks() {
    let mut board = board(
        "reset: const r4, 0xe000e010
            movs r5, #96
            str r5, [r4, #4]
            movs r5, #7
            str r5, [r4]
            const r6, 0x20001000
            movs r0, #0
            movs r1, #0
            str r1, [r6]
            str r1, [r6, #4]
        again: cmp r0, #0
            itett eq
            addeq r1, #1
            movne r1, #0
            addeq r1, #1
            addeq r1, #1
            str r1, [r6]
            b again
        sys_tick: ldr r2, [r6, #4]
            adds r2, #1
            str r2, [r6, #4]
            cmp r6, #0
            bx lr",
    );
    board.run_until(20 * MS);
    let [sum, ticks] = words(&board, 2)[..] else {
        unreachable!()
    };
    assert!(sum > 40_000 && sum % 3 == 0, "{sum}");
    assert!(ticks > 3000, "{ticks}");
}
