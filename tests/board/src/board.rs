//! The interface of the board: pins, serial link, supply, reset button, and time.

use crate::adc::Imperfection;
use crate::ads1220::ConverterFaults;
use crate::chip::Chip;
use crate::cpu::{Cpu, ExceptionEvent};
use crate::elf::{self, BadElf};
use crate::engine::{RAM, RAM_LEN};
use crate::errors::BoardError;
use crate::flash::{self, Flash};
use crate::log::{self, Log};
use crate::pin::Pin;
use crate::rcc::{Oscillators, ResetCause};
use crate::soc::{DacEvent, Soc, is_flash};
use crate::time::{from_ns, to_ns};

/// Duration of the low pulse at NRST after an internal reset (datasheet, about 20 µs).
const RESET_PULSE_NS: u64 = 20_000;
/// Symbol of an image whose board has a converter for the bridge.
const BRIDGE_CONVERTER: &str = "bridge_converter_ads1220";
/// Start of the private peripheral bus.
const PRIVATE: u32 = 0xe000_0000;

/// A byte sent by the board.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LinkByte {
    /// End of its stop bit.
    pub time_ns: u64,
    /// Its value.
    pub byte: u8,
}

/// One reset.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reset {
    /// Time of the reset.
    pub time_ns: u64,
    /// Its cause.
    pub cause: ResetCause,
}

/// A board with a firmware in its flash; the firmware says for which chip it is.
pub struct Board {
    cpu: Cpu,
    log: Option<Log>,
    symbols: Vec<(String, u32)>,
    powered: bool,
    resets: Vec<Reset>,
    power_cuts: u64,
}

impl Board {
    /// Flashes the firmware `elf` into an erased chip and switches the supply on.
    pub fn new(elf: &[u8]) -> Result<Board, BadElf> {
        let mut cells = vec![0xff; flash::LEN];
        for (address, bytes) in elf::load_segments(elf)? {
            let start = address.wrapping_sub(flash::BASE) as usize;
            let target = start
                .checked_add(bytes.len())
                .and_then(|end| cells.get_mut(start..end));
            match target {
                Some(target) if is_flash(address) => target.copy_from_slice(&bytes),
                _ => return Err(BadElf(format!("{address:#010x} is not in the flash"))),
            }
        }
        let symbols = elf::symbols(elf);
        let mut board = Board::from_flash(cells, Chip::of(&symbols)?);
        if symbols.iter().any(|(name, _)| name == BRIDGE_CONVERTER) {
            board.set_bridge_converter(ConverterFaults::default());
        }
        board.symbols = symbols;
        board.log = Log::new(elf, &board.symbols);
        Ok(board)
    }

    /// A board whose flash contains `cells`, without symbols and logs.
    pub fn from_flash(cells: Vec<u8>, chip: Chip) -> Board {
        Board {
            cpu: Cpu::new(Soc::new(Flash::new(cells), chip)),
            log: None,
            symbols: vec![],
            powered: true,
            resets: vec![],
            power_cuts: 0,
        }
    }

    // ---- time and supply -----------------------------------------------------------------------

    /// Time since the board was created \[ns\].
    pub fn time_ns(&self) -> u64 {
        to_ns(self.cpu.soc().now)
    }

    /// Runs until `time_ns`, or a few core cycles longer, because instructions are not divided.
    /// Executes the resets that the chip requests in this time.
    pub fn run_until(&mut self, time_ns: u64) {
        let end = from_ns(time_ns);
        while self.cpu.soc().now < end {
            if !self.powered {
                self.cpu.pass_unpowered(end);
            } else if let Some(cause) = self.cpu.run_until(end) {
                self.reset(cause);
            }
        }
        self.read_log();
    }

    /// Runs for `duration_ns`.
    pub fn run_for(&mut self, duration_ns: u64) {
        self.run_until(self.time_ns() + duration_ns);
    }

    fn reset(&mut self, cause: ResetCause) {
        self.read_log();
        self.cpu.reset(cause);
        self.resets.push(Reset {
            time_ns: self.time_ns(),
            cause,
        });
        if let Some(log) = &mut self.log {
            log.cut();
        }
        let now = self.cpu.soc().now;
        self.cpu.pass_unpowered(now + from_ns(RESET_PULSE_NS));
    }

    /// Stops the core, as an endless loop with masked interrupts would, or lets it continue.
    /// Timers, DMA and watchdog continue in any case.
    pub fn hold_core(&mut self, held: bool) {
        self.cpu.held = held;
        if held {
            // The core is busy, not asleep: the cycle counter counts.
            self.cpu.asleep = false;
        }
    }

    /// Halts the core as a debugger does, or lets it continue. The watchdog stops with it only if
    /// DBGMCU says so.
    pub fn halt(&mut self, halted: bool) {
        self.cpu.soc_mut().halt(halted);
    }

    /// Whether a debugger halts the core.
    pub fn is_halted(&self) -> bool {
        self.cpu.soc().halted
    }

    /// Halts the core at the next hard fault, as a debugger with vector catch does.
    pub fn catch_hard_fault(&mut self) {
        self.cpu.catches_hard_fault = true;
    }

    /// Writes a register of a peripheral or of the core, as a debugger does.
    pub fn write_register(&mut self, address: u32, value: u32) {
        let soc = self.cpu.soc_mut();
        if address >= PRIVATE {
            soc.write_private(address, value, 4);
        } else {
            soc.write(address, value);
        }
    }

    /// Reads a register of a peripheral or of the core, as a debugger does.
    pub fn read_register(&mut self, address: u32) -> u32 {
        let soc = self.cpu.soc_mut();
        if address >= PRIVATE {
            soc.read_private(address)
        } else {
            soc.read(address)
        }
    }

    /// The oscillators.
    pub fn oscillators(&self) -> Oscillators {
        self.cpu.soc().rcc.oscillators()
    }

    /// Changes the oscillators: their tolerance, or whether they oscillate.
    pub fn set_oscillators(&mut self, oscillators: Oscillators) {
        self.cpu.soc_mut().set_oscillators(oscillators);
    }

    /// Presses and releases the reset button.
    pub fn reset_pin(&mut self) {
        if self.powered {
            self.reset(ResetCause::Pin);
        }
    }

    /// Switches the supply off: RAM loses its content, a flash operation is interrupted.
    pub fn power_cut(&mut self) {
        self.read_log();
        self.power_cuts += 1;
        self.cpu.reset(ResetCause::Power);
        self.cpu.scramble_ram(self.power_cuts);
        self.powered = false;
        if let Some(log) = &mut self.log {
            log.cut();
        }
    }

    /// Switches the supply on again.
    pub fn power_on(&mut self) {
        if !self.powered {
            self.powered = true;
            self.reset(ResetCause::Power);
        }
    }

    /// All resets so far, except the first power-up.
    pub fn resets(&self) -> &[Reset] {
        &self.resets
    }

    // ---- pins ----------------------------------------------------------------------------------

    /// Drives a pin to a voltage that the ADC can see.
    pub fn set_analog(&mut self, pin: Pin, volts: f64) {
        let soc = self.cpu.soc_mut();
        soc.external.volts[usize::from(pin.port)][usize::from(pin.number)] = volts;
    }

    /// Makes the converter differ from an ideal one.
    pub fn set_converter(&mut self, imperfection: Imperfection) {
        self.cpu.soc_mut().external.converter = imperfection;
    }

    /// Changes what is wrong with the converter of the bridge, which the board has from now on. The
    /// voltage of PC0, to which no bridge is wired then, is its signal: 0 to 3.3 V for ±1.953 mV/V.
    pub fn set_bridge_converter(&mut self, faults: ConverterFaults) {
        self.cpu.soc_mut().set_converter_faults(faults);
    }

    /// Pulls the valve's output to a voltage, as a short circuit or a wrong amplifier would.
    pub fn load_valve(&mut self, volts: Option<f64>) {
        self.cpu.soc_mut().external.valve_load = volts;
    }

    /// Sets the time that the regulator of the core takes; none if it never reaches its voltage.
    pub fn set_regulator_ns(&mut self, regulator_ns: Option<u64>) {
        self.cpu.soc_mut().external.regulator_ns = regulator_ns;
    }

    /// Sets the option BOR_LEV: 0 is the highest level, 3 (a new chip) is off.
    pub fn set_brown_out_level(&mut self, level: u8) {
        self.cpu.soc_mut().flash.brown_out_level = level;
    }

    /// From now on some bits of a word of the RAM read as 1.
    pub fn stick_ram(&mut self, address: u32, bits: u32) {
        self.cpu.stick_ram(address, bits);
    }

    /// Drives a pin to a digital level, or lets it float.
    pub fn set_level(&mut self, pin: Pin, level: Option<bool>) {
        let soc = self.cpu.soc_mut();
        soc.external.levels[usize::from(pin.port)][usize::from(pin.number)] = level;
    }

    /// Level of an output pin; none if the chip does not drive it.
    pub fn level(&self, pin: Pin) -> Option<bool> {
        self.cpu.soc().output(pin)
    }

    /// Sets the pins of the encoder signals A and B; PA0 and PA1 by default.
    pub fn wire_encoder(&mut self, a: Pin, b: Pin) {
        self.cpu.soc_mut().encoder_pins = [a, b];
    }

    /// Moves the encoder to `position`, in quadrature edges; A leads B in the positive direction.
    pub fn set_encoder(&mut self, position: i64) {
        self.cpu.soc_mut().set_encoder(position);
    }

    /// The chip.
    pub fn chip(&self) -> Chip {
        self.cpu.soc().chip
    }

    /// Voltage at the pin of DAC channel 1 or 2, or of the MCP4922 in place of the first. A
    /// floating pin is at 0 V because of the resistor in docs/wiring.md.
    pub fn dac_volts(&self, channel: usize) -> f64 {
        self.cpu.soc().dac_volts(channel - 1).unwrap_or(0.0)
    }

    /// Changes of the DAC pins since the last call.
    pub fn dac_events(&mut self) -> Vec<DacEvent> {
        std::mem::take(&mut self.cpu.soc_mut().dac_events)
    }

    // ---- serial link ---------------------------------------------------------------------------

    /// Sets the baud rate of the PC; 115 200 bit/s by default.
    pub fn set_link_baud(&mut self, baud: u32) {
        self.cpu.soc_mut().host.baud = baud;
    }

    /// Sends bytes to USART2, one after the other, starting now.
    pub fn link_send(&mut self, bytes: &[u8]) {
        let soc = self.cpu.soc_mut();
        soc.host.send(bytes, soc.now);
    }

    /// Count of the bytes sent that have not arrived yet.
    pub fn link_unsent(&self) -> usize {
        self.cpu.soc().host.unsent()
    }

    /// Bytes that USART2 has sent since the last call.
    pub fn link_receive(&mut self) -> Vec<LinkByte> {
        let received = std::mem::take(&mut self.cpu.soc_mut().host.received);
        received
            .into_iter()
            .map(|b| LinkByte {
                time_ns: to_ns(b.at),
                byte: b.byte,
            })
            .collect()
    }

    // ---- inspection ----------------------------------------------------------------------------

    /// Errors of the firmware, most of which a real board would not report, and accesses to what
    /// is not modelled.
    pub fn errors(&self) -> &[BoardError] {
        &self.cpu.soc().errors.list
    }

    /// The errors as text, each with the function in which it occurred.
    pub fn error_report(&self) -> String {
        let line = |e: &BoardError| {
            let (seconds, place) = (e.time_ns as f64 * 1e-9, self.function_at(e.pc));
            format!(
                "{:.6} s, {} times, at {:#010x} in {place}: {}\n",
                seconds, e.count, e.pc, e.text
            )
        };
        self.errors().iter().map(line).collect()
    }

    /// Instructions executed since the board was created.
    pub fn instructions(&self) -> u64 {
        self.cpu.soc().instructions
    }

    /// Core clock \[Hz\].
    pub fn core_clock_hz(&self) -> u64 {
        self.cpu.soc().rcc.clocks.hclk_hz
    }

    /// Whether the core waits for an interrupt.
    pub fn is_asleep(&self) -> bool {
        self.cpu.is_asleep()
    }

    /// Whether the core is in lock-up, after a fault in a fault handler.
    pub fn is_locked_up(&self) -> bool {
        self.cpu.is_locked_up()
    }

    /// Address of the next instruction.
    pub fn pc(&self) -> u32 {
        self.cpu.pc()
    }

    /// Stack pointer.
    pub fn sp(&self) -> u32 {
        self.cpu.sp()
    }

    /// Count of the flash sectors erased.
    pub fn flash_erase_count(&self) -> u64 {
        self.cpu.soc().flash.erase_count
    }

    /// Whether a flash operation is in progress.
    pub fn is_flash_busy(&self) -> bool {
        self.cpu.soc().flash.busy_until() > self.cpu.soc().now
    }

    /// Starts or stops recording exceptions.
    pub fn trace_exceptions(&mut self, on: bool) {
        self.cpu.trace = on.then(Vec::new);
    }

    /// Exceptions entered and left since the last call.
    pub fn exceptions(&mut self) -> Vec<ExceptionEvent> {
        self.cpu
            .trace
            .as_mut()
            .map(std::mem::take)
            .unwrap_or_default()
    }

    /// Counts loads from the flash, too, from now on, for [`ExceptionEvent::cost`]. The program
    /// must not change the flash afterwards: the engine does not support both.
    pub fn count_loads(&mut self) {
        self.cpu.count_loads();
    }

    /// Bytes of memory as the core reads them; empty if the address is not mapped.
    pub fn read_memory(&self, address: u32, len: usize) -> Vec<u8> {
        self.cpu.memory(address, len).unwrap_or_default()
    }

    /// Overwrites RAM, as a debugger could.
    pub fn write_ram(&mut self, address: u32, bytes: &[u8]) {
        let end = address as usize + bytes.len();
        assert!(
            address >= RAM && end <= RAM as usize + RAM_LEN,
            "{address:#x} is not RAM"
        );
        self.cpu.set_memory(address, bytes);
    }

    /// Content of the flash.
    pub fn flash(&self) -> &[u8] {
        &self.cpu.soc().flash.cells
    }

    /// Cells of the flash, as offsets, that keep their content when they are programmed.
    pub fn wear_flash(&mut self, cells: std::ops::Range<usize>) {
        self.cpu.soc_mut().flash.worn = cells;
    }

    /// Overwrites flash without delay, as a programmer could.
    pub fn write_flash(&mut self, address: u32, bytes: &[u8]) {
        let start = address.wrapping_sub(flash::BASE) as usize;
        assert!(
            start + bytes.len() <= flash::LEN,
            "{address:#x} is not flash"
        );
        self.cpu.write_flash(start, bytes);
    }

    /// Address of a symbol of the ELF.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols
            .iter()
            .find(|(symbol, _)| symbol == name)
            .map(|(_, address)| *address)
    }

    /// Address of the first symbol whose mangled name contains `part`.
    pub fn symbol_with(&self, part: &str) -> Option<u32> {
        let has_part = |(symbol, _): &&(String, u32)| symbol.contains(part);
        self.symbols
            .iter()
            .find(has_part)
            .map(|(_, address)| *address)
    }

    /// The symbol at or before `address`.
    pub fn function_at(&self, address: u32) -> String {
        let before = |(_, a): &&(String, u32)| *a & !1 <= address && *a != 0;
        let nearest = self.symbols.iter().filter(before).max_by_key(|(_, a)| *a);
        nearest.map_or("?".into(), |(name, _)| format!("{name:#}"))
    }

    /// Log lines since the last call.
    pub fn logs(&mut self) -> Vec<String> {
        self.read_log();
        self.log
            .as_mut()
            .map(|log| std::mem::take(&mut log.lines))
            .unwrap_or_default()
    }

    fn read_log(&mut self) {
        let (Some(log), true) = (&mut self.log, self.powered) else {
            return;
        };
        let block = log.control_block();
        let Some(header) = self.cpu.memory(block, log::CONTROL_BLOCK_LEN) else {
            return;
        };
        let Some(channel) = Log::channel(&header) else {
            return;
        };
        let Some(buffer) = self.cpu.memory(channel.buffer, channel.size as usize) else {
            return;
        };
        let (read, write) = (channel.read as usize, channel.write as usize);
        if read <= write {
            log.feed(&buffer[read..write]);
        } else {
            log.feed(&[&buffer[read..], &buffer[..write]].concat());
        }
        self.cpu
            .set_memory(block + log::READ_OFFSET, &channel.write.to_le_bytes());
    }
}
