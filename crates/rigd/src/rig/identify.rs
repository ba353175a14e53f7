//! Reads the identities of the devices again while the rig is idle. Nothing moves.

use rig_analyzer::AnalyzerError;
use rig_model::{Unit, with_causes};
use rig_stage::{Look, Stage};
use tokio::sync::oneshot;

use super::{
    DeviceIdentity,
    devices::{Axes, GatedAnalyzer},
    inspect::{AxisPosition, AxisState, standing},
};

/// What a device answered when it was asked again who it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identified {
    /// Its role on the rig.
    pub role: &'static str,
    /// The identity that is known since the rig was opened.
    pub known: String,
    /// The identity of the device that answered; `None` if it could not be read.
    pub found: Option<String>,
    /// The position of an axis by its own account, with its unit.
    pub position: Option<String>,
    /// Why it cannot be used as before.
    pub trouble: Option<String>,
}

/// The answers of the analyzer and of the drives.
pub(super) type Answers = [oneshot::Receiver<Vec<Identified>>; 2];

pub(super) async fn analyzer(known: DeviceIdentity, gated: &mut GatedAnalyzer) -> Vec<Identified> {
    let DeviceIdentity { role, identity: known, .. } = known;
    let (found, trouble) = match gated.analyzer.identify().await {
        Ok(found) => (Some(found.to_string()), None),
        Err(error) => {
            let found = match &error {
                AnalyzerError::Swapped { found, .. }
                | AnalyzerError::WrongInstrument { found, .. } => Some(found.to_string()),
                _ => None,
            };
            (found, Some(with_causes(&error)))
        }
    };
    vec![Identified { role, known, found, position: None, trouble }]
}

/// A stop and `rigd acknowledge` bring the rig into service again.
const OTHER_SETTINGS: &str = "its settings differ from those that rigd wrote: find out whether it was exchanged, reset or set by another program; after \
                              an exchange, `rigd commission changed drive`; otherwise a stop and an acknowledgement write those of the \
                              rig file again, and move both axes";

pub(super) async fn axes(known: [DeviceIdentity; 2], axes: &mut Axes) -> Vec<Identified> {
    let [linear, rotary] = known;
    vec![axis(linear, &mut axes.linear).await, axis(rotary, &mut axes.rotary).await]
}

/// Few drives report an identity: one that answers as its make does, with the settings that it was given,
/// is the known one. One with other settings keeps them: nothing is written.
async fn axis<U: Unit>(known: DeviceIdentity, stage: &mut Stage<U>) -> Identified {
    let DeviceIdentity { role, identity: known, .. } = known;
    match stage.look_again().await {
        Ok(Look { has_settings: false, status, .. }) => Identified {
            role,
            known,
            found: None,
            position: Some(standing(stage.axis(), &status).at),
            trouble: Some(OTHER_SETTINGS.to_owned()),
        },
        Ok(Look { status, .. }) => {
            let facts = standing(stage.axis(), &status);
            let trouble = match (&facts.place, facts.state) {
                (_, AxisState::Alarmed(alarm)) => Some(format!("alarm: {alarm}")),
                (AxisPosition::NotHomed, _) => Some("it has lost its position".to_owned()),
                (AxisPosition::BeyondTravel(travel), _) => {
                    Some(format!("it cannot be there: its travel is {travel}"))
                }
                (_, AxisState::Moving) => Some("it moves without a command".to_owned()),
                (_, AxisState::NotReady | AxisState::NotInService) => {
                    Some("it accepts no moves".to_owned())
                }
                (_, AxisState::Ready) => None,
            };
            Identified {
                role,
                found: Some(known.clone()),
                known,
                position: Some(facts.at),
                trouble,
            }
        }
        Err(error) => {
            let trouble = Some(with_causes(&error));
            Identified { role, known, found: None, position: None, trouble }
        }
    }
}
