//! `hil-sim completions`.

use super::Failure;
use clap::{CommandFactory, ValueEnum};
use clap_complete::{Generator, Shell, generate};
use hil_sim::output::write_atomically;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Print shell completions, or write them and the man pages to a folder
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim completions bash > ~/.local/share/bash-completion/completions/hil-sim
  hil-sim completions --dir share      share/hil-sim.bash, …, share/hil-sim.1, …")]
pub struct Args {
    /// The shell
    #[arg(required_unless_present = "dir", conflicts_with = "dir")]
    shell: Option<Shell>,
    /// Folder for the completions of all shells and a man page for each command
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// Print the script, or the names of the written files, as JSON
    #[arg(long)]
    json: bool,
}

/// A script as JSON.
#[derive(Serialize)]
struct Script {
    shell: String,
    script: String,
}

/// The written files as JSON.
#[derive(Serialize)]
struct Written {
    files: Vec<PathBuf>,
}

/// Prints or writes the completions of `Cli`.
pub fn run<Cli: CommandFactory>(args: &Args) -> Result<(), Failure> {
    if let Some(shell) = args.shell {
        let script = completions::<Cli>(shell);
        let script = String::from_utf8_lossy(&script).into_owned();
        if args.json {
            let shell = shell.to_string();
            super::print_json(&Script { shell, script })?;
        } else {
            super::print(&script)?;
        }
    }
    if let Some(folder) = &args.dir {
        super::make_folder(folder)?;
        let mut files = Vec::new();
        for shell in Shell::value_variants() {
            let path = folder.join(shell.file_name("hil-sim"));
            write_atomically(&path, &completions::<Cli>(*shell))?;
            files.push(path);
        }
        let mut command = Cli::command();
        // Otherwise clap adds its options and names of pages only when it parses.
        command.build();
        man_pages(folder, &command, &mut files)?;
        if args.json {
            super::print_json(&Written { files })?;
        }
    }
    Ok(())
}

fn completions<Cli: CommandFactory>(shell: Shell) -> Vec<u8> {
    let mut script = Vec::new();
    generate(shell, &mut Cli::command(), "hil-sim", &mut script);
    script
}

/// Writes the man page of `command` and of each command below it, and adds them to `files`.
fn man_pages(
    folder: &Path,
    command: &clap::Command,
    files: &mut Vec<PathBuf>,
) -> Result<(), Failure> {
    let page = clap_mangen::Man::new(command.clone());
    let path = folder.join(page.get_filename());
    let mut text = Vec::new();
    page.render(&mut text)
        .map_err(|source| hil_sim::output::NotWritten::new(&path, source))?;
    write_atomically(&path, &text)?;
    files.push(path);
    let below = command.get_subcommands();
    for command in below.filter(|command| command.get_name() != "help") {
        man_pages(folder, command, files)?;
    }
    Ok(())
}
