//! `simulate` against an independent solution of the same equations (tests/reference).

use hil_sim::identify::simulate::simulate;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, Record};
use hil_sim::rig::Rig;
use muscle_plant::nominal::Load;
use muscle_plant::simulation::TOLERANCE;
use std::collections::BTreeSet;
use std::path::Path;

/// Largest difference that is allowed, relative to the range of the signal in the reference.
const RELATIVE: f64 = 1e-3;

/// Largest difference of two columns, relative to the range of `reference`'s.
fn relative_gap(reference: &Record, simulated: &Record, column: &str) -> f64 {
    let expected = reference.require(column).expect("the reference's column");
    let found = simulated.require(column).expect("the simulated column");
    assert_eq!(expected.len(), found.len());
    let (min, max) = expected
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), value| {
            (min.min(*value), max.max(*value))
        });
    let gaps = expected.iter().zip(found).map(|(a, b)| (a - b).abs());
    gaps.fold(0.0, f64::max) / (max - min)
}

fn check(case: &Path) {
    let rig = Rig::read(&case.join("rig.toml")).expect("a rig");
    let drive = Record::read(&case.join("drive.csv")).expect("a drive");
    let reference = Record::read(&case.join("expected.csv")).expect("a solution");
    let simulated = simulate(&rig, &drive, TOLERANCE).expect("simulated");
    let mut gaps = Vec::new();
    if rig.nominal.valve.is_some() && drive.column("pressure_ref_pa").is_some() {
        gaps.push((
            PRESSURE_PA,
            relative_gap(&reference, &simulated, PRESSURE_PA),
        ));
    }
    if matches!(rig.nominal.load, Load::Weight(_)) {
        gaps.push((
            CONTRACTION,
            relative_gap(&reference, &simulated, CONTRACTION),
        ));
    } else {
        gaps.push((FORCE_N, relative_gap(&reference, &simulated, FORCE_N)));
    }
    for (column, gap) in gaps {
        println!("{}: {column} within {gap:.1e} of its range", case.display());
        assert!(gap < RELATIVE, "{}: {column} {gap:.1e}", case.display());
    }
}

/// The cases that the README beside the solutions lists: the first column of its table.
fn listed(folder: &Path) -> Vec<String> {
    let readme = std::fs::read_to_string(folder.join("README.md")).expect("the README");
    let cells = readme.lines().filter_map(|line| line.strip_prefix("| "));
    let names = cells.filter_map(|cells| Some(cells.split_once(" |")?.0));
    names.skip(1).map(str::to_owned).collect()
}

#[test]
fn simulate_agrees_with_the_reference_solutions() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("reference");
    let mut cases: Vec<_> = std::fs::read_dir(&folder)
        .expect("the reference solutions")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.is_dir())
        .collect();
    cases.sort();
    let names = cases.iter().filter_map(|case| case.file_name()?.to_str());
    assert_eq!(
        names.collect::<BTreeSet<_>>(),
        listed(&folder).iter().map(String::as_str).collect()
    );
    cases.iter().for_each(|case| check(case));
}
