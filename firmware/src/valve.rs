//! The servo valve's voltage: DAC channel 1.

use crate::board::ValvePin;
use model_core::signal::DacCount;
use stm32f4xx_hal::pac::DAC;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

/// The valve.
pub struct Valve(DAC);

impl Valve {
    /// Switches the output on, at zero volts.
    pub fn new(dac: DAC, _pin: ValvePin, rcc: &mut Rcc) -> Valve {
        DAC::enable(rcc);
        DAC::reset(rcc);
        // Without its buffer the output reaches zero volts.
        dac.cr().write(|w| w.boff1().set_bit().en1().set_bit());
        Valve(dac)
    }

    /// Sets the voltage.
    pub fn set(&mut self, count: DacCount) {
        self.0.dhr12r1().write(|w| w.daccdhr().set(count.get()));
    }
}

/// Zero volts, from wherever; where the DAC is not yet on, its pin is at zero volts anyway.
pub fn make_safe() {
    // SAFETY: a single write of a register whose every value is harmless.
    #[allow(unsafe_code)]
    let dac = unsafe { DAC::steal() };
    dac.dhr12r1()
        .write(|w| w.daccdhr().set(DacCount::default().get()));
}
