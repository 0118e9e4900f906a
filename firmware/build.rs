//! Puts memory.x on the linker's search path and passes the commit to `link::identity`.

use std::{env, path::Path, process::Command};

fn main() {
    let manifest_dir = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let root = Path::new(&manifest_dir).parent().expect("the repository");
    println!("cargo:rustc-link-search={}", root.display());
    // defmt's sections. Not in .cargo/config.toml, because cortex-m-tests does not use defmt.
    println!("cargo:rustc-link-arg=-Tdefmt.x");

    // Outside a repository, and for an image of edited sources, the commit is unknown: 0.
    let sources = [
        "firmware",
        "model-core",
        "memory.x",
        "Cargo.toml",
        "Cargo.lock",
    ];
    let sources = sources.map(|source| root.join(source).display().to_string());
    for source in &sources {
        println!("cargo:rerun-if-changed={source}");
    }
    let status = ["status", "--porcelain", "--"].map(String::from);
    let is_edited = git(&[&status[..], &sources[..]].concat()).is_none_or(|list| !list.is_empty());
    let head = git(&["rev-parse", "--short=8", "HEAD"].map(String::from));
    let commit = head.filter(|_| !is_edited).unwrap_or("0".into());
    println!("cargo:rustc-env=COMMIT={commit}");
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"].map(String::from)) {
        println!("cargo:rerun-if-changed={log}");
    }
}

fn git(arguments: &[String]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_string())
}
