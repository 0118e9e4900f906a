//! The power assist on the board.
#![no_std]
#![no_main]

mod board;

use defmt_rtt as _;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use crate::board;
    use stm32f4xx_hal::{prelude::*, rcc::Config};

    #[shared]
    struct Shared {}

    #[local]
    struct Local {}

    #[init]
    fn init(cx: init::Context) -> (Shared, Local) {
        let config = Config::hse(board::HSE_HZ.Hz())
            .bypass_hse_oscillator()
            .sysclk(board::SYSCLK_HZ.Hz());
        let rcc = cx.device.RCC.freeze(config);
        assert!(rcc.clocks.timclk1().raw() == board::TIMER_HZ);
        (Shared {}, Local {})
    }
}
