//! Append-only journal of every run in SQLite, each record chained by its digest; queries and exports.
