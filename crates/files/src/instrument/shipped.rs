//! The instruments of `config/instruments`, which are in the program.

use std::sync::LazyLock;

use rig_model::{AnalyzerMake, DriveMake};

use super::{Dialect, RegisterMap, dialect_keys, drive_keys};
use crate::settings;

macro_rules! text {
    ($name:literal) => {
        include_str!(concat!("../../../../config/instruments/", $name, ".toml"))
    };
}

/// HIOKI IM3536, IM3533 and IM3570.
pub static HIOKI_IM3536: LazyLock<Dialect> =
    LazyLock::new(|| dialect("hioki-im3536", text!("hioki-im3536")));
/// Keysight E4980A.
pub static KEYSIGHT_E4980A: LazyLock<Dialect> =
    LazyLock::new(|| dialect("keysight-e4980a", text!("keysight-e4980a")));
/// HP or Agilent 4284A.
pub static HP_4284A: LazyLock<Dialect> = LazyLock::new(|| dialect("hp-4284a", text!("hp-4284a")));
/// Tonghui `TH283x` on RS-232.
pub static TONGHUI_TH283X: LazyLock<Dialect> =
    LazyLock::new(|| dialect("tonghui-th283x", text!("tonghui-th283x")));
/// Keysight E4990A.
pub static KEYSIGHT_E4990A: LazyLock<Dialect> =
    LazyLock::new(|| dialect("keysight-e4990a", text!("keysight-e4990a")));

/// Oriental Motor AZ.
pub static ORIENTAL_AZ: LazyLock<RegisterMap> =
    LazyLock::new(|| drive("oriental-az", text!("oriental-az")));
/// IAI RC.
pub static IAI_RC: LazyLock<RegisterMap> = LazyLock::new(|| drive("iai-rc", text!("iai-rc")));
/// Leadshine with position registers.
pub static LEADSHINE_PR: LazyLock<RegisterMap> =
    LazyLock::new(|| drive("leadshine-pr", text!("leadshine-pr")));

impl Dialect {
    /// The dialect that analyzers of this make speak.
    pub fn of(make: AnalyzerMake) -> &'static Self {
        match make {
            AnalyzerMake::HiokiIm3536 => &HIOKI_IM3536,
            AnalyzerMake::KeysightE4980a => &KEYSIGHT_E4980A,
            AnalyzerMake::Hp4284a => &HP_4284A,
            AnalyzerMake::TonghuiTh283x => &TONGHUI_TH283X,
            AnalyzerMake::KeysightE4990a => &KEYSIGHT_E4990A,
        }
    }
}

impl RegisterMap {
    /// The registers of drives of this make.
    pub fn of(make: DriveMake) -> &'static Self {
        match make {
            DriveMake::OrientalAz => &ORIENTAL_AZ,
            DriveMake::IaiRc => &IAI_RC,
            DriveMake::LeadshinePr => &LEADSHINE_PR,
        }
    }
}

/// The text of the shipped file of this name.
pub fn shipped_text(name: &str) -> Option<&'static str> {
    Some(match name {
        "hioki-im3536" => text!("hioki-im3536"),
        "keysight-e4980a" => text!("keysight-e4980a"),
        "hp-4284a" => text!("hp-4284a"),
        "tonghui-th283x" => text!("tonghui-th283x"),
        "keysight-e4990a" => text!("keysight-e4990a"),
        "oriental-az" => text!("oriental-az"),
        "iai-rc" => text!("iai-rc"),
        "leadshine-pr" => text!("leadshine-pr"),
        _ => return None,
    })
}

fn dialect(name: &str, text: &str) -> Dialect {
    let (dialect, faults) = settings::read(name, text, dialect_keys::dialect);
    faults.finish(dialect).expect("a test reads every shipped file")
}

fn drive(name: &str, text: &str) -> RegisterMap {
    let (map, faults) = settings::read(name, text, drive_keys::drive);
    faults.finish(map).expect("a test reads every shipped file")
}
