//! How a study ends.

use std::{error::Error, io, io::Write as _, path::PathBuf, process::ExitCode};

use rig_chart::ChartError;
use rig_model::with_causes;
use serde::Serialize;

/// Why a study did not end well.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StudyError {
    /// The models refuse the question; the answer says why.
    #[error("refused")]
    Refused(#[source] Box<dyn Error>),
    /// The arguments contradict each other or describe nothing that exists.
    #[error("arguments")]
    Arguments(#[source] Box<dyn Error>),
    /// Standard output could not be written.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
    /// A file could not be read or written.
    #[error("cannot write {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A chart has nothing to show.
    #[error("cannot draw a chart")]
    Chart(#[from] ChartError),
    /// A result could not be turned into JSON.
    #[error("cannot write JSON")]
    Json(#[from] serde_json::Error),
}

impl StudyError {
    /// The arguments are at fault.
    pub(crate) fn arguments(error: impl Error + 'static) -> Self {
        Self::Arguments(Box::new(error))
    }

    /// The models refuse.
    pub(crate) fn refused(error: impl Error + 'static) -> Self {
        Self::Refused(Box::new(error))
    }
}

/// Says what went wrong, and ends with 0, 1 for files, 2 for arguments, 3 for a refusal.
pub(crate) fn exit(result: Result<(), StudyError>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    // Nobody is left to be told when standard error is closed.
    let _ = writeln!(io::stderr(), "rig-study: {}", with_causes(&error));
    match error {
        StudyError::Arguments(_) => ExitCode::from(2),
        StudyError::Refused(_) => ExitCode::from(3),
        StudyError::Output(_)
        | StudyError::File { .. }
        | StudyError::Chart(_)
        | StudyError::Json(_) => ExitCode::FAILURE,
    }
}

/// Prints a result as JSON, or the reason for a refusal, which is passed on.
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
