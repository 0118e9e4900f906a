//! Seeded inputs of all kinds for model-core, and checksums of all output bits, which must be equal
//! on every machine.

use model_core::assist::{Assist, reference_force_n};
use model_core::controller::Controller;
use model_core::io::{Output, Request, Sensors};
use model_core::muscle::{Muscle, Volume};
use model_core::number::Number;
use model_core::pressure::{AbsolutePa, GaugePa};
use model_core::reference::reference_pressure;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, AdcScale, DacCount, EncoderCount, ValveDrive};
use model_core::valve::mass_flow_kg_per_s;

/// Name of a part of the battery, and the function that computes its checksum.
pub type Part = (&'static str, fn() -> u64);

/// The parts of the battery.
pub const PARTS: &[Part] = &[
    ("controller", controller),
    ("equations in f32", || equations(f32_any, f32_bits)),
    ("equations in f64", || equations(f64_any, f64_bits)),
    ("converters", converters),
];

const DRAWS: u32 = 20_000;
const RUNS: u64 = 50;
const RUN_TICKS: u32 = 2_000;

/// Pseudo-random numbers: PCG-XSH-RR as published.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(2).wrapping_add(1))
    }

    fn next(&mut self) -> u32 {
        let state = self.0;
        self.0 = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let xorshifted = (((state >> 18) ^ state) >> 27) as u32;
        xorshifted.rotate_right((state >> 59) as u32)
    }

    fn below(&mut self, end: u32) -> u32 {
        self.next() % end
    }
}

/// FNV-1a over words.
struct Checksum(u64);

impl Checksum {
    fn new() -> Checksum {
        Checksum(0xCBF2_9CE4_8422_2325)
    }

    fn add(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01B3);
    }
}

/// The bits of a value. IEEE 754 does not define sign and payload of a NaN, and the machines differ
/// in them: every NaN gives the same bits.
fn f32_bits(value: f32) -> u64 {
    u64::from(if value.is_nan() { f32::NAN } else { value }.to_bits())
}

fn f64_bits(value: f64) -> u64 {
    if value.is_nan() { f64::NAN } else { value }.to_bits()
}

/// Arbitrary bits, often those of a special value.
fn f32_any(random: &mut Random) -> f32 {
    const SPECIAL: [f32; 12] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f32::MIN_POSITIVE,
        // The smallest and the largest denormal number.
        f32::from_bits(1),
        f32::from_bits(0x807F_FFFF),
        f32::EPSILON,
        f32::MAX,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    match random.below(4) {
        0 => SPECIAL[random.below(12) as usize],
        1 => f32::from_bits(random.next()),
        // The usual magnitudes: 1e-6 to 1e6.
        _ => {
            let exponent = 107 + random.below(40);
            f32::from_bits((random.next() & 0x807F_FFFF) | exponent << 23)
        }
    }
}

fn f64_any(random: &mut Random) -> f64 {
    match random.below(4) {
        0 => f32_any(random).into(),
        1 => f64::from_bits(u64::from(random.next()) << 32 | u64::from(random.next())),
        // All bits of the mantissa.
        _ => f64::from(f32_any(random)) * (1.0 + f64::from(random.next()) / (1_u64 << 40) as f64),
    }
}

/// Eqs 1, 2, 6–9 and quantities derived from them.
fn equations<T: Number>(any: fn(&mut Random) -> T, bits: fn(T) -> u64) -> u64 {
    let (mut random, mut checksum) = (Random::new(2), Checksum::new());
    for _ in 0..DRAWS {
        let mut next = || any(&mut random);
        let muscle = Muscle {
            alpha_m2: next(),
            beta_m2: next(),
            gamma_n: next(),
            initial_length_m: next(),
        };
        let volume = Volume {
            d1_m3: next(),
            d2_m3: next(),
            d3_m3: next(),
        };
        let assist = Assist {
            gain: next(),
            input_stiffness_n_per_m: next(),
            lever_length_m: next(),
            pulley_diameter_m: next(),
        };
        let (a, b, c) = (next(), next(), next());
        let (pressure, other) = (GaugePa(next()), GaugePa(next()));
        let limited = reference_pressure(&muscle, a, b, c, pressure);
        let results = [
            muscle.force_n(a, pressure),
            muscle.force_per_pressure_m2(a),
            muscle.stiffness_n(a, pressure),
            volume.volume_m3(a),
            volume.slope_m3(a),
            assist.lever_travel_m(a),
            assist.finger_force_n(a, b, c),
            reference_force_n(a, b),
            limited.0,
            mass_flow_kg_per_s(a, pressure, other),
            pressure.to_absolute(AbsolutePa(a)).0,
        ];
        for result in results {
            checksum.add(bits(result));
        }
    }
    checksum.0
}

/// Conversion of counts to quantities and back with arbitrary scales.
fn converters() -> u64 {
    let (mut random, mut checksum) = (Random::new(3), Checksum::new());
    for _ in 0..DRAWS {
        let mut next = || f32_any(&mut random);
        let scale = AdcScale {
            zero_count: next(),
            per_count: next(),
        };
        let drive = ValveDrive {
            pa_per_v: next(),
            amplifier_gain: next(),
            dac_full_scale_v: next(),
        };
        let (value, pressure) = (next(), GaugePa(next()));
        let count = random.below(1 << 16) as u16;
        checksum.add(f32_bits(scale.value(AdcCount(count))));
        checksum.add(scale.count(value).0.into());
        checksum.add(f32_bits(drive.valve_v(pressure)));
        checksum.add(drive.count(pressure).get().into());
        checksum.add(f32_bits(drive.pressure(DacCount::new(count)).0));
    }
    checksum.0
}

/// The controller with different settings, in all of its modes.
fn controller() -> u64 {
    let mut checksum = Checksum::new();
    run_controllers(|output| {
        checksum.add(output.valve.get().into());
        checksum.add(output.mode as u64);
        let floats = [
            output.pressure_ref.0,
            output.finger_force_n,
            output.reference_force_n,
            output.contraction,
            output.pressure.0,
        ];
        // None of them may be a NaN, which would change the checksum.
        for value in floats {
            checksum.add(value.to_bits().into());
        }
    });
    checksum.0
}

/// Runs the controllers, and passes the output of each tick to `each`.
pub fn run_controllers(mut each: impl FnMut(&Output)) {
    for run in 0..RUNS {
        let mut controller = Controller::new(any_settings(&mut Random::new(run)));
        let mut readings = Readings::new(run);
        for _ in 0..RUN_TICKS {
            let sensors = readings.next(controller.state().valve);
            each(&controller.tick(&sensors));
        }
    }
}

/// The reference settings with scales, gains and rates changed by up to 5 %.
fn any_settings(random: &mut Random) -> Settings {
    let mut values = SettingsValues::reference();
    let floats = [
        &mut values.muscle.alpha_m2,
        &mut values.muscle.beta_m2,
        &mut values.muscle.gamma_n,
        &mut values.muscle.initial_length_m,
        &mut values.gain,
        &mut values.bridge.zero_count,
        &mut values.pressure_sensor.zero_count,
        &mut values.pressure_sensor.per_count,
        &mut values.encoder_m_per_count,
        &mut values.valve_drive.pa_per_v,
        &mut values.reference_speed_m_per_s_max,
        &mut values.engage_rate_pa_per_s,
        &mut values.vent_rate_pa_per_s,
    ];
    for value in floats {
        *value *= 0.95 + random.below(1 << 16) as f32 * (0.1 / 65_536.0);
    }
    let reference = Settings::new(SettingsValues::reference());
    match Settings::new(values).or(reference) {
        Ok(settings) => settings,
        Err(error) => panic!("{error}"),
    }
}

/// Inputs of a controller: at rest for the self-check, then up and down, with requests and sensor
/// faults.
pub struct Readings {
    random: Random,
    tick: u32,
    /// The faulty input, its value, and the remaining ticks of the fault.
    fault: (u32, u32, u32),
}

impl Readings {
    /// The readings of a seed.
    pub fn new(seed: u64) -> Readings {
        Readings {
            random: Random::new(seed),
            tick: 0,
            fault: (0, 0, 0),
        }
    }

    /// The readings of the next tick, before which the valve was set to this.
    pub fn next(&mut self, valve: DacCount) -> Sensors {
        let tick = self.tick % 1_000;
        self.tick += 1;
        let lift = match tick {
            200..475 => tick - 200,
            475..750 => 750 - tick,
            _ => 0,
        };
        let request = match tick {
            110 | 650 => Request::Assist,
            600 => Request::Hold,
            800 => Request::Vent,
            970 => Request::Reset,
            _ => Request::None,
        };
        let random = &mut self.random;
        let mut sensors = Sensors {
            bridge: AdcCount((2_048 + 2 * lift + random.below(4)) as u16),
            pressure: AdcCount((409 + 5 * lift + random.below(4)) as u16),
            encoder: EncoderCount(12 * lift),
            read_back: AdcCount(valve.get()),
            missed_ticks: 0,
            request,
        };
        if random.below(400) == 0 {
            self.fault = (random.below(6), random.next(), random.below(10));
        }
        let (input, value, ticks) = &mut self.fault;
        if *ticks > 0 {
            *ticks -= 1;
            match *input {
                0 => sensors.bridge = AdcCount(*value as u16),
                1 => sensors.pressure = AdcCount(*value as u16 % 4096),
                2 => sensors.encoder = EncoderCount(*value),
                3 => sensors.missed_ticks = (*value % 4) as u8,
                4 => sensors.read_back = AdcCount(*value as u16 % 4096),
                _ => sensors.request = Request::Hold,
            }
        }
        sensors
    }
}
