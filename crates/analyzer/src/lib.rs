//! What each impedance analyzer must be told.
