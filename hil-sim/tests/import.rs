//! Import of other programs' files: converted to records, or refused if they do not fit the
//! mapping.
//!
//! `tests/import` holds MATLAB files as scipy 1 (version 5) and h5py 3 with MATLAB's header (7.3)
//! write them (`make.py` there), a workbook of openpyxl, and logs as mcap, mcap-ros2-support and
//! rosbags write them (`make_logs.py`).

use hil_sim::record::columns::{COLUMNS, Cell};
use hil_sim::record::import::{Imported, Map};
use hil_sim::record::mcap::{McapWriter, Origin};
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, TEMPERATURE_K, VALVE_OPEN};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};

const PLAIN_5: &[u8] = include_bytes!("import/plain5.mat");
const PACKED_5: &[u8] = include_bytes!("import/packed5.mat");
const V_7_3: &[u8] = include_bytes!("import/v73.mat");

const MATLAB: &str = r#"
[time]
column = "t_ms"
unit = "ms"
[columns.pressure_pa]
column = "p"
unit = "bar"
[columns.contraction]
column = "data(:,2)"
unit = "%"
[columns.force_n]
column = "n"
unit = "N"
"#;

/// The time in the first column in seconds, the force in the second.
const SIMPLE: &str = r#"
[time]
column = 1
unit = "s"
[columns.force_n]
column = 2
unit = "N"
"#;

fn map(text: &str) -> Map {
    Map::parse("map.toml", text).expect("a mapping")
}

fn import(map_text: &str, file: &[u8]) -> Imported {
    map(map_text).import("bench.txt", file).expect("a record")
}

fn refused(map_text: &str, file: &[u8]) -> String {
    let imported = map(map_text).import("bench.txt", file);
    imported.expect_err("bad input").to_string()
}

fn close(one: &[f64], other: &[f64]) -> bool {
    one.len() == other.len()
        && one.iter().zip(other).all(|(one, other)| {
            (one - other).abs() <= 1e-12 * (1.0 + other.abs()) || one.is_nan() && other.is_nan()
        })
}

#[test]
fn the_example_mapping_imports_the_example_file() {
    let Imported { record, summary } = import(Map::EXAMPLE_TOML, Map::EXAMPLE_CSV.as_bytes());
    assert!(close(record.time_s(), &[0.0, 0.01, 0.02, 0.025, 0.03]));
    let column = |name| record.column(name).expect("the column");
    assert!(close(column(PRESSURE_PA), &[0.0, 5e4, 1e5, 1.25e5, 1.5e5]));
    assert!(close(
        column(CONTRACTION),
        &[0.0, 0.005, f64::NAN, 0.014, 0.02]
    ));
    assert!(close(column(FORCE_N), &[1.0, 25.5, 51.5, 65.0, 74.5]));
    assert_eq!(
        (summary.format, summary.rows_read, summary.rows_written),
        ("CSV", 5, 5)
    );
    let repeated = &summary.repeated_times;
    assert_eq!(
        (repeated.count, repeated.first, repeated.done),
        (1, Some(8), "spread")
    );
    assert_eq!(summary.restarted_times.count, 0);
    assert_eq!(summary.left_out, ["Bemerkung"]);
    let pressure = &summary.columns[0];
    assert_eq!(
        (pressure.name, pressure.source.as_str()),
        (PRESSURE_PA, "column `Druck`")
    );
    assert_eq!(pressure.conversion, "cell -1.013, in bar, × 100000");
    assert!((pressure.min, pressure.max).eq(&(0.0, 1.5e5)) || close(&[pressure.max], &[1.5e5]));
    assert_eq!(summary.columns[1].missing, 1);
}

#[test]
fn units_are_converted_to_si() {
    let of = |key: &str, unit: &str, cell: &str| {
        let text = format!(
            "[time]\nrate_hz = 10\n[columns.{key}]\ncolumn = 1\nunit = \"{unit}\"\nscale = 2\n\
             offset = 1\n"
        );
        let imported = import(&text, format!("a\n{cell}\n").as_bytes());
        imported.record.column(key).expect("the column")[0]
    };
    for (key, unit, cell, value) in [
        (PRESSURE_PA, "psi", "0", 6_894.757_293_168_361),
        (PRESSURE_PA, "kPa", "49.5", 1e5),
        (TEMPERATURE_K, "degC", "12", 298.15),
        (TEMPERATURE_K, "degF", "38", 298.15),
        (FORCE_N, "lbf", "0", 4.448_221_615_260_5),
        (FORCE_N, "kgf", "2", 5.0 * 9.806_65),
        ("finger_m", "in", "0", 0.0254),
        (CONTRACTION, "%", "12", 0.25),
    ] {
        assert!(close(&[of(key, unit, cell)], &[value]), "{key} {unit}");
    }
}

#[test]
fn times_come_from_a_rate_or_a_column_in_any_unit() {
    let rate = SIMPLE.replace("column = 1\nunit = \"s\"", "rate_hz = 250");
    let imported = import(&rate, b"t,f\n7,1\n7,2\n7,3\n");
    assert!(close(imported.record.time_s(), &[0.0, 0.004, 0.008]));
    for (unit, step_s) in [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("min", 60.0)] {
        let text = SIMPLE.replace("\"s\"", &format!("\"{unit}\""));
        let imported = import(&text, b"t,f\n1,1\n2,2\n");
        assert!(close(imported.record.time_s(), &[step_s, 2.0 * step_s]));
    }
}

#[test]
fn times_that_do_not_increase_are_refused_or_corrected_and_reported() {
    let file = b"t,f\n0,1\n1,2\n1,3\n1,4\n2,5\n0.5,6\n1.5,7\n3,8\n";
    let with = |keys: &str| SIMPLE.replace("unit = \"s\"", &format!("unit = \"s\"\n{keys}"));
    assert_eq!(
        refused(SIMPLE, file),
        "bench.txt:4: column 1: expected a time after 1 s, or `time.repeated` in the mapping, \
         found 1 s"
    );
    let error = refused(&with("repeated = \"drop\""), file);
    assert!(
        error.starts_with("bench.txt:7: column 1: expected a time after 2 s, or"),
        "{error}"
    );

    let dropped = import(&with("repeated = \"drop\"\nrestarted = \"drop\""), file);
    assert!(close(dropped.record.time_s(), &[0.0, 1.0, 2.0, 3.0]));
    assert_eq!(
        dropped.record.column(FORCE_N),
        Some(&[1.0, 2.0, 5.0, 8.0][..])
    );
    let (repeated, restarted) = (
        &dropped.summary.repeated_times,
        &dropped.summary.restarted_times,
    );
    assert_eq!(
        (repeated.count, repeated.first, repeated.done),
        (2, Some(4), "dropped")
    );
    assert_eq!(
        (restarted.count, restarted.first, restarted.done),
        (2, Some(7), "dropped")
    );
    assert_eq!(
        (dropped.summary.rows_read, dropped.summary.rows_written),
        (8, 4)
    );

    let kept = import(
        &with("repeated = \"spread\"\nrestarted = \"continue\""),
        file,
    );
    let (third, two) = (1.0 / 3.0, 2.0 / 3.0);
    let times_s = [0.0, 1.0, 1.0 + third, 1.0 + two, 2.0, 3.0, 4.0, 5.5];
    assert!(
        close(kept.record.time_s(), &times_s),
        "{:?}",
        kept.record.time_s()
    );
    assert_eq!(kept.summary.restarted_times.done, "continued");
    assert_eq!(
        kept.summary.restarted_times.count, 1,
        "the clock was reset once"
    );
    // At the end there is no next time: a period is used.
    let spread = import(&with("repeated = \"spread\""), b"t,f\n0,1\n2,2\n2,3\n");
    assert!(close(spread.record.time_s(), &[0.0, 2.0, 3.0]));
}

#[test]
fn errors_of_cells_name_line_and_column() {
    for (file, message) in [
        (
            &b"t,f\n0,1\n\n1,x\n"[..],
            ":4: column 2: expected a number or an empty cell, found `x`",
        ),
        (
            b"t,f\n0,1\n1\n",
            ":3: column 2: expected this cell, found the end of the row",
        ),
        (
            b"t,f\n0,1\n,2\n",
            ":3: column 1: expected a time in every row, found none",
        ),
        (b"t,f\n0,inf\n", ":2: column 2: expected a finite number"),
        (
            b"t,f\n0,1\n1,2e6\n",
            ":3: column 2: expected what is force_n as a number from -1",
        ),
        (
            b"t,f\n0,\n1,\n",
            ": column 2: expected at least one sample of force_n, found none",
        ),
        (b"t\n0\n", ": column 2: expected one of `t`, found none"),
        (
            b"t,f\n",
            ": column 1: expected at least one row of samples, found none",
        ),
        (
            b"t,f\n1,1\n100000,2\n",
            ": column `time_s`: expected seconds, at most 10000",
        ),
        (
            b"\xff\xfet\0",
            ": expected text in UTF-8 or Latin-1, found UTF-16",
        ),
        (
            b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
            ": expected text, or one of the formats of `hil-sim import --help`, found a byte of 0",
        ),
    ] {
        let error = refused(SIMPLE, file);
        assert!(error.starts_with(&format!("bench.txt{message}")), "{error}");
    }
    let comma = SIMPLE.replace(
        "[time]",
        "[file]\ndelimiter = \";\"\ndecimal_comma = true\n[time]",
    );
    let error = refused(&comma, b"t;f\n0;1.000,5\n");
    assert!(
        error.contains(":2: column 2: expected a number with a decimal comma"),
        "{error}"
    );
    assert_eq!(
        import(&comma, b"t;f\n0;1000,5\n").record.column(FORCE_N),
        Some(&[1000.5][..])
    );
}

#[test]
fn errors_of_layouts_say_what_the_mapping_lacks() {
    let named = SIMPLE.replace("column = 1", "column = \"Zeit\"");
    for (map_text, file, message) in [
        (
            SIMPLE,
            &b""[..],
            ": expected a line with names of columns, found the end of the file",
        ),
        (
            &named,
            b"0,1\n1,2\n",
            ": column `Zeit`: expected one of `0`, `1`, found none; without a line of names \
             `file.header = false` numbers the columns",
        ),
        (
            &named,
            b"Zeit;F\n0;1\n",
            ": column `Zeit`: expected one of `Zeit;F`, found none; is `file.delimiter` ';'?",
        ),
        (
            &named,
            b"Zait,F\n0,1\n",
            ": column `Zeit`: expected one of `Zait`, `F`, found none: did you mean Zait?",
        ),
        // 1,5 N with a decimal comma would be 1 N.
        (
            SIMPLE,
            b"t,f,n\n0,1,5,a\n",
            ":2: expected 3 cells as in the first row, found 4; lines above the names need \
             `skip_lines`, decimal commas another delimiter",
        ),
    ] {
        assert_eq!(refused(map_text, file), format!("bench.txt{message}"));
    }
    // A delimiter at the end of each row is no cell.
    assert_eq!(import(SIMPLE, b"t,f\n0,1,\n1,2,\n").summary.rows_read, 2);
}

#[test]
fn latin_1_and_files_without_a_header_are_read_and_reported() {
    let named = SIMPLE.replace("column = 2", "column = \"Kraft in N/m²\"");
    let imported = import(&named, b"t,Kraft in N/m\xb2\n0,1\n");
    assert_eq!(imported.summary.encoding, Some("Latin-1"));
    let bare = SIMPLE.replace(
        "[time]",
        "[file]\nheader = false\ndelimiter = \"\\t\"\n[time]",
    );
    let imported = import(&bare, b"0\t1\t9\n1\t2\t9\n");
    assert_eq!(imported.record.column(FORCE_N), Some(&[1.0, 2.0][..]));
    assert_eq!(imported.summary.left_out, ["column 3"]);
    assert_eq!(imported.summary.encoding, None);
}

#[test]
fn invalid_mappings_are_refused_with_their_line() {
    for (from, to, message) in [
        (
            "unit = \"s\"",
            "unit = \"h2\"",
            ":4: key `time.unit`: expected one of s, ms,",
        ),
        (
            "unit = \"s\"",
            "",
            ":2: key `time.unit`: expected one of s, ms,",
        ),
        (
            "unit = \"s\"",
            "rate_hz = 3",
            ":2: key `time`: expected either",
        ),
        (
            "column = 1\nunit = \"s\"",
            "rate_hz = 0",
            ":2: key `time.rate_hz`: expected a rate",
        ),
        (
            "columns.force_n",
            "columns.force",
            ":5: key `columns.force`: expected one of pressure",
        ),
        (
            "unit = \"N\"",
            "unit = \"Pa\"",
            ":7: key `columns.force_n.unit`: expected one of N,",
        ),
        (
            "unit = \"N\"",
            "",
            ":5: expected a mapping, missing field `unit`",
        ),
        (
            "unit = \"N\"",
            "unit = \"N\"\nscale = 0",
            ":5: key `columns.force_n`: expected a scale",
        ),
        (
            "column = 2",
            "column = true",
            ":6: expected a mapping, a column's name, or its number",
        ),
        (
            "[time]",
            "[file]\nskip = 1\n[time]",
            ":3: expected a mapping, unknown field `skip`",
        ),
        (
            "[time]",
            "[file]\ndelimiter = \"1\"\n[time]",
            ":3: key `file.delimiter`: expected one",
        ),
        ("[time]", "[time", ":2: expected a mapping,"),
    ] {
        let text = SIMPLE.replace(from, to);
        let error = Map::parse("map.toml", &text).expect_err(to).to_string();
        assert!(error.starts_with(&format!("map.toml{message}")), "{error}");
    }
}

#[test]
fn matlab_files_are_read_in_each_version() {
    for (file, format) in [
        (PLAIN_5, "MATLAB 5"),
        (PACKED_5, "MATLAB 5"),
        (V_7_3, "MATLAB 7.3"),
    ] {
        let Imported { record, summary } = import(MATLAB, file);
        assert_eq!((summary.format, summary.rows_read), (format, 200));
        let t_ms = |row: usize| 10.0 * row as f64;
        let expected =
            |value: fn(f64) -> f64| (0..200).map(|row| value(t_ms(row))).collect::<Vec<_>>();
        let column = |name| record.column(name).expect("the column");
        assert!(close(record.time_s(), &expected(|t_ms| 1e-3 * t_ms)));
        assert!(close(
            column(PRESSURE_PA),
            &expected(|t_ms| 1e5 * (1.0 + (t_ms / 200.0).sin()))
        ));
        assert!(close(
            column(CONTRACTION),
            &expected(|t_ms| (t_ms / 300.0).sin())
        ));
        assert!(close(column(FORCE_N), &expected(|t_ms| t_ms / 10.0)));
    }
    let field = MATLAB.replace("\"p\"", "\"rig.p\"");
    assert_eq!(
        import(&field, V_7_3)
            .record
            .column(PRESSURE_PA)
            .map(<[f64]>::len),
        Some(200)
    );
    assert_eq!(
        refused(&field, PLAIN_5),
        "bench.txt: column `rig.p`: expected one of `t_ms`, `p`, `data(:,1) to (:,2)`, `n`, `s.x`, \
         found none"
    );
    let outside = MATLAB.replace("(:,2)", "(:,3)");
    assert!(refused(&outside, V_7_3).contains("column `data(:,3)`: expected one of"));
}

/// MATLAB 5 bytes of one element.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let length = u32::try_from(data.len()).expect("short");
    let mut bytes = [kind.to_le_bytes(), length.to_le_bytes()].concat();
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// A MATLAB 5 file of 100 kB with a packed variable `t` of twelve million zeros.
fn packed_zeros() -> Vec<u8> {
    let rows: u32 = 12_000_000;
    let parts = [
        element(6, &[6, 0, 0, 0, 0, 0, 0, 0]),
        element(5, &[rows.to_le_bytes(), 1_u32.to_le_bytes()].concat()),
        element(1, b"t"),
        element(9, &vec![0; 8 * rows as usize]),
    ];
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    packed
        .write_all(&element(14, &parts.concat()))
        .expect("memory");
    let packed = packed.finish().expect("memory");
    let mut file = b"MATLAB 5.0".to_vec();
    file.resize(124, b' ');
    file.extend([0, 1, b'I', b'M']);
    file.extend(15_u32.to_le_bytes());
    file.extend(u32::try_from(packed.len()).expect("short").to_le_bytes());
    file.extend(packed);
    file
}

/// Files of h5py 3 whose groups or links lead back, and one whose 1000 bytes are 8 GB of zeros: see
/// `make.py`.
const BACK: &[u8] = include_bytes!("import/back.h5");
const FILLED: &[u8] = include_bytes!("import/filled.h5");
const ONE_DIMENSION: &[u8] = include_bytes!("import/one_dimension.h5");

#[test]
fn small_files_cannot_cost_much() {
    // Without the limits, gigabytes are allocated and written.
    for (file, says) in [
        (
            &packed_zeros()[..],
            "expected a MATLAB file, at most 32000000 unpacked bytes",
        ),
        (BACK, "expected at most 2000 datasets and groups"),
        (
            FILLED,
            "column `t_ms`: expected at most 4000000 numbers of a file of its size, found",
        ),
    ] {
        let error = refused(MATLAB, file);
        assert!(error.contains(says), "{error}");
    }
}

const LINKS: &[u8] = include_bytes!("import/links.h5");
const BOMB: &[u8] = include_bytes!("import/bomb.h5");

/// Imports the file `name` of `folder` by the command: what it says on stderr. A small file takes
/// 2 s of processor time at most, with the process that reads it, and a larger one 0.3 s for each
/// MB, as work beside it on the same core slows it down by two. What fails with 200 MB of memory in
/// either process fails here.
fn cheap(folder: &Path, name: &str, map: &str) -> String {
    let mut child = Command::new("sh")
        .current_dir(folder)
        .args(["-c", "ulimit -v 195312; exec \"$0\" import \"$@\""])
        .arg(env!("CARGO_BIN_EXE_hil-sim"))
        .args([name, "--map", map, "--out", "out.csv"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command runs");
    let mut error = String::new();
    let stderr = child.stderr.as_mut().expect("piped");
    stderr.read_to_string(&mut error).expect("text");
    let used = wait4::Wait4::wait4(&mut child).expect("it ends");
    let lines = usize::from(!used.status.success());
    assert_eq!(error.lines().count(), lines, "{name}: {error}");
    let time_s = (used.rusage.utime + used.rusage.stime).as_secs_f64();
    // Crates without optimisation are slower by a factor of ten and more.
    let limit_s = if cfg!(debug_assertions) {
        30.0
    } else {
        let file = std::fs::metadata(folder.join(name)).expect("the file");
        2.0 + 0.3e-6 * file.len() as f64
    };
    assert!(time_s < limit_s, "{name}: {time_s} s");
    error
}

#[test]
fn small_files_cost_little_by_the_command() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let map = SIMPLE
        .replace("column = 1", "column = \"t_ms\"")
        .replace("column = 2", "column = \"x7\"");
    std::fs::write(path.join("map.toml"), map).expect("written");
    for (name, file, says) in [
        ("back.h5", BACK, "expected at most 2000 datasets and groups"),
        (
            "filled.h5",
            FILLED,
            "expected at most 4000000 numbers of a file of its size",
        ),
        (
            "links.h5",
            LINKS,
            "row 2: expected a time after 0 s, or `time.repeated`",
        ),
        ("bomb.h5", BOMB, "expected a dataset that can be read"),
        (
            "zeros.mat",
            &packed_zeros(),
            "expected a MATLAB file, at most 32000000 unpacked bytes",
        ),
    ] {
        std::fs::write(path.join(name), file).expect("written");
        let error = cheap(path, name, "map.toml");
        assert!(error.contains(says), "{error}");
    }
}

/// Whatever three of its bytes are, in a process of its own as by the command.
#[test]
fn an_hdf5_file_with_changed_bytes_costs_little() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let map = SIMPLE
        .replace("column = 1", "column = \"t\"")
        .replace("column = 2", "column = \"x\"");
    std::fs::write(path.join("map.toml"), map).expect("written");
    let mut random = Pcg64Mcg::seed_from_u64(8);
    for _ in 0..100 {
        let mut file = ONE_DIMENSION.to_vec();
        for _ in 0..3 {
            let place = random.random_range(0..file.len());
            file[place] = random.random();
        }
        std::fs::write(path.join("a.h5"), file).expect("written");
        cheap(path, "a.h5", "map.toml");
    }
}

#[test]
fn fields_of_structs_and_arrays_of_one_dimension_are_read() {
    let struct_field = SIMPLE
        .replace("column = 1", "column = \"t_ms\"")
        .replace("column = 2", "column = \"s.x\"");
    for file in [PLAIN_5, PACKED_5] {
        let record = import(&struct_field, file).record;
        let expected: Vec<f64> = (0..200).map(|row| 10.0 * f64::from(row)).collect();
        assert_eq!(record.column(FORCE_N), Some(&expected[..]));
    }
    let one_dimension = SIMPLE
        .replace("column = 1", "column = \"log.t\"")
        .replace("column = 2", "column = \"log.force\"");
    let record = import(&one_dimension, ONE_DIMENSION).record;
    assert_eq!(record.column(FORCE_N), Some(&[0.0, 1.0, 4.0, 9.0][..]));
}

const SHEET: &[u8] = include_bytes!("import/sheet.xlsx");

/// Of the second sheet: a title, a blank row, names, units.
const SHEET_MAP: &str = r#"
[file]
sheet = "Messung"
skip_lines = 2
skip_after_header = 1
[time]
column = "Zeit"
unit = "ms"
[columns.pressure_pa]
column = "Druck"
unit = "bar"
offset = -1.013
[columns.contraction]
column = "Weg"
unit = "1"
scale = 0.01
[columns.force_n]
column = 5
unit = "N"
scale = 50
"#;

#[test]
fn sheets_of_workbooks_are_read_with_the_layout_of_a_csv_file() {
    let comma = SHEET_MAP.replace("[time]", "decimal_comma = true\ndelimiter = \";\"\n[time]");
    for text in [SHEET_MAP, &comma] {
        let Imported { record, summary } = import(text, SHEET);
        assert!(close(record.time_s(), &[0.0, 0.01, 0.02, 0.03, 0.04]));
        let column = |name| record.column(name).expect("the column");
        assert!(close(column(FORCE_N), &[0.0, 12.5, 25.0, 37.5, 50.0]));
        let contraction = [0.0, 0.015, f64::NAN, 0.045, 0.06];
        assert!(close(column(CONTRACTION), &contraction));
        for (row, pressure_pa) in column(PRESSURE_PA).iter().enumerate() {
            assert!((pressure_pa - 5e4 * row as f64).abs() < 1e-6);
        }
        assert_eq!((summary.format, summary.rows_read), ("xlsx", 5));
        assert_eq!(summary.left_out, ["Uhr", "Bemerkung"]);
        assert_eq!(
            summary.notes,
            ["Sheet `Messung`. `file.sheet` takes another: `Info`."]
        );
    }
    // Dates are days since 1900: half a second is 6e-6 of them, and their digits end at 1e-11.
    let dates = SHEET_MAP.replace("\"Zeit\"\nunit = \"ms\"", "\"Uhr\"\nunit = \"d\"");
    let record = import(&dates, SHEET).record;
    for (row, time_s) in record.time_s().iter().enumerate() {
        let since_s = time_s - record.time_s()[0];
        assert!((since_s - 0.5 * row as f64).abs() < 1e-5, "{since_s}");
    }
}

#[test]
fn errors_in_workbooks_name_sheet_row_and_column() {
    for (from, to, says) in [
        (
            "sheet = \"Messung\"",
            "",
            "bench.txt: expected a line with names of columns, found the end of the file",
        ),
        (
            "\"Messung\"",
            "\"Mesung\"",
            "bench.txt: expected a `file.sheet` of [\"Info\", \"Messung\"], found `Mesung`",
        ),
        (
            "\"Weg\"",
            "\"Bemerkung\"",
            "bench.txt:6: column `Bemerkung`: expected a number or an empty cell, found `a;b, \
             \"c\"`",
        ),
    ] {
        assert_eq!(refused(&SHEET_MAP.replace(from, to), SHEET), says);
    }
}

const LZ4: &[u8] = include_bytes!("import/lz4.mcap");
const ZSTD: &[u8] = include_bytes!("import/zstd.mcap");
const ROS_2: &[u8] = include_bytes!("import/ros2.mcap");
const BAG: &[u8] = include_bytes!("import/bag.mcap");

/// The time in `time`, the force in `force`.
fn log_map(time: &str, force: &str) -> String {
    let map = SIMPLE.replace("column = 1", &format!("column = {time:?}"));
    map.replace("column = 2", &format!("column = {force:?}"))
}

#[test]
fn messages_in_json_are_read_by_topic_and_field() {
    for file in [LZ4, ZSTD] {
        let map = log_map("/rig.log_time_s", "/rig.p.bar")
            + "[columns.valve_open]\ncolumn = \"/rig.is_up\"\nunit = \"1\"\n";
        let Imported { record, summary } = import(&map, file);
        let bar: Vec<f64> = (0..8).map(|row| 1.0 + 0.25 * f64::from(row)).collect();
        assert_eq!(record.column(FORCE_N), Some(&bar[..]));
        assert_eq!(
            record.column(VALVE_OPEN).map(|open| open[3..5].to_vec()),
            Some(vec![0.0, 1.0])
        );
        for (row, time_s) in record.time_s().iter().enumerate() {
            // A double has 2.4e-7 s at the year 2023.
            assert!((time_s - 1.7e9 - 0.01 * row as f64).abs() < 3e-7);
        }
        assert_eq!(summary.format, "MCAP");
        assert_eq!(
            summary.left_out,
            [
                "/force.log_time_s",
                "/force.newtons[0]",
                "/force.newtons[1]"
            ]
        );
    }
}

#[test]
fn topics_are_merged_by_the_time_of_their_log() {
    let pressure = "[columns.pressure_pa]\ncolumn = \"/rig.p.bar\"\nunit = \"bar\"\n";
    let map = log_map("log_time_s", "/force.newtons[1]") + pressure;
    let record = import(&map, ZSTD).record;
    // Every 10 ms the rig; at 0, 25, 40 and 65 ms the force.
    let force_n: Vec<_> = record.column(FORCE_N).expect("a force").to_vec();
    let no = f64::NAN;
    assert!(
        close(&force_n, &[0.0, no, no, 4.0, no, 8.0, no, no, 12.0, no]),
        "{force_n:?}"
    );
    let pressure_pa = record.column(PRESSURE_PA).expect("a pressure");
    assert_eq!(pressure_pa.iter().filter(|cell| cell.is_nan()).count(), 2);
    assert!((record.time_s()[3] - 1.7e9 - 0.025).abs() < 3e-7);
    // Rows of different clocks do not belong together.
    let error = refused(
        &(log_map("/rig.log_time_s", "/force.newtons[1]") + pressure),
        ZSTD,
    );
    assert!(
        error.contains("fields of one topic, or `time.column = \"log_time_s\"`, which merges"),
        "{error}"
    );
    let error = refused(&log_map("/rig.log_time_s", "/rig.q"), ZSTD);
    assert!(
        error.contains("column `/rig.q`: expected one of `/rig.log_time_s`, `/rig.is_up`"),
        "{error}"
    );
}

#[test]
fn messages_of_ros_2_are_read_by_their_definitions() {
    // One topic: the bare names of its fields are enough.
    for (topic, file) in [("/state.", ROS_2), ("", ROS_2)] {
        let field = |name: &str| format!("{topic}{name}");
        let map = log_map(&field("header.stamp"), &field("contraction"))
            + &format!(
                "[columns.pressure_pa]\ncolumn = {:?}\nunit = \"Pa\"\n\
                 [columns.supply_pa]\ncolumn = {:?}\nunit = \"Pa\"\n\
                 [columns.finger_m]\ncolumn = {:?}\nunit = \"m\"\n\
                 [columns.input_force_n]\ncolumn = {:?}\nunit = \"N\"\n",
                field("pressure[0]"),
                field("pressure[1]"),
                field("points[1].y"),
                field("count"),
            );
        let record = import(&map, file).record;
        let column = |name| record.column(name).expect("the column").to_vec();
        assert!((record.time_s()[5] - 1.7e9 - 0.05).abs() < 3e-7);
        let rows = |scale: f64| (0..6).map(|row| scale * f64::from(row)).collect::<Vec<_>>();
        assert_eq!(column(PRESSURE_PA), rows(1e5));
        assert_eq!(column("supply_pa"), [5e5; 6]);
        assert_eq!(column(FORCE_N), rows(0.125));
        assert_eq!(column("input_force_n"), rows(-1.0));
        // The second point is in every third message, behind texts of any length.
        let no = f64::NAN;
        assert!(close(&column("finger_m"), &[no, no, 2.0, no, no, 5.0]));
    }
}

#[test]
fn bags_of_ros_2_are_read() {
    let map = log_map("log_time_s", "/joint_states.effort[1]")
        + "[columns.pressure_pa]\ncolumn = \"/muscle/pressure.fluid_pressure\"\nunit = \"Pa\"\n\
           offset = -101325\n";
    let Imported { record, summary } = import(&map, BAG);
    let rows = |first: f64, step: f64| (0..6).map(move |row| first + step * f64::from(row));
    let expected: Vec<_> = rows(30.0, 1.0).collect();
    assert_eq!(record.column(FORCE_N), Some(&expected[..]));
    let expected: Vec<_> = rows(0.0, 1e4).collect();
    assert_eq!(record.column(PRESSURE_PA), Some(&expected[..]));
    assert!(
        summary
            .left_out
            .contains(&"/joint_states.position[0]".to_owned())
    );
    // Cut off within its second half: what is complete is read, and it is said.
    let cut = &BAG[..1300];
    let cut = import(&map, cut).summary;
    assert!(
        cut.rows_read < 6 && cut.notes[0].starts_with("The file is damaged"),
        "{cut:?}"
    );
}

/// The cells of a tick: time, reference and pressure.
fn ticks() -> Vec<Vec<Cell>> {
    let tick = |row: u32| {
        let cell = |column: &hil_sim::record::columns::Column| match column.name {
            "time_s" => Cell::Number(0.01 * f64::from(row)),
            "pressure_ref_pa" => Cell::Number(2e5),
            "pressure_pa" if row != 1 => Cell::Number(1e5 + f64::from(row)),
            "mode" => Cell::Text("Ready".into()),
            _ => Cell::Missing,
        };
        COLUMNS.iter().map(cell).collect()
    };
    (0..4).map(tick).collect()
}

#[test]
fn a_log_of_this_program_needs_no_mapping() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("assist.mcap");
    let mut writer = McapWriter::create(&path, &Origin::default()).expect("created");
    for (row, cells) in ticks().iter().enumerate() {
        writer.push(0.01 * row as f64, cells).expect("written");
    }
    writer.finish().expect("written");
    let done = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder.path())
        .args(["import", "assist.mcap", "--out", "assist.csv"])
        .output()
        .expect("the command runs");
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    let written = std::fs::read_to_string(folder.path().join("assist.csv")).expect("a record");
    assert_eq!(
        written,
        "time_s,pressure_ref_pa,pressure_pa\n0,200000,100000\n0.01,200000,\n\
         0.02,200000,100002\n0.03,200000,100003\n"
    );
    let other = Map::of_record("a.csv", b"Zeit;Druck\n0;1\n", &[]).expect_err("other names");
    assert!(
        other
            .to_string()
            .contains("found Zeit, Druck; a mapping (`hil-sim import --example`)"),
        "{other}"
    );
}

#[test]
fn a_record_from_a_spreadsheet_needs_no_mapping() {
    for text in [
        "time_s;pressure_pa;note\n0;1,5;a, b\n0,01;1,75;c\n",
        "time_s\tpressure_pa\tnote\n0\t1.5\t1,2 m\n0.01\t1.75\t\n",
        "time_s,pressure_pa,note\n0,1.5,a;b\n0.01,1.75,\n",
    ] {
        let map = Map::of_record("a.csv", text.as_bytes(), &["pressure_pa=bar".into()]);
        let imported = map.expect("a record").import("a.csv", text.as_bytes());
        let record = imported.expect("a record").record;
        assert!(close(record.time_s(), &[0.0, 0.01]), "{text}");
        let pressure_pa = record.column(PRESSURE_PA).expect("the column");
        assert!(close(pressure_pa, &[1.5e5, 1.75e5]), "{text}");
    }
}

/// A ZIP file of parts.
fn zip_of(parts: Vec<(String, Box<dyn Read>)>) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, mut bytes) in parts {
        zip.start_file(name, zip::write::SimpleFileOptions::default())
            .expect("memory");
        std::io::copy(&mut bytes, &mut zip).expect("memory");
    }
    zip.finish().expect("memory").into_inner()
}

/// A workbook as [`SHEET`] with one part in another form.
fn with_part(replaced: &str, bytes: impl Read + 'static) -> Vec<u8> {
    let mut book = zip::ZipArchive::new(Cursor::new(SHEET)).expect("a workbook");
    let mut parts: Vec<(String, Box<dyn Read>)> = vec![(replaced.to_owned(), Box::new(bytes))];
    for index in 0..book.len() {
        let mut part = book.by_index(index).expect("a part");
        let name = part.name().expect("a name").into_owned();
        let mut bytes = Vec::new();
        part.read_to_end(&mut bytes).expect("a part");
        if name != replaced {
            parts.push((name, Box::new(Cursor::new(bytes))));
        }
    }
    zip_of(parts)
}

/// An MCAP file with one packed chunk of messages `data`.
fn log_of(encoding: &str, schema: &str, data: &[u8], count: u32) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let options = WriteOptions::new().compression(Some(Compression::Zstd));
    let options = options.chunk_size(None).emit_message_indexes(false);
    let mut writer = options.create(&mut file).expect("memory");
    let schema = writer
        .add_schema("a/B", "ros2msg", schema.as_bytes())
        .expect("memory");
    let channel = writer
        .add_channel(schema, "/t", encoding, &BTreeMap::new())
        .expect("memory");
    let header = MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    for _ in 0..count {
        writer
            .write_to_known_channel(&header, data)
            .expect("memory");
    }
    writer.finish().expect("memory");
    drop(writer);
    file.into_inner()
}

/// What makes a small file that would take gigabytes or minutes, and what is said of it.
type Small = (&'static str, fn() -> Vec<u8>, &'static str);

const STRINGS: &str = "xl/sharedStrings.xml";

const SMALL: [Small; 9] = [
    (
        "spaces.xlsx",
        || with_part(STRINGS, std::io::repeat(b' ').take(60_000_000)),
        "unpacked bytes, found more",
    ),
    (
        "wide.xlsx",
        || {
            let row = "<row r=\"ROW\"><c r=\"XFDROW\"><v>1</v></c></row>";
            let rows = (1..100_000).map(|number| row.replace("ROW", &number.to_string()));
            let rows: String = rows.collect();
            let sheet = format!("<worksheet><sheetData>{rows}</sheetData></worksheet>");
            with_part("xl/worksheets/sheet2.xml", Cursor::new(sheet))
        },
        "cells of at most",
    ),
    (
        "below.xlsx",
        || {
            let row = "<row r=\"1\"><c r=\"A274682349\"><v>1</v></c></row>";
            let sheet = format!("<worksheet><sheetData>{row}</sheetData></worksheet>");
            with_part("xl/worksheets/sheet2.xml", Cursor::new(sheet))
        },
        "cells of at most",
    ),
    (
        "count.xlsx",
        || {
            let strings = "<sst uniqueCount=\"1000000000000000000\"><si><t>a</t></si></sst>";
            with_part(STRINGS, Cursor::new(strings))
        },
        "",
    ),
    (
        "texts.xlsx",
        || {
            let texts = "<sst>".to_owned() + &"<si><t>a</t></si>".repeat(1_500_000) + "</sst>";
            with_part(STRINGS, Cursor::new(texts))
        },
        "",
    ),
    (
        "zeros.mcap",
        || log_of("json", "", &vec![0; 40_000_000], 1),
        "unpacked bytes, found more",
    ),
    (
        "many.mcap",
        || log_of("json", "", b"{\"a\":1}", 1_000_000),
        "unpacked bytes, found more",
    ),
    (
        "nested.mcap",
        || {
            let deep = [&[0, 1, 0, 0], &[1_u8, 0, 0, 0].repeat(1000)[..]].concat();
            log_of("cdr", "B[] a\n===\nMSG: a/B\nB[] a", &deep, 10)
        },
        "found ones within each other",
    ),
    (
        "long.mcap",
        || log_of("cdr", "uint8[] a", &[0, 1, 0, 0, 255, 255, 255, 255], 10),
        "expected 4294967295 values of a, found 0 bytes",
    ),
];

#[test]
fn small_workbooks_and_logs_cannot_cost_much() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("sheet.toml"), SHEET_MAP).expect("written");
    std::fs::write(folder.path().join("log.toml"), log_map("log_time_s", "a")).expect("written");
    for (name, file, says) in SMALL {
        let file = file();
        assert!(file.len() < 1_000_000, "{name}: {}", file.len());
        std::fs::write(folder.path().join(name), &file).expect("written");
        let map = if name.ends_with("xlsx") {
            "sheet.toml"
        } else {
            "log.toml"
        };
        let error = cheap(folder.path(), name, map);
        assert!(error.contains(says), "{name}: {error}");
    }
}

#[test]
fn a_long_chunk_is_refused_with_the_limit_of_a_chunk() {
    let file = log_of("json", "", &vec![0; 1 << 26], 1);
    let error = hil_sim::record::mcap::parse("long.mcap", &file).expect_err("too long");
    assert_eq!(
        error.to_string(),
        "long.mcap: expected at most 67108864 unpacked bytes in a chunk, found more"
    );
}

#[test]
fn other_formats_are_named_with_the_command_that_converts_them() {
    for (file, says) in [
        (
            &zip_of(vec![("mimetype".into(), Box::new(Cursor::new("ods")))])[..],
            "`libreoffice --headless --convert-to csv bench.txt`",
        ),
        (b"ULog\x01\x12\x35\x01", "`ulog2csv bench.txt`"),
        (b"\x1f\x8b\x08", "`gunzip bench.txt`"),
        (b"MDF     4.10", "asammdf.MDF('bench.txt').export('csv')"),
        (b"PAR1", "found Parquet"),
        (b"SQLite format 3\0", "sqlite3 -header -csv bench.txt"),
    ] {
        let error = refused(SIMPLE, file);
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn a_damaged_hdf5_file_ends_the_command_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("map.toml"), MATLAB).expect("written");
    for (file, is_record) in [(V_7_3, true), (FILLED, false), (&V_7_3[..9000], false)] {
        std::fs::write(folder.path().join("a.mat"), file).expect("written");
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .current_dir(folder.path())
            .args(["import", "a.mat", "--map", "map.toml", "--out", "b.csv"])
            .output()
            .expect("the command runs");
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.success(), is_record, "{error}");
        assert_eq!(error.lines().count(), usize::from(!is_record), "{error}");
    }
}

#[test]
fn the_command_prints_a_summary_and_does_not_overwrite_its_inputs() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |args: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .current_dir(folder.path())
            .arg("import")
            .args(args)
            .output()
            .expect("the command runs")
    };
    let example = run(&["--example"]);
    std::fs::write(folder.path().join("map.toml"), &example.stdout).expect("written");
    std::fs::write(folder.path().join("a.csv"), Map::EXAMPLE_CSV).expect("written");
    let words = run(&["a.csv", "--map", "map.toml", "--out", "b.csv"]);
    let text = String::from_utf8_lossy(&words.stdout);
    assert!(
        words.status.success(),
        "{}",
        String::from_utf8_lossy(&words.stderr)
    );
    for said in [
        "5 rows read, 5 written",
        "spread, the first in line 8",
        "Left out: Bemerkung",
    ] {
        assert!(text.contains(said), "{text}");
    }
    assert!(folder.path().join("b.csv").exists());
    let json = run(&["a.csv", "--map", "map.toml", "--out", "b.csv", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    assert_eq!(json["columns"][2]["name"], "force_n");
    for out in ["a.csv", "map.toml"] {
        let spared = run(&["a.csv", "--map", "map.toml", "--out", out]);
        assert_eq!(spared.status.code(), Some(2));
    }
    assert_eq!(run(&["a.csv"]).status.code(), Some(2));
}

proptest! {
    /// A damaged file is refused or read; the program never panics.
    #[test]
    fn damaged_matlab_files_cause_no_panic(
        which in 0..3_usize,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
    ) {
        let mut file = [PLAIN_5, PACKED_5, V_7_3][which].to_vec();
        for (place, byte) in damage {
            let place = place.index(file.len());
            file[place] = byte;
        }
        if is_cut {
            file.truncate(cut.index(file.len()));
        }
        let _ = map(MATLAB).import("bench.mat", &file);
    }
}
