//! Resuming a run after an interruption, a fault or an abort.
//!
//! ```text
//!  run_started … touch_result … ✂ │ resumed  step_started  prompt_asked … touch_result …
//! run_finished
//!  └──────────── as it is ────────┘ └─ seam: new clock, what changed, who went on
//! ```

use std::{collections::BTreeSet, path::Path};

use rig_files::{Faults, rig_file::RigFile, settings::InForce};
use rig_model::with_causes;
use rig_protocol::{Action, Plan};
use rig_store::{
    Archived, Change, CitedCalibration, Device, Reader, Record, Resumed, Run, RunId, RunStarted,
    RunStatus, Source, StoreError, StoredRecord,
};

use super::{DeviceIdentity, Setting};
use crate::{calibrations, corrections, protocol_file::LoadedProtocol};

/// Why a run cannot be resumed. Nothing has changed.
#[derive(Debug, thiserror::Error)]
pub enum ResumeRefusal {
    /// The journal cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The run was completed or given up.
    #[error("{run} is {status} and sealed; nothing can be added to it")]
    Sealed {
        /// Name and id of the run.
        run: String,
        /// How the run ended.
        status: String,
    },
    /// The run is under way.
    #[error("{run} is under way")]
    UnderWay {
        /// Name and id of the run.
        run: String,
    },
    /// The first record of the run is missing.
    #[error("{run} has no beginning in the journal, so that its protocol is not known")]
    NoBeginning {
        /// Name and id of the run.
        run: String,
    },
    /// Results of real and of simulated instruments would be mixed.
    #[error("{run} was made on a {was} rig, and this rig is {is}: choose the rig file with --rig")]
    OtherKind {
        /// Name and id of the run.
        run: String,
        /// `real` or `simulated`.
        was: &'static str,
        /// The other one.
        is: &'static str,
    },
    /// The protocol does not fit the rig any more.
    #[error("the protocol of the run does not fit this rig: {}", first(.0))]
    Protocol(Faults),
    /// Something has changed since, which a person has to confirm.
    #[error(
        "since {run}, these have changed: {}; restore them, or confirm the change",
        listed(.changes)
    )]
    Changed {
        /// Name and id of the run.
        run: String,
        /// Changes since the run began.
        changes: Vec<Change>,
    },
    /// The run has no such touch.
    #[error("{run} has no touch {step}")]
    NoSuchTouch {
        /// Name and id of the run.
        run: String,
        /// Address of the touch.
        step: String,
    },
}

fn first(faults: &Faults) -> String {
    faults.iter().next().map(ToString::to_string).unwrap_or_default()
}

fn listed(changes: &[Change]) -> String {
    let one = |Change { what, was, is }: &Change| {
        if was == is { what.clone() } else { format!("{what} ({was} → {is})") }
    };
    changes.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Refuses a run that is under way or sealed.
pub(super) fn resumable(run: &Run) -> Result<(), ResumeRefusal> {
    if run.status == RunStatus::Running {
        return Err(ResumeRefusal::UnderWay { run: run.to_string() });
    }
    if !run.is_resumable() {
        return Err(ResumeRefusal::Sealed { run: run.to_string(), status: run.status.describe() });
    }
    Ok(())
}

/// Refuses a run that is sealed or damaged, for a program that has no rig yet. Whether it fits the rig is not known then. One
/// under way is left to the opening of the rig, whose refusal names the other program.
///
/// # Errors
/// [`ResumeRefusal`].
pub(crate) fn may_resume(reader: &Reader, run: &Run) -> Result<(), ResumeRefusal> {
    if run.status == RunStatus::Running {
        return Ok(());
    }
    resumable(run)?;
    may_amend(reader, run)
}

/// Refuses a run of which no touch can be measured again because its records are damaged or in an archive.
///
/// # Errors
/// [`ResumeRefusal`].
pub(crate) fn may_amend(reader: &Reader, run: &Run) -> Result<(), ResumeRefusal> {
    if let Some(Archived { place, .. }) = reader.archive_of(run.id)? {
        return Err(StoreError::Archived { run: run.id, place }.into());
    }
    for part in [run.id].into_iter().chain(reader.amendments(run.id)?) {
        rig_store::intact(part, &reader.verify(part)?)?;
    }
    Ok(())
}

/// A run from the journal, to be resumed or amended.
pub(super) struct Known {
    pub(super) run: Run,
    pub(super) records: Vec<StoredRecord>,
    /// The protocol, laid out for the present rig.
    pub(super) protocol: LoadedProtocol,
    /// Differences between then and now.
    pub(super) changes: Vec<Change>,
    /// What a run would cite that began now.
    calibrations: Vec<CitedCalibration>,
}

/// The finished and the missing touches of a run.
pub(super) struct Rest {
    /// The done steps and, behind them, the steps of the touches that are left.
    pub(super) plan: Plan,
    /// Number of done steps.
    pub(super) from: usize,
    /// Number of touches with a result or a refusal.
    pub(super) touches_done: usize,
    pub(super) touches_refused: usize,
    pub(super) touches_skipped: usize,
    /// Number of the last sweep.
    pub(super) sweeps: u64,
}

impl Known {
    /// Reads a run and compares it with the present rig.
    pub(super) fn read(
        reader: &Reader,
        id: RunId,
        now: Present<'_>,
        samples: &[(String, f64)],
    ) -> Result<Self, ResumeRefusal> {
        let run = reader.run(id)?;
        let records = reader.amended(id)?;
        let Some(started) = started(&records)? else {
            return Err(ResumeRefusal::NoBeginning { run: run.to_string() });
        };
        let setting = now.setting;
        let is_simulated = setting.scene.is_some();
        if started.is_simulated != is_simulated {
            let word = |is_simulated| if is_simulated { "simulated" } else { "real" };
            return Err(ResumeRefusal::OtherKind {
                run: run.to_string(),
                was: word(started.is_simulated),
                is: word(is_simulated),
            });
        }
        let known: Option<Vec<String>> =
            is_simulated.then(|| samples.iter().map(|(name, _)| name.clone()).collect());
        let protocol = LoadedProtocol::of_run(&started, &setting.limits, known.as_deref())
            .map_err(ResumeRefusal::Protocol)?;
        let changes = changes(&records, &started, now)?;
        Ok(Self { run, records, protocol, changes, calibrations: now.calibrations.to_vec() })
    }

    /// Digest of the last record of the run itself, in hexadecimal.
    pub(super) fn head(&self) -> String {
        let own = self.records.iter().rev().find(|stored| stored.run == self.run.id);
        own.map(|last| last.digest.to_string()).unwrap_or_default()
    }

    /// The plan of one of its touches.
    pub(super) fn only(&self, step: &str) -> Result<Plan, ResumeRefusal> {
        let none =
            || ResumeRefusal::NoSuchTouch { run: self.run.to_string(), step: step.to_owned() };
        self.protocol.plan.only(step).ok_or_else(none)
    }

    /// Refuses changes without a confirmation.
    pub(super) fn confirm(&self, is_confirmed: bool) -> Result<(), ResumeRefusal> {
        if self.changes.is_empty() || is_confirmed {
            return Ok(());
        }
        let (run, changes) = (self.run.to_string(), self.changes.clone());
        Err(ResumeRefusal::Changed { run, changes })
    }

    fn has_changed(&self, what: &str) -> bool {
        self.changes.iter().any(|change| change.what == what)
    }

    /// The rig file, if it has changed.
    pub(super) fn changed_rig(&self, setting: &Setting) -> Option<Source> {
        self.has_changed(RIG_FILE).then(|| setting.rig.clone())
    }

    /// What a run would cite that began now, if a calibration or a correction has changed.
    pub(super) fn changed_calibrations(&self) -> Option<Vec<CitedCalibration>> {
        let is_cited = |change: &Change| {
            ["calibration (", "correction ("].iter().any(|begin| change.what.starts_with(begin))
        };
        self.changes.iter().any(is_cited).then(|| self.calibrations.clone())
    }

    pub(super) fn rest(&self) -> Result<Rest, ResumeRefusal> {
        let outcomes = Outcomes::of(&self.records)?;
        let (plan, from) = self.protocol.plan.resumed(|step| outcomes.done.contains(&step.0));
        let (touches_refused, touches_skipped) = (outcomes.refused.len(), outcomes.skipped.len());
        let touches_done = outcomes.done.len() - touches_skipped;
        let sweeps = outcomes.sweeps;
        Ok(Rest { plan, from, touches_done, touches_refused, touches_skipped, sweeps })
    }

    /// The record at the seam.
    pub(super) fn resumed(&self, rest: &Rest, epoch: u64, who: &str, setting: &Setting) -> Record {
        let left = rest.plan.steps[rest.from..].iter();
        let mut left = left.filter(|step| matches!(step.action, Action::Touch(_)));
        let next = left.next().map(|step| step.id.to_string());
        let count = |touches| u32::try_from(touches).unwrap_or(u32::MAX);
        Record::Resumed(Resumed {
            epoch,
            who: who.to_owned(),
            touches_left: count(usize::from(next.is_some()) + left.count()),
            next,
            touches_done: count(rest.touches_done + rest.touches_skipped),
            changes: self.changes.clone(),
            software: SOFTWARE.to_owned(),
            rig: self.changed_rig(setting),
            scene: setting.scene.clone().filter(|_| self.has_changed(SCENE_FILE)),
            calibrations: self.changed_calibrations(),
            devices: devices(setting),
        })
    }
}

/// This program, its version and the commit that it was built from.
pub const SOFTWARE: &str = concat!("rigd ", env!("CARGO_PKG_VERSION"), env!("RIGD_COMMIT"));
const RIG_FILE: &str = "rig file";
const SCENE_FILE: &str = "scene file";
const INSTRUMENT_FILE: &str = "instrument file";

pub(super) fn devices(setting: &Setting) -> Vec<Device> {
    let device = |device: &super::DeviceIdentity| Device {
        role: device.role.to_owned(),
        identity: device.identity.clone(),
        instrument: device.instrument.cloned(),
    };
    setting.devices.iter().map(device).collect()
}

/// What a run is compared with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Present<'a> {
    pub(crate) setting: &'a Setting,
    /// What a run would cite that began now.
    pub(crate) calibrations: &'a [CitedCalibration],
}

/// The calibrations that hold now, the last daily check, and the corrections that were made last for this analyzer.
/// Those that cannot be read are not cited.
pub(crate) fn cited(data: &Path, setting: &Setting) -> Vec<CitedCalibration> {
    let mut cited = calibrations::cited(&setting.rests_on, data).unwrap_or_else(|error| {
        let error = with_causes(&error);
        tracing::warn!(error, "the calibrations cannot be read, and the run cites none");
        Vec::new()
    });
    let is_analyzer = |device: &&DeviceIdentity| device.role == "analyzer";
    if let Some(analyzer) = setting.devices.iter().find(is_analyzer) {
        match corrections::cited(data, &analyzer.identity) {
            Ok(corrections) => cited.extend(corrections),
            Err(error) => {
                tracing::warn!(%error, "the corrections cannot be read, and the run cites none");
            }
        }
    }
    cited
}

pub(super) fn started(records: &[StoredRecord]) -> Result<Option<RunStarted>, StoreError> {
    match records.first().map(StoredRecord::record).transpose()? {
        Some(Record::RunStarted(started)) => Ok(Some(started)),
        _ => Ok(None),
    }
}

/// Differences between a run and the present rig; none if the beginning of the run is missing.
///
/// # Errors
/// [`StoreError`] if a record cannot be understood.
pub(crate) fn changes_since(
    records: &[StoredRecord],
    now: Present<'_>,
) -> Result<Vec<Change>, StoreError> {
    match started(records)? {
        Some(started) => changes(records, &started, now),
        None => Ok(Vec::new()),
    }
}

/// Differences between the last part of a run and now.
fn changes(
    records: &[StoredRecord],
    started: &RunStarted,
    Present { setting, calibrations }: Present<'_>,
) -> Result<Vec<Change>, StoreError> {
    let (mut rig, mut scene) = (&started.rig, started.scene.as_ref());
    let (mut software, mut known) = (&started.software, &started.devices);
    let mut cites = &started.calibrations;
    let seams: Vec<Resumed> = records
        .iter()
        .filter(|stored| stored.kind == "resumed")
        .filter_map(|stored| match stored.record() {
            Ok(Record::Resumed(resumed)) => Some(Ok(resumed)),
            Ok(_) => None,
            Err(error) => Some(Err(error)),
        })
        .collect::<Result<_, _>>()?;
    for seam in &seams {
        rig = seam.rig.as_ref().unwrap_or(rig);
        scene = seam.scene.as_ref().or(scene);
        (software, known) = (&seam.software, &seam.devices);
        cites = seam.calibrations.as_ref().unwrap_or(cites);
    }
    let mut changes = Vec::new();
    let mut compare = |what: &str, was: &str, is: &str, is_same: bool| {
        if !is_same {
            let [what, was, is] = [what, was, is].map(str::to_owned);
            changes.push(Change { what, was, is });
        }
    };
    let [was, is] = rig_files_apart(rig, &setting.rig);
    compare(RIG_FILE, &was, &is, *rig == setting.rig);
    if let (Some(was), Some(is)) = (scene, &setting.scene) {
        compare(SCENE_FILE, &was.name, &is.name, was == is);
    }
    compare("software", software, SOFTWARE, software == SOFTWARE);
    let file = |file: Option<&Source>| file.map_or_else(|| "none".to_owned(), |of| of.name.clone());
    for Device { role, identity, instrument } in devices(setting) {
        let known = known.iter().find(|known| known.role == role);
        let was = known.map_or("none", |was| was.identity.as_str());
        compare(&role, was, &identity, was == identity);
        let (was, is) = (known.and_then(|was| was.instrument.as_ref()), instrument.as_ref());
        compare(&format!("{INSTRUMENT_FILE} of the {role}"), &file(was), &file(is), was == is);
    }
    for (kind, was, is) in both(cites, calibrations) {
        let text = |cited: Option<&CitedCalibration>| {
            cited.map_or_else(|| "none".to_owned(), |of| format!("{} of {}", of.file, of.made))
        };
        let digest = |cited: Option<&CitedCalibration>| cited.map(|of| of.sha256.clone());
        compare(&kind, &text(was), &text(is), digest(was) == digest(is));
    }
    Ok(changes)
}

/// The calibrations and corrections of a run beside those of now, with what each is. A daily check is made each day, and is
/// none of them.
fn both<'a>(
    were: &'a [CitedCalibration],
    are: &'a [CitedCalibration],
) -> Vec<(String, Option<&'a CitedCalibration>, Option<&'a CitedCalibration>)> {
    let of = |all: &'a [CitedCalibration], kind: &str| all.iter().find(|cited| cited.kind == kind);
    let mut kinds: Vec<&CitedCalibration> = Vec::new();
    for cited in were.iter().chain(are).filter(|cited| cited.verdict.is_none()) {
        if kinds.iter().all(|known| known.kind != cited.kind) {
            kinds.push(cited);
        }
    }
    let named = |cited: &CitedCalibration| {
        let group = if cited.cable.is_some() { "correction" } else { "calibration" };
        let kind = &cited.kind;
        (format!("{group} ({kind})"), of(were, kind), of(are, kind))
    };
    kinds.into_iter().map(named).collect()
}

/// The names of two rig files, and the first keys in which they differ.
fn rig_files_apart(was: &Source, is: &Source) -> [String; 2] {
    /// A person recognises a change by so many keys.
    const KEYS: usize = 3;
    let values =
        |source: &Source| RigFile::in_force(&source.name, &source.toml).unwrap_or_default();
    let text = |values: &[InForce], name: &str| {
        let value = values.iter().find(|value| value.name == name);
        value.and_then(|value| value.text.clone()).unwrap_or_else(|| "not given".to_owned())
    };
    let (before, now) = (values(was), values(is));
    let mut apart = Vec::new();
    for InForce { name, .. } in before.iter().chain(&now) {
        let pair = [text(&before, name), text(&now, name)];
        if pair[0] != pair[1] && !apart.iter().any(|(known, _)| *known == name) {
            apart.push((name, pair));
        }
    }
    let more = apart.len().saturating_sub(KEYS);
    let side = |file: &str, side: usize| {
        let keys = apart.iter().take(KEYS).map(|(name, pair)| format!("{name} = {}", pair[side]));
        let mut keys: Vec<_> = keys.collect();
        keys.extend((more > 0).then(|| format!("{more} more")));
        if keys.is_empty() { file.to_owned() } else { format!("{file}: {}", keys.join(", ")) }
    };
    [side(&was.name, 0), side(&is.name, 1)]
}

/// The finished touches. An amendment replaces the outcome of a touch.
#[derive(Debug, Default)]
pub(crate) struct Outcomes {
    /// Touches with a result or a refusal, and those that a person left out.
    done: BTreeSet<String>,
    refused: BTreeSet<String>,
    skipped: BTreeSet<String>,
    /// Number of the last sweep.
    sweeps: u64,
}

impl Outcomes {
    pub(crate) fn of(records: &[StoredRecord]) -> Result<Self, StoreError> {
        let mut outcomes = Self::default();
        let kinds = ["touch_result", "touch_refused", "amended", "sweep"];
        for stored in records.iter().filter(|stored| kinds.contains(&&*stored.kind)) {
            match stored.record()? {
                Record::TouchResult(touch) => outcomes.done(touch.touch.step, false),
                Record::TouchRefused(refused) => outcomes.done(refused.touch.step, true),
                Record::Amended(amended) if amended.what == rig_store::Amendment::Skip => {
                    outcomes.skipped.insert(amended.step.clone());
                    outcomes.refused.remove(&amended.step);
                    outcomes.done.insert(amended.step);
                }
                Record::Sweep(sweep) => outcomes.sweeps = outcomes.sweeps.max(sweep.number),
                _ => {}
            }
        }
        Ok(outcomes)
    }

    fn done(&mut self, step: String, is_refused: bool) {
        if is_refused {
            self.refused.insert(step.clone());
        } else {
            self.refused.remove(&step);
        }
        self.skipped.remove(&step);
        self.done.insert(step);
    }

    /// Whether a touch is finished.
    pub(crate) fn is_done(&self, step: &str) -> bool {
        self.done.contains(step)
    }
}
