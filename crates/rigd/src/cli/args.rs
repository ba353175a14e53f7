//! Arguments that several commands have.

use std::{num::ParseFloatError, path::PathBuf};

use clap::Args;
use rig_commission::NoTemperature;
use rig_store::{Reader, Run, Store};

use super::{Failure, table::note};
use crate::{
    archive,
    loaded_rig::LoadedRig,
    operator::Operator,
    place::{Place, PlaceKind},
    reason::reason,
    rig::TouchOrder,
};

/// Why an argument is no temperature at a bench.
#[derive(Debug, thiserror::Error)]
pub(super) enum NotATemperature {
    #[error(transparent)]
    NoNumber(#[from] ParseFloatError),
    #[error(transparent)]
    Outside(#[from] NoTemperature),
}

/// A temperature at the bench, °C, for a record.
///
/// # Errors
/// [`NotATemperature`].
pub(super) fn temperature(text: &str) -> Result<f64, NotATemperature> {
    Ok(rig_commission::temperature(text.parse()?)?)
}

/// The rig to use.
#[derive(Debug, Clone, Args)]
pub(super) struct RigArgs {
    /// Rig file of the bench [default: the first of /etc/rigd/rig.toml, ~/.config/rigd/rig.toml and
    /// config/rigs/simulated.toml]
    #[arg(long, value_name = "RIG")]
    pub(super) rig: Option<PathBuf>,
}

/// Data directory with the journal.
#[derive(Debug, Clone, Args)]
pub(super) struct DataArgs {
    /// Directory of the journal and the reports, or an archive to read [default: that of the rig file that is found:
    /// /var/lib/rigd, ~/.local/share/rigd or data]
    #[arg(long, value_name = "DIR")]
    pub(super) data: Option<PathBuf>,
}

/// The operator of a command.
#[derive(Debug, Clone, Args)]
pub(super) struct OperatorArgs {
    /// Name that the journal keeps with the command [default: the login user]
    #[arg(long, value_name = "NAME")]
    pub(super) operator: Option<Operator>,
}

impl OperatorArgs {
    pub(super) fn name(&self) -> Operator {
        self.operator.clone().unwrap_or_else(Operator::login)
    }
}

/// The bench to open, where it is recorded, and by whom.
#[derive(Debug, Clone, Args)]
pub(super) struct BenchArgs {
    #[command(flatten)]
    pub(super) rig: RigArgs,
    #[command(flatten)]
    pub(super) data: DataArgs,
    #[command(flatten)]
    pub(super) operator: OperatorArgs,
}

/// The output format.
#[derive(Debug, Args)]
pub(super) struct OutputArgs {
    /// Print JSON for a program instead of text for a person
    #[arg(long)]
    pub(super) json: bool,
}

/// A run in a data directory.
#[derive(Debug, Args)]
pub(super) struct RunArg {
    /// Run: its name such as `smoke-7`, its id or enough of it, or `latest`
    run: String,
    #[command(flatten)]
    pub(super) data: DataArgs,
}

impl RunArg {
    /// The run as it was written.
    pub(super) fn text(&self) -> &str {
        &self.run
    }

    /// The data directory of the run; in an archive, the folder of the run.
    pub(super) fn dir(&self) -> Result<PathBuf, Failure> {
        self.data.of(&self.run)
    }

    /// Finds the run, with what reads its journal.
    pub(super) fn find(&self) -> Result<(Reader, Run), Failure> {
        self.data.find(&self.run)
    }
}

/// One touch of a run, and why it is amended.
#[derive(Debug, Args)]
pub(super) struct TouchArgs {
    #[command(flatten)]
    pub(super) run: RunArg,
    /// Address of the touch, such as `main/3/left/30/1`
    step: String,
    /// The reason, for the journal and the report
    #[arg(long, value_name = "TEXT", value_parser = reason)]
    why: String,
    #[command(flatten)]
    pub(super) operator: OperatorArgs,
}

impl TouchArgs {
    pub(super) fn order(&self) -> Result<TouchOrder, Failure> {
        let run = self.run.find()?.1.id;
        Ok(TouchOrder { run, step: self.step.clone(), why: self.why.clone() })
    }
}

impl DataArgs {
    /// The directory that is given, or that of the place that is found.
    pub(super) fn dir(&self) -> PathBuf {
        self.data.clone().unwrap_or_else(|| Place::found().data)
    }

    /// The data directory of a run; in an archive, the folder of the run.
    fn of(&self, run: &str) -> Result<PathBuf, Failure> {
        let data = self.dir();
        Ok(if archive::is_archive(&data) { archive::find(&data, run)? } else { data })
    }

    /// Finds a run, with what reads its journal.
    pub(super) fn find(&self, run: &str) -> Result<(Reader, Run), Failure> {
        let data = self.of(run)?;
        let reader = Reader::open(&data).map_err(|source| Failure::Data { data, source })?;
        let run = reader.find(run)?;
        Ok((reader, run))
    }

    /// Opens the journal to read.
    pub(super) fn journal(&self) -> Result<Reader, Failure> {
        let data = self.dir();
        Reader::open(&data).map_err(|source| Failure::Data { data, source })
    }

    /// Opens the journal to write.
    pub(super) fn store(&self) -> Result<Store, Failure> {
        let data = self.dir();
        Store::open(&data).map_err(|source| Failure::Data { data, source })
    }
}

impl RigArgs {
    /// The file that is given, or that of the place that is found. A file elsewhere than below the current
    /// directory is said: it may be that of a real bench.
    pub(super) fn path(&self) -> PathBuf {
        self.rig.clone().unwrap_or_else(|| {
            let place = Place::found();
            if place.kind != PlaceKind::Checkout {
                note(&format!("rig file: {}, found without --rig", place.rig.display()));
            }
            place.rig
        })
    }

    pub(super) fn load(&self) -> Result<LoadedRig, Failure> {
        Ok(LoadedRig::load(&self.path())?)
    }
}
