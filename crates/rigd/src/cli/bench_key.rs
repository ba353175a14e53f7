//! `rigd bench-key`: the key that signs the seals of a bench.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use rig_ship::BenchKey;
use rig_system::files::protection;

use super::{
    Failure,
    table::{note, print},
};

#[derive(Debug, Args)]
pub(super) struct BenchKeyArgs {
    #[command(subcommand)]
    command: BenchKeyCommand,
}

#[derive(Debug, Subcommand)]
enum BenchKeyCommand {
    /// Make a key in a new file, and print its public key
    New {
        /// File for the key, readable by its owner alone
        file: PathBuf,
    },
    /// Print the public key, by which `rigd verify --signed-by` knows the bench
    Show {
        /// File of the key
        file: PathBuf,
    },
}

pub(super) fn bench_key(args: &BenchKeyArgs) -> Result<(), Failure> {
    let key = match &args.command {
        BenchKeyCommand::New { file } => {
            let key = BenchKey::make(file)?;
            if let Some(text) = protection(file) {
                note(&text);
            }
            key
        }
        BenchKeyCommand::Show { file } => BenchKey::read(file)?,
    };
    print(&key.public())
}
