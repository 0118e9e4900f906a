//! The start-up self-test: what the firmware has measured before the first tick, and what follows.
//!
//! Bridge and pressure sensor out of their range are found by the controller's self-check, with or
//! without hardware in the loop; here is what only the board itself can have.

use crate::names::names;
use crate::sampling::is_supply_valid;
use crate::signal::DacCount;
use serde::{Deserialize, Serialize};

/// What is wrong with the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StartFault {
    /// The program in flash is not the one that was flashed.
    Image,
    /// A bit of the RAM is stuck.
    Ram,
    /// The stack does not hold the pattern of the start-up code.
    Stack,
    /// The supply is not 3.3 V within 10 %, by the converter's internal reference, or the chip's
    /// regulator does not make the core's voltage of it.
    Supply,
    /// The valve's voltage is not the one that was set.
    ValveVoltage,
    /// The chip does not reset when its supply sinks. Assistance is possible.
    BrownOut,
    /// The core's clock and the watchdog's do not agree: one of the oscillators is wrong.
    Clock,
}

names! { StartFault:
    "Image" = StartFault::Image;
    "Ram" = StartFault::Ram;
    "Stack" = StartFault::Stack;
    "Supply" = StartFault::Supply;
    "ValveVoltage" = StartFault::ValveVoltage;
    "BrownOut" = StartFault::BrownOut;
    "Clock" = StartFault::Clock;
}

impl StartFault {
    /// Whether the board stays at 0 V until the next reset.
    pub fn prevents_assistance(self) -> bool {
        self != StartFault::BrownOut
    }

    /// What to do about it.
    pub fn help(self) -> &'static str {
        match self {
            StartFault::Image => "flash the firmware again; if it comes back, the flash is worn",
            StartFault::Ram | StartFault::Clock => "the chip is damaged: replace the board",
            StartFault::Stack => "flash the firmware again; if it comes back, replace the board",
            StartFault::Supply => {
                "measure the board's 3.3 V (2.97 to 3.63 V) and AVDD; if they are right, the \
                 capacitors at VCAP"
            }
            StartFault::ValveVoltage => {
                "disconnect the valve's amplifier from A2: its input pulls the voltage, or is \
                 shorted; without a DAC check the converter's wires"
            }
            StartFault::BrownOut => {
                "set the option BOR_LEV to level 3, with the valve's supply off: \
                 STM32_Programmer_CLI -c port=SWD -ob BOR_LEV=0"
            }
        }
    }
}

/// The levels to which the valve's voltage is set \[counts\]. The second one is 0.41 V for some
/// 100 µs: the valve has no time to follow.
pub const VALVE_LEVELS: [u16; 2] = [0, 512];

/// What the firmware has measured.
#[derive(Clone, Copy, Debug)]
pub struct StartFindings {
    /// Whether the image has its checksum; none if it was flashed without one.
    pub image: Option<bool>,
    /// Every word of the RAM holds 0 and 1 in each bit.
    pub ram: bool,
    /// Free bytes of the stack, by its pattern.
    pub stack_free_bytes: u16,
    /// The internal reference: as measured, and at 3.3 V \[counts\].
    pub reference: (u16, u16),
    /// The chip's regulator reports the voltage that the core's clock needs.
    pub regulator: bool,
    /// The valve's voltage as read back, for each of [`VALVE_LEVELS`] \[counts\].
    pub valve: [u16; VALVE_LEVELS.len()],
    /// The lowest and the highest count of each: the board's converter has tolerances.
    pub valve_limits: [(u16, u16); VALVE_LEVELS.len()],
    /// The chip's option BOR_LEV; 0 is the highest level.
    pub brown_out_level: u8,
}

/// A level of the test for the valve's output.
pub fn valve_level(index: usize) -> DacCount {
    DacCount::new(VALVE_LEVELS.get(index).copied().unwrap_or(0))
}

impl StartFindings {
    /// The first thing that is wrong, the most fundamental one first.
    pub fn fault(&self) -> Option<StartFault> {
        let (reference, calibrated) = self.reference;
        let valve_follows =
            |((low, high), seen): (&(u16, u16), &u16)| (*low..=*high).contains(seen);
        if self.image == Some(false) {
            Some(StartFault::Image)
        } else if !self.ram {
            Some(StartFault::Ram)
        } else if self.stack_free_bytes == 0 {
            Some(StartFault::Stack)
        } else if !self.regulator || !is_supply_valid(reference.into(), calibrated.into()) {
            Some(StartFault::Supply)
        } else if !self.valve_limits.iter().zip(&self.valve).all(valve_follows) {
            Some(StartFault::ValveVoltage)
        } else if self.brown_out_level != 0 {
            Some(StartFault::BrownOut)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEALTHY: StartFindings = StartFindings {
        image: Some(true),
        ram: true,
        stack_free_bytes: 3_000,
        reference: (1_510, 1_502),
        regulator: true,
        valve: [3, 504],
        valve_limits: [(0, 40), (464, 552)],
        brown_out_level: 0,
    };

    #[test]
    fn each_finding_has_its_fault() {
        assert_eq!(HEALTHY.fault(), None);
        let unsealed = StartFindings {
            image: None,
            ..HEALTHY
        };
        assert_eq!(unsealed.fault(), None);
        let mut findings = [HEALTHY; 10];
        findings[0].image = Some(false);
        findings[1].ram = false;
        findings[2].stack_free_bytes = 0;
        findings[3].reference.0 = 1_365;
        findings[4].reference.0 = 1_669;
        findings[5].valve[0] = 41;
        findings[6].valve[1] = 463;
        findings[7].valve[1] = 553;
        findings[8].brown_out_level = 3;
        findings[9].regulator = false;
        let expected = [
            StartFault::Image,
            StartFault::Ram,
            StartFault::Stack,
            StartFault::Supply,
            StartFault::Supply,
            StartFault::ValveVoltage,
            StartFault::ValveVoltage,
            StartFault::ValveVoltage,
            StartFault::BrownOut,
            StartFault::Supply,
        ];
        for (findings, expected) in findings.iter().zip(expected) {
            assert_eq!(findings.fault(), Some(expected), "{findings:?}");
        }
    }

    #[test]
    fn supply_is_accepted_from_2_97_to_3_63_v() {
        for (volts, accepted) in [(2.965, false), (2.975, true), (3.625, true), (3.635, false)] {
            let mut findings = HEALTHY;
            findings.reference.0 = (f64::from(HEALTHY.reference.1) * 3.3 / volts).round() as u16;
            let expected = (!accepted).then_some(StartFault::Supply);
            assert_eq!(findings.fault(), expected, "{volts} V");
        }
    }

    #[test]
    fn the_fault_that_spoils_the_other_findings_is_reported() {
        let all = StartFindings {
            image: Some(false),
            ram: false,
            stack_free_bytes: 0,
            reference: (0, 1_502),
            regulator: false,
            valve: [4_095; 2],
            valve_limits: HEALTHY.valve_limits,
            brown_out_level: 3,
        };
        assert_eq!(all.fault(), Some(StartFault::Image));
    }
}
