//! Simulated instruments on the wire and the physical world behind them.

pub mod plant;
