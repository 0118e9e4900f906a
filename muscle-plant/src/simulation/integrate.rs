//! One step of an explicit Runge–Kutta method, with an error estimate and a continuous extension.
//!
//! Tsitouras' pair of orders 5 and 4 (Computers & Mathematics with Applications 62 (2011) 770–775),
//! first-same-as-last, with its free interpolant of order 4. The plant is only mildly stiff: over
//! a 10 ms hold valve B's fastest pole makes |λh| ≤ 7, so that an explicit method of high order
//! needs few steps and no Jacobian; the benchmark sets it beside implicit ones.

const A2: [f64; 1] = [0.161];
const A3: [f64; 2] = [-0.008480655492356989, 0.335480655492357];
const A4: [f64; 3] = [2.8971530571054935, -6.359448489975075, 4.3622954328695815];
const A5: [f64; 4] = [
    5.325864828439257,
    -11.748883564062828,
    7.4955393428898365,
    -0.09249506636175525,
];
const A6: [f64; 5] = [
    5.86145544294642,
    -12.92096931784711,
    8.159367898576159,
    -0.071584973281401,
    -0.028269050394068383,
];
/// Weights of the fifth-order solution.
const B: [f64; 6] = [
    0.09646076681806523,
    0.01,
    0.4798896504144996,
    1.379008574103742,
    -3.290069515436081,
    2.324710524099774,
];
/// Weights of the difference between the two orders.
const E: [f64; 7] = [
    -0.001_780_011_052_225_777,
    -0.0008164344596567469,
    0.007880878010261995,
    -0.1447110071732629,
    0.5823571654525552,
    -0.45808210592918697,
    0.015151515151515152,
];
/// Nodes of the stages 2 to 5.
const C: [f64; 4] = [0.161, 0.327, 0.9, 0.9800255409045097];
/// The interpolant's polynomials: rows are stages, columns the powers θ, θ², θ³, θ⁴.
const R: [[f64; 4]; 7] = [
    [
        1.0,
        -2.763706197274826,
        2.9132554618219126,
        -1.0530884977290216,
    ],
    [0.0, 0.13169999999999998, -0.2234, 0.1017],
    [
        0.0,
        3.9302962368947516,
        -5.941033872131505,
        2.490627285651253,
    ],
    [
        0.0,
        -12.411077166933676,
        30.33818863028232,
        -16.548102889244902,
    ],
    [0.0, 37.50931341651104, -88.1789048947664, 47.37952196281928],
    [
        0.0,
        -27.896526289197286,
        65.09189467479366,
        -34.87065786149661,
    ],
    [0.0, 1.5, -4.0, 2.5],
];

/// One trial step.
pub struct Step<const N: usize> {
    /// Length of the step \[s\].
    pub length_s: f64,
    /// State at its begin.
    pub begin: [f64; N],
    /// State at its end, of order 5.
    pub end: [f64; N],
    /// Rates at the stages; the last is the rate at the end.
    pub rates: [[f64; N]; 7],
}

#[inline(always)]
fn combine<const N: usize, const S: usize>(
    begin: &[f64; N],
    length_s: f64,
    weights: &[f64; S],
    rates: &[[f64; N]; 7],
) -> [f64; N] {
    let mut out = *begin;
    for i in 0..N {
        let mut sum = weights[0] * rates[0][i];
        for stage in 1..S {
            sum += weights[stage] * rates[stage][i];
        }
        out[i] += length_s * sum;
    }
    out
}

impl<const N: usize> Step<N> {
    /// Takes a step of `length_s` from `begin` at `time_s`; `first` is the rate there.
    #[inline(always)]
    pub fn take(
        mut f: impl FnMut(f64, &[f64; N]) -> [f64; N],
        time_s: f64,
        begin: &[f64; N],
        first: &[f64; N],
        length_s: f64,
    ) -> Step<N> {
        let h = length_s;
        let mut k = [[0.0; N]; 7];
        k[0] = *first;
        k[1] = f(time_s + C[0] * h, &combine(begin, h, &A2, &k));
        k[2] = f(time_s + C[1] * h, &combine(begin, h, &A3, &k));
        k[3] = f(time_s + C[2] * h, &combine(begin, h, &A4, &k));
        k[4] = f(time_s + C[3] * h, &combine(begin, h, &A5, &k));
        k[5] = f(time_s + h, &combine(begin, h, &A6, &k));
        let end = combine(begin, h, &B, &k);
        k[6] = f(time_s + h, &end);
        Step {
            length_s,
            begin: *begin,
            end,
            rates: k,
        }
    }

    /// Estimated local error of each state.
    #[inline(always)]
    pub fn error(&self) -> [f64; N] {
        combine(&[0.0; N], self.length_s, &E, &self.rates)
    }

    /// State at `begin + fraction · length_s`, of order 4.
    pub fn interpolate(&self, fraction: f64) -> [f64; N] {
        let weights =
            R.map(|[a, b, c, d]| fraction * (a + fraction * (b + fraction * (c + fraction * d))));
        combine(&self.begin, self.length_s, &weights, &self.rates)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row_sums() -> [(f64, f64); 5] {
        [
            (A3.iter().sum(), C[1]),
            (A4.iter().sum(), C[2]),
            (A5.iter().sum(), C[3]),
            (A6.iter().sum(), 1.0),
            (B.iter().sum(), 1.0),
        ]
    }

    #[test]
    fn coefficients_are_consistent() {
        for (sum, node) in row_sums() {
            assert!((sum - node).abs() < 1e-13, "{sum} {node}");
        }
        assert!(E.iter().sum::<f64>().abs() < 1e-13);
        // The interpolant ends where the step does.
        for (stage, row) in R.iter().enumerate() {
            let end: f64 = row.iter().sum();
            let weight = B.get(stage).copied().unwrap_or(0.0);
            assert!(
                (end - weight).abs() < 1e-12,
                "stage {stage}: {end} {weight}"
            );
        }
    }

    /// Largest error of y' = −y + sin t (a forced, nonautonomous problem) at t = 1 and of the
    /// interpolant along the way, with `steps` equal steps.
    fn errors(steps: usize) -> (f64, f64) {
        let exact = |t: f64| 1.5 * (-t).exp() + 0.5 * (t.sin() - t.cos());
        let f = |t: f64, y: &[f64; 1]| [-y[0] + t.sin()];
        let h = 1.0 / steps as f64;
        let (mut y, mut inside) = ([1.0], 0.0_f64);
        for i in 0..steps {
            let t = i as f64 * h;
            let step = Step::take(f, t, &y, &f(t, &y), h);
            inside = inside.max((step.interpolate(0.4)[0] - exact(t + 0.4 * h)).abs());
            y = step.end;
        }
        ((y[0] - exact(1.0)).abs(), inside)
    }

    #[test]
    fn converges_at_order_five_and_interpolates_at_order_four() {
        let (coarse, inside_coarse) = errors(8);
        let (fine, inside_fine) = errors(16);
        let order = (coarse / fine).log2();
        // Global order 5; the interpolant's local error falls as h⁵ on top of that.
        assert!((4.7..5.6).contains(&order), "{order}");
        let order = (inside_coarse / inside_fine).log2();
        assert!((4.6..5.6).contains(&order), "{order}");
    }
}
