//! A program run with a time limit, its time and memory measured.

use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};
use serde::{Deserialize, Serialize};
use std::io;
use std::process::{Child, Command};
use std::time::{Duration, Instant};
use wait4::Wait4;

/// How long between looks at whether it has ended: a hundredth of the shortest time of interest.
const LOOK: Duration = Duration::from_millis(5);

/// How a program ran.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ended {
    /// Its exit status; none if a signal ended it.
    pub exit: Option<i32>,
    /// It was ended because it took too long.
    pub timed_out: bool,
    /// Time from start to end \[s\].
    pub wall_s: f64,
    /// Time on processors, all threads together \[s\].
    pub cpu_s: f64,
    /// Largest memory it had; never below that of this program, from which it was started.
    pub peak_memory_bytes: u64,
}

impl Ended {
    /// What was wrong with how it ended, in words.
    pub fn fault(&self) -> Option<String> {
        match self.exit {
            _ if self.timed_out => Some(format!("ended after {:.0} s", self.wall_s)),
            Some(0) => None,
            Some(status) => Some(format!("exit status {status}")),
            None => Some("ended by a signal".into()),
        }
    }
}

/// Waits until it has ended or the time is up; the child is left to be reaped.
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
    fn tells_how_it_ended() {
        let ended = shell("exit 3", Duration::from_secs(60));
        assert_eq!(ended.fault().as_deref(), Some("exit status 3"));
        assert!(ended.peak_memory_bytes > 100_000 && ended.wall_s < 50.0);
        let ended = shell("exit 0", Duration::from_secs(60));
        assert_eq!(ended.fault(), None);
        let ended = shell("kill -9 $$", Duration::from_secs(60));
        assert_eq!(ended.fault().as_deref(), Some("ended by a signal"));
    }

    #[test]
    fn ends_what_takes_too_long() {
        let ended = shell("exec sleep 60", Duration::from_millis(200));
        assert!(ended.timed_out && ended.wall_s < 30.0);
        assert_eq!(ended.fault().as_deref(), Some("ended after 0 s"));
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
