//! The voltage of the servo valve: DAC channel 1 of the chip.

use crate::board::ValvePins;
use model_core::signal::DacCount;
use model_core::start::VALVE_LEVELS;
use rig_drivers::valve::AnalogOutput;
use stm32f4xx_hal::pac::DAC;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

/// The unit of the chip behind the valve's voltage.
pub use stm32f4xx_hal::pac::DAC as Unit;

/// What may be read back at [`VALVE_LEVELS`] \[counts\]: both converters have offsets of some
/// counts, 0.8 mV each, and a 1 MΩ load takes 1.5 % of the second level.
pub const READ_BACK: [(u16, u16); VALVE_LEVELS.len()] = [(0, 40), (464, 552)];

/// The valve output.
pub struct Valve {
    dac: DAC,
    /// Its pin, which is a channel of the converter, too.
    pub read_back: ValvePins,
}

impl Valve {
    /// Enables the output at 0 V.
    pub fn new(dac: DAC, read_back: ValvePins, rcc: &mut Rcc) -> Valve {
        DAC::enable(rcc);
        DAC::reset(rcc);
        // With the output buffer the voltage would stay about 0.2 V above ground.
        dac.cr().write(|w| w.boff1().set_bit().en1().set_bit());
        Valve { dac, read_back }
    }
}

impl AnalogOutput for Valve {
    fn set(&mut self, count: DacCount) {
        self.dac.dhr12r1().write(|w| w.daccdhr().set(count.get()));
    }
}

/// Sets 0 V from any context, also from a fault handler. While the DAC is still disabled its pin
/// floats, and the resistor at the amplifier holds it at 0 V.
pub fn make_safe() {
    // SAFETY: a single write to a register of which every value is valid.
    #[allow(unsafe_code)]
    let dac = unsafe { DAC::steal() };
    dac.dhr12r1()
        .write(|w| w.daccdhr().set(DacCount::default().get()));
}
