//! Effects of one's own, declared in a rig file.

use hil_sim::identify::simulate::simulate;
use hil_sim::own_effect::from_toml;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::Rig;
use std::fs;
use std::path::Path;

const EXAMPLES: &str = include_str!("../../docs/examples/own-effects.toml");
const GUIDE: &str = include_str!("../../docs/own-effect.md");

/// The reference rig with more text: keys of the root, and tables at its end.
fn rig(root: &str, tables: &str) -> Result<Rig, String> {
    let schema = "schema = 1\n";
    let text = Rig::REFERENCE_TOML.replacen(schema, &format!("{schema}{root}"), 1) + "\n" + tables;
    Rig::parse("rig.toml", &text).map_err(|error| error.to_string())
}

/// Steps of the reference up and down over 20 s, from rest.
fn steps(interval_s: f64) -> Record {
    let rows = (20.0 / interval_s) as u32;
    let time_s: Vec<f64> = (0..rows).map(|row| interval_s * f64::from(row)).collect();
    let levels_pa = [2e5, 4.9e5, 2.2e5, 4.6e5, 2.3e5, 2e5];
    let reference_pa = time_s
        .iter()
        .map(|time_s| levels_pa[(time_s / 3.4) as usize]);
    let reference_pa: Vec<f64> = reference_pa.collect();
    let mut record = Record::new(time_s);
    record.set(PRESSURE_REF_PA, reference_pa);
    record.set(PRESSURE_PA, vec![2e5; rows as usize]);
    record
}

/// The effect of the examples against the built-in one, with the lines for each.
fn compare(name: &str, built_in: &str, own: &str) {
    let effect = |lines: &str| format!("[[effect]]\nname = \"{name}\"\n{lines}\n");
    let of_catalogue = rig("", &effect(built_in)).expect("a rig");
    let of_example = rig("", &format!("{}{EXAMPLES}", effect(own))).expect("a rig");
    let kind = of_example.effects[0].kind;
    let known = of_catalogue.catalogue.find(name).expect("a kind");
    assert!(!std::ptr::eq(known, kind));
    // What a diagnosis lets vary decides as much as the equations do.
    assert_eq!(known.law_quantities, kind.law_quantities, "{name}");
    assert_eq!(known.discrepancy_ratio, kind.discrepancy_ratio, "{name}");
    let drive = steps(0.01);
    let [expected, found] = [&of_catalogue, &of_example]
        .map(|rig| simulate(rig, &drive, 1e-8).unwrap_or_else(|error| panic!("{name}: {error}")));
    let nominal = simulate(&Rig::reference(), &drive, 1e-8).expect("simulated");
    let mut changed = false;
    // The weight starts at instants that the tolerance of 1e-8 leaves open, and goes on from there.
    for (column, range) in [(PRESSURE_PA, 5e5), (CONTRACTION, 0.25), (FORCE_N, 500.0)] {
        let [expected, found, nominal] =
            [&expected, &found, &nominal].map(|record| record.require(column).expect("a column"));
        let largest = |of: &[f64]| {
            let differences = of.iter().zip(expected).map(|(a, b)| (a - b).abs() / range);
            differences.fold(0.0, f64::max)
        };
        // A static excess makes the motion sensitive to the instant of the start.
        let near = if built_in.contains("static_ratio") {
            3e-4
        } else {
            1e-5
        };
        assert!(largest(found) < near, "{name} {column}: {}", largest(found));
        changed |= largest(nominal) > 1e-4;
    }
    assert!(changed, "{name} changes nothing");
}

/// Effects by name and form, with their parameters as the catalogue has them and, where these
/// differ, as the examples do. CREEP_N: 4 % of the force of 300 kPa.
const COMPARED: &str = "
leak; linear; conductance_kg_per_pa_s = 6e-9
leak; orifice; conductance_kg_per_pa_s = 6e-9
leak; power; conductance_kg_per_pa_s = 6e-9, power = 1.7
bladder-elasticity; exponential; force_n = 40.0, growth = 8.0; size_n = 40.0, growth = 8.0
bladder-elasticity; polynomial; linear_n = 20.0, quadratic_n = 15.0
creep; relaxation; force_n = CREEP_N, time_constant_s = 4.0; share = 0.04, time_constant_s = 4.0
creep; logarithmic; force_per_decade_n = CREEP_N; share_per_decade = 0.04
creep; strain-relaxation; force_n = 15.0, time_constant_s = 4.0; \
    size_n = 15.0, time_constant_s = 4.0
creep; logarithmic-strain; force_per_decade_n = 15.0, shortest_time_constant_s = 0.4, \
    longest_time_constant_s = 90.0; per_decade_n = 15.0, shortest_time_constant_s = 0.4, \
    longest_time_constant_s = 90.0
friction; coulomb; force_n = 6.0
friction; stribeck; force_n = 6.0, static_ratio = 1.4, speed_m_per_s = 0.02; \
    force_n = 6.0, static_ratio = 1.4, stribeck_m_per_s = 0.02
friction; lugre; force_n = 6.0, static_ratio = 1.4, deflection_m = 3e-4
payload; ; mass_kg = 1.5
valve-dead-zone; sharp; half_width_pa = 9e3
valve-dead-zone; rounded; half_width_pa = 9e3, rounding_pa = 4e3
valve-dead-zone; asymmetric; filling_pa = 5e3, exhausting_pa = 1.2e4
valve-lag; first-order; time_constant_s = 0.04
valve-lag; second-order; time_constant_s = 0.04, damping_ratio = 0.5
transport-delay; ; delay_s = 0.03
supply-droop; linear; reservoir_volume_m3 = 8e-4, recovery_time_s = 3.0
supply-droop; orifice; reservoir_volume_m3 = 8e-4, conductance_kg_per_pa_s = 3e-9
pressure-sensor-offset; ; offset_pa = 4e3
contraction-sensor-offset; ; offset = 0.01
force-sensor-offset; ; offset_n = 8.0
";

#[test]
fn the_examples_are_simulated_as_the_effects_of_the_catalogue() {
    let area_m2 = Rig::reference().nominal.muscle.force_per_pressure_m2(0.0);
    let creep_n = (0.04 * area_m2 * 3e5).to_string();
    for line in COMPARED.lines().filter(|line| !line.is_empty()) {
        let fields: Vec<String> = line
            .split(';')
            .map(|field| {
                field
                    .trim()
                    .replace(", ", "\n")
                    .replace("CREEP_N", &creep_n)
            })
            .collect();
        let [name, form, built_in, own @ ..] = &*fields else {
            panic!("{line}");
        };
        let form = match &**form {
            "" => String::new(),
            form => format!("form = \"{form}\"\n"),
        };
        let own = own.first().unwrap_or(built_in);
        compare(name, &(form.clone() + built_in), &(form + own));
    }
}

/// A Maxwell element with one slider, by an update after each step, is the play operator.
#[test]
fn a_memory_is_updated_after_each_step() {
    let declared = "[own_effect.slider]\nsubsystem = \"muscle-force\"\n\
        parameter.held_n = { unit = \"N\", min = 0, max = 1e3, typical = 10, neutral = 0 }\n\
        parameter.reach = { unit = \"1\", min = 1e-3, max = 0.1, typical = 0.01 }\n\
        adds.force_n = \"-held_n * max(min((contraction - at) / reach, 1), -1)\"\n\
        [own_effect.slider.state.at]\nunit = \"1\"\ntypical = 1\nsteady = \"contraction - reach\"\n\
        update = \"max(min(at, contraction + reach), contraction - reach)\"\n\
        after_contraction = \"contraction - reach\"\nafter_extension = \"contraction + reach\"\n";
    let effect = "[[effect]]\nname = \"slider\"\nheld_n = 10.0\nreach = 0.01\n";
    let rig = rig("", &format!("{declared}{effect}")).expect("a rig");
    let drive = steps(1e-3);
    let found = simulate(&rig, &drive, 1e-6).expect("simulated");
    let nominal = Rig::reference().nominal;
    let columns = [PRESSURE_PA, CONTRACTION, FORCE_N];
    let [pressure_pa, contraction, force_n] =
        columns.map(|column| found.require(column).expect("a column"));
    let held_n = |row: usize| {
        let pressure = model_core::pressure::GaugePa(pressure_pa[row]);
        nominal.muscle.force_n(contraction[row], pressure) - force_n[row]
    };
    // What was before the record is estimated.
    let mut at = contraction[0] - 0.01 * held_n(0) / 10.0;
    for (row, contraction) in contraction.iter().enumerate() {
        at = at.clamp(contraction - 0.01, contraction + 0.01);
        let expected_n = 10.0 * (contraction - at) / 0.01;
        // Between two rows 1 ms apart the muscle may turn: at 100 m/s² it moves some 0.01 mm.
        let difference_n = (held_n(row) - expected_n).abs();
        assert!(difference_n < 0.05, "row {row}: {difference_n}");
    }
}

const LEAK: &str = "subsystem = \"gas\"\nparameter.g_kg_per_pa_s = { unit = \"kg/(Pa·s)\", \
                    min = 0, max = 1e-6, typical = 4e-9, neutral = 0 }\n";
const FLOW: &str = "adds.outflow_kg_per_s = \"g_kg_per_pa_s * pressure_pa\"";
const STATE: &str = "state.x = { unit = \"1\", typical = 1, steady = \"0\", rate = \"RATE\" }\n";

/// The table `body` is refused at this line of the file.
fn assert_refused(body: &str, line: usize, expected: &str) {
    let text = format!("[own_effect.mine]\n{body}\n");
    let error = from_toml("mine.toml", &text).expect_err(body);
    assert_eq!(error.line, Some(line), "{error}\n{text}");
    let error = error.to_string();
    assert!(
        error.starts_with("mine.toml:") && error.contains(expected),
        "{error}"
    );
}

#[test]
fn wrong_names_and_units_are_told_with_their_line() {
    let flow = |expression: &str| {
        format!("{LEAK}adds.outflow_kg_per_s = \"g_kg_per_pa_s * {expression}\"")
    };
    assert_refused(&flow("presure_pa"), 4, "did you mean pressure_pa?");
    let units = "expected one unit, found [Pa] in `pressure_pa` and [K] in `temperature_k`";
    assert_refused(&flow("(pressure_pa - temperature_k)"), 4, units);
    let of_flow = "expected an expression in [kg·s^-1], found [";
    assert_refused(&flow("pressure_pa / 3e5 * 1 * temperature_k"), 4, of_flow);
    assert_refused(&flow("1"), 4, of_flow);
    assert_refused(&flow(""), 4, "a number, a name or `(`, found its end");
    let bar = LEAK.replace("Pa·s", "bar·s") + FLOW;
    assert_refused(&bar, 3, "expected a unit of 1, -, kg");
    let inflow = format!("{LEAK}adds.inflow = \"1\"");
    assert_refused(&inflow, 4, "one of outflow_kg_per_s, heat_transfer");
    let gass = "subsystem = \"gass\"\nadds.x = \"1\"";
    assert_refused(gass, 2, "did you mean gas?");
    let quantities = format!("{LEAK}law_quantities = [\"pressure\"]\n{FLOW}");
    assert_refused(&quantities, 4, "did you mean pressure_pa?");
    let add = "subsystem = \"gas\"\nadd.x = \"1\"";
    assert_refused(add, 3, "unknown field `add`");
    let reserved = LEAK.replace("g_kg_per_pa_s", "max") + FLOW;
    assert_refused(&reserved, 3, "a name that is not taken, found max");
    let line = format!("subsystem = \"line\"\n{STATE}adds.delay_s = \"0\"");
    assert_refused(&line, 4, "expected 0 to 0 keys, found 1");
    let large = STATE.replace("typical = 1,", "typical = 1e308,");
    let large = format!("{LEAK}{large}{FLOW}").replace("RATE", "0");
    assert_refused(&large, 4, "a number from 1e-12 to 1e12, found");
    let nothing = "subsystem = \"gas\"\nsource = \"a hole\"";
    assert_refused(nothing, 1, "what the effect `adds`");
}

#[test]
fn what_cannot_be_simulated_is_told_with_its_line() {
    let jump = "g_kg_per_pa_s * pressure_pa * sign(temperature_k - ambient_temperature_k)";
    let jump = format!("{LEAK}adds.outflow_kg_per_s = \"{jump}\"");
    let found = "expected expressions without jumps but at reversals (`direction`), found one at";
    assert_refused(&jump, 4, found);
    let with_state = |constant: &str, rate: &str| {
        let state = STATE.replace("RATE", rate);
        format!(
            "{LEAK}{constant}{state}adds.outflow_kg_per_s = \"g_kg_per_pa_s * pressure_pa * x\""
        )
    };
    let no_rate = "expected an expression in [Hz], found [1]";
    assert_refused(&with_state("", "-1e6 * x"), 4, no_rate);
    let fast = "constant.fast_per_s = { unit = \"1/s\", value = 1e6 }\n";
    let stiff = "expected states with time constants of at least 2e-5 s, found 1.0e-6 s";
    assert_refused(&with_state(fast, "-fast_per_s * x"), 6, stiff);
    let supply = "subsystem = \"supply\"\nadds.supply_pa = \"-drawn_kg_per_s * 1e9\"";
    assert_refused(supply, 3, "found \"drawn_kg_per_s\"");
    let sensor = "subsystem = \"sensor\"\nadds.force_n = \"-1.5 * force_n\"";
    let loops = "the reading could not be inverted (an algebraic loop)";
    assert_refused(sensor, 3, loops);
    // A vented muscle is a little below 0 with an offset of its sensor, a slack one extended.
    for root in ["sqrt(pressure_pa / 1e5)", "ln(pressure_pa / 1e5)"] {
        let root = format!(
            "{LEAK}constant.one_pa = {{ unit = \"Pa\", value = 1 }}\n\
             adds.outflow_kg_per_s = \"g_kg_per_pa_s * one_pa * {}\"",
            root.replace("1e5", "one_pa")
        );
        assert_refused(&root, 5, "expected finite numbers, found ");
    }
    let infinite =
        format!("{LEAK}adds.outflow_kg_per_s = \"g_kg_per_pa_s * pressure_pa / (1 - 1)\"");
    assert_refused(&infinite, 4, "expected ");
    let large = LEAK.replace("4e-9", "4e-5") + FLOW;
    assert_refused(&large, 3, "`typical` in its range");
    let neutral = LEAK.replace("neutral = 0", "neutral = 1e-9") + FLOW;
    let added = "expected nothing to be added where all parameters are `neutral`";
    assert_refused(&neutral, 4, added);
}

#[test]
fn a_file_beside_the_rig_is_read_and_written_into_a_rig_elsewhere() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("mine.toml"), EXAMPLES).expect("written");
    let path = folder.path().join("rig.toml");
    let text = Rig::REFERENCE_TOML.replacen(
        "schema = 1\n",
        "schema = 1\nown_effect_files = [\"mine.toml\"]\n",
        1,
    );
    fs::write(&path, &text).expect("written");
    let mut rig = Rig::read(&path).expect("a rig");
    let kind = rig.catalogue.find("leak").expect("the leak");
    rig.effects
        .push(muscle_plant::effects::Effect::typical(kind, &kind.forms[0]));
    let elsewhere = rig.rewritten(&text).expect("TOML");
    let again = Rig::parse("elsewhere.toml", &elsewhere).expect("a rig");
    assert_eq!(again.effects[0].form.source, kind.forms[0].source);
    assert!(elsewhere.contains("# Pressure that the bladder does not transmit yet"));
    assert_eq!(again.rewritten(&elsewhere).as_ref(), Ok(&elsewhere));
    let missing = text.replace("mine.toml", "none.toml");
    let name = path.display().to_string();
    // Not two of a name, nothing that would be lost, and any spelling of a table.
    let refused = |text: &str| Rig::parse(&name, text).expect_err(text).to_string();
    let twice = refused(&text.replace("\"mine.toml\"", "\"mine.toml\", \"mine.toml\""));
    assert!(
        twice.contains("each effect in one of them, found leak in two"),
        "{twice}"
    );
    let again = format!("{text}\n{EXAMPLES}");
    let again = refused(&again);
    assert!(
        again.contains("effects that no file beside the rig has, found leak"),
        "{again}"
    );
    let other = path.with_file_name("other.toml");
    fs::write(&other, format!("author = \"me\"\n{EXAMPLES}")).expect("written");
    let other = refused(&text.replace("mine.toml", "other.toml"));
    assert!(other.contains("and nothing else, found author"), "{other}");
    let inline = "own_effect.mine = { subsystem = \"line\", adds.delay_s = \"0\" }\n";
    fs::write(path.with_file_name("inline.toml"), inline).expect("written");
    let inline = text.replace("mine.toml", "inline.toml")
        + "\n"
        + "[own_effect.your]\n\
        subsystem = \"line\"\nadds.delay_s = \"0\"\n";
    let both = Rig::parse(&name, &inline)
        .expect("a rig")
        .rewritten(&inline)
        .expect("TOML");
    let both = Rig::parse("both.toml", &both).unwrap_or_else(|error| panic!("{error}\n{both}"));
    assert!(both.catalogue.find("mine").is_some() && both.catalogue.find("your").is_some());
    let error = Rig::parse(&name, &missing)
        .expect_err("no such file")
        .to_string();
    assert!(
        error.contains("none.toml: expected a readable TOML file of effects"),
        "{error}"
    );
}

/// A friction below 0 would drive the weight, and a static one below the Coulomb friction would
/// start it without end.
#[test]
fn a_friction_is_not_taken_below_zero() {
    let less = "[own_effect.oil]\nsubsystem = \"load\"\n\
        parameter.less_n = { unit = \"N\", min = 0, max = 1e3, typical = 1, neutral = 0 }\n\
        adds.coulomb_friction_n = \"-less_n\"\n\
        [own_effect.resin]\nsubsystem = \"load\"\n\
        parameter.more_n = { unit = \"N\", min = 0, max = 1e3, typical = 1, neutral = 0 }\n\
        adds.coulomb_friction_n = \"more_n\"\n";
    let with = |effect: &str| {
        let rig = rig("", &format!("{less}[[effect]]\n{effect}\n")).expect("a rig");
        simulate(&rig, &steps(0.01), 1e-6).unwrap_or_else(|error| panic!("{error}"))
    };
    let column = |record: &Record| record.require(CONTRACTION).expect("a column").to_vec();
    let nominal = Rig::reference().nominal;
    let coulomb_n = match nominal.load {
        muscle_plant::nominal::Load::Weight(weight) => weight.coulomb_friction_n,
        muscle_plant::nominal::Load::Prescribed => 0.0,
    };
    let without = column(&with(&format!("name = \"oil\"\nless_n = {coulomb_n:?}")));
    let below = column(&with(&format!(
        "name = \"oil\"\nless_n = {:?}",
        coulomb_n + 50.0
    )));
    assert_eq!(without, below);
    // Sticky beyond its static friction: it moves, and stops.
    let sticky = column(&with("name = \"resin\"\nmore_n = 40.0"));
    assert!(sticky.iter().any(|contraction| *contraction > 0.05));
}

/// Every block of TOML in docs/own-effect.md that declares an effect is one.
#[test]
fn the_guide_declares_effects_that_are_taken() {
    let blocks = GUIDE.split("```toml\n").skip(1);
    let blocks: Vec<_> = blocks
        .filter_map(|block| block.split("```").next())
        .collect();
    let declared = blocks.iter().filter(|block| block.contains("[own_effect."));
    let mut count = 0;
    for block in declared {
        count += from_toml("own-effect.md", block).expect("effects").len();
    }
    assert!(count >= 2, "{count}");
    assert!(
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../docs/examples/own-effects.toml")
            .exists()
    );
}
