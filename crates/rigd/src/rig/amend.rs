//! Amendments: one touch of a run is measured again or left out. The run itself is unchanged.

use rig_store::{
    Amended, Amendment, Ending, Journal, Record, Run, RunFinished, RunId, RunKind, RunStatus, Store,
};

use super::{
    Setting,
    resume::{Known, ResumeRefusal, SOFTWARE, devices, may_amend, started},
};

/// The touch to amend, the person, and the reason.
#[derive(Debug, Clone)]
pub struct TouchOrder {
    /// The run.
    pub run: RunId,
    /// Address of the touch.
    pub step: String,
    /// The reason, for the journal.
    pub why: String,
}

/// Begins the journal of a touch that is measured again.
pub(super) fn redo(
    store: &Store,
    known: &Known,
    order: &TouchOrder,
    who: &str,
    rig_us: u64,
    setting: &Setting,
) -> Result<Journal, ResumeRefusal> {
    let head = known.head();
    let amended = Amended {
        rig: known.changed_rig(setting),
        calibrations: known.changed_calibrations(),
        devices: devices(setting),
        changes: known.changes.clone(),
        ..amended(order, Amendment::Redo, who, head)
    };
    let mut journal = store.begin(RunKind::Amendment, &order.run.to_string())?;
    journal.append(rig_us, &Record::Amended(amended))?;
    Ok(journal)
}

/// Refuses an order about a run of which a touch is being measured again.
pub(super) fn is_not_of(under_way: &Run, order: &TouchOrder) -> Result<(), ResumeRefusal> {
    let is_of_it = under_way.kind == RunKind::Amendment && under_way.name == order.run.to_string();
    if is_of_it {
        return Err(ResumeRefusal::UnderWay { run: under_way.to_string() });
    }
    Ok(())
}

/// Leaves a touch of a run out: its outcome is not used, and it is not measured when the run is
/// resumed.
///
/// # Errors
/// [`ResumeRefusal`]; nothing has changed then.
pub fn skip(
    store: &Store,
    order: &TouchOrder,
    who: &str,
    rig_us: u64,
) -> Result<(), ResumeRefusal> {
    let reader = store.reader()?;
    let run = reader.run(order.run)?;
    if run.status == RunStatus::Running {
        return Err(ResumeRefusal::UnderWay { run: run.to_string() });
    }
    may_amend(&reader, &run)?;
    write_skip(store, order, who, rig_us)
}

/// The same for a touch that is ahead in the run under way, which the engine leaves out. Of a run under way, only its
/// start is read: a stop would have to wait for all of it.
pub(super) fn write_skip(
    store: &Store,
    order: &TouchOrder,
    who: &str,
    rig_us: u64,
) -> Result<(), ResumeRefusal> {
    let reader = store.reader()?;
    let run = reader.run(order.run)?;
    let is_planned = started(&reader.unchecked(order.run, &["run_started"])?)?
        .is_some_and(|started| started.touches.iter().any(|touch| touch.step == order.step));
    if !is_planned {
        let (run, step) = (run.to_string(), order.step.clone());
        return Err(ResumeRefusal::NoSuchTouch { run, step });
    }
    let head = reader.last_digest(order.run)?.map(|last| last.to_string()).unwrap_or_default();
    let mut journal = store.begin(RunKind::Amendment, &order.run.to_string())?;
    let amended = amended(order, Amendment::Skip, who, head);
    journal.append(rig_us, &Record::Amended(amended))?;
    journal.append(rig_us, &Record::RunFinished(RunFinished { status: Ending::Completed }))?;
    Ok(journal.commit()?)
}

fn amended(order: &TouchOrder, what: Amendment, who: &str, head: String) -> Amended {
    let TouchOrder { run, step, why } = order.clone();
    Amended {
        run: run.to_string(),
        head,
        step,
        what,
        who: who.to_owned(),
        why,
        software: SOFTWARE.to_owned(),
        rig: None,
        calibrations: None,
        devices: Vec::new(),
        changes: Vec::new(),
    }
}
