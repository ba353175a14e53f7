//! `rigd run`: replays a protocol from beginning to end, and leaves the report.

use std::{
    io::{self, IsTerminal},
    time::Duration,
};

use indicatif::{ProgressBar, ProgressStyle};
use rig_engine::{Command, RunStatus};
use rig_store::RunId;

use super::{
    Failure, RunArgs,
    prompt::Terminal,
    runs,
    session::{Session, latched, with_rig},
    table::{duration, note},
};
use crate::{
    protocol_file::LoadedProtocol,
    rig::{self, Status},
    run_files,
};

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let is_simulated = rig.is_simulated();
    let protocol = LoadedProtocol::load(&args.protocol, &rig.facts())?;
    let data = &args.data.data;
    let (run, ending, status) = with_rig(rig, data, &args.operator.name(), async |session| {
        replay(session, protocol, is_simulated).await
    })?;
    let files = run_files::write(data, run)?;
    if !args.output.json {
        note(&format!("report: {}\ndata:   {}\n", files.report.display(), files.data.display()));
    }
    runs::print_results(data, run, args.output.json)?;
    match ending {
        RunStatus::Completed => Ok(()),
        RunStatus::CompletedWithRefusals => Err(Failure::TouchesRefused),
        RunStatus::Aborted => Err(Failure::Aborted),
        RunStatus::Faulted => Err(latched(&status)),
    }
}

/// Replays the protocol and waits for its end.
async fn replay(
    session: &mut Session,
    protocol: LoadedProtocol,
    is_simulated: bool,
) -> Result<(RunId, RunStatus, Status), Failure> {
    let mut terminal = if is_simulated { None } else { Some(open_terminal()?) };
    let run = session.handle.run(protocol, session.operator()).await?;
    let bar = Progress::new();
    loop {
        let now = session.status.borrow_and_update().clone();
        bar.show(&now);
        if let Some(terminal) = &mut terminal {
            let asked = now.snapshot.prompt.zip(now.run.as_ref());
            terminal.show(asked.map(|(prompt, run)| run.ask(&prompt)));
        }
        if let Some(ending) = now.run.as_ref().and_then(|run| run.ending) {
            bar.finish();
            return Ok((run, ending, now));
        }
        tokio::select! {
            changed = session.status.changed() => changed.map_err(|_| rig::Refusal::Closed)?,
            () = session.signals.next() => session.end_early().await?,
            answer = answer(&mut terminal) => if answer.is_some() {
                session.handle.command(Command::Answer, Some(run), session.operator()).await?;
            } else {
                note("nobody can answer at this terminal any more; aborting the run");
                terminal = None;
                _ = session.handle.command(Command::Abort, Some(run), session.operator()).await;
            },
        }
    }
}

fn open_terminal() -> Result<Terminal, Failure> {
    Terminal::open().map_err(|source| Failure::System { what: "terminal", source })
}

async fn answer(terminal: &mut Option<Terminal>) -> Option<()> {
    match terminal {
        Some(terminal) => terminal.answer().await,
        None => std::future::pending().await,
    }
}

/// The bar on stderr; nothing is drawn where nobody looks.
struct Progress {
    bar: ProgressBar,
}

impl Progress {
    fn new() -> Self {
        let bar =
            if io::stderr().is_terminal() { ProgressBar::new(0) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{bar:32} {pos:>3}/{len} {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(Duration::from_millis(100));
        Self { bar }
    }

    fn show(&self, status: &Status) {
        let (Some(run), Some(progress)) = (&status.run, &status.snapshot.progress) else { return };
        self.bar.set_length(progress.steps as u64);
        self.bar.set_position(progress.step as u64);
        let elapsed_s = status.now.since(run.started).as_secs_f64();
        self.bar.set_message(format!(
            "{}; rig time {}, about {} to go",
            run.describe_step(progress.step),
            duration(elapsed_s),
            duration(run.remaining_s(elapsed_s)),
        ));
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
