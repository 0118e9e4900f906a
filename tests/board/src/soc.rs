//! The chip around the core: the address map of the peripherals, their interrupts and triggers,
//! and the time of the next event. Independent of how instructions are executed.

use crate::adc::{Adc, VREF_VOLTS, VREFINT_VOLTS};
use crate::ads1220::{self, Ads1220, ConverterFaults};
use crate::chip::Chip;
use crate::counters::{CycleCounter, SysTick};
use crate::dac::Dac;
use crate::dma::{Dma, Transfer};
use crate::errors::{Context, Errors};
use crate::flash::{self, Flash};
use crate::gpio::{self, External, Gpio, Mode};
use crate::iwdg::Iwdg;
use crate::nvic::{Nvic, SYS_TICK};
use crate::pin::{Pin, pin};
use crate::pwr::Pwr;
use crate::rcc::{self, Bus, Clocks, Oscillators, Rcc, ResetCause};
use crate::rtc::Rtc;
use crate::scb::Scb;
use crate::spi::{Mcp4922, Spi};
use crate::tim::{Pulses, Tim};
use crate::time::{NEVER, Time, period, to_ns};
use crate::usart::{Host, Usart};
use std::collections::BTreeMap;

/// Count of the timers, TIM2 to TIM7.
const TIMERS: usize = 6;
const TIMER_IRQ: [u32; TIMERS] = [28, 29, 30, 50, 54, 55];
const USART2_IRQ: u32 = 38;
const ADC_IRQ: u32 = 18;
const FLASH_IRQ: u32 = 4;
const SPIS: [&str; 2] = ["SPI2", "SPI3"];
/// Highest frequency at a pin of the lowest speed \[Hz\].
const SLOW_PIN_HZ_MAX: u64 = 4_000_000;
const DMA_IRQ: [[u32; 8]; 2] = [
    [11, 12, 13, 14, 15, 16, 17, 47],
    [56, 57, 58, 59, 60, 68, 69, 70],
];
/// DBGMCU_APB1_FZ, and its bit that stops the watchdog while the core is halted.
const DBG_APB1_FZ: u32 = 0xe004_2008;
const DBG_IWDG_STOP: u32 = 1 << 12;
/// Controller (0 or 1), stream and channel of a request line (RM0390 tables 28 and 29).
const ADC1_DMA: [(usize, usize, u32); 2] = [(1, 0, 0), (1, 4, 0)];
const USART2_RX_DMA: (usize, usize, u32) = (0, 5, 4);
const USART2_TX_DMA: (usize, usize, u32) = (0, 6, 4);

/// The peripheral at an address.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Peripheral {
    Tim(usize),
    Rtc,
    Iwdg,
    Usart2,
    Spi(usize),
    Pwr,
    Dac,
    Adc,
    Memory(&'static str),
    Gpio(usize),
    Rcc,
    Flash,
    Dma(usize),
}

/// The peripheral at `address`, and its clock gate if it has one.
fn peripheral_at(address: u32) -> Option<(Peripheral, Option<(Bus, u32)>)> {
    use Bus::{Ahb1, Apb1, Apb2};
    Some(match address & !0x3ff {
        base @ 0x4000_0000..=0x4000_1400 => {
            let index = base >> 10 & 7;
            (Peripheral::Tim(index as usize), Some((Apb1, index)))
        }
        0x4000_2800 => (Peripheral::Rtc, None),
        0x4000_3000 => (Peripheral::Iwdg, None),
        0x4000_3800 => (Peripheral::Spi(0), Some((Apb1, 14))),
        0x4000_3c00 => (Peripheral::Spi(1), Some((Apb1, 15))),
        0x4000_4400 => (Peripheral::Usart2, Some((Apb1, 17))),
        0x4000_7000 => (Peripheral::Pwr, Some((Apb1, 28))),
        0x4000_7400 => (Peripheral::Dac, Some((Apb1, 29))),
        0x4001_2000 => (Peripheral::Adc, Some((Apb2, 8))),
        0x4001_3800 => (Peripheral::Memory("SYSCFG"), Some((Apb2, 14))),
        0x4001_3c00 => (Peripheral::Memory("EXTI"), None),
        base @ 0x4002_0000..=0x4002_1c00 => {
            let port = base >> 10 & 7;
            (Peripheral::Gpio(port as usize), Some((Ahb1, port)))
        }
        0x4002_3800 => (Peripheral::Rcc, None),
        0x4002_3c00 => (Peripheral::Flash, None),
        0x4002_6000 => (Peripheral::Dma(0), Some((Ahb1, 21))),
        0x4002_6400 => (Peripheral::Dma(1), Some((Ahb1, 22))),
        _ => return None,
    })
}

fn name(peripheral: Peripheral) -> String {
    match peripheral {
        Peripheral::Tim(index) => format!("TIM{}", index + 2),
        Peripheral::Gpio(port) => format!("GPIO{}", char::from(b'A' + port as u8)),
        Peripheral::Dma(index) => format!("DMA{}", index + 1),
        Peripheral::Spi(index) => SPIS[index].into(),
        Peripheral::Adc => "ADC1".into(),
        Peripheral::Memory(name) => name.into(),
        peripheral => format!("{peripheral:?}").to_uppercase(),
    }
}

/// A change of the voltage at a DAC pin.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct DacEvent {
    /// Time of the change.
    pub time_ns: u64,
    /// 1 or 2.
    pub channel: usize,
    /// The voltage; none if the pin floats.
    pub volts: Option<f64>,
}

/// The chip except the core, and the external signals at its pins.
pub struct Soc {
    /// Current time.
    pub now: Time,
    /// Duration of a core cycle.
    pub cycle: Time,
    /// Instructions executed since the board was created.
    pub instructions: u64,
    /// Address of the current instruction.
    pub pc: u32,
    /// The chip.
    pub chip: Chip,
    /// Clock tree.
    pub rcc: Rcc,
    /// Non-volatile memory.
    pub flash: Flash,
    /// Exceptions.
    pub nvic: Nvic,
    /// Core registers.
    pub scb: Scb,
    /// CYCCNT.
    pub cycles: CycleCounter,
    /// The PC at the serial link.
    pub host: Host,
    /// External signals at the pins.
    pub external: External,
    /// Changes of the DAC pins.
    pub dac_events: Vec<DacEvent>,
    /// Errors detected.
    pub errors: Errors,
    /// Pins of the encoder signals A and B.
    pub encoder_pins: [Pin; 2],
    /// Position of the encoder in quadrature edges.
    pub encoder: i64,
    /// A requested reset.
    pub reset: Option<ResetCause>,
    /// Whether a debugger halts the core.
    pub halted: bool,
    pwr: Pwr,
    gpio: Gpio,
    tims: [Tim; TIMERS],
    adc: Adc,
    dac: Dac,
    spis: [Spi; 2],
    /// The valve's converter, if the chip has none.
    mcp4922: Mcp4922,
    /// The bridge's converter, if there is one.
    ads1220: Ads1220,
    dma: [Dma; 2],
    usart: Usart,
    iwdg: Iwdg,
    rtc: Rtc,
    systick: SysTick,
    dac_seen: [Option<f64>; 2],
    /// Registers without a function.
    memory: BTreeMap<u32, u32>,
}

impl Soc {
    /// The state after the first power-up.
    pub fn new(flash: Flash, chip: Chip) -> Soc {
        let mut rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        rcc.chip = chip;
        let unit = |hz| period(hz).0;
        let clocks = rcc.clocks;
        Soc {
            now: 0,
            cycle: clocks.cycle(),
            instructions: 0,
            pc: 0,
            chip,
            flash,
            nvic: Nvic::default(),
            scb: Scb::default(),
            cycles: CycleCounter::new(clocks.cycle()),
            host: Host::default(),
            external: External::default(),
            dac_events: vec![],
            errors: Errors::default(),
            encoder_pins: [pin('A', 0), pin('A', 1)],
            encoder: 0,
            reset: None,
            halted: false,
            pwr: Pwr::new(chip),
            gpio: Gpio::default(),
            tims: std::array::from_fn(|i| Tim::new(i + 2, unit(clocks.timclk1_hz))),
            adc: Adc::new(unit(clocks.pclk2_hz)),
            dac: Dac::default(),
            spis: SPIS.map(|name| Spi::new(name, unit(clocks.pclk1_hz))),
            mcp4922: Mcp4922::default(),
            ads1220: Ads1220::default(),
            dma: [Dma::new(1), Dma::new(2)],
            usart: Usart::new(unit(clocks.pclk1_hz)),
            iwdg: Iwdg::new(rcc.oscillators().lsi_hz),
            rtc: Rtc::default(),
            systick: SysTick::new(clocks.cycle()),
            dac_seen: [None; 2],
            memory: BTreeMap::new(),
            rcc,
        }
    }

    /// Resets the registers. Time, flash, external signals and recorded events are kept.
    pub fn reset(&mut self, cause: ResetCause) {
        self.flash.reset(self.now);
        let flash = std::mem::replace(&mut self.flash, Flash::new(vec![]));
        let mut new = Soc::new(flash, self.chip);
        new.rcc = Rcc::new(cause, self.rcc.reset_flags(), self.rcc.oscillators());
        new.rcc.chip = self.chip;
        if cause != ResetCause::Power {
            new.mcp4922 = self.mcp4922;
            new.ads1220 = self.ads1220;
            // The backup domain.
            new.rcc.keep_backup_domain(&self.rcc);
            new.rtc = self.rtc.clone();
        }
        // Only power-on resets the debug units.
        if cause != ResetCause::Power {
            new.memory.extend(
                self.memory
                    .get(&DBG_APB1_FZ)
                    .map(|word| (DBG_APB1_FZ, *word)),
            );
        }
        new.iwdg = Iwdg::new(new.rcc.oscillators().lsi_hz);
        new.now = self.now;
        new.instructions = self.instructions;
        new.host = std::mem::take(&mut self.host);
        new.external = self.external.clone();
        new.dac_events = std::mem::take(&mut self.dac_events);
        new.errors = std::mem::take(&mut self.errors);
        new.encoder_pins = self.encoder_pins;
        new.encoder = self.encoder;
        new.dac_seen = self.dac_seen;
        new.set_clocks(new.rcc.clocks);
        new.rtc.set_clock(new.now, new.rcc.rtc_hz());
        *self = new;
        self.record_dac();
    }

    /// Calls `f` with the context of a register access.
    fn with<T>(&mut self, f: impl FnOnce(&mut Soc, &mut Context) -> T) -> T {
        let mut errors = std::mem::take(&mut self.errors);
        let (now, pc) = (self.now, self.pc);
        let result = f(
            self,
            &mut Context {
                now,
                pc,
                errors: &mut errors,
            },
        );
        self.errors = errors;
        result
    }

    /// Records an error.
    pub fn error(&mut self, text: impl Into<String>) {
        self.errors.add(self.now, self.pc, text.into());
    }

    // ---- time ----------------------------------------------------------------------------------

    /// Time of the next event that the core can observe. Without a system clock that is the
    /// watchdog's, which has its own oscillator.
    pub fn next_event(&self) -> Time {
        if !self.rcc.is_clocked() {
            return self.iwdg.next();
        }
        let timers = self
            .tims
            .iter()
            .fold(NEVER, |next, tim| next.min(tim.next()));
        timers
            .min(self.adc.next())
            .min(self.usart.next(&self.host))
            .min(self.iwdg.next())
            .min(self.systick.next())
            .min(self.flash.next())
    }

    /// Executes all events that are due.
    pub fn fire_due(&mut self) {
        while self.next_event() <= self.now && self.reset.is_none() {
            self.fire();
        }
    }

    fn fire(&mut self) {
        if self.iwdg.next() <= self.now {
            self.reset = Some(ResetCause::Watchdog);
            return;
        }
        for index in 0..TIMERS {
            if self.tims[index].next() <= self.now {
                let pulses = self.tims[index].fire(self.now);
                self.forward(index, pulses);
            }
        }
        if self.adc.next() <= self.now {
            let (volts, converter) = (self.adc_volts(), self.external.converter);
            self.with(|soc, cx| soc.adc.finish(volts, &converter, cx));
        }
        if self.usart.next(&self.host) <= self.now {
            let wired = [gpio::LINK_TX, gpio::LINK_RX];
            let wired = wired.map(|pin| self.gpio.mode(pin) == Mode::Alternate(7));
            self.with(|soc, cx| soc.usart.fire(&mut soc.host, (wired[0], wired[1]), cx));
        }
        if self.systick.fire(self.now) {
            self.nvic.pend(SYS_TICK);
        }
        self.flash.fire(self.now);
        self.update_lines();
    }

    /// Forwards the edges of a timer to ADC and DAC.
    fn forward(&mut self, index: usize, pulses: Pulses) {
        if pulses == Pulses::default() {
            return;
        }
        let number = index + 2;
        if pulses.trgo {
            self.dac.trigger(number);
            self.record_dac();
            self.with(|soc, cx| soc.adc.trigger((number, None), cx));
        }
        for channel in (0..4).filter(|channel| pulses.compare >> channel & 1 != 0) {
            self.with(|soc, cx| soc.adc.trigger((number, Some(channel + 1)), cx));
        }
    }

    /// Changes the oscillators.
    pub fn set_oscillators(&mut self, oscillators: Oscillators) {
        self.iwdg.set_lsi(oscillators.lsi_hz);
        if self.rcc.set_oscillators(oscillators) {
            self.set_clocks(self.rcc.clocks);
        }
        self.rtc.set_clock(self.now, self.rcc.rtc_hz());
    }

    /// Halts the core as a debugger does, or lets it continue.
    pub fn halt(&mut self, halted: bool) {
        self.halted = halted;
        let frozen = self.memory.get(&DBG_APB1_FZ).copied().unwrap_or(0) & DBG_IWDG_STOP != 0;
        self.iwdg.freeze(halted && frozen, self.now);
    }

    fn set_clocks(&mut self, clocks: Clocks) {
        let now = self.now;
        let unit = |hz| period(hz).0;
        self.tims
            .iter_mut()
            .for_each(|tim| tim.set_clock(now, unit(clocks.timclk1_hz)));
        self.adc.set_clock(unit(clocks.pclk2_hz));
        self.usart.set_clock(unit(clocks.pclk1_hz));
        self.spis
            .iter_mut()
            .for_each(|spi| spi.set_clock(unit(clocks.pclk1_hz)));
        self.systick.set_clock(now, clocks.cycle());
        self.cycles.set_clock(now, clocks.cycle());
        self.cycle = clocks.cycle();
    }

    /// Checks voltage scale and wait states for the clock (RM0390 tables 6 and 18).
    fn check_clock(&mut self) {
        let hz = self.rcc.clocks.hclk_hz;
        if hz > self.pwr.hclk_max_hz(self.now) {
            self.error(format!(
                "PWR: {hz} Hz needs another voltage scale or over-drive"
            ));
        }
        if hz > (self.flash.latency() + 1) * 30_000_000 {
            let latency = self.flash.latency();
            self.error(format!(
                "FLASH: {latency} wait states are too few for {hz} Hz"
            ));
        }
    }

    // ---- signals -------------------------------------------------------------------------------

    fn adc_volts(&mut self) -> f64 {
        let channel = self.adc.channel();
        let Some(pin) = gpio::adc_pin(channel) else {
            if !self.adc.internal_channels() {
                self.error(format!("ADC1: channel {channel} converted without TSVREFE"));
                return 0.0;
            }
            // temperature sensor at 25 °C (datasheet)
            return if channel == 17 { VREFINT_VOLTS } else { 0.76 };
        };
        if self.gpio.mode(pin) != Mode::Analog {
            self.error(format!("ADC1: {pin} is converted, but it is not analog"));
            return 0.0;
        }
        if let (true, Some(faults)) = (pin == gpio::BRIDGE, self.external.bridge_converter) {
            return faults.bridge_volts / 2.0;
        }
        if pin == gpio::VALVE {
            let volts = self.dac_volts(0).unwrap_or(0.0);
            return self.external.valve_load.unwrap_or(volts);
        }
        self.external.volts[usize::from(pin.port)][usize::from(pin.number)]
    }

    /// Voltage of a DAC channel (0 or 1) at its pin; none if the pin floats.
    ///
    /// A chip without a DAC has an MCP4922 in the place of the first channel.
    pub fn dac_volts(&self, channel: usize) -> Option<f64> {
        // Either converter divides the board's supply.
        let of_supply = self.external.converter.vref_volts / VREF_VOLTS;
        if !self.chip.has(Bus::Apb1, 29) {
            let shutdown = self.gpio.output(gpio::CONVERTER_SHUTDOWN);
            let volts = self.mcp4922.volts(shutdown).filter(|_| channel == 0);
            return volts.map(|volts| volts * of_supply);
        }
        let connected = self.gpio.mode(gpio::DAC_PINS[channel]) == Mode::Analog;
        let volts = self.dac.volts(channel).filter(|_| connected);
        volts.map(|volts| volts * of_supply)
    }

    fn write_spi(&mut self, index: usize, offset: u32, value: u32) {
        let word = self.with(|soc, cx| soc.spis[index].write(offset, value, cx));
        let Some((word, bits)) = word else {
            return;
        };
        let (wires, function) = [
            ([gpio::CONVERTER_CLOCK, gpio::CONVERTER_DATA], 5),
            ([gpio::BRIDGE_CLOCK, gpio::BRIDGE_DATA_IN], 6),
        ][index];
        let hz = self.spis[index].clock_hz();
        for pin in wires {
            if self.gpio.is_slow(pin) && hz > SLOW_PIN_HZ_MAX {
                let name = SPIS[index];
                self.error(format!("{name}: {hz} Hz at {pin}, whose speed is low"));
            }
        }
        if wires.map(|pin| self.gpio.mode(pin)) != [Mode::Alternate(function); 2] {
            return;
        }
        match (index, self.external.bridge_converter) {
            (0, _) => self.mcp4922.shift(word, bits),
            (_, Some(faults)) => {
                if (self.spis[1].mode(), bits) != (1, 8) || hz > ads1220::CLOCK_HZ_MAX {
                    self.error("SPI3: an ADS1220 needs mode 1, bytes, and 6.67 MHz at most");
                }
                let byte = self.with(|soc, cx| soc.ads1220.exchange(word as u8, &faults, cx));
                let read = self.gpio.mode(gpio::BRIDGE_DATA_OUT) == Mode::Alternate(6);
                self.spis[1].reply = if read { byte.into() } else { 0 };
            }
            (_, None) => {}
        }
    }

    /// What the outputs of the ports change at the converters.
    fn select_converters(&mut self) {
        let select = self.gpio.output(gpio::CONVERTER_SELECT);
        self.mcp4922.select(select == Some(false));
        if let Some(faults) = self.external.bridge_converter {
            let select = self.gpio.output(gpio::BRIDGE_SELECT);
            let pin = gpio::BRIDGE;
            let volts = self.external.volts[usize::from(pin.port)][usize::from(pin.number)];
            // To the middle of the count that the chip's converter would have, of which sixteen
            // have 0x80 as the lowest byte of their sum.
            let code = (volts / VREF_VOLTS * 4095.0 - 2048.0) * 1024.0 + 520.0;
            let signal = code / (128.0 * 8_388_608.0);
            let low = select == Some(false);
            self.ads1220.select(low, self.now, &faults, signal);
        }
    }

    /// Changes what is wrong with the bridge's converter.
    pub fn set_converter_faults(&mut self, faults: ConverterFaults) {
        if !faults.powered {
            self.ads1220.switch_off();
        }
        self.external.bridge_converter = Some(faults);
    }

    /// Drives DRDY's pin.
    fn drive_ready(&mut self) {
        if let Some(faults) = self.external.bridge_converter {
            let pin = gpio::BRIDGE_READY;
            let high = self.ads1220.ready(self.now, &faults);
            self.external.levels[usize::from(pin.port)][usize::from(pin.number)] = Some(high);
        }
    }

    fn record_dac(&mut self) {
        for channel in 0..2 {
            let volts = self.dac_volts(channel);
            if volts != self.dac_seen[channel] {
                self.dac_seen[channel] = volts;
                let time_ns = to_ns(self.now);
                self.dac_events.push(DacEvent {
                    time_ns,
                    channel: channel + 1,
                    volts,
                });
            }
        }
    }

    /// Level that the chip drives a pin to; none if it does not drive the pin.
    pub fn output(&self, pin: Pin) -> Option<bool> {
        self.gpio.output(pin)
    }

    /// Moves the encoder to `position`, in edges. A timer counts only if its inputs are A and B.
    pub fn set_encoder(&mut self, position: i64) {
        let delta = position - self.encoder;
        self.encoder = position;
        let [a, b] = self.encoder_pins;
        let phase = position.rem_euclid(4);
        for (pin, high) in [(a, phase == 1 || phase == 2), (b, phase >= 2)] {
            self.external.levels[usize::from(pin.port)][usize::from(pin.number)] = Some(high);
        }
        for timer in 2..=5 {
            let edges = match self.gpio.timer_inputs(timer) {
                inputs if inputs == [Some(a), Some(b)] => delta,
                inputs if inputs == [Some(b), Some(a)] => -delta,
                _ => 0,
            };
            self.tims[timer - 2].encoder_edges(edges);
        }
        self.update_lines();
    }

    /// Sets the interrupt lines of all peripherals at the NVIC.
    fn update_lines(&mut self) {
        let mut lines = 0u128;
        let mut set = |irq: u32, high: bool| lines |= u128::from(high) << irq;
        for (tim, irq) in self.tims.iter().zip(TIMER_IRQ) {
            set(irq, tim.irq());
        }
        set(USART2_IRQ, self.usart.irq());
        set(ADC_IRQ, self.adc.irq());
        set(FLASH_IRQ, self.flash.irq());
        for (dma, irqs) in self.dma.iter().zip(DMA_IRQ) {
            for (stream, irq) in irqs.into_iter().enumerate() {
                set(irq, dma.irq(stream));
            }
        }
        self.nvic.set_lines(lines);
    }

    // ---- DMA -----------------------------------------------------------------------------------

    /// The first request of a peripheral that a stream serves.
    fn request(&self) -> Option<(usize, usize, u32)> {
        let served = |wanted: bool, line: (usize, usize, u32)| {
            let (controller, stream, channel) = line;
            let on = wanted && self.rcc.is_on(Bus::Ahb1, 21 + controller as u32);
            (on && self.dma[controller].listens(stream, channel)).then_some(line)
        };
        served(self.adc.wants_dma, ADC1_DMA[0])
            .or_else(|| served(self.adc.wants_dma, ADC1_DMA[1]))
            .or_else(|| served(self.usart.wants_rx_dma(), USART2_RX_DMA))
            .or_else(|| served(self.usart.wants_tx_dma(), USART2_TX_DMA))
    }

    /// Whether a transfer is pending.
    pub fn is_transfer_pending(&self) -> bool {
        self.request().is_some()
    }

    /// The next pending transfer, which the caller executes.
    pub fn next_transfer(&mut self) -> Option<(usize, usize, Transfer)> {
        let (controller, stream, channel) = self.request()?;
        let transfer = self.dma[controller].request(stream, channel)?;
        if controller == 1 && transfer.last {
            self.adc.stream_ended();
        }
        self.update_lines();
        Some((controller, stream, transfer))
    }

    /// Handles a transfer with an unmapped address.
    pub fn transfer_failed(&mut self, controller: usize, stream: usize, transfer: Transfer) {
        self.dma[controller].failed(stream);
        self.error(format!(
            "DMA{} stream {stream}: bus error, {transfer:x?}",
            controller + 1
        ));
        self.update_lines();
    }

    // ---- registers -----------------------------------------------------------------------------

    /// The peripheral at `address` if it exists and its clock is on; otherwise records an error.
    fn reach(&mut self, address: u32, verb: &str) -> Option<Peripheral> {
        let exists =
            |gate: Option<(Bus, u32)>| gate.is_none_or(|(bus, bit)| self.chip.has(bus, bit));
        let found = peripheral_at(address).filter(|(_, gate)| exists(*gate));
        let Some((peripheral, gate)) = found else {
            let page = address & !0x3ff;
            self.error(format!(
                "model: no peripheral is modelled at {page:#010x}, {verb}"
            ));
            return None;
        };
        if gate.is_none_or(|(bus, bit)| self.rcc.is_on(bus, bit)) {
            return Some(peripheral);
        }
        self.error(format!(
            "RCC: {} {verb} while its clock is off",
            name(peripheral)
        ));
        None
    }

    /// Reads the word at `address` (a multiple of 4).
    pub fn read(&mut self, address: u32) -> u32 {
        self.fire_due();
        let Some(peripheral) = self.reach(address, "read") else {
            return 0;
        };
        let offset = address & 0x3ff;
        let value = match peripheral {
            Peripheral::Tim(index) => self.tims[index].read(offset, self.now),
            Peripheral::Rtc => self.rtc.read(offset, self.now),
            Peripheral::Iwdg => self.iwdg.read(offset, self.now),
            Peripheral::Usart2 => self.usart.read(offset),
            Peripheral::Spi(index) => self.spis[index].read(offset, self.now),
            Peripheral::Pwr => self.pwr.read(offset, self.now),
            Peripheral::Dac => self.dac.read(offset),
            Peripheral::Adc => self.adc.read(offset),
            Peripheral::Gpio(port) => {
                self.drive_ready();
                self.gpio.read(port, offset, &self.external)
            }
            Peripheral::Rcc => self.rcc.read(offset),
            Peripheral::Flash => self.flash.read(offset),
            Peripheral::Dma(index) => self.dma[index].read(offset),
            Peripheral::Memory(_) => self.memory.get(&address).copied().unwrap_or(0),
        };
        // only reads of these two have side effects
        if matches!(peripheral, Peripheral::Usart2 | Peripheral::Adc) {
            self.update_lines();
        }
        value
    }

    /// Writes the word at `address` (a multiple of 4).
    pub fn write(&mut self, address: u32, value: u32) {
        self.fire_due();
        let Some(peripheral) = self.reach(address, "written") else {
            return;
        };
        let offset = address & 0x3ff;
        match peripheral {
            Peripheral::Tim(index) => {
                let pulses = self.with(|soc, cx| soc.tims[index].write(offset, value, cx));
                self.forward(index, pulses);
            }
            Peripheral::Rtc => {
                let is_open = self.pwr.is_backup_open();
                self.with(|soc, cx| soc.rtc.write(offset, value, is_open, cx));
            }
            Peripheral::Iwdg => self.iwdg.write(offset, value, self.now),
            Peripheral::Usart2 => self.with(|soc, cx| soc.usart.write(offset, value, cx)),
            Peripheral::Spi(index) => self.write_spi(index, offset, value),
            Peripheral::Pwr => self.pwr.write(offset, value),
            Peripheral::Dac => self.with(|soc, cx| soc.dac.write(offset, value, cx)),
            Peripheral::Adc => self.with(|soc, cx| soc.adc.write(offset, value, cx)),
            Peripheral::Gpio(port) => {
                self.gpio.write(port, offset, value);
                self.select_converters();
            }
            Peripheral::Rcc => self.write_rcc(offset, value),
            Peripheral::Flash => self.with(|soc, cx| soc.flash.write(offset, value, cx)),
            Peripheral::Dma(index) => self.with(|soc, cx| soc.dma[index].write(offset, value, cx)),
            Peripheral::Memory(_) => {
                self.memory.insert(address, value);
            }
        }
        if matches!(
            peripheral,
            Peripheral::Dac | Peripheral::Gpio(_) | Peripheral::Rcc
        ) {
            self.record_dac();
        }
        if matches!(
            peripheral,
            Peripheral::Rcc | Peripheral::Pwr | Peripheral::Flash
        ) {
            self.check_clock();
        }
        self.update_lines();
    }

    fn write_rcc(&mut self, offset: u32, value: u32) {
        if offset == rcc::BDCR as u32 {
            if !self.pwr.is_backup_open() {
                return self.error("RCC: BDCR written without DBP: ignored");
            }
            if value & rcc::BDRST != 0 {
                self.rtc = Rtc::default();
            }
        }
        if self.with(|soc, cx| soc.rcc.write(offset, value, cx)) {
            self.set_clocks(self.rcc.clocks);
        }
        self.rtc.set_clock(self.now, self.rcc.rtc_hz());
        let (pll_on, regulator_ns) = (self.rcc.is_pll_on(), self.external.regulator_ns);
        self.pwr.set_pll(pll_on, regulator_ns, self.now);
        let unit = |hz| period(hz).0;
        let clocks = self.rcc.clocks;
        let bits = |range: std::ops::Range<u32>| range.filter(move |bit| value >> bit & 1 != 0);
        match offset {
            0x10 => {
                bits(0..8).for_each(|port| self.gpio.reset(port as usize));
                bits(21..23).for_each(|bit| {
                    self.dma[bit as usize - 21] = Dma::new(bit as usize - 20);
                });
            }
            0x20 => {
                bits(0..6).for_each(|bit| {
                    let number = bit as usize + 2;
                    self.tims[bit as usize] = Tim::new(number, unit(clocks.timclk1_hz));
                });
                bits(14..16).for_each(|bit| {
                    let index = bit as usize - 14;
                    self.spis[index] = Spi::new(SPIS[index], unit(clocks.pclk1_hz));
                });
                bits(17..18).for_each(|_| self.usart = Usart::new(unit(clocks.pclk1_hz)));
                bits(28..29).for_each(|_| self.pwr = Pwr::new(self.chip));
                bits(29..30).for_each(|_| self.dac = Dac::default());
            }
            0x24 => bits(8..9).for_each(|_| self.adc = Adc::new(unit(clocks.pclk2_hz))),
            _ => {}
        }
    }

    /// Handles a store to the flash.
    pub fn program(&mut self, address: u32, size: usize, value: u64) {
        self.with(|soc, cx| soc.flash.program(address, size, value, cx));
    }

    /// Reads a word of the private peripheral bus, 0xE000_0000 to 0xE00F_FFFF.
    pub fn read_private(&mut self, address: u32) -> u32 {
        self.fire_due();
        let low = address & 0xfff;
        match address & !0xfff {
            0xe000_1000 if low < 8 => self.cycles.read(low, self.now),
            0xe000_e000 => match low {
                0x010..=0x01f => self.systick.read(low, self.now),
                0x100..=0x4ff | 0xd18..=0xd23 => self.nvic.read(low),
                0xd04 => self.nvic.icsr(),
                // MPU_TYPE: eight regions
                0xd90 => 0x800,
                _ => match self.scb.read(low) {
                    Some(value) => value,
                    None => self.memory.get(&address).copied().unwrap_or(0),
                },
            },
            _ if address == 0xe004_2000 => self.chip.idcode(),
            _ => self.memory.get(&address).copied().unwrap_or(0),
        }
    }

    /// Writes to the private peripheral bus; `address` need not be a multiple of 4.
    pub fn write_private(&mut self, address: u32, value: u32, size: usize) {
        self.fire_due();
        let low = address & 0xfff;
        match address & !0xfff {
            0xe000_1000 if low < 8 => self.cycles.write(low, value, self.now),
            0xe000_e000 => match low {
                0x010..=0x01f => self.systick.write(low, value, self.now),
                0x100..=0x4ff | 0xd18..=0xd23 => self.nvic.write(low, value, size),
                0xd04 => self.nvic.write_icsr(value),
                0xf00 => self.nvic.pend(16 + (value & 0x1ff) as usize),
                0xd94 if value & 1 != 0 => self.error("model: no memory protection unit"),
                _ => self.write_core(address, value),
            },
            _ => self.write_core(address, value),
        }
        self.update_lines();
    }

    fn write_core(&mut self, address: u32, value: u32) {
        match address {
            0xe000_ed0c if value >> 16 == 0x05fa => self.nvic.prigroup = value >> 8 & 7,
            0xe000_edfc => {
                self.cycles.advance(self.now, false);
                self.cycles.trace_on = value & 1 << 24 != 0;
            }
            0xe004_2004 => {
                self.cycles.advance(self.now, false);
                self.cycles.runs_in_sleep = value & 1 != 0;
            }
            _ => {}
        }
        if address >> 12 != 0xe000e || !self.scb.write(address & 0xfff, value) {
            self.memory.insert(address, value);
        }
        if self.scb.reset_requested {
            self.reset = Some(ResetCause::Software);
        }
    }
}

/// Whether `address` is in the flash.
pub fn is_flash(address: u32) -> bool {
    address.wrapping_sub(flash::BASE) < flash::LEN as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::from_ns;

    const RCC: u32 = 0x4002_3800;

    fn soc(writes: &[(u32, u32)]) -> Soc {
        let mut soc = Soc::new(Flash::new(vec![]), Chip::default());
        for (address, value) in writes {
            soc.write(*address, *value);
        }
        soc
    }

    fn texts(soc: &Soc) -> Vec<&str> {
        soc.errors.list.iter().map(|e| e.text.as_str()).collect()
    }

    #[test]
    fn peripheral_without_its_clock_reads_zero_and_ignores_writes() {
        let mut soc = soc(&[(0x4002_0018, 1)]);
        assert_eq!(soc.read(0x4002_0000), 0);
        let expected = [
            "RCC: GPIOA written while its clock is off",
            "RCC: GPIOA read while its clock is off",
        ];
        assert_eq!(texts(&soc), expected);
        soc.write(RCC + 0x30, 1);
        assert_eq!(soc.read(0x4002_0000), 0xa800_0000);
        assert_eq!(soc.read(0x4002_0014), 0, "the write was lost");
    }

    #[test]
    fn accesses_to_addresses_without_a_model_are_reported() {
        let mut soc = soc(&[]);
        soc.read(0x4000_5400);
        assert_eq!(
            texts(&soc),
            ["model: no peripheral is modelled at 0x40005400, read"]
        );
    }

    #[test]
    fn encoder_reaches_the_timer_only_through_its_pins() {
        let on = [
            (RCC + 0x30, 1),
            (RCC + 0x40, 1 << 3),
            (0x4000_0c08, 3),
            (0x4000_0c00, 1),
        ];
        let mut soc = soc(&on);
        soc.set_encoder(5);
        assert_eq!(soc.read(0x4000_0c24), 0);
        soc.write(0x4002_0020, 0x22);
        soc.write(0x4002_0000, 0xa800_000a);
        soc.set_encoder(12);
        assert_eq!(soc.read(0x4000_0c24), 7);
        soc.encoder_pins.swap(0, 1);
        soc.set_encoder(14);
        assert_eq!(soc.read(0x4000_0c24), 5, "swapped wires count down");
    }

    #[test]
    fn dac_pin_floats_until_it_is_analog() {
        let on = [
            (RCC + 0x30, 1),
            (RCC + 0x40, 1 << 29),
            (0x4000_7400, 3),
            (0x4000_7408, 1365),
        ];
        let mut soc = soc(&on);
        assert_eq!(soc.dac_volts(0), None);
        soc.write(0x4002_0000, 0xa800_0300);
        assert_eq!(soc.dac_volts(0), Some(1.1));
        soc.reset(ResetCause::Pin);
        assert_eq!(soc.dac_volts(0), None);
        let volts: Vec<_> = soc.dac_events.iter().map(|e| e.volts).collect();
        assert_eq!(volts, [Some(1.1), None]);
    }

    #[test]
    fn timer_update_starts_the_adc_and_the_dma_reads_it() {
        let mut soc = soc(&[
            (RCC + 0x30, 1 << 22 | 1 << 2),
            (RCC + 0x40, 1),
            (RCC + 0x44, 1 << 8),
            (0x4002_0800, 0b1111),
            // TIM2: update is TRGO, 16 MHz / 16 / 10 000
            (0x4000_0028, 15),
            (0x4000_002c, 9_999),
            (0x4000_0014, 1),
            (0x4000_0004, 2 << 4),
            // DMA2 stream 0: two half-words, circular
            (0x4002_6414, 2),
            (0x4002_6418, 0x4001_204c),
            (0x4002_641c, 0x2000_0000),
            (
                0x4002_6410,
                1 << 13 | 1 << 11 | 1 << 10 | 1 << 8 | 1 << 4 | 1,
            ),
            // ADC1: scan of channels 10 and 11, triggered by TIM2 TRGO, DMA
            (0x4001_2004, 1 << 8),
            (0x4001_200c, 0o44),
            (0x4001_202c, 1 << 20),
            (0x4001_2034, 10 | 11 << 5),
            (0x4001_2008, 1 << 28 | 6 << 24 | 1 << 9 | 1 << 8 | 1),
            (0x4000_0000, 1),
        ]);
        soc.external.volts[2][0] = 1.65;
        soc.external.volts[2][1] = 3.3;
        let mut transfers = vec![];
        while transfers.len() < 4 {
            soc.now = soc.next_event();
            soc.fire_due();
            while let Some((_, _, transfer)) = soc.next_transfer() {
                transfers.push((transfer.to, soc.read(transfer.from)));
            }
        }
        let both = [(0x2000_0000, 2048), (0x2000_0002, 4095)];
        assert_eq!(transfers, [both, both].concat());
        assert!(soc.now > from_ns(20_000_000) && soc.now < from_ns(20_100_000));
        assert_eq!(texts(&soc), Vec::<&str>::new());
    }

    #[test]
    fn reset_keeps_time_and_external_signals() {
        let mut soc = soc(&[(RCC + 0x30, 1)]);
        soc.now = 1000;
        soc.set_encoder(7);
        soc.reset(ResetCause::Watchdog);
        assert_eq!((soc.now, soc.encoder), (1000, 7));
        assert_eq!(soc.read(RCC + 0x74) >> 24, 0x2e);
        assert_eq!(soc.read(RCC + 0x30), 0);
    }

    #[test]
    fn cycle_counter_counts_only_with_trace_enabled() {
        let mut soc = soc(&[]);
        soc.write_private(0xe000_edfc, 1 << 24, 4);
        soc.write_private(0xe000_1000, 1, 4);
        soc.now += 3150 * 5;
        assert_eq!(soc.read_private(0xe000_1004), 5);
    }
}
