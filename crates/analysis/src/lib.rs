//! From touches to results: shift tables, sensitivity, classification.
#![deny(clippy::disallowed_methods)]
