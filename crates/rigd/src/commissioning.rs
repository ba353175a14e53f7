//! The commissioning of the rig of a daemon, led by clients: the steps and records of `rigd commission`, a question at a
//! time, without ending the daemon.
//!
//! ```text
//!   start ──▶ task: next missing step ──▶ procedure::carry_out ──▶ record ──▶ next …
//!                          │ question                ▲ answer
//!                          ▼                         │
//!                  [`Progress`], which clients read  answer, abort
//! ```

mod remote;
#[cfg(test)]
mod tests;

use std::{
    path::PathBuf,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use rig_commission::{Answer, Basis, Finding, NotAnAnswer, Standing, Step, Verdict, procedure};
use rig_engine::Fault;
use rig_files::rig_file::RigFile;
use rig_model::with_causes;
use tokio::{sync::oneshot, task::JoinError};
use tokio_util::sync::CancellationToken;

use crate::{
    calibrations::{self, CalibrationsError, Witness},
    loaded_rig::LoadedRig,
    rig::{RequestRefusal, RigHandle, unproven_text},
};
pub(crate) use remote::Question;
use remote::Remote;

/// Lines of what was said that are kept: those of a step fit.
const SAID_MAX: usize = 100;

/// The rig that is commissioned, and where its records are.
#[derive(Debug, Clone)]
pub(crate) struct Commissioned {
    file: RigFile,
    pub(crate) basis: Basis,
    pub(crate) data: PathBuf,
    /// The instruments that no transcript proves, whatever the calibrations show.
    unproven: Option<Arc<str>>,
}

impl Commissioned {
    pub(crate) fn of(rig: &LoadedRig, data: PathBuf) -> Self {
        let unproven = unproven_text(&rig.unproven());
        Self { file: rig.file.clone(), basis: rig.basis(), data, unproven }
    }
}

/// The commissioning of one rig.
#[derive(Debug, Clone)]
pub(crate) struct Commissioning {
    rig: RigHandle,
    of: Commissioned,
    progress: Arc<Mutex<Progress>>,
}

/// Where the commissioning is.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    /// The step under way; `None` while nobody commissions.
    pub(crate) step: Option<Step>,
    /// What waits for an answer, with its number, from 1.
    pub(crate) question: Option<(u64, Question)>,
    /// Questions so far.
    asked: u64,
    /// What was said and seen since the start, the oldest first.
    pub(crate) said: Vec<String>,
    /// Takes the answer, with the name of who gave it.
    reply: Option<oneshot::Sender<(Answer, String)>>,
    stop: CancellationToken,
    /// Who aborted the step under way.
    aborted_by: Option<String>,
}

/// Why a request about the commissioning is refused.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CommissioningRefusal {
    #[error("the step {} is under way; answer it, or abort it", .0.name())]
    UnderWay(Step),
    #[error(
        "no step is missing, and the rig is in service; commission it with `rigd commission again` after the daemon has ended"
    )]
    NothingMissing,
    #[error("{}", calibrations::not_in_service(.0))]
    NotInService(Arc<str>),
    #[error("nobody is asked")]
    NothingAsked,
    #[error("question {wanted} was asked before, and now question {now} waits for its answer")]
    OtherQuestion { wanted: u64, now: u64 },
    #[error(transparent)]
    NotAnAnswer(#[from] NotAnAnswer),
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
    #[error("reading the calibrations has panicked")]
    Panicked(#[from] JoinError),
}

/// Why a step ends without a finding.
#[derive(Debug, thiserror::Error)]
enum Ended {
    #[error("aborted")]
    Aborted,
    /// A motion that was not made shows nothing of the bench.
    #[error("not let go on, so that nothing was shown and nothing is recorded")]
    NotLet,
    #[error(transparent)]
    Refused(#[from] RequestRefusal),
    #[error(transparent)]
    Record(#[from] Box<CommissioningRefusal>),
}

impl Commissioning {
    /// Nobody commissions the rig yet.
    pub(crate) fn new(rig: RigHandle, of: Commissioned) -> Self {
        Self { rig, of, progress: Arc::default() }
    }

    /// Where it is. Nothing that holds it panics.
    pub(crate) fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The steps with their records, and what is missing.
    ///
    /// # Errors
    /// The calibrations cannot be read.
    pub(crate) async fn standing(&self) -> Result<Standing, CommissioningRefusal> {
        let Commissioned { basis, data, .. } = self.of.clone();
        let read = tokio::task::spawn_blocking(move || calibrations::standing(&basis, &data));
        Ok(read.await??)
    }

    /// Begins with the first step that is missing. The word of `by` that nothing is below the probe is asked before
    /// each motion.
    ///
    /// # Errors
    /// [`CommissioningRefusal`]; nothing has begun then.
    pub(crate) async fn start(
        &self,
        by: String,
        temperature_c: Option<f64>,
    ) -> Result<(), CommissioningRefusal> {
        let standing = self.standing().await?;
        let (first, _) = standing.missing().next().ok_or_else(|| self.nothing_missing())?;
        let stop = CancellationToken::new();
        {
            let mut progress = self.progress();
            if let Some(step) = progress.step {
                return Err(CommissioningRefusal::UnderWay(step));
            }
            let asked = progress.asked;
            *progress =
                Progress { step: Some(first), asked, stop: stop.clone(), ..Progress::default() };
        }
        let this = self.clone();
        tokio::spawn(async move {
            let told = this.walk(&by, temperature_c, stop).await;
            let mut progress = this.progress();
            progress.say(told);
            (progress.step, progress.question, progress.reply) = (None, None, None);
        });
        Ok(())
    }

    /// Why there is no step to make.
    fn nothing_missing(&self) -> CommissioningRefusal {
        match &self.rig.status().borrow().snapshot.fault {
            Some(Fault::NotCommissioned { missing }) => {
                let unproven = self.of.unproven.clone();
                CommissioningRefusal::NotInService(
                    unproven.unwrap_or_else(|| missing.as_str().into()),
                )
            }
            _ => CommissioningRefusal::NothingMissing,
        }
    }

    /// Answers the question with this number. The record of the step names `by`.
    ///
    /// # Errors
    /// [`CommissioningRefusal`]; the question waits on then.
    pub(crate) fn answer(
        &self,
        number: u64,
        text: &str,
        by: String,
    ) -> Result<(), CommissioningRefusal> {
        let mut progress = self.progress();
        let (now, question) = progress.question.ok_or(CommissioningRefusal::NothingAsked)?;
        if now != number {
            return Err(CommissioningRefusal::OtherQuestion { wanted: number, now });
        }
        let answer = question.asked().read(text)?;
        progress.say(format!("{} {answer}", question.text()));
        progress.question = None;
        if let Some(reply) = progress.reply.take() {
            // The step may have ended meanwhile.
            _ = reply.send((answer, by));
        }
        Ok(())
    }

    /// Ends the step under way. An axis that moves is stopped first, and the record of that stop names `by`.
    ///
    /// # Errors
    /// Nothing is under way.
    pub(crate) fn abort(&self, by: String) -> Result<(), CommissioningRefusal> {
        let mut progress = self.progress();
        progress.step.ok_or(CommissioningRefusal::NothingAsked)?;
        progress.aborted_by.get_or_insert(by);
        progress.stop.cancel();
        Ok(())
    }

    /// Makes the steps that are missing, and says how it ended.
    async fn walk(&self, by: &str, temperature_c: Option<f64>, stop: CancellationToken) -> String {
        match self.void_after_interrupted_homing(by, temperature_c).await {
            Ok(true) => self.progress().say(calibrations::HOMING_WAS_INTERRUPTED.to_owned()),
            Ok(false) => {}
            Err(error) => return with_causes(&error),
        }
        // Who answered last.
        let (mut by, mut missing) = (by.to_owned(), None);
        loop {
            let step = match self.standing().await {
                Ok(standing) => standing.missing().next().map(|(step, _)| step),
                Err(error) => return with_causes(&error),
            };
            let Some(step) = step else {
                return missing.as_deref().map_or_else(
                    || "The rig is commissioned, and goes into service.".to_owned(),
                    calibrations::not_in_service,
                );
            };
            self.progress().step = Some(step);
            let mut bench = Remote::new(self.clone(), by, stop.clone(), temperature_c);
            let finding = match procedure::carry_out(step, &self.of.file, &mut bench).await {
                Ok(finding) => finding,
                Err(ended) => return format!("step {}: {}", step.name(), with_causes(&ended)),
            };
            let verdict = finding.verdict.clone();
            let person = bench.person();
            if let Err(error) = self.keep(step, finding, person, temperature_c).await {
                return with_causes(&error);
            }
            by = bench.into_by();
            missing = match self.rig.read_calibrations(&by).await {
                Ok(missing) => missing,
                Err(refusal) => return with_causes(&refusal),
            };
            match verdict {
                Verdict::Accepted => self.progress().say(format!("step {}: accepted", step.name())),
                Verdict::Failed(why) => return format!("step {} failed: {why}", step.name()),
                Verdict::RigFile(changes) => {
                    let changes: Vec<_> = changes.iter().map(ToString::to_string).collect();
                    return format!(
                        "the bench is not as the rig file says: {}. Change the rig file, and start the daemon again",
                        changes.join("; ")
                    );
                }
            }
        }
    }

    /// Writes the record of a step.
    async fn keep(
        &self,
        step: Step,
        finding: Finding,
        person: String,
        temperature_c: Option<f64>,
    ) -> Result<(), CommissioningRefusal> {
        let witness = self.witness(person, temperature_c);
        let Commissioned { basis, data, .. } = self.of.clone();
        let write = move || calibrations::write_step(&basis, &data, (step, finding), witness);
        tokio::task::spawn_blocking(write).await??;
        Ok(())
    }

    /// Writes that the power of the drives is about to go.
    async fn begin_homing(
        &self,
        person: String,
        temperature_c: Option<f64>,
    ) -> Result<(), CommissioningRefusal> {
        let witness = self.witness(person, temperature_c);
        let Commissioned { basis, data, .. } = self.of.clone();
        let write = move || calibrations::begin_homing(&basis, &data, witness);
        Ok(tokio::task::spawn_blocking(write).await??)
    }

    async fn void_after_interrupted_homing(
        &self,
        by: &str,
        temperature_c: Option<f64>,
    ) -> Result<bool, CommissioningRefusal> {
        let witness = self.witness(by.to_owned(), temperature_c);
        let Commissioned { basis, data, .. } = self.of.clone();
        let void = move || calibrations::void_after_interrupted_homing(&basis, &data, &witness);
        Ok(tokio::task::spawn_blocking(void).await??)
    }

    fn witness(&self, person: String, temperature_c: Option<f64>) -> Witness {
        let journal = vec![self.rig.status().borrow().session.to_string()];
        Witness { person, journal, temperature_c }
    }
}

impl Progress {
    fn say(&mut self, text: String) {
        if self.said.len() == SAID_MAX {
            self.said.remove(0);
        }
        self.said.push(text);
    }

    /// Puts a question, and returns its answer with the name of who gave it.
    fn ask(&mut self, question: Question) -> oneshot::Receiver<(Answer, String)> {
        let (reply, answer) = oneshot::channel();
        self.asked += 1;
        self.question = Some((self.asked, question));
        self.reply = Some(reply);
        answer
    }
}
