//! Comments at the top of a fitted rig: the tool, the verdict and the files it follows from.

use model_discrepancy::verdict::Verdict;
use sha2::{Digest, Sha256};
use std::path::Path;

/// A file that a diagnosis read.
pub struct Input {
    name: String,
    sha256: String,
}

impl Input {
    /// The file at `path`, which contained `bytes`.
    pub fn new(path: &Path, bytes: &[u8]) -> Input {
        let name = path.file_name().unwrap_or(path.as_os_str());
        let mut line = String::new();
        for character in name.to_string_lossy().chars() {
            // A line break would end the comment.
            if character.is_control() {
                line.extend(character.escape_default());
            } else {
                line.push(character);
            }
        }
        let sha256 = Sha256::digest(bytes);
        Input {
            name: line,
            sha256: sha256.iter().map(|byte| format!("{byte:02x}")).collect(),
        }
    }
}

/// `rig_toml`, a fitted rig, below comments with the tool and its version, the verdict, and the
/// files' names and SHA-256 as `sha256sum` writes them. The same inputs give the same text.
pub fn with_provenance(
    rig_toml: &str,
    verdict: Verdict,
    rig: Input,
    [fit, validate]: [Vec<Input>; 2],
) -> String {
    let verdict = verdict.name();
    let version = env!("CARGO_PKG_VERSION");
    let mut text = format!("# Fitted by hil-sim {version} diagnose. Verdict: {verdict}.\n");
    let groups = [
        ("nominal rig", vec![rig]),
        ("fitted records", fit),
        ("validation records", validate),
    ];
    for (group, files) in groups {
        text += &format!("# SHA-256 of the {group}:\n");
        for Input { name, sha256 } in files {
            text += &format!("# {sha256}  {name}\n");
        }
    }
    text + "\n" + rig_toml
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_comments_name_version_verdict_and_files() {
        // The digest of "abc" is the first example of FIPS 180-2, appendix B; that of nothing is
        // what sha256sum prints for /dev/null.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let nothing = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        let input = |name: &str, bytes: &[u8]| Input::new(Path::new(name), bytes);
        let text = with_provenance(
            "schema = 1\n",
            Verdict::Unexplained,
            input("rigs/rig.toml", b"abc"),
            [
                vec![input("a.csv", b"")],
                vec![input("b\nmass_kg = 0", b"")],
            ],
        );
        let expected = format!(
            "# Fitted by hil-sim {} diagnose. Verdict: unexplained.\n\
             # SHA-256 of the nominal rig:\n# {abc}  rig.toml\n\
             # SHA-256 of the fitted records:\n# {nothing}  a.csv\n\
             # SHA-256 of the validation records:\n# {nothing}  b\\nmass_kg = 0\n\
             \nschema = 1\n",
            env!("CARGO_PKG_VERSION")
        );
        assert_eq!(text, expected);
    }
}
