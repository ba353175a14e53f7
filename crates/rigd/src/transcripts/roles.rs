//! The roles of instruments that need no motion, as the drivers carry them out.

use rig_analyzer::{Analyzer, AnalyzerError};
use rig_link::StopSignal;
use rig_model::{DriveLevel, PointResult, SweepPoint, Unit};
use rig_stage::{Stage, StageError};

/// A role of an instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// An analyzer says who it is.
    Identity,
    /// An analyzer takes the settings of a level.
    Setup,
    /// An analyzer measures at several frequencies.
    Reading,
    /// A drive shows signature, settings and status; nothing is written.
    Look,
}

impl Role {
    /// The roles of an analyzer, in the order in which they are recorded.
    pub(super) const ANALYZER: [Self; 3] = [Self::Identity, Self::Setup, Self::Reading];

    /// The role of a drive that needs no motion.
    pub(super) const DRIVE: [Self; 1] = [Self::Look];

    /// The word in transcripts and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Identity => "identity",
            Self::Setup => "setup",
            Self::Reading => "reading",
            Self::Look => "look",
        }
    }

    pub(super) fn named(name: &str) -> Option<Self> {
        [Self::ANALYZER.as_slice(), &Self::DRIVE]
            .concat()
            .into_iter()
            .find(|role| role.name() == name)
    }
}

/// What is asked of an analyzer.
#[derive(Debug, Clone, Copy)]
pub(super) struct AnalyzerTask {
    /// Amplitude, V.
    pub(super) level_v: f64,
    /// Lowest frequency of the readings, Hz.
    pub(super) low_hz: f64,
    /// Highest frequency of the readings, Hz.
    pub(super) high_hz: f64,
}

impl AnalyzerTask {
    /// Readings that change each setting once: frequency, averages and delay.
    fn points(&self) -> [SweepPoint; 3] {
        let middle_hz = 0.5 * (self.low_hz + self.high_hz);
        [
            SweepPoint { frequency_hz: self.low_hz, settle_s: 0.1, cycles: 4 },
            SweepPoint { frequency_hz: middle_hz, settle_s: 0.1, cycles: 40 },
            SweepPoint { frequency_hz: self.high_hz, settle_s: 0.2, cycles: 40 },
        ]
    }
}

/// Carries out a role of an analyzer, and says what came of it.
pub(super) async fn of_analyzer(
    analyzer: &mut Analyzer,
    role: Role,
    task: &AnalyzerTask,
) -> Result<Vec<String>, AnalyzerError> {
    match role {
        Role::Setup => {
            analyzer.configure(DriveLevel { volt: task.level_v }).await?;
            Ok(vec![format!("the level of {} V is taken, and read back", task.level_v)])
        }
        Role::Reading => {
            let readings = analyzer.measure(&task.points(), &StopSignal::new()).await?;
            let line = |(frequency_hz, measured): (f64, PointResult)| match measured {
                PointResult::Value(value) => format!(
                    "{frequency_hz} Hz: {:E} ohm, {:E} ohm",
                    value.resistance_ohm, value.reactance_ohm
                ),
                PointResult::LowSignal(value) => format!(
                    "{frequency_hz} Hz: {:E} ohm, {:E} ohm, low signal",
                    value.resistance_ohm, value.reactance_ohm
                ),
                PointResult::Overload => format!("{frequency_hz} Hz: overload"),
            };
            Ok(readings.iter().map(|one| line((one.frequency_hz, one.measured))).collect())
        }
        Role::Identity | Role::Look => Ok(vec![analyzer.identify().await?.to_string()]),
    }
}

/// Looks at a drive, and says what it shows. Nothing is written.
pub(super) async fn of_drive<U: Unit>(stage: &mut Stage<U>) -> Result<Vec<String>, StageError<U>> {
    let look = stage.look().await?;
    let status = look.status;
    let word = |is_so: bool| if is_so { "yes" } else { "no" };
    let alarm = status.alarm.map_or("none".to_owned(), |alarm| alarm.to_string());
    Ok(vec![
        format!("position {}, target {}", status.position.value(), status.target.value()),
        format!(
            "moving {}, ready {}, homed {}, alarm {alarm}, settings of the rig file {}",
            word(status.is_moving),
            word(status.is_ready),
            word(status.is_homed),
            word(look.has_settings)
        ),
    ])
}
