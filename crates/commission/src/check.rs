//! The daily check of a bench: what it measures, and what its charts say of it.
//!
//! ```text
//!   touches on a block ──┐
//!                        ├─▶ Readings::values ──▶ judge(all checks since the bench was changed) ──▶ Checked
//!   touches on two       │         seven quantities, each with a chart of its own
//!   reference samples ───┘
//! ```

mod judge;
mod quantity;
mod readings;
#[cfg(test)]
mod tests;

pub use judge::{CheckVerdict, Checked, QuantityAlarm, judge};
pub use quantity::Quantity;
pub use readings::{BlockHeight, CheckValues, Readings, Unmeasured};
