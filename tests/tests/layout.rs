//! The import graph between the source files of each crate, computed from the source text: files of
//! different folders must not import each other in a circle.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The crates, as folders of the repository.
const CRATES: [&str; 5] = [
    "model-core",
    "muscle-plant",
    "model-discrepancy",
    "hil-sim",
    "firmware",
];

/// Circles inside one folder that are intended: the files, and the reason.
const INTENDED: &[(&[&str], &str)] = &[];

/// Source text as identifiers and punctuation, without comments, literals and test modules.
fn tokens(text: &str) -> Vec<String> {
    let mut tokens = Vec::new();
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        let rest = &text[at..];
        let length = skipped(rest);
        if length > 0 {
            at += length;
            continue;
        }
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let word = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
        let length = match rest.starts_with("::") {
            _ if word > 0 => word,
            true => 2,
            false => rest.chars().next().map_or(1, char::len_utf8),
        };
        let token = &rest[..length];
        if !token.trim().is_empty() {
            tokens.push(token.into());
        }
        at += length;
    }
    without_tests(&tokens)
}

/// The length of the comment or literal that `rest` begins with; 0 if it begins with neither.
fn skipped(rest: &str) -> usize {
    let after = |open: usize, close: &str| {
        let end = rest[open..].find(close);
        end.map_or(rest.len(), |end| open + end + close.len())
    };
    if rest.starts_with("//") {
        return after(2, "\n");
    }
    if rest.starts_with("/*") {
        return after(2, "*/");
    }
    let raw = rest.trim_start_matches('b').trim_start_matches('r');
    let prefix = rest.len() - raw.len();
    let hashes = raw.len() - raw.trim_start_matches('#').len();
    if prefix > 0 && prefix <= 2 && rest[..prefix].ends_with('r') && raw[hashes..].starts_with('"')
    {
        return after(prefix + hashes + 1, &format!("\"{}", "#".repeat(hashes)));
    }
    let Some(quote @ ('"' | '\'')) = rest.chars().next() else {
        return 0;
    };
    let mut inner = rest[1..].char_indices();
    if quote == '\'' && rest.chars().nth(1) != Some('\\') && rest.chars().nth(2) != Some('\'') {
        // A lifetime.
        return 1;
    }
    while let Some((place, character)) = inner.next() {
        match character {
            '\\' => drop(inner.next()),
            _ if character == quote => return place + 2,
            _ => {}
        }
    }
    rest.len()
}

/// The tokens without the items that stand behind `#[cfg(test)]`.
fn without_tests(tokens: &[String]) -> Vec<String> {
    const MARK: [&str; 7] = ["#", "[", "cfg", "(", "test", ")", "]"];
    let mut kept = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        if !tokens[at..].starts_with(&MARK.map(String::from)) {
            kept.push(tokens[at].clone());
            at += 1;
            continue;
        }
        at += MARK.len();
        let mut depth = 0;
        while at < tokens.len() {
            at += 1;
            match tokens[at - 1].as_str() {
                "{" => depth += 1,
                "}" if depth == 1 => break,
                "}" => depth -= 1,
                ";" if depth == 0 => break,
                _ => {}
            }
        }
    }
    kept
}

/// A path as it stands in the text, and the name that it brings into scope (`*` for all).
struct Reference {
    path: Vec<String>,
    name: Option<String>,
}

/// One file: a module of a crate.
struct Module {
    file: PathBuf,
    children: BTreeMap<String, usize>,
    parent: Option<usize>,
    root: usize,
    references: Vec<Reference>,
}

/// The modules of a package: of its library and of its program.
#[derive(Default)]
struct Package {
    modules: Vec<Module>,
    /// The library's root, and its name in a program beside it.
    library: Option<(String, usize)>,
}

impl Package {
    fn read(folder: &Path) -> Package {
        let mut package = Package::default();
        for root in ["src/lib.rs", "src/main.rs"] {
            let file = folder.join(root);
            if file.exists() {
                let inner = folder.join("src");
                let number = package.add(file, &inner, None);
                if root.ends_with("lib.rs") {
                    let name = folder.file_name().expect("a folder").to_string_lossy();
                    package.library = Some((name.replace('-', "_"), number));
                }
            }
        }
        assert!(!package.modules.is_empty(), "{}", folder.display());
        package
    }

    /// Adds the module in `file`, whose children are in the folder `inner`; returns its number.
    fn add(&mut self, file: PathBuf, inner: &Path, parent: Option<usize>) -> usize {
        let text = std::fs::read_to_string(&file).expect("a source file");
        let tokens = tokens(&text);
        let number = self.modules.len();
        self.modules.push(Module {
            file,
            children: BTreeMap::new(),
            parent,
            root: parent.map_or(number, |parent| self.modules[parent].root),
            references: references(&tokens),
        });
        for three in tokens.windows(3) {
            let [keyword, name, end] = three else {
                continue;
            };
            if keyword == "mod" && end == ";" {
                let inner = inner.join(name);
                let file = inner.with_extension("rs");
                let file = if file.exists() {
                    file
                } else {
                    inner.join("mod.rs")
                };
                if file.exists() {
                    let child = self.add(file, &inner, Some(number));
                    self.modules[number].children.insert(name.clone(), child);
                }
            }
        }
        number
    }

    /// The module in which the item of a path stands, seen from module `from`: through modules and
    /// what they re-export. None if it is no path into this package.
    fn target(&self, from: usize, path: &[String], depth: usize) -> Option<usize> {
        let module = &self.modules[from];
        let (mut here, mut rest) = match path.first()?.as_str() {
            "crate" => (module.root, &path[1..]),
            "self" => (from, &path[1..]),
            "super" => (module.parent?, &path[1..]),
            first => match (&self.library, module.children.get(first)) {
                (_, Some(child)) => (*child, &path[1..]),
                (Some((name, root)), None) if name == first => (*root, &path[1..]),
                _ => return None,
            },
        };
        while let Some(segment) = rest.first() {
            if segment == "super" {
                here = self.modules[here].parent?;
            } else if let Some(child) = self.modules[here].children.get(segment) {
                here = *child;
            } else {
                return Some(self.exporting(here, segment, depth).unwrap_or(here));
            }
            rest = &rest[1..];
        }
        Some(here)
    }

    /// The module from which module `here` has its item `name`, if it imports it.
    fn exporting(&self, here: usize, name: &str, depth: usize) -> Option<usize> {
        // A circle of re-exports would not compile; globs may name each other.
        let depth = depth.checked_sub(1)?;
        let references = &self.modules[here].references;
        let named = |reference: &&Reference| reference.name.as_deref() == Some(name);
        let reference = references.iter().find(named)?;
        self.target(here, &reference.path, depth)
    }

    /// For each file, the files that it imports.
    fn imports(&self) -> BTreeMap<PathBuf, BTreeSet<PathBuf>> {
        let mut imports: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        for (number, module) in self.modules.iter().enumerate() {
            let imported = imports.entry(module.file.clone()).or_default();
            for reference in &module.references {
                if let Some(target) = self.target(number, &reference.path, 8) {
                    imported.insert(self.modules[target].file.clone());
                }
            }
            imported.remove(&module.file);
        }
        imports
    }
}

/// The paths in a file's tokens: of `use` trees, one by one, and those in the code.
fn references(tokens: &[String]) -> Vec<Reference> {
    let mut references = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        // `use<'a>` names lifetimes.
        if tokens[at] == "use" && tokens[at + 1] != "<" {
            at = use_tree(tokens, at + 1, &[], &mut references);
        } else if tokens.get(at + 1).is_some_and(|next| next == "::") && is_name(&tokens[at]) {
            let mut path = vec![tokens[at].clone()];
            at += 1;
            while tokens[at] == "::" && tokens.get(at + 1).is_some_and(|name| is_name(name)) {
                path.push(tokens[at + 1].clone());
                at += 2;
            }
            references.push(Reference { path, name: None });
            // What is behind it, such as a turbofish, is no path of its own.
            at += usize::from(tokens[at] == "::");
        } else {
            at += 1;
        }
    }
    references
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Reads a `use` tree that begins at `at`, below `prefix`; returns where it ends.
fn use_tree(
    tokens: &[String],
    mut at: usize,
    prefix: &[String],
    references: &mut Vec<Reference>,
) -> usize {
    let mut path = prefix.to_vec();
    let mut name = None;
    while at < tokens.len() {
        match tokens[at].as_str() {
            "{" => {
                at += 1;
                while tokens[at] != "}" {
                    at = use_tree(tokens, at, &path, references);
                    at += usize::from(tokens[at] == ",");
                }
                return at + 1;
            }
            ";" | "," | "}" => break,
            "::" => {}
            "as" => {
                name = Some(tokens[at + 1].clone());
                at += 1;
            }
            "*" => name = Some("*".into()),
            segment => path.push(segment.into()),
        }
        at += 1;
    }
    if path.last().is_some_and(|last| last == "self") && path.len() > 1 {
        path.pop();
    }
    let name = name.or_else(|| path.last().cloned());
    references.push(Reference { path, name });
    at
}

/// Files that import each other, over whatever others: the strongly connected components of more
/// than one file.
fn circles(imports: &BTreeMap<PathBuf, BTreeSet<PathBuf>>) -> Vec<Vec<&Path>> {
    let reached = |from: &Path| {
        let mut reached: BTreeSet<&Path> = BTreeSet::new();
        let mut left: Vec<&Path> = vec![from];
        while let Some(file) = left.pop() {
            for next in &imports[file] {
                if reached.insert(next) {
                    left.push(next);
                }
            }
        }
        reached
    };
    let reached: BTreeMap<&Path, _> = imports
        .keys()
        .map(|file| (file.as_path(), reached(file)))
        .collect();
    let mut circles: BTreeSet<Vec<&Path>> = BTreeSet::new();
    for file in imports
        .keys()
        .filter(|file| reached[file.as_path()].contains(file.as_path()))
    {
        let is_mutual = |other: &&&Path| reached[**other].contains(file.as_path());
        let circle = reached[file.as_path()].iter().filter(is_mutual);
        circles.insert(circle.copied().collect());
    }
    circles.into_iter().collect()
}

/// The folders that a file belongs to: its own and, for `a.rs` beside a folder `a`, that one.
fn folders(file: &Path) -> BTreeSet<PathBuf> {
    let own = file.parent().map(Path::to_path_buf);
    let inner = Some(file.with_extension("")).filter(|inner| inner.is_dir());
    own.into_iter().chain(inner).collect()
}

fn share_a_folder(files: &[&Path]) -> bool {
    let mut common = folders(files[0]);
    for file in files {
        common = &common & &folders(file);
    }
    !common.is_empty()
}

#[test]
fn files_of_different_folders_do_not_import_each_other_in_a_circle() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the repository");
    let mut intended: BTreeSet<Vec<String>> = INTENDED
        .iter()
        .map(|(files, _)| files.iter().map(|file| String::from(*file)).collect())
        .collect();
    let mut found = Vec::new();
    for name in CRATES {
        let imports = Package::read(&repository.join(name)).imports();
        for circle in circles(&imports) {
            let relative = |file: &&Path| {
                let file = file.strip_prefix(repository).expect("below it");
                file.display().to_string()
            };
            let files: Vec<String> = circle.iter().map(relative).collect();
            if !(share_a_folder(&circle) && intended.remove(&files)) {
                found.push(files);
            }
        }
    }
    let largest = found.iter().map(Vec::len).max().unwrap_or(0);
    assert!(
        found.is_empty(),
        "{} circles, the largest of {largest} files: {found:#?}",
        found.len()
    );
    assert!(intended.is_empty(), "no longer circles: {intended:#?}");
}
