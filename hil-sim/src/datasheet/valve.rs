//! What data sheets of valves state, and the flow gain of Eq 9.
//!
//! Eq 9 is linear: G = K_G (P_r − P). A valve is a restriction by ISO 6358-1, and the flow from the
//! pressure P_r to P is proportional to neither. K_G is the chord of that characteristic over the
//! drop at which data sheets state the nominal flow, 6 to 5 bar: K_G = ρ₀ Q/(1 bar). It holds for
//! 6 bar upstream; the chord over 1 bar falls with the upstream pressure, to less than half at 1
//! bar. Below a drop of 1 bar a restriction passes more than the chord, beyond it less. The effect
//! `flow-limit` is an upper limit, and so describes the large drops alone.

use crate::error::one_of;
use model_core::pressure::AbsolutePa;
use muscle_plant::effects::orifice::Orifice;
use serde::Serialize;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Density of air at the reference of ISO 8778 (ANR): 20 °C, 100 kPa, 65 % humidity \[kg/m³\].
const ANR_KG_PER_M3: f64 = 1.185;
/// Atmosphere of the nominal flow rate: data sheets count 6 bar as 7 bar absolute \[bar\].
const ATMOSPHERE_BAR: f64 = 1.0;
/// Pressures of the nominal flow rate (gauge) \[bar\].
const NOMINAL_BAR: (f64, f64) = (6.0, 5.0);
const PA_PER_BAR: f64 = 1e5;
const L_PER_MIN_PER_M3_PER_S: f64 = 60_000.0;
/// Critical ratio where a data sheet has none: spool valves have 0.2 to 0.4.
pub const TYPICAL_CRITICAL_RATIO: f64 = 0.3;
/// Largest critical ratio: that of the effect `flow-limit`, which takes it over. Valves have up to
/// 0.5.
const CRITICAL_RATIO_MAX: f64 = 0.6;
/// Drops between which a valve works that controls a muscle's pressure \[bar\].
const WORKING_DROPS_BAR: (f64, f64) = (0.2, 4.0);
/// Conductance in kg/(s·Pa) of 1 dm³/(s·bar).
const KG_PER_S_PA: f64 = 1e-3 / PA_PER_BAR * ANR_KG_PER_M3;
/// Kv of a Cv of 1: m³/h of water at 1 bar, and US gallons per minute at 1 psi.
const KV_PER_CV: f64 = 0.865;
/// Density of dry air at 1 bar and 20 °C \[kg/m³\].
const AIR_KG_PER_M3_BAR: f64 = 1.189;
/// Factor of IEC 60534-2-1 for Kv, mass flow in kg/h, pressure in bar and density in kg/m³. That
/// for Cv is 27.3.
const IEC_N6: f64 = 31.6;
/// Critical ratio of the pressure drop by IEC 60534-2-1, between those of globe valves.
const IEC_XT: f64 = 0.7;

/// A valve by ISO 6358-1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValveSheet {
    /// Sonic conductance C \[dm³/(s·bar)\], ANR.
    pub conductance_dm3_per_s_bar: f64,
    /// Critical ratio b \[-\].
    pub critical_ratio: f64,
}

/// The same valve in the words of data sheets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ValveWords {
    /// Nominal flow rate from 6 to 5 bar \[l/min\], ANR.
    pub nominal_flow_l_per_min: f64,
    /// Sonic conductance C \[dm³/(s·bar)\], ANR.
    pub conductance_dm3_per_s_bar: f64,
    /// The same as mass flow over upstream pressure, C ρ₀ \[kg/(Pa·s)\]: what `flow-limit` takes.
    pub conductance_kg_per_pa_s: f64,
    /// Critical ratio b \[-\].
    pub critical_ratio: f64,
    /// Kv \[m³/h\].
    pub kv_m3_per_h: f64,
    /// Cv \[US gal/min\].
    pub cv_us_gal_per_min: f64,
}

/// Proportional directional valves as they are sold: nominal flow \[l/min\] and port. Festo's MPYE
/// series; other makers have the same sizes.
const CLASSES: [(f64, &str); 5] = [
    (100.0, "M5"),
    (350.0, "G1/8, low flow"),
    (700.0, "G1/8, high flow"),
    (1400.0, "G1/4"),
    (2000.0, "G3/8"),
];

impl ValveSheet {
    /// The valve that passes a flow \[kg/s\] between gauge pressures \[bar\].
    fn passing(flow_kg_per_s: f64, (from_bar, to_bar): (f64, f64), critical_ratio: f64) -> Self {
        let unit = ValveSheet {
            conductance_dm3_per_s_bar: 1.0,
            critical_ratio,
        };
        ValveSheet {
            conductance_dm3_per_s_bar: flow_kg_per_s / unit.flow_kg_per_s((from_bar, to_bar)),
            critical_ratio,
        }
    }

    /// The valve of a flow gain of Eq 9, with the typical critical ratio.
    pub fn of_gain(flow_gain_kg_per_pa_s: f64) -> ValveSheet {
        let drop_pa = (NOMINAL_BAR.0 - NOMINAL_BAR.1) * PA_PER_BAR;
        ValveSheet::passing(
            flow_gain_kg_per_pa_s * drop_pa,
            NOMINAL_BAR,
            TYPICAL_CRITICAL_RATIO,
        )
    }

    /// Mass flow between gauge pressures in bar \[kg/s\].
    fn flow_kg_per_s(&self, (from_bar, to_bar): (f64, f64)) -> f64 {
        let orifice = Orifice {
            conductance_kg_per_pa_s: self.conductance_dm3_per_s_bar * KG_PER_S_PA,
            critical_ratio: self.critical_ratio,
        };
        let absolute = |bar: f64| AbsolutePa((bar + ATMOSPHERE_BAR) * PA_PER_BAR);
        orifice.flow_kg_per_s(absolute(from_bar), absolute(to_bar))
    }

    /// K_G of Eq 9 \[kg/(Pa·s)\]: the chord over the drop of the nominal flow.
    pub fn flow_gain_kg_per_pa_s(&self) -> f64 {
        self.flow_kg_per_s(NOMINAL_BAR) / ((NOMINAL_BAR.0 - NOMINAL_BAR.1) * PA_PER_BAR)
    }

    /// The ratio of the chord over a drop from 6 bar to the one over 1 bar \[-\].
    pub fn chord_ratio(&self, drop_bar: f64) -> f64 {
        let (from_bar, to_bar) = (NOMINAL_BAR.0, NOMINAL_BAR.0 - drop_bar);
        let per_bar = self.flow_kg_per_s((from_bar, to_bar)) / drop_bar;
        per_bar / self.flow_kg_per_s(NOMINAL_BAR)
    }

    /// The chord ratios over the smallest and the largest working drop \[-\].
    pub fn working_chord_ratios(&self) -> [f64; 2] {
        let (smallest_bar, largest_bar) = WORKING_DROPS_BAR;
        [smallest_bar, largest_bar].map(|drop_bar| self.chord_ratio(drop_bar))
    }

    /// Relative standard deviation of K_G because Eq 9 is one chord of a curve \[-\]: that of a
    /// uniform distribution between the chords over the working drops.
    pub fn chord_sigma(&self) -> f64 {
        let [most, least] = self.working_chord_ratios();
        (most - least) / 12_f64.sqrt()
    }

    /// What a data sheet would say.
    pub fn words(&self) -> ValveWords {
        let nominal_kg_per_s = self.flow_kg_per_s(NOMINAL_BAR);
        let kv_m3_per_h = nominal_kg_per_s / kv_flow_kg_per_s(1.0);
        ValveWords {
            nominal_flow_l_per_min: nominal_kg_per_s / ANR_KG_PER_M3 * L_PER_MIN_PER_M3_PER_S,
            conductance_dm3_per_s_bar: self.conductance_dm3_per_s_bar,
            conductance_kg_per_pa_s: self.conductance_dm3_per_s_bar * KG_PER_S_PA,
            critical_ratio: self.critical_ratio,
            kv_m3_per_h,
            cv_us_gal_per_min: kv_m3_per_h / KV_PER_CV,
        }
    }
}

/// Nominal mass flow of a Kv \[kg/s\], IEC 60534-2-1 for a gas below choking:
/// W = N₆ Kv Y √(x p₁ ρ₁), Y = 1 − x/(3 x_T), with x the drop over p₁.
fn kv_flow_kg_per_s(kv_m3_per_h: f64) -> f64 {
    let upstream_bar = NOMINAL_BAR.0 + ATMOSPHERE_BAR;
    let drop = (NOMINAL_BAR.0 - NOMINAL_BAR.1) / upstream_bar;
    let expansion = 1.0 - drop / (3.0 * IEC_XT);
    let density_kg_per_m3 = AIR_KG_PER_M3_BAR * upstream_bar;
    expansion * iec_flow_kg_per_h(kv_m3_per_h, drop * upstream_bar, density_kg_per_m3) / 3600.0
}

/// Mass flow of what does not expand \[kg/h\].
fn iec_flow_kg_per_h(kv_m3_per_h: f64, drop_bar: f64, density_kg_per_m3: f64) -> f64 {
    IEC_N6 * kv_m3_per_h * (drop_bar * density_kg_per_m3).sqrt()
}

/// How a number of a data sheet is rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rounding {
    /// What is there: to the nearest number.
    Nearest,
    /// What is needed: a valve with these numbers has enough.
    Up,
}

/// A positive number with three significant digits.
fn significant(value: f64, rounding: Rounding) -> String {
    let digits_before = value.log10().floor() as i32 + 1;
    let step = 10_f64.powi(digits_before - 3);
    let steps = match rounding {
        Rounding::Nearest => (value / step).round(),
        // A number that has three digits already stays as it is.
        Rounding::Up => (value / step - 1e-9).ceil(),
    };
    let decimals = usize::try_from(3 - digits_before).unwrap_or(0);
    format!("{:.decimals$}", steps * step)
}

impl ValveWords {
    /// The numbers as a data sheet has them.
    pub fn sheet(&self, rounding: Rounding) -> String {
        let digits = |value| significant(value, rounding);
        format!(
            "{} l/min (ANR) from 6 to 5 bar, C = {} dm³/(s·bar) with b = {}, Kv = {} m³/h, \
             Cv = {} US gal/min",
            digits(self.nominal_flow_l_per_min),
            digits(self.conductance_dm3_per_s_bar),
            self.critical_ratio,
            digits(self.kv_m3_per_h),
            digits(self.cv_us_gal_per_min),
        )
    }

    /// Where the chord does not hold, and the effect that takes over the data sheet's curve.
    pub fn limits(&self) -> String {
        let sheet = ValveSheet {
            conductance_dm3_per_s_bar: self.conductance_dm3_per_s_bar,
            critical_ratio: self.critical_ratio,
        };
        let [from_5, from_2, from_1] = [5.0, 2.0, 1.0].map(|from_bar| {
            sheet.flow_kg_per_s((from_bar, from_bar - 1.0)) / sheet.flow_kg_per_s(NOMINAL_BAR)
        });
        format!(
            "The flow gain holds for 6 bar upstream and falls with that pressure (b = {}, over 1 \
             bar: {:.2} of it from 5 bar, {:.2} from 2, {:.2} from 1). Drops much above 1 bar are \
             those of the effect flow-limit with filling_conductance_kg_per_pa_s = {:.2e} and \
             critical_ratio = {}; smaller ones pass more per bar, which no effect describes.",
            self.critical_ratio,
            from_5,
            from_2,
            from_1,
            self.conductance_kg_per_pa_s,
            self.critical_ratio,
        )
    }

    /// The smallest valve that is sold with at least this flow, as words.
    pub fn class(&self) -> String {
        let flow_l_per_min = self.nominal_flow_l_per_min;
        let fits = CLASSES.iter().find(|(flow, _)| *flow >= flow_l_per_min);
        match (fits, CLASSES.last()) {
            (Some((flow, port)), _) => {
                format!("a proportional directional valve of {flow:.0} l/min ({port})")
            }
            (None, Some((flow, port))) => {
                let valves = (flow_l_per_min / flow).ceil();
                format!(
                    "more than the largest common proportional directional valve, {flow:.0} l/min \
                     ({port}): {valves:.0} of them in parallel, or a pilot valve with a booster"
                )
            }
            (None, None) => String::new(),
        }
    }
}

/// Sonic conductances of valves \[dm³/(s·bar)\]: the largest that are sold have some 50.
const CONDUCTANCE_DM3_PER_S_BAR: RangeInclusive<f64> = 1e-4..=100.0;

/// What `--valve` takes.
const SYNTAX: &str = "C=… in dm³/(s·bar), Kv=… in m³/h, Cv=… in US gal/min, or \
                      Q=…[,from=…,to=…] in l/min (ANR) between gauge pressures in bar; each with \
                      [,b=…] from 0 to 0.6";

impl FromStr for ValveSheet {
    type Err = String;

    fn from_str(text: &str) -> Result<ValveSheet, String> {
        let wrong = || format!("{SYNTAX}, found \"{text}\"");
        const NAMES: [&str; 7] = ["C", "Kv", "Cv", "Q", "from", "to", "b"];
        let mut values = Vec::new();
        for part in text.split(',') {
            let Some((name, number)) = part.split_once('=') else {
                let digits = part.trim().parse::<u64>().is_ok() && !values.is_empty();
                return Err(match digits {
                    true => format!("decimal points, found \"{text}\""),
                    false => wrong(),
                });
            };
            let (name, number) = (name.trim(), number.trim());
            if !NAMES.contains(&name) {
                return Err(one_of(&NAMES, name) + " (upper and lower case count)");
            }
            let number = number.parse().map_err(|_| {
                format!("a number without its unit behind {name}=, found \"{number}\"")
            })?;
            let number = Some(number).filter(|number: &f64| number.is_finite());
            if values.iter().any(|(known, _)| *known == name) {
                return Err(wrong());
            }
            values.push((name, number.ok_or_else(wrong)?));
        }
        let mut take = |wanted: &str| {
            let place = values.iter().position(|(name, _)| *name == wanted)?;
            Some(values.remove(place).1)
        };
        let critical_ratio = take("b").unwrap_or(TYPICAL_CRITICAL_RATIO);
        let between = [take("from"), take("to")];
        let (from_bar, to_bar) = (
            between[0].unwrap_or(NOMINAL_BAR.0),
            between[1].unwrap_or(NOMINAL_BAR.1),
        );
        let sizes = ["C", "Kv", "Cv", "Q"].map(&mut take);
        let nominal = |kv| ValveSheet::passing(kv_flow_kg_per_s(kv), NOMINAL_BAR, critical_ratio);
        let sheet = match sizes {
            [Some(conductance_dm3_per_s_bar), None, None, None] => ValveSheet {
                conductance_dm3_per_s_bar,
                critical_ratio,
            },
            [None, Some(kv), None, None] => nominal(kv),
            [None, None, Some(cv), None] => nominal(cv * KV_PER_CV),
            [None, None, None, Some(flow_l_per_min)] => {
                let flow_kg_per_s = flow_l_per_min / L_PER_MIN_PER_M3_PER_S * ANR_KG_PER_M3;
                ValveSheet::passing(flow_kg_per_s, (from_bar, to_bar), critical_ratio)
            }
            _ => return Err(wrong()),
        };
        // The other sizes have their pressures.
        let has_use = between == [None, None] || sizes[3].is_some();
        let in_range = CONDUCTANCE_DM3_PER_S_BAR.contains(&sheet.conductance_dm3_per_s_bar)
            && (0.0..=CRITICAL_RATIO_MAX).contains(&critical_ratio)
            && (from_bar > to_bar && to_bar >= 0.0 && from_bar <= 100.0)
            && has_use
            && values.is_empty();
        if sheet.conductance_dm3_per_s_bar > *CONDUCTANCE_DM3_PER_S_BAR.end() {
            let most = CONDUCTANCE_DM3_PER_S_BAR.end();
            return Err(format!("{}; C is at most {most} dm³/(s·bar)", wrong()));
        }
        in_range.then_some(sheet).ok_or_else(wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gain(text: &str) -> f64 {
        let sheet: ValveSheet = text.parse().expect("a valve");
        sheet.flow_gain_kg_per_pa_s()
    }

    fn assert_near(found: f64, expected: f64, relative: f64) {
        assert!(
            (found / expected - 1.0).abs() < relative,
            "{found} {expected}"
        );
    }

    /// 700 l/min = 0.011667 m³/s of 1.185 kg/m³ at 1 bar.
    #[test]
    fn the_flow_gain_is_the_nominal_flow_over_its_drop() {
        assert_near(gain("Q=700"), 700.0 / 6e4 * 1.185 / 1e5, 1e-12);
        // The critical ratio does not matter where the drop is the nominal one.
        assert_near(gain("Q=700,b=0.4"), gain("Q=700"), 1e-12);
    }

    /// C = 2 dm³/(s·bar), b = 0.3, 7 to 6 bar absolute: 14 dm³/s · √(1 − ((6/7 − 0.3)/0.7)²).
    #[test]
    fn the_conductance_follows_the_ellipse_of_the_standard() {
        let share = 1.0 - ((6.0_f64 / 7.0 - 0.3) / 0.7).powi(2);
        let expected = 14e-3 * share.sqrt() * 1.185 / 1e5;
        assert_near(gain("C=2,b=0.3"), expected, 1e-12);
        assert_near(gain("C=2"), expected, 1e-12);
        // Choked: 7 bar absolute to 1 bar.
        let choked = format!("Q={},from=6,to=0,b=0.3", 14.0 * 60.0);
        assert_near(gain(&choked), expected, 1e-12);
    }

    /// Kv is the flow of water at 1 bar in m³/h. N₆ has three digits: to half of the last one,
    /// 0.2 %.
    #[test]
    fn kv_is_a_flow_of_water() {
        assert_near(iec_flow_kg_per_h(1.0, 1.0, 1e3), 1e3, 2e-3);
        assert_near(iec_flow_kg_per_h(0.5, 4.0, 1e3), 1e3, 2e-3);
    }

    /// Handbooks round the conversion: Q = 984 Cv and 1100 Kv l/min (ANR), 6 to 5 bar. They and the
    /// standard differ by less than the tolerance of a nominal flow, 10 %.
    #[test]
    fn kv_and_cv_agree_with_the_rules_of_thumb() {
        assert_near(gain("Kv=1"), gain("Q=1100"), 0.1);
        assert_near(gain("Cv=1"), gain("Q=984"), 0.1);
        assert_near(gain("Kv=0.865"), gain("Cv=1"), 1e-12);
        // √(x p₁ ρ₁) = √(1 bar · 7 · 1.189 kg/m³), Y = 1 − 1/14.7, in l of 1.185 g.
        let expected = 31.62 * (7.0_f64 * 1.189).sqrt() * (1.0 - 1.0 / 14.7) / 1.185e-3 / 60.0;
        assert_near(gain("Kv=1"), gain(&format!("Q={expected}")), 1e-3);
    }

    /// Half the uniform range from 2.34 to 0.41 would be 0.96: its deviation is 0.56.
    #[test]
    fn the_chord_depends_on_the_drop_and_on_the_upstream_pressure() {
        let sheet: ValveSheet = "C=2,b=0.3".parse().expect("a valve");
        // q = 6.8/7 and 3/7: √(1 − ((q − 0.3)/0.7)²) over the drop, relative to that of 1 bar.
        let per_bar = |drop_bar: f64| {
            let share = ((7.0 - drop_bar) / 7.0 - 0.3) / 0.7;
            (1.0 - share * share).sqrt() / drop_bar
        };
        let [most, least] = sheet.working_chord_ratios();
        assert_near(most, per_bar(0.2) / per_bar(1.0), 1e-12);
        assert_near(least, per_bar(4.0) / per_bar(1.0), 1e-12);
        assert_near(sheet.chord_sigma(), (most - least) / 12_f64.sqrt(), 1e-12);
        let nominal = sheet.flow_kg_per_s(NOMINAL_BAR);
        for (from_bar, share) in [(5.0, 0.92), (2.0, 0.60), (1.0, 0.45)] {
            let found = sheet.flow_kg_per_s((from_bar, from_bar - 1.0)) / nominal;
            assert!((found - share).abs() < 0.005, "{from_bar} bar: {found}");
            assert!(sheet.words().limits().contains(&format!("{share:.2}")));
        }
    }

    /// The words of `limits` can be pasted: the effect has the same curve, and takes every b.
    #[test]
    fn the_flow_limit_takes_the_valve_over() {
        let words = "C=2.5,b=0.6"
            .parse::<ValveSheet>()
            .expect("a valve")
            .words();
        // 2.5 dm³/(s·bar) of 1.185 kg/m³: 2.96e-8 kg/(Pa·s).
        assert_near(words.conductance_kg_per_pa_s, 2.5e-8 * 1.185, 1e-12);
        assert!(
            words
                .limits()
                .contains("filling_conductance_kg_per_pa_s = 2.96e-8")
        );
        let kind = muscle_plant::effects::Catalogue::standard().find("flow-limit");
        let form = &kind.expect("flow-limit").forms[0];
        let parameter = |name: &str| form.parameters.iter().find(|known| known.name == name);
        let ratio = parameter("critical_ratio").expect("the key");
        assert!(words.critical_ratio == CRITICAL_RATIO_MAX && CRITICAL_RATIO_MAX <= ratio.max);
        assert!(parameter("filling_conductance_kg_per_pa_s").is_some());
    }

    #[test]
    fn numbers_have_three_digits_and_a_need_is_rounded_up() {
        for (value, nearest, up) in [
            (658.2, "658", "659"),
            (0.001_234, "0.00123", "0.00124"),
            (2.5, "2.50", "2.50"),
            (9.996, "10.00", "10.00"),
            (12_345.0, "12300", "12400"),
        ] {
            assert_eq!(significant(value, Rounding::Nearest), nearest);
            assert_eq!(significant(value, Rounding::Up), up);
        }
        let needed = ValveSheet::of_gain(1.234e-10).words().sheet(Rounding::Up);
        let (flow, _) = needed.split_once(' ').expect("words");
        assert!(gain(&format!("Q={flow}")) >= 1.234e-10, "{needed}");
        assert!(!needed.contains("= 0.00 "), "{needed}");
    }

    #[test]
    fn a_valve_reads_back_from_its_own_data_sheet() {
        let sheet = ValveSheet::of_gain(1.3e-7);
        assert_near(sheet.flow_gain_kg_per_pa_s(), 1.3e-7, 1e-12);
        let words = sheet.words();
        for text in [
            format!(
                "C={},b={}",
                words.conductance_dm3_per_s_bar, words.critical_ratio
            ),
            format!("Q={}", words.nominal_flow_l_per_min),
            format!("Kv={}", words.kv_m3_per_h),
            format!("Cv={}", words.cv_us_gal_per_min),
        ] {
            assert_near(gain(&text), 1.3e-7, 1e-9);
        }
        assert!(words.class().contains("700 l/min (G1/8, high flow)"));
    }

    #[test]
    fn what_is_no_valve_is_refused() {
        for text in [
            "",
            "700",
            "C=2,Kv=1",
            "b=0.3",
            "C=-2",
            "C=NaN",
            "C=2,b=1",
            "C=2,b=0.61",
            "C=2,from=6,to=5",
            "Kv=1,from=6",
            "Q=700,from=5,to=6",
            "C=2,from=5,to=4",
            "C=2,C=2",
            "C=101",
        ] {
            let error = text.parse::<ValveSheet>().expect_err(text);
            assert!(error.starts_with("C=…"), "{error}");
        }
        for (text, expected) in [
            ("C=2,x=1", "one of C, Kv, Cv, Q, from, to, b, found \"x\""),
            ("kv=1", "one of C, Kv, Cv, Q, from, to, b, found \"kv\""),
            ("C=2,1", "decimal points, found"),
            ("C=2 l/(s·bar)", "a number without its unit behind C="),
        ] {
            let error = text.parse::<ValveSheet>().expect_err(text);
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
