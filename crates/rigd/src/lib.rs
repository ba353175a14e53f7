//! The daemon: command line, configuration, HTTP, wiring.
