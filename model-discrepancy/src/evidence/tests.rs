use super::super::signature::EffectTraits;
use super::*;
use std::f64::consts::TAU;

const COUNT: usize = 600;
const PERIOD_S: f64 = 0.02;

/// Two records of the same length.
fn times_s() -> Vec<f64> {
    (0..COUNT)
        .map(|row| PERIOD_S * (row % (COUNT / 2)) as f64)
        .collect()
}

/// White noise of unit variance: the sum of twelve uniform numbers (xorshift).
fn noise(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        let uniform = || {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        std::iter::repeat_with(uniform).take(12).sum::<f64>() - 6.0
    }
}

fn rows(signal: impl Fn(f64) -> f64, seed: u64) -> Rows {
    let mut noise = noise(seed);
    let time_s = times_s();
    Rows {
        residual: time_s.iter().map(|t| signal(*t) + noise()).collect(),
        base: vec![0.3; COUNT],
        begins: (0..COUNT).map(|row| row % (COUNT / 2) == 0).collect(),
        in_process: vec![true; COUNT],
        time_s,
    }
}

fn column(signal: impl Fn(f64) -> f64) -> Column {
    vec![times_s().into_iter().map(signal).collect()]
}

fn wave(frequency_hz: f64) -> impl Fn(f64) -> f64 + Copy {
    move |time_s| (TAU * frequency_hz * time_s).sin()
}

fn effect(effect: &'static str, examples: &[Column], blocks: &[Rows]) -> Signature {
    let of = EffectTraits {
        effect,
        signed: false,
        exact: false,
    };
    Signature::new(of, examples, examples.len(), blocks).expect("a signature")
}

/// `slow` has a wave of 0.4 Hz, or a little more or less, `fast` one of 1.5 Hz; a nominal value is
/// off by a constant.
fn posterior(signal: impl Fn(f64) -> f64, seed: u64) -> Vec<Hypothesis> {
    let blocks = [rows(signal, seed)];
    let around = |hz: f64| [0.95, 1.0, 1.05].map(|factor| column(wave(factor * hz)));
    let effects = [
        effect("slow", &around(0.4), &blocks),
        effect("fast", &around(1.5), &blocks),
    ];
    let evidence = Evidence::new(&blocks, &[column(|_| 5.0)], &effects);
    evidence.posterior(&[]).expect("a posterior")
}

fn best(posterior: &[Hypothesis]) -> (&[usize], Blocks) {
    (&posterior[0].effects, posterior[0].unknown)
}

/// The log density of the residuals from their covariance, row by row.
#[test]
fn evidence_is_the_density_of_the_residuals() {
    let mut block = rows(wave(0.3), 3);
    let keep = 40;
    for values in [&mut block.time_s, &mut block.residual, &mut block.base] {
        values.rotate_left(COUNT / 2 - keep / 2);
        values.truncate(keep);
    }
    block.begins = (0..keep).map(|row| row % (keep / 2) == 0).collect();
    block.in_process.truncate(keep);
    block.in_process[7] = false;
    let short = |signal: &dyn Fn(f64) -> f64| -> Column {
        vec![block.time_s.iter().map(|t| signal(*t)).collect()]
    };
    let (common, own) = (short(&|_| 2.0), short(&wave(1.1)));
    let signature = effect(
        "own",
        std::slice::from_ref(&own),
        std::slice::from_ref(&block),
    );
    let scale = signature.columns[0][0][5] / own[0][5];
    let evidence = Evidence::new(
        std::slice::from_ref(&block),
        std::slice::from_ref(&common),
        &[signature],
    );
    let size = 8.0;
    for (at, (amplitude, time_constant_s)) in [(0, (0.0, 1.0)), (7, (2.0, 0.1)), (12, (8.0, 1.0))] {
        let covariance = DMatrix::from_fn(keep, keep, |i, j| {
            let same_record = (i < keep / 2) == (j < keep / 2);
            let passed_s = (block.time_s[i] - block.time_s[j]).abs();
            let in_process = same_record && block.in_process[i] && block.in_process[j];
            let process = if in_process {
                let decay = (-passed_s / time_constant_s).exp();
                block.base[i] * block.base[j] * amplitude * amplitude * decay
            } else {
                0.0
            };
            let effect = size * size * scale * scale * own[0][i] * own[0][j];
            let white = if i == j { 1.0 } else { 0.0 };
            white + process + effect + common[0][i] * common[0][j]
        });
        let residual = DVector::from_row_slice(&block.residual);
        let factor = Cholesky::new(covariance).expect("positive");
        let half_log = factor
            .l_dirty()
            .diagonal()
            .iter()
            .map(|d| d.ln())
            .sum::<f64>();
        let expected = -0.5 * factor.solve(&residual).dot(&residual) - half_log;

        let problem = evidence.problem(&[0], &[size]);
        let precisions = DVector::from_row_slice(&problem.precisions);
        let mut matrix = DMatrix::from_diagonal(&precisions);
        let mut vector = DVector::zeros(2);
        let [square, half_log] = evidence.add((&mut matrix, &mut vector), &problem, 0, at);
        let factor = Cholesky::new(matrix).expect("positive");
        let weights = factor.solve(&vector);
        let diagonal = factor.l_dirty().diagonal();
        let log = -0.5 * (square - weights.dot(&vector)) - half_log + problem.half_log_prior()
            - diagonal.iter().map(|d| d.ln()).sum::<f64>();
        assert!(
            (log - expected).abs() < 1e-8,
            "{amplitude}: {log}, {expected}"
        );
    }
}

#[test]
fn a_sound_rig_has_no_effect() {
    for seed in 1..6 {
        let posterior = posterior(|_| 8.0, seed);
        assert_eq!(best(&posterior), (&[][..], 0));
        assert!(posterior[0].probability > 0.9, "{posterior:?}");
    }
}

#[test]
fn probabilities_sum_to_one() {
    let sum: f64 = posterior(wave(0.4), 1).iter().map(|h| h.probability).sum();
    assert!((sum - 1.0).abs() < 1e-12);
}

#[test]
fn an_effect_is_named_in_a_law_that_is_no_example() {
    for seed in 1..6 {
        let posterior = posterior(|t| 3.0 * wave(0.41)(t), seed);
        assert_eq!(best(&posterior), (&[0][..], 0));
        assert!(posterior[0].probability > 0.9, "{posterior:?}");
    }
}

#[test]
fn two_effects_are_named_together() {
    let posterior = posterior(|t| 3.0 * wave(0.4)(t) + 2.0 * wave(1.52)(t), 1);
    assert_eq!(best(&posterior), (&[0, 1][..], 0));
    assert!(posterior[0].probability > 0.9, "{posterior:?}");
}

/// Of the other sign it is something else.
#[test]
fn an_effect_has_its_sign() {
    let posterior = posterior(|t| -3.0 * wave(0.4)(t), 1);
    assert_eq!(best(&posterior), (&[][..], 1));
}

#[test]
fn what_no_effect_does_is_an_unknown() {
    for seed in 1..6 {
        let posterior = posterior(|t| 3.0 * wave(0.8)(t).powi(3), seed);
        assert_eq!(best(&posterior), (&[][..], 1));
        let unknown = posterior.iter().filter(|h| h.unknown == 1);
        let probability: f64 = unknown.map(|h| h.probability).sum();
        assert!(probability > 0.99, "{posterior:?}");
    }
}

/// It shows far above the noise, and is half the base.
#[test]
fn what_is_smaller_than_the_base_is_no_effect() {
    let mut block = rows(|t| 10.0 * wave(0.4)(t), 1);
    block.base.fill(20.0);
    let slow = effect("slow", &[column(wave(0.4))], std::slice::from_ref(&block));
    let evidence = Evidence::new(&[block], &[], &[slow]);
    assert!(evidence.solve(&[0], 0).is_none());
}
