//! Lays the steps out with few prompts and little travel.
//!
//! Samples are outermost, because changing one takes a person. Within a sample the sensor begins
//! as it stands and is turned at most once, so that the next sample begins where this one ended.
//! Within one mounting of the sensor the directions come as they are listed, angles rising, and
//! repeats follow each other. A random order shuffles the samples and what lies within one
//! mounting: it costs travel and no prompt. The trials of the blind phase are never put in order.

use rig_files::Faults;
use rig_model::{Orientation, RigLimits, random::Stream};

use crate::{
    Action, Phase, Plan, Pose, Prompt, Protocol, Step, StepId, Touch, check,
    fault::ProtocolFault,
    protocol::{BlindPhase, NoLoadPolicy, Order},
};

/// The purpose of a stream of draws. Their streams are independent, so that a change in one part of
/// a protocol leaves the draws of the other part as they were.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Draws {
    /// The order of the main phase.
    Order = 1,
    /// The trials of the blind phase.
    Blind = 2,
}

impl Draws {
    /// `seed` has at most 53 bits; the bits above them select the stream.
    pub(crate) fn stream(self, seed: u64) -> Stream {
        Stream::of_seed(seed | (self as u64) << 53)
    }
}

impl Plan {
    /// Checks the protocol against the limits of a rig and lays out its steps.
    ///
    /// `known_samples` are the names of the available samples, if they are known: a simulated rig
    /// knows them, a real one takes the sample that the person places.
    ///
    /// # Errors
    /// Every fault of the file, by itself and on this rig.
    pub fn new(
        protocol: &Protocol,
        limits: &RigLimits,
        known_samples: Option<&[String]>,
    ) -> Result<Self, Faults> {
        let mut faults = protocol.faults.clone();
        check::on_rig(protocol, limits, &mut faults);
        if let Some(known) = known_samples {
            check::samples_are_known(protocol, known, &mut faults);
        }
        if !faults.is_empty() {
            return Err(faults);
        }
        let plan = Self {
            name: protocol.name.clone(),
            samples: protocol.samples.iter().map(|sample| sample.value.clone()).collect(),
            steps: Layout::of(protocol),
            touch: protocol.touch_settings(),
            no_load_sweep: protocol.no_load_sweep.request,
            contact_sweep: protocol.contact_sweep.request,
            classes: protocol.blind.as_ref().map(|blind| blind.classes.value as usize),
            seed: protocol.seed,
        };
        if let Some(limit) = protocol.max_duration_h() {
            let expected = plan.summary(limits).duration_s / 3600.0;
            limit.check(&mut faults, |&limit| {
                (expected > limit).then_some(ProtocolFault::TooLong { expected, limit })
            });
        }
        faults.finish(plan)
    }
}

/// The steps so far, and the state of the bench after them.
struct Layout<'a> {
    protocol: &'a Protocol,
    steps: Vec<Step>,
    sample: Option<usize>,
    orientation: Option<Orientation>,
    /// The pose of the last no-load measurement, until a person touches the bench.
    no_load_pose: Option<Pose>,
}

impl<'a> Layout<'a> {
    fn of(protocol: &'a Protocol) -> Vec<Step> {
        let (sample, orientation, no_load_pose) = (None, None, None);
        let mut layout = Self { protocol, steps: Vec::new(), sample, orientation, no_load_pose };
        layout.main();
        if let Some(blind) = &protocol.blind {
            layout.blind(blind);
        }
        layout.steps
    }

    fn main(&mut self) {
        let mut random = match self.protocol.order {
            Order::Listed => None,
            Order::Random => Some(Draws::Order.stream(self.protocol.seed)),
        };
        let mut samples: Vec<_> = (0..self.protocol.samples.len()).collect();
        if let Some(random) = &mut random {
            random.shuffle(&mut samples);
        }
        for sample in samples {
            for orientation in self.orientations() {
                let mut touches = self.mounting(sample, orientation);
                if let Some(random) = &mut random {
                    random.shuffle(&mut touches);
                }
                for touch in touches {
                    let Pose { direction, angle } = touch.pose;
                    let name = &self.protocol.samples[sample].value;
                    let degrees = angle.degrees();
                    let id = format!("main/{name}/{direction}/{degrees}/{}", touch.repeat);
                    self.touch(&id, touch);
                }
            }
        }
    }

    /// The orientations of the listed directions, the present one first.
    fn orientations(&self) -> Vec<Orientation> {
        let mut orientations = Vec::new();
        let listed = self.protocol.directions.iter().map(|direction| direction.value.orientation());
        for orientation in self.orientation.into_iter().chain(listed.clone()) {
            if !orientations.contains(&orientation) && listed.clone().any(|o| o == orientation) {
                orientations.push(orientation);
            }
        }
        orientations
    }

    /// The touches of one sample with the sensor standing one way.
    fn mounting(&self, sample: usize, orientation: Orientation) -> Vec<Touch> {
        let mut angles: Vec<_> = self.protocol.angles.iter().map(|angle| angle.value).collect();
        angles.sort_by(|a, b| a.degrees().total_cmp(&b.degrees()));
        let mut touches = Vec::new();
        for direction in self.protocol.directions.iter().map(|direction| direction.value) {
            if direction.orientation() != orientation {
                continue;
            }
            for &angle in &angles {
                for repeat in 1..=self.protocol.repeats.value {
                    let pose = Pose { direction, angle };
                    touches.push(Touch { phase: Phase::Main, sample, pose, repeat });
                }
            }
        }
        touches
    }

    fn blind(&mut self, blind: &BlindPhase) {
        let mut random = Draws::Blind.stream(self.protocol.seed);
        let angles = blind.angles();
        for trial in 1..=blind.trials.value {
            let sample = random.below(self.protocol.samples.len());
            let direction = random.below(self.protocol.directions.len());
            let direction = self.protocol.directions[direction].value;
            let angle = angles[random.below(angles.len())];
            let pose = Pose { direction, angle };
            let touch = Touch { phase: Phase::Blind, sample, pose, repeat: trial };
            self.touch(&format!("blind/{trial}"), touch);
        }
    }

    /// A touch and the steps that it needs before it.
    fn touch(&mut self, id: &str, touch: Touch) {
        let Touch { sample, pose, .. } = touch;
        if self.sample != Some(sample) {
            self.ask(format!("{id}/place-sample"), Prompt::PlaceSample { sample });
            self.sample = Some(sample);
        }
        let orientation = pose.direction.orientation();
        if self.orientation != Some(orientation) {
            self.ask(format!("{id}/turn-sensor"), Prompt::TurnSensor { orientation });
            self.orientation = Some(orientation);
        }
        if self.needs_no_load(pose) {
            self.no_load_pose = Some(pose);
            self.push(format!("{id}/no-load"), Action::NoLoad(pose));
        }
        self.push(id.to_owned(), Action::Touch(touch));
    }

    fn needs_no_load(&self, pose: Pose) -> bool {
        match self.protocol.no_load {
            NoLoadPolicy::EveryTouch => true,
            NoLoadPolicy::EveryPose => self.no_load_pose != Some(pose),
            NoLoadPolicy::EverySample | NoLoadPolicy::Once => self.no_load_pose.is_none(),
        }
    }

    fn ask(&mut self, id: String, prompt: Prompt) {
        if self.protocol.no_load != NoLoadPolicy::Once {
            self.no_load_pose = None;
        }
        self.push(id, Action::Prompt(prompt));
    }

    fn push(&mut self, id: String, action: Action) {
        self.steps.push(Step { id: StepId(id), action });
    }
}
