//! The makes of devices that rigd can drive, each with its name in rig files.

use std::fmt;

use crate::Parity;

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

    /// Lowest and highest frequency, Hz.
    ///
    /// # Source
    /// The specifications in the manuals that `rig-analyzer` cites with each dialect.
    pub const fn frequency_hz(self) -> (f64, f64) {
        match self {
            Self::HiokiIm3536 => (4.0, 8e6),
            Self::KeysightE4980a => (20.0, 2e6),
            Self::Hp4284a => (20.0, 1e6),
            Self::TonghuiTh283x => (20.0, 1e5),
            Self::KeysightE4990a => (20.0, 120e6),
        }
    }

    /// Lowest and highest level without options, V.
    ///
    /// # Source
    /// As for [`Self::frequency_hz`].
    pub const fn level_v(self) -> (f64, f64) {
        match self {
            Self::HiokiIm3536 => (0.01, 5.0),
            Self::KeysightE4980a | Self::Hp4284a | Self::TonghuiTh283x => (0.005, 2.0),
            Self::KeysightE4990a => (0.005, 1.0),
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

    /// The parity of its serial line as it leaves the factory.
    ///
    /// # Source
    /// Oriental Motor, HM-60262E (8E1); IAI, `ROBONET` manual, p. 38 (no parity); Leadshine, iEM-RS
    /// and DM556RS manuals (8N1).
    pub const fn parity(self) -> Parity {
        match self {
            Self::OrientalAz => Parity::Even,
            Self::IaiRc | Self::LeadshinePr => Parity::None,
        }
    }
}

impl fmt::Display for DriveMake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
