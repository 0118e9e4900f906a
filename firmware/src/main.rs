//! The power assist on the board: what runs when. What is decided, model-core decides.
//!
//! | priority | task                  | when                 | may take                      |
//! |----------|-----------------------|----------------------|-------------------------------|
//! | 3        | [`app::tick`]         | each 10 ms           | 1 % of that                   |
//! | 2        | [`app::serve_link`]   | each ms              | what the tick leaves          |
//! | 0        | [`app::idle`]         | else                 | sleeps, having logged         |
//!
//! Queues connect them, no locks: nothing can make the tick wait but masked interrupts, which last
//! as long as a log entry.
#![no_std]
#![no_main]

mod adc;
mod board;
mod crash;
mod encoder;
mod flash;
mod link;
mod valve;
mod watchdog;

use defmt_rtt as _;

#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use crate::adc::{self, Scanner};
    use crate::board::{self, Button, Parts};
    use crate::crash;
    use crate::encoder::Encoder;
    use crate::flash::Store;
    use crate::link::Link;
    use crate::valve::{self, Valve};
    use crate::watchdog::{self, Watchdog};
    use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
    use cortex_m::peripheral::{DWT, SCB};
    use heapless::spsc::{Consumer, Producer, Queue};
    use model_core::device::{Command, Device, Pins};
    use model_core::io::Request;
    use model_core::link::{FromDevice, Identity, Telemetry, ToDevice, Written};
    use model_core::settings::{Settings, SettingsValues};
    use model_core::supervisor::{Fault, Mode};
    use model_core::timing::TickClock;
    use stm32f4xx_hal::ClearFlags;
    use stm32f4xx_hal::pac::TIM3;
    use stm32f4xx_hal::timer::{CounterUs, Flag};

    /// Told to the tick: venting is asked for. Not queued, so that nothing can crowd it out.
    static VENT: AtomicBool = AtomicBool::new(false);
    /// Told by the tick: settings must not change.
    static ARMED: AtomicBool = AtomicBool::new(false);

    const VENTING: Command = Command::Request(Request::Vent);

    /// What is logged.
    type Change = (Mode, Option<Fault>);

    #[shared]
    struct Shared {}

    #[local]
    struct Local {
        device: Device,
        clock: TickClock,
        scanner: Scanner,
        encoder: Encoder,
        button: Button,
        valve: Valve,
        watchdog: Watchdog,
        to_tick: Producer<'static, Command>,
        commands: Consumer<'static, Command>,
        from_tick: Producer<'static, Telemetry>,
        telemetries: Consumer<'static, Telemetry>,
        link: Link,
        link_timer: CounterUs<TIM3>,
        store: Store,
        settings: SettingsValues,
        identity: Identity,
        last_change: Change,
        to_log: Producer<'static, Change>,
        changes: Consumer<'static, Change>,
    }

    #[init(local = [
        command_queue: Queue<Command, 16> = Queue::new(),
        telemetry_queue: Queue<Telemetry, 4> = Queue::new(),
        change_queue: Queue<Change, 8> = Queue::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let note = crash::take_note();
        let reset = watchdog::reset_cause(&cx.device.RCC);
        let mut parts = Parts::new(cx.device, cx.core);
        let (settings, source) = parts.store.load();
        defmt::info!(
            "reset: {}, before it: {}",
            defmt::Debug2Format(&reset),
            defmt::Debug2Format(&note)
        );
        let identity = board::identity(reset, note, source);

        let (to_tick, commands) = cx.local.command_queue.split();
        let (from_tick, telemetries) = cx.local.telemetry_queue.split();
        let (to_log, changes) = cx.local.change_queue.split();
        parts.watchdog.expect_ticks();
        adc::start_ticks(parts.tick_timer, &mut parts.rcc);
        (
            Shared {},
            Local {
                device: Device::new(settings),
                clock: TickClock::new(board::TICK_CYCLES),
                scanner: parts.scanner,
                encoder: parts.encoder,
                button: parts.button,
                valve: parts.valve,
                watchdog: parts.watchdog,
                to_tick,
                commands,
                from_tick,
                telemetries,
                link: parts.link,
                link_timer: parts.link_timer,
                store: parts.store,
                settings: *settings.values(),
                identity,
                last_change: (Mode::SelfCheck, None),
                to_log,
                changes,
            },
        )
    }

    /// The scan of this tick's conversions has ended.
    #[task(binds = DMA2_STREAM0, priority = 3,
        local = [device, clock, scanner, encoder, button, valve, watchdog, commands, from_tick])]
    fn tick(cx: tick::Context) {
        let local = cx.local;
        let begin_cycles = DWT::cycle_count();
        let timing = local.clock.begin(begin_cycles);
        let (bridge, pressure) = local.scanner.read();
        let pins = Pins {
            bridge,
            pressure,
            encoder: local.encoder.read(),
            button_pressed: local.button.is_pressed(),
        };
        let vent = VENT.swap(false, Relaxed).then_some(VENTING);
        let queued = core::iter::from_fn(|| local.commands.dequeue());
        let tick = local
            .device
            .tick(&pins, timing, vent.into_iter().chain(queued));
        local.valve.set(tick.valve);
        ARMED.store(tick.armed, Relaxed);
        // Full only if the link has not had its turn for four ticks: the tick's number shows it.
        let _ = local.from_tick.enqueue(tick.telemetry);
        local.watchdog.feed();
        local.clock.end(begin_cycles, DWT::cycle_count());
    }

    #[task(binds = TIM3, priority = 2, local = [link, link_timer, telemetries, to_tick, store,
        settings, identity, to_log, last_change, greeted: bool = false])]
    fn serve_link(cx: serve_link::Context) {
        let local = cx.local;
        let link = local.link;
        local.link_timer.clear_flags(Flag::Update);
        let mut identify = !core::mem::replace(local.greeted, true);
        while let Some(telemetry) = local.telemetries.dequeue() {
            link.send(telemetry);
            let change = (telemetry.output.mode, telemetry.output.fault);
            if core::mem::replace(local.last_change, change) != change {
                crash::note_fault(telemetry.output.fault);
                // What is not logged is in the telemetry.
                let _ = local.to_log.enqueue(change);
            }
        }
        while let Some(message) = link.receive() {
            match message {
                ToDevice::Identify => identify = true,
                ToDevice::ReadSettings => link.answer(&FromDevice::Settings(*local.settings)),
                ToDevice::WriteSettings(values) => write_settings(link, local.store, values),
                ToDevice::Command(VENTING) => VENT.store(true, Relaxed),
                ToDevice::Command(command) => {
                    if local.to_tick.enqueue(command).is_err() {
                        link.messages_dropped = link.messages_dropped.saturating_add(1);
                    }
                }
            }
        }
        if identify {
            local.identity.stack_free_bytes = crash::stack_free_bytes();
            local.identity.frames_rejected = link.frames_rejected;
            local.identity.messages_dropped = link.messages_dropped;
            link.answer(&FromDevice::Identity(*local.identity));
        }
        link.pump();
    }

    /// Stores settings and restarts with them. There is no other way for settings to change, so
    /// none can change under a tick.
    fn write_settings(link: &mut Link, store: &mut Store, values: SettingsValues) {
        let Ok(settings) = Settings::new(values) else {
            return link.answer(&FromDevice::Written(Written::Invalid));
        };
        cortex_m::interrupt::free(|_| {
            // With the ticks masked this cannot change any more.
            if ARMED.load(Relaxed) {
                return link.answer(&FromDevice::Written(Written::Armed));
            }
            valve::make_safe();
            watchdog::expect_no_ticks();
            let stored = store.store(&settings);
            link.answer(&FromDevice::Written(if stored {
                Written::Stored
            } else {
                Written::FlashFailed
            }));
            link.flush();
            SCB::sys_reset()
        })
    }

    #[idle(local = [changes])]
    fn idle(cx: idle::Context) -> ! {
        loop {
            while let Some((mode, fault)) = cx.local.changes.dequeue() {
                let fault = defmt::Debug2Format(&fault);
                defmt::info!("mode: {}, fault: {}", defmt::Debug2Format(&mode), fault);
            }
            cortex_m::asm::wfi();
        }
    }
}
