//! Lays the steps out with few prompts and little travel.
//!
//! Samples are the outer loop, because a change of sample needs a person. For each sample the
//! sensor begins in its present orientation and is turned at most once, so that the next sample
//! begins in that orientation. For one mounting of the sensor, directions follow the listed order
//! with rising angles, and repeats follow each other. A random order shuffles the samples and the
//! touches of one mounting: it costs travel but no prompt. An order by travel goes through the tilts of a
//! mounting once, from the end that is nearer. The trials of the blind phase keep their
//! random order, or are made by mounting: the draws are the same, the samples come in random order, and the
//! touches of one mounting by tilt.

use rig_files::Faults;
use rig_model::{Orientation, RigLimits, random::Stream};

use crate::{
    Action, Phase, Plan, Pose, Prompt, Protocol, Step, StepId, Touch, TouchModel, aim, check,
    fault::ProtocolFault,
    protocol::{BlindOrder, BlindPhase, NoLoadPolicy, Order},
};

/// The purpose of a stream of draws. Their streams are independent, so that a change in one part of
/// a protocol leaves the draws of the other part as they were.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Draws {
    /// The order of the main phase.
    Order = 1,
    /// The trials of the blind phase.
    Blind = 2,
    /// The order of the samples of blind touches by mounting.
    Mountings = 3,
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
    /// knows them, a real one takes the sample that the person places. `model` is asked about the touches of
    /// a protocol with an aim.
    ///
    /// # Errors
    /// Every fault of the file, alone and on this rig.
    pub fn new(
        protocol: &Protocol,
        limits: &RigLimits,
        known_samples: Option<&[String]>,
        model: &dyn TouchModel,
    ) -> Result<Self, Faults> {
        let mut faults = protocol.faults.clone();
        check::on_rig(protocol, limits, &mut faults);
        if let Some(known) = known_samples {
            check::samples_are_known(protocol, known, &mut faults);
        }
        if !faults.is_empty() {
            return Err(faults);
        }
        let plan = match &protocol.aim {
            None => Some(Self::of(protocol, limits)),
            Some(aim) => aim::choose(protocol, &aim.value, limits, model, &mut faults),
        };
        let Some(plan) = plan else { return Err(faults) };
        if let Some(limit) = protocol.max_duration_h() {
            let expected = plan.summary(limits).duration_s / 3600.0;
            limit.check(&mut faults, |&limit| {
                (expected > limit).then_some(ProtocolFault::TooLong { expected, limit })
            });
        }
        faults.finish(plan)
    }

    /// The steps of a protocol in which nothing is left out.
    pub(crate) fn of(protocol: &Protocol, limits: &RigLimits) -> Self {
        let plan = Self {
            name: protocol.name.clone(),
            samples: protocol.samples.iter().map(|sample| sample.value.clone()).collect(),
            steps: Layout::of(protocol),
            touch: protocol.touch_settings(limits),
            no_load: protocol.no_load,
            no_load_sweep: protocol.no_load_sweep.sweep.request,
            survey_s: protocol.no_load_sweep.survey_s,
            level_check: protocol.no_load_sweep.level_check,
            contact_sweep: protocol.contact_sweep.request,
            classes: protocol.blind.as_ref().map(|blind| blind.classes.value as usize),
            seed: protocol.seed,
            aim: None,
        };
        match &protocol.blind {
            Some(blind) if blind.order == BlindOrder::ByMounting => plan.by_mounting(),
            _ => plan,
        }
    }

    /// The plan of a resumed run: the steps of the finished touches, unchanged, and then the other
    /// touches in their order. Sample and orientation are asked for again, and the no-load
    /// resonance is measured again, because the bench may have changed in the meantime. Also
    /// returns the number of finished steps.
    #[must_use]
    pub fn resumed(&self, is_done: impl Fn(&StepId) -> bool) -> (Self, usize) {
        let mut layout = Layout::new(self.no_load);
        let (mut done, mut before) = (Vec::new(), Vec::new());
        for step in &self.steps {
            match step.action {
                Action::Touch(touch) if !is_done(&step.id) => {
                    before.clear();
                    layout.touch(&step.id.0, touch);
                }
                Action::Touch(_) => {
                    done.append(&mut before);
                    done.push(step.clone());
                }
                Action::Prompt(_) | Action::NoLoad(_) => before.push(step.clone()),
            }
        }
        let from = done.len();
        let steps = done.into_iter().chain(layout.steps).collect();
        (Self { steps, ..self.clone() }, from)
    }

    /// The plan without its first steps.
    #[must_use]
    pub fn after(&self, steps: usize) -> Self {
        Self { steps: self.steps.iter().skip(steps).cloned().collect(), ..self.clone() }
    }

    /// This plan with the blind touches by mounting: with the fewest changes by hand.
    #[must_use]
    pub fn by_mounting(&self) -> Self {
        let touches = self.steps.iter().filter_map(|step| match step.action {
            Action::Touch(touch) => Some((step.id.0.as_str(), touch)),
            _ => None,
        });
        let (main, blind): (Vec<_>, Vec<_>) =
            touches.partition(|(_, touch)| touch.phase == Phase::Main);
        let mut layout = Layout::new(self.no_load);
        for (id, touch) in main {
            layout.touch(id, touch);
        }
        layout.mountings(&blind, self.seed);
        Self { steps: layout.steps, ..self.clone() }
    }

    /// A plan of one touch of this one, with the steps that it needs; `None` if there is no such touch.
    #[must_use]
    pub fn only(&self, wanted: &str) -> Option<Self> {
        let step = self.steps.iter().find(|step| step.id.0 == wanted)?;
        let Action::Touch(touch) = step.action else { return None };
        let mut layout = Layout::new(self.no_load);
        layout.touch(wanted, touch);
        Some(Self { steps: layout.steps, ..self.clone() })
    }
}

/// The steps so far, and the state of the bench after them.
struct Layout {
    no_load: NoLoadPolicy,
    steps: Vec<Step>,
    sample: Option<usize>,
    orientation: Option<Orientation>,
    /// Where the sample stands.
    tilt_deg: f64,
    /// The pose of the last no-load measurement, until a person touches the bench.
    no_load_pose: Option<Pose>,
}

impl Layout {
    const fn new(no_load: NoLoadPolicy) -> Self {
        let (sample, orientation, no_load_pose) = (None, None, None);
        Self { no_load, steps: Vec::new(), sample, orientation, tilt_deg: 0.0, no_load_pose }
    }

    fn of(protocol: &Protocol) -> Vec<Step> {
        let mut layout = Self::new(protocol.no_load);
        layout.main(protocol);
        if let Some(blind) = &protocol.blind {
            layout.blind(protocol, blind);
        }
        layout.steps
    }

    fn main(&mut self, protocol: &Protocol) {
        let mut random = match protocol.order {
            Order::Listed | Order::ByTravel => None,
            Order::Random => Some(Draws::Order.stream(protocol.seed)),
        };
        let mut samples: Vec<_> = (0..protocol.samples.len()).collect();
        if let Some(random) = &mut random {
            random.shuffle(&mut samples);
        }
        for sample in samples {
            for orientation in self.orientations(protocol) {
                let mut touches = mounting(protocol, sample, orientation);
                if let Some(random) = &mut random {
                    random.shuffle(&mut touches);
                }
                if protocol.order == Order::ByTravel {
                    self.by_travel(sample, &mut touches, tilt_deg);
                }
                for touch in touches {
                    let Pose { direction, angle } = touch.pose;
                    let name = &protocol.samples[sample].value;
                    let degrees = angle.degrees();
                    let id = format!("main/{name}/{direction}/{degrees}/{}", touch.repeat);
                    self.touch(&id, touch);
                }
            }
        }
    }

    /// The orientations of the listed directions, the present one first.
    fn orientations(&self, protocol: &Protocol) -> Vec<Orientation> {
        let mut orientations = Vec::new();
        let listed = protocol.directions.iter().map(|direction| direction.value.orientation());
        for orientation in self.orientation.into_iter().chain(listed.clone()) {
            if !orientations.contains(&orientation) && listed.clone().any(|o| o == orientation) {
                orientations.push(orientation);
            }
        }
        orientations
    }

    fn blind(&mut self, protocol: &Protocol, blind: &BlindPhase) {
        let mut random = Draws::Blind.stream(protocol.seed);
        let angles = blind.angles();
        for trial in 1..=blind.trials.value {
            let sample = random.below(protocol.samples.len());
            let direction = random.below(protocol.directions.len());
            let direction = protocol.directions[direction].value;
            let angle = angles[random.below(angles.len())];
            let pose = Pose { direction, angle };
            let touch = Touch { phase: Phase::Blind, sample, pose, repeat: trial };
            self.touch(&format!("blind/{trial}"), touch);
        }
    }

    /// Touches by mounting, the present one first.
    fn mountings(&mut self, touches: &[(&str, Touch)], seed: u64) {
        let mut samples: Vec<usize> = touches.iter().map(|(_, touch)| touch.sample).collect();
        samples.sort_unstable();
        samples.dedup();
        Draws::Mountings.stream(seed).shuffle(&mut samples);
        samples.sort_by_key(|sample| self.sample != Some(*sample));
        for sample in samples {
            let of_sample = touches.iter().filter(|(_, touch)| touch.sample == sample).copied();
            let is_present = |touch: &Touch, layout: &Self| {
                layout.orientation == Some(touch.pose.direction.orientation())
            };
            // Each sample has two mountings at most; the first one is in the present orientation.
            let (present, turned): (Vec<_>, Vec<_>) =
                of_sample.partition(|(_, touch)| is_present(touch, self));
            for mut mounting in [present, turned] {
                self.by_travel(sample, &mut mounting, |(_, touch)| tilt_deg(touch));
                for (id, touch) in mounting {
                    self.touch(id, touch);
                }
            }
        }
    }

    /// Sorts the touches of one mounting by tilt, from the end that is nearer to where the sample will stand:
    /// level if it has to be placed.
    fn by_travel<T>(&self, sample: usize, touches: &mut [T], tilt_deg: impl Fn(&T) -> f64) {
        let here = if self.sample == Some(sample) { self.tilt_deg } else { 0.0 };
        touches.sort_by(|one, other| tilt_deg(one).total_cmp(&tilt_deg(other)));
        let way = |end: Option<&T>| end.map_or(0.0, |touch| (tilt_deg(touch) - here).abs());
        if way(touches.last()) < way(touches.first()) {
            // Repeats stay in their order.
            touches.sort_by(|one, other| tilt_deg(other).total_cmp(&tilt_deg(one)));
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
        self.tilt_deg = tilt_deg(&touch);
    }

    fn needs_no_load(&self, pose: Pose) -> bool {
        match self.no_load {
            // By drift, the rig leaves out those that it does not need.
            NoLoadPolicy::EveryTouch | NoLoadPolicy::ByDrift => true,
            NoLoadPolicy::EveryPose => self.no_load_pose != Some(pose),
            NoLoadPolicy::EverySample | NoLoadPolicy::Once => self.no_load_pose.is_none(),
        }
    }

    fn ask(&mut self, id: String, prompt: Prompt) {
        if self.no_load != NoLoadPolicy::Once {
            self.no_load_pose = None;
        }
        self.push(id, Action::Prompt(prompt));
    }

    fn push(&mut self, id: String, action: Action) {
        self.steps.push(Step { id: StepId(id), action });
    }
}

/// Where the rotary stage stands in a touch, degrees.
fn tilt_deg(touch: &Touch) -> f64 {
    touch.pose.direction.rotary_position(touch.pose.angle).value()
}

/// The touches of one sample with the sensor standing one way.
fn mounting(protocol: &Protocol, sample: usize, orientation: Orientation) -> Vec<Touch> {
    let mut angles: Vec<_> = protocol.angles.iter().map(|angle| angle.value).collect();
    angles.sort_by(|a, b| a.degrees().total_cmp(&b.degrees()));
    let mut touches = Vec::new();
    for direction in protocol.directions.iter().map(|direction| direction.value) {
        if direction.orientation() != orientation {
            continue;
        }
        for &angle in &angles {
            for repeat in 1..=protocol.repeats.value {
                let pose = Pose { direction, angle };
                touches.push(Touch { phase: Phase::Main, sample, pose, repeat });
            }
        }
    }
    touches
}
