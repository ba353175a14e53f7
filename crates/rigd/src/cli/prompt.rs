//! Prompts at the terminal.

use std::{
    io::{self, IsTerminal},
    sync::mpsc as std_mpsc,
};

use tokio::sync::mpsc;

use super::screen::say_clearly;

/// Why there is no line.
#[derive(Debug, thiserror::Error)]
pub(super) enum NoLine {
    #[error("the input of this terminal has ended")]
    Ended,
    #[error("the input of this terminal cannot be read")]
    Unread(#[from] io::Error),
}

/// Reads a line when something has been asked, on a thread of its own, because reading cannot be
/// interrupted.
pub(super) struct Terminal {
    questions: std_mpsc::Sender<()>,
    answers: mpsc::Receiver<Result<String, NoLine>>,
    /// Whether the thread is reading. It keeps reading after its prompt has been answered
    /// elsewhere.
    is_reading: bool,
    asked: Option<String>,
}

impl Terminal {
    pub(super) fn open() -> io::Result<Self> {
        let (questions, asked) = std_mpsc::channel();
        let (sender, answers) = mpsc::channel(1);
        std::thread::Builder::new().name("terminal".to_owned()).spawn(move || {
            while asked.recv().is_ok() {
                let line = line(&mut io::stdin().lock());
                let is_over = line.is_err();
                if sender.blocking_send(line).is_err() || is_over {
                    return;
                }
            }
        })?;
        Ok(Self { questions, answers, is_reading: false, asked: None })
    }

    /// Shows each prompt once.
    pub(super) fn show(&mut self, prompt: Option<String>) {
        if self.asked != prompt {
            if let Some(text) = &prompt {
                // An answer to a question that has gone is none.
                forget_input();
                while self.answers.try_recv().is_ok() {
                    self.is_reading = false;
                }
                ask(text);
                if !self.is_reading {
                    // A thread that has ended is noticed by the wait for its answer.
                    self.is_reading = self.questions.send(()).is_ok();
                }
            }
            self.asked = prompt;
        }
    }

    /// Shows the prompt once more after a text that is no answer.
    pub(super) fn ask_again(&mut self) {
        self.repeat();
        self.is_reading = self.questions.send(()).is_ok();
    }

    /// Whether a prompt is open.
    pub(super) const fn is_asking(&self) -> bool {
        self.asked.is_some()
    }

    /// Shows the prompt again: a terminal that was made narrower may have cut it off.
    pub(super) fn repeat(&self) {
        self.asked.iter().for_each(|text| ask(text));
    }

    /// Waits for the answer to the shown prompt, without end if there is none.
    ///
    /// # Errors
    /// [`NoLine`]: there is none any more.
    pub(super) async fn answer(&mut self) -> Result<String, NoLine> {
        if self.asked.is_none() {
            std::future::pending::<()>().await;
        }
        let answer = self.answers.recv().await;
        self.is_reading = false;
        answer.unwrap_or(Err(NoLine::Ended))
    }
}

fn ask(text: &str) {
    say_clearly(text);
}

/// Discards keys typed before a question. Input from a pipe counts as an answer.
fn forget_input() {
    let stdin = io::stdin();
    if stdin.is_terminal() {
        rig_system::terminal::forget_input();
    }
}

/// Waits for a line. Bytes that are no text, as from a terminal with another character set, are `�` in it.
fn line(input: &mut impl io::BufRead) -> Result<String, NoLine> {
    let mut line = Vec::new();
    match input.read_until(b'\n', &mut line)? {
        0 => Err(NoLine::Ended),
        _ => Ok(String::from_utf8_lossy(&line).into_owned()),
    }
}
