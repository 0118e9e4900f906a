//! Wrong inputs that were thought of without looking at the code: exit status 2, one line that says
//! what is wrong where, and no output.
#![cfg(unix)]

use hil_sim::rig::Rig;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const RECORD: &str = "\
time_s,pressure_ref_pa,pressure_pa,contraction
0,2e5,0,0
0.01,2e5,1.9e5,0.03
0.02,2e5,2e5,0.04
0.03,1e5,1.9e5,0.04
";

const TABLE: &str = "\
pressure_bar,contraction_percent,force_n
1,0,65
2,0,344
2,10,176
3,0,624
3,10,371
";

/// The reference rig with something replaced.
fn rig(from: &str, to: &str) -> Vec<u8> {
    assert!(Rig::REFERENCE_TOML.contains(from), "{from}");
    Rig::REFERENCE_TOML.replacen(from, to, 1).into()
}

fn record(from: &str, to: &str) -> Vec<u8> {
    assert!(RECORD.contains(from), "{from}");
    RECORD.replace(from, to).into()
}

fn packed() -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(RECORD.as_bytes()).expect("memory");
    packed.finish().expect("memory")
}

fn mapping(column: &str, unit: &str) -> Vec<u8> {
    format!(
        "[time]\ncolumn = \"time_s\"\nunit = \"s\"\n[columns.pressure_pa]\ncolumn = \"{column}\"\n\
         unit = \"{unit}\"\n"
    )
    .into()
}

/// The file `wrong`, the arguments, and the line that is printed behind `hil-sim: `; `…` in it
/// stands for the names of all effects, and for what the system says.
type Wrong = (fn() -> Vec<u8>, &'static str, &'static str);

const RECORDS: [Wrong; 17] = [
    (
        Vec::new,
        "check wrong",
        "wrong:1: expected a header line with a column `time_s`, found an empty file",
    ),
    (
        || {
            let units = RECORD.encode_utf16().flat_map(u16::to_le_bytes);
            [0xff, 0xfe].into_iter().chain(units).collect()
        },
        "check wrong",
        "wrong:1: expected text in UTF-8, found other bytes (`hil-sim import` reads Latin-1, xlsx, \
         MATLAB, HDF5 and MCAP, and says what converts other formats)",
    ),
    (
        packed,
        "import wrong --out new.csv",
        "wrong: expected an unpacked file (`gunzip wrong`), found gzip",
    ),
    (
        || record("0.01,", "2026-11-24T10:00:00.01Z,"),
        "check wrong",
        "wrong:3: column `time_s`: expected a number or an empty cell, found \
         `2026-11-24T10:00:00.01Z`",
    ),
    (
        || record("0.03,", "0.015,"),
        "check wrong",
        "wrong:5: column `time_s`: expected a time after 0.02, found 0.015 (`hil-sim import` \
         corrects clocks that repeat or restart)",
    ),
    (
        || record("contraction", "pressure_pa"),
        "check wrong",
        "wrong:1: expected each column once, found `pressure_pa` again",
    ),
    (
        || record("1.9e5,0.03", "#DIV/0!,0.03"),
        "check wrong",
        "wrong:3: column `pressure_pa`: expected a number or an empty cell, found `#DIV/0!`",
    ),
    (
        || RECORD.replace(',', ";").replace('.', ",").into(),
        "check wrong",
        "wrong:1: expected a header line with a column `time_s`, found \
         `time_s;pressure_ref_pa;pressure_pa;contraction` (`hil-sim import` reads other names and \
         delimiters)",
    ),
    // Of 1.3 MB, as from a file whose lines were joined.
    (
        || {
            (0..200_000)
                .map(|number| format!("{number},"))
                .collect::<String>()
                .into()
        },
        "check wrong",
        "wrong:1: expected a name for column 200001, found none",
    ),
    (
        || Rig::REFERENCE_TOML.into(),
        "check wrong",
        "wrong:1: expected a header line with a column `time_s`, found `# The paper's rig: \
         Kagawa,Fujita and Kawashima,with the cons` (`hil-sim import` reads other names and \
         delimiters)",
    ),
    (
        || RECORD.into(),
        "diagnose --rig rig.toml --fit wrong --validate wrong --out new",
        "wrong: expected a record that is not fitted too",
    ),
    (
        || record("0.02,2e5", "\"0.02,2e5"),
        "check wrong",
        "wrong:4: expected a closing quote, found the end of the file",
    ),
    (
        || record("contraction\n", "contraction\n[s],[Pa],[Pa],[-]\n"),
        "check wrong",
        "wrong:2: column `time_s`: expected a number or an empty cell, found `[s]` (`hil-sim \
         import` leaves out a row of units, with `skip_after_header = 1` in its mapping)",
    ),
    (
        Vec::new,
        "check folder",
        "folder: expected a readable CSV file, found a folder",
    ),
    (
        || b"%PDF-1.7\n".into(),
        "import wrong --out new.csv",
        "wrong: expected a table as CSV, found a PDF",
    ),
    (
        || b"\n<!doctype HTML>\n<table><tr><td>time_s</td></tr></table>\n".into(),
        "import wrong --out new.csv",
        "wrong: expected a table as CSV, found a web page, whose table a spreadsheet can save",
    ),
    (
        Vec::new,
        "check /dev/zero",
        "/dev/zero: expected a readable CSV file of at most 500 MB, found more",
    ),
];

const RIGS: [Wrong; 14] = [
    (
        || RECORD.into(),
        "rig check wrong",
        "wrong:1: expected a rig in TOML, found `time_s,pressure_ref_pa,pressure_pa,contraction`",
    ),
    (
        Vec::new,
        "simulate --rig folder --drive record.csv --out new.csv",
        "folder: expected a readable TOML file, found a folder",
    ),
    (
        Vec::new,
        "rig check /dev/zero",
        "/dev/zero: expected a readable TOML file of at most 10 MB, found more",
    ),
    (
        || br#"{ "muscle": { "initial_length_m": 0.3 } }"#.into(),
        "rig check wrong",
        "wrong:1: expected a rig in TOML, found JSON",
    ),
    (
        || rig("[load]", "[muscle]"),
        "rig check wrong",
        "wrong:15: expected each key and each section once, found `muscle` again",
    ),
    (
        || rig("beta_m2 = -1.39e-3", "beta_m2 = −1.39e−3"),
        "rig check wrong",
        "wrong:8: expected the minus sign of the keyboard, found −1.39e−3",
    ),
    (
        || [b"# Pr\xfcfstand\n", Rig::REFERENCE_TOML.as_bytes()].concat(),
        "rig check wrong",
        "wrong:1: expected text in UTF-8, found other bytes (`iconv -f LATIN1 -t UTF-8` converts \
         Latin-1)",
    ),
    (
        || rig("mass_kg = 12.0", "mass_kg = \"12 kg\""),
        "rig check wrong",
        "wrong:17: key `load.mass_kg`: expected a number, found string",
    ),
    (
        || rig("mass_kg = 12.0", "mass_kg = 12 kg"),
        "rig check wrong",
        "wrong:17: expected a number without its unit, which the key names, found 12 kg",
    ),
    (
        || rig("[muscle]", "[Muscle]"),
        "rig check wrong",
        "wrong:6: key `Muscle`: expected one of the keys schema, muscle, load, valve, gas, assist, \
         tolerance, effect, own_effect, own_effect_files, provenance, found this: did you mean \
         muscle?",
    ),
    (
        || rig("initial_length_m = 0.3", "initial_length_m = 300"),
        "rig check wrong",
        "wrong:13: key `muscle.initial_length_m`: expected a number from 0.001 to 100, found 300, \
         most likely mm: write 0.3",
    ),
    (
        || {
            rig(
                "# [[effect]]",
                "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = -4e-9",
            )
        },
        "rig check wrong",
        "wrong:41: key `effect.conductance_kg_per_pa_s`: expected a number from 0 to 1e-6, found \
         -4e-9",
    ),
    (
        || rig("# [[effect]]", "[effect]\nname = \"leak\""),
        "rig check wrong",
        "wrong:39: key `effect`: expected sections `[[effect]]`, found a section",
    ),
    (
        || TABLE.replace("pressure_bar", "p").into(),
        "rig new new.toml --muscle wrong --length 0.3",
        "wrong:1: expected a column pressure_pa or pressure_hpa or pressure_mbar or pressure_kpa \
         or pressure_bar or pressure_mpa or pressure_psi, found p, contraction_percent, force_n: \
         did you mean pressure_pa?",
    ),
];

const ARGUMENTS: [Wrong; 23] = [
    (
        || {
            TABLE
                .lines()
                .take(3)
                .flat_map(|line| [line, "\n"])
                .collect::<String>()
                .into()
        },
        "rig new new.toml --muscle wrong --length 0.3",
        "wrong: expected four points with a force, at two contractions and two pressures or more, \
         found 2 that do not determine Eq 1",
    ),
    (
        || TABLE.into(),
        "rig new new.toml --muscle wrong --length 300",
        "invalid value '300' for '--length <M>': expected a number from 0.001 to 100.0 m; \
         if this is mm, write 0.3",
    ),
    (
        || TABLE.into(),
        "rig new new.toml --muscle wrong --length 0,3",
        "invalid value '0,3' for '--length <M>': expected a decimal point",
    ),
    (
        || TABLE.replace("pressure_bar", "pressure_kpa").into(),
        "rig new new.toml --muscle wrong --length 0.3",
        "wrong: expected pressures of a muscle, found none above 3000.000 Pa: is the column in \
         bar, kPa or MPa? Its name has the unit, as `pressure_bar`",
    ),
    (
        || TABLE.into(),
        "rig new new.toml --muscle wrong",
        "the following required arguments were not provided: --length <M> (`hil-sim rig new \
         --help`)",
    ),
    (
        Vec::new,
        "rig new new.toml --valve Q=314l/min",
        "invalid value 'Q=314l/min' for '--valve <VALVE>': a number without its unit behind Q=, \
         found \"314l/min\"",
    ),
    (
        Vec::new,
        "rig new new.toml --valve C=2,1,b=0,35",
        "invalid value 'C=2,1,b=0,35' for '--valve <VALVE>': decimal points, found \
         \"C=2,1,b=0,35\"",
    ),
    (
        Vec::new,
        "rig new new.toml --valve kv=0.59",
        "invalid value 'kv=0.59' for '--valve <VALVE>': one of C, Kv, Cv, Q, from, to, b, found \
         \"kv\" (upper and lower case count)",
    ),
    (
        Vec::new,
        "rig new new.toml --valve C=210",
        "invalid value 'C=210' for '--valve <VALVE>': C=… in dm³/(s·bar), Kv=… in m³/h, Cv=… in US \
         gal/min, or Q=…[,from=…,to=…] in l/min (ANR) between gauge pressures in bar; each with \
         [,b=…] from 0 to 0.6, found \"C=210\"; C is at most 100 dm³/(s·bar)",
    ),
    (
        || RECORD.into(),
        "diagnose --rig rig.toml --fit record.csv --validate wrong --out rig.toml",
        "rig.toml: expected a folder, found a file",
    ),
    (
        || mapping("pressure_pa", "bars"),
        "import record.csv --map wrong --out new.csv",
        "wrong:6: key `columns.pressure_pa.unit`: expected one of Pa, hPa, mbar, kPa, bar, MPa, \
         psi, found `bars`",
    ),
    (
        || mapping("pressure", "Pa"),
        "import record.csv --map wrong --out new.csv",
        "record.csv: column `pressure`: expected one of `time_s`, `pressure_ref_pa`, \
         `pressure_pa`, `contraction`, found none: did you mean pressure_pa?",
    ),
    (
        || RECORD.into(),
        "import wrong --unit bar --out new.csv",
        "--unit: expected COLUMN=UNIT with one of time_s, pressure_ref_pa, pressure_pa, \
         contraction, found \"bar\"",
    ),
    (
        || RECORD.into(),
        "import wrong --out folder",
        "folder: cannot be written: …",
    ),
    (
        Vec::new,
        "completions --dir record.csv",
        "record.csv: expected a folder, found a file",
    ),
    (
        Vec::new,
        "effects leaks",
        "effects: expected one of …, found \"leaks\": did you mean leak?",
    ),
    (
        || RECORD.into(),
        "diagnose --rig rig.toml --fit record.csv --validate wrong --without leek --out new",
        "--without: expected one of …, found \"leek\": did you mean leak?",
    ),
    (
        Vec::new,
        "diagnos --rig rig.toml",
        "unrecognized subcommand 'diagnos'; tip: some similar subcommands exist: 'design', \
         'diagnose' (`hil-sim --help`)",
    ),
    (
        Vec::new,
        "run --seed -1",
        "invalid value '-1' for '--seed <SEED>': expected a whole number of at least 0",
    ),
    (
        || br#"{ "name": "pump", "values": [1, 2] }"#.into(),
        "compare wrong wrong",
        "wrong:1: expected a diagnosis (what `hil-sim diagnose --out` wrote), missing field \
         `schema` at line 1 column 36",
    ),
    (
        || br#""explained""#.into(),
        "compare wrong wrong",
        "wrong:1: expected a diagnosis (what `hil-sim diagnose --out` wrote), invalid type: string \
         \"explained\", expected an object with schema, verdict, effects and gap at line 1 \
         column 11",
    ),
    (
        Vec::new,
        "compare /dev/zero wrong",
        "/dev/zero: expected a diagnosis (what `hil-sim diagnose --out` wrote) of at most 10 MB, \
         found more",
    ),
    (
        Vec::new,
        "settings --port /dev/absent",
        "/dev/absent: expected a serial port that can be opened, …",
    ),
];

/// Whether `told` is `says`, where `…` stands for any words.
fn is(told: &str, says: &str) -> bool {
    if told == says {
        return true;
    }
    match says.split_once('…') {
        Some((begin, end)) => told.starts_with(begin) && told.ends_with(end),
        None => false,
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("the folder");
    let names = entries.map(|entry| entry.expect("an entry").file_name().into_string());
    let mut names: Vec<_> = names.map(|name| name.expect("UTF-8")).collect();
    names.sort();
    names
}

#[test]
fn wrong_inputs_end_in_one_line_that_says_what_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    fs::create_dir(path.join("folder")).expect("a folder");
    fs::write(path.join("record.csv"), RECORD).expect("written");
    let new = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(path)
        .args(["rig", "new"])
        .output()
        .expect("the command runs");
    assert!(new.status.success());
    for (wrong, arguments, says) in RECORDS.iter().chain(&RIGS).chain(&ARGUMENTS) {
        fs::write(path.join("wrong"), wrong()).expect("written");
        let before = names(path);
        let begin = Instant::now();
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .current_dir(path)
            .args(arguments.split(' '))
            .output()
            .expect("the command runs");
        let told = String::from_utf8(output.stderr).expect("text");
        assert_eq!(output.status.code(), Some(2), "{arguments}: {told}");
        assert!(output.stdout.is_empty(), "{arguments}: {told}");
        let line = told
            .strip_prefix("hil-sim: ")
            .and_then(|line| line.strip_suffix('\n'));
        let line = line.expect("a line");
        assert!(
            !line.contains('\n') && is(line, says),
            "{arguments}: {line}\nnot: {says}"
        );
        assert_eq!(names(path), before, "{arguments}");
        // Seconds if the machine is busy; the line of names took minutes.
        assert!(begin.elapsed() < Duration::from_secs(30), "{arguments}");
    }
}
