//! Owns a port: bytes, deadlines, drain, quarantine, and a transcript of the last frames.
