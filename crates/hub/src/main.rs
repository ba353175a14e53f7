//! The `rigd-hub` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    rig_hub::cli::main()
}
