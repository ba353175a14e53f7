//! Offline studies: the paper's figures, charts of speed against accuracy, failure maps.
fn main() {}
