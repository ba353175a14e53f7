//! `rigd completions` and `rigd man`.

use std::{fs, io, path::PathBuf};

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::{
    Cli, Failure,
    table::{note, print},
};

#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

#[derive(Debug, Args)]
pub(super) struct ManArgs {
    /// Directory to which the page of every command is written, such as `man/man1`; without it, the page
    /// of rigd is printed
    directory: Option<PathBuf>,
}

/// The script is made in memory first: its generator stops the program if a reader closes the pipe.
pub(super) fn completions(args: &CompletionsArgs) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "rigd", &mut script);
    print(String::from_utf8_lossy(&script).trim_end())
}

pub(super) fn man(args: &ManArgs) -> Result<(), Failure> {
    let failed = |source: io::Error| Failure::System { what: "manual pages", source };
    let Some(directory) = &args.directory else {
        let mut page = Vec::new();
        clap_mangen::Man::new(Cli::command()).render(&mut page).map_err(failed)?;
        return print(String::from_utf8_lossy(&page).trim_end());
    };
    fs::create_dir_all(directory).map_err(failed)?;
    clap_mangen::generate_to(Cli::command(), directory).map_err(failed)?;
    note(&format!("manual pages: {}", directory.display()));
    Ok(())
}
