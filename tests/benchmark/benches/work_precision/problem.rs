//! A reference case as a problem for a solver: the plant, held references, the solution at rows.

use hil_sim::record::{CONTRACTION, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::Rig;
use model_core::pressure::GaugePa;
use muscle_plant::simulation::{Drive, Plant, Simulated};
use muscle_plant::simulation::{Initial, Simulation};
use std::path::{Path, PathBuf};

/// Ranges that tolerances are relative to: ε, ε̇ \[1/s\], P \[Pa\], θ \[K\].
pub const PER_STATE: [f64; 4] = [0.25, 1.0, 4e5, 100.0];

/// One case of tests/reference.
pub struct Problem {
    pub name: String,
    pub folder: PathBuf,
    rig: Rig,
    references_pa: Vec<f64>,
    time_s: Vec<f64>,
    /// Contraction and gauge pressure of the independent solution, and their ranges.
    solution: Vec<[f64; 2]>,
    ranges: [f64; 2],
}

impl Problem {
    pub fn read(name: &str) -> Problem {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../reference")
            .join(name);
        let record = |file: &str| Record::read(&folder.join(file)).expect("a reference record");
        let (drive, expected) = (record("drive.csv"), record("expected.csv"));
        let column = |name: &str| expected.require(name).expect("a solution").to_vec();
        let (contraction, pressure_pa) = (column(CONTRACTION), column(PRESSURE_PA));
        let range = |values: &[f64]| {
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            high - values.iter().copied().fold(f64::INFINITY, f64::min)
        };
        Problem {
            name: name.into(),
            rig: Rig::read(&folder.join("rig.toml")).expect("a rig"),
            references_pa: drive.require(PRESSURE_REF_PA).expect("a drive").to_vec(),
            time_s: drive.time_s().to_vec(),
            ranges: [range(&contraction), range(&pressure_pa)],
            solution: contraction
                .into_iter()
                .zip(pressure_pa)
                .map(|(c, p)| [c, p])
                .collect(),
            folder,
        }
    }

    pub fn plant(&self) -> Plant {
        let whole = Simulated::WHOLE;
        self.rig.plant(whole).expect("a complete rig")
    }

    pub fn flow_gain_kg_per_pa_s(&self) -> f64 {
        self.rig
            .require_valve()
            .expect("a valve")
            .flow_gain_kg_per_pa_s
    }

    pub fn rows(&self) -> usize {
        self.time_s.len()
    }

    pub fn time_s(&self, row: usize) -> f64 {
        self.time_s[row]
    }

    pub fn drive(&self, row: usize) -> Drive {
        Drive {
            reference: GaugePa(self.references_pa[row]),
            ..Drive::default()
        }
    }

    /// Rows from which and to which a reference is held.
    pub fn stretches(&self) -> Vec<(usize, usize)> {
        let last = self.rows() - 1;
        let references = &self.references_pa;
        let changes = (1..last).filter(|row| references[*row] != references[row - 1]);
        let mut from = vec![0];
        from.extend(changes);
        let to = from
            .iter()
            .skip(1)
            .copied()
            .chain([last])
            .collect::<Vec<_>>();
        from.into_iter().zip(to).collect()
    }

    /// State at the first row: at rest at ambient temperature.
    pub fn start(&self) -> [f64; 4] {
        let plant = self.plant();
        let [contraction, pressure_pa] = self.solution[0];
        let absolute = GaugePa(pressure_pa).to_absolute(plant.atmospheric);
        [contraction, 0.0, absolute.0, plant.ambient_temperature_k]
    }

    /// What is compared of a state: contraction and absolute pressure.
    pub fn observed(&self, state: &[f64]) -> [f64; 2] {
        [state[0], state[2]]
    }

    /// Ours: one `advance` a row, as the controller's ticks ask for.
    pub fn solve(&self, tolerance: f64) -> Option<Vec<[f64; 2]>> {
        let plant = self.plant();
        let atmospheric = plant.atmospheric;
        let [contraction, pressure_pa] = self.solution[0];
        let initial = Initial {
            time_s: self.time_s[0],
            contraction,
            contraction_rate_per_s: 0.0,
            pressure: GaugePa(pressure_pa),
            temperature_k: plant.ambient_temperature_k,
        };
        let mut simulation = Simulation::new(plant, &initial, &self.drive(0), tolerance);
        let mut out = Vec::with_capacity(self.rows());
        for row in 0..self.rows() {
            let absolute = simulation.pressure().to_absolute(atmospheric);
            out.push([simulation.contraction(), absolute.0]);
            if row + 1 < self.rows() {
                simulation
                    .advance(&self.drive(row), self.time_s[row + 1])
                    .ok()?;
            }
        }
        Some(out)
    }

    /// Largest errors of contraction and pressure, relative to their ranges.
    pub fn errors(&self, found: &[[f64; 2]]) -> [f64; 2] {
        assert_eq!(found.len(), self.rows());
        let atmospheric_pa = self.plant().atmospheric.0;
        let mut errors = [0.0_f64; 2];
        for (found, solution) in found.iter().zip(&self.solution) {
            let differences = [
                found[0] - solution[0],
                found[1] - atmospheric_pa - solution[1],
            ];
            for (place, difference) in differences.iter().enumerate() {
                errors[place] = errors[place].max(difference.abs() / self.ranges[place]);
            }
        }
        errors
    }

    /// Simulated time \[s\].
    pub fn duration_s(&self) -> f64 {
        self.time_s[self.rows() - 1] - self.time_s[0]
    }
}
