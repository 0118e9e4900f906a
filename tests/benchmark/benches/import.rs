//! How long 10 MB of CSV take to import: `cargo bench --bench import`. The goal is a second.
//!
//! The memory is a test of hil-sim (`import_memory`).

use hil_sim::record::import::Map;
use std::time::Instant;

const FILE_BYTES: usize = 10_000_000;

const AT_A_RATE: &str = "\
[file]
header = false
[time]
rate_hz = 100
[columns.force_n]
column = 1
unit = \"N\"
";
const WITH_TIMES: &str = "\
[file]
header = false
[time]
column = 1
unit = \"s\"
[columns.force_n]
column = 2
unit = \"N\"
";

/// The line of a row.
type Row = fn(u32) -> String;

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let repeats = if quick { 1 } else { 5 };
    let shapes: [(&str, &str, Row); 3] = [
        ("single digits", AT_A_RATE, |_| "1\n".into()),
        ("long decimals", WITH_TIMES, |row| {
            let (seconds, hundredths) = (row / 100, row % 100);
            format!("{seconds}.{hundredths:02},{}.123456789012\n", row % 1000)
        }),
        ("a hundred columns", AT_A_RATE, |_| {
            format!("1{}\n", ",1".repeat(99))
        }),
    ];
    for (what, map, row) in shapes {
        let mut file = String::new();
        for number in 0.. {
            if file.len() >= FILE_BYTES {
                break;
            }
            file += &row(number);
        }
        let map = Map::parse("map.toml", map).expect("a mapping");
        let out = std::env::temp_dir().join(format!("import-{}.csv", std::process::id()));
        let once = || {
            let start = Instant::now();
            let imported = map.import("file.csv", file.as_bytes()).expect("a record");
            imported.record.write(&out).expect("written");
            start.elapsed().as_secs_f64()
        };
        let mut times_s: Vec<f64> = (0..repeats).map(|_| once()).collect();
        times_s.sort_by(f64::total_cmp);
        std::fs::remove_file(&out).expect("it was written");
        let rows = file.lines().count();
        println!("{what:20} {rows:8} rows: {:.2} s", times_s[repeats / 2]);
    }
}
