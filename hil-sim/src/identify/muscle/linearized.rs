//! The rig linearized about what was measured: residuals of the nominal rig, and how nominal
//! values, zeros of sensors and effects change them. From these follow probabilities of effects
//! whose law is free (see [`model_discrepancy::evidence`]).
//!
//! The space of residuals that an effect can cause is found from examples: the effect in each of
//! its forms with parameters over their usual range, and the same modulated by pressure and
//! contraction.

use super::force::{Force, Forces};
use super::observed_gas::ObservedGas;
use super::prepared::Prepared;
use super::residuals::{balances_and_masses, force_residuals, measured_n};
use super::{FORCE, GAS, MuscleModel};
use crate::record::{CONTRACTION, FORCE_N, PRESSURE_PA};
use crate::rig::Rig;
use model_discrepancy::evidence::{Evidence, Hypothesis};
use model_discrepancy::form_fit::{Projected, fitted_places};
use model_discrepancy::rows::{Column, Rows};
use model_discrepancy::signature::{EffectTraits, Signature};
use muscle_plant::effects::{Effect, EffectKind, Form, Parameter};
use muscle_plant::nominal::Load;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use rayon::prelude::*;

/// Examples of each form.
const EXAMPLES: usize = 6;
/// Distance of the examples about fitted parameters, in usual ranges.
const ABOUT: f64 = 0.05;
/// Effects of the gas beside which the signatures of the others are made anew.
const BESIDE: usize = 2;
/// The process while a form is fitted \[base, s\].
const FIT_PROCESS: [f64; 2] = [4.0, 0.1];
/// Factor between the typical value of a parameter and the ends of its usual range.
const USUAL_FACTOR: f64 = 5.0;
/// Distance of the ends from it for a parameter that is neither a size nor a scale, as a share of
/// the whole range; not more than the typical value.
const USUAL_SHARE: f64 = 0.3;
/// Change of an effect from the least pressure or contraction to the largest, over its size.
const MODULATION: f64 = 1.4;
/// Step of a nominal value in the difference quotient, in standard deviations.
const STEP: f64 = 0.3;
/// The rig is linearized about the nominal values that fit, if they are not farther than this from
/// the given ones \[standard deviations\]: an effect may pull them farther.
const DEVIATIONS_MAX: f64 = 2.0;
/// Nor by more than this share of the given value.
const SHARE_MAX: f64 = 0.5;
/// The balance of a weight is not compared where friction may take up more than this share of the
/// noise.
const SLACK_MAX: f64 = 0.5;
/// What the nominal model of a sound rig may leave: a share of the sensor's noise, and errors of
/// the interpolation between samples \[Pa\], \[N\], and as a share of the weight.
const BASE_NOISES: f64 = 0.3;
const BASE_PA: f64 = 10.0;
const BASE_N: f64 = 0.1;
const BASE_SHARE: f64 = 2.5e-3;

/// A rig linearized.
struct Linearized {
    rig: Rig,
    gas: Vec<Option<ObservedGas>>,
    /// Residuals by block, record and row.
    residuals: Vec<Vec<Vec<f64>>>,
    /// The rows that are compared, by block and record.
    kept: Vec<Vec<Vec<usize>>>,
    blocks: Vec<Rows>,
    /// Columns of nominal values and of zeros.
    common: Vec<Column>,
}

/// The signature of an effect, and the effect itself where its parameters were fitted.
type Made = (Signature, Option<Effect>);

/// A point of a low-discrepancy sequence in the unit cube (Roberts 2018: multiples of powers of the
/// root of x^(d+1) = x + 1).
fn point(number: usize, dimensions: usize) -> impl Iterator<Item = f64> {
    let mut root = 2.0_f64;
    for _ in 0..50 {
        root = (1.0 + root).powf((dimensions as f64 + 1.0).recip());
    }
    (0..dimensions).scan(1.0, move |power, _| {
        *power /= root;
        Some((0.5 + (number as f64 + 1.0) * *power).fract())
    })
}

/// The value of a parameter at a place from 0 to 1 in its usual range.
fn usual(parameter: &Parameter, place: f64) -> f64 {
    let Parameter {
        min, max, typical, ..
    } = *parameter;
    let is_size = parameter.neutral.is_some() && typical != 0.0;
    let value = if parameter.log || is_size {
        typical * USUAL_FACTOR.powf(2.0 * place - 1.0)
    } else {
        let reach = USUAL_SHARE * (max - min);
        let reach = if typical == 0.0 {
            reach
        } else {
            reach.min(typical.abs())
        };
        typical + reach * (2.0 * place - 1.0)
    };
    value.clamp(min, max)
}

/// The effect with its parameters at some places in their usual ranges.
fn effect_at(kind: &'static EffectKind, form: &'static Form, places: &[f64]) -> Effect {
    let values = form.parameters.iter().zip(places);
    let values = values.map(|(parameter, place)| usual(parameter, *place));
    let values = values.collect();
    Effect { kind, form, values }
}

/// Places of the parameters of a form that cover their usual ranges.
fn usual_places(form: &Form) -> Vec<Vec<f64>> {
    let dimensions = form.parameters.len();
    (0..EXAMPLES)
        .map(|number| point(number, dimensions).collect())
        .collect()
}

/// `places`, and with each parameter moved up and down.
fn places_about(places: &[f64]) -> Vec<Vec<f64>> {
    let mut about = vec![places.to_vec()];
    for number in 0..places.len() {
        for step in [-ABOUT, ABOUT] {
            let mut moved = places.to_vec();
            moved[number] += step;
            about.push(moved);
        }
    }
    about
}

/// Whether the effect occurs with either sign.
fn is_signed(kind: &EffectKind) -> bool {
    let has_sign = |p: &Parameter| p.neutral.is_some_and(|none| p.min < none && none < p.max);
    let mut forms = kind.forms.iter();
    forms.all(|form| form.parameters.iter().any(has_sign))
}

impl MuscleModel {
    /// Probabilities of sets of effects, the most probable first, each effect named; `None` if the
    /// nominal rig cannot be simulated.
    pub fn hypotheses(&self) -> Option<Vec<(Vec<&'static str>, Hypothesis)>> {
        let nominals = self.nominal_blocks.len();
        let given = self.linearized(&vec![0.0; nominals])?;
        let alone = Evidence::new(&given.blocks, &given.common, &[]);
        // With a process in every block, so that a missing effect pulls nominal values little.
        let mut deviations = alone.solve(&[], !0)?.weights;
        deviations.truncate(nominals);
        for (deviation, tolerance) in deviations.iter_mut().zip(&self.rig.tolerances) {
            let most = DEVIATIONS_MAX.min(SHARE_MAX / tolerance.relative_sigma);
            *deviation = deviation.clamp(-most, most);
        }
        let linearized = self.linearized(&deviations)?;
        let modulations = [PRESSURE_PA, CONTRACTION].map(|name| self.modulation(&linearized, name));
        let mut kinds: Vec<&'static EffectKind> = Vec::new();
        for candidate in &self.candidates {
            let kind = self.rig.catalogue.find(candidate.effect)?;
            if kinds.iter().all(|own| own.name != kind.name) {
                kinds.push(kind);
            }
        }
        let alone: Vec<Made> = kinds
            .par_iter()
            .filter_map(|kind| self.made(&linearized, &modulations, kind, None))
            .collect();
        let evidence = |all: &[Made]| {
            let signatures: Vec<Signature> = all.iter().map(|own| own.0.clone()).collect();
            Evidence::new(&linearized.blocks, &linearized.common, &signatures)
        };
        let all = evidence(&alone);
        let mut leading: Vec<(f64, usize)> = alone
            .iter()
            .enumerate()
            .filter(|(_, own)| own.1.is_some())
            .filter_map(|(number, _)| Some((all.solve(&[number], !0)?.log_evidence, number)))
            .collect();
        leading.sort_by(|a, b| b.0.total_cmp(&a.0));
        let leading = leading.into_iter().take(BESIDE);
        let beside: Vec<(usize, Evidence)> = leading
            .filter_map(|(_, number)| {
                let first = alone[number].1.as_ref()?;
                let made = self.made_beside(&linearized, &modulations, first, &alone)?;
                Some((number, evidence(&made)))
            })
            .collect();
        let posterior = all.posterior(&beside)?.into_iter().map(|hypothesis| {
            let effects = hypothesis.effects.iter();
            let names = effects.map(|effect| alone[*effect].0.of.effect);
            (names.collect(), hypothesis)
        });
        Some(posterior.collect())
    }

    /// The blocks that an effect changes; `None` if no record can show it.
    fn touched(&self, kind: &EffectKind) -> Option<&[usize]> {
        let mut candidates = self.candidates.iter();
        let candidate = candidates.find(|own| own.effect == kind.name)?;
        Some(&candidate.blocks)
    }

    /// The signature of an effect, beside `first` with its column; and the effect as it explains
    /// the rows best, if it works on the gas alone.
    fn made(
        &self,
        linearized: &Linearized,
        modulations: &[Column],
        kind: &'static EffectKind,
        first: Option<(&Effect, &Column)>,
    ) -> Option<Made> {
        let own = self.form_in_gas(linearized, first, kind);
        let fitted = own.as_ref().map(|(form, places)| (*form, &places[..]));
        let signature = self.signature(linearized, modulations, kind, first, fitted)?;
        let effect = own.map(|(form, places)| effect_at(kind, form, &places));
        Some((signature, effect))
    }

    /// The signatures of effects as they are beside `first`: two effects of the gas do not add up,
    /// as the second changes what the first left.
    fn made_beside(
        &self,
        linearized: &Linearized,
        modulations: &[Column],
        first: &Effect,
        alone: &[Made],
    ) -> Option<Vec<Made>> {
        let mut rig = linearized.rig.clone();
        rig.effects.push(first.clone());
        let touched = self.touched(first.kind)?;
        let column = self.change(linearized, &Column::new(), &rig, touched)?;
        let beside = |own: &Made| {
            let other = own.1.as_ref().map(|effect| effect.kind);
            let other = other.filter(|kind| kind.name != first.kind.name);
            let made = other
                .and_then(|kind| self.made(linearized, modulations, kind, Some((first, &column))));
            made.unwrap_or_else(|| own.clone())
        };
        Some(alone.par_iter().map(beside).collect())
    }

    /// The form of an effect of the gas alone that explains it best, beside `first` with its
    /// column, and the places of its parameters; `None` for other effects.
    fn form_in_gas(
        &self,
        linearized: &Linearized,
        first: Option<(&Effect, &Column)>,
        kind: &'static EffectKind,
    ) -> Option<(&'static Form, Vec<f64>)> {
        let gas = self.blocks.iter().position(|block| *block == GAS)?;
        if self.touched(kind)? != [gas] {
            return None;
        }
        let mut rows = linearized.blocks[gas].clone();
        let none = Column::new();
        let column = first.map_or(&none, |(_, column)| column);
        let changes = column.get(gas).into_iter().flatten();
        for (residual, change) in rows.residual.iter_mut().zip(changes) {
            *residual -= change;
        }
        let common: Vec<&[f64]> = linearized.common.iter().map(|own| &own[gas][..]).collect();
        let common: Vec<&[f64]> = common.into_iter().filter(|own| !own.is_empty()).collect();
        let [amplitude, time_constant_s] = FIT_PROCESS;
        let projected = Projected::new(&rows, &common, amplitude, time_constant_s);
        let fits = kind.forms.iter().filter_map(|form| {
            let simulated = |places: &[f64]| {
                let mut rig = linearized.rig.clone();
                rig.effects.extend(first.map(|(effect, _)| effect.clone()));
                rig.effects.push(effect_at(kind, form, places));
                let mut change = self.change(linearized, column, &rig, &[gas])?;
                Some(std::mem::take(&mut change[gas]))
            };
            let (places, cost) = fitted_places(&projected, &usual_places(form), simulated)?;
            Some((form, places, cost))
        });
        let best = fits.min_by(|a, b| a.2.total_cmp(&b.2))?;
        Some((best.0, best.1))
    }

    /// The signature of an effect, beside `first` with its column, of examples about `fitted`
    /// parameters or of all forms; `None` if it does not show.
    fn signature(
        &self,
        linearized: &Linearized,
        modulations: &[Column],
        kind: &'static EffectKind,
        first: Option<(&Effect, &Column)>,
        fitted: Option<(&'static Form, &[f64])>,
    ) -> Option<Signature> {
        let touched = self.touched(kind)?;
        let effects: Vec<Effect> = match fitted {
            Some((form, places)) => places_about(places)
                .iter()
                .map(|places| effect_at(kind, form, places))
                .collect(),
            None => {
                let forms = kind.forms.iter();
                let all =
                    forms.flat_map(|form| usual_places(form).into_iter().map(move |p| (form, p)));
                all.map(|(form, places)| effect_at(kind, form, &places))
                    .collect()
            }
        };
        let none = Column::new();
        let before = first.map_or(&none, |(_, column)| column);
        let plain = effects.into_iter().filter_map(|effect| {
            let mut rig = linearized.rig.clone();
            rig.effects.extend(first.map(|(effect, _)| effect.clone()));
            rig.effects.push(effect);
            self.change(linearized, before, &rig, touched)
        });
        let mut columns: Vec<Column> = plain.collect();
        let plain = columns.len();
        // An effect whose name determines its law has no modulation.
        let exact = kind.discrepancy_ratio == 0.0;
        for modulation in modulations.iter().filter(|_| !exact) {
            for number in 0..plain {
                let pairs = columns[number].iter().zip(modulation);
                let product = |(values, by): (&Vec<f64>, &Vec<f64>)| {
                    values
                        .iter()
                        .zip(by)
                        .map(|(value, by)| value * by)
                        .collect()
                };
                columns.push(pairs.map(product).collect());
            }
        }
        let of = EffectTraits {
            effect: kind.name,
            signed: is_signed(kind),
            exact,
        };
        let mut signature = Signature::new(of, &columns, plain, &linearized.blocks)?;
        if let Some((form, _)) = fitted {
            // Each form and each place was as likely before.
            let parameters = form.parameters.len() as f64;
            signature.log_prior = parameters * (2.0 * ABOUT).ln() - (kind.forms.len() as f64).ln();
        }
        Some(signature)
    }

    /// The rig linearized about nominal values that are off by these standard deviations; its
    /// residuals are those of the given values.
    fn linearized(&self, deviations: &[f64]) -> Option<Linearized> {
        let rig = self.fitted(deviations, []);
        let gas: Vec<Option<ObservedGas>> = self
            .records
            .par_iter()
            .map(|record| ObservedGas::new(record, &rig))
            .collect();
        let blocks = 0..self.blocks.len();
        let residuals: Vec<Vec<Vec<f64>>> = blocks
            .clone()
            .map(|block| self.residuals_of(block, &rig, &gas))
            .collect::<Option<_>>()?;
        let kept: Vec<Vec<Vec<usize>>> = blocks
            .clone()
            .map(|block| self.kept_rows(block, &rig))
            .collect::<Option<_>>()?;
        let rows = blocks.map(|block| self.rows_of(block, &residuals[block], &kept[block]));
        let mut linearized = Linearized {
            blocks: rows.collect(),
            common: Vec::new(),
            rig,
            gas,
            residuals,
            kept,
        };
        let columns = self.nominal_blocks.par_iter().enumerate();
        let columns = columns.map(|(number, touched)| {
            let mut moved = deviations.to_vec();
            moved[number] += STEP;
            let none = Column::new();
            let mut column = self.change(&linearized, &none, &self.fitted(&moved, []), touched)?;
            column.iter_mut().flatten().for_each(|value| *value /= STEP);
            Some(column)
        });
        linearized.common = columns.collect::<Option<_>>()?;
        for (column, deviation) in linearized.common.iter().zip(deviations) {
            for (rows, values) in linearized.blocks.iter_mut().zip(column) {
                for (residual, value) in rows.residual.iter_mut().zip(values) {
                    *residual += deviation * value;
                }
            }
        }
        let zeros = self.zeros(&linearized);
        linearized.common.extend(zeros);
        Some(linearized)
    }

    /// How `rig` changes the compared rows of the blocks that it touches, against the linearized
    /// one with the changes `before`; `None` without a solution.
    fn change(
        &self,
        from: &Linearized,
        before: &Column,
        rig: &Rig,
        touched: &[usize],
    ) -> Option<Column> {
        let mut column = vec![Vec::new(); self.blocks.len()];
        for block in touched {
            let changes = &mut column[*block];
            for (number, rows) in from.kept[*block].iter().enumerate() {
                let record = &self.records[number];
                if self.blocks[*block] == GAS {
                    let changed_pa = from.gas[number].as_ref()?.change_pa(record, rig)?;
                    let rows = rows.iter().map(|row| record.gas_rows[*row]);
                    changes.extend(rows.map(|row| changed_pa[row] / record.noise.pressure_pa));
                } else {
                    let moved = self.residuals_in(record, *block, rig)?;
                    let own = &from.residuals[*block][number];
                    changes.extend(rows.iter().map(|row| moved[*row] - own[*row]));
                }
            }
        }
        for (changes, before) in column.iter_mut().zip(before) {
            for (change, before) in changes.iter_mut().zip(before) {
                *change -= before;
            }
        }
        let mut changes = column.iter().flatten();
        changes.all(|change| change.is_finite()).then_some(column)
    }

    /// Simulated less measured in each row of a block, in units of the noise, record by record.
    fn residuals_of(
        &self,
        block: usize,
        rig: &Rig,
        gas: &[Option<ObservedGas>],
    ) -> Option<Vec<Vec<f64>>> {
        let of = |(record, gas): (&Prepared, &Option<ObservedGas>)| {
            if self.blocks[block] != GAS {
                return self.residuals_in(record, block, rig);
            }
            let residuals_pa = gas.as_ref()?.residuals_pa();
            let rows = record.gas_rows.iter();
            Some(
                rows.map(|row| residuals_pa[*row] / record.noise.pressure_pa)
                    .collect(),
            )
        };
        let residuals: Vec<Vec<f64>> = self
            .records
            .iter()
            .zip(gas)
            .map(of)
            .collect::<Option<_>>()?;
        let mut all = residuals.iter().flatten();
        all.all(|residual| residual.is_finite())
            .then_some(residuals)
    }

    /// The same of force or load in one record.
    fn residuals_in(&self, record: &Prepared, block: usize, rig: &Rig) -> Option<Vec<f64>> {
        if self.blocks[block] == FORCE {
            let ways = record.ways(rig);
            let forces_n = Forces::new(rig, &ways, Force::Read)?.settled_n()?;
            return Some(force_residuals(record, &forces_n)?.values);
        }
        let (values, _): (Vec<f64>, Vec<f64>) = self.balances_of(record, rig)?.into_iter().unzip();
        Some(values)
    }

    /// Balances of the load and readings at its stop, each with what friction may take up.
    fn balances_of(&self, record: &Prepared, rig: &Rig) -> Option<Vec<(f64, f64)>> {
        let Load::Weight(weight) = self.rig.nominal.load else {
            return None;
        };
        let with_force = self.blocks.contains(&FORCE);
        let forces_n = if with_force {
            measured_n(record, rig)?
        } else {
            let ways = record.ways(rig);
            Forces::new(rig, &ways, Force::True)?.settled_n()?
        };
        let balances = balances_and_masses(record, rig, &forces_n)?.into_iter();
        // Without a measured force all forces may be small together: as an acceleration the balance
        // has a scale.
        let scale = |mass_kg: f64| {
            if with_force {
                1.0
            } else {
                weight.mass_kg / mass_kg
            }
        };
        let balances = balances.map(|(value, slack, mass_kg)| (value * scale(mass_kg), slack));
        let mut still = rig.clone();
        still.nominal.load = Load::Prescribed;
        let stops = record.stop_residuals(&still)?;
        Some(
            balances
                .chain(stops.values.into_iter().zip(stops.slack))
                .collect(),
        )
    }

    /// Rows of a block that are compared, record by record.
    fn kept_rows(&self, block: usize, rig: &Rig) -> Option<Vec<Vec<usize>>> {
        let of = |record: &Prepared| -> Option<Vec<usize>> {
            Some(match self.blocks[block] {
                GAS => {
                    let read_pa = record.gas.as_ref()?.column(PRESSURE_PA)?;
                    let clips =
                        |row: &usize| record.pressure_span.clips(read_pa[record.gas_rows[*row]]);
                    (0..record.gas_rows.len())
                        .filter(|row| !clips(row))
                        .collect()
                }
                FORCE => (0..record.force_rows.len()).collect(),
                _ => {
                    let balances = self.balances_of(record, rig)?;
                    let moves = |row: &usize| balances[*row].1 <= SLACK_MAX;
                    (0..balances.len()).filter(moves).collect()
                }
            })
        };
        self.records.iter().map(of).collect()
    }

    /// The row of the record in which a row of a block is.
    fn record_row(&self, record: &Prepared, block: usize, row: usize) -> usize {
        match self.blocks[block] {
            GAS => record.gas_rows[row],
            FORCE => record.force_rows[row],
            _ => match record.places.get(row) {
                Some(place) => place.kernel.middle(),
                None => record.stops[row - record.places.len()],
            },
        }
    }

    fn rows_of(&self, block: usize, residuals: &[Vec<f64>], kept: &[Vec<usize>]) -> Rows {
        let mut rows = Rows::default();
        let weight_n = match self.rig.nominal.load {
            Load::Weight(weight) => weight.mass_kg * GRAVITY_M_PER_S2,
            Load::Prescribed => 0.0,
        };
        for ((record, residuals), kept) in self.records.iter().zip(residuals).zip(kept) {
            let pressure_pa = record.noise.pressure_pa;
            let base_n = (BASE_NOISES * record.noise.force_n)
                .hypot(self.repeatability_n.unwrap_or(0.0))
                .hypot(BASE_N)
                .hypot(BASE_SHARE * weight_n);
            let mut last_s = f64::INFINITY;
            for row in kept {
                let (base, in_process) = match self.blocks[block] {
                    GAS => (BASE_NOISES.hypot(BASE_PA / pressure_pa), true),
                    FORCE => (base_n * record.per_force_noise[*row], true),
                    _ => match record.places.get(*row) {
                        Some(place) => (base_n * place.per_noise, true),
                        // A reading of the encoder, not a force.
                        None => (1.0, false),
                    },
                };
                let at = self.record_row(record, block, *row);
                let time_s = record.measured.time_s()[at];
                // Readings at the stop come after all balances.
                rows.begins.push(time_s <= last_s);
                last_s = time_s;
                rows.time_s.push(time_s);
                rows.residual.push(-residuals[*row]);
                rows.base.push(base);
                rows.in_process.push(in_process);
            }
        }
        rows
    }

    /// A signal in the compared rows, from −½ to ½ times the modulation over its range.
    fn modulation(&self, linearized: &Linearized, name: &str) -> Column {
        let columns = self
            .records
            .iter()
            .filter_map(|record| record.measured.column(name));
        let present = columns.flatten().filter(|value| !value.is_nan());
        let ends = (f64::INFINITY, f64::NEG_INFINITY);
        let (least, most) = present.fold(ends, |(least, most), v| (v.min(least), v.max(most)));
        let middle = 0.5 * (least + most);
        let of = |block: usize| {
            let mut values = Vec::new();
            for (record, rows) in self.records.iter().zip(&linearized.kept[block]) {
                let column = record.measured.column(name).unwrap_or_default();
                values.extend(rows.iter().map(|row| {
                    let value = column.get(self.record_row(record, block, *row)).copied();
                    let value = value.filter(|value| !value.is_nan()).unwrap_or(middle);
                    MODULATION * (value - middle) / (most - least).max(f64::MIN_POSITIVE)
                }));
            }
            values
        };
        (0..self.blocks.len()).map(of).collect()
    }

    /// The zero of the pressure sensor, and of the force sensor if there is one, in each record:
    /// off by the sensor's noise, which whoever sets it sees, and by what a bench does not repeat.
    fn zeros(&self, linearized: &Linearized) -> Vec<Column> {
        let sensors = if self.blocks.contains(&FORCE) {
            &[PRESSURE_PA, FORCE_N][..]
        } else {
            &[PRESSURE_PA]
        };
        let of = |number: usize, sensor: &str| -> Column {
            let blocks = linearized.kept.iter().enumerate();
            let column = blocks.map(|(block, kept)| {
                let values = kept.iter().enumerate().flat_map(|(other, rows)| {
                    if other == number {
                        self.zero(linearized, block, number, sensor)
                    } else {
                        vec![0.0; rows.len()]
                    }
                });
                values.collect()
            });
            column.collect()
        };
        let records = 0..self.records.len();
        let columns = records.flat_map(|number| sensors.iter().map(move |sensor| (number, sensor)));
        columns.map(|(number, sensor)| of(number, sensor)).collect()
    }

    /// How the residuals of a block in a record change if a sensor reads too much by its zero.
    fn zero(&self, linearized: &Linearized, block: usize, number: usize, sensor: &str) -> Vec<f64> {
        let (record, rows) = (&self.records[number], linearized.kept[block][number].iter());
        let with_force = self.blocks.contains(&FORCE);
        let contraction = record.measured.column(CONTRACTION).unwrap_or_default();
        let force_n = |row: usize| match sensor {
            PRESSURE_PA => {
                let at = contraction[self.record_row(record, block, row)];
                let per_pressure_m2 = self.rig.nominal.muscle.force_per_pressure_m2(at);
                per_pressure_m2 * record.noise.pressure_pa
            }
            _ => record
                .noise
                .force_n
                .hypot(self.repeatability_n.unwrap_or(0.0)),
        };
        let is_pressure = sensor == PRESSURE_PA;
        let shares = linearized.gas[number].as_ref().filter(|_| is_pressure);
        let shares = shares.map(ObservedGas::zero_shares).unwrap_or_default();
        let change = |row: &usize| match self.blocks[block] {
            GAS => shares.get(record.gas_rows[*row]).copied().unwrap_or(0.0),
            FORCE if is_pressure => -force_n(*row) * record.per_force_noise[*row],
            FORCE => force_n(*row) * record.per_force_noise[*row],
            // The measured force works on the load, whatever the pressure reads.
            _ if is_pressure && with_force => 0.0,
            _ => {
                let place = record.places.get(*row);
                place.map_or(0.0, |place| -force_n(*row) * place.per_noise)
            }
        };
        rows.map(change).collect()
    }
}
