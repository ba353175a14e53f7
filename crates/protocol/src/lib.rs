//! Protocol TOML in; a checked plan of addressable steps out.
#![deny(clippy::disallowed_methods)]
