//! Where the code and the tests of a requirement are, and what CI has made of the tests.

use super::source::repository;
use std::collections::BTreeMap;
use std::path::Path;

/// What is known of the tests' results.
pub enum Results {
    /// What a commit claims: CI takes none of which a test fails.
    Claimed,
    /// What libtest has written, by program and by the test's path in it.
    Logged(BTreeMap<(String, String), bool>),
}

impl Results {
    /// The results in the logs of this folder, as `cargo test` prints them with both streams.
    pub fn read(folder: &Path) -> Results {
        let mut logged = BTreeMap::new();
        for entry in std::fs::read_dir(folder).expect("a folder with logs") {
            let path = entry.expect("an entry").path();
            if path.extension().is_some_and(|extension| extension == "log") {
                parse(&std::fs::read_to_string(&path).expect("a log"), &mut logged);
            }
        }
        Results::Logged(logged)
    }

    /// The result of a test, given as `path#test`.
    pub fn of(&self, test: &str) -> &'static str {
        let Results::Logged(logged) = self else {
            return "passes";
        };
        let (path, name) = test.split_once('#').expect("path#test");
        let program = program(path);
        let is_it = |(of, found): &(String, String)| {
            *of == program && found.rsplit("::").next() == Some(name)
        };
        let found: Vec<bool> = logged
            .iter()
            .filter(|(key, _)| is_it(key))
            .map(|(_, passed)| *passed)
            .collect();
        match &found[..] {
            [] => "**not run**",
            found if found.iter().all(|passed| *passed) => "passes",
            _ => "**fails**",
        }
    }
}

/// The program in which the tests of this file run.
fn program(path: &str) -> String {
    let stem = |part: &str| part.trim_end_matches(".rs").to_string();
    match path.rsplit_once("/tests/") {
        Some((_, file)) => stem(file.split('/').next().unwrap_or(file)),
        None => stem(path.split('/').next().unwrap_or(path)).replace('-', "_"),
    }
}

fn parse(log: &str, logged: &mut BTreeMap<(String, String), bool>) {
    let mut program = String::new();
    for line in log.lines() {
        if let Some((_, file)) = line.trim_start().split_once("Running ") {
            // `unittests src/lib.rs (target/debug/deps/model_core-0123456789abcdef)`
            let file = file.rsplit(['/', '(']).next().unwrap_or(file);
            let name = file.trim_end_matches(')').rsplit_once('-');
            program = name.map_or(String::new(), |(name, _)| name.into());
        } else if let Some(test) = line.strip_prefix("test ") {
            for (end, passed) in [(" ... ok", true), (" ... FAILED", false)] {
                let Some((name, _)) = test.split_once(end) else {
                    continue;
                };
                let name = name.trim_end_matches(" - should panic");
                let key = (program.clone(), name.to_string());
                let before = logged.get(&key).copied().unwrap_or(true);
                logged.insert(key, before && passed);
            }
        }
    }
}

/// Whether the item is defined there and not only mentioned: a function, a type, a constant or a
/// field.
fn defines(text: &str, item: &str) -> bool {
    const KINDS: [&str; 7] = ["fn", "struct", "enum", "trait", "const", "static", "type"];
    let code = text.lines().map(str::trim_start);
    let mut places = code
        .filter(|line| !line.starts_with("//"))
        .flat_map(|line| {
            let found = line.match_indices(item);
            found.map(move |(at, _)| (line[..at].trim_end(), &line[at + item.len()..]))
        });
    places.any(|(before, after)| {
        let is_part = |letter: char| letter.is_alphanumeric() || letter == '_';
        let last = before.rsplit(' ').next().unwrap_or_default();
        let is_field = matches!(before, "" | "pub") && after.starts_with(": ");
        !after.starts_with(is_part) && (KINDS.contains(&last) || is_field)
    })
}

/// What is wrong with a place `path#item` in the repository; a test must be one.
pub fn missing(place: &str, is_test: bool) -> Option<String> {
    let (path, item) = place.split_once('#')?;
    let Ok(text) = std::fs::read_to_string(repository().join(path)) else {
        return Some(format!("{place}: no such file"));
    };
    let is_found = if is_test {
        let function = text.find(&format!("fn {item}("));
        function.is_some_and(|at| {
            let before = &text[text[..at].rfind("}\n").unwrap_or(0)..at];
            before.contains("#[test]") || text[..at].contains("proptest! {")
        })
    } else {
        item.is_empty() || defines(&text, item)
    };
    (!is_found).then(|| format!("{place}: not found"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &str = "\
     Running unittests src/lib.rs (target/debug/deps/model_core-00ff)
test enabling::tests::nothing_begins ... ok
     Running tests/sequences/main.rs (/x/target/debug/deps/sequences-12ab)
test scenarios ... FAILED
test slow ... ignored, takes minutes
";

    #[test]
    fn results_are_those_of_the_log() {
        let mut logged = BTreeMap::new();
        parse(LOG, &mut logged);
        let results = Results::Logged(logged);
        let of = |test| results.of(test);
        assert_eq!(of("model-core/src/enabling.rs#nothing_begins"), "passes");
        assert_eq!(of("hil-sim/tests/sequences/main.rs#scenarios"), "**fails**");
        assert_eq!(of("hil-sim/tests/sequences/main.rs#slow"), "**not run**");
        assert_eq!(of("hil-sim/tests/other.rs#scenarios"), "**not run**");
    }

    #[test]
    fn places_that_are_not_there_are_told() {
        let test = "hil-sim/tests/safety_case/evidence.rs#places_that_are_not_there_are_told";
        assert_eq!(missing(test, true), None);
        assert!(missing("hil-sim/tests/safety_case/evidence.rs#parse", true).is_some());
        let item = ["model-core/src/stop.rs#Stop", "Nothing"].concat();
        assert!(missing(&item, false).is_some());
        // Mentioned is not defined.
        for item in ["fail", "Findings", "Stop", "Contact"] {
            let place = format!("model-core/src/stop.rs#{item}");
            assert!(missing(&place, false).is_some(), "{place}");
        }
        let place = "model-core/src/stop.rs#StopContacts";
        assert_eq!(missing(place, false), None);
        assert!(missing("hil-sim/tests/nothing.rs#parse", false).is_some());
    }
}
