//! The module `hil_sim._native`: what the commands of `hil-sim` compute, from Python.
//!
//! Results are the commands' JSON as text, which `hil_sim/__init__.py` makes objects of. Work runs
//! in a thread of its own, while Python's thread waits for it, looks for Ctrl-C and tells progress.

mod input;
mod work;

use hil_sim::bench::test_signal::{CONTRACTION_MAX, Limits, Part, test_signal};
use hil_sim::design::report::{Question, design_report};
use hil_sim::effect_page::KindSummary;
use hil_sim::error::{BadInput, one_of};
use hil_sim::identify::diagnosis::Options;
use hil_sim::identify::files::{Files, diagnose_files};
use hil_sim::identify::provenance::file_hash;
use hil_sim::identify::report::report;
use hil_sim::identify::{gap, simulate};
use hil_sim::record::Record;
use hil_sim::record::check::summary;
use hil_sim::rig::Rig;
use input::{Columns, GivenRecord, GivenRig, Taken, columns_of};
use model_discrepancy::verdict::{Costs, Step};
use muscle_plant::effects::Catalogue;
use muscle_plant::simulation::TOLERANCE;
use pyo3::prelude::*;
use serde::Serialize;

pyo3::create_exception!(
    _native,
    BadInputError,
    pyo3::exceptions::PyValueError,
    "A rig, a record or an argument is not what was expected: the words of the command line."
);

fn bad(error: &BadInput) -> PyErr {
    BadInputError::new_err(error.to_string())
}

/// Refuses a number outside the range that the command line takes.
fn within(name: &str, value: f64, min: f64, max: f64) -> Result<(), BadInput> {
    match (min..=max).contains(&value) {
        true => Ok(()),
        false => Err(BadInput::file(
            name,
            format!("a number from {min} to {max}, found {value}"),
        )),
    }
}

/// As the commands print it.
fn json(summary: &impl Serialize) -> String {
    // Plain structs of numbers and strings are always valid JSON.
    serde_json::to_string_pretty(summary).unwrap_or_default() + "\n"
}

/// `hil-sim check --json`.
#[pyfunction]
fn check(record: GivenRecord, rig: Option<GivenRig>, accept: bool) -> PyResult<String> {
    let rig = rig.map(|rig| rig.read(accept)).transpose();
    let rig = rig.map_err(|error| bad(&error))?;
    let record = record.read().map_err(|error| bad(&error))?;
    let found = summary(&record.record, rig.as_ref(), accept).map_err(|error| bad(&error))?;
    Ok(json(&found))
}

/// `hil-sim simulate --json`, and the columns of the simulated record.
#[pyfunction]
fn simulated(
    py: Python,
    rig: GivenRig,
    drive: GivenRecord,
    tolerance: Option<f64>,
    accept: bool,
) -> PyResult<(String, Columns)> {
    let tolerance = tolerance.unwrap_or(TOLERANCE);
    work::run(py, None, move |watch| {
        within("tolerance", tolerance, 1e-12, 1e-2)?;
        let rig = rig.read(accept)?;
        let drive = drive.checked(&rig, accept)?.record;
        let step = || watch(Step::Stage("simulating", 0));
        let simulated = simulate::simulate_with(&rig, &drive, tolerance, step)?;
        let gaps = gap::gaps(&drive, &simulated, simulate::simulated(&rig, &drive));
        Ok((json(&gaps), columns_of(&simulated)))
    })
}

/// What `hil-sim diagnose` writes: diagnosis.json, rig.fitted.toml, report.html; and each
/// validation record as measured, and as simulated with the nominal and with the fitted rig.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn diagnosed(
    py: Python,
    rig: GivenRig,
    fit: Vec<GivenRecord>,
    validate: Vec<GivenRecord>,
    without: Vec<String>,
    costs: (f64, f64),
    threads: Option<usize>,
    exact: bool,
    accept: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String, String, Vec<[Columns; 3]>)> {
    work::run(py, progress, move |watch| {
        let parsed = rig.read(accept)?;
        let known: Vec<_> = parsed.catalogue.kinds().map(|kind| kind.name).collect();
        if let Some(unknown) = without.iter().find(|name| !known.contains(&name.as_str())) {
            return Err(BadInput::file("without", one_of(&known, unknown)));
        }
        within("cost_wrong_name", costs.0, f64::MIN_POSITIVE, f64::MAX)?;
        within("cost_missing_name", costs.1, f64::MIN_POSITIVE, f64::MAX)?;
        within("threads", threads.unwrap_or(1) as f64, 1.0, 1000.0)?;
        let options = Options {
            without,
            costs: Costs {
                wrong_name: costs.0,
                missing_name: costs.1,
            },
            ..Options::default()
        };
        let read = |records: Vec<GivenRecord>| -> Result<(Vec<Record>, Vec<_>), BadInput> {
            let taken = records
                .into_iter()
                .map(|given| given.checked(&parsed, accept));
            let taken: Vec<Taken> = taken.collect::<Result<_, _>>()?;
            Ok(taken
                .into_iter()
                .map(|taken| (taken.record, taken.hash))
                .unzip())
        };
        let (fit, fit_hashes) = read(fit)?;
        let (validate, validate_hashes) = read(validate)?;
        let files = Files {
            rig: (&parsed, &rig.name, &rig.text),
            records: [&fit, &validate],
            hashes: [fit_hashes, validate_hashes],
            rig_hash: file_hash(rig.name.as_ref(), rig.text.as_bytes()),
            exact,
        };
        let mut pool = rayon::ThreadPoolBuilder::new();
        if let Some(threads) = threads {
            pool = pool.num_threads(threads);
        }
        let pool = pool.build();
        let pool = pool.map_err(|error| BadInput::file("threads", error.to_string()))?;
        let found = pool.install(|| diagnose_files(files, &options, watch));
        let (found, rig_toml) = found?;
        let shown = ("Validation record", &validate[..], &found.free_runs[..]);
        let of = &found.diagnosis;
        let report = report(of, &found.fitted.catalogue, shown, Some(&rig_toml));
        let runs = validate.iter().zip(&found.free_runs);
        let runs =
            runs.map(|(measured, [nominal, fitted])| [measured, nominal, fitted].map(columns_of));
        Ok((json(of), rig_toml, report.to_html(), runs.collect()))
    })
}

/// `hil-sim design --json`; of the paper's rig without one.
#[pyfunction]
fn design(
    rig: Option<GivenRig>,
    pressure_pa_min: Option<f64>,
    pressure_pa_max: Option<f64>,
    masses_kg: Vec<f64>,
    accept: bool,
) -> PyResult<String> {
    let rig = rig.map_or_else(|| Ok(Rig::reference()), |rig| rig.read(accept));
    let question = Question {
        pressure_pa_min,
        pressure_pa_max,
        masses_kg,
    };
    let answer = rig.and_then(|rig| design_report(&rig, &question));
    let (_, found) = answer.map_err(|error| bad(&error))?;
    Ok(json(&found))
}

/// `hil-sim effects --json`, or of one effect; with those of a rig's own.
#[pyfunction]
fn effects(name: Option<&str>, rig: Option<GivenRig>) -> PyResult<String> {
    let catalogue = match rig {
        // What its values are in does not matter here.
        Some(rig) => rig.read(true).map_err(|error| bad(&error))?.catalogue,
        None => Catalogue::standard(),
    };
    let Some(name) = name else {
        let kinds: Vec<_> = catalogue.kinds().map(KindSummary::new).collect();
        return Ok(json(&kinds));
    };
    let kind = catalogue.find(name).ok_or_else(|| {
        let known: Vec<_> = catalogue.kinds().map(|kind| kind.name).collect();
        bad(&BadInput::file("effects", one_of(&known, name)))
    })?;
    Ok(json(&KindSummary::new(kind)))
}

/// `hil-sim experiment --json`, and the columns of the test signal.
#[pyfunction]
fn experiment(
    rig: GivenRig,
    parts: Vec<String>,
    contraction_max: Option<f64>,
    rate_pa_per_s_max: Option<f64>,
    accept: bool,
) -> PyResult<(String, Columns)> {
    let named = |name: &String| {
        let all = Part::all().iter().find(|part| part.name() == *name);
        let known: Vec<String> = Part::all().iter().map(|part| part.name()).collect();
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        all.copied()
            .ok_or_else(|| bad(&BadInput::file("parts", one_of(&known, name))))
    };
    let parts: Vec<Part> = parts.iter().map(named).collect::<PyResult<_>>()?;
    let contraction_max = contraction_max.unwrap_or(CONTRACTION_MAX);
    let limits = within("contraction_max", contraction_max, 0.01, 0.9)
        .and_then(|()| {
            within(
                "rate_pa_per_s_max",
                rate_pa_per_s_max.unwrap_or(1e8),
                100.0,
                1e8,
            )
        })
        .and_then(|()| rig.read(accept));
    let limits = limits.and_then(|rig| Limits::of(&rig, contraction_max));
    let mut limits = limits.map_err(|error| bad(&error))?;
    limits.rate_pa_per_s_max = rate_pa_per_s_max;
    let written = test_signal(
        &limits,
        if parts.is_empty() {
            &Part::DEFAULT
        } else {
            &parts
        },
    );
    let found = written.summary(&limits, "experiment");
    Ok((json(&found), columns_of(&written.record)))
}

/// Checks a rig, as `hil-sim rig check`.
#[pyfunction]
fn check_rig(rig: GivenRig, accept: bool) -> PyResult<()> {
    rig.read(accept).map(|_| ()).map_err(|error| bad(&error))
}

/// The paper's rig with comments, as `hil-sim rig new` writes it.
#[pyfunction]
fn rig_template() -> String {
    Rig::template()
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("BadInputError", module.py().get_type::<BadInputError>())?;
    module.add_function(wrap_pyfunction!(check, module)?)?;
    module.add_function(wrap_pyfunction!(simulated, module)?)?;
    module.add_function(wrap_pyfunction!(diagnosed, module)?)?;
    module.add_function(wrap_pyfunction!(design, module)?)?;
    module.add_function(wrap_pyfunction!(effects, module)?)?;
    module.add_function(wrap_pyfunction!(experiment, module)?)?;
    module.add_function(wrap_pyfunction!(check_rig, module)?)?;
    module.add_function(wrap_pyfunction!(rig_template, module)?)?;
    Ok(())
}
