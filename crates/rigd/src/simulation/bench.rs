//! A bench of `rig-sim`.

use std::path::Path;

use rig_commission::{Answer, Asked, Choice};
use rig_engine::Event;
use rig_files::{
    FileKind,
    rig_file::{AxisFile, Connection, PortFile, RigFile, SimulatedPerson},
};
use rig_link::{Endpoint, Transport};
use rig_model::{DriveMake, Unit};
use rig_protocol::Prompt;
use rig_sim::{
    AxisWiring, LineTransport, PortId, SimRig, Wiring,
    person::{EdgeSank, Person, ProbeWent},
    world::Scene,
};
pub use rig_sim::{SimHandle, world::SceneError};
use rig_store::Source;

use crate::{
    files::{FileError, read},
    instruments::SimulatedMakes,
};

/// The scene of a simulated rig.
#[derive(Debug)]
pub struct LoadedScene {
    /// Contents of the simulated bench.
    pub scene: Scene,
    /// Its text, for the journal.
    pub source: Source,
}

impl LoadedScene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// [`FileError`], with every fault of the file.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let (name, toml) = read(path, FileKind::Scene)?;
        let scene = rig_sim::scene::read(&name, &toml).map_err(FileError::Faults)?;
        // The journal has no path, so that a run gives the same bytes in any directory.
        let source = Source { name: scene.name.clone(), toml };
        Ok(Self { scene, source })
    }

    /// Its text, for the journal.
    pub(crate) const fn source(&self) -> &Source {
        &self.source
    }

    /// Whether a rig file describes how the bench is put together.
    pub(crate) fn is_described_by(&self, file: &RigFile) -> bool {
        let Scene { linear, rotary, .. } = &self.scene;
        let (by_linear, by_rotary) = (&file.linear.scale, &file.rotary.scale);
        linear.assembly.is_described_by(by_linear.per_count, by_linear.zero.value())
            && rotary.assembly.is_described_by(by_rotary.per_count, by_rotary.zero.value())
    }

    /// Names and stiffness, MPa, of its samples.
    pub(crate) fn known_samples(&self) -> Vec<(String, f64)> {
        let samples = self.scene.samples.iter();
        samples.map(|sample| (sample.name.clone(), sample.stiffness_mpa)).collect()
    }
}

/// The simulated person at a bench that is commissioned.
#[derive(Debug)]
pub(crate) struct BenchPerson(Person);

impl BenchPerson {
    /// Looks at the bench; the next answers are about the motion since then.
    pub(crate) fn look(&mut self) {
        self.0.look();
    }

    /// Does or sees what is asked.
    pub(crate) fn answer(&mut self, asked: Asked) -> Answer {
        let person = &mut self.0;
        let choice = match asked {
            Asked::NoSample | Asked::ClearWay | Asked::TableAway => Choice::Yes,
            Asked::AtLimit => yes(person.is_at_limit()),
            Asked::HoldSwitch | Asked::LetGo => {
                person.hold_lower_switch(asked == Asked::HoldSwitch);
                Choice::Yes
            }
            Asked::DialZero => {
                person.look();
                Choice::Yes
            }
            Asked::SetIndicators => {
                person.set_indicators();
                Choice::Yes
            }
            Asked::PowerCycle => {
                person.power_cycle_drives();
                Choice::Yes
            }
            Asked::FindZero => {
                person.home_drives();
                Choice::Yes
            }
            Asked::PressStop | Asked::ReleaseStop => {
                person.press_stop(asked == Asked::PressStop);
                Choice::Yes
            }
            Asked::ProbeWent => match person.probe_went() {
                ProbeWent::Up => Choice::Up,
                ProbeWent::Down => Choice::Down,
                ProbeWent::Nowhere => Choice::Nowhere,
            },
            Asked::EdgeSank => match person.edge_sank() {
                EdgeSank::Tip => Choice::Tip,
                EdgeSank::Clamp => Choice::Clamp,
                EdgeSank::Neither => Choice::Neither,
            },
            Asked::WayDown => return Answer::Reading(person.way_down_mm()),
            Asked::Indicator => return Answer::Reading(person.indicator_mm()),
            Asked::EdgeIndicator => return Answer::Reading(person.edge_indicator_mm()),
            Asked::Dial => return Answer::Reading(person.dial_mm()),
            Asked::Gauge => return Answer::Reading(person.gauge_deg()),
            Asked::Gap => return Answer::Reading(person.gap_mm()),
            Asked::AbovePivot => return Answer::Reading(person.surface_above_pivot_mm()),
            Asked::BesidePivot => return Answer::Reading(person.probe_beside_pivot_mm()),
        };
        Answer::Choice(choice)
    }
}

const fn yes(is_so: bool) -> Choice {
    if is_so { Choice::Yes } else { Choice::No }
}

/// The bench of a simulated rig, with its person.
#[derive(Debug, Clone)]
pub(crate) struct Simulation {
    rig: SimHandle,
    /// Whether the simulated person also says that it is done.
    is_answering: bool,
}

impl Simulation {
    /// The bench of a scene, or one that was open before.
    pub(crate) fn start(
        file: &RigFile,
        makes: SimulatedMakes,
        LoadedScene { scene, .. }: LoadedScene,
        bench: Option<SimHandle>,
    ) -> Result<Self, SceneError> {
        let seed = scene.seed;
        let rig = match bench {
            Some(bench) => bench,
            None => SimRig::start(scene, &wiring(file, makes), seed)?.handle(),
        };
        let is_answering = !matches!(
            &file.connection,
            Connection::Simulated(simulation) if simulation.person == SimulatedPerson::Waits
        );
        Ok(Self { rig, is_answering })
    }

    pub(crate) fn handle(&self) -> SimHandle {
        self.rig.clone()
    }

    /// The port of the analyzer.
    pub(crate) fn analyzer(&self, file: &RigFile) -> Endpoint {
        self.endpoint(PortId::Analyzer, "simulated analyzer", &file.analyzer.port)
    }

    /// The port of the drives.
    pub(crate) fn bus(&self, file: &RigFile) -> Endpoint {
        self.endpoint(PortId::Bus, "simulated bus", &file.bus)
    }

    fn endpoint(&self, port: PortId, name: &str, described: &PortFile) -> Endpoint {
        let rig = self.rig.clone();
        let plug =
            Box::new(move || rig.plug(port).map(|pipe| Box::new(pipe) as Box<dyn Transport>));
        Endpoint::Memory { name: name.into(), line: described.line(), plug }
    }

    /// Whether the simulated person is asked what is below the probe, and sees nothing there.
    pub(crate) fn sees_nothing_below(&self) -> bool {
        self.is_answering && self.rig.with(|now, rig| rig.world().truth(now).sample.is_none())
    }

    /// The simulated person, who says what is to be seen; `None` if a user answers. `attempt` counts the steps
    /// before: who begins again does not err in the same places.
    pub(crate) fn person(&self, attempt: u64) -> Option<BenchPerson> {
        let seed = self.rig.with(|_, rig| rig.world().scene().seed);
        self.is_answering.then(|| BenchPerson(self.rig.person(seed.wrapping_add(attempt))))
    }

    /// Does with the hand what a user has said is done.
    pub(crate) fn follow_hand(&self, asked: Asked, answer: Answer) {
        if answer != Answer::Choice(Choice::Yes) {
            return;
        }
        let person = self.rig.person(0);
        match asked {
            Asked::PressStop | Asked::ReleaseStop => person.press_stop(asked == Asked::PressStop),
            Asked::HoldSwitch | Asked::LetGo => {
                person.hold_lower_switch(asked == Asked::HoldSwitch);
            }
            Asked::PowerCycle => person.power_cycle_drives(),
            Asked::FindZero => person.home_drives(),
            _ => {}
        }
    }

    /// Whether the simulated person answers what an event asks.
    pub(crate) const fn answers(&self, event: &Event) -> bool {
        self.is_answering && matches!(event, Event::PromptAsked(_) | Event::RefusalAsked { .. })
    }

    /// Carries out the prompts of a run: when they are asked, or else when somebody has answered.
    pub(crate) fn follow(&self, event: &Event, samples: &[String]) {
        let ((Event::PromptAsked(prompt), true) | (Event::PromptAnswered { prompt, .. }, false)) =
            (event, self.is_answering)
        else {
            return;
        };
        let person = self.rig.technician();
        match *prompt {
            Prompt::PlaceSample { sample } => {
                // The plan was checked against the samples of the scene.
                if let Some(name) = samples.get(sample)
                    && let Err(error) = person.place_sample(name)
                {
                    tracing::error!(%error, "the simulated rig has no such sample");
                }
            }
            Prompt::TurnSensor { orientation } => person.turn_sensor(orientation),
        }
    }
}

/// Simulated devices are of these makes, and wired as in the rig file.
fn wiring(file: &RigFile, makes: SimulatedMakes) -> Wiring {
    Wiring {
        analyzer: makes.analyzer,
        linear: axis_wiring(&file.linear, makes.linear),
        rotary: axis_wiring(&file.rotary, makes.rotary),
        transport: match file.bus.line() {
            Some(line) => LineTransport::Serial { baud: line.baud },
            None => LineTransport::Tcp,
        },
    }
}

fn axis_wiring<U: Unit>(file: &AxisFile<U>, make: DriveMake) -> AxisWiring {
    AxisWiring {
        make,
        unit_id: file.unit_id,
        units_per_step: file.scale.per_count,
        zero: file.scale.zero.value(),
        steps_per_revolution: file.scale.counts_per_revolution,
    }
}
