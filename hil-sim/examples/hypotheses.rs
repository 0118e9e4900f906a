//! Prints, as JSON, how probable each set of missing effects is: the method by which `diagnose` is
//! to decide, to be measured until it is better than today's.
//!
//!     cargo run --release --example hypotheses -- rig.toml a.csv b.csv

use hil_sim::error::BadInput;
use hil_sim::identify::hypotheses::hypotheses;
use hil_sim::record::Record;
use hil_sim::rig::Rig;
use std::path::Path;
use std::process::ExitCode;

fn json(arguments: &[String]) -> Result<String, BadInput> {
    let Some((rig, records)) = arguments.split_first() else {
        return Err(BadInput::file("arguments", "a rig, then records"));
    };
    let rig = Rig::read(Path::new(rig))?;
    let records = records.iter().map(|path| Record::read(Path::new(path)));
    let records = records.collect::<Result<Vec<_>, _>>()?;
    let posterior = hypotheses(&rig, &records, &[])?;
    serde_json::to_string_pretty(&posterior)
        .map_err(|error| BadInput::file("the result", error.to_string()))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match json(&arguments) {
        Ok(json) => {
            println!("{json}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("hypotheses: {error}");
            ExitCode::from(2)
        }
    }
}
