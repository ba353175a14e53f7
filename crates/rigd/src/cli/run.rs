//! `rigd run`: replays a protocol or resumes a run, and writes the report.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use clap::Args;
use rig_engine::{Command, RefusalAnswer, RefusedTouch, RunStatus};
use rig_store::{Ending, RunId};
use tokio::{
    signal::unix::{Signal, SignalKind, signal},
    time::MissedTickBehavior,
};

use super::{
    Failure,
    args::{DataArgs, OperatorArgs, OutputArgs, RigArgs, TouchArgs},
    prompt::Terminal,
    runs, screen,
    session::{LeftInContact, Session, latched, with_rig},
    table::{duration, note},
};
use crate::{
    protocol_file::LoadedProtocol,
    rig::{self, Status, TouchOrder},
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
    /// With --resume: confirm that the rig file, the scene, the software or a device has changed
    #[arg(long, requires = "resume")]
    accept_changes: bool,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    operator: OperatorArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
pub(super) struct RedoArgs {
    #[command(flatten)]
    touch: TouchArgs,
    #[command(flatten)]
    rig: RigArgs,
    /// Confirm that the rig file, the scene, the software or a device has changed since the run
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

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    let data = &args.data.data;
    let (order, rig, left) = match (&args.resume, &args.protocol) {
        (Some(wanted), _) => {
            let run = args.data.journal()?.find(wanted)?;
            if let rig_store::RunStatus::Ended(ending) = run.status
                && ending.is_complete()
            {
                note(&format!("{} has been {}", run.short_name(), run.status.describe()));
                return finish(data, &args.output, run.id, ending == Ending::CompletedWithRefusals);
            }
            let order = Order::Rest { run: run.id, is_confirmed: args.accept_changes };
            (order, args.rig.load()?, LeftInContact::Retract)
        }
        (None, Some(path)) => {
            let rig = args.rig.load()?;
            let protocol = Box::new(LoadedProtocol::load(path, &rig.facts())?);
            (Order::Protocol(protocol), rig, LeftInContact::Refuse)
        }
        // The command line asks for one of them.
        (None, None) => return Ok(()),
    };
    let is_simulated = rig.is_simulated();
    let operator = args.operator.name();
    let (run, ending, status) = with_rig(rig, data, &operator, left, async |session| {
        replay(session, order, is_simulated).await
    })?;
    end(data, &args.output, run, ending, &status)
}

/// Measures one touch of a run again.
pub(super) fn redo(args: &RedoArgs) -> Result<(), Failure> {
    let (data, rig) = (&args.touch.run.data.data, args.rig.load()?);
    let touch = args.touch.order()?;
    let (run, is_simulated, operator) = (touch.run, rig.is_simulated(), args.touch.operator.name());
    let order = Order::Redo { touch, is_confirmed: args.accept_changes };
    let redone = with_rig(rig, data, &operator, LeftInContact::Refuse, async |session| {
        replay(session, order, is_simulated).await
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
    let finished = finish(data, output, run, ending == RunStatus::CompletedWithRefusals);
    match ending {
        RunStatus::Completed | RunStatus::CompletedWithRefusals => finished,
        RunStatus::Aborted => finished.and(Err(Failure::Aborted)),
        RunStatus::Faulted => finished.and(Err(latched(status))),
    }
}

/// Writes the files of a run and prints its results.
fn finish(data: &Path, output: &OutputArgs, run: RunId, has_refusals: bool) -> Result<(), Failure> {
    let files = run_files::write(data, run)?;
    if !output.json {
        note(&format!("report: {}\ndata:   {}\n", files.report.display(), files.data.display()));
    }
    runs::print_results(data, &files.results, &files.verdict, output.json)?;
    if !files.verdict.is_sound() {
        return Err(Failure::NotSound);
    }
    if has_refusals { Err(Failure::TouchesRefused) } else { Ok(()) }
}

/// Begins the requested run and waits for its end.
async fn replay(
    session: &mut Session,
    order: Order,
    is_simulated: bool,
) -> Result<(RunId, RunStatus, Status), Failure> {
    let mut terminal = if is_simulated { None } else { Some(open_terminal()?) };
    let (mut resizes, mut resized) = (resizes()?, None);
    let run = match order {
        Order::Protocol(protocol) => session.handle.run(*protocol, session.operator()).await?,
        Order::Rest { run, is_confirmed } => {
            session.handle.resume(run, is_confirmed, session.operator()).await?;
            run
        }
        Order::Redo { touch, is_confirmed } => {
            session.handle.redo(touch, is_confirmed, session.operator()).await?
        }
    };
    let mut redraw = tokio::time::interval(REDRAW_INTERVAL);
    redraw.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let now = session.status.borrow_and_update().clone();
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
                    draw(&now);
                }
                if resized.is_some_and(|at: Instant| at.elapsed() >= RESIZE_PAUSE) {
                    resized = None;
                    terminal.iter().for_each(Terminal::repeat);
                    session.repeat_advice();
                }
            }
            _ = resizes.recv() => resized = Some(Instant::now()),
            () = session.signals.next() => {
                screen::show_progress("");
                session.end_early().await?;
            }
            answer = answer(&mut terminal) => if let Some(line) = answer {
                let refused = session.status.borrow().snapshot.refused.clone();
                match command_of(refused, &line) {
                    Some(command) => {
                        session.handle.command(command, Some(run), session.operator()).await?;
                    }
                    None => terminal.iter_mut().for_each(Terminal::ask_again),
                }
            } else {
                screen::say_clearly("the input of this terminal has ended, so that prompts cannot \
                                     be answered; aborting the run");
                terminal = None;
                _ = session.handle.command(Command::Abort, Some(run), session.operator()).await;
            },
        }
    }
}

/// Interval of the progress line: smooth to the eye, and slow for a terminal.
const REDRAW_INTERVAL: Duration = Duration::from_millis(100);

/// While a person resizes the window, messages are not repeated.
const RESIZE_PAUSE: Duration = Duration::from_millis(200);

fn open_terminal() -> Result<Terminal, Failure> {
    Terminal::open().map_err(|source| Failure::System { what: "terminal", source })
}

/// That the terminal has another size.
fn resizes() -> Result<Signal, Failure> {
    signal(SignalKind::window_change())
        .map_err(|source| Failure::System { what: "signals", source })
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

async fn answer(terminal: &mut Option<Terminal>) -> Option<String> {
    match terminal {
        Some(terminal) => terminal.answer().await,
        None => std::future::pending().await,
    }
}

/// The smallest width with room for a bar of [`BAR_COLUMNS`].
const COLUMNS_WITH_BAR: usize = 80;
const BAR_COLUMNS: usize = 16;

/// The progress of the run.
fn draw(status: &Status) {
    let (Some(run), Some(progress)) = (&status.run, &status.snapshot.progress) else { return };
    let elapsed_s = status.now.since(run.started).as_secs_f64();
    let remaining = run.remaining(progress.step, status.now);
    let bar = match screen::columns() {
        Some(COLUMNS_WITH_BAR..) => {
            let done = BAR_COLUMNS * progress.step / progress.steps.max(1);
            format!("{:░<BAR_COLUMNS$} ", "█".repeat(done))
        }
        _ => String::new(),
    };
    screen::show_progress(&format!(
        "{bar}{}/{} {}; rig time {}, {} to {} to go",
        progress.step,
        progress.steps,
        run.describe_step(progress.step),
        duration(elapsed_s),
        duration(remaining.least_s),
        duration(remaining.most_s),
    ));
}
