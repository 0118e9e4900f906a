//! `hil-sim completions SHELL`.

use super::Failure;
use clap::CommandFactory;
use clap_complete::{Shell, generate};

/// Print shell completions
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  hil-sim completions bash > ~/.local/share/bash-completion/completions/hil-sim")]
pub struct Args {
    /// The shell
    shell: Shell,
}

/// Prints the completions of `Cli`.
pub fn run<Cli: CommandFactory>(args: &Args) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(args.shell, &mut Cli::command(), "hil-sim", &mut script);
    Ok(super::print(&String::from_utf8_lossy(&script))?)
}
