//! The import graph between the source files of each crate: files of different folders do not
//! import each other in a cycle, and cycles inside a folder are listed with their reason.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use petgraph::algo::tarjan_scc;
use petgraph::graphmap::DiGraphMap;
use syn::punctuated::Punctuated;
use syn::visit::{self, Visit};
use syn::{Attribute, Expr, ImplItem, Item, Token, UseTree};

/// The crates, as folders of the repository.
const CRATES: [&str; 7] = [
    "model-core",
    "muscle-plant",
    "model-discrepancy",
    "hil-sim",
    "fmu",
    "firmware",
    "firmware/drivers",
];

/// Cycles inside one folder that are intended: the files in alphabetical order, and the reason.
const INTENDED: &[(&[&str], &str)] = &[
    (
        &[
            "model-core/src/limits.rs",
            "model-core/src/settings.rs",
            "model-core/src/signal.rs",
        ],
        "Settings and ADC readings are checked against limits, which refer to the fields of the \
         settings and the range of the ADC.",
    ),
    (
        &["model-core/src/io.rs", "model-core/src/supervisor.rs"],
        "The output of a tick contains the supervisor's mode and fault, and the supervisor takes \
         the request of the tick's input.",
    ),
    (
        &["model-core/src/device.rs", "model-core/src/link.rs"],
        "The link decodes commands for the device, and the device fills the link's telemetry.",
    ),
    (
        &[
            "muscle-plant/src/effects/compensation.rs",
            "muscle-plant/src/effects/kind.rs",
        ],
        "A kind of effect names its compensation method, which computes sizes from an effect.",
    ),
    (
        &[
            "hil-sim/src/bench/compensate/hysteresis_loop.rs",
            "hil-sim/src/bench/compensate/sizes.rs",
            "hil-sim/src/bench/compensate/trial.rs",
        ],
        "Sizes are computed with a hysteresis loop that is fitted to a trial, and a trial tests \
         sizes for robustness.",
    ),
    (
        &[
            "hil-sim/src/identify/muscle/play.rs",
            "hil-sim/src/identify/muscle/prepared.rs",
            "hil-sim/src/identify/muscle/thinned.rs",
        ],
        "Preparation calls the thinning and the search for the play, which use its types `Noise` \
         and `Prepared`.",
    ),
];

/// A module: a file, or an inline module of a file.
struct Module {
    file: PathBuf,
    root: usize,
    parent: Option<usize>,
    children: BTreeMap<String, usize>,
    /// Name brought into scope by a `use` tree (`*` for all), and its path.
    uses: Vec<(String, Vec<String>)>,
    /// Paths of at least two segments in the code.
    paths: Vec<Vec<String>>,
}

/// The modules of a package: of its library and of its program.
struct Package {
    modules: Vec<Module>,
}

impl Package {
    fn read(folder: &Path) -> Package {
        let mut package = Package {
            modules: Vec::new(),
        };
        for root in ["lib.rs", "main.rs"] {
            let file = folder.join("src").join(root);
            if file.exists() {
                package.add_file(file, &folder.join("src"), None);
            }
        }
        assert!(
            !package.modules.is_empty(),
            "no source in {}",
            folder.display()
        );
        package
    }

    /// Adds the module in `file`, whose child modules are in `folder`.
    fn add_file(&mut self, file: PathBuf, folder: &Path, parent: Option<usize>) -> usize {
        let text = std::fs::read_to_string(&file).expect("a source file");
        let items = syn::parse_file(&text).expect("Rust source").items;
        self.add(file, folder, parent, &items)
    }

    /// Adds a module and its child modules; returns its index.
    fn add(
        &mut self,
        file: PathBuf,
        folder: &Path,
        parent: Option<usize>,
        items: &[Item],
    ) -> usize {
        let index = self.modules.len();
        let mut module = Module {
            file: file.clone(),
            root: parent.map_or(index, |parent| self.modules[parent].root),
            parent,
            children: BTreeMap::new(),
            uses: Vec::new(),
            paths: Vec::new(),
        };
        items.iter().for_each(|item| module.visit_item(item));
        self.modules.push(module);
        for item in items {
            let Item::Mod(item) = item else { continue };
            if is_test(&item.attrs) {
                continue;
            }
            let name = item.ident.to_string();
            let folder = folder.join(&name);
            let child = match &item.content {
                Some((_, items)) => self.add(file.clone(), &folder, Some(index), items),
                None => {
                    let candidates = [folder.with_extension("rs"), folder.join("mod.rs")];
                    let Some(file) = candidates.into_iter().find(|file| file.exists()) else {
                        panic!("no file for module {name} of {}", file.display());
                    };
                    self.add_file(file, &folder, Some(index))
                }
            };
            self.modules[index].children.insert(name, child);
        }
        index
    }

    /// The module in which the item of a path is defined, seen from module `from`; re-exports are
    /// followed. None if the path is not one of this crate.
    fn target(&self, from: usize, path: &[String], depth: usize) -> Option<usize> {
        let (first, mut rest) = path.split_first()?;
        let mut module = match first.as_str() {
            "crate" => self.modules[from].root,
            "self" => from,
            "super" => self.modules[from].parent?,
            name => self.member(from, name, depth)?,
        };
        while let Some((segment, after)) = rest.split_first() {
            module = match segment.as_str() {
                "super" => self.modules[module].parent?,
                name => match self.member(module, name, depth) {
                    Some(member) => member,
                    None => break,
                },
            };
            rest = after;
        }
        Some(module)
    }

    /// The module that `name` in module `index` is, or from which it is imported.
    fn member(&self, index: usize, name: &str, depth: usize) -> Option<usize> {
        let module = &self.modules[index];
        if let Some(child) = module.children.get(name) {
            return Some(*child);
        }
        // Imports of a name of another crate, such as `use libm`, refer to themselves.
        let depth = depth.checked_sub(1)?;
        let (_, path) = module.uses.iter().find(|(used, _)| used == name)?;
        self.target(index, path, depth)
    }

    /// Pairs of a file and another that it imports, except a module with its own parts.
    fn imports(&self) -> BTreeSet<(&Path, &Path)> {
        let mut imports = BTreeSet::new();
        for (index, module) in self.modules.iter().enumerate() {
            let paths = module
                .uses
                .iter()
                .map(|(_, path)| path)
                .chain(&module.paths);
            for target in paths.filter_map(|path| self.target(index, path, 8)) {
                let (file, imported) = (&module.file, &self.modules[target].file);
                // A part may refer to its module: the module is made of its parts.
                if !is_part(file, imported) {
                    imports.insert((file.as_path(), imported.as_path()));
                }
            }
        }
        imports
    }

    /// Strongly connected components of more than one file, each in alphabetical order.
    fn cycles(&self) -> Vec<Vec<&Path>> {
        let graph: DiGraphMap<&Path, ()> = DiGraphMap::from_edges(self.imports());
        let mut cycles = tarjan_scc(&graph);
        cycles.retain(|files| files.len() > 1);
        cycles.iter_mut().for_each(|files| files.sort());
        cycles
    }
}

/// Whether `file` is the module file `module` or in the folder of its child modules.
fn is_part(file: &Path, module: &Path) -> bool {
    let is_folder_file = ["mod.rs", "lib.rs", "main.rs"]
        .iter()
        .any(|name| module.ends_with(name));
    let folder = match module.parent() {
        Some(folder) if is_folder_file => folder.to_path_buf(),
        _ => module.with_extension(""),
    };
    file == module || file.starts_with(folder)
}

fn is_test(attributes: &[Attribute]) -> bool {
    attributes
        .iter()
        .filter(|attribute| attribute.path().is_ident("cfg"))
        .any(|attribute| {
            let condition = attribute.parse_args::<syn::Path>();
            condition.is_ok_and(|condition| condition.is_ident("test"))
        })
}

impl Module {
    /// Adds the names that a `use` tree below `prefix` brings into scope.
    fn add_uses(&mut self, prefix: &[String], tree: &UseTree) {
        let below = |name: &syn::Ident| [prefix, &[name.to_string()]].concat();
        match tree {
            UseTree::Path(path) => self.add_uses(&below(&path.ident), &path.tree),
            UseTree::Group(group) => {
                group
                    .items
                    .iter()
                    .for_each(|tree| self.add_uses(prefix, tree));
            }
            UseTree::Glob(_) => self.uses.push(("*".into(), prefix.to_vec())),
            UseTree::Name(name) if name.ident == "self" => {
                let last = prefix.last().cloned().unwrap_or_default();
                self.uses.push((last, prefix.to_vec()));
            }
            UseTree::Name(name) => self.uses.push((name.ident.to_string(), below(&name.ident))),
            UseTree::Rename(name) if name.ident == "self" => {
                self.uses.push((name.rename.to_string(), prefix.to_vec()));
            }
            UseTree::Rename(name) => self
                .uses
                .push((name.rename.to_string(), below(&name.ident))),
        }
    }
}

impl<'ast> Visit<'ast> for Module {
    fn visit_item(&mut self, item: &'ast Item) {
        let attributes = match item {
            // A module of its own.
            Item::Mod(_) => return,
            Item::Const(item) => &item.attrs,
            Item::Enum(item) => &item.attrs,
            Item::Fn(item) => &item.attrs,
            Item::Impl(item) => &item.attrs,
            Item::Macro(item) => &item.attrs,
            Item::Static(item) => &item.attrs,
            Item::Struct(item) => &item.attrs,
            Item::Trait(item) => &item.attrs,
            Item::Type(item) => &item.attrs,
            Item::Use(item) => &item.attrs,
            _ => &Vec::new(),
        };
        if !is_test(attributes) {
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item(&mut self, item: &'ast ImplItem) {
        let attributes = match item {
            ImplItem::Const(item) => &item.attrs,
            ImplItem::Fn(item) => &item.attrs,
            _ => &Vec::new(),
        };
        if !is_test(attributes) {
            visit::visit_impl_item(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if item.leading_colon.is_none() {
            self.add_uses(&[], &item.tree);
        }
    }

    /// `pub(super)` imports nothing.
    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.segments.len() > 1 && path.leading_colon.is_none() {
            let segments = path
                .segments
                .iter()
                .map(|segment| segment.ident.to_string());
            self.paths.push(segments.collect());
        }
        visit::visit_path(self, path);
    }

    /// Arguments of macros such as `format!` are expressions.
    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        let arguments = Punctuated::<Expr, Token![,]>::parse_terminated;
        if let Ok(arguments) = item.parse_body_with(arguments) {
            arguments
                .iter()
                .for_each(|argument| self.visit_expr(argument));
        }
        visit::visit_macro(self, item);
    }
}

#[test]
fn source_files_of_different_folders_do_not_import_each_other_in_a_cycle() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the repository");
    let packages = CRATES.map(|name| Package::read(&repository.join(name)));
    let mut intended: BTreeSet<&[&str]> = INTENDED.iter().map(|(files, _)| *files).collect();
    let mut unexpected = Vec::new();
    for cycle in packages.iter().flat_map(Package::cycles) {
        let folders: BTreeSet<_> = cycle.iter().map(|file| file.parent()).collect();
        let relative = cycle.iter().map(|file| file.strip_prefix(repository));
        let files: Vec<&str> = relative
            .map(|file| file.expect("below the repository").to_str().expect("UTF-8"))
            .collect();
        if !intended.remove(files.as_slice()) || folders.len() > 1 {
            unexpected.push(files);
        }
    }
    let largest = unexpected.iter().map(Vec::len).max().unwrap_or(0);
    assert!(
        unexpected.is_empty(),
        "{} cycles of imports, the largest of {largest} files: {unexpected:#?}",
        unexpected.len()
    );
    assert!(
        intended.is_empty(),
        "listed in INTENDED, but no longer a cycle: {intended:#?}"
    );
}
