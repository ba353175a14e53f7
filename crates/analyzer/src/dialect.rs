//! Which analyzers are known, and what each can do.

use crate::hioki;

/// What must be known of an analyzer before anything is sent to it.
#[derive(Debug, Clone, Copy)]
pub struct Dialect {
    /// The name in configuration files.
    pub name: &'static str,
    /// The models it is for, as people read them.
    pub models: &'static str,
    /// How the model field of the identity begins, one of these.
    pub model_prefixes: &'static [&'static str],
    /// Lowest and highest frequency, Hz.
    pub frequency_hz: (f64, f64),
    /// Lowest and highest level, V.
    pub level_v: (f64, f64),
    /// Steps of the frequency setting, Hz.
    pub frequency_step_hz: f64,
    /// The longest delay between trigger and measurement that it can be told, s.
    pub trigger_delay_max_s: f64,
    /// The most cycles that one trigger can average.
    pub averages_max: u32,
    /// How messages are sent.
    pub quirks: Quirks,
}

/// How messages travel, apart from what they say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quirks {
    /// What ends a message to the instrument. What it sends ends with a line feed, and a carriage
    /// return before it is dropped.
    pub terminator: &'static str,
    /// Sent before anything else, so that answers come without their headers.
    pub header_off: Option<&'static str>,
}

/// HIOKI IM3536, which gives 5 V at 100–300 Hz.
///
/// # Source
/// HIOKI, IM3536 Instruction Manual, specifications; Communication Instruction Manual.
pub const HIOKI_IM3536: Dialect = Dialect {
    name: "hioki-im3536",
    models: "HIOKI IM3536, IM3533 or IM3570",
    model_prefixes: &["IM3536", "IM3533", "IM3570"],
    frequency_hz: (4.0, 8e6),
    level_v: (0.01, 5.0),
    frequency_step_hz: 0.01,
    trigger_delay_max_s: 9.9999,
    averages_max: hioki::AVERAGES_MAX,
    quirks: Quirks { terminator: "\r\n", header_off: Some(":HEADer OFF") },
};

/// All dialects.
pub const DIALECTS: [&Dialect; 1] = [&HIOKI_IM3536];

/// The dialect of this name.
pub fn dialect_by_name(name: &str) -> Option<&'static Dialect> {
    DIALECTS.into_iter().find(|dialect| dialect.name == name)
}
