//! The makes of the family, as data.
//!
//! # Source
//! Measurement times: data sheet of the E4980A and Operation Manual of the 4284A; what Tonghui does
//! not print is taken from the 4284A.

use std::{fmt, sync::LazyLock};

use rig_scpi::Tree;

use super::commands::{E4980A_KEPT, LcrCommand, TH2832_KEPT, tree};
use crate::device::meter::{round_step, setting_store::StoredSetting};

/// The differences between the makes.
pub(crate) trait Make: fmt::Debug + Send + Sync + 'static {
    /// The answer to `*IDN?`.
    const IDENTITY: &'static str;
    /// The answer to `*OPT?`.
    const OPTIONS: &'static str;
    /// The highest frequency, Hz.
    const MAX_HZ: f64;
    /// Duration of one measurement, s, at 20 Hz, 100 Hz, 1 kHz, 10 kHz and above, for each
    /// aperture.
    const TIMES: [[f64; 4]; 3];
    /// The highest level, V, and with high power switched on.
    const MAX_V: (f64, f64);
    /// The same of the current, A.
    const MAX_A: (f64, f64);
    /// The same of the bias, V and its magnitude.
    const MAX_BIAS_V: (f64, f64);
    /// The longest delay, s.
    const MAX_DELAY_S: f64;
    /// Whether it measures the bias as well.
    const MONITORS_BIAS: bool;
    /// Settings of its own that are kept.
    const KEPT: &'static [StoredSetting];
    /// Whether the delay of a trigger and that of a step are separate.
    const HAS_TRIGGER_DELAY: bool;
    /// Whether a query waits for a reading. Otherwise the status says that there is none yet.
    const FETCH_WAITS: bool;

    /// The set frequency for a requested one.
    fn nearest_hz(frequency_hz: f64) -> f64;

    /// Its commands, checked once.
    fn tree() -> &'static Tree<LcrCommand>;
}

/// Keysight E4980A with option 001, which drives 20 V.
#[derive(Debug)]
pub(crate) struct E4980a;

impl Make for E4980a {
    const IDENTITY: &'static str = "Keysight Technologies,E4980A,MY46516789,A.06.16";
    const OPTIONS: &'static str = "001";
    const MAX_HZ: f64 = 2e6;
    const TIMES: [[f64; 4]; 3] =
        [[0.330, 0.100, 0.020, 0.0077], [0.380, 0.180, 0.110, 0.092], [0.480, 0.300, 0.240, 0.230]];
    const MAX_V: (f64, f64) = (20.0, 20.0);
    const MAX_A: (f64, f64) = (0.1, 0.1);
    const MAX_BIAS_V: (f64, f64) = (40.0, 40.0);
    const MONITORS_BIAS: bool = true;
    const KEPT: &'static [StoredSetting] = E4980A_KEPT;
    const MAX_DELAY_S: f64 = 999.0;
    const HAS_TRIGGER_DELAY: bool = true;
    const FETCH_WAITS: bool = true;

    fn nearest_hz(frequency_hz: f64) -> f64 {
        four_digits(frequency_hz)
    }

    fn tree() -> &'static Tree<LcrCommand> {
        static TREE: LazyLock<Tree<LcrCommand>> = LazyLock::new(|| tree(E4980a::KEPT));
        &TREE
    }
}

/// HP 4284A with option 001, which drives 20 V once high power is switched on.
#[derive(Debug)]
pub(crate) struct Hp4284a;

impl Make for Hp4284a {
    const IDENTITY: &'static str = "HEWLETT-PACKARD,4284A,2940J01234,REV01.20";
    const OPTIONS: &'static str = "001,0,0,0,0";
    const MAX_HZ: f64 = 1e6;
    const TIMES: [[f64; 4]; 3] =
        [[0.350, 0.270, 0.040, 0.030], [0.400, 0.400, 0.190, 0.180], [0.800, 0.800, 0.830, 0.820]];
    const MAX_V: (f64, f64) = (2.0, 20.0);
    const MAX_A: (f64, f64) = (0.02, 0.2);
    const MAX_BIAS_V: (f64, f64) = (2.0, 40.0);
    const MONITORS_BIAS: bool = false;
    const KEPT: &'static [StoredSetting] = &[];
    const MAX_DELAY_S: f64 = 60.0;
    const HAS_TRIGGER_DELAY: bool = false;
    const FETCH_WAITS: bool = true;

    /// The instrument divides a clock, so that only some frequencies can be had, at most one
    /// percent apart.
    fn nearest_hz(frequency_hz: f64) -> f64 {
        const CLOCK_HZ: f64 = 60e3;
        if frequency_hz < 1000.0 {
            CLOCK_HZ / (CLOCK_HZ / frequency_hz).round()
        } else {
            four_digits(frequency_hz)
        }
    }

    fn tree() -> &'static Tree<LcrCommand> {
        static TREE: LazyLock<Tree<LcrCommand>> = LazyLock::new(|| tree(Hp4284a::KEPT));
        &TREE
    }
}

/// Tonghui TH2832. It hands characters over one by one, with an echo of each.
#[derive(Debug)]
pub(crate) struct Th2832;

impl Make for Th2832 {
    const IDENTITY: &'static str = "Tonghui,TH2832,V1.0.5,T283210021";
    const OPTIONS: &'static str = "0";
    const MAX_HZ: f64 = 2e5;
    const TIMES: [[f64; 4]; 3] = Hp4284a::TIMES;
    const MAX_V: (f64, f64) = (2.0, 2.0);
    const MAX_A: (f64, f64) = (0.02, 0.02);
    const MAX_BIAS_V: (f64, f64) = (2.0, 2.0);
    const MONITORS_BIAS: bool = false;
    const KEPT: &'static [StoredSetting] = TH2832_KEPT;
    const MAX_DELAY_S: f64 = 60.0;
    const HAS_TRIGGER_DELAY: bool = false;
    const FETCH_WAITS: bool = false;

    fn nearest_hz(frequency_hz: f64) -> f64 {
        four_digits(frequency_hz)
    }

    fn tree() -> &'static Tree<LcrCommand> {
        static TREE: LazyLock<Tree<LcrCommand>> = LazyLock::new(|| tree(Th2832::KEPT));
        &TREE
    }
}

/// Rounds to four digits.
fn four_digits(frequency_hz: f64) -> f64 {
    round_step(frequency_hz, 10_f64.powf(frequency_hz.log10().floor() - 3.0))
}
