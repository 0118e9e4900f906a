//! A motor that is simulated here, by laws that are not those of its catalogue.

use model_discrepancy::engine::Engine;
use model_discrepancy::verdict::{Costs, Selection, Verdict, select};
use plants::Plant;
use plants::motor::{Motor, RATIO, SAMPLE_S};

/// What is wrong with the motor.
#[derive(Clone, Copy, Default)]
struct Fault {
    /// Half of the gear's play \[rad\].
    play_rad: f64,
    /// Torque of a dry bearing at rest \[N·m\]; it falls to half of that.
    dry_n_m: f64,
}

/// Normal noise by the sum of twelve uniform numbers.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self
                .0
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (self.0 >> 33) as f64 / (1_u64 << 31) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// Friction grows as an arctangent from rest, and a dry bearing's falls as a rational function of
/// speed; a play has soft edges, and the load follows it by a viscous contact.
fn run(fault: Fault, seed: u64) -> Motor {
    let mut noise = Noise(seed);
    let phase = noise.next();
    let step_s = 5e-5;
    let (mut ampere, mut speed, mut motor, mut load) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    let mut run = Motor::default();
    for step in 0..(10.0 / step_s) as usize {
        let time_s = step as f64 * step_s;
        let wave = |hertz: f64| (std::f64::consts::TAU * hertz * time_s + phase * hertz).sin();
        let volt = 4.0 * wave(0.4) + 3.0 * wave(0.9) + 1.5 * wave(2.3);
        if step % (SAMPLE_S / step_s).round() as usize == 0 {
            run.volt.push(volt);
            run.ampere.push(ampere + 5e-3 * noise.next());
            run.speed_rad_per_s.push(speed + 0.05 * noise.next());
            run.motor_rad.push(motor);
            run.load_rad.push(load + 1e-3 * noise.next());
        }
        let dry = fault.dry_n_m * (1.0 + 1.0 / (1.0 + (speed / 20.0).powi(2))) / 2.0;
        let friction = (4e-3 + dry) * (speed / 0.2).atan() / std::f64::consts::FRAC_PI_2;
        ampere += step_s * (volt - ampere - 0.05 * speed) / 1e-3;
        speed += step_s * (0.05 * ampere - 2e-5 * speed - friction) / 2e-5;
        motor += step_s * speed;
        let way = motor / RATIO - load;
        let edge = |over: f64| 5e-4 * (over / 5e-4).exp().ln_1p();
        load = if fault.play_rad > 0.0 {
            let contact = edge(way - fault.play_rad) - edge(-way - fault.play_rad);
            load + step_s * contact / 2e-4
        } else {
            motor / RATIO
        };
    }
    run
}

/// A run to be fitted, and one to be predicted.
fn twice(fault: Fault, seed: u64) -> Vec<Motor> {
    vec![run(fault, seed), run(fault, seed + 1000)]
}

fn diagnosed(runs: Vec<Motor>) -> (Selection, Vec<&'static str>) {
    let motor = Plant::new(runs, 1);
    let engine = Engine::new(&motor);
    let selection = select(&engine, Costs::default(), &|_| ()).expect("a diagnosis");
    let named = selection.named.candidates.iter();
    let named = named.map(|own| motor.candidates[*own].effect);
    let named = named.collect();
    (selection, named)
}

#[test]
fn a_healthy_motor_has_no_effect() {
    for seed in 1..=10 {
        let (selection, named) = diagnosed(twice(Fault::default(), seed));
        assert_eq!(
            selection.verdict,
            Verdict::Consistent,
            "seed {seed}: {named:?}"
        );
    }
}

#[test]
fn a_play_is_named_and_its_width_found() {
    for seed in 1..=5 {
        let fault = Fault {
            play_rad: 0.02,
            ..Fault::default()
        };
        let (selection, named) = diagnosed(twice(fault, seed));
        assert_eq!(named, ["backlash"], "seed {seed}: {:?}", selection.verdict);
        let width = selection.named.fit.effects[0].1[0];
        assert!((width - 0.02).abs() < 0.003, "seed {seed}: {width} rad");
    }
}

#[test]
fn a_dry_bearing_is_named() {
    for seed in 1..=5 {
        let fault = Fault {
            dry_n_m: 8e-3,
            ..Fault::default()
        };
        let (selection, named) = diagnosed(twice(fault, seed));
        assert_eq!(named, ["friction"], "seed {seed}: {:?}", selection.verdict);
    }
}

/// Where nothing is held out, nothing speaks against what is named.
#[test]
fn a_single_run_can_be_explained() {
    let fault = Fault {
        dry_n_m: 8e-3,
        ..Fault::default()
    };
    let (selection, named) = diagnosed(vec![run(fault, 1)]);
    assert_eq!(named, ["friction"]);
    assert_eq!(selection.verdict, Verdict::Explained);
}
