//! Gaps that the scorer computes from simulations of the nominal and the fitted rig.

use crate::child;
use hil_sim::record::Record;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Root mean square by signal, in the column's unit.
pub type BySignal = BTreeMap<String, f64>;

/// Relative excess over the noise below which a gap counts as zero.
const LEAST_EXCESS: f64 = 0.1;

/// The gaps of several records.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gaps {
    /// Gaps of the nominal rig.
    pub before: BySignal,
    /// Gaps of the fitted rig.
    pub after: BySignal,
}

/// Sum of squared differences, and their number.
#[derive(Default)]
struct Sums(BTreeMap<String, (f64, usize)>);

impl Sums {
    fn add(&mut self, signal: &str, measured: &Record, simulated: &Record) -> Result<(), String> {
        let missing = || format!("no `{signal}` was simulated");
        let measured = measured.column(signal).ok_or("not measured")?;
        let simulated = simulated.column(signal).ok_or_else(missing)?;
        if simulated.len() != measured.len() {
            return Err("the simulation has other times than the record".into());
        }
        let (squares, count) = self.0.entry(signal.into()).or_default();
        for (simulated, measured) in simulated.iter().zip(measured) {
            if !measured.is_nan() && !simulated.is_nan() {
                *squares += (simulated - measured).powi(2);
                *count += 1;
            }
        }
        if 2 * *count > measured.len() {
            Ok(())
        } else {
            Err(format!("most of `{signal}` was not simulated"))
        }
    }

    fn rms(self) -> BySignal {
        let rms = |(signal, (squares, count))| (signal, f64::sqrt(squares / count as f64));
        self.0.into_iter().map(rms).collect()
    }
}

/// Runs `program simulate` for one rig on one record.
fn simulate(program: &Path, rig: &Path, drive: &Path, limit: Duration) -> Result<Record, String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let out = folder.path().join("simulated.csv");
    let mut command = Command::new(program);
    command.arg("simulate").arg("--rig").arg(rig);
    command.arg("--drive").arg(drive).arg("--out").arg(&out);
    let errors = folder.path().join("stderr.txt");
    let file = std::fs::File::create(&errors).map_err(|error| error.to_string())?;
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(file);
    let ended = child::run(&mut command, limit).map_err(|error| error.to_string())?;
    let rig = rig.file_name().unwrap_or_default().to_string_lossy();
    match ended.fault() {
        Some(fault) => {
            let said = std::fs::read_to_string(&errors).unwrap_or_default();
            Err(format!("simulate with {rig}: {fault}: {}", said.trim()))
        }
        None => Record::read(&out).map_err(|error| format!("simulate with {rig}: {error}")),
    }
}

/// The gaps between the simulation of each rig and the `records`.
///
/// # Errors
/// A rig cannot be simulated, in words.
pub fn measure(
    program: &Path,
    [nominal, fitted]: [&Path; 2],
    records: &[PathBuf],
    signals: &[&str],
    limit: Duration,
) -> Result<Gaps, String> {
    let of_rig = |rig: &Path| -> Result<BySignal, String> {
        let mut sums = Sums::default();
        for path in records {
            let measured = Record::read(path).map_err(|error| error.to_string())?;
            let simulated = simulate(program, rig, path, limit)?;
            for signal in signals {
                sums.add(signal, &measured, &simulated)?;
            }
        }
        Ok(sums.rms())
    };
    Ok(Gaps {
        before: of_rig(nominal)?,
        after: of_rig(fitted)?,
    })
}

impl Gaps {
    /// Share of the gap above the noise that is removed: (before − after)/(before − noise), each a
    /// sum over the signals in units of their noise. `None` if the gap counts as zero.
    pub fn share_removed(&self, noise: &BySignal) -> Option<f64> {
        let sum = |gaps: &BySignal| -> Option<f64> {
            noise
                .iter()
                .map(|(signal, noise)| Some(gaps.get(signal)? / noise))
                .sum()
        };
        let (before, after) = (sum(&self.before)?, sum(&self.after)?);
        let floor = noise.len() as f64;
        let excess = before - floor;
        (excess > LEAST_EXCESS * floor).then(|| (before - after) / excess)
    }

    /// The same of one signal.
    pub fn share_removed_of(&self, signal: &str, noise: &BySignal) -> Option<f64> {
        let only: BySignal = noise
            .get_key_value(signal)
            .map(|(k, v)| (k.clone(), *v))
            .into_iter()
            .collect();
        if only.is_empty() {
            None
        } else {
            self.share_removed(&only)
        }
    }

    /// Largest relative difference from `claimed`, over the signals.
    pub fn largest_difference(&self, claimed: &Gaps) -> f64 {
        let one = |measured: &BySignal, claimed: &BySignal| {
            let differences = measured.iter().map(|(signal, value)| {
                let claimed = claimed.get(signal).copied().unwrap_or(f64::INFINITY);
                (claimed - value).abs() / value
            });
            differences.fold(0.0, f64::max)
        };
        one(&self.before, &claimed.before).max(one(&self.after, &claimed.after))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_signal(pressure_pa: f64, contraction: f64) -> BySignal {
        [("pressure_pa", pressure_pa), ("contraction", contraction)]
            .map(|(signal, value)| (signal.to_owned(), value))
            .into()
    }

    #[test]
    fn the_share_is_relative_to_the_gap_above_the_noise() {
        let noise = by_signal(100.0, 1e-4);
        let gaps = |after| Gaps {
            before: by_signal(1100.0, 1e-4),
            after,
        };
        assert_eq!(
            gaps(by_signal(100.0, 1e-4)).share_removed(&noise),
            Some(1.0)
        );
        assert_eq!(
            gaps(by_signal(600.0, 1e-4)).share_removed(&noise),
            Some(0.5)
        );
        // a larger gap of another signal reduces the share
        assert_eq!(
            gaps(by_signal(600.0, 6e-4)).share_removed(&noise),
            Some(0.0)
        );
        let shares = gaps(by_signal(350.0, 1e-4));
        assert_eq!(shares.share_removed_of("pressure_pa", &noise), Some(0.75));
        assert_eq!(shares.share_removed_of("contraction", &noise), None);
        assert_eq!(shares.share_removed_of("force_n", &noise), None);
        // a gap of a signal is missing: no share
        assert_eq!(Gaps::default().share_removed(&noise), None);
    }

    #[test]
    fn claimed_gaps_are_compared_with_computed_ones() {
        let measured = Gaps {
            before: by_signal(1000.0, 1e-3),
            after: by_signal(100.0, 1e-4),
        };
        let mut claimed = measured.clone();
        assert_eq!(measured.largest_difference(&claimed), 0.0);
        claimed.after.insert("pressure_pa".into(), 50.0);
        assert_eq!(measured.largest_difference(&claimed), 0.5);
        claimed.after.remove("contraction");
        assert_eq!(measured.largest_difference(&claimed), f64::INFINITY);
    }

    #[test]
    fn only_samples_in_both_records_are_compared() {
        let record = |text: &str| Record::parse("x.csv", text.as_bytes()).expect("a record");
        let measured = record("time_s,contraction\n0,0.1\n1,\n2,0.3\n3,0.4\n");
        let simulated = record("time_s,contraction\n0,0.1\n1,0.2\n2,0.3\n3,0.7\n");
        let mut sums = Sums::default();
        sums.add("contraction", &measured, &simulated)
            .expect("enough");
        assert!((sums.rms()["contraction"] - 0.3 / 3.0_f64.sqrt()).abs() < 1e-12);
        let empty = record("time_s,contraction\n0,0.1\n1,\n2,\n3,\n");
        let longer = record("time_s,contraction\n0,0.1\n");
        let mut sums = Sums::default();
        assert!(sums.add("contraction", &measured, &empty).is_err());
        assert!(sums.add("contraction", &measured, &longer).is_err());
        assert!(sums.add("force_n", &measured, &simulated).is_err());
    }
}
