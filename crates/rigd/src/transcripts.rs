//! Transcripts of instruments: recorded on a port, and replayed against an instrument file.
//!
//! A role of an instrument, such as its identity or a reading, is proven when a recorded exchange replays
//! byte by byte through the driver with the same result. A replay proves the messages and not the physics:
//! signs, scales and moves are proven by the commissioning of the bench.

mod file;
mod record;
mod replay;
mod roles;

use std::path::{Path, PathBuf};

use rig_files::{instrument::Named, rig_file::RigFile};
use rig_model::with_causes;

pub(crate) use file::{TranscriptError, TranscriptFile};
pub(crate) use record::{Recorded, keep_frames, record, record_analyzer, record_axis};
pub(crate) use replay::{Device, RoleProof, Verdict, replay};
pub use roles::Role;

use crate::loaded_rig::LoadedRig;

/// The end of the name of a transcript, which stands beside the file of its instrument.
const ENDING: &str = "transcript";

/// An instrument with roles that no transcript proves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unproven {
    /// Role of the device on the rig.
    pub device: &'static str,
    /// Name of the instrument.
    pub instrument: String,
    /// The roles without a transcript, or with one that differs.
    pub roles: Vec<Role>,
    /// Why its transcript proves nothing, where there is one that cannot be used.
    pub trouble: Option<String>,
}

/// The transcript that belongs to an instrument file.
pub(crate) fn beside(file: &Path) -> PathBuf {
    file.with_extension(ENDING)
}

impl LoadedRig {
    /// The instruments with files of their own that a transcript does not prove. A rig with one of them
    /// may be used in commissioning alone. Shipped instruments are proven by the tests of the project.
    pub fn unproven(&self) -> Vec<Unproven> {
        let RigFile { analyzer, linear, rotary, .. } = &self.file;
        let devices = [
            (
                "analyzer",
                file_of(&analyzer.instrument),
                Device::Analyzer(self.instruments.analyzer),
            ),
            ("linear stage", file_of(&linear.instrument), Device::Drive(self.instruments.linear)),
            ("rotary stage", file_of(&rotary.instrument), Device::Drive(self.instruments.rotary)),
        ];
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let unproven = |(device, file, instrument): (&'static str, Option<&Path>, Device)| {
            let transcript = beside(&folder.join(file?));
            let (roles, trouble) = unproven_roles(instrument, &transcript);
            let instrument = instrument.name().to_owned();
            let unproven = Unproven { device, instrument, roles, trouble };
            (!unproven.roles.is_empty()).then_some(unproven)
        };
        devices.into_iter().filter_map(unproven).collect()
    }

    /// Whether every instrument with a file of its own is proven by its transcript.
    pub fn is_proven(&self) -> bool {
        self.unproven().is_empty()
    }
}

fn file_of<M>(named: &Named<M>) -> Option<&Path> {
    match named {
        Named::Shipped(_) => None,
        Named::File { path, .. } => Some(path),
    }
}

/// The roles of an instrument that the transcript does not prove; all of them without a transcript, or with one that
/// cannot be used, and then why not.
fn unproven_roles(instrument: Device, transcript: &Path) -> (Vec<Role>, Option<String>) {
    let all = || instrument.roles().to_vec();
    if !transcript.exists() {
        return (all(), None);
    }
    match TranscriptFile::load(transcript).and_then(|file| replay(instrument, &file)) {
        Err(error) => (all(), Some(with_causes(&error))),
        Ok(proofs) => {
            let is_open = |proof: &RoleProof| !matches!(proof.verdict, Verdict::Proven);
            (proofs.into_iter().filter(is_open).map(|proof| proof.role).collect(), None)
        }
    }
}
