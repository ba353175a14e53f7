//! Reads TOML and reports every fault at once, each with line, column and a suggestion.
#![deny(clippy::disallowed_methods)]
