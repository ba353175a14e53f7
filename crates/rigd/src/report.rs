//! The report of a run: one HTML file with figures, tables and provenance.
