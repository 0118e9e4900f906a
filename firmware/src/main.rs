//! The power assist on the board: the tasks and what connects them. All decisions are made in
//! model-core.
//!
//! | priority | task                  | runs                 | time budget                   |
//! |----------|-----------------------|----------------------|-------------------------------|
//! | 3        | [`app::tick`]         | every 10 ms          | 1 % of the period             |
//! | 3        | `scan_bridge`         | every 625 µs, only with the feature `ads1220` | 2 %   |
//! | 2        | [`app::serve_link`]   | every 1 ms           | what the tick leaves          |
//! | 0        | [`app::idle`]         | otherwise            | logs, self-test, sleeps       |
//!
//! The tasks exchange data through queues, without locks. Only masked interrupts can delay the
//! tick: while a log entry is written, and while settings are stored, when the valve is at 0 V.
#![no_std]
#![no_main]

mod board;
mod crash;
mod driver;
mod link;
mod ram;
mod self_test;

use defmt_rtt as _;

#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use crate::board::{self, ButtonPin, EnablingPin, LampPin, PortPin, StopPins};
    use crate::crash;
    use crate::driver::Devices;
    use crate::driver::adc::Adc;
    #[cfg(feature = "ads1220")]
    use crate::driver::bridge_converter::BridgeConverter;
    use crate::driver::counter::Counter;
    use crate::driver::flash::Flash;
    use crate::driver::iwdg::{self, Iwdg};
    use crate::driver::valve::{self, Valve};
    use crate::link::{self, Link};
    use crate::self_test::{self, SelfTest};
    use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
    use cortex_m::peripheral::{DWT, SCB};
    use heapless::spsc::{Consumer, Producer, Queue};
    use model_core::device::{Command, Device, Pins};
    use model_core::gate::{Decision, SettingsGate, Verdict};
    use model_core::io::Request;
    use model_core::link::{Crash, FromDevice, Identity, Signature, Telemetry, ToDevice, Written};
    use model_core::settings::SettingsValues;
    use model_core::supervisor::{Fault, Mode};
    use model_core::timing::TickClock;
    use rig_drivers::button::Button;
    use rig_drivers::contact::Contact;
    use rig_drivers::encoder::Encoder;
    use rig_drivers::output::Output;
    use rig_drivers::stop::Stop;
    use rig_drivers::store::Store;
    use rig_drivers::valve::AnalogOutput;
    use rig_drivers::watchdog::Watchdog;
    use stm32f4xx_hal::ClearFlags;
    use stm32f4xx_hal::pac::TIM3;
    use stm32f4xx_hal::timer::{CounterUs, Flag, SysDelay};

    /// A vent request for the next tick. Not in the command queue, which may be full.
    static VENT_REQUESTED: AtomicBool = AtomicBool::new(false);
    /// Set by the tick while settings must not change.
    static ARMED: AtomicBool = AtomicBool::new(false);

    // RTIC refers to the type of a resource also where it leaves the resource out.
    #[cfg(not(feature = "ads1220"))]
    type BridgeConverter = ();

    const VENT: Command = Command::Request(Request::Vent);

    /// Mode and fault after a change, for the log.
    type Change = (Mode, Option<Fault>);

    #[shared]
    struct Shared {}

    #[local]
    struct Local {
        device: Device,
        clock: TickClock,
        adc: Adc,
        #[cfg(feature = "ads1220")]
        bridge_converter: BridgeConverter,
        encoder: Encoder<Counter>,
        button: Button<ButtonPin>,
        stop: Stop<StopPins>,
        enabling: Contact<EnablingPin>,
        valve: Valve,
        port: Output<PortPin>,
        lamp: Output<LampPin>,
        watchdog: Watchdog<Iwdg>,
        to_tick: Producer<'static, Command>,
        commands: Consumer<'static, Command>,
        from_tick: Producer<'static, Telemetry>,
        telemetries: Consumer<'static, Telemetry>,
        to_ask: Producer<'static, Option<u32>>,
        proposals: Consumer<'static, Option<u32>>,
        to_decide: Producer<'static, Verdict>,
        verdicts: Consumer<'static, Verdict>,
        gate: SettingsGate,
        signature: Signature,
        link: Link,
        link_timer: CounterUs<TIM3>,
        delay: SysDelay,
        store: Store<Flash>,
        settings: SettingsValues,
        identity: Identity,
        last_change: Change,
        to_log: Producer<'static, Change>,
        changes: Consumer<'static, Change>,
        self_test: SelfTest,
    }

    #[init(local = [
        command_queue: Queue<Command, 16> = Queue::new(),
        telemetry_queue: Queue<Telemetry, 4> = Queue::new(),
        change_queue: Queue<Change, 8> = Queue::new(),
        proposal_queue: Queue<Option<u32>, 8> = Queue::new(),
        verdict_queue: Queue<Verdict, 8> = Queue::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let note = crash::take_note();
        let reset = iwdg::reset_cause(&cx.device.RCC);
        let mut devices = Devices::new(cx.device, cx.core);
        let (settings, source) = devices.store.load();
        defmt::info!(
            "reset cause: {=str}; before it: crash {=str}, fault {=str}",
            reset.name(),
            note.crash.map_or("none", Crash::name),
            note.fault.map_or("none", Fault::name)
        );
        if iwdg::STOPS_IN_DEBUG {
            defmt::warn!("a halt stops the watchdog: the valve's supply must be off");
        }
        let start = devices.findings.fault();
        if let Some(fault) = start {
            defmt::error!("start-up self-test: {=str}", fault.name());
        }
        let identity = link::identity(reset, note, source, settings.values(), start);

        let (to_tick, commands) = cx.local.command_queue.split();
        let (from_tick, telemetries) = cx.local.telemetry_queue.split();
        let (to_log, changes) = cx.local.change_queue.split();
        let (to_ask, proposals) = cx.local.proposal_queue.split();
        let (to_decide, verdicts) = cx.local.verdict_queue.split();
        devices.watchdog.expect_ticks();
        #[cfg(not(feature = "ads1220"))]
        devices.tick_timer.start();
        #[cfg(feature = "ads1220")]
        devices.bridge_converter.start();
        (
            Shared {},
            Local {
                device: Device::new(settings).started(start),
                clock: TickClock::new(board::TICK_CYCLES),
                adc: devices.adc,
                #[cfg(feature = "ads1220")]
                bridge_converter: devices.bridge_converter,
                encoder: devices.encoder,
                button: devices.button,
                stop: devices.stop,
                enabling: devices.enabling,
                valve: devices.valve,
                port: devices.port,
                lamp: devices.lamp,
                watchdog: devices.watchdog,
                to_tick,
                commands,
                from_tick,
                telemetries,
                to_ask,
                proposals,
                to_decide,
                verdicts,
                gate: SettingsGate::default(),
                signature: Signature::default(),
                link: Link::new(devices.serial),
                link_timer: devices.link_timer,
                delay: devices.delay,
                store: devices.store,
                settings: *settings.values(),
                identity,
                last_change: (Mode::SelfCheck, None),
                to_log,
                changes,
                self_test: SelfTest::new(devices.slow_counter),
            },
        )
    }

    /// One tick of the controller; the DMA starts it when the scan of the ADC is complete.
    #[task(binds = DMA2_STREAM0, priority = 3,
        local = [device, clock, adc, encoder, button, stop, enabling, valve, port, lamp, watchdog,
        commands, from_tick, proposals, to_decide])]
    fn tick(cx: tick::Context) {
        let local = cx.local;
        let begin_cycles = DWT::cycle_count();
        let timing = local.clock.begin(begin_cycles);
        let [bridge, pressure, read_back] = local.adc.read();
        let pins = Pins {
            bridge,
            pressure,
            encoder: local.encoder.read(),
            read_back,
            button_pressed: local.button.is_pressed(),
            stop_open: local.stop.open(),
            enabling_closed: local.enabling.is_closed(),
        };
        while let Some(proposed) = local.proposals.dequeue() {
            local.device.propose(proposed);
        }
        if let Some(fault) = self_test::found() {
            local.device.fail(fault);
        }
        let vent = VENT_REQUESTED.swap(false, Relaxed).then_some(VENT);
        let queued = core::iter::from_fn(|| local.commands.dequeue());
        let tick = local
            .device
            .tick(&pins, timing, vent.into_iter().chain(queued));
        local.valve.set(tick.valve);
        local.port.set(tick.port_pulse);
        local.lamp.set(tick.lamp);
        ARMED.store(tick.armed, Relaxed);
        if let Some(verdict) = tick.verdict {
            // Full only if the link task does not run: then nothing is stored.
            let _ = local.to_decide.enqueue(verdict);
        }
        // Full only if the link task has not run for four ticks. The PC sees the gap in the tick
        // numbers.
        let _ = local.from_tick.enqueue(tick.telemetry);
        local.watchdog.feed();
        local.clock.end(begin_cycles, DWT::cycle_count());
    }

    /// Reads the bridge's converter, at each scan of the ADC. With the priority of the tick, which
    /// follows the last of its scans.
    #[cfg(feature = "ads1220")]
    #[task(binds = TIM2, priority = 3, local = [bridge_converter])]
    fn scan_bridge(cx: scan_bridge::Context) {
        cx.local.bridge_converter.scan();
    }

    /// Sends telemetry and answers, receives commands.
    #[task(binds = TIM3, priority = 2, local = [link, link_timer, delay, telemetries, to_tick,
        store, settings, identity, to_log, last_change, to_ask, verdicts, gate, signature,
        identity_sent: bool = false])]
    fn serve_link(cx: serve_link::Context) {
        let local = cx.local;
        let link = local.link;
        let mut decision = None;
        local.link_timer.clear_flags(Flag::Update);
        let mut identify = !core::mem::replace(local.identity_sent, true);
        while let Some(telemetry) = local.telemetries.dequeue() {
            link.send(telemetry);
            let change = (telemetry.output.mode, telemetry.output.fault);
            if core::mem::replace(local.last_change, change) != change {
                crash::note_fault(telemetry.output.fault);
                // A full queue loses the log entry only: the telemetry has the change, too.
                let _ = local.to_log.enqueue(change);
            }
        }
        while let Some(verdict) = local.verdicts.dequeue() {
            decision = decision.or(local.gate.decide(verdict));
        }
        while decision.is_none()
            && let Some(message) = link.receive()
        {
            match message {
                ToDevice::Identify => identify = true,
                ToDevice::ReadSettings => link.answer(&FromDevice::Settings(*local.settings)),
                ToDevice::WriteSettings(values) => {
                    let armed = ARMED.load(Relaxed);
                    let signature = core::mem::take(local.signature);
                    decision = Some(local.gate.offer(local.settings, values, signature, armed));
                }
                ToDevice::Sign(signature) => *local.signature = signature,
                ToDevice::ReadChange(back) => {
                    link.answer(&FromDevice::Change(local.store.change(back)));
                }
                ToDevice::Command(VENT) => VENT_REQUESTED.store(true, Relaxed),
                ToDevice::Command(command) => {
                    if local.to_tick.enqueue(command).is_err() {
                        link.messages_dropped = link.messages_dropped.saturating_add(1);
                    }
                }
            }
        }
        if let Some(decision) = decision {
            carry_out(
                link,
                local.gate,
                local.to_ask,
                local.store,
                local.delay,
                &decision,
            );
        }
        if identify {
            local.identity.stack_free_bytes = crash::stack_free_bytes();
            local.identity.frames_rejected = link.frames_rejected;
            local.identity.messages_dropped = link.messages_dropped;
            link.answer(&FromDevice::Identity(*local.identity));
        }
        link.pump();
    }

    /// Answers, asks at the device, or stores settings and resets the board, which then starts with
    /// them. Settings change in no other way, so that they are constant while ticks run. Refused
    /// while armed.
    fn carry_out(
        link: &mut Link,
        gate: &mut SettingsGate,
        to_ask: &mut Producer<'static, Option<u32>>,
        store: &mut Store<Flash>,
        delay: &mut SysDelay,
        decision: &Decision,
    ) {
        let answer = |written| FromDevice::Written(written);
        match decision {
            Decision::Answer(written) => link.answer(&answer(*written)),
            Decision::Ask(number) if to_ask.enqueue(Some(*number)).is_ok() => {
                link.answer(&answer(Written::AwaitsButton));
            }
            Decision::Ask(_) => {
                gate.forget();
                link.answer(&answer(Written::NotConfirmed));
            }
            // In a full queue the question goes on, but no answer to it has an effect.
            Decision::Withdraw => {
                let _ = to_ask.enqueue(None);
                link.answer(&answer(Written::NotConfirmed));
            }
            Decision::Store(settings, signature) => cortex_m::interrupt::free(|_| {
                // The tick, which writes it, is masked from here on.
                if ARMED.load(Relaxed) {
                    return link.answer(&answer(Written::Armed));
                }
                valve::make_safe();
                iwdg::expect_no_ticks();
                let stored = store.store(settings, signature);
                link.answer(&answer(if stored {
                    Written::Stored
                } else {
                    Written::FlashFailed
                }));
                link.flush(delay);
                SCB::sys_reset()
            }),
        }
    }

    /// Writes changes of mode and fault to the log, tests a slice of flash and RAM, and sleeps.
    #[idle(local = [changes, self_test])]
    fn idle(cx: idle::Context) -> ! {
        loop {
            while let Some((mode, fault)) = cx.local.changes.dequeue() {
                // As text: interrupts are masked while an entry is formatted.
                let fault = fault.map_or("none", Fault::name);
                defmt::info!("mode: {=str}, fault: {=str}", mode.name(), fault);
            }
            cx.local.self_test.step();
            cortex_m::asm::wfi();
        }
    }
}
