//! Line and scatter charts as deterministic SVG text.
