//! The status lamp: what the device does, and why it has stopped, as a pattern of one LED.
//! docs/wiring.md shows the patterns.

use crate::io::Request;
use crate::start::StartFault;
use crate::supervisor::{Fault, Mode};

/// Ticks of one flash of a fault, and of the gap after it.
const FLASH_TICKS: u32 = 20;
/// Ticks without light after the flashes.
const PAUSE_TICKS: u32 = 100;

/// Ticks of the long flash before those of a fault of the start-up self-test.
const LONG_TICKS: u32 = 120;
/// Short flashes of the mode ready if brown-outs do not reset the chip.
const WARNING_FLASHES: u32 = 3;

/// Count of flashes that tell a fault.
pub fn flashes(fault: Fault) -> u32 {
    match fault {
        Fault::Bridge(_) => 1,
        Fault::Pressure(_) => 2,
        Fault::Encoder(_) => 3,
        Fault::OverPressure | Fault::PressureControl | Fault::ValveVoltage => 4,
        Fault::OverContraction | Fault::OverSpeed | Fault::ForceBalance | Fault::Uncommanded => 5,
        Fault::LoadedLever | Fault::NotVented | Fault::NotStill => 6,
        Fault::EmergencyStop | Fault::StopContactsDiffer => 7,
        Fault::MissedTicks | Fault::Memory => 8,
        // After a long flash.
        Fault::Start(StartFault::Image) => 1,
        Fault::Start(StartFault::Ram) => 2,
        Fault::Start(StartFault::Stack) => 3,
        Fault::Start(StartFault::Supply) => 4,
        Fault::Start(StartFault::ValveVoltage) => 5,
        Fault::Start(StartFault::Clock) => 6,
        // Never latched: see the mode ready.
        Fault::Start(StartFault::BrownOut) => WARNING_FLASHES,
    }
}

/// Whether the lamp is lit in this tick.
///
/// `warns`: ready, but brown-outs do not reset the chip.
pub fn is_lit(mode: Mode, fault: Option<Fault>, request: Request, warns: bool, tick: u32) -> bool {
    if let Some(fault) = fault {
        let long_ticks = match fault {
            Fault::Start(_) => LONG_TICKS,
            _ => 0,
        };
        let lit_ticks = 2 * FLASH_TICKS * flashes(fault);
        let phase = tick % (long_ticks + lit_ticks + PAUSE_TICKS);
        let Some(phase) = phase.checked_sub(long_ticks) else {
            return phase < LONG_TICKS - FLASH_TICKS;
        };
        return phase < lit_ticks && phase % (2 * FLASH_TICKS) < FLASH_TICKS;
    }
    let is_stopped = matches!(request, Request::Stop | Request::StopContactsDiffer);
    match mode {
        Mode::SelfCheck => tick % 20 < 10,
        Mode::Ready => {
            let flashes = if is_stopped {
                2
            } else if warns {
                WARNING_FLASHES
            } else {
                1
            };
            let phase = tick % 200;
            phase < 30 * flashes && phase % 30 < 10
        }
        Mode::Assisting | Mode::Playing => true,
        Mode::Holding => tick % 100 >= 10,
        Mode::Venting => tick % 100 < 50,
    }
}

/// Whether the lamp is lit in this tick while it asks to hold the button: 10 flashes a second, and
/// steady while it is held.
pub fn asks(is_held: bool, tick: u32) -> bool {
    is_held || tick % 10 < 5
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two periods of a pattern as a string, a character for each 100 ms.
    fn pattern(mode: Mode, fault: Option<Fault>, request: Request, ticks: u32) -> String {
        let lit = |tick| is_lit(mode, fault, request, false, tick);
        (0..2 * ticks / 10)
            .map(|tenth| if lit(10 * tenth) { '#' } else { '.' })
            .collect()
    }

    #[test]
    fn patterns_are_those_of_the_manual() {
        let none = Request::None;
        let expected = [
            (Mode::SelfCheck, none, "#.", 20),
            (Mode::Ready, none, "#...................", 200),
            (Mode::Ready, Request::Stop, "#..#................", 200),
            (Mode::Assisting, none, "##########", 100),
            (Mode::Playing, none, "##########", 100),
            (Mode::Holding, none, ".#########", 100),
            (Mode::Venting, none, "#####.....", 100),
        ];
        for (mode, request, period, ticks) in expected {
            assert_eq!(
                pattern(mode, None, request, ticks),
                period.repeat(2),
                "{mode:?}"
            );
        }
    }

    #[test]
    fn ready_without_a_reset_at_a_brown_out_flashes_three_times() {
        let lit = |tick| is_lit(Mode::Ready, None, Request::None, true, tick);
        let seen: String = (0..20)
            .map(|n| if lit(10 * n) { '#' } else { '.' })
            .collect();
        assert_eq!(seen, "#..#..#.............");
    }

    #[test]
    fn every_fault_flashes_its_number_and_pauses_in_any_mode() {
        for (fault, name) in Fault::NAMED {
            let count = flashes(*fault);
            assert!((1..=8).contains(&count), "{name}");
            let long = match fault {
                Fault::Start(_) => "##########..",
                _ => "",
            };
            let period = format!("{long}{}..........", "##..".repeat(count as usize));
            let ticks = 10 * period.len() as u32;
            let seen = pattern(Mode::Venting, Some(*fault), Request::None, ticks);
            assert_eq!(seen, period.repeat(2), "{name}");
        }
    }
}
