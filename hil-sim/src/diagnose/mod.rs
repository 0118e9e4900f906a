//! Finds where simulation and measurement disagree, and which effect is missing.

pub mod engine;
pub mod muscle;

use crate::error::BadInput;
use crate::record::Record;
use crate::rig::Rig;
use engine::{Engine, Hypothesis, Model};
use muscle::MuscleModel;
use rayon::prelude::*;

/// Prints how each hypothesis fares.
///
/// # Errors
/// Rig and records do not fit.
pub fn explore(rig: &Rig, fit: &[Record], validate: &[Record], without: &[String]) -> Result<(), BadInput> {
    let model = MuscleModel::new(rig, fit, validate, without)?;
    let engine = Engine::new(&model);
    let start = std::time::Instant::now();
    let Some(null) = engine.hypothesis(&[]) else {
        println!("no null");
        return Ok(());
    };
    let all = model.candidates();
    let show = |h: &Hypothesis| {
        let names: Vec<String> = h.fit.effects.iter().map(|(c, v)| {
            let v: Vec<String> = v.iter().map(|v| format!("{v:.2e}")).collect();
            format!("{}/{}[{}]", all[*c].effect, all[*c].form, v.join(","))
        }).collect();
        let parts: Vec<String> = h.fit.parts.iter().map(|p| {
            format!("{} {:.2}/{:.2}", &model.blocks()[p.block][..1], 2.0*p.fitted.cost/p.fitted.count as f64, 2.0*p.predicted.cost/p.predicted.count as f64)
        }).collect();
        println!("  {:8.0} {:8.0} p{:6.1} {} {}", h.cost(), h.predicted(), h.fit.prior, parts.join(" "), names.join(" + "));
    };
    show(&null);
    let score = |h: &Hypothesis| h.cost() + h.predicted();
    let fits = |list: &[Vec<usize>]| -> Vec<Hypothesis> {
        let mut tried: Vec<_> = list.par_iter().filter_map(|candidates| {
            let begin = std::time::Instant::now();
            let h = engine.hypothesis(candidates);
            let names: Vec<String> = candidates.iter().map(|c| format!("{}/{}", all[*c].effect, all[*c].form)).collect();
            if std::env::var("TIMES").is_ok() { println!("    T {:?} {}", begin.elapsed(), names.join("+")); }
            h
        }).collect();
        tried.sort_by(|a, b| score(a).total_cmp(&score(b)));
        tried
    };
    let singles: Vec<Vec<usize>> = (0..all.len()).map(|c| vec![c]).collect();
    let mut promises: Vec<(usize, f64)> = engine.promises(&null).unwrap_or_default().into_iter().enumerate().collect();
    println!("promises {:?}", start.elapsed());
    promises.sort_by(|a, b| b.1.total_cmp(&a.1));
    let line: Vec<String> = promises.iter().take(8).map(|(c, p)| format!("{}/{} {p:.0}", all[*c].effect, all[*c].form)).collect();
    println!("   {}", line.join(", "));
    let singles = fits(&singles);
    println!("singles {:?}", start.elapsed());
    singles.iter().take(5).for_each(show);
    for h in &singles {
        let place = promises.iter().position(|(c, _)| *c == h.candidates[0]).unwrap_or(99);
        print!("{place} ");
    }
    println!();
    // Leaders: the best names over all, and over each block alone.
    let mut leaders: Vec<usize> = Vec::new();
    let add = |order: Vec<usize>, count: usize, leaders: &mut Vec<usize>| {
        let mut names: Vec<&str> = Vec::new();
        for c in order {
            if names.len() == count { break; }
            if !names.contains(&all[c].effect) {
                names.push(all[c].effect);
                if !leaders.contains(&c) { leaders.push(c); }
            }
        }
    };
    add(singles.iter().map(|h| h.candidates[0]).collect(), 3, &mut leaders);
    for part in &null.fit.parts {
        if 2.0 * part.fitted.cost < 1.5 * part.fitted.count as f64 { continue; }
        let touching: Vec<usize> = (0..all.len()).filter(|c| all[*c].blocks.contains(&part.block)).collect();
        let mut alone: Vec<(f64, usize)> = touching.par_iter().filter_map(|c| {
            let fit = engine.group(&[part.block], &[*c])?;
            Some((fit.prior + fit.parts[0].fitted.cost + fit.parts[0].predicted.cost, *c))
        }).collect();
        alone.sort_by(|a, b| a.0.total_cmp(&b.0));
        let line: Vec<String> = alone.iter().take(4).map(|(p, c)| format!("{}/{} {p:.0}", all[*c].effect, all[*c].form)).collect();
        println!("  alone {} {}", model.blocks()[part.block], line.join(", "));
        add(alone.iter().map(|a| a.1).collect(), 2, &mut leaders);
    }
    println!("alone {:?}", start.elapsed());
    let bases: Vec<Hypothesis> = leaders.iter().filter_map(|c| engine.hypothesis(&[*c])).collect();
    let mut pairs: Vec<Vec<usize>> = Vec::new();
    for base in &bases {
        let Some(promises) = engine.promises(base) else { continue };
        let mut order: Vec<usize> = (0..all.len()).collect();
        order.sort_by(|a, b| promises[*b].total_cmp(&promises[*a]));
        let mut second = Vec::new();
        order.retain(|c| *c != base.candidates[0]);
        add(order, 4, &mut second);
        pairs.extend(second.into_iter().map(|c| { let mut v = vec![base.candidates[0], c]; v.sort_unstable(); v }));
    }
    pairs.sort(); pairs.dedup();
    println!("screened {:?} {} pairs", start.elapsed(), pairs.len());
    fits(&pairs).iter().take(5).for_each(show);
    println!("pairs {:?}", start.elapsed());
    Ok(())
}
