//! Generates a program from model-core and its tests. Rust's test harness needs std, which a bare
//! CPU does not have: this replaces `#[test]` on each function and lists the functions in a table.
//! It changes nothing else of model-core, and line numbers stay the same.

use std::path::PathBuf;
use std::{env, fs};

const MODEL_CORE: &str = "../../model-core";

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    // The linker runs in the root of the workspace, where it would find the board's memory.x.
    let memory = fs::canonicalize("memory.x").expect("memory.x is in the folder of the package");
    println!(
        "cargo:rustc-link-arg=--remap-inputs=memory.x={}",
        memory.display()
    );
    println!("cargo:rerun-if-changed=memory.x");
    println!("cargo:rerun-if-changed={MODEL_CORE}");

    let (mut modules, mut tables) = (String::new(), String::new());
    for (name, text) in sources("src").into_iter().chain(sources("tests")) {
        // What needs threads goes through all inputs, for which this CPU is too slow; variables of
        // a thread need std.
        if name == "lib" || text.contains("std::thread") || text.contains("thread_local!") {
            continue;
        }
        let tests = "#[cfg(test)]\nmod tests {\n";
        // Tests whose helpers those of another module use.
        let text = text.replace("#[cfg(test)]\npub(crate) mod tests {\n", tests);
        let (text, table) = match text.split_once(tests) {
            Some((code, tests)) => {
                // What only tests use.
                let code = code.replace("#[cfg(test)]", "");
                let code = format!("{code}\npub(crate) mod tests {{");
                (with_table(&name, &code, tests), format!("{name}::tests"))
            }
            None if text.contains("#[test]") => {
                // A file of tests: the table replaces the first blank line, after the comments.
                let (comment, tests) = text.split_once("\n\n").expect("a blank line");
                let comment = format!("{comment}\n");
                (with_table(&name, &comment, tests), name.clone())
            }
            None => (text, String::new()),
        };
        let path = out.join(format!("{name}.rs"));
        fs::write(&path, text).expect("OUT_DIR can be written to");
        modules += &format!("#[path = {path:?}]\npub mod {name};\n");
        if !table.is_empty() {
            tables += &format!("    {table}::TESTS,\n");
        }
    }
    let root = format!("{modules}\nconst TESTS: &[&[host::Test]] = &[\n{tables}];\n");
    fs::write(out.join("model_core.rs"), root).expect("OUT_DIR can be written to");
}

/// Name and text of each file. A suffix distinguishes test files from sources of the same name.
fn sources(folder: &str) -> Vec<(String, String)> {
    let entries = fs::read_dir(format!("{MODEL_CORE}/{folder}")).expect("model-core exists");
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("a readable folder").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "rs"))
        .collect();
    files.sort();
    let read = |path: &PathBuf| {
        let stem = path
            .file_stem()
            .expect("the path of a file")
            .to_string_lossy();
        let name = if folder == "src" {
            stem.into()
        } else {
            format!("{stem}_{folder}")
        };
        (name, fs::read_to_string(path).expect("a readable file"))
    };
    files.iter().map(read).collect()
}

/// Joins `before` and `tests` with a table of the tests on the line between.
fn with_table(name: &str, before: &str, tests: &str) -> String {
    let functions = tests.split("#[test]").skip(1).filter_map(|test| {
        let (_, function) = test.split_once("fn ")?;
        Some(function.split_once('(')?.0)
    });
    let rows = functions.map(|function| format!("(\"{name}::{function}\", {function}), "));
    let rows: String = rows.collect();
    let tests = tests.replace("#[test]", "#[cfg(not(test))]");
    let table = format!("pub(crate) const TESTS: &[Test] = &[{rows}];");
    format!("{before} #[allow(unused_imports)] use crate::host::*; {table}\n{tests}")
}
