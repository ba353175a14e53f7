//! What is shown of a rig before it moves, and by what.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use rig_commission::{Basis, Standing, Step, Why};
use rig_interlock::Proven;
use rig_model::with_causes;

use crate::{
    calibrations::{self, CalibrationsError},
    loaded_rig::LoadedRig,
    transcripts::Unproven,
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
    /// The instruments with files of their own that no transcript proves; `None` if there are none. With them a
    /// rig is not in service, whatever its calibrations show.
    unproven: Option<Arc<str>>,
}

impl Proof {
    const COMPLETE: Self = Self { proven: Proven::Bench, missing: None, unproven: None };

    /// What the calibrations in a data directory show. The person of a simulated rig sees by itself whether the
    /// simulated bench is put together as the rig file says.
    pub(super) fn of(rig: &LoadedRig, data: Option<&Path>) -> Self {
        if rig.is_put_together_as_described() {
            return Self::COMPLETE;
        }
        let proof = data.map_or_else(Self::nothing, |data| Self::in_directory(&rig.basis(), data));
        proof.with_instruments(unproven_text(&rig.unproven()))
    }

    /// The same with these unproven instruments: the rig moves as in commissioning alone.
    fn with_instruments(self, unproven: Option<Arc<str>>) -> Self {
        let Some(text) = unproven else { return self };
        let proven = self.proven.min(Proven::Scales);
        let missing = match self.missing {
            Some(missing) => format!("{missing}; {text}").into(),
            None => Arc::clone(&text),
        };
        Self { proven, missing: Some(missing), unproven: Some(text) }
    }

    fn nothing() -> Self {
        let missing = "a rig without a data directory has no calibrations".into();
        Self { proven: Proven::Nothing, missing: Some(missing), unproven: None }
    }

    fn in_directory(basis: &Basis, data: &Path) -> Self {
        match calibrations::standing(basis, data) {
            Ok(standing) => Self::from(&standing),
            Err(error) => Self::unreadable(&error),
        }
    }

    fn unreadable(error: &CalibrationsError) -> Self {
        let missing = Some(with_causes(error).into());
        Self { proven: Proven::Nothing, missing, unproven: None }
    }

    /// The same for the way out of contact, which needs no disk: where calibrations cannot be read, or only their times do not
    /// fit the clock, the rig may have been in service.
    pub(super) fn for_way_out(rig: &LoadedRig, data: &Path) -> Self {
        if rig.is_put_together_as_described() {
            return Self::COMPLETE;
        }
        match calibrations::standing(&rig.basis(), data) {
            Ok(standing) => Self::of_way_out(&standing),
            Err(CalibrationsError::File { .. }) => Self::COMPLETE,
            Err(error) => Self::unreadable(&error),
        }
    }

    /// What expired while the rig was in service, and a clock that was set back, do not keep its probe in the sample.
    fn of_way_out(standing: &Standing) -> Self {
        if standing.missing().all(|(_, why)| matches!(why, Why::Expired | Why::Later)) {
            return Self::COMPLETE;
        }
        Self::from(standing)
    }
}

/// The unproven roles of instruments, and what proves them.
pub(crate) fn unproven_text(instruments: &[Unproven]) -> Option<Arc<str>> {
    let one = |Unproven { device, instrument, roles, trouble }: &Unproven| {
        let roles: Vec<_> = roles.iter().map(|role| role.name()).collect();
        let trouble = trouble.as_ref().map_or(String::new(), |trouble| format!(" ({trouble})"));
        format!("the file of {instrument} ({device}) is unproven: {}{trouble}", roles.join(", "))
    };
    let all: Vec<_> = instruments.iter().map(one).collect();
    let text = || format!("{}; `rigd instrument record` proves it", all.join("; "));
    (!all.is_empty()).then(|| text().into())
}

impl From<&Standing> for Proof {
    fn from(standing: &Standing) -> Self {
        if standing.is_complete() {
            return Self::COMPLETE;
        }
        let has_signs = standing.has(Step::Stop) && standing.has(Step::Signs);
        let proven = match has_signs {
            true if standing.has(Step::Scale) => Proven::Scales,
            true => Proven::Signs,
            false => Proven::Nothing,
        };
        Self { proven, missing: Some(standing.to_string().into()), unproven: None }
    }
}

/// A rig that is not in service, because it is not commissioned.
#[derive(Debug)]
pub(super) struct Uncommissioned {
    pub(super) purpose: Purpose,
    pub(super) missing: Arc<str>,
    unproven: Option<Arc<str>>,
    basis: Basis,
    /// Its data directory, with the calibrations; `None` in memory.
    data: Option<PathBuf>,
}

impl Uncommissioned {
    /// `None` for a rig that goes into service.
    pub(super) fn new(
        basis: Basis,
        data: Option<&Path>,
        purpose: Purpose,
        proof: &Proof,
    ) -> Option<Self> {
        let missing = match (&proof.missing, purpose) {
            (Some(missing), _) => Arc::clone(missing),
            (None, Purpose::Commissioning) => "it is being commissioned again".into(),
            (None, Purpose::Service) => return None,
        };
        let (unproven, data) = (proof.unproven.clone(), data.map(Path::to_owned));
        Some(Self { purpose, missing, unproven, basis, data })
    }

    /// Number of steps that have a record, also of those that failed.
    pub(super) fn attempts(&self) -> u64 {
        let records = self.data.as_deref().map(calibrations::read);
        records.and_then(Result::ok).map_or(0, |records| records.len() as u64)
    }

    /// What the calibrations show now.
    pub(super) fn read_again(&self) -> Proof {
        let data = self.data.as_deref();
        data.map_or_else(Proof::nothing, |data| Proof::in_directory(&self.basis, data))
            .with_instruments(self.unproven.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transcripts::Role;

    #[test]
    fn expired_calibrations_keep_no_probe_in_the_sample() {
        let expired = Step::ALL.map(|step| (step, Err(Why::Expired)));
        let mut standing = Standing { steps: expired.into() };
        assert_eq!(Proof::of_way_out(&standing).missing, None);
        // A clock that was set back makes them later than now.
        standing.steps[1].1 = Err(Why::Later);
        assert_eq!(Proof::of_way_out(&standing).missing, None);
        assert!(Proof::from(&standing).missing.is_some());
        for why in [Why::Never, Why::OtherDrives, Why::Failed, Why::Changed, Why::Begun] {
            standing.steps[0].1 = Err(why);
            assert!(Proof::of_way_out(&standing).missing.is_some(), "{why:?}");
        }
    }

    #[test]
    fn a_commissioned_rig_with_an_unproven_instrument_is_not_in_service() {
        let unproven = Unproven {
            device: "analyzer",
            instrument: "meter".to_owned(),
            roles: vec![Role::Setup, Role::Reading],
            trouble: None,
        };
        let text = unproven_text(&[unproven]);
        let said = "the file of meter (analyzer) is unproven: setup, reading; `rigd instrument record` proves it";
        assert_eq!(text.as_deref(), Some(said));
        let proof = Proof::COMPLETE.with_instruments(text.clone());
        assert_eq!((proof.proven, proof.missing.as_deref()), (Proven::Scales, Some(said)));
        let proof = Proof::nothing().with_instruments(text);
        assert_eq!(proof.proven, Proven::Nothing);
        assert!(proof.missing.is_some_and(|missing| missing.ends_with(said)));
        let proof = Proof::COMPLETE.with_instruments(unproven_text(&[]));
        assert_eq!((proof.proven, proof.missing), (Proven::Bench, None));
    }
}
