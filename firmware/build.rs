//! Gives the linker the memory of the selected board, and passes the commit to `link::identity`.

use std::path::{Path, PathBuf};
use std::{env, process::Command};

fn main() {
    let manifest_dir = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let root = Path::new(&manifest_dir).parent().expect("the repository");
    // The linker runs in the repository's root, and would find the default board's memory.x there.
    let memory = memory(root);
    println!(
        "cargo:rustc-link-arg=--remap-inputs=memory.x={}",
        memory.display()
    );
    println!("cargo:rustc-link-search={}", root.display());
    if env::var_os("CARGO_FEATURE_DEBUGGER").is_some() {
        // For scripts/probe-run.sh.
        println!("cargo:rustc-link-arg=--defsym=watchdog_stops_in_debug=1");
    }
    if env::var_os("CARGO_FEATURE_ADS1220").is_some() {
        // For the emulated board.
        println!("cargo:rustc-link-arg=--defsym=bridge_converter_ads1220=1");
    }
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

/// The memory of the selected board: the file of its feature's name beside its source, or else that
/// of the default board.
fn memory(root: &Path) -> PathBuf {
    let boards = root.join("firmware/src/board");
    let features = env::vars().filter_map(|(name, _)| {
        let feature = name.strip_prefix("CARGO_FEATURE_")?.to_lowercase();
        Some(boards.join(feature).with_extension("x"))
    });
    let beside = features.into_iter().find(|file| file.exists());
    beside.unwrap_or_else(|| root.join("memory.x"))
}

fn git(arguments: &[String]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_string())
}
