//! The self-test of a bench, in levels: the computer, the talk with each device, the analyzer at rest.
//!
//! Up to these nothing moves, and nothing is written into a drive. The levels after them need a bench in service, and
//! are led by the command; [`records`] says what the calibrations show. Each check has a
//! value, its uncertainty where it has one, a limit, and advice.

mod archive;
mod electric;
pub(crate) mod records;
mod talk;

use rig_files::rig_file::{AxisFile, RigFile};
use rig_link::Clock;
use rig_model::{Axis, Unit, with_causes};
use rig_stage::{BusHandle, RegisterMap};

pub(crate) use archive::Archive;

use crate::{
    doctor::{
        Level,
        host::{self, HostFacts},
    },
    loaded_rig::LoadedRig,
    rig::{OpenError, Ports, bus_settings, runtime_of},
    transcripts::{Recorded, keep_frames, record_analyzer, record_axis},
};

/// How far a self-test goes. Each level has those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Depth {
    /// The computer alone; no port is opened.
    Host,
    /// Each device, by reading many times.
    Talk,
    /// The analyzer with what is at its terminals: noise, and the same impedance at two levels.
    Electric,
}

/// A quantity with what it must not exceed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quantity {
    pub(crate) value: f64,
    /// One standard deviation; `None` for a count.
    pub(crate) uncertainty: Option<f64>,
    pub(crate) limit: f64,
    pub(crate) unit: &'static str,
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Check {
    pub(crate) part: &'static str,
    pub(crate) name: String,
    pub(crate) level: Level,
    pub(crate) quantity: Option<Quantity>,
    /// The observation, where it is no quantity.
    pub(crate) text: Option<String>,
    /// Empty if all is well.
    pub(crate) advice: Option<&'static str>,
}

impl Check {
    /// A quantity that is a problem above its limit.
    pub(crate) fn quantity(
        part: &'static str,
        name: impl Into<String>,
        quantity: Quantity,
        advice: &'static str,
    ) -> Self {
        let is_well = quantity.value <= quantity.limit;
        let level = if is_well { Level::Ok } else { Level::Problem };
        let advice = (!is_well).then_some(advice);
        Self { part, name: name.into(), level, quantity: Some(quantity), text: None, advice }
    }

    /// An observation that is well.
    pub(crate) fn fact(part: &'static str, name: &str, text: String) -> Self {
        let (level, quantity, advice) = (Level::Ok, None, None);
        Self { part, name: name.into(), level, quantity, text: Some(text), advice }
    }

    pub(crate) fn problem(
        part: &'static str,
        name: &str,
        text: String,
        advice: &'static str,
    ) -> Self {
        let (level, quantity) = (Level::Problem, None);
        Self { part, name: name.into(), level, quantity, text: Some(text), advice: Some(advice) }
    }
}

/// What a self-test found, and the transcripts of the devices.
#[derive(Debug)]
pub(crate) struct Report {
    pub(crate) rig: String,
    pub(crate) checks: Vec<Check>,
    pub(crate) recorded: Vec<Recorded>,
    /// Serial numbers, which leave this computer as hashes alone.
    pub(crate) secrets: Vec<String>,
}

/// Advice for a device that does not answer.
const NO_ANSWER: &str = "`rigd doctor` says what to look at";

/// Tests a rig as far as asked.
///
/// # Errors
/// [`OpenError`] for a scene that cannot be set up. Ports and devices have their problems in the report.
pub(crate) fn selftest(rig: LoadedRig, depth: Depth) -> Result<Report, OpenError> {
    let host = HostFacts::look(&rig.file);
    let mut checks: Vec<_> = host.iter().flat_map(host::findings).map(of_finding).collect();
    let secrets = rig_link::attached_ports();
    let secrets = secrets.into_iter().filter_map(|port| port.usb?.serial_number).collect();
    let name = rig.file.name.clone();
    if checks.is_empty() {
        checks.push(Check {
            part: "computer",
            name: "ports".to_owned(),
            level: Level::Ok,
            quantity: None,
            text: Some("the rig has no serial port of this computer".to_owned()),
            advice: None,
        });
    }
    let mut report = Report { rig: name, checks, recorded: Vec::new(), secrets };
    if depth == Depth::Host {
        return Ok(report);
    }
    let runtime = runtime_of(&rig)?;
    runtime.block_on(devices(rig, depth, &mut report))?;
    Ok(report)
}

fn of_finding(finding: crate::doctor::Finding) -> Check {
    let crate::doctor::Finding { part, check, level, text, advice } = finding;
    Check { part, name: check.to_owned(), level, quantity: None, text: Some(text), advice }
}

async fn devices(rig: LoadedRig, depth: Depth, report: &mut Report) -> Result<(), OpenError> {
    let LoadedRig { file, instruments, scene, .. } = rig;
    // The simulated devices live until the end.
    let Ports { analyzer, bus, simulation: _simulation } =
        Ports::open(&file, &instruments, scene, None, Clock::start()).await?;
    let (recorded, analyzer) = record_analyzer(&file, instruments.analyzer, analyzer).await;
    report.note(recorded);
    if let Some(mut analyzer) = analyzer {
        if let Ok(identity) = analyzer.identify().await {
            report.secrets.extend(identity.serial);
        }
        report.checks.extend(talk::with_analyzer(&mut analyzer, &file).await);
        if depth >= Depth::Electric {
            report.checks.extend(electric::checks(&mut analyzer, &file).await);
        }
    }
    match bus {
        Err(error) => {
            let text = with_causes(&error);
            report.checks.push(Check::problem("bus", "open", text, NO_ANSWER));
        }
        Ok(port) => {
            let transcript = port.transcript();
            keep_frames(&transcript);
            let bus = BusHandle::open(port, bus_settings(&file.bus));
            let linear = (&file.linear, file.limits.linear);
            report
                .drive("linear stage", instruments.linear, linear, &file, &bus, &transcript)
                .await;
            let rotary = (&file.rotary, file.limits.rotary);
            report
                .drive("rotary stage", instruments.rotary, rotary, &file, &bus, &transcript)
                .await;
        }
    }
    Ok(())
}

impl Report {
    /// Keeps a transcript, or the reason why there is none.
    fn note(&mut self, recorded: Recorded) {
        if let Some(fault) = &recorded.fault {
            let check = Check::problem(recorded.device, "answers", fault.clone(), NO_ANSWER);
            self.checks.push(check);
        }
        self.recorded.push(recorded);
    }

    async fn drive<U: Unit>(
        &mut self,
        device: &'static str,
        map: &'static RegisterMap,
        axis: (&AxisFile<U>, Axis<U>),
        rig: &RigFile,
        bus: &BusHandle,
        transcript: &rig_link::Transcript,
    ) {
        let (recorded, mut stage) = record_axis(device, map, axis, bus, transcript, &rig.bus).await;
        let is_there = recorded.fault.is_none();
        self.note(recorded);
        if is_there {
            self.checks.extend(talk::with_drive(device, &mut stage).await);
        }
    }

    /// Number of checks of this level.
    pub(crate) fn count(&self, level: Level) -> usize {
        self.checks.iter().filter(|check| check.level == level).count()
    }
}
