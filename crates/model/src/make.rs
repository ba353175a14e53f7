//! The makes of devices that are shipped and simulated, each with its name in rig files.

use std::fmt;

/// A make of impedance analyzer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnalyzerMake {
    /// HIOKI IM3536, IM3533 or IM3570.
    HiokiIm3536,
    /// Keysight E4980A.
    KeysightE4980a,
    /// HP or Agilent 4284A.
    Hp4284a,
    /// Tonghui TH2830, TH2831, TH2832 or TH2838.
    TonghuiTh283x,
    /// Keysight E4990A.
    KeysightE4990a,
}

impl AnalyzerMake {
    /// Every make.
    pub const ALL: [Self; 5] = [
        Self::HiokiIm3536,
        Self::KeysightE4980a,
        Self::Hp4284a,
        Self::TonghuiTh283x,
        Self::KeysightE4990a,
    ];

    /// The name in rig files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::HiokiIm3536 => "hioki-im3536",
            Self::KeysightE4980a => "keysight-e4980a",
            Self::Hp4284a => "hp-4284a",
            Self::TonghuiTh283x => "tonghui-th283x",
            Self::KeysightE4990a => "keysight-e4990a",
        }
    }

    /// Longest time of a reading in a stream of readings at one frequency beside its integration, s: for the
    /// message, the trigger and the answer. `None` for an analyzer that measures whole traces.
    ///
    /// Estimates from the length of the messages at 38400 baud and from the speed of the instruments; no manual states
    /// them, and `stream_overhead_s` of the rig file replaces them.
    pub const fn stream_overhead_s(self) -> Option<f64> {
        match self {
            Self::HiokiIm3536 => Some(0.01),
            Self::KeysightE4980a => Some(0.015),
            Self::Hp4284a | Self::TonghuiTh283x => Some(0.03),
            Self::KeysightE4990a => None,
        }
    }
}

impl fmt::Display for AnalyzerMake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A make of axis drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveMake {
    /// Oriental Motor AZ.
    OrientalAz,
    /// IAI PCON, ACON, SCON or ERC, whose unit of position is a hundredth of a millimetre.
    IaiRc,
    /// Leadshine CL2C-RS or iEM-RS in PR mode.
    LeadshinePr,
}

impl DriveMake {
    /// Every make.
    pub const ALL: [Self; 3] = [Self::OrientalAz, Self::IaiRc, Self::LeadshinePr];

    /// The name in rig files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OrientalAz => "oriental-az",
            Self::IaiRc => "iai-rc",
            Self::LeadshinePr => "leadshine-pr",
        }
    }
}

impl fmt::Display for DriveMake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
