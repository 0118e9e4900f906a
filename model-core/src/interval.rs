//! Range, rate and finiteness of the next reference, for all inputs at once: the controller's own
//! functions, which are generic over [`Number`], are evaluated with intervals.
//!
//! An interval holds all results that f32 can have: rounding is monotone, so that the rounded
//! results at the corners enclose those between. A comparison that an interval does not decide is
//! decided both ways, one after the other ([`all_results`]).
//!
//! What is assumed: the processor rounds as IEEE 754 says, and [`limited`] and [`limited_pa`] are
//! the last that a reference passes, which `act` and `next_reference_pa` show by reading. The
//! settings are sampled, not enclosed: the reference ones, and a thousand others that are valid.

use crate::number::{Number, limited};
use crate::pressure::GaugePa;
use crate::reference::reference_pressure;
use crate::settings::{Settings, SettingsValues};
use crate::state::within_pa;
use core::cell::{Cell, RefCell};
use core::cmp::Ordering;
use core::num::FpCategory;
use core::ops::{Add, Div, Mul, Neg, Rem, Sub};
use num_traits::float::FloatCore;
use num_traits::{Num, One, ToPrimitive, Zero};

/// All numbers from `low` to `high`, and perhaps no number.
#[derive(Clone, Copy, Debug)]
struct Interval {
    low: f32,
    high: f32,
    is_perhaps_nan: bool,
}

/// Any f32 at all.
const ANYTHING: Interval = Interval {
    low: f32::NEG_INFINITY,
    high: f32::INFINITY,
    is_perhaps_nan: true,
};

thread_local! {
    /// Decisions of comparisons that are undecided, and how many were asked for.
    static DECISIONS: RefCell<Vec<bool>> = const { RefCell::new(Vec::new()) };
    static ASKED: Cell<usize> = const { Cell::new(0) };
}

fn undecided() -> bool {
    let asked = ASKED.replace(ASKED.get() + 1);
    DECISIONS.with_borrow_mut(|decisions| {
        if asked == decisions.len() {
            decisions.push(false);
        }
        decisions[asked]
    })
}

/// The interval of all results of `f`: along each path of its comparisons.
fn all_results(f: impl Fn() -> Interval) -> Interval {
    DECISIONS.with_borrow_mut(Vec::clear);
    let mut hull: Option<Interval> = None;
    loop {
        ASKED.set(0);
        let result = f();
        hull = Some(hull.map_or(result, |hull| hull.hull(result)));
        let has_next = DECISIONS.with_borrow_mut(|decisions| {
            while decisions.pop_if(|decision| *decision).is_some() {}
            decisions.last_mut().map(|last| *last = true).is_some()
        });
        if !has_next {
            return hull.unwrap();
        }
    }
}

impl Interval {
    fn new(low: f32, high: f32) -> Interval {
        assert!(low <= high);
        Interval {
            low,
            high,
            is_perhaps_nan: false,
        }
    }

    fn point(value: f32) -> Interval {
        Interval::new(value, value)
    }

    fn hull(self, other: Interval) -> Interval {
        Interval {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            is_perhaps_nan: self.is_perhaps_nan || other.is_perhaps_nan,
        }
    }

    /// The results of an operation that is monotone in each operand, by its corners.
    fn corners(self, other: Interval, f: impl Fn(f32, f32) -> f32) -> Interval {
        let corners = [
            f(self.low, other.low),
            f(self.low, other.high),
            f(self.high, other.low),
            f(self.high, other.high),
        ];
        let is_nan = corners.iter().any(|corner| corner.is_nan());
        if is_nan {
            return ANYTHING;
        }
        Interval {
            low: corners.iter().copied().fold(f32::INFINITY, f32::min),
            high: corners.iter().copied().fold(f32::NEG_INFINITY, f32::max),
            is_perhaps_nan: self.is_perhaps_nan || other.is_perhaps_nan,
        }
    }

    fn contains(self, value: f32) -> bool {
        if value.is_nan() {
            self.is_perhaps_nan
        } else {
            (self.low..=self.high).contains(&value)
        }
    }
}

impl PartialEq for Interval {
    fn eq(&self, other: &Interval) -> bool {
        self.partial_cmp(other) == Some(Ordering::Equal)
    }
}

impl PartialOrd for Interval {
    fn partial_cmp(&self, other: &Interval) -> Option<Ordering> {
        panic!("{self:?} and {other:?}: no one answer")
    }

    fn lt(&self, other: &Interval) -> bool {
        other.gt(self)
    }

    fn gt(&self, other: &Interval) -> bool {
        let is_perhaps_nan = self.is_perhaps_nan || other.is_perhaps_nan;
        if self.high <= other.low {
            false
        } else if self.low > other.high && !is_perhaps_nan {
            true
        } else {
            undecided()
        }
    }
}

impl Add for Interval {
    type Output = Interval;
    fn add(self, other: Interval) -> Interval {
        self.corners(other, |a, b| a + b)
    }
}

impl Sub for Interval {
    type Output = Interval;
    fn sub(self, other: Interval) -> Interval {
        self.corners(other, |a, b| a - b)
    }
}

impl Mul for Interval {
    type Output = Interval;
    fn mul(self, other: Interval) -> Interval {
        self.corners(other, |a, b| a * b)
    }
}

impl Div for Interval {
    type Output = Interval;
    fn div(self, other: Interval) -> Interval {
        if other.contains(0.0) {
            ANYTHING
        } else {
            self.corners(other, |a, b| a / b)
        }
    }
}

impl Rem for Interval {
    type Output = Interval;
    fn rem(self, _: Interval) -> Interval {
        ANYTHING
    }
}

impl Neg for Interval {
    type Output = Interval;
    fn neg(self) -> Interval {
        Interval {
            low: -self.high,
            high: -self.low,
            ..self
        }
    }
}

impl Zero for Interval {
    fn zero() -> Interval {
        Interval::point(0.0)
    }

    fn is_zero(&self) -> bool {
        unimplemented!()
    }
}

impl One for Interval {
    fn one() -> Interval {
        Interval::point(1.0)
    }
}

impl Num for Interval {
    type FromStrRadixErr = ();
    fn from_str_radix(_: &str, _: u32) -> Result<Interval, ()> {
        Err(())
    }
}

impl ToPrimitive for Interval {
    fn to_i64(&self) -> Option<i64> {
        None
    }

    fn to_u64(&self) -> Option<u64> {
        None
    }
}

impl num_traits::NumCast for Interval {
    fn from<N: ToPrimitive>(number: N) -> Option<Interval> {
        number.to_f32().map(Interval::point)
    }
}

impl FloatCore for Interval {
    fn infinity() -> Interval {
        Interval::point(f32::INFINITY)
    }

    fn neg_infinity() -> Interval {
        Interval::point(f32::NEG_INFINITY)
    }

    fn nan() -> Interval {
        ANYTHING
    }

    fn neg_zero() -> Interval {
        Interval::point(-0.0)
    }

    fn min_value() -> Interval {
        Interval::point(f32::MIN)
    }

    fn min_positive_value() -> Interval {
        Interval::point(f32::MIN_POSITIVE)
    }

    fn epsilon() -> Interval {
        Interval::point(f32::EPSILON)
    }

    fn max_value() -> Interval {
        Interval::point(f32::MAX)
    }

    fn classify(self) -> FpCategory {
        unimplemented!()
    }

    fn is_nan(self) -> bool {
        self.is_perhaps_nan && undecided()
    }

    fn to_degrees(self) -> Interval {
        unimplemented!()
    }

    fn to_radians(self) -> Interval {
        unimplemented!()
    }

    fn integer_decode(self) -> (u64, i16, i8) {
        unimplemented!()
    }
}

/// As of libm: of a number and a NaN the number.
fn chosen(a: Interval, b: Interval, f: impl Fn(f32, f32) -> f32) -> Interval {
    let numbers = Interval::new(f(a.low, b.low), f(a.high, b.high));
    let mut result = Interval {
        is_perhaps_nan: a.is_perhaps_nan && b.is_perhaps_nan,
        ..numbers
    };
    if a.is_perhaps_nan {
        result = result.hull(Interval::new(b.low, b.high));
    }
    if b.is_perhaps_nan {
        result = result.hull(Interval::new(a.low, a.high));
    }
    result
}

impl Number for Interval {
    fn at_most(self, bound: Interval) -> Interval {
        chosen(self, bound, f32::min)
    }

    fn at_least(self, bound: Interval) -> Interval {
        chosen(self, bound, f32::max)
    }
}

/// The reference settings, and others with values drawn within the limits that are valid.
fn all_settings() -> impl Iterator<Item = SettingsValues> {
    let mut seed = 24_u64;
    let mut drawn = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 40) as f32 / (1 << 24) as f32
    };
    let mut varied = move || {
        let mut values = SettingsValues::reference();
        // Factors from a tenth to ten, as far as the limits and the relations allow.
        let mut vary = |value: &mut f32| *value *= libm::powf(10.0, 2.0 * drawn() - 1.0);
        let muscle = &mut values.muscle;
        vary(&mut muscle.alpha_m2);
        muscle.beta_m2 = -muscle.alpha_m2;
        vary(&mut muscle.gamma_n);
        vary(&mut muscle.initial_length_m);
        vary(&mut values.reference_speed_m_per_s_max);
        vary(&mut values.contraction_max);
        vary(&mut values.supply_pressure_pa);
        vary(&mut values.load_kg);
        values.muscle.beta_m2 *= drawn();
        values.pressure_pa_max = values.supply_pressure_pa * (0.5 + 0.5 * drawn());
        values
    };
    let others = core::iter::from_fn(move || Some(varied()));
    let valid = others.filter(|values| Settings::new(*values).is_ok());
    core::iter::once(SettingsValues::reference()).chain(valid.take(1000))
}

fn muscle(values: &SettingsValues) -> crate::muscle::Muscle<Interval> {
    crate::muscle::Muscle {
        alpha_m2: Interval::point(values.muscle.alpha_m2),
        beta_m2: Interval::point(values.muscle.beta_m2),
        gamma_n: Interval::point(values.muscle.gamma_n),
        initial_length_m: Interval::point(values.muscle.initial_length_m),
    }
}

/// Whatever led to it, NaN and infinities included.
#[test]
fn reference_that_leaves_is_a_number_within_its_limits() {
    for values in all_settings() {
        let most = Interval::point(values.pressure_pa_max);
        let result = all_results(|| within_pa(ANYTHING, most));
        assert!(!result.is_perhaps_nan, "{result:?}");
        assert_eq!((result.low, result.high), (0.0, values.pressure_pa_max));
    }
}

/// Eq 8 of any force and any contraction.
#[test]
fn law_demands_a_number_within_its_limits_for_any_force_and_contraction() {
    for values in all_settings() {
        let muscle = muscle(&values);
        let [contraction_max, supply] =
            [values.contraction_max, values.pressure_pa_max].map(Interval::point);
        let result = all_results(|| {
            let law = reference_pressure(
                &muscle,
                ANYTHING,
                ANYTHING,
                contraction_max,
                GaugePa(supply),
            );
            law.0
        });
        assert!(!result.is_perhaps_nan && result.low >= 0.0, "{result:?}");
        assert!(result.high <= values.pressure_pa_max, "{result:?}");
    }
}

/// A step of any demanded change is at most the rate's.
#[test]
fn step_is_limited_for_any_demanded_change() {
    for step_pa in [0.0, 1e-3, 1.0, 5e3, 1e9, f32::INFINITY] {
        let result = all_results(|| limited(ANYTHING, Interval::point(step_pa)));
        assert!(!result.is_perhaps_nan, "{result:?}");
        assert_eq!((result.low, result.high), (-step_pa, step_pa));
    }
}

/// The rate at any contraction, NaN included, and at any reference within the limits is a number,
/// at least 0 and at most the one at the greatest contraction and pressure, but for rounding.
#[test]
fn rate_is_a_number_up_to_that_at_the_ends_of_contraction_and_pressure() {
    let (mut count, mut widest) = (0, 0.0_f32);
    for values in all_settings() {
        let (muscle_box, contraction_max) = (muscle(&values), values.contraction_max);
        let speed = Interval::point(values.reference_speed_m_per_s_max);
        let pressure = GaugePa(Interval::new(0.0, values.pressure_pa_max));
        let at_ends = values.muscle.moving_rate_pa_per_s(
            values.reference_speed_m_per_s_max,
            contraction_max,
            GaugePa(values.pressure_pa_max),
        );
        // What `Target::new` makes of a contraction.
        let taken = all_results(|| {
            let limited = ANYTHING.at_least(Interval::zero());
            limited.at_most(Interval::point(contraction_max))
        });
        assert_eq!((taken.low, taken.high), (0.0, contraction_max));
        assert!(!taken.is_perhaps_nan);
        const PARTS: u16 = 256;
        let part = |part: u16| contraction_max * f32::from(part) / f32::from(PARTS);
        for number in 0..PARTS {
            let contraction = Interval::new(part(number), part(number + 1));
            let result =
                all_results(|| muscle_box.moving_rate_pa_per_s(speed, contraction, pressure));
            assert!(
                !result.is_perhaps_nan && result.low >= 0.0,
                "{values:?}: {result:?}"
            );
            assert!(result.high.is_finite(), "{values:?}: {result:?}");
            widest = widest.max(result.high / at_ends);
        }
        count += 1;
    }
    // f_c is taken at the other end of a part: by at most 0.9/256 over 1 − 0.9 too much.
    println!("{count} settings, at most {widest} of the rate at the ends");
    assert!(count > 1000 && widest < 1.04, "{widest}");
}

/// So the intervals enclose what f32 computes.
#[test]
fn intervals_enclose_the_results_of_their_numbers() {
    let numbers = [-3e38_f32, -7.5, -1.0, -0.0, 0.0, 1e-40, 0.3, 2.0, 3e38];
    let boxes = numbers.iter().flat_map(|low| {
        let highs = numbers.iter().filter(move |high| low <= high);
        highs.map(move |high| Interval::new(*low, *high))
    });
    let boxes: Vec<Interval> = boxes.collect();
    for a in &boxes {
        for b in &boxes {
            let sums = [
                *a + *b,
                *a - *b,
                *a * *b,
                *a / *b,
                a.at_most(*b),
                a.at_least(*b),
            ];
            for x in numbers.iter().filter(|x| a.contains(**x)) {
                for y in numbers.iter().filter(|y| b.contains(**y)) {
                    let results = [x + y, x - y, x * y, x / y, x.at_most(*y), x.at_least(*y)];
                    for (interval, result) in sums.iter().zip(results) {
                        assert!(
                            interval.contains(result),
                            "{a:?} {b:?} {x} {y}: {interval:?}"
                        );
                    }
                }
            }
        }
    }
}
