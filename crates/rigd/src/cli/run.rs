//! `rigd run`: replays a protocol or resumes a run, and writes the report.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use clap::Args;
use rig_engine::{Command, RefusalAnswer, RefusedTouch, RunStatus};
use rig_model::with_causes;
use rig_report::{TouchRow, TouchStatus};
use rig_store::{Reader, RunId};
use tokio::time::MissedTickBehavior;

use super::{
    Failure,
    args::{BenchArgs, OutputArgs, RigArgs, TouchArgs},
    live::{Progress, say_touch},
    prompt::{NoLine, Terminal},
    runs, screen,
    session::{LeftInContact, Session, latched, with_rig},
    signals::Resizes,
    table::{concluded, note},
};
use crate::{
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, RequestRefusal, Status, TouchOrder},
    run_files,
};

#[derive(Debug, Args)]
pub(super) struct RunArgs {
    /// Protocol file
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    protocol: Option<PathBuf>,
    /// Resume a run that was not completed, at its next touch without an outcome: its name such as
    /// `smoke-7`, its id or enough of it, or `latest`
    #[arg(long, value_name = "RUN")]
    resume: Option<String>,
    /// With --resume: confirm that the rig file, the scene, the software, a device, or a calibration or
    /// correction has changed
    #[arg(long, requires = "resume")]
    accept_changes: bool,
    #[command(flatten)]
    bench: BenchArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
pub(super) struct RedoArgs {
    #[command(flatten)]
    touch: TouchArgs,
    #[command(flatten)]
    rig: RigArgs,
    /// Confirm that the rig file, the scene, the software, a device, or a calibration or correction has
    /// changed since the run
    #[arg(long)]
    accept_changes: bool,
    #[command(flatten)]
    output: OutputArgs,
}

/// The run to begin.
enum Order {
    /// A protocol from its beginning.
    Protocol(Box<LoadedProtocol>),
    /// The rest of a run.
    Rest { run: RunId, is_confirmed: bool },
    /// One touch of a run again.
    Redo { touch: TouchOrder, is_confirmed: bool },
}

/// What matters here of the bench.
#[derive(Debug, Clone, Copy)]
pub(super) struct BenchKind {
    /// Nobody is asked at the terminal.
    is_simulated: bool,
    /// The rig's clock does not follow that of the wall.
    is_virtual_time: bool,
}

impl BenchKind {
    pub(super) fn of(rig: &LoadedRig) -> Self {
        Self { is_simulated: rig.is_simulated(), is_virtual_time: rig.is_virtual_time() }
    }
}

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    let data = &args.bench.data.dir();
    let (order, rig, left) = match (&args.resume, &args.protocol) {
        (Some(wanted), _) => {
            let reader = args.bench.data.journal()?;
            let run = reader.find(wanted)?;
            if let rig_store::RunStatus::Ended(ending) = run.status
                && ending.is_complete()
            {
                note(&format!("{} has been {}", run.short_name(), run.status.describe()));
                return finish(data, &args.output, run.id, None);
            }
            // Before the rig moves.
            rig::may_resume(&reader, &run).map_err(RequestRefusal::from)?;
            let order = Order::Rest { run: run.id, is_confirmed: args.accept_changes };
            (order, args.bench.rig.load()?, LeftInContact::Retract)
        }
        (None, Some(path)) => {
            let rig = args.bench.rig.load()?;
            let protocol = Box::new(LoadedProtocol::load(path, &rig.facts().with_data(data))?);
            (Order::Protocol(protocol), rig, LeftInContact::Refuse)
        }
        // The command line asks for one of them.
        (None, None) => return Ok(()),
    };
    let bench = BenchKind::of(&rig);
    let operator = args.bench.operator.name();
    let touches = args.output.touches(data);
    let (run, ending, status) = with_rig(rig, data, &operator, left, async |session| {
        replay(session, order, bench, touches).await
    })?;
    end(data, &args.output, run, ending, &status)
}

/// Measures one touch of a run again.
pub(super) fn redo(args: &RedoArgs) -> Result<(), Failure> {
    let data = &args.touch.run.data.dir();
    let (reader, run) = args.touch.run.find()?;
    // Before the rig moves.
    rig::may_amend(&reader, &run).map_err(RequestRefusal::from)?;
    drop(reader);
    let rig = args.rig.load()?;
    let touch = args.touch.order()?;
    let (run, bench, operator) = (touch.run, BenchKind::of(&rig), args.touch.operator.name());
    let order = Order::Redo { touch, is_confirmed: args.accept_changes };
    let touches = args.output.touches(data);
    let redone = with_rig(rig, data, &operator, LeftInContact::Refuse, async |session| {
        replay(session, order, bench, touches).await
    });
    let (_, ending, status) = redone?;
    end(data, &args.output, run, ending, &status)
}

/// Writes the files of a run and prints its results, also when it ended early.
fn end(
    data: &Path,
    output: &OutputArgs,
    run: RunId,
    ending: RunStatus,
    status: &Status,
) -> Result<(), Failure> {
    let has_refusals = ending == RunStatus::CompletedWithRefusals;
    let finished = finish(data, output, run, Some(has_refusals));
    let ended = match ending {
        RunStatus::Completed | RunStatus::CompletedWithRefusals => return finished,
        RunStatus::Aborted => Failure::Aborted,
        RunStatus::Faulted => latched(status),
    };
    if let Err(failure) = finished {
        let what = match failure {
            Failure::RunFiles(_) => "the files of the run are not written",
            Failure::NotSound => "the run is not in order",
            _ => "the results of the run are not printed",
        };
        // How the run ended, and where the probe is, is said last.
        note(&format!("{what}: {}", with_causes(&failure)));
        failure.advice().into_iter().for_each(|advice| note(&format!("→ {advice}\n")));
    }
    Err(ended)
}

/// Writes the files of a run and prints its results. `has_refusals` says whether touches were refused just now; for a run that had
/// ended before, its results say it, with all that was measured again since.
fn finish(
    data: &Path,
    output: &OutputArgs,
    run: RunId,
    has_refusals: Option<bool>,
) -> Result<(), Failure> {
    let files = run_files::write(data, run)?;
    if !output.json {
        note(&format!("report: {}\ndata:   {}\n", files.report.display(), files.data.display()));
    }
    let printed = runs::print_results(data, &files.results, &files.verdict, output.json);
    let is_refused = |row: &TouchRow| row.status == TouchStatus::Refused;
    let has_refusals =
        has_refusals.unwrap_or_else(|| files.results.touches().iter().any(is_refused));
    let verdict = match files.verdict.is_sound() {
        false => Err(Failure::NotSound),
        true if has_refusals => Err(Failure::TouchesRefused),
        true => Ok(()),
    };
    concluded(printed, verdict)
}

/// Begins the requested run.
async fn begin(session: &Session, order: Order) -> Result<RunId, Failure> {
    Ok(match order {
        Order::Protocol(protocol) => session.handle.run(*protocol, session.operator()).await?,
        Order::Rest { run, is_confirmed } => {
            session.handle.resume(run, is_confirmed, session.operator()).await?;
            run
        }
        Order::Redo { touch, is_confirmed } => {
            session.handle.redo(touch, is_confirmed, session.operator()).await?
        }
    })
}

/// Begins a run of a protocol and waits until it is completed, also with refused touches.
pub(super) async fn replay_protocol(
    session: &mut Session,
    protocol: LoadedProtocol,
    bench: BenchKind,
    journal: Option<&Path>,
) -> Result<RunId, Failure> {
    let order = Order::Protocol(Box::new(protocol));
    let (run, ending, status) = replay(session, order, bench, journal).await?;
    match ending {
        RunStatus::Completed | RunStatus::CompletedWithRefusals => Ok(run),
        RunStatus::Aborted => Err(Failure::Aborted),
        RunStatus::Faulted => Err(latched(&status)),
    }
}

/// Begins the requested run and waits for its end.
async fn replay(
    session: &mut Session,
    order: Order,
    bench: BenchKind,
    journal: Option<&Path>,
) -> Result<(RunId, RunStatus, Status), Failure> {
    let mut terminal = if bench.is_simulated { None } else { Some(open_terminal()?) };
    let (mut resizes, mut resized) = (Resizes::listen()?, None);
    let run = begin(session, order).await?;
    let mut touches = journal.map(|data| Touches::new(data, run, &session.status.borrow()));
    let mut redraw = tokio::time::interval(REDRAW_INTERVAL);
    redraw.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let now = session.status.borrow_and_update().clone();
        if let Some(touches) = &mut touches {
            touches.say(&now);
        }
        if let Some(terminal) = &mut terminal {
            let prompt = now.snapshot.prompt.zip(now.run.as_ref());
            let prompt = prompt.map(|(prompt, run)| {
                format!("{} Press Enter when that is done.", run.ask(&prompt))
            });
            let asked = prompt.or_else(|| now.snapshot.refused.as_ref().map(ask_about));
            if asked.is_some() {
                screen::show_progress("");
            }
            terminal.show(asked);
        }
        if let Some(ending) = now.run.as_ref().and_then(|run| run.ending) {
            screen::show_progress("");
            return Ok((run, ending, now));
        }
        tokio::select! {
            changed = session.status.changed() => changed.map_err(|_| rig::RequestRefusal::Closed)?,
            // Below a prompt, and below the advice on how to stop, nothing is drawn.
            _ = redraw.tick() => {
                let is_asking = terminal.as_ref().is_some_and(Terminal::is_asking);
                if !is_asking && session.signals.count == 0 {
                    progress(&now, bench).iter().for_each(Progress::draw);
                }
                if resized.is_some_and(|at: Instant| at.elapsed() >= RESIZE_PAUSE) {
                    resized = None;
                    terminal.iter().for_each(Terminal::repeat);
                    session.repeat_advice();
                }
            }
            () = resizes.next() => resized = Some(Instant::now()),
            () = session.signals.next() => {
                screen::show_progress("");
                session.end_early().await?;
            }
            answer = answer(&mut terminal) => {
                if !obey(session, run, terminal.as_mut(), answer).await? {
                    terminal = None;
                }
            }
        }
    }
}

impl OutputArgs {
    /// The data directory, if the outcome of each touch is said.
    pub(super) fn touches<'a>(&self, data: &'a Path) -> Option<&'a Path> {
        (!self.json).then_some(data)
    }
}

/// Interval of the progress line: smooth to the eye, and slow for a terminal.
const REDRAW_INTERVAL: Duration = Duration::from_millis(100);

/// While a person resizes the window, messages are not repeated.
const RESIZE_PAUSE: Duration = Duration::from_millis(200);

fn open_terminal() -> Result<Terminal, Failure> {
    Terminal::open().map_err(|source| Failure::System { what: "terminal", source })
}

/// Asks what to do after a refused touch.
fn ask_about(RefusedTouch { step, reason }: &RefusedTouch) -> String {
    format!(
        "Touch {step} was refused: {reason}. Type w to widen the window and repeat, r to repeat, s to skip \
         (keep the refusal), or a to abort the run, and press Enter."
    )
}

/// The command that a line stands for: any line answers a prompt, a letter decides about a refused touch.
fn command_of(refused: Option<RefusedTouch>, line: &str) -> Option<Command> {
    let Some(touch) = refused else { return Some(Command::Answer) };
    let letter = line.trim().to_lowercase();
    let is_it = |answer: &RefusalAnswer| !letter.is_empty() && answer.name().starts_with(&letter);
    let answer = RefusalAnswer::ALL.into_iter().find(is_it)?;
    Some(Command::Decide { step: touch.step, answer })
}

/// Does what a line of the terminal says, and returns whether there may be more of them. A run whose prompts nobody can answer is
/// aborted.
async fn obey(
    session: &Session,
    run: RunId,
    terminal: Option<&mut Terminal>,
    answer: Result<String, NoLine>,
) -> Result<bool, Failure> {
    let line = match answer {
        Ok(line) => line,
        Err(why) => {
            screen::say_clearly(&format!(
                "{}, so that prompts cannot be answered; aborting the run",
                with_causes(&why)
            ));
            _ = session.handle.command(Command::Abort, Some(run), session.operator()).await;
            return Ok(false);
        }
    };
    let refused = session.status.borrow().snapshot.refused.clone();
    match command_of(refused, &line) {
        Some(command) => {
            session.handle.command(command, Some(run), session.operator()).await?;
        }
        None => terminal.into_iter().for_each(Terminal::ask_again),
    }
    Ok(true)
}

async fn answer(terminal: &mut Option<Terminal>) -> Result<String, NoLine> {
    match terminal {
        Some(terminal) => terminal.answer().await,
        None => std::future::pending().await,
    }
}

/// The progress of the run at this moment, which can be long after the last change of the status.
fn progress(status: &Status, bench: BenchKind) -> Option<Progress> {
    let (run, progress) = (status.run.as_ref()?, status.snapshot.progress.as_ref()?);
    let remaining = run.remaining(progress.step, status.present(bench.is_virtual_time));
    let estimate = status.live.as_ref().and_then(|live| live.estimates.last());
    Some(Progress {
        step: progress.step,
        steps: progress.steps,
        doing: run.describe_step(progress.step),
        remaining_s: [remaining.least_s, remaining.most_s],
        estimate_hz: estimate.map(|estimate| [estimate.resonance_hz, estimate.sigma_hz]),
        is_pausing: progress.is_pausing,
    })
}

/// Says the outcome of each touch of a run when it is in the journal.
struct Touches {
    reader: Option<Reader>,
    run: RunId,
    /// The last event seen in the journal.
    last: u64,
    /// Touches done before, and said.
    done: usize,
}

/// Records read at a time.
const PAGE: u32 = 256;

impl Touches {
    /// Nothing is said if the journal cannot be read: the results come from it too, with the error.
    fn new(data: &Path, run: RunId, status: &Status) -> Self {
        let done = status.run.as_ref().map_or(0, |run| run.touches_before);
        Self { reader: Reader::open(data).ok(), run, last: status.first_event, done }
    }

    fn say(&mut self, status: &Status) {
        let (done, is_ended) = match &status.run {
            Some(run) => (run.touches_done, run.ending.is_some()),
            None => return,
        };
        let Some(reader) = self.reader.as_ref().filter(|_| done > self.done || is_ended) else {
            return;
        };
        // Each round reads at least one of the records that exist.
        while self.last < status.last_event {
            let page = reader.events_after(self.last, PAGE).unwrap_or_default();
            let Some(newest) = page.last() else { return };
            self.last = newest.event;
            for stored in page.iter().filter(|stored| stored.run == self.run) {
                if matches!(stored.kind.as_str(), "touch_result" | "touch_refused")
                    && let Ok(record) = stored.record()
                {
                    self.done += 1;
                    say_touch(&record);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rig_engine::RigState;
    use tempfile::TempDir;

    use super::*;

    #[tokio::test]
    async fn the_remaining_time_goes_on_between_two_changes_of_the_status() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let load = || LoadedRig::load(&config.join("rigs/simulated.toml")).unwrap();
        let protocol = config.join("protocols/smoke.toml");
        let protocol = LoadedProtocol::load(&protocol, &load().facts()).unwrap();
        let data = TempDir::new().unwrap();
        let (handle, _thread) = rig::open(load(), data.path().to_owned()).unwrap();
        let mut watch = handle.status();
        watch.wait_for(|status| status.snapshot.state == RigState::Idle).await.unwrap();
        handle.run(protocol, "Ada").await.unwrap();
        let is_touching = |status: &Status| {
            status.snapshot.progress.as_ref().is_some_and(|progress| progress.step == 3)
        };
        let mut status = watch.wait_for(is_touching).await.unwrap().clone();
        handle.close().await;
        let range = |status: &Status, is_virtual_time| {
            let bench = BenchKind { is_simulated: true, is_virtual_time };
            progress(status, bench).unwrap().remaining_s
        };
        let virtually = range(&status, true);
        status.published = status.published.checked_sub(Duration::from_secs(2)).unwrap();
        // Virtual time does not pass by itself.
        assert_eq!(range(&status, true), virtually);
        for (later_s, first_s) in range(&status, false).into_iter().zip(virtually) {
            let passed_s = first_s - later_s;
            assert!((1.0..10.0).contains(&passed_s), "{later_s} after {first_s}");
        }
    }
}
