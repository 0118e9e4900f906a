//! Hands memory.x to the linker, and the commit to `link::Identity`.

use std::{env, fs, path::PathBuf, process::Command};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy("memory.x", out.join("memory.x")).expect("memory.x stands beside this");
    println!("cargo:rustc-link-search={}", out.display());
    // The logs' sections; here, as not every program for this CPU logs.
    println!("cargo:rustc-link-arg=-Tdefmt.x");
    println!("cargo:rerun-if-changed=memory.x");

    // Outside of a repository the commit is unknown: zero.
    let commit = git(&["rev-parse", "--short=8", "HEAD"]).unwrap_or("0".into());
    println!("cargo:rustc-env=COMMIT={commit}");
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={log}");
    }
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_string())
}
