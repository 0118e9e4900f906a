//! One instance of an FMU: its values, and the simulation between communication points.
//!
//! At a communication point the inputs take effect; over the step `pressure_ref_pa` and
//! `valve_open` are held, and the others move at their rates. With the rates of a record's straight
//! lines this is the simulation of `hil-sim simulate`, row by row.

use super::variables::{Input, Model, Role, Setting, Variable};
use crate::identify::initial::{hanging_contraction, held_pressure};
use crate::rig::Rig;
use model_core::pressure::{AbsolutePa, GaugePa};
use muscle_plant::nominal::Gas;
use muscle_plant::simulation::{Drive, Initial, Ramp, Simulation, TOLERANCE};

/// Communication points that differ by less are the same \[s\].
const SAME_S: f64 = 1e-9;
/// Tolerances that an importer may ask for; others are moved to the nearer end.
const TOLERANCES: [f64; 2] = [1e-12, 1e-2];

/// The state of FMI 3.0 that an instance is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Instantiated,
    Initialization,
    Step,
    Terminated,
}

/// One instance of an FMU.
pub struct Instance {
    model: Model,
    /// The value of each variable but the outputs.
    values: Vec<f64>,
    phase: Phase,
    time_s: f64,
    tolerance: f64,
    /// `None` until something needs it, and after a change during initialization.
    simulation: Option<Simulation>,
    /// An input was set since the last step.
    is_set: bool,
}

impl Instance {
    /// An instance of `model` for the model description with this instantiation token.
    ///
    /// # Errors
    /// The token is that of another rig, or of another version of the program.
    pub fn new(model: Model, token: &str) -> Result<Instance, String> {
        let expected = model.token();
        if expected != token {
            return Err(format!(
                "modelDescription.xml: expected the instantiation token {expected}, found {token}: \
                 export the FMU again"
            ));
        }
        let mut instance = Instance {
            model,
            values: Vec::new(),
            phase: Phase::Instantiated,
            time_s: 0.0,
            tolerance: TOLERANCE,
            simulation: None,
            is_set: false,
        };
        instance.reset();
        Ok(instance)
    }

    /// Returns to the state after [`Instance::new`].
    pub fn reset(&mut self) {
        let starts = self.model.variables.iter().map(|variable| variable.start);
        self.values = starts.collect();
        self.phase = Phase::Instantiated;
        self.time_s = 0.0;
        self.tolerance = TOLERANCE;
        self.simulation = None;
        self.is_set = false;
    }

    /// Begins the initialization at `start_s`.
    ///
    /// # Errors
    /// The instance is initialized already, or the time is not finite.
    pub fn enter_initialization(
        &mut self,
        start_s: f64,
        tolerance: Option<f64>,
    ) -> Result<(), String> {
        self.expect(Phase::Instantiated)?;
        if !start_s.is_finite() {
            return Err(format!("expected a finite start time, found {start_s}"));
        }
        let [min, max] = TOLERANCES;
        // `max` and `min` also replace NaN.
        self.tolerance = tolerance.map_or(TOLERANCE, |asked| asked.max(min).min(max));
        self.time_s = start_s;
        self.phase = Phase::Initialization;
        Ok(())
    }

    /// Ends the initialization.
    ///
    /// # Errors
    /// The parameters are no rig, or the initial state is not physical.
    pub fn exit_initialization(&mut self) -> Result<(), String> {
        self.expect(Phase::Initialization)?;
        self.simulation()?;
        self.phase = Phase::Step;
        Ok(())
    }

    /// Ends the simulation; values can still be read.
    ///
    /// # Errors
    /// There is no simulation.
    pub fn terminate(&mut self) -> Result<(), String> {
        self.expect(Phase::Step)?;
        self.phase = Phase::Terminated;
        Ok(())
    }

    /// Sets a variable; `is_boolean` is the type that the importer means.
    ///
    /// # Errors
    /// No such variable of this type, one that cannot be set now, or a value out of range.
    pub fn set(&mut self, reference: u32, is_boolean: bool, value: f64) -> Result<(), String> {
        let index = self.index(reference, is_boolean)?;
        let variable = &self.model.variables[index];
        let is_settable = match variable.role {
            Role::Time | Role::Output(_) => false,
            Role::Input(_) => self.phase != Phase::Terminated,
            _ => [Phase::Instantiated, Phase::Initialization].contains(&self.phase),
        };
        if !is_settable {
            let (name, phase) = (&variable.name, self.phase);
            let (causality, _) = variable.kind();
            return Err(format!(
                "variable `{name}`: expected no change of this {causality} in the state {phase:?}"
            ));
        }
        self.values[index] = variable.checked(value)?;
        self.is_set = true;
        if self.phase == Phase::Initialization {
            self.simulation = None;
        }
        Ok(())
    }

    /// The value of a variable; `is_boolean` is the type that the importer means.
    ///
    /// # Errors
    /// No such variable of this type, or an output that cannot be computed.
    pub fn get(&mut self, reference: u32, is_boolean: bool) -> Result<f64, String> {
        let index = self.index(reference, is_boolean)?;
        let variable = &self.model.variables[index];
        match variable.role {
            Role::Time => Ok(self.time_s),
            Role::Output(_) if self.phase == Phase::Instantiated => {
                let name = &variable.name;
                Err(format!(
                    "variable `{name}`: expected the initialization mode to have begun"
                ))
            }
            Role::Output(value) => {
                self.take_inputs()?;
                Ok(value(self.simulation()?))
            }
            _ => Ok(self.values[index]),
        }
    }

    /// Simulates from the communication point `time_s` over `length_s`.
    ///
    /// # Errors
    /// Another time than that of the last step's end, or inputs that the plant cannot follow.
    pub fn step(&mut self, time_s: f64, length_s: f64) -> Result<f64, String> {
        self.expect(Phase::Step)?;
        let same_s = SAME_S.max(4.0 * f64::EPSILON * self.time_s.abs());
        if (time_s - self.time_s).abs() > same_s || time_s.is_nan() {
            let reached_s = self.time_s;
            return Err(format!(
                "expected a step from {reached_s} s on, found {time_s} s"
            ));
        }
        if !(length_s > 0.0 && length_s.is_finite()) {
            return Err(format!(
                "expected a step of more than 0 s, found {length_s} s"
            ));
        }
        self.is_set = true;
        self.take_inputs()?;
        let (drive, end_s) = (self.drive(), time_s + length_s);
        if let Err(error) = self.simulation()?.advance(&drive, end_s) {
            self.phase = Phase::Terminated;
            return Err(format!(
                "expected inputs that the plant can follow, {error}"
            ));
        }
        self.time_s = end_s;
        Ok(end_s)
    }

    fn expect(&self, phase: Phase) -> Result<(), String> {
        match self.phase == phase {
            true => Ok(()),
            false => Err(format!(
                "expected the state {phase:?}, found {:?}",
                self.phase
            )),
        }
    }

    /// The place of a variable of this type.
    fn index(&self, reference: u32, is_boolean: bool) -> Result<usize, String> {
        let index = reference as usize;
        let variable = self.model.variables.get(index);
        let is_of_type = |variable: &&Variable| is_boolean == variable.unit.is_none();
        match variable.filter(is_of_type) {
            Some(_) => Ok(index),
            None => {
                let kind = if is_boolean { "Boolean" } else { "Float64" };
                Err(format!(
                    "expected the value reference of a {kind}, found {reference}"
                ))
            }
        }
    }

    /// The value of an input; `None` if the model lacks it.
    fn input(&self, input: Input) -> Option<f64> {
        self.value_of(|role| matches!(role, Role::Input(other) if other == input))
    }

    /// The value of a setting; `None` if the model lacks it.
    fn setting(&self, setting: Setting) -> Option<f64> {
        self.value_of(|role| matches!(role, Role::Setting(other) if other == setting))
    }

    /// The value of the variable whose role is `it`.
    fn value_of(&self, it: impl Fn(Role) -> bool) -> Option<f64> {
        let mut variables = self.model.variables.iter();
        let index = variables.position(|variable| it(variable.role))?;
        Some(self.values[index])
    }

    /// What the inputs mean over the next step.
    fn drive(&self) -> Drive {
        let input = |input| self.input(input).unwrap_or(0.0);
        let supply = Ramp {
            start_s: self.time_s,
            value: input(Input::SupplyPa),
            rate_per_s: input(Input::SupplyRate),
        };
        Drive {
            reference: GaugePa(input(Input::ReferencePa)),
            contraction_rate_per_s: input(Input::ContractionRate),
            contraction_acceleration_per_s2: 0.0,
            pressure_rate_pa_per_s: input(Input::PressureRate),
            supply: (self.setting(Setting::SupplyIsInput) == Some(1.0)).then_some(supply),
            shut: self.input(Input::ValveOpen) == Some(0.0),
        }
    }

    /// Gives the simulation the prescribed pressure and contraction of a communication point.
    fn take_inputs(&mut self) -> Result<(), String> {
        if !std::mem::take(&mut self.is_set) || self.phase == Phase::Terminated {
            return Ok(());
        }
        let contraction = self.input(Input::Contraction);
        let rate_per_s = self.input(Input::ContractionRate).unwrap_or(0.0);
        let atmospheric = self.simulation()?.plant().atmospheric;
        let pressure = self.prescribed_pressure(atmospheric)?;
        let simulation = self.simulation()?;
        if let Some(contraction) = contraction {
            simulation.prescribe_contraction(contraction, rate_per_s);
        }
        if let Some(pressure) = pressure {
            simulation.prescribe_pressure(pressure);
        }
        Ok(())
    }

    /// The prescribed pressure, if it is an input.
    ///
    /// # Errors
    /// It is not above vacuum.
    fn prescribed_pressure(
        &self,
        atmospheric: AbsolutePa<f64>,
    ) -> Result<Option<GaugePa<f64>>, String> {
        let pressure_pa = self.input(Input::PressurePa);
        let pressure = pressure_pa.map(|pressure_pa| {
            above_vacuum("prescribed_pressure_pa", GaugePa(pressure_pa), atmospheric)
        });
        pressure.transpose()
    }

    /// The simulation, begun if there is none.
    fn simulation(&mut self) -> Result<&mut Simulation, String> {
        if self.simulation.is_none() {
            let rig = self.rig()?;
            let (drive, initial) = (self.drive(), self.initial(&rig)?);
            let plant = rig.plant(self.model.simulated);
            let plant = plant.map_err(|error| error.to_string())?;
            let begun = Simulation::new(plant, &initial, &drive, self.tolerance);
            self.simulation = Some(begun);
        }
        self.simulation.as_mut().ok_or_else(String::new)
    }

    /// The rig with the parameters' values and the effects that are on.
    fn rig(&self) -> Result<Rig, String> {
        let rig = self.model.rig_with(&self.values);
        rig.check().map_err(|error| error.to_string())?;
        Ok(rig)
    }

    /// The initial state under the present inputs.
    fn initial(&self, rig: &Rig) -> Result<Initial, String> {
        let setting = |setting| self.setting(setting).unwrap_or(0.0);
        let at_rest = self.setting(Setting::StartsAtRest) != Some(0.0);
        let drive = self.drive();
        let gas = rig.nominal.gas.unwrap_or(Gas::STANDARD);
        let atmospheric = gas.atmospheric_pressure;
        let pressure = match self.prescribed_pressure(atmospheric)? {
            Some(pressure) => pressure,
            None if at_rest => held_pressure(rig, &drive).map_err(|error| error.to_string())?,
            None => {
                let pressure = GaugePa(setting(Setting::InitialPressurePa));
                above_vacuum("initial.pressure_pa", pressure, atmospheric)?
            }
        };
        let (contraction, contraction_rate_per_s) = match self.input(Input::Contraction) {
            Some(contraction) => (contraction, drive.contraction_rate_per_s),
            None if at_rest => (hanging_contraction(rig, pressure), 0.0),
            None => (
                setting(Setting::InitialContraction),
                setting(Setting::InitialContractionRate),
            ),
        };
        let temperature_k = match self.setting(Setting::InitialTemperatureK) {
            Some(temperature_k) if !at_rest => temperature_k,
            _ => gas.ambient_temperature_k,
        };
        Ok(Initial {
            time_s: self.time_s,
            contraction,
            contraction_rate_per_s,
            pressure,
            temperature_k,
        })
    }
}

/// `pressure`, refused if it is not above vacuum.
fn above_vacuum(
    variable: &str,
    pressure: GaugePa<f64>,
    atmospheric: AbsolutePa<f64>,
) -> Result<GaugePa<f64>, String> {
    if pressure.to_absolute(atmospheric).0 > 0.0 {
        return Ok(pressure);
    }
    let found = pressure.0;
    Err(format!(
        "variable `{variable}`: expected a gauge pressure above vacuum, found {found}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    fn instance() -> Instance {
        let model = Model::new("rig.toml", Rig::REFERENCE_TOML).expect("a model");
        let token = model.token();
        Instance::new(model, &token).expect("an instance")
    }

    /// The value reference of a variable.
    fn reference(instance: &Instance, name: &str) -> u32 {
        let mut variables = instance.model.variables.iter();
        let index = variables.position(|variable| variable.name == name);
        index.expect("the variable") as u32
    }

    fn set(instance: &mut Instance, name: &str, value: f64) -> Result<(), String> {
        let reference = reference(instance, name);
        let is_boolean = instance.model.variables[reference as usize].unit.is_none();
        instance.set(reference, is_boolean, value)
    }

    fn get(instance: &mut Instance, name: &str) -> Result<f64, String> {
        let reference = reference(instance, name);
        instance.get(reference, false)
    }

    #[test]
    fn the_order_of_calls_is_that_of_the_standard() {
        let mut instance = instance();
        assert!(instance.step(0.0, 0.01).is_err());
        assert!(get(&mut instance, "pressure_pa").is_err());
        assert_eq!(get(&mut instance, "load.mass_kg"), Ok(12.0));
        assert!(instance.exit_initialization().is_err());
        instance
            .enter_initialization(1.0, None)
            .expect("the initialization");
        // The state at rest follows the inputs until the initialization ends.
        for reference_pa in [2e5, 3e5] {
            set(&mut instance, "pressure_ref_pa", reference_pa).expect("an input");
            assert_eq!(get(&mut instance, "pressure_pa"), Ok(reference_pa));
        }
        instance.exit_initialization().expect("a simulation");
        let late = set(&mut instance, "load.mass_kg", 11.0).expect_err("a fixed parameter");
        let expected = "variable `load.mass_kg`: expected no change of this parameter in the state \
                        Step";
        assert_eq!(late, expected);
        assert_eq!(
            instance.step(0.0, 0.01),
            Err("expected a step from 1 s on, found 0 s".into())
        );
        for length_s in [0.0, -0.01, f64::NAN, f64::INFINITY] {
            assert!(instance.step(1.0, length_s).is_err(), "{length_s}");
        }
        assert_eq!(instance.step(1.0, 0.5), Ok(1.5));
        assert_eq!(get(&mut instance, "time"), Ok(1.5));
        instance.terminate().expect("the end");
        assert!(get(&mut instance, "pressure_pa").is_ok());
        assert!(instance.step(1.5, 0.5).is_err());
        instance.reset();
        assert!(set(&mut instance, "load.mass_kg", 11.0).is_ok());
    }

    #[test]
    fn values_that_are_no_rig_are_refused_with_their_names() {
        let mut instance = instance();
        for (name, value, expected) in [
            ("load.mass_kg", -1.0, "a number from 0.001 to 1e5, found -1"),
            ("pressure_ref_pa", f64::NAN, "a finite number, found NaN"),
            (
                "initial.contraction",
                1.0,
                "a number from 0 to 0.999, found 1",
            ),
            (
                "effect.leak.conductance_kg_per_pa_s",
                1.0,
                "a number from 0 to 1e-6, found 1",
            ),
        ] {
            let error = set(&mut instance, name, value).expect_err(name);
            assert_eq!(error, format!("variable `{name}`: expected {expected}"));
        }
        // Each in its range, but not together.
        set(&mut instance, "load.static_friction_n", 1.0).expect("in range");
        instance
            .enter_initialization(0.0, None)
            .expect("the initialization");
        let error = instance
            .exit_initialization()
            .expect_err("less than in motion");
        let expected = "key `load.static_friction_n`: expected at least coulomb_friction_n = 4.5";
        assert!(error.contains(expected), "{error}");
        set(&mut instance, "load.static_friction_n", 7.0).expect("in range");
        set(&mut instance, "initial.at_rest", 0.0).expect("a switch");
        set(&mut instance, "initial.pressure_pa", -2e5).expect("a finite number");
        let error = instance.exit_initialization().expect_err("below vacuum");
        assert!(
            error.starts_with("variable `initial.pressure_pa`: expected"),
            "{error}"
        );
        set(&mut instance, "initial.pressure_pa", 2e5).expect("a pressure");
        instance.exit_initialization().expect("a simulation");
        let boolean = reference(&instance, "valve_open");
        assert!(
            instance.set(boolean, false, 1.0).is_err(),
            "a Boolean as a number"
        );
        assert!(instance.get(1_000_000, false).is_err(), "no such variable");
    }

    #[test]
    fn a_token_of_another_rig_is_refused() {
        let text = Rig::REFERENCE_TOML.replace("mass_kg = 12.0", "mass_kg = 11.0");
        let other = Model::new("rig.toml", &text).expect("a model").token();
        let model = Model::new("rig.toml", Rig::REFERENCE_TOML).expect("a model");
        let error = Instance::new(model, &other).err().expect("another rig");
        assert!(error.ends_with("export the FMU again"), "{error}");
    }

    /// Between communication points a prescribed contraction moves at its rate, and the output at a
    /// communication point is that of the inputs which were set there.
    #[test]
    fn a_prescribed_contraction_moves_at_its_rate() {
        let text = Rig::REFERENCE_TOML.replace("\"weight\"", "\"prescribed\"");
        let model = Model::new("rig.toml", &text).expect("a model");
        let token = model.token();
        let mut instance = Instance::new(model, &token).expect("an instance");
        set(&mut instance, "prescribed_contraction", 0.1).expect("an input");
        set(&mut instance, "prescribed_contraction_rate_per_s", 0.05).expect("an input");
        instance
            .enter_initialization(0.0, None)
            .expect("the initialization");
        instance.exit_initialization().expect("a simulation");
        instance.step(0.0, 0.2).expect("a step");
        let reached = get(&mut instance, "contraction").expect("an output");
        assert!((reached - 0.11).abs() < 1e-12, "{reached}");
        set(&mut instance, "prescribed_contraction", 0.2).expect("an input");
        assert_eq!(get(&mut instance, "contraction"), Ok(0.2));
    }
}
