//! Errors and exit codes of studies.

use std::{error::Error, io, io::Write as _, path::PathBuf, process::ExitCode};

use rig_chart::ChartError;
use rig_model::with_causes;
use rig_workqueue::QueueError;
use rigd::program::ProgramError;
use serde::Serialize;

/// A failed study.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StudyError {
    /// The models refuse the request.
    #[error("refused")]
    Refused(#[source] Box<dyn Error>),
    /// The arguments are contradictory or invalid.
    #[error("arguments")]
    Arguments(#[source] Box<dyn Error>),
    /// A run on the simulated bench failed.
    #[error("simulated bench")]
    Bench(#[source] Box<dyn Error>),
    /// Standard output could not be written.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
    /// A file could not be read or written.
    #[error("cannot write {}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The file of this program could not be read.
    #[error("cannot read this program")]
    Program(#[from] ProgramError),
    /// A queue is of no use.
    #[error(transparent)]
    Queue(#[from] QueueError),
    /// A chart cannot be drawn.
    #[error("cannot draw a chart")]
    Chart(#[from] ChartError),
    /// A result could not be serialised.
    #[error("cannot write JSON")]
    Json(#[from] serde_json::Error),
}

impl StudyError {
    /// An error of the arguments.
    pub(crate) fn arguments(error: impl Error + 'static) -> Self {
        Self::Arguments(Box::new(error))
    }

    /// A failed run on the simulated bench.
    pub(crate) fn bench(error: impl Error + 'static) -> Self {
        Self::Bench(Box::new(error))
    }

    /// A refusal by the models.
    pub(crate) fn refused(error: impl Error + 'static) -> Self {
        Self::Refused(Box::new(error))
    }
}

/// Prints the error and returns the exit code: 0 success, 1 failed run or file, 2 bad arguments, 3 refusal.
pub(crate) fn exit(result: Result<(), StudyError>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    // A closed standard error cannot take the message.
    let _ = writeln!(io::stderr(), "rig-study: {}", with_causes(&error));
    match error {
        StudyError::Arguments(_) => ExitCode::from(2),
        StudyError::Refused(_) => ExitCode::from(3),
        StudyError::Output(_)
        | StudyError::Bench(_)
        | StudyError::File { .. }
        | StudyError::Program(_)
        | StudyError::Queue(_)
        | StudyError::Chart(_)
        | StudyError::Json(_) => ExitCode::FAILURE,
    }
}

/// Prints a result as JSON, or the reason of a refusal, and passes the refusal on.
pub(crate) fn print_json<T: Serialize>(
    result: Result<T, StudyError>,
    out: &mut impl io::Write,
) -> Result<(), StudyError> {
    #[derive(Serialize)]
    struct RefusedAnswer {
        status: &'static str,
        reason: String,
    }
    match &result {
        Ok(answer) => serde_json::to_writer_pretty(&mut *out, answer)?,
        Err(StudyError::Refused(reason)) => {
            let answer = RefusedAnswer { status: "refused", reason: with_causes(reason.as_ref()) };
            serde_json::to_writer_pretty(&mut *out, &answer)?;
        }
        Err(_) => return result.map(drop),
    }
    writeln!(out)?;
    result.map(drop)
}
