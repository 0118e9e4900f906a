//! Work and precision: this project's integrator beside diffsol (same Rust equations), and beside
//! SUNDIALS in C and scipy where they are installed, on the same problems in the same run.
//!
//! `cargo bench` writes target/benchmark/work_precision.{json,html}; `-- --quick` repeats less.

mod peer_diffsol;
mod problem;

use hil_sim::report::{Axis, Plot, Report, Section, Series, Table};
use peer_diffsol::Method;
use problem::Problem;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// The accuracy at which solvers are compared.
const ACCURACY: f64 = 1e-4;
/// A solver whose run takes longer is not tried at finer tolerances.
const SECONDS_MAX: f64 = 0.1;
const OURS: &str = "hil-sim (Rust)";

/// One solver at one tolerance on one problem.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Point {
    #[serde(default)]
    problem: String,
    solver: String,
    tolerance: f64,
    /// Median wall time of a run.
    seconds: f64,
    simulated_s: f64,
    /// Largest error relative to the range.
    error_contraction: f64,
    error_pressure: f64,
}

impl Point {
    fn error(&self) -> f64 {
        self.error_contraction.max(self.error_pressure)
    }

    fn times_real_time(&self) -> f64 {
        self.simulated_s / self.seconds
    }
}

type Solve<'a> = dyn Fn(f64) -> Option<Vec<[f64; 2]>> + 'a;

fn measure(problem: &Problem, solver: &str, repeats: usize, solve: &Solve) -> Vec<Point> {
    let mut points = Vec::new();
    for halves in 5..=14 {
        let tolerance = 10_f64.powf(-0.5 * f64::from(halves));
        let Some(found) = solve(tolerance) else {
            continue;
        };
        let errors = problem.errors(&found);
        let mut seconds: Vec<f64> = (0..repeats)
            .map(|_| {
                let start = Instant::now();
                std::hint::black_box(solve(tolerance));
                start.elapsed().as_secs_f64()
            })
            .collect();
        seconds.sort_by(f64::total_cmp);
        points.push(Point {
            problem: problem.name.clone(),
            solver: solver.into(),
            tolerance,
            seconds: seconds[repeats / 2],
            simulated_s: problem.duration_s(),
            error_contraction: errors[0],
            error_pressure: errors[1],
        });
        if seconds[repeats / 2] > SECONDS_MAX {
            break;
        }
    }
    points
}

/// Reports a peer that does not run here; in CI, which installs all of them, that is an error.
fn left_out(name: &str, why: &str) {
    assert!(std::env::var_os("CI").is_none(), "{name}: {why}");
    eprintln!("{name} is left out: {why}");
}

/// Runs a peer that prints a point a line.
fn foreign(name: &str, command: &mut Command, problem: &Problem) -> Vec<Point> {
    eprintln!("{}: {name}", problem.name);
    let output = match command.output() {
        Ok(output) if output.status.success() => output,
        Ok(output) => {
            left_out(name, String::from_utf8_lossy(&output.stderr).trim());
            return Vec::new();
        }
        Err(error) => {
            left_out(name, &error.to_string());
            return Vec::new();
        }
    };
    let lines = String::from_utf8_lossy(&output.stdout).into_owned();
    let points = lines.lines().map(|line| {
        let mut point: Point = serde_json::from_str(line).expect("a point as JSON");
        point.problem.clone_from(&problem.name);
        point
    });
    points.collect()
}

fn peers(problem: &Problem, quick: bool) -> Vec<Point> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers");
    let repeats = if quick { "1" } else { "5" };
    let cvode = std::env::temp_dir().join("hil-sim-benchmark-cvode");
    let compiled = Command::new("cc")
        .args(["-O3", "-march=native", "-std=gnu11", "-o"])
        .arg(&cvode)
        .arg(folder.join("cvode.c"))
        .args(
            [
                "cvode",
                "arkode",
                "nvecserial",
                "sunmatrixdense",
                "sunlinsoldense",
            ]
            .map(|library| format!("-lsundials_{library}")),
        )
        .arg("-lm")
        .output();
    let mut points = Vec::new();
    match compiled {
        Ok(output) if output.status.success() => {
            let mut command = Command::new(&cvode);
            command.arg(&problem.folder).args(["--repeats", repeats]);
            points.extend(foreign("SUNDIALS", &mut command, problem));
        }
        _ => left_out("SUNDIALS", "it needs cc and libsundials-dev"),
    }
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".into());
    let mut command = Command::new(python);
    command
        .arg(folder.join("scipy_peers.py"))
        .arg(&problem.folder);
    command.args(["--repeats", "1", "--methods", "LSODA"]);
    if !quick {
        command.arg("BDF");
    }
    points.extend(foreign("scipy", &mut command, problem));
    points
}

fn all_points(quick: bool) -> Vec<Point> {
    let repeats = if quick { 5 } else { 21 };
    let mut points = Vec::new();
    for name in ["steps_B", "multisine_B"] {
        let problem = Problem::read(name);
        eprintln!("{name}: {OURS}");
        points.extend(measure(&problem, OURS, repeats, &|tolerance| {
            problem.solve(tolerance)
        }));
        for method in [
            Method::Tsit45,
            Method::Bdf,
            Method::TrBdf2,
            Method::Esdirk34,
        ] {
            let solver = format!("diffsol {method:?} (Rust)");
            eprintln!("{name}: {solver}");
            let solve = |tolerance| peer_diffsol::solve(&problem, method, tolerance);
            points.extend(measure(&problem, &solver, repeats.min(5), &solve));
        }
        points.extend(peers(&problem, quick));
    }
    points
}

/// The fastest setting of each solver that reaches the accuracy, fastest first.
fn at_accuracy<'a>(points: &'a [Point], problem: &str) -> Vec<&'a Point> {
    let mut best: Vec<&Point> = Vec::new();
    let good = points
        .iter()
        .filter(|p| p.problem == problem && p.error() <= ACCURACY);
    for point in good {
        match best.iter_mut().find(|known| known.solver == point.solver) {
            Some(known) if known.seconds <= point.seconds => {}
            Some(known) => *known = point,
            None => best.push(point),
        }
    }
    best.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    best
}

fn section(points: &[Point], problem: &str) -> Section {
    let best = at_accuracy(points, problem);
    let ours = best
        .iter()
        .find(|point| point.solver == OURS)
        .map_or(f64::NAN, |p| p.seconds);
    let row = |point: &&Point| {
        vec![
            point.solver.clone(),
            format!("{:.1e}", point.tolerance),
            format!("{:.1e}", point.error()),
            format!("{:.0}", point.times_real_time()),
            format!("{:.1}", point.seconds / ours),
        ]
    };
    let mut solvers: Vec<&str> = points.iter().map(|point| point.solver.as_str()).collect();
    solvers.dedup();
    let line = |solver: &str| {
        let mut own: Vec<&Point> = points
            .iter()
            .filter(|p| p.problem == problem && p.solver == solver)
            .collect();
        own.sort_by(|a, b| a.error().total_cmp(&b.error()));
        let x = own.iter().map(|point| point.error()).collect();
        Series::new(
            solver,
            x,
            own.iter().map(|p| p.seconds / p.simulated_s).collect(),
        )
    };
    solvers.sort_unstable();
    solvers.dedup();
    let columns = [
        "solver",
        "tolerance",
        "error",
        "× real time",
        "time over ours",
    ];
    Section {
        heading: problem.into(),
        tables: vec![Table {
            caption: format!("Fastest setting with errors of ε and P up to {ACCURACY:e} of range"),
            columns: columns.map(String::from).to_vec(),
            rows: best.iter().map(row).collect(),
        }],
        plots: vec![Plot {
            title: format!("Work and precision, {problem}"),
            caption: "Down and left is better.".into(),
            x: Axis::new("largest error over range", "", 1.0).log(),
            y: Axis::new("time per simulated second", "s", 1.0).log(),
            series: solvers.iter().map(|solver| line(solver)).collect(),
            markers: Vec::new(),
            sync: None,
        }],
        ..Section::default()
    }
}

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let points = all_points(quick);
    let report = Report {
        title: "Work and precision of the plant's integrator".into(),
        verdict: vec!["Medians of repeated runs on one core, all solvers in one run.".into()],
        sections: ["steps_B", "multisine_B"]
            .map(|name| section(&points, name))
            .into(),
        repeat: vec!["cargo bench".into()],
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/benchmark");
    std::fs::create_dir_all(&folder).expect("target/ can be written");
    let json = serde_json::to_string_pretty(&points).expect("numbers and words");
    std::fs::write(folder.join("work_precision.json"), json).expect("written");
    std::fs::write(folder.join("work_precision.html"), report.to_html()).expect("written");
    print!("{}", report.to_text());
}
