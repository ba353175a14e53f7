//! The `rigd` program.
fn main() {}
