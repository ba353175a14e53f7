//! What is shown of a rig before it moves, and by what.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use rig_commission::{Standing, Step};
use rig_files::rig_file::RigFile;
use rig_interlock::Proven;
use rig_model::with_causes;

use crate::{
    calibrations::{self, CalibrationsError},
    loaded_rig::LoadedRig,
};

/// Why a rig is opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// To measure. Until it is commissioned, it does nothing.
    Service,
    /// To be commissioned. It is not brought into service.
    Commissioning,
}

/// What is shown of a rig.
#[derive(Debug, Clone)]
pub(super) struct Proof {
    pub(super) proven: Proven,
    /// The steps that are missing, and why; `None` for a rig that may move.
    pub(super) missing: Option<Arc<str>>,
}

impl Proof {
    const COMPLETE: Self = Self { proven: Proven::Bench, missing: None };

    /// What the calibrations in a data directory show. The person of a simulated rig sees by itself whether the
    /// simulated bench is put together as the rig file says.
    pub(super) fn of(rig: &LoadedRig, data: Option<&Path>) -> Self {
        if rig.is_put_together_as_described() {
            return Self::COMPLETE;
        }
        data.map_or_else(Self::nothing, |data| Self::in_directory(&rig.file, data))
    }

    fn nothing() -> Self {
        let missing = "a rig without a data directory has no calibrations".into();
        Self { proven: Proven::Nothing, missing: Some(missing) }
    }

    fn in_directory(rig: &RigFile, data: &Path) -> Self {
        match calibrations::standing(rig, data) {
            Ok(standing) => Self::from(&standing),
            Err(error) => {
                Self { proven: Proven::Nothing, missing: Some(with_causes(&error).into()) }
            }
        }
    }

    /// The same for the way out of contact, which needs no disk: where calibrations cannot be read, the rig may
    /// have been in service.
    pub(super) fn for_way_out(rig: &LoadedRig, data: &Path) -> Self {
        if rig.is_put_together_as_described() {
            return Self::COMPLETE;
        }
        match calibrations::standing(&rig.file, data) {
            Ok(standing) => Self::from(&standing),
            Err(CalibrationsError::File { .. }) => Self::COMPLETE,
            Err(error) => {
                Self { proven: Proven::Nothing, missing: Some(with_causes(&error).into()) }
            }
        }
    }
}

impl From<&Standing> for Proof {
    fn from(standing: &Standing) -> Self {
        if standing.is_complete() {
            return Self::COMPLETE;
        }
        let has_signs = standing.has(Step::Stop) && standing.has(Step::Signs);
        let proven = if has_signs { Proven::Signs } else { Proven::Nothing };
        Self { proven, missing: Some(standing.to_string().into()) }
    }
}

/// A rig that is not in service, because it is not commissioned.
#[derive(Debug)]
pub(super) struct Uncommissioned {
    pub(super) purpose: Purpose,
    pub(super) missing: Arc<str>,
    rig: RigFile,
    /// Its data directory, with the calibrations; `None` in memory.
    data: Option<PathBuf>,
}

impl Uncommissioned {
    /// `None` for a rig that goes into service.
    pub(super) fn new(
        rig: &RigFile,
        data: Option<&Path>,
        purpose: Purpose,
        proof: &Proof,
    ) -> Option<Self> {
        let missing = match (&proof.missing, purpose) {
            (Some(missing), _) => Arc::clone(missing),
            (None, Purpose::Commissioning) => "it is being commissioned again".into(),
            (None, Purpose::Service) => return None,
        };
        Some(Self { purpose, missing, rig: rig.clone(), data: data.map(Path::to_owned) })
    }

    /// Number of steps that have a record, also of those that failed.
    pub(super) fn attempts(&self) -> u64 {
        let records = self.data.as_deref().map(calibrations::read);
        records.and_then(Result::ok).map_or(0, |records| records.len() as u64)
    }

    /// What the calibrations show now.
    pub(super) fn read_again(&self) -> Proof {
        self.data
            .as_deref()
            .map_or_else(Proof::nothing, |data| Proof::in_directory(&self.rig, data))
    }
}
