//! The state in which a killed program left a run or session, as text and as JSON.

use std::{collections::BTreeSet, iter};

use rig_engine::{Fault, Jump};
use rig_model::{Span, with_causes};
use rig_store::{
    Interruption, PREPARE, ProbeWord, Reader, Record, Run, RunKind, RunStatus, StoreError, intact,
};
use schemars::JsonSchema;
use serde::Serialize;

/// Advice for a probe that may be in the sample. It names no move: a person must see first where
/// the probe is.
pub(crate) const ADVICE: &str = "check by eye where the probe is, and touch neither the sample \
                                 nor the stages; if a position is said to be wrong or lost, move \
                                 nothing before that is mended; otherwise `rigd home` moves the \
                                 probe to its clear position before anything turns, and `rigd run \
                                 --resume` also resumes the run";

/// An interruption for a program.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub(crate) struct InterruptionView {
    /// When something was last written: UTC, RFC 3339.
    at: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    step: Option<String>,
    /// `clear`, `may be in contact` or `unknown`, at that moment.
    probe: &'static str,
    #[serde(skip)]
    is_clear: bool,
    /// Position of the linear axis at its last read-back before, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    at_mm: Option<f64>,
    /// The lowest position that it was allowed to go to, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    down_to_mm: Option<f64>,
    /// Whether the probe has been shown to be clear since.
    is_cleared_since: bool,
    /// All of it for a person.
    pub(crate) message: String,
}

impl InterruptionView {
    /// The state in which a killed program left a run or session.
    ///
    /// # Errors
    /// The record of the journal.
    pub(crate) fn read(reader: &Reader, run: &Run) -> Result<Option<Self>, StoreError> {
        Ok(reader.interruption(run)?.map(Self::from))
    }

    /// Whether the probe may still be in the sample, as far as the journal tells.
    pub(crate) fn is_open(&self) -> bool {
        !self.is_clear && !self.is_cleared_since
    }
}

impl From<Interruption> for InterruptionView {
    fn from(left: Interruption) -> Self {
        let message = sentence(&left);
        let Interruption { at, step, probe, is_cleared_since } = left;
        let is_clear = probe == ProbeWord::Clear;
        let (probe, at_mm, down_to_mm) = match probe {
            ProbeWord::Clear => ("clear", None, None),
            ProbeWord::MayTouch { at_mm, down_to_mm } => ("may be in contact", at_mm, down_to_mm),
            ProbeWord::Silent => ("unknown", None, None),
        };
        Self { at, step, probe, is_clear, at_mm, down_to_mm, is_cleared_since, message }
    }
}

/// A latch that nobody has acknowledged, also over several sessions.
fn latch(cause: &str) -> String {
    const LEFT: &str = "the rig was left latched, not acknowledged: ";
    // What was missing then may have been shown since.
    const CLOSED: &str = "the rig was not commissioned when it was closed, and its steps may have left the probe anywhere";
    let cause = cause.trim_start_matches(LEFT);
    if is_of_commissioning(cause) || cause == CLOSED {
        return CLOSED.to_owned();
    }
    format!("{LEFT}{cause}")
}

/// Whether a cause in the journal, which has the sentence of a fault and not its type, is that of
/// [`Fault::NotCommissioned`].
fn is_of_commissioning(cause: &str) -> bool {
    let fault = Fault::NotCommissioned { missing: String::new() };
    cause.starts_with(&fault.to_string())
}

/// The state of the probe of a rig that no program has open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeftProbe {
    /// Shown clear.
    Clear,
    /// Not shown clear: the program was killed before it had brought the rig into service, and the
    /// session before left the probe clear.
    Unproven,
    /// Lowered or lost, and not shown clear since.
    Lowered,
}

/// The state in which the last program left a rig.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct InterruptedRig {
    /// It was not closed in order.
    pub(crate) is_interrupted: bool,
    /// The rig must not move until a person acknowledges its state: the program was killed, or the rig was latched when it
    /// was closed, whether `rigd safe` has retracted since or not.
    pub(crate) is_latched: bool,
    /// The probe.
    pub(crate) probe: LeftProbe,
    /// The jump of the linear stage, if the rig was not in service since.
    pub(crate) jump: Option<Jump>,
    /// Interruption and probe in a sentence.
    pub(crate) message: String,
}

impl InterruptedRig {
    /// The state in which a rig was left, with every record behind it checked against its digest. Where one of them is damaged,
    /// nothing shows that the probe is clear. A real rig may have had another name in its file: what a session of another name
    /// left since its own last one counts too, if the probe was not clear.
    pub(crate) fn left(reader: &Reader, rig: &str, is_simulated: bool) -> Option<Self> {
        let own = Self::left_by(reader, rig).map(|left| {
            // The bench of a simulated rig is another one at each start.
            let is_latched = left.is_latched
                && (!is_simulated || left.is_interrupted || left.probe != LeftProbe::Clear);
            Self { is_latched, ..left }
        });
        if is_simulated || own.as_ref().is_some_and(Self::is_latched_in_contact) {
            return own;
        }
        let others = match names_since(reader, rig) {
            Ok(names) => names,
            Err(error) => return Some(Self::unreadable(&error)),
        };
        let mut of_others = others.into_iter().filter_map(|name| {
            let left = Self::left_by(reader, &name).filter(Self::is_latched_in_contact)?;
            let message =
                format!("under the name `{name}`, which may be this rig: {}", left.message);
            Some(Self { message, ..left })
        });
        of_others.next().or(own)
    }

    /// Whether the rig must not move, and its probe was not left clear.
    fn is_latched_in_contact(&self) -> bool {
        self.is_latched && self.probe != LeftProbe::Clear
    }

    fn left_by(reader: &Reader, rig: &str) -> Option<Self> {
        let checked = Self::read(reader, rig).and_then(|left| {
            if let Some(session) = reader.latest_session(rig)? {
                intact(session.id, &reader.verify(session.id)?)?;
                let is_last =
                    |run: &Run| run.kind != RunKind::Session && run.epoch == session.epoch;
                if let Some(run) = reader.every_run()?.into_iter().find(is_last) {
                    // One that is archived has all records that tell where the probe was.
                    intact(run.id, &reader.verify(run.id)?)?;
                }
            }
            Ok(left)
        });
        checked.unwrap_or_else(|error| Some(Self::unreadable(&error)))
    }

    /// The state of a rig whose journal does not tell it.
    fn unreadable(error: &StoreError) -> Self {
        let error = with_causes(error);
        let message = format!(
            "the journal of the last session is damaged ({error}); the probe may be in the sample"
        );
        let (is_interrupted, is_latched, probe) = (false, true, LeftProbe::Lowered);
        Self { is_interrupted, is_latched, probe, jump: None, message }
    }

    /// The state in which the latest session with a rig ended; `None` without one, or while it is
    /// open.
    ///
    /// # Errors
    /// The record of the journal.
    fn read(reader: &Reader, rig: &str) -> Result<Option<Self>, StoreError> {
        let Some(latest) = reader.latest_session(rig)? else { return Ok(None) };
        if latest.status == RunStatus::Running {
            return Ok(None);
        }
        let jump = reader.jump(rig)?.map(jump_of);
        let last_word = reader.probe_word(&latest)?;
        let session = if last_word == ProbeWord::Clear {
            Self::before_ways_out(reader, &latest)?.unwrap_or(latest)
        } else {
            latest
        };
        let Some(left) = InterruptionView::read(reader, &session)? else {
            let probe = last_word;
            let is_open = probe != ProbeWord::Clear;
            let latched = reader.latched_by(&session)?;
            let message = match (&latched, probe) {
                (Some(cause), _) => latch(cause),
                (None, ProbeWord::Clear) => "the probe was left clear".to_owned(),
                (None, other) => format!("the probe was not retracted{}", whereabouts(other)),
            };
            let is_latched = latched.is_some();
            let probe = if is_open { LeftProbe::Lowered } else { LeftProbe::Clear };
            return Ok(Some(Self { is_interrupted: false, is_latched, probe, jump, message }));
        };
        let is_its_run = |run: &Run| {
            run.kind == RunKind::Run && run.status.is_interrupted() && run.epoch == session.epoch
        };
        let probe = match left.is_open() {
            false => LeftProbe::Clear,
            true if Self::was_lowered(reader, &session)? => LeftProbe::Lowered,
            true => LeftProbe::Unproven,
        };
        let run = reader.every_run()?.into_iter().find(is_its_run);
        let (what, left) = match run {
            // It ended with its program, so that nothing was said of the probe after it.
            Some(run) => (run.short_name(), InterruptionView::read(reader, &run)?.unwrap_or(left)),
            None => ("the last session".to_owned(), left),
        };
        let elsewhere = jump.map_or_else(String::new, |jump| {
            format!("; the linear stage was read back elsewhere: {jump}, and the rig was not in service since")
        });
        let message = format!("{what} was {}{elsewhere}", left.message);
        Ok(Some(Self { is_interrupted: true, is_latched: true, probe, jump, message }))
    }

    /// The last session with a rig, up to `latest`, that was no way out, or was interrupted. `rigd safe`, which a service manager calls
    /// after every end, leaves the rig latched; where it has shown the probe clear, what the program before it left stands.
    fn before_ways_out(reader: &Reader, latest: &Run) -> Result<Option<Run>, StoreError> {
        let is_own = |run: &Run| run.kind == RunKind::Session && run.name == latest.name;
        for session in reader.every_run()?.into_iter().filter(is_own) {
            if session.status.is_interrupted() || was_in_service(reader, &session)? {
                intact(session.id, &reader.verify(session.id)?)?;
                return Ok(Some(session));
            }
        }
        Ok(None)
    }

    /// Whether the last word about the probe, in this session or before it, is that it was lowered or
    /// lost.
    fn was_lowered(reader: &Reader, session: &Run) -> Result<bool, StoreError> {
        let is_earlier = |run: &Run| {
            run.kind == RunKind::Session && run.name == session.name && run.epoch <= session.epoch
        };
        for session in reader.every_run()?.into_iter().filter(is_earlier) {
            match reader.probe_word(&session)? {
                ProbeWord::Silent => {}
                word => return Ok(word != ProbeWord::Clear),
            }
        }
        Ok(false)
    }
}

/// Whether a session was that of a program that brought its rig into service, or began to.
fn was_in_service(reader: &Reader, session: &Run) -> Result<bool, StoreError> {
    for stored in reader.unchecked(session.id, &["state_changed", "operator"])? {
        let is_of_service = match stored.record()? {
            Record::StateChanged(changed) => matches!(&*changed.state, "preparing" | "idle"),
            // A rig that nobody has latched is in preparation from the start, and no record says so.
            Record::Operator(operator) => operator.action == PREPARE,
            _ => false,
        };
        if is_of_service {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The names of the sessions since the last one of a rig, the latest first.
fn names_since(reader: &Reader, rig: &str) -> Result<Vec<String>, StoreError> {
    let sessions = reader.every_run()?.into_iter().filter(|run| run.kind == RunKind::Session);
    let mut seen = BTreeSet::new();
    let names = sessions.map(|run| run.name).take_while(|name| name != rig);
    Ok(names.filter(|name| seen.insert(name.clone())).collect())
}

/// The jump of the linear stage of a rig, if the rig was not in service since, under its name or, for a real rig, under another
/// one since its own last session. What cannot be read is passed over.
pub(crate) fn jump(reader: &Reader, rig: &str, is_simulated: bool) -> Option<Jump> {
    let others =
        if is_simulated { Vec::new() } else { names_since(reader, rig).unwrap_or_default() };
    let names = iter::once(rig).chain(others.iter().map(String::as_str));
    let mut jumps = names.filter_map(|name| reader.jump(name).ok().flatten());
    jumps.next().map(jump_of)
}

fn jump_of(jump: rig_store::Jump) -> Jump {
    let [low, high] = jump.last_moves_mm;
    Jump { last_moves: Span::new(low, high), is_homing_open: jump.is_homing_open }
}

/// When, in which step, and where the probe may be.
fn sentence(left: &Interruption) -> String {
    // Without milliseconds, but with the time zone.
    let at = left.at.split('.').next().unwrap_or_default().replace('T', " ");
    let step = left.step.as_ref().map_or_else(String::new, |step| format!(" in step {step}"));
    let probe = match (left.probe, left.is_cleared_since) {
        (ProbeWord::Clear, _) => "the probe was clear".to_owned(),
        (ProbeWord::Silent, false) => {
            "the probe had not yet been shown clear by a read-back".to_owned()
        }
        (ProbeWord::Silent, true) => {
            "the probe was shown clear only by a later read-back".to_owned()
        }
        (probe @ ProbeWord::MayTouch { .. }, false) => {
            format!("the probe may be in the sample{}", whereabouts(probe))
        }
        (ProbeWord::MayTouch { .. }, true) => {
            "the probe may have been in the sample; a later read-back showed it clear".to_owned()
        }
    };
    format!("interrupted at {at} UTC{step}; {probe}")
}

/// The journal's knowledge of a probe that was not shown clear.
fn whereabouts(probe: ProbeWord) -> String {
    let ProbeWord::MayTouch { at_mm, down_to_mm } = probe else { return String::new() };
    let at = at_mm.map(|at_mm| format!("last read back at {at_mm:.3} mm"));
    let down_to = down_to_mm.map(|to| format!("allowed down to {to:.3} mm"));
    let known: Vec<_> = at.into_iter().chain(down_to).collect();
    if known.is_empty() { String::new() } else { format!(" ({})", known.join(", ")) }
}

#[cfg(test)]
mod tests {
    use std::{path::Path, slice};

    use rig_store::{
        Axis, Clearance, Ending, Fault, Intent, Move, MoveReason, Record, RunFinished,
        StateChanged, Store,
    };

    use super::*;

    #[test]
    fn a_latch_over_several_sessions_is_told_once_and_without_what_was_missing() {
        let once = "the rig was left latched, not acknowledged: a drive is gone";
        assert_eq!(latch("a drive is gone"), once);
        assert_eq!(latch(once), once);
        let fault = rig_engine::Fault::NotCommissioned { missing: "scale (never made)".to_owned() };
        let said = latch(&fault.to_string());
        assert!(said.starts_with("the rig was not commissioned when it was closed"), "{said}");
        assert_eq!(latch(&said), said);
    }

    /// A session of a rig of this name, whose program is killed.
    fn killed(data: &Path, rig: &str, records: &[Record]) {
        let store = Store::open(data).unwrap();
        let mut session = store.begin(RunKind::Session, rig).unwrap();
        for record in records {
            session.append(0, record).unwrap();
        }
        session.commit().unwrap();
    }

    /// `rigd safe` comes after every end, as the service manager calls it.
    #[test]
    fn a_latch_outlasts_a_restart_and_an_ordinary_end_leaves_none() {
        let (what, axis) = (MoveReason::Approach, Axis::LinearMm);
        let lowering = Record::Intent(Intent { what, axis, from: None, to: 9.5, limit: None });
        let state = |state: &str| {
            Record::StateChanged(StateChanged { state: state.to_owned(), reason: None })
        };
        let stopped = |by: &str, probe: Clearance| {
            let (cause, hint) = (format!("stopped by {by}"), "look".to_owned());
            let last_moves_mm = None;
            Record::Fault(Fault { step: None, cause, probe, hint, last_moves_mm })
        };
        let clear = Record::Moved(Move { axis, target: 24.5, read_back: 24.5, is_clear: true });
        let ended = Record::RunFinished(RunFinished { status: Ending::Completed });
        let service = [state("preparing"), clear.clone(), state("idle")];
        let safe = [
            stopped("rigd", Clearance::Unknown),
            state("retracting"),
            clear,
            state("latched"),
            ended.clone(),
        ];
        let killed_in_contact = [&service[..], &[lowering]].concat();
        let latched =
            [&service[..], &[stopped("Ada", Clearance::Clear), state("latched"), ended.clone()]]
                .concat();
        let in_order = [&service[..], &[ended]].concat();
        for (last, is_latched, is_interrupted, says) in [
            (&killed_in_contact, true, true, "a later read-back showed it clear"),
            (&latched, true, false, "the rig was left latched, not acknowledged: stopped by Ada"),
            (&in_order, false, false, "the probe was left clear"),
        ] {
            let data = tempfile::TempDir::new().unwrap();
            killed(data.path(), "bench", last);
            for ways_out in 0..3 {
                let reader = Reader::open(data.path()).unwrap();
                let left = InterruptedRig::left(&reader, "bench", false).unwrap();
                let found = (left.is_latched, left.is_interrupted);
                assert_eq!(found, (is_latched, is_interrupted), "{says}, {ways_out}");
                let is_shown = ways_out > 0 || !is_interrupted;
                assert_eq!(left.probe == LeftProbe::Clear, is_shown, "{says}, {ways_out}");
                assert!(!is_shown || left.message.ends_with(says), "{}", left.message);
                killed(data.path(), "bench", &safe);
            }
            // A person has acknowledged since, and the rig was closed in order.
            killed(data.path(), "bench", &in_order);
            let reader = Reader::open(data.path()).unwrap();
            let left = InterruptedRig::left(&reader, "bench", false).unwrap();
            assert!(!left.is_latched && left.probe == LeftProbe::Clear, "{says}");
        }
    }

    #[test]
    fn a_real_rig_under_another_name_is_left_as_it_was() {
        let data = tempfile::TempDir::new().unwrap();
        let (what, axis) = (MoveReason::Approach, Axis::LinearMm);
        let lowering = Record::Intent(Intent { what, axis, from: None, to: 9.5, limit: None });
        let clear = Record::Moved(Move { axis, target: 24.5, read_back: 24.5, is_clear: true });
        let left = |rig, is_simulated| {
            let reader = Reader::open(data.path()).unwrap();
            InterruptedRig::left(&reader, rig, is_simulated)
        };
        killed(data.path(), "bench", slice::from_ref(&clear));
        assert_eq!(left("bench 2", false), None);
        killed(data.path(), "bench", slice::from_ref(&lowering));
        killed(data.path(), "simulated bench", slice::from_ref(&clear));
        let found = left("bench 2", false).unwrap();
        assert_eq!((found.is_latched, found.probe), (true, LeftProbe::Lowered));
        let said =
            "under the name `bench`, which may be this rig: the last session was interrupted";
        assert!(found.message.starts_with(said), "{}", found.message);
        assert_eq!(left("bench 2", true), None);
        // Since it was shown clear under its new name, the old one says nothing.
        killed(data.path(), "bench 2", slice::from_ref(&clear));
        assert_eq!(left("bench 2", false).unwrap().probe, LeftProbe::Clear);
    }

    #[test]
    fn a_position_that_was_said_to_be_wrong_is_so_after_a_restart() {
        let data = tempfile::TempDir::new().unwrap();
        let (cause, hint) = ("elsewhere".to_owned(), "look".to_owned());
        let (probe, last_moves_mm) = (Clearance::Unknown, Some([9.5, 24.5]));
        let jumped = Fault { step: None, cause, probe, hint, last_moves_mm };
        killed(data.path(), "bench", &[Record::Fault(jumped)]);
        let reader = Reader::open(data.path()).unwrap();
        let left = InterruptedRig::left(&reader, "bench", false).unwrap();
        let expected = Some(Jump { last_moves: Span::new(9.5, 24.5), is_homing_open: false });
        assert_eq!(left.jump, expected);
        // For the way out, too, which knows only the present name.
        let known = |rig, is_simulated| jump(&reader, rig, is_simulated);
        assert_eq!([known("bench", false), known("bench 2", false)], [expected; 2]);
        assert_eq!(known("bench 2", true), None);
        let says = "elsewhere: its last moves were between 9.500 mm and 24.500 mm, and the rig was not in service since";
        assert!(left.is_latched && left.message.ends_with(says), "{}", left.message);
    }

    #[test]
    fn a_list_of_runs_that_cannot_be_read_shows_no_probe_of_a_real_rig_clear() {
        let data = tempfile::TempDir::new().unwrap();
        let (axis, target) = (Axis::LinearMm, 24.5);
        let clear = Record::Moved(Move { axis, target, read_back: target, is_clear: true });
        killed(data.path(), "bench", slice::from_ref(&clear));
        killed(data.path(), "simulated bench", &[clear]);
        let database = rusqlite::Connection::open(data.path().join("rigd.db")).unwrap();
        let damage = "UPDATE runs SET kind = 'sessiom' WHERE name = 'simulated bench'";
        assert_eq!(database.execute(damage, []).unwrap(), 1);
        let reader = Reader::open(data.path()).unwrap();
        for rig in ["bench", "bench 2"] {
            let left = InterruptedRig::left(&reader, rig, false).unwrap();
            assert_eq!((left.is_latched, left.probe), (true, LeftProbe::Lowered), "{rig}");
            assert!(left.message.contains("is damaged"), "{}", left.message);
        }
        // A simulated rig looks for its own sessions only.
        assert_eq!(InterruptedRig::left(&reader, "bench 2", true), None);
    }

    #[track_caller]
    fn check(probe: ProbeWord, is_cleared_since: bool, is_open: bool, expected: &str) {
        let left = Interruption {
            at: "2026-11-22T06:20:01.123Z".to_owned(),
            step: Some("main/1/left/0/1".to_owned()),
            probe,
            is_cleared_since,
        };
        let view = InterruptionView::from(left);
        let before = "interrupted at 2026-11-22 06:20:01 UTC in step main/1/left/0/1; the probe ";
        assert_eq!(view.message.strip_prefix(before), Some(expected));
        assert_eq!(view.is_open(), is_open);
    }

    #[test]
    fn an_interruption_says_when_where_and_what_of_the_probe() {
        let touching = |at_mm, down_to_mm| ProbeWord::MayTouch { at_mm, down_to_mm };
        let lowered =
            "may be in the sample (last read back at 10.300 mm, allowed down to 9.500 mm)";
        check(touching(Some(10.3), Some(9.5)), false, true, lowered);
        let about_to = "may be in the sample (allowed down to 9.500 mm)";
        check(touching(None, Some(9.5)), false, true, about_to);
        check(touching(None, None), false, true, "may be in the sample");
        let later = "may have been in the sample; a later read-back showed it clear";
        check(touching(Some(10.3), Some(9.5)), true, false, later);
        check(ProbeWord::Clear, false, false, "was clear");
        check(ProbeWord::Silent, false, true, "had not yet been shown clear by a read-back");
        check(ProbeWord::Silent, true, false, "was shown clear only by a later read-back");
    }
}
