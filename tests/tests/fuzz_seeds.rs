//! The seeds of the fuzzer, tests/fuzz/seeds: one folder per target.

#[path = "../fuzz/src/targets.rs"]
mod targets;

use std::fs::read_dir;
use std::path::Path;

#[test]
fn no_seed_violates_a_property_of_its_target() {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds");
    let mut ran = Vec::new();
    for folder in read_dir(seeds).expect("seeds") {
        let folder = folder.expect("a folder");
        let name = folder.file_name().into_string().expect("a name");
        let target = targets::target(&name).expect("a target of that name");
        let files = read_dir(folder.path()).expect("its seeds");
        for file in files.map(|file| file.expect("a file").path()) {
            let bytes = std::fs::read(&file).expect("its bytes");
            assert!(
                std::panic::catch_unwind(|| target(&bytes)).is_ok(),
                "{}",
                file.display()
            );
            ran.push(name.clone());
        }
    }
    ran.sort();
    ran.dedup();
    assert_eq!(
        ran,
        [
            "import",
            "import-hdf5",
            "import-log",
            "import-matlab",
            "import-ros",
            "import-sheet",
            "link",
            "mcap",
            "pipe",
            "record",
            "rig",
            "settings"
        ]
    );
}
