//! The memory that `import` takes for large CSV files. How long it takes is a benchmark.
//!
//! In a program of its own: on Linux the peak memory of a child is at least that of the process
//! that starts it.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use wait4::Wait4;

const FILE_BYTES: usize = 10_000_000;
/// Text, times and samples of five million rows are 90 MB.
const MEMORY_BYTES: u64 = 100_000_000;

/// Most memory that the import of a file takes, which is `row` for the numbers from 0 on, again and
/// again up to 10 MB \[bytes\].
fn peak(map: &str, header: &str, row: fn(u32, &mut String)) -> u64 {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    std::fs::write(path.join("map.toml"), map).expect("written");
    write_rows(&path.join("rows.csv"), header, row).expect("written");
    let mut child = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(path)
        .args(["-q", "import", "rows.csv", "--map", "map.toml", "--out"])
        .arg("out.csv")
        .stdout(Stdio::null())
        .spawn()
        .expect("the command runs");
    let used = child.wait4().expect("it ends");
    assert!(used.status.success());
    used.rusage.maxrss
}

fn write_rows(path: &Path, header: &str, row: fn(u32, &mut String)) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    file.write_all(header.as_bytes())?;
    let (mut written, mut line) = (header.len(), String::new());
    for number in 0.. {
        if written >= FILE_BYTES {
            break;
        }
        line.clear();
        row(number, &mut line);
        line.push('\n');
        file.write_all(line.as_bytes())?;
        written += line.len();
    }
    file.flush()
}

fn assert_small(what: &str, bytes: u64) {
    assert!(bytes < MEMORY_BYTES, "{what}: {bytes} bytes");
}

#[test]
fn ten_megabytes_of_single_digits_need_less_than_100_mb() {
    let at_a_rate = "[file]\nheader = false\n[time]\nrate_hz = 100\n[columns.force_n]\n\
                     column = 1\nunit = \"N\"\n";
    let bytes = peak(at_a_rate, "", |_, line| line.push('1'));
    assert_small("a column at a rate", bytes);
    let with_times = "[time]\ncolumn = \"t\"\nunit = \"ms\"\nrestarted = \"continue\"\n\
                      [columns.force_n]\ncolumn = \"f\"\nunit = \"N\"\n";
    let bytes = peak(with_times, "t,f\n", |number, line| {
        let _ = write!(line, "{},1", number % 10);
    });
    assert_small("times and a column", bytes);
}

#[test]
fn ten_megabytes_of_long_decimals_need_less_than_100_mb() {
    let map = "[time]\ncolumn = 1\nunit = \"s\"\n[columns.force_n]\ncolumn = 2\nunit = \"N\"\n";
    let bytes = peak(map, "t,f\n", |number, line| {
        let (seconds, hundredths) = (number / 100, number % 100);
        let _ = write!(
            line,
            "{seconds}.{hundredths:02},{}.123456789012",
            number % 1000
        );
    });
    assert_small("times and decimals", bytes);
}

#[test]
fn ten_megabytes_of_many_columns_need_less_than_100_mb() {
    // All that a record can have, beside a hundred others.
    let columns = [
        ("pressure_ref_pa", "Pa"),
        ("pressure_pa", "Pa"),
        ("contraction", "%"),
        ("force_n", "N"),
        ("finger_m", "m"),
        ("input_force_n", "N"),
        ("supply_pa", "Pa"),
        ("temperature_k", "K"),
        ("valve_open", "1"),
    ];
    for others in [0, 100] {
        let mut map = String::from("[file]\nheader = false\n[time]\nrate_hz = 100\n");
        for (place, (name, unit)) in columns.iter().enumerate() {
            let column = place + 1;
            let _ = write!(
                map,
                "[columns.{name}]\ncolumn = {column}\nunit = \"{unit}\"\n"
            );
        }
        let row: fn(u32, &mut String) = match others {
            0 => |_, line| line.push_str("1,1,1,1,1,1,1,1,1"),
            _ => |_, line| {
                line.push('1');
                (0..108).for_each(|_| line.push_str(",1"));
            },
        };
        assert_small(&format!("and {others} other columns"), peak(&map, "", row));
    }
}
