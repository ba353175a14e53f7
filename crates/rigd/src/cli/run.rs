//! `rigd run`: replays a protocol from beginning to end, and leaves the report.

use std::{
    io::{self, IsTerminal},
    time::Duration,
};

use indicatif::{ProgressBar, ProgressStyle};
use rig_engine::{Command, RunStatus, StateWord};
use rig_store::RunId;
use tokio::sync::watch;

use super::{
    Failure, RunArgs,
    prompt::Terminal,
    runs,
    table::{duration, note},
};
use crate::{
    protocol_file::LoadedProtocol,
    rig::{self, RigHandle, Status},
    run_files,
};

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let is_simulated = rig.is_simulated();
    let protocol = LoadedProtocol::load(&args.protocol, &rig.facts())?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let (handle, thread) = rig::open(rig, args.data.data.clone())?;
    let outcome = runtime.block_on(async {
        let outcome = replay(&handle, protocol, is_simulated).await;
        handle.close().await;
        outcome
    });
    thread.join();
    // Reading the terminal cannot be interrupted; the program does not wait for it.
    runtime.shutdown_background();
    let (run, ending) = outcome?;
    let files = run_files::write(&args.data.data, run)?;
    runs::print_results(&args.data.data, run, args.output.json)?;
    if !args.output.json {
        note(&format!("report: {}\ndata:   {}", files.report.display(), files.data.display()));
    }
    match ending {
        RunStatus::Completed => Ok(()),
        RunStatus::Aborted => Err(Failure::Aborted),
        RunStatus::Faulted => Err(latched(&handle.status().borrow())),
    }
}

/// Replays the protocol and waits for its end.
async fn replay(
    handle: &RigHandle,
    protocol: LoadedProtocol,
    is_simulated: bool,
) -> Result<(RunId, RunStatus), Failure> {
    let mut status = handle.status();
    let mut interrupts = Interrupts::new()?;
    ready(handle, &mut status, &mut interrupts).await?;
    let mut terminal = if is_simulated { None } else { Some(open_terminal()?) };
    let run = handle.run(protocol, "terminal").await?;
    let bar = Progress::new();
    loop {
        let ending = {
            let now = status.borrow_and_update();
            bar.show(&now);
            if let Some(terminal) = &mut terminal {
                let asked = now.snapshot.prompt.zip(now.run.as_ref());
                terminal.show(asked.map(|(prompt, run)| run.ask(&prompt)));
            }
            now.run.as_ref().and_then(|run| run.ending)
        };
        if let Some(ending) = ending {
            bar.finish();
            return Ok((run, ending));
        }
        tokio::select! {
            changed = status.changed() => if changed.is_err() {
                return Err(rig::Refusal::Closed.into());
            },
            () = interrupts.next() => {
                let command = if interrupts.count == 1 { Command::Abort } else { Command::Stop };
                note("retracting the probe; interrupt again to stop everything");
                // Denied when the run is being ended already.
                _ = handle.command(command, None, "terminal").await;
            }
            answer = answer(&mut terminal) => if answer.is_some() {
                handle.command(Command::Answer, Some(run), "terminal").await?;
            } else {
                note("nobody can answer at this terminal any more; aborting the run");
                terminal = None;
                _ = handle.command(Command::Abort, Some(run), "terminal").await;
            },
        }
    }
}

/// Waits until the rig is in service.
async fn ready(
    handle: &RigHandle,
    status: &mut watch::Receiver<Status>,
    interrupts: &mut Interrupts,
) -> Result<(), Failure> {
    loop {
        match status.borrow_and_update().snapshot.state {
            StateWord::Idle => return Ok(()),
            StateWord::Latched => return Err(latched(&handle.status().borrow())),
            _ => {}
        }
        tokio::select! {
            changed = status.changed() => if changed.is_err() {
                return Err(rig::Refusal::Closed.into());
            },
            () = interrupts.next() => {
                _ = handle.command(Command::Stop, None, "terminal").await;
                return Err(Failure::Interrupted);
            }
        }
    }
}

fn latched(status: &Status) -> Failure {
    let fault = status.snapshot.fault.as_ref();
    let hint = fault.map(|fault| crate::hint::after(fault, status.snapshot.clearance));
    let cause = fault.map_or_else(|| "a fault".to_owned(), ToString::to_string);
    Failure::Latched {
        cause: format!(
            "{cause}\nprobe: {}\n{}",
            status.snapshot.clearance.name(),
            hint.unwrap_or_default()
        ),
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

/// Interrupts of the person at the terminal: the first asks for an orderly end, the second stops.
struct Interrupts {
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
    count: u32,
}

impl Interrupts {
    fn new() -> Result<Self, Failure> {
        use tokio::signal::unix::{SignalKind, signal};
        let terminate = signal(SignalKind::terminate())
            .map_err(|source| Failure::System { what: "signals", source })?;
        Ok(Self { terminate, count: 0 })
    }

    async fn next(&mut self) {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = self.terminate.recv() => {}
        }
        self.count += 1;
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
