//! Prompts at the terminal: what the bench cannot do is asked of the person who sits there.

use std::io::{self, BufRead};

use tokio::sync::mpsc;

use super::table::note;

/// Lines from the terminal, read by a thread of its own, because reading cannot be interrupted.
pub(super) struct Terminal {
    lines: mpsc::Receiver<()>,
    asked: Option<String>,
}

impl Terminal {
    pub(super) fn open() -> io::Result<Self> {
        let (sender, lines) = mpsc::channel(1);
        std::thread::Builder::new().name("terminal".to_owned()).spawn(move || {
            for line in io::stdin().lock().lines() {
                if line.is_err() || sender.blocking_send(()).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self { lines, asked: None })
    }

    /// Shows a prompt once, as long as it is the same one.
    pub(super) fn show(&mut self, prompt: Option<String>) {
        if self.asked != prompt {
            if let Some(text) = &prompt {
                // An answer given before the question is none.
                while self.lines.try_recv().is_ok() {}
                note(&format!("{text} Press Enter when that is done."));
            }
            self.asked = prompt;
        }
    }

    /// Waits for the answer to the prompt that is shown; for ever when there is none. None when
    /// nobody can answer any more.
    pub(super) async fn answer(&mut self) -> Option<()> {
        if self.asked.is_none() {
            std::future::pending::<()>().await;
        }
        self.lines.recv().await
    }
}
