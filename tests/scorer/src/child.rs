//! Runs a program with a time limit, and measures its time and memory.

use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};
use serde::{Deserialize, Serialize};
use std::io;
use std::process::{Child, Command};
use std::time::{Duration, Instant};
use wait4::Wait4;

/// Polling interval: a hundredth of the shortest time of interest.
const LOOK: Duration = Duration::from_millis(5);

/// How a program ended, with its time and memory.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ended {
    /// Its exit status; `None` if a signal ended it.
    pub exit: Option<i32>,
    /// Whether it exceeded the time limit.
    pub timed_out: bool,
    /// Time from start to end \[s\].
    pub wall_s: f64,
    /// CPU time of all threads \[s\].
    pub cpu_s: f64,
    /// Peak memory, at least that of this program, from which it was started.
    pub peak_memory_bytes: u64,
}

impl Ended {
    /// Description of an abnormal end.
    pub fn fault(&self) -> Option<String> {
        match self.exit {
            _ if self.timed_out => Some("ended at the time limit".into()),
            Some(0) => None,
            Some(status) => Some(format!("exit status {status}")),
            None => Some("ended by a signal".into()),
        }
    }
}

/// Waits until the child has ended or the time limit; does not reap it.
fn ends_within(child: &Child, limit: Duration) -> io::Result<bool> {
    let id = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    let id = WaitId::Pid(id.ok_or(io::ErrorKind::NotFound)?);
    let started = Instant::now();
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT | WaitIdOptions::NOHANG;
    while waitid(id.clone(), options)?.is_none() {
        if started.elapsed() > limit {
            return Ok(false);
        }
        std::thread::sleep(LOOK);
    }
    Ok(true)
}

/// Runs `command` to its end, or ends it after `limit`.
///
/// # Errors
/// It cannot be started.
pub fn run(command: &mut Command, limit: Duration) -> io::Result<Ended> {
    let started = Instant::now();
    let mut child = command.spawn()?;
    let in_time = ends_within(&child, limit);
    if !matches!(in_time, Ok(true)) {
        // it may have ended by itself just now
        let _ = child.kill();
    }
    let used = child.wait4()?;
    let wall_s = started.elapsed().as_secs_f64();
    Ok(Ended {
        exit: used.status.code(),
        timed_out: !in_time?,
        wall_s,
        cpu_s: (used.rusage.utime + used.rusage.stime).as_secs_f64(),
        peak_memory_bytes: used.rusage.maxrss,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str, limit: Duration) -> Ended {
        run(Command::new("sh").args(["-c", script]), limit).expect("a shell")
    }

    #[test]
    fn reports_exit_status_and_signals() {
        let ended = shell("exit 3", Duration::from_secs(60));
        assert_eq!(ended.fault().as_deref(), Some("exit status 3"));
        assert!(ended.peak_memory_bytes > 100_000);
        let ended = shell("exit 0", Duration::from_secs(60));
        assert_eq!(ended.fault(), None);
        let ended = shell("kill -9 $$", Duration::from_secs(60));
        assert_eq!(ended.fault().as_deref(), Some("ended by a signal"));
    }

    #[test]
    fn ends_a_program_at_the_time_limit() {
        let ended = shell("exec sleep 60", Duration::from_millis(200));
        // By a signal: it was not waited for.
        assert!(ended.timed_out && ended.exit.is_none(), "{ended:?}");
        assert_eq!(ended.fault().as_deref(), Some("ended at the time limit"));
    }

    #[test]
    fn measures_memory() {
        // dd's buffer is 300 MB
        let script = "exec dd if=/dev/zero of=/dev/null bs=300M count=1 2>/dev/null";
        let ended = shell(script, Duration::from_secs(60));
        assert!(ended.peak_memory_bytes > 250_000_000, "{ended:?}");
        assert!(ended.cpu_s > 0.0);
    }
}
