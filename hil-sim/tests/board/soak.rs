//! Soak test: random use for hours, without drift or fault. The emulated board's tests include this
//! file too.

use hil_sim::bench::closed_loop::{self, Run};
use hil_sim::bench::person::Finger;
use hil_sim::bench::port::ControllerPort;
use hil_sim::bench::tick::{TICK_S, Tick};
use hil_sim::error::BadInput;
use hil_sim::rig::Rig;
use model_core::io::{Output, Request, Sensors};
use model_core::settings::Settings;
use model_core::supervisor::{Fault, Mode};
use std::collections::BTreeMap;

const HOUR_TICKS: usize = 360_000;
/// Rounding of the encoder and of its home \[counts\].
const ENCODER_COUNTS: f64 = 2.0;

/// Pseudo-random numbers: the upper bits of a linear congruential generator.
struct Random(u64);

impl Random {
    /// At least 0, below 1.
    fn share(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.share()
    }

    /// True once in `seconds` on average, if called each tick.
    fn once_in(&mut self, seconds: f64) -> bool {
        self.share() < TICK_S / seconds
    }
}

/// Lifts of all heights and speeds, with pauses.
fn finger(duration_s: f64, random: &mut Random) -> Finger {
    let (mut time_s, mut finger_m) = (vec![0.0], vec![0.0]);
    let mut now_s = 1.0;
    while now_s < duration_s {
        now_s += random.within(1.0, 15.0);
        let travel_m = random.within(0.02, 0.12);
        let [rise_s, lower_s] = [0; 2].map(|_| random.within(0.6, 1.5));
        let hold_s = random.within(0.5, 20.0);
        for (from_m, to_m, takes_s) in [(0.0, travel_m, rise_s), (travel_m, 0.0, lower_s)] {
            for part in 0..=16 {
                let share = f64::from(part) / 16.0;
                time_s.push(now_s + share * takes_s);
                let cosine = (std::f64::consts::PI * share).cos();
                finger_m.push(from_m + (to_m - from_m) * 0.5 * (1.0 - cosine));
            }
            now_s += takes_s + if to_m > 0.0 { hold_s } else { 0.1 };
        }
    }
    Finger::Recorded { time_s, finger_m }
}

/// Sums over an hour.
#[derive(Clone, Copy, Default)]
struct Hour {
    ticks: usize,
    assisting: usize,
    /// Sum of (F_c − F)² while assisting \[N²\].
    squares_n2: f64,
    /// Sum of the errors of the controller's finger force \[N\].
    offset_n: f64,
}

impl Hour {
    fn error_n_rms(&self) -> f64 {
        (self.squares_n2 / self.assisting.max(1) as f64).sqrt()
    }
}

/// A controller in use.
struct Soak<F> {
    tick: F,
    random: Random,
    last: Output,
    count_of_contraction: f64,
    hours: Vec<Hour>,
    entered: BTreeMap<String, usize>,
    encoder_counts_max: f64,
}

impl<F> Soak<F> {
    /// The request of the person.
    fn request(&mut self) -> Request {
        let (random, last) = (&mut self.random, &self.last);
        let released = last.finger_force_n.abs() < 0.5;
        let emptied = last.pressure_ref.0 == 0.0 && last.pressure.0 < 2e4;
        match last.mode {
            // Occasionally other requests.
            _ if random.once_in(60.0) => match (5.0 * random.share()) as u32 {
                0 => Request::Assist,
                1 => Request::Hold,
                2 => Request::Vent,
                3 => Request::Reset,
                _ => Request::Play((6e5 * random.share()) as u32),
            },
            Mode::Ready if random.once_in(2.0) => Request::Assist,
            Mode::Assisting if random.once_in(30.0) => Request::Hold,
            Mode::Holding if random.once_in(3.0) => Request::Assist,
            Mode::Assisting | Mode::Holding if random.once_in(120.0) => Request::Vent,
            Mode::Venting if released && emptied && random.once_in(1.0) => Request::Reset,
            _ => Request::None,
        }
    }
}

impl<F: FnMut(&Sensors) -> Output> ControllerPort for Soak<F> {
    type Error = BadInput;

    fn tick(&mut self, sensors: &Sensors) -> Result<Output, BadInput> {
        let request = self.request();
        let output = (self.tick)(&Sensors {
            request,
            ..*sensors
        });
        let state = |output: &Output| format!("{:?} {:?}", output.mode, output.fault);
        if (output.mode, output.fault) != (self.last.mode, self.last.fault) {
            *self.entered.entry(state(&output)).or_insert(0) += 1;
        }
        self.last = output;
        Ok(output)
    }

    fn observe(&mut self, tick: Tick) -> Result<(), BadInput> {
        let (output, at_s) = (&tick.output, tick.time_s);
        // A lever that is pulled during the self-check is the only permitted fault.
        let fault = output.fault;
        assert!(
            matches!(fault, None | Some(Fault::LoadedLever)),
            "{fault:?} at {at_s} s"
        );
        if output.mode != Mode::SelfCheck {
            let off = (f64::from(output.contraction) - tick.contraction).abs();
            let off_counts = off / self.count_of_contraction;
            assert!(
                off_counts < ENCODER_COUNTS,
                "{off_counts} counts at {at_s} s"
            );
            self.encoder_counts_max = self.encoder_counts_max.max(off_counts);
        }
        if self
            .hours
            .last()
            .is_none_or(|hour| hour.ticks == HOUR_TICKS)
        {
            self.hours.push(Hour::default());
        }
        let Some(hour) = self.hours.last_mut() else {
            return Ok(());
        };
        hour.ticks += 1;
        if output.mode == Mode::Assisting {
            hour.assisting += 1;
            hour.squares_n2 += (f64::from(output.reference_force_n) - tick.force_n).powi(2);
            hour.offset_n += f64::from(output.finger_force_n) - tick.finger_force_n;
        }
        Ok(())
    }
}

/// Uses a controller with `settings` for `hours`; each call of `tick` is one of its ticks.
pub fn soak(hours: f64, settings: &Settings, tick: impl FnMut(&Sensors) -> Output) {
    let mut random = Random(1);
    let duration_s = 3600.0 * hours;
    let experiment = Run {
        finger: finger(duration_s, &mut random),
        arm_stiffness_n_per_m: 1500.0,
        duration_s,
        ..Run::PAPER
    };
    let values = settings.values();
    let mut soak = Soak {
        tick,
        random,
        last: Output::default(),
        count_of_contraction: f64::from(
            values.encoder_m_per_count / values.muscle.initial_length_m,
        ),
        hours: Vec::new(),
        entered: BTreeMap::new(),
        encoder_counts_max: 0.0,
    };
    closed_loop::run_on(&Rig::reference(), settings, &experiment, &mut soak).expect("it runs");
    let ticks: usize = soak.hours.iter().map(|hour| hour.ticks).sum();
    assert_eq!(
        ticks,
        (duration_s / TICK_S).round() as usize,
        "none is missing"
    );
    println!("{hours} h, {ticks} ticks; entered: {:?}", soak.entered);
    println!(
        "encoder off by {:.2} counts at most",
        soak.encoder_counts_max
    );
    let whole: Vec<&Hour> = soak
        .hours
        .iter()
        .filter(|hour| hour.ticks == HOUR_TICKS)
        .collect();
    for (number, hour) in soak.hours.iter().enumerate() {
        let offset_n = hour.offset_n / hour.assisting.max(1) as f64;
        let rms_n = hour.error_n_rms();
        println!("hour {number}: F_c − F {rms_n:.3} N rms, finger off by {offset_n:.3} N");
        // The tare may contain a finger force up to the limit of the self-check.
        assert!(offset_n.abs() < f64::from(values.tare_n_max));
    }
    let errors_n: Vec<f64> = whole.iter().map(|hour| hour.error_n_rms()).collect();
    let (first, last) = errors_n.split_at(errors_n.len() / 2);
    if first.len() > 1 {
        let ((first_n, first_n2), (last_n, last_n2)) = (mean(first), mean(last));
        // Hours differ by their random use; the two halves differ by so much with a probability of
        // 1e-4.
        let chance_n = 4.0 * (first_n2 + last_n2).sqrt();
        println!("F_c − F {first_n:.3} N rms, later {last_n:.3} N; chance is {chance_n:.3} N");
        assert!((first_n - last_n).abs() < chance_n, "it drifts");
    }
}

/// The mean, and its variance.
fn mean(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, squares / (count - 1.0) / count)
}
