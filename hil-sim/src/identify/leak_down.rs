//! A leak-down: what the pressure of a closed chamber tells without a rig.
//!
//! A chamber of constant volume and temperature whose leak is laminar loses air in proportion to
//! its gauge pressure p: p(t) = p₀ exp(−t/τ), τ = V/(RθC) with the leak's conductance C.

use super::diagnosis::{
    Clock, Diagnosis, Evidence, GapOf, Named, Options, Remaining, blocks, hypotheses,
};
use super::formula::Estimate;
use super::gap;
use super::report::quantity;
use crate::error::BadInput;
use crate::record::check::check;
use crate::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record};
use model_discrepancy::engine::{
    Active, Candidate, Coordinate, Engine, Hypothesis, Model, Parameter,
};
use model_discrepancy::least_squares::Residuals;
use model_discrepancy::left::when;
use model_discrepancy::rows::Timeline;
use model_discrepancy::verdict::{PROBABLE, Step, Verdict, Watch, probability, select};
use muscle_plant::effects::Catalogue;

const GAS: &str = "gas";
const LEAK: &str = "leak";
const EXPONENTIAL: &str = "exponential";
/// Rows that a decay is told from.
const LEAST_ROWS: usize = 20;
/// Standard deviation of the pressure sensor's zero, as a share of the largest pressure: a class of
/// 0.5 %.
const ZERO: f64 = 5e-3;
/// Share of its pressure by which a sound chamber may be off: by 0.3 K of the room, at constant
/// volume.
const ROOM: f64 = 1e-3;
/// Noise of a sensor whose readings repeat exactly, and least pressure that is told from none
/// \[Pa\].
const LEAST_NOISE_PA: f64 = 1.0;
const LEAST_PA: f64 = 1.0;
/// Time constants that are looked for \[s\].
const LEAST_S: f64 = 0.1;
const LARGEST_S: f64 = 1e8;
/// Parts of a record whose time constants are told apart if the decay is no exponential.
const PARTS: usize = 3;

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The share of a pressure that is left at each time, of that at `begin_s`.
fn shares(
    time_s: &[f64],
    begin_s: f64,
    time_constant_s: f64,
) -> impl Iterator<Item = f64> + use<'_> {
    let share = move |s: &f64| (-(s - begin_s) / time_constant_s).exp();
    time_s.iter().map(share)
}

/// A chamber's pressure over time.
struct Decay {
    time_s: Vec<f64>,
    pressure_pa: Vec<f64>,
}

impl Decay {
    /// The rows of `record` with a pressure, with the shut-off valve shut if there is one.
    fn of(record: &Record) -> Result<Decay, BadInput> {
        for column in [PRESSURE_REF_PA, CONTRACTION, FORCE_N] {
            if record.column(column).is_some() {
                let expected = "`--rig` with it: without a rig only a leak-down is diagnosed, the \
                                `pressure_pa` of a closed chamber alone";
                return Err(record.bad(column, expected));
            }
        }
        let (shut, pressure_pa) = (record.shut(), record.require(PRESSURE_PA)?);
        let rows = record.time_s().iter().zip(pressure_pa).enumerate();
        let rows =
            rows.filter(|(row, (_, pa))| !pa.is_nan() && shut.get(*row).copied().unwrap_or(true));
        let (time_s, pressure_pa): (Vec<f64>, Vec<f64>) =
            rows.map(|(_, (s, pa))| (*s, *pa)).unzip();
        if time_s.len() < LEAST_ROWS {
            let expected = format!("at least {LEAST_ROWS} pressures, found {}", time_s.len());
            return Err(record.bad(PRESSURE_PA, &expected));
        }
        Ok(Decay {
            time_s,
            pressure_pa,
        })
    }

    /// Measured less modelled pressure \[Pa\], from the pressure at the first row that fits best.
    fn missed(&self, zero_pa: f64, time_constant_s: f64) -> Vec<f64> {
        let shares = shares(&self.time_s, self.time_s[0], time_constant_s);
        let shares: Vec<f64> = shares.collect();
        let pairs = || shares.iter().zip(&self.pressure_pa);
        let product: f64 = pairs().map(|(share, pa)| share * (pa - zero_pa)).sum();
        let square: f64 = shares.iter().map(|share| share * share).sum();
        let first_pa = product / square;
        let missed = pairs().map(|(share, pa)| pa - zero_pa - first_pa * share);
        missed.collect()
    }

    /// Time constant by what is left at the end \[s\]; infinite where nothing is lost.
    fn overall_s(&self) -> f64 {
        let rows = (self.time_s.len() / PARTS).min(LEAST_ROWS);
        let from = self.time_s.len() - rows;
        let first_pa = mean(&self.pressure_pa[..rows]);
        let last_pa = mean(&self.pressure_pa[from..]);
        let spent_s = mean(&self.time_s[from..]) - mean(&self.time_s[..rows]);
        let lost = (first_pa / last_pa.max(LEAST_PA)).max(1.0).ln();
        spent_s / lost
    }

    /// Time constant by a straight line through each part of equal time \[s\], infinite or below 0
    /// where the pressure does not fall, with the mean pressure \[Pa\].
    fn local(&self) -> impl Iterator<Item = (f64, f64)> {
        let rows = self.time_s.len();
        (0..PARTS).map(move |part| {
            let part = part * rows / PARTS..(part + 1) * rows / PARTS;
            let (s, pa) = (&self.time_s[part.clone()], &self.pressure_pa[part]);
            let (mean_s, mean_pa) = (mean(s), mean(pa));
            let product: f64 = s.iter().zip(pa).map(|(s, pa)| (s - mean_s) * pa).sum();
            let square: f64 = s.iter().map(|s| (s - mean_s).powi(2)).sum();
            (-mean_pa * square / product, mean_pa)
        })
    }
}

/// Closed chambers, each with a pressure of its own to begin with.
struct Chamber {
    decays: Vec<Decay>,
    fitted: usize,
    noise_pa: f64,
    zero_pa: f64,
    nominal_blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
}

impl Chamber {
    fn new(fit: &[Record], validate: &[Record], without: &[String]) -> Result<Chamber, BadInput> {
        let records = || fit.iter().chain(validate);
        let decays = records().map(Decay::of).collect::<Result<Vec<_>, _>>()?;
        let noises = records().filter_map(|record| Some(check(record).signal(PRESSURE_PA)?.noise));
        // From another start no step may lead to a decay that is over soon.
        let overall_s = decays[..fit.len()].iter().map(Decay::overall_s);
        let usual_s = overall_s.fold(LARGEST_S, f64::min).max(LEAST_S);
        let largest = decays.iter().flat_map(|decay| &decay.pressure_pa);
        let leak = Candidate {
            effect: LEAK,
            form: EXPONENTIAL,
            parameters: vec![Parameter {
                name: "time_constant_s",
                unit: "s",
                range: (LEAST_S, LARGEST_S),
                usual: usual_s,
                log: true,
                neutral: None,
                ends: [false, true],
            }],
            blocks: vec![0],
            form_doubt: 0.0,
        };
        let is_known = !without.iter().any(|name| name == LEAK);
        Ok(Chamber {
            fitted: fit.len(),
            noise_pa: noises.fold(LEAST_NOISE_PA, f64::max),
            zero_pa: ZERO * largest.fold(0.0, |most: f64, pa| most.max(pa.abs())),
            nominal_blocks: vec![vec![0]],
            candidates: is_known.then_some(leak).into_iter().collect(),
            decays,
        })
    }

    /// Of a hypothesis; without a leak the pressure stays.
    fn time_constant_s(effects: &[Active]) -> f64 {
        let values = effects.first().and_then(|(_, values)| values.first());
        values.copied().unwrap_or(f64::INFINITY)
    }
}

impl Model for Chamber {
    fn records(&self) -> usize {
        self.decays.len()
    }

    fn fitted(&self) -> usize {
        self.fitted
    }

    fn blocks(&self) -> &[&'static str] {
        &[GAS]
    }

    fn nominal_blocks(&self) -> &[Vec<usize>] {
        &self.nominal_blocks
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    fn residuals(
        &self,
        record: usize,
        _: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        let zero_pa = self.zero_pa * nominal[0];
        let missed = self.decays[record].missed(zero_pa, Chamber::time_constant_s(effects));
        let rows = missed.into_iter().map(|pa| pa / self.noise_pa);
        Some(Residuals::exact(rows.collect()))
    }

    fn rows(&self, record: usize, _: usize) -> usize {
        self.decays[record].time_s.len()
    }

    fn proportional(&self, _: usize) -> bool {
        false
    }

    fn context(&self, record: usize, _: usize) -> Vec<Coordinate> {
        let decay = &self.decays[record];
        let coordinate = |name, unit, values: &[f64]| Coordinate {
            name,
            unit,
            values: values.to_vec(),
        };
        vec![
            coordinate("pressure", "Pa", &decay.pressure_pa),
            coordinate("time", "s", &decay.time_s),
        ]
    }

    fn timeline(&self, record: usize, _: usize) -> Timeline {
        let decay = &self.decays[record];
        let room = decay.pressure_pa.iter().map(|pa| ROOM * pa.abs());
        Timeline {
            time_s: decay.time_s.clone(),
            base: room
                .map(|pa| pa.max(LEAST_NOISE_PA) / self.noise_pa)
                .collect(),
        }
    }
}

/// Diagnoses a closed chamber from records of its pressure to `fit`, judged by records to
/// `validate`, if there are some; `watch` is told what is being done. Beside the diagnosis these
/// records, or without any those to fit, without a leak and with the one that was found.
///
/// # Errors
/// A record that is no leak-down.
pub fn leak_down(
    fit: &[Record],
    validate: &[Record],
    options: &Options,
    watch: Watch,
) -> Result<(Diagnosis, Vec<[Record; 2]>), BadInput> {
    let mut clock = Clock::new();
    watch(Step::Stage("data and noise", 0));
    let model = Chamber::new(fit, validate, &options.without)?;
    clock.lap("data and noise");
    let engine = Engine::new(&model);
    let selection = select(&engine, options.costs, watch)
        .ok_or_else(|| fit[0].bad(PRESSURE_PA, "finite pressures"))?;
    // Nothing but a leak empties a closed chamber, also where the decay has another shape.
    let leaks = probability(&selection.posterior, |set| set.effects.contains(&LEAK));
    let leak = (leaks >= options.costs.threshold())
        .then(|| engine.estimated(&engine.hypothesis(&[0])?))
        .flatten();
    let is_left = probability(&selection.posterior, |set| set.unknown != 0) >= PROBABLE;
    let verdict = match (&leak, is_left) {
        (None, false) => Verdict::Consistent,
        (None, true) => Verdict::Unexplained,
        (Some(_), false) => Verdict::Explained,
        (Some(_), true) => Verdict::Partial,
    };
    clock.lap("effects");
    let taken = leak.as_ref().unwrap_or(&selection.null);
    let effects = leak.iter().filter_map(|leak| {
        let time_constant = time_constant(&engine, leak, verdict);
        named(time_constant, leaks, selection.gain_nats(LEAK))
    });
    let effects = effects.collect();
    let shown = if validate.is_empty() { fit } else { validate };
    let free_runs = free_runs(&model, shown, taken);
    let blocks = blocks(&model, &selection.null, taken);
    let diagnosis = Diagnosis {
        schema: 2,
        verdict,
        next_experiment: next_experiment(verdict).into(),
        warnings: other_decays(&model, verdict),
        effects,
        gap: gaps(&model, validate, &free_runs),
        remaining: Remaining {
            places: is_left.then_some(GAS).into_iter().collect(),
            when: if is_left {
                when(&blocks[0].profiles[1])
            } else {
                String::new()
            },
        },
        calibrated: Vec::new(),
        blocks,
        formula: None,
        hypotheses: hypotheses(&selection, |unknown| match unknown {
            0 => Vec::new(),
            _ => vec![GAS],
        }),
        stages: clock.stages,
    };
    Ok((diagnosis, free_runs))
}

/// What would tell more.
fn next_experiment(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Consistent => {
            "None: the chamber is tight as far as these records tell. A longer one tells smaller \
             leaks."
        }
        Verdict::Explained => {
            "None: the decay is an exponential. A longer record narrows its time constant."
        }
        Verdict::Partial | Verdict::Unexplained => {
            "Wait after filling until the air has the room's temperature, at a constant length, \
             and begin at two pressures: a leak falls with the pressure, heat does not."
        }
    }
}

fn named(
    time_constant: (&'static str, Estimate),
    probability: f64,
    gain_nats: Option<f64>,
) -> Option<Named> {
    Some(Named {
        name: LEAK,
        form: EXPONENTIAL,
        place: GAS,
        parameters: [time_constant].into(),
        shape: None,
        probability,
        alternatives: Vec::new(),
        evidence: Evidence {
            gain_nats,
            signature: Catalogue::standard().find(LEAK)?.signature,
            source: "Laminar leak of a constant volume at constant temperature.",
            leaves_out: "heat of the gas, chambers that shrink",
        },
    })
}

/// The time constant of a leak, and its key. Its interval is that of the fit together with that
/// beside what is left in time, and with the time constants of parts of the records if the decay is
/// no exponential.
fn time_constant(
    engine: &Engine<Chamber>,
    leak: &Hypothesis,
    verdict: Verdict,
) -> (&'static str, Estimate) {
    let parameter = &engine.model.candidates[0].parameters[0];
    let value = Chamber::time_constant_s(&leak.fit.effects);
    let of_fit = engine.intervals(leak).map(|all| all[0][0]);
    let beside_unknown = engine.intervals_beside_unknown(leak).map(|all| all[0][0]);
    let fitted = engine.model.decays[..engine.model.fitted].iter();
    let of_parts = fitted.filter(|_| verdict == Verdict::Partial);
    let of_parts = of_parts.flat_map(Decay::local);
    let of_parts = of_parts.filter_map(|(s, _)| (s > 0.0).then_some([s; 2]));
    let intervals = [of_fit, beside_unknown].into_iter().flatten();
    let ci95 = intervals
        .chain(of_parts)
        .fold([value; 2], |[low, high], other| {
            [low.min(other[0]), high.max(other[1])]
        });
    let unit = parameter.unit;
    (parameter.name, Estimate { value, ci95, unit })
}

/// Each of the last records, without a leak and with the one that was found, from what was measured
/// at its beginning.
fn free_runs(model: &Chamber, last: &[Record], taken: &Hypothesis) -> Vec<[Record; 2]> {
    let decays = model.decays[model.decays.len() - last.len()..].iter();
    let run = |(record, decay): (&Record, &Decay)| {
        let begin_s = decay.time_s[0];
        let first = decay.time_s.iter().take_while(|s| **s <= begin_s + 1.0);
        let first_pa = mean(&decay.pressure_pa[..first.count()]);
        [f64::INFINITY, Chamber::time_constant_s(&taken.fit.effects)].map(|time_constant_s| {
            let mut run = Record::new(record.time_s().to_vec());
            let shares = shares(record.time_s(), begin_s, time_constant_s);
            let pressure_pa = shares.map(|share| first_pa * share);
            run.set(PRESSURE_PA, pressure_pa.collect());
            run
        })
    };
    last.iter().zip(decays).map(run).collect()
}

fn gaps(
    model: &Chamber,
    validate: &[Record],
    free_runs: &[[Record; 2]],
) -> Vec<(&'static str, GapOf)> {
    let which = muscle_plant::simulation::Simulated {
        pressure: true,
        motion: false,
    };
    let (mut squares, mut samples) = ([0.0; 2], 0.0);
    for (record, runs) in validate.iter().zip(free_runs) {
        for (place, run) in runs.iter().enumerate() {
            for gap in gap::gaps(record, run, which) {
                squares[place] += gap.samples as f64 * gap.rms * gap.rms;
                samples += 0.5 * gap.samples as f64;
            }
        }
    }
    if samples == 0.0 {
        return Vec::new();
    }
    let [before, after] = squares.map(|square: f64| (square / samples).sqrt());
    vec![(PRESSURE_PA, GapOf::new([before, after, model.noise_pa]))]
}

/// Says of each record that was fitted how its time constant changes, if the decay is no
/// exponential.
fn other_decays(model: &Chamber, verdict: Verdict) -> Vec<String> {
    if !matches!(verdict, Verdict::Partial | Verdict::Unexplained) {
        return Vec::new();
    }
    let fitted = model.decays[..model.fitted].iter().enumerate();
    let told = fitted.map(|(number, decay)| {
        let parts = decay.local().map(|(time_constant_s, mean_pa)| {
            let pressure = quantity(mean_pa, "Pa");
            if time_constant_s > 0.0 {
                format!("{} at {pressure}", quantity(time_constant_s, "s"))
            } else {
                format!("none at {pressure}, where it rises")
            }
        });
        let parts: Vec<String> = parts.collect();
        format!(
            "record {}: the time constants of its thirds are {}; an exponential has one",
            number + 1,
            parts.join(", ")
        )
    });
    told.collect()
}
