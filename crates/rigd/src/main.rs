//! The `rigd` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    rigd::cli::main()
}
