//! Columns whose numbers cannot be what their names say: another unit, an absolute pressure, the
//! wrong sign.
//!
//! A column is doubted only if physics excludes it ([`crate::plausible`]), and a unit is named only
//! if it brings the column to what the rest of the record, and the rig, say. Where a rig is given,
//! its force law (Eq 1) predicts pressure, contraction or force from the other two.

use super::{Check, Finding, quantile};
use crate::error::{BadInput, significant};
use crate::plausible::{
    CONTRACTION_MAX, CONTRACTION_USED, DATES_D, FORCE_FACTOR, GAUGE_NOISE_PA_MIN, LAG_S_MAX,
    PERIOD_S_DOUBTFUL, PERIOD_S_MAX, PERIOD_S_MIN, PRESSURE_BURST_PA, PRESSURE_IDLE_PA,
    PRESSURE_TYPICAL_PA, PRESSURE_UNITS, PRESSURE_WORKING_PA_MAX, PRESSURE_WORKING_PA_MIN, REACH_M,
    STRETCH_MAX, nearest,
};
use crate::record::{
    CONTRACTION, FINGER_M, FORCE_N, INPUT_FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, SUPPLY_PA,
    TEMPERATURE_K, TIME_S,
};
use crate::rig::{KEYS, Rig};
use model_core::constants::GRAVITY_M_PER_S2;
use muscle_plant::nominal::{Gas, Load};
use std::ops::RangeInclusive;

/// The extremes of a column are the quantiles with this share beyond them: spikes are no unit.
const SPIKES: f64 = 0.01;
/// Two columns follow each other if their correlation exceeds this, also with lag and hysteresis.
const FOLLOWS: f64 = 0.5;
/// One of two columns is much smaller: by more than a valve, a line or a leak could make it.
const MUCH: f64 = 50.0;
/// A sign is wrong if the extreme on the right side is below this share of the other.
const ONE_SIDED: f64 = 0.2;
/// Rows of the highest pressures, at which the force law is least uncertain.
const HIGH: f64 = 0.75;
/// The force law and the atmosphere have to agree to this share of one atmosphere.
const ATMOSPHERE_SHARE: f64 = 0.25;
/// A force is opposite to that of the rig if it is more than a third of it: friction and the stop
/// take less.
const OPPOSITE: f64 = 3.0;
/// Muscles that one can buy are shorter \[m\].
const MUSCLE_M_MAX: f64 = 2.0;
/// Contractions that are metres differ from what the force law needs by the muscle's length within
/// this factor.
const LIKE_LENGTH: f64 = 1.4;
/// A pressure hardly changes in this quarter of the rows, over this time \[s\].
const SLOW: f64 = 0.25;
const CHANGE_S: f64 = 0.1;

/// A doubted column.
struct Doubt {
    signal: &'static str,
    /// What was expected and what was found.
    expected: String,
    /// The likely unit, in words; empty if there is none.
    likely: String,
    /// The value of `import --unit`.
    option: String,
}

impl Doubt {
    fn new(signal: &'static str, expected: String, likely: &str, unit: &str) -> Doubt {
        Doubt {
            signal,
            expected,
            likely: likely.into(),
            option: format!("{signal}={unit}"),
        }
    }
}

impl Check {
    /// The columns of `record`, of which this is the check, that cannot be in the units that their
    /// names say. With a `rig` its values are compared, too.
    pub fn units(&self, record: &Record, rig: Option<&Rig>) -> Vec<Finding> {
        let doubts = Evidence::of(self, record, rig).doubts();
        let options = doubts.iter().map(|doubt| &doubt.option);
        let options = options.filter(|option| !option.is_empty());
        let options: String = options.map(|option| format!(" --unit {option}")).collect();
        let command = match options.is_empty() {
            true => "hil-sim import --example".into(),
            false => format!("hil-sim import {}{options} --out new.csv", record.file()),
        };
        let found = doubts.into_iter().map(|doubt| Finding::Unit {
            signal: doubt.signal,
            expected: doubt.expected,
            likely: doubt.likely,
            command: command.clone(),
        });
        found.collect()
    }
}

/// All of `findings` as one error about `record`, if there are any.
///
/// # Errors
/// There are.
pub fn refuse_units(findings: &[Finding], record: &Record) -> Result<(), BadInput> {
    let errors = findings.iter().map(|finding| finding.refusal(record));
    let Some(mut error) = errors.reduce(BadInput::and) else {
        return Ok(());
    };
    let command = findings.iter().find_map(|finding| match finding {
        Finding::Unit { command, .. } => Some(command),
        _ => None,
    });
    if let Some(command) = command {
        error.expected += &format!("; `{command}` converts it, --accept takes it as it is");
    }
    Err(error)
}

/// Lowest and highest samples, without spikes.
#[derive(Clone, Copy)]
struct Range {
    low: f64,
    high: f64,
}

impl Range {
    fn largest(&self) -> f64 {
        self.low.abs().max(self.high.abs())
    }
}

fn from_to(low: f64, high: f64) -> String {
    format!("{} to {}", significant(low), significant(high))
}

/// The muscle's force law, and what it carries.
struct Law {
    muscle: [f64; 3],
    /// Relative standard uncertainty of these three.
    uncertainty: [f64; 3],
    weight_n: Option<f64>,
    length_m: f64,
    supply_pa: Option<f64>,
}

impl Law {
    fn of(rig: &Rig) -> Law {
        let muscle = rig.nominal.muscle;
        Law {
            muscle: [muscle.alpha_m2, muscle.beta_m2, muscle.gamma_n],
            uncertainty: ["alpha_m2", "beta_m2", "gamma_n"].map(|key| uncertainty(rig, key)),
            weight_n: match rig.nominal.load {
                Load::Weight(weight) => Some(weight.mass_kg * GRAVITY_M_PER_S2),
                Load::Prescribed => None,
            },
            length_m: muscle.initial_length_m,
            supply_pa: rig.nominal.valve.map(|valve| valve.supply_pressure.0),
        }
    }

    /// Force for each pascal \[m²\]; `None` where it is so small that a force says nothing about
    /// the pressure.
    fn area_m2(&self, contraction: f64) -> Option<f64> {
        let [alpha_m2, beta_m2, _] = self.muscle;
        let area_m2 = alpha_m2 * (1.0 - contraction).powi(2) + beta_m2;
        (area_m2 > 0.1 * (alpha_m2 + beta_m2)).then_some(area_m2)
    }

    fn pressure_pa(&self, contraction: f64, force_n: f64) -> Option<f64> {
        Some((force_n - self.muscle[2]) / self.area_m2(contraction)?)
    }

    /// Standard uncertainty of that pressure.
    fn uncertainty_pa(&self, contraction: f64, pressure_pa: f64) -> f64 {
        let [alpha_m2, beta_m2, gamma_n] = self.muscle;
        let terms = [
            alpha_m2 * (1.0 - contraction).powi(2) * pressure_pa,
            beta_m2 * pressure_pa,
            gamma_n,
        ];
        let squares = terms
            .iter()
            .zip(self.uncertainty)
            .map(|(term, share)| (term * share).powi(2));
        squares.sum::<f64>().sqrt() / self.area_m2(contraction).unwrap_or(f64::MIN_POSITIVE)
    }

    fn force_n(&self, contraction: f64, pressure_pa: f64) -> f64 {
        let [alpha_m2, beta_m2, gamma_n] = self.muscle;
        (alpha_m2 * (1.0 - contraction).powi(2) + beta_m2) * pressure_pa + gamma_n
    }

    fn contraction(&self, pressure_pa: f64, force_n: f64) -> Option<f64> {
        let [alpha_m2, beta_m2, gamma_n] = self.muscle;
        let square = ((force_n - gamma_n) / pressure_pa - beta_m2) / alpha_m2;
        (square > 0.0).then(|| 1.0 - square.sqrt())
    }
}

/// How well a value of the muscle is known: its tolerance in `rig`, or of uncalibrated muscles.
fn uncertainty(rig: &Rig, key: &str) -> f64 {
    let mut own = rig.tolerances.iter();
    let own = own.find(|own| own.section == "muscle" && own.key == key);
    let usual = KEYS.iter().find(|known| known.name == key);
    let usual = usual.and_then(|known| known.tolerance);
    own.map(|own| own.relative_sigma)
        .or(usual.map(|usual| usual.relative_sigma))
        .unwrap_or(0.0)
}

/// What a record, its check and its rig say.
struct Evidence<'a> {
    check: &'a Check,
    record: &'a Record,
    law: Option<Law>,
    atmosphere_pa: f64,
    shut: Vec<bool>,
}

impl<'a> Evidence<'a> {
    fn of(check: &'a Check, record: &'a Record, rig: Option<&Rig>) -> Evidence<'a> {
        let gas = rig.and_then(|rig| rig.nominal.gas).unwrap_or(Gas::STANDARD);
        Evidence {
            check,
            record,
            law: rig.map(Law::of),
            atmosphere_pa: gas.atmospheric_pressure.0,
            shut: record.shut(),
        }
    }

    fn doubts(&self) -> Vec<Doubt> {
        let mut doubts: Vec<Doubt> = self.time().into_iter().collect();
        let pressures = [PRESSURE_REF_PA, PRESSURE_PA, SUPPLY_PA];
        let scaled = pressures.map(|name| self.pressure_scale(name));
        let signed = pressures.map(|name| self.pressure_sign(name));
        let are_sane = [&scaled, &signed].iter().all(|found| {
            let mut found = found.iter();
            found.all(Option::is_none)
        });
        let doubted = scaled.into_iter().zip(signed);
        doubts.extend(doubted.filter_map(|(scaled, signed)| scaled.or(signed)));
        // Contractions that are too small make pressures look too high.
        let length = are_sane.then(|| self.length()).flatten();
        if are_sane && length.is_none() {
            doubts.extend(self.absolute());
        }
        let contraction = length.or_else(|| self.contraction(are_sane));
        let is_sane = are_sane && contraction.is_none();
        doubts.extend(contraction);
        doubts.extend(self.force(is_sane));
        doubts.extend(self.temperature());
        doubts.extend(self.finger());
        doubts
    }

    fn range(&self, name: &str) -> Option<Range> {
        Some(Range {
            low: self.range_at(name, SPIKES)?,
            high: self.range_at(name, 1.0 - SPIKES)?,
        })
    }

    fn moves(&self, name: &str) -> bool {
        self.check.moves(name)
    }

    /// Correlation of two columns; 0 if one of them does not move.
    fn correlation(&self, one: &str, other: &str) -> f64 {
        let columns = (self.record.column(one), self.record.column(other));
        let (Some(one_values), Some(other_values)) = columns else {
            return 0.0;
        };
        if !(self.moves(one) && self.moves(other)) {
            return 0.0;
        }
        let pairs = one_values.iter().zip(other_values);
        let pairs = pairs.filter(|(one, other)| !(one.is_nan() || other.is_nan()));
        let [mut n, mut x, mut y, mut xx, mut xy, mut yy] = [0.0; 6];
        for (one, other) in pairs {
            n += 1.0;
            let (dx, dy) = (one - x, other - y);
            x += dx / n;
            y += dy / n;
            xx += dx * (one - x);
            yy += dy * (other - y);
            xy += dx * (other - y);
        }
        if xx > 0.0 && yy > 0.0 {
            xy / (xx * yy).sqrt()
        } else {
            0.0
        }
    }

    /// Correlation with the reference, or with the pressure without one.
    fn driven(&self, name: &str) -> f64 {
        let by = [PRESSURE_PA, PRESSURE_REF_PA];
        let most = by.map(|drive| self.correlation(drive, name));
        match most[0].abs() > most[1].abs() {
            true => most[0],
            false => most[1],
        }
    }

    /// The quantile of a column at `share`.
    fn range_at(&self, name: &str, share: f64) -> Option<f64> {
        let values = self.record.column(name)?.iter().copied();
        Some(quantile(
            values.filter(|value| !value.is_nan()).collect(),
            share,
        ))
    }

    /// The rows with the highest values of `name`: see [`Self::rows`].
    fn high_rows(&self, law: &Law, name: &str) -> Vec<(f64, f64, f64)> {
        let high = self.range_at(name, HIGH);
        high.map_or_else(Vec::new, |high| self.rows(law, name, high..=f64::INFINITY))
    }

    /// Value of `name`, contraction and force of the rows with values `within`, where the weight is
    /// off its stop or the force was measured.
    fn rows(&self, law: &Law, name: &str, within: RangeInclusive<f64>) -> Vec<(f64, f64, f64)> {
        let (Some(values), Some(contraction)) =
            (self.record.column(name), self.record.column(CONTRACTION))
        else {
            return Vec::new();
        };
        let force = self.record.column(FORCE_N);
        let rows = (0..values.len()).filter(|row| within.contains(&values[*row]));
        let rows = rows.filter_map(|row| {
            let (value, contraction) = (values[row], contraction[row]);
            let measured_n = force.map(|force| force[row]).filter(|n| !n.is_nan());
            let carried_n = law.weight_n.filter(|_| contraction > CONTRACTION_USED);
            let force_n = measured_n.or(carried_n)?;
            (contraction.abs() < CONTRACTION_MAX).then_some((value, contraction, force_n))
        });
        rows.collect()
    }

    /// By what the numbers of a column of pressures have to be multiplied to be what the force law
    /// needs.
    fn pressure_factor(&self, name: &str) -> Option<f64> {
        let law = self.law.as_ref()?;
        let rows = self.high_rows(law, name);
        let factors = rows
            .into_iter()
            .filter_map(|(value, contraction, force_n)| {
                let needed_pa = law.pressure_pa(contraction, force_n)?;
                (value > 0.0 && needed_pa > 0.0).then_some(needed_pa / value)
            });
        let factors: Vec<f64> = factors.collect();
        (!factors.is_empty()).then(|| quantile(factors, 0.5))
    }

    /// Bar, kPa, psi or MPa in place of Pa, or numbers beyond any muscle's pressure.
    fn pressure_scale(&self, name: &'static str) -> Option<Doubt> {
        let highest = self.range(name)?.largest();
        if highest > PRESSURE_BURST_PA {
            let expected = format!(
                "gauge pressures in Pa up to {PRESSURE_BURST_PA:e}, at which any muscle bursts, \
                 found {}",
                significant(highest)
            );
            return Some(Doubt {
                signal: name,
                expected,
                likely: String::new(),
                option: String::new(),
            });
        }
        if highest == 0.0 || highest > PRESSURE_IDLE_PA {
            return None;
        }
        let beside = self.beside(name, highest);
        let why = match &beside {
            Some((other, other_pa)) => {
                format!("while `{other}` reaches {}", significant(*other_pa))
            }
            None => format!("while {}", self.used(name)?),
        };
        let factor = match &beside {
            Some((_, other_pa)) => other_pa / highest,
            None => match self.pressure_factor(name) {
                // The force is that of a slack muscle: the pressure may be as it is.
                Some(factor) if factor < MUCH => return None,
                Some(factor) => factor,
                None => PRESSURE_TYPICAL_PA / highest,
            },
        };
        let supply_pa = self.law.as_ref().and_then(|law| law.supply_pa);
        let most_pa = supply_pa.filter(|pa| *pa > PRESSURE_WORKING_PA_MIN);
        let most_pa = 2.0 * most_pa.unwrap_or(PRESSURE_WORKING_PA_MAX);
        let works = |size: f64| (PRESSURE_WORKING_PA_MIN..=most_pa).contains(&(size * highest));
        let (unit, _) = nearest(&PRESSURE_UNITS, factor, works)?;
        let found = significant(highest);
        let expected = format!("gauge pressures in Pa, found at most {found} {why}");
        let sign = match self.range(name)? {
            Range { low, high } if high < ONE_SIDED * low.abs() => ",scale=-1",
            _ => "",
        };
        Some(Doubt::new(name, expected, unit, &format!("{unit}{sign}")))
    }

    /// Another column of pressures that this one follows, or feeds, and that is much higher.
    fn beside(&self, name: &str, highest: f64) -> Option<(&'static str, f64)> {
        let others = [PRESSURE_REF_PA, PRESSURE_PA];
        let others = others.into_iter().filter(|other| *other != name);
        let mut higher = others.filter_map(|other| {
            let other_pa = self.range(other)?.largest();
            let follows = name == SUPPLY_PA || self.correlation(name, other).abs() > FOLLOWS;
            let is_higher = other_pa > MUCH * highest && other_pa > PRESSURE_WORKING_PA_MIN;
            (is_higher && follows).then_some((other, other_pa))
        });
        higher.next()
    }

    /// What shows that a pressure that hardly any gauge would notice was used.
    fn used(&self, name: &str) -> Option<String> {
        if name == SUPPLY_PA {
            // It feeds a muscle whose pressure is in doubt as well.
            let fed = [PRESSURE_REF_PA, PRESSURE_PA].into_iter();
            let mut fed = fed.filter(|fed| self.pressure_scale(fed).is_some());
            let fed = fed.next_back()?;
            return Some(format!("it feeds `{fed}`"));
        }
        let contraction = self.range(CONTRACTION);
        let contracts = contraction.is_some_and(|range| range.high - range.low > CONTRACTION_USED)
            && self.correlation(name, CONTRACTION).abs() > FOLLOWS;
        let pulls = self.correlation(name, FORCE_N).abs() > FOLLOWS;
        if contracts || pulls {
            let by = if contracts { CONTRACTION } else { FORCE_N };
            return Some(format!("`{by}` follows it"));
        }
        let other = match name {
            PRESSURE_PA => PRESSURE_REF_PA,
            _ => PRESSURE_PA,
        };
        let noise_pa = self.check.signal(PRESSURE_PA)?.noise;
        let is_quiet = self.moves(PRESSURE_PA) && noise_pa < GAUGE_NOISE_PA_MIN;
        (is_quiet && self.correlation(name, other) > FOLLOWS)
            .then(|| format!("the noise of {noise_pa:.2e} Pa is below that of any gauge"))
    }

    /// Pressures whose sign is wrong.
    fn pressure_sign(&self, name: &'static str) -> Option<Doubt> {
        let Range { low, high } = self.range(name)?;
        let is_mostly = self.range_at(name, 0.5)? < 0.0;
        let is_wrong = low < -PRESSURE_WORKING_PA_MIN && high < ONE_SIDED * -low && is_mostly;
        let found = from_to(low, high);
        let expected = format!("gauge pressures, which fill the muscle, found {found}");
        is_wrong.then(|| Doubt::new(name, expected, "of the other sign", "Pa,scale=-1"))
    }

    /// Absolute pressures in place of gauge pressures.
    fn absolute(&self) -> Vec<Doubt> {
        let atmosphere_pa = self.atmosphere_pa;
        let never_below = |name| {
            let lowest = self.range_at(name, 0.001)?;
            (lowest > 0.9 * atmosphere_pa).then_some(lowest)
        };
        let doubt = |name, lowest: f64, why: &str| {
            let expected = format!("gauge pressures, found none below {lowest:.0} Pa, {why}");
            let unit = format!("Pa,offset={}", -atmosphere_pa);
            Doubt::new(name, expected, "absolute pressures", &unit)
        };
        let (pressure, reference) = (never_below(PRESSURE_PA), never_below(PRESSURE_REF_PA));
        let near = |by_pa: f64, middle_pa: f64| {
            (middle_pa - by_pa).abs() < ATMOSPHERE_SHARE * atmosphere_pa
        };
        // A valve that lags, or whose dead zone is wide, is on both sides of its reference.
        let apart = self.apart(f64::INFINITY);
        let is_above =
            |[low, middle, _]: [f64; 3]| low > 0.5 * atmosphere_pa && near(atmosphere_pa, middle);
        if let Some(lowest) = pressure.filter(|_| apart.is_some_and(is_above)) {
            let why = format!("one atmosphere above `{PRESSURE_REF_PA}`");
            return vec![doubt(PRESSURE_PA, lowest, &why)];
        }
        // A supply that is too low keeps the pressure below a high reference, not a low one.
        let is_below = |[_, middle, high]: [f64; 3]| {
            high < -0.5 * atmosphere_pa && near(-atmosphere_pa, middle)
        };
        let middle_pa = self.range_at(PRESSURE_REF_PA, 0.5).unwrap_or(0.0);
        let low_apart = self.apart(middle_pa);
        if let Some(lowest) = reference.filter(|_| low_apart.is_some_and(is_below)) {
            let why = format!("one atmosphere above `{PRESSURE_PA}`");
            return vec![doubt(PRESSURE_REF_PA, lowest, &why)];
        }
        let Some(lowest) = pressure.filter(|_| self.is_absolute_by_law()) else {
            return Vec::new();
        };
        let why = "one atmosphere above what the rig's force law (Eq 1) needs";
        let mut doubts = vec![doubt(PRESSURE_PA, lowest, why)];
        let is_near = |[_, middle, _]: [f64; 3]| near(0.0, middle);
        if let Some(lowest) = reference.filter(|_| apart.is_some_and(is_near)) {
            doubts.push(doubt(PRESSURE_REF_PA, lowest, why));
        }
        doubts
    }

    /// Pressure less reference where the reference is at most `most_pa`, the valve is connected and
    /// the pressure hardly changes, as then it is the reference (Eq 9): near the lowest, middle and
    /// near the highest.
    fn apart(&self, most_pa: f64) -> Option<[f64; 3]> {
        let pressure = self.record.column(PRESSURE_PA)?;
        let reference = self.record.column(PRESSURE_REF_PA)?;
        let time_s = self.record.time_s();
        let mut held_pa = f64::NAN;
        // Change over a tenth of a second, and pressure less reference.
        let mut rows = Vec::new();
        let mut first = 0;
        for row in 0..pressure.len() {
            if !reference[row].is_nan() {
                held_pa = reference[row];
            }
            while first + 1 < row && time_s[row] - time_s[first] > CHANGE_S {
                first += 1;
            }
            let change_pa = (pressure[row] - pressure[first]).abs();
            let is_shut = self.shut.get(row).is_some_and(|shut| *shut);
            let apart_pa = pressure[row] - held_pa;
            if !is_shut && held_pa <= most_pa && !(apart_pa + change_pa).is_nan() {
                rows.push((change_pa, apart_pa));
            }
        }
        let slow_pa = quantile(rows.iter().map(|(change_pa, _)| *change_pa).collect(), SLOW);
        let slow = rows.iter().filter(|(change_pa, _)| *change_pa <= slow_pa);
        let apart: Vec<f64> = slow.map(|(_, apart_pa)| *apart_pa).collect();
        let at = |share| quantile(apart.clone(), share);
        (!apart.is_empty()).then(|| [at(0.1), at(0.5), at(0.9)])
    }

    /// Whether the pressure is one atmosphere above what the force law needs, at all heights alike.
    fn is_absolute_by_law(&self) -> bool {
        let Some(law) = &self.law else { return false };
        let Some(middle_pa) = self.range_at(PRESSURE_PA, 0.5) else {
            return false;
        };
        // The law's uncertainty grows with the pressure.
        let rows = self.rows(law, PRESSURE_PA, f64::NEG_INFINITY..=middle_pa);
        let excess = rows.iter().filter_map(|(value, contraction, force_n)| {
            Some(value - law.pressure_pa(*contraction, *force_n)?)
        });
        let excess: Vec<f64> = excess.collect();
        let uncertain = rows
            .iter()
            .map(|(value, contraction, _)| law.uncertainty_pa(*contraction, *value));
        let uncertain_pa = quantile(uncertain.collect(), 0.5);
        let at = |share| quantile(excess.clone(), share);
        let near_pa = ATMOSPHERE_SHARE * self.atmosphere_pa;
        !excess.is_empty()
            && uncertain_pa < near_pa
            && (at(0.5) - self.atmosphere_pa).abs() < near_pa
            && at(0.9) - at(0.1) < self.atmosphere_pa
    }

    /// Percent or millimetres in place of a ratio, or the wrong sign.
    fn contraction(&self, are_pressures_sane: bool) -> Option<Doubt> {
        let range = self.range(CONTRACTION)?;
        let Range { low, high } = range;
        let driven = self.driven(CONTRACTION);
        let is_one_sided = low < 0.0 && high < ONE_SIDED * -low;
        let sign = if is_one_sided { ",scale=-1" } else { "" };
        let largest = range.largest();
        if largest > CONTRACTION_MAX {
            let law = self.law.as_ref();
            let lengths = law.map(|law| [("mm", 1e-3 / law.length_m), ("cm", 1e-2 / law.length_m)]);
            let lengths = lengths.into_iter().flatten();
            let units: Vec<(&str, f64)> = [("%", 0.01)].into_iter().chain(lengths).collect();
            let fits = |size: f64| size * largest <= CONTRACTION_MAX;
            let used = are_pressures_sane.then(|| self.contraction_factor());
            // Without a force law: half of what a muscle can do is usual.
            let factor = used.flatten().unwrap_or(0.5 * CONTRACTION_MAX / largest);
            let expected = format!(
                "contractions y/L as a ratio, of which no braided muscle has more than 0.423, \
                 found {}",
                from_to(low, high)
            );
            return Some(match nearest(&units, factor, fits) {
                Some(("%", _)) => Doubt::new(CONTRACTION, expected, "percent", &format!("%{sign}")),
                Some((unit, size)) => {
                    let sign = if is_one_sided { "-" } else { "" };
                    Doubt::new(
                        CONTRACTION,
                        expected,
                        unit,
                        &format!("1,scale={sign}{size}"),
                    )
                }
                None => {
                    let unit = "1,scale=1e-3/LENGTH_M";
                    let likely = "mm (divide by the muscle's length)";
                    Doubt::new(CONTRACTION, expected, likely, unit)
                }
            });
        }
        let is_stretched = low < -STRETCH_MAX;
        let opposes = low < -CONTRACTION_USED && driven < -FOLLOWS;
        if !(is_one_sided && (is_stretched || opposes)) {
            return None;
        }
        let expected = format!(
            "contractions, which grow with the pressure, found {} (correlation {driven:.2})",
            from_to(low, high)
        );
        let unit = "1,scale=-1";
        Some(Doubt::new(CONTRACTION, expected, "of the other sign", unit))
    }

    /// The muscle's length, or by how much it is shorter, in metres.
    ///
    /// A length falls as the pressure rises. With a reference the pressure is what moves the
    /// muscle; without one the muscle may be moved by something else, and its pressure fall because
    /// its volume grows.
    fn length(&self) -> Option<Doubt> {
        let Range { low, high } = self.range(CONTRACTION)?;
        let found = from_to(low, high);
        let lifts = self.law.as_ref().is_some_and(|law| law.weight_n.is_some());
        let falls = match lifts {
            true => self.driven(CONTRACTION),
            false => self.correlation(PRESSURE_REF_PA, CONTRACTION),
        };
        let length_m = self.law.as_ref().map(|law| law.length_m);
        // In cm and mm it is beyond any contraction.
        let is_length = low > 0.0 && high < MUSCLE_M_MAX;
        if is_length && high - low > CONTRACTION_USED * high && falls < -FOLLOWS {
            let expected = format!(
                "contractions, which grow with the pressure, found {found} (correlation \
                 {falls:.2})"
            );
            // A clamped muscle is hardly longer than its rest length.
            let unit = match length_m.filter(|length_m| high < (1.0 + STRETCH_MAX) * length_m) {
                Some(length_m) => format!("1,scale={},offset=1", -1.0 / length_m),
                None => "1,scale=-1/LENGTH_M,offset=1".into(),
            };
            return Some(Doubt::new(
                CONTRACTION,
                expected,
                "the muscle's length in m",
                &unit,
            ));
        }
        let length_m = length_m?;
        let [least, most] = self.contraction_factors([0.25, 0.75])?;
        // The law with its tolerances, and friction, change it by less; and then at all heights.
        let like = 1.0 / LIKE_LENGTH..LIKE_LENGTH;
        let is_like = like.contains(&(least * length_m)) && like.contains(&(most * length_m));
        if !is_like || length_m > 1.0 / LIKE_LENGTH.powi(2) {
            return None;
        }
        let expected = format!(
            "contractions y/L, of some {} times as much by the rig's force law (Eq 1), found \
             {found}",
            significant((least * most).sqrt())
        );
        let unit = format!("1,scale={}", 1.0 / length_m);
        Some(Doubt::new(CONTRACTION, expected, "m", &unit))
    }

    /// By what the contraction has to be multiplied to be what the force law needs.
    fn contraction_factor(&self) -> Option<f64> {
        self.contraction_factors([0.5]).map(|[factor]| factor)
    }

    /// The quantiles of that factor at `shares`.
    fn contraction_factors<const N: usize>(&self, shares: [f64; N]) -> Option<[f64; N]> {
        let law = self.law.as_ref()?;
        let pressure = self.record.column(PRESSURE_PA)?;
        let contraction = self.record.column(CONTRACTION)?;
        let force = self.record.column(FORCE_N);
        let high_pa = self.range_at(PRESSURE_PA, HIGH)?;
        let rows = (0..pressure.len()).filter(|row| pressure[*row] >= high_pa.max(1.0));
        let factors = rows.filter_map(|row| {
            let measured_n = force.map(|force| force[row]).filter(|n| !n.is_nan());
            let needed = law.contraction(pressure[row], measured_n.or(law.weight_n)?)?;
            let factor = needed / contraction[row].abs();
            (needed > CONTRACTION_USED && factor.is_finite()).then_some(factor)
        });
        let factors: Vec<f64> = factors.collect();
        (!factors.is_empty()).then(|| shares.map(|share| quantile(factors.clone(), share)))
    }

    /// Forces in kN or mN, or of the wrong sign.
    fn force(&self, is_rest_sane: bool) -> Option<Doubt> {
        let Range { low, high } = self.range(FORCE_N)?;
        let typical = self.typical_forces(is_rest_sane);
        let is_one_sided = low < 0.0 && high < ONE_SIDED * -low;
        let opposes = self.correlation(PRESSURE_PA, FORCE_N) < -FOLLOWS;
        let is_opposite = typical.is_some_and(|(found, law)| found < -law / OPPOSITE);
        // A muscle that lifts something pulls.
        let lifts = high < 0.0 && self.driven(CONTRACTION) > FOLLOWS;
        if is_opposite || is_one_sided && (opposes || lifts) {
            let found = from_to(low, high);
            let expected = format!("forces of a muscle, which pulls, found {found}");
            let unit = "N,scale=-1";
            return Some(Doubt::new(FORCE_N, expected, "of the other sign", unit));
        }
        let (found, law) = typical?;
        let factor = law / found;
        let (unit, _) = nearest(&[("kN", 1e3), ("mN", 1e-3)], factor, |size| {
            (1.0 / FORCE_FACTOR..FORCE_FACTOR).contains(&(factor / size))
        })?;
        let is_far = !(1.0 / FORCE_FACTOR..FORCE_FACTOR).contains(&factor);
        let is_signal = self.moves(FORCE_N) || low == high;
        let expected = format!("forces in N, of some {law:.3} N by the rig, found {found:.3e}");
        (is_far && is_signal && found > 0.0).then(|| Doubt::new(FORCE_N, expected, unit, unit))
    }

    /// The force at high pressures, measured and by the force law or the weight.
    fn typical_forces(&self, is_rest_sane: bool) -> Option<(f64, f64)> {
        let law = self.law.as_ref()?;
        if let Some(weight_n) = law.weight_n {
            // A vented muscle may be pushed (Eq 1): it says nothing about the sign.
            let force = self.record.column(FORCE_N)?.iter().copied();
            let lifted = self.record.column(CONTRACTION);
            let carries = |row: &usize| {
                lifted.is_none_or(|contraction| contraction[*row].abs() > CONTRACTION_USED)
            };
            let rows = force.enumerate().filter(|(row, _)| carries(row));
            let carried = rows.map(|(_, force_n)| force_n);
            let carried: Vec<f64> = carried.filter(|force_n| !force_n.is_nan()).collect();
            return (!carried.is_empty()).then(|| (quantile(carried, 0.5), weight_n));
        }
        if !is_rest_sane || !self.moves(FORCE_N) {
            return None;
        }
        let rows = self.high_rows(law, PRESSURE_PA);
        let (found, by_law): (Vec<f64>, Vec<f64>) = rows
            .iter()
            .map(|(pressure_pa, contraction, force_n)| {
                (*force_n, law.force_n(*contraction, *pressure_pa))
            })
            .unzip();
        let law_n = quantile(by_law, 0.5);
        (law_n > 0.0).then(|| (quantile(found, 0.5), law_n))
    }

    /// Milliseconds, microseconds, hours or a spreadsheet's days in place of seconds.
    fn time(&self) -> Option<Doubt> {
        let period_s = self.check.sampling.period_s;
        if period_s > 0.0 && period_s < PERIOD_S_MIN {
            let [first, last] = DATES_D;
            let (unit, why) = match self.record.time_s().first() {
                Some(date) if (first..last).contains(date) => ("d", ", from a spreadsheet's date"),
                _ => ("h", ""),
            };
            let expected = format!("seconds, found rows {period_s:.2e} s apart{why}");
            return Some(Doubt::new(TIME_S, expected, unit, unit));
        }
        if period_s < PERIOD_S_DOUBTFUL {
            return None;
        }
        let names = [PRESSURE_REF_PA, PRESSURE_PA, CONTRACTION, FORCE_N];
        let cycles = |name: &&str| self.check.signal(name).is_some_and(|s| s.reversals >= 2);
        let moving = names.iter().find(|name| cycles(name));
        let by_hand = [FINGER_M, INPUT_FORCE_N];
        let by_hand = by_hand.into_iter().find(|name| self.moves(name));
        let why = if let Some(name) = moving.filter(|_| period_s >= PERIOD_S_MAX) {
            format!("`{name}` goes up and down")
        } else if let Some(name) = by_hand.filter(|_| period_s >= PERIOD_S_MAX) {
            format!("a person moves `{name}`")
        } else {
            let lag_s = self.lag_s()?;
            let is_slow = lag_s > LAG_S_MAX && lag_s > 5.0 * period_s;
            is_slow.then(|| format!("the pressure follows a step in {lag_s} s"))?
        };
        // The first that gives a rate of some logger.
        let units = [("ms", 1e-3), ("us", 1e-6)];
        let fits = |(_, size): &&(&str, f64)| period_s * size < PERIOD_S_DOUBTFUL;
        let (unit, _) = units.iter().find(fits)?;
        let expected = format!("seconds, found rows {period_s} s apart, in which {why}");
        Some(Doubt::new(TIME_S, expected, unit, unit))
    }

    /// The median time in which the pressure covers 63 % of a step of the reference.
    fn lag_s(&self) -> Option<f64> {
        let time_s = self.record.time_s();
        let reference = self.record.column(PRESSURE_REF_PA)?;
        let pressure = self.record.column(PRESSURE_PA)?;
        let range = self.range(PRESSURE_REF_PA)?;
        let step_pa = 0.2 * (range.high - range.low);
        let mut lags_s = Vec::new();
        for row in 1..reference.len() {
            let (before, after) = (reference[row - 1], reference[row]);
            let from = pressure[row];
            // Of a full step from rest only.
            if (after - before).abs() <= step_pa.max(1e-9) || (from - before).abs() > step_pa {
                continue;
            }
            let rest = (row..reference.len()).take_while(|next| reference[*next] == after);
            let mut rest = rest.filter(|next| {
                let share = (pressure[*next] - from) / (after - from);
                share >= 0.63
            });
            lags_s.extend(rest.next().map(|reached| time_s[reached] - time_s[row]));
        }
        (!lags_s.is_empty()).then(|| quantile(lags_s, 0.5))
    }

    /// Degrees in place of kelvin.
    fn temperature(&self) -> Option<Doubt> {
        // Rubber neither freezes stiff nor melts: see the rig's ambient temperature.
        const K: std::ops::RangeInclusive<f64> = 150.0..=500.0;
        let Range { low, high } = self.range(TEMPERATURE_K)?;
        let middle = 0.5 * (low + high);
        if K.contains(&middle) {
            return None;
        }
        let of_room_k = |kelvin: f64| (kelvin - 293.0).abs();
        let (celsius_k, fahrenheit_k) = (middle + 273.15, (middle + 459.67) / 1.8);
        let unit = match of_room_k(celsius_k) <= of_room_k(fahrenheit_k) {
            true => "degC",
            false => "degF",
        };
        let found = from_to(low, high);
        let expected = format!("absolute temperatures in K, found {found}");
        Some(Doubt::new(TEMPERATURE_K, expected, unit, unit))
    }

    /// Millimetres in place of metres.
    fn finger(&self) -> Option<Doubt> {
        let largest = self.range(FINGER_M)?.largest();
        let found = significant(largest);
        let expected = format!("metres, of which an arm reaches {REACH_M}, found {found}");
        (largest > REACH_M).then(|| Doubt::new(FINGER_M, expected, "mm", "mm"))
    }
}
