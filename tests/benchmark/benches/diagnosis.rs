//! How long a diagnosis takes: by stage on hidden effects, by the records' length, and the memory.
//!
//! `cargo bench --bench diagnosis` writes target/benchmark/diagnosis.json; `-- --quick` repeats
//! less and leaves out the longest records. It names effects, which no peer does.

use hil_sim::identify::diagnosis::{Diagnosis, Options, diagnose};
use hil_sim::identify::simulate::simulate;
use hil_sim::record::{CONTRACTION, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::Rig;
use rand_distr::{Distribution, Normal, Uniform};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;
use serde::Serialize;
use std::time::Instant;
use truth::Kind;

/// Seed of the cases with hidden effects.
const SEED: u64 = 3;
/// Lengths of both records of the second part \[s\]; the last is half an hour.
const LENGTHS_S: [u32; 4] = [40, 80, 160, 1800];

/// Median times of one diagnosis.
#[derive(Serialize)]
struct Timed {
    what: String,
    /// Of all records together \[s\].
    recorded_s: f64,
    spent_s: f64,
    /// Stage by stage \[s\].
    stages_s: Vec<(String, f64)>,
    verdict: String,
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn timed(what: &str, repeats: usize, rig: &Rig, fit: &[Record], validate: &[Record]) -> Timed {
    let once = || -> (f64, Diagnosis) {
        let start = Instant::now();
        let found =
            diagnose(rig, fit, validate, &Options::default(), &|_| ()).expect("a diagnosis");
        (start.elapsed().as_secs_f64(), found.diagnosis)
    };
    let runs: Vec<(f64, Diagnosis)> = (0..repeats).map(|_| once()).collect();
    let last = &runs[repeats - 1].1;
    let stages = last.stages.iter().enumerate().map(|(place, stage)| {
        let spent = runs.iter().map(|(_, run)| run.stages[place].spent_s);
        (stage.stage.clone(), median(spent.collect()))
    });
    let names: Vec<&str> = last.effects.iter().map(|effect| effect.name).collect();
    let of = |record: &Record| record.time_s().last().copied().unwrap_or_default();
    let timed = Timed {
        what: what.into(),
        recorded_s: fit.iter().chain(validate).map(of).sum(),
        spent_s: median(runs.iter().map(|(spent_s, _)| *spent_s).collect()),
        stages_s: stages.collect(),
        verdict: format!("{:?} {}", last.verdict, names.join(" + ")),
    };
    let stages = timed.stages_s.iter();
    let stages: Vec<String> = stages.map(|(name, s)| format!("{name} {s:.2}")).collect();
    let (recorded_s, spent_s) = (timed.recorded_s, timed.spent_s);
    let per_second = spent_s / recorded_s;
    println!("{what:24} {recorded_s:5.0} s recorded: {spent_s:6.2} s, {per_second:.4} s/s");
    println!("{:24} {}; {}", "", timed.verdict, stages.join(", "));
    timed
}

/// The first case of a kind.
fn hidden(kind: Kind, repeats: usize) -> Timed {
    let index = (0..).find(|index| truth::plan(SEED, *index).kind == kind);
    let case = truth::case(SEED, index.expect("a case"));
    let rig = Rig::parse("rig.toml", &case.rig_toml).expect("a rig");
    let records = |texts: &[String]| -> Vec<Record> {
        let parse = |text: &String| Record::parse("case.csv", text.as_bytes()).expect("a record");
        texts.iter().map(parse).collect()
    };
    let (fit, validate) = (records(&case.fit), records(&case.validate));
    timed(&format!("{kind:?}"), repeats, &rig, &fit, &validate)
}

/// A record of the reference rig with a leak, its reference new every 0.7 s.
fn leaking(length_s: u32, seed: u64) -> Record {
    let leak = "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 8e-9\n";
    let rig = Rig::parse("rig.toml", &format!("{}\n{leak}", Rig::REFERENCE_TOML)).expect("a rig");
    let mut random = Pcg64::seed_from_u64(seed);
    let rows = 100 * length_s as usize;
    let level = Uniform::new(2.6e5, 4.0e5).expect("a range");
    let levels_pa: Vec<f64> = level.sample_iter(&mut random).take(rows / 70 + 1).collect();
    let references: Vec<f64> = (0..rows).map(|row| levels_pa[row / 70]).collect();
    let mut record = Record::new((0..rows).map(|row| row as f64 * 0.01).collect());
    record.set(PRESSURE_REF_PA, references.clone());
    for (name, value) in [(PRESSURE_PA, 3e5), (CONTRACTION, 0.1)] {
        let first = |row| if row == 0 { value } else { f64::NAN };
        record.set(name, (0..rows).map(first).collect());
    }
    let mut simulated = simulate(&rig, &record, 1e-5).expect("a run");
    for (name, noise) in [(PRESSURE_PA, 250.0), (CONTRACTION, 3e-5)] {
        let normal = Normal::new(0.0, noise).expect("a spread");
        let clean = simulated.require(name).expect("a column").to_vec();
        let noisy = clean.iter().map(|value| value + normal.sample(&mut random));
        simulated.set(name, noisy.collect());
    }
    simulated.set(PRESSURE_REF_PA, references);
    simulated
}

/// Most memory that the process has held \[MB\], where the system tells.
fn memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kb: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kb / 1e3)
}

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let repeats = if quick { 1 } else { 3 };
    let kinds = [Kind::None, Kind::Single, Kind::Pair, Kind::Unlisted];
    let mut all: Vec<Timed> = kinds
        .into_iter()
        .map(|kind| hidden(kind, repeats))
        .collect();
    let memory = memory_mb();
    let lengths = if quick { &LENGTHS_S[..2] } else { &LENGTHS_S };
    for length_s in lengths {
        let what = format!("a leak, {length_s} s twice");
        let records = [1, 2].map(|seed| leaking(*length_s, seed));
        all.push(timed(
            &what,
            1,
            &Rig::reference(),
            &records[..1],
            &records[1..],
        ));
    }
    if let Some(memory) = memory {
        println!("at most {memory:.0} MB with records of 40 s");
    }
    let out = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/benchmark");
    let json = serde_json::to_string_pretty(&all).expect("JSON");
    std::fs::create_dir_all(&out).expect("a folder");
    hil_sim::output::write_atomically(&out.join("diagnosis.json"), json.as_bytes())
        .expect("written");
}
