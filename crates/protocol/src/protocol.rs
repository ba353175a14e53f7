//! The protocol file, key by key.

use std::ops::RangeInclusive;

use rig_files::{
    Faults,
    settings::{Setting, Table},
};
use rig_model::{ContactAngle, Direction, RigLimits};

use crate::{
    AimSettings, Approach, RefusalPolicy, TouchSettings,
    aim::{self, AimKeys},
    sweep::{self, NoLoadKeys, SweepKeys},
};

/// Larger whole numbers lose their last digits in readers of JSON that know only 64-bit floats.
const MAX_SEED: u64 = (1 << 53) - 1;

/// Beyond this the probe would rather slide along the surface than indent it.
const MAX_ANGLE_DEG: f64 = 85.0;

/// A protocol file and its faults.
#[derive(Debug, Clone)]
pub struct Protocol {
    pub(crate) name: String,
    pub(crate) samples: Vec<Setting<String>>,
    pub(crate) directions: Vec<Setting<Direction>>,
    pub(crate) angles: Vec<Setting<ContactAngle>>,
    pub(crate) repeats: Setting<u32>,
    pub(crate) order: Order,
    pub(crate) seed: u64,
    pub(crate) no_load: NoLoadPolicy,
    /// Whether the file states `no_load`.
    pub(crate) states_no_load: bool,
    pub(crate) angle: Setting<AngleKnowledge>,
    pub(crate) model: ModelOrigin,
    pub(crate) aim: Option<Setting<AimKeys>>,
    pub(crate) touch: TouchKeys,
    pub(crate) approach: ApproachKeys,
    pub(crate) no_load_sweep: NoLoadKeys,
    pub(crate) contact_sweep: SweepKeys,
    pub(crate) blind: Option<BlindPhase>,
    pub(crate) limits: Option<Limits>,
    pub(crate) faults: Faults,
}

/// Order of the poses of the main phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    /// As they are listed, angles rising.
    Listed,
    /// At random, as far as that costs no prompt.
    Random,
    /// Those of one mounting by tilt, from the end at which the sample stands.
    ByTravel,
}

/// Order of the blind touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BlindOrder {
    /// As they are drawn.
    Drawn,
    /// Those of one mounting of sample and sensor together.
    ByMounting,
}

/// When the no-load resonance is measured again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoLoadPolicy {
    /// Before every touch.
    EveryTouch,
    /// Whenever the pose has changed or a person has touched the bench.
    EveryPose,
    /// Whenever a person has touched the bench.
    EverySample,
    /// Whenever a person has touched the bench, and before a touch at whose end the drift would exceed twice the
    /// standard deviation that the no-load sweep asks for.
    ByDrift,
    /// At the beginning of the run.
    Once,
}

/// The knowledge of the contact angles in the analysis. The touches are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngleKnowledge {
    /// Direction and angle of each touch, as the stage set them.
    Known,
    /// Only that the touches of one sample at one angle share it, and the turn of the probe between
    /// them.
    Unknown,
}

/// Where the analysis has its model of sensor and contact from. The touches are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelOrigin {
    /// The rig file, corrected by the main touches as far as they identify it.
    Learnt,
    /// The rig file alone.
    Described,
}

#[derive(Debug, Clone)]
pub(crate) struct TouchKeys {
    pub(crate) indentation_mm: Setting<f64>,
    pub(crate) halfway_mm: Option<Setting<f64>>,
    pub(crate) dwell_s: f64,
    pub(crate) on_refusal: RefusalPolicy,
}

#[derive(Debug, Clone)]
pub(crate) struct ApproachKeys {
    pub(crate) start_above_mm: Setting<f64>,
    pub(crate) give_up_below_mm: Setting<f64>,
    pub(crate) coarse_step_mm: Setting<f64>,
    pub(crate) fine_step_mm: Setting<f64>,
    pub(crate) contact_threshold: f64,
    pub(crate) settle_s: f64,
    pub(crate) cycles: u32,
    pub(crate) slip_mm: Option<Setting<f64>>,
    pub(crate) method: Setting<ApproachMethod>,
    pub(crate) speed_mm_per_s: Option<Setting<f64>>,
    pub(crate) slow_speed_mm_per_s: Option<Setting<f64>>,
}

/// How the surface is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ApproachMethod {
    /// In steps, with a reading at rest after each.
    Stepped,
    /// Going down evenly, with a stream of readings.
    Descent,
}

/// The random touches that are classified without their labels.
#[derive(Debug, Clone)]
pub(crate) struct BlindPhase {
    pub(crate) trials: Setting<u32>,
    pub(crate) order: BlindOrder,
    pub(crate) classes: Setting<u32>,
    pub(crate) min_angle_deg: Setting<f64>,
    pub(crate) max_angle_deg: Setting<f64>,
}

impl BlindPhase {
    /// The angles that a trial may draw: whole hundredths of a degree, finer than anyone sets up a
    /// sample.
    pub(crate) fn angles(&self) -> Vec<ContactAngle> {
        let range = self.min_angle_deg.value..=self.max_angle_deg.value;
        let hundredths = (0..9000_u32).map(|hundredths| f64::from(hundredths) / 100.0);
        hundredths.filter(|degrees| range.contains(degrees)).map(contact_angle).collect()
    }
}

/// The limits of the protocol itself.
#[derive(Debug, Clone)]
pub(crate) struct Limits {
    pub(crate) max_indentation_mm: Option<Setting<f64>>,
    pub(crate) max_duration_h: Option<Setting<f64>>,
}

impl Protocol {
    /// The faults of the file on any rig.
    pub fn faults(&self) -> &Faults {
        &self.faults
    }

    /// The knowledge of the contact angles in the analysis.
    pub fn angle(&self) -> AngleKnowledge {
        self.angle.value
    }

    /// Where the analysis has its model from.
    pub const fn model(&self) -> ModelOrigin {
        self.model
    }

    /// The protocol with the settings that its aim has chosen before, for example when a run began.
    #[must_use]
    pub fn with_chosen(self, settings: &AimSettings) -> Self {
        Self { aim: None, ..self.with(settings) }
    }

    /// The protocol with these settings in place of its own.
    pub(crate) fn with(&self, settings: &AimSettings) -> Self {
        let mut chosen = self.clone();
        chosen.no_load = settings.no_load;
        chosen.approach.fine_step_mm.value = settings.fine_step_mm;
        chosen.contact_sweep.request.target_sigma_hz = settings.contact_sigma_hz;
        chosen.no_load_sweep.sweep.request.target_sigma_hz = settings.no_load_sigma_hz;
        chosen
    }

    /// When the reference is measured, if no aim chooses it.
    pub const fn no_load(&self) -> NoLoadPolicy {
        self.no_load
    }

    pub(crate) fn max_indentation_mm(&self) -> Option<&Setting<f64>> {
        self.limits.as_ref()?.max_indentation_mm.as_ref()
    }

    pub(crate) fn max_duration_h(&self) -> Option<&Setting<f64>> {
        self.limits.as_ref()?.max_duration_h.as_ref()
    }

    /// The slip that may go unnoticed, mm.
    fn slip_mm(&self) -> f64 {
        let usual_mm = SLIP_PART * self.touch.indentation_mm.value;
        let usual_mm = usual_mm.max(self.approach.fine_step_mm.value);
        self.approach.slip_mm.as_ref().map_or(usual_mm, |slip_mm| slip_mm.value)
    }

    /// The settings of the descent, for the engine.
    pub(crate) fn touch_settings(&self, limits: &RigLimits) -> TouchSettings {
        let ApproachKeys { contact_threshold, settle_s, cycles, .. } = self.approach;
        TouchSettings {
            indentation_mm: self.touch.indentation_mm.value,
            halfway_mm: self.touch.halfway_mm.as_ref().map(|halfway_mm| halfway_mm.value),
            dwell_s: self.touch.dwell_s,
            approach: Approach {
                start_above_mm: self.approach.start_above_mm.value,
                give_up_below_mm: self.approach.give_up_below_mm.value,
                coarse_step_mm: self.approach.coarse_step_mm.value,
                fine_step_mm: self.approach.fine_step_mm.value,
                contact_threshold,
                settle_s,
                cycles,
                slip_mm: self.slip_mm(),
                descent_mm_per_s: self.descent_mm_per_s(limits),
                slow_descent_mm_per_s: self
                    .approach
                    .slow_speed_mm_per_s
                    .as_ref()
                    .map(|slow| slow.value),
            },
            on_refusal: self.touch.on_refusal,
        }
    }
}

pub(crate) fn protocol(table: &mut Table<'_>) -> Protocol {
    let aim = table.section("aim", aim::read).optional();
    let has_aim = aim.is_some();
    let states_no_load = table.states("no_load");
    Protocol {
        aim,
        states_no_load,
        name: table.text("name").required().value,
        samples: table.text("samples").max_chars(40).list().at_most(100).required().value,
        directions: table
            .choice("directions", Direction::ALL.map(|direction| (direction.name(), direction)))
            .list()
            .required()
            .value,
        angles: table
            .number("angles_deg")
            .range(0.0..=MAX_ANGLE_DEG)
            .list()
            .at_most(100)
            .required()
            .value
            .into_iter()
            .map(|angle| angle.map(contact_angle))
            .collect(),
        repeats: table.count("repeats").range(1..=1000).or(1),
        order: table
            .choice(
                "order",
                [
                    ("listed", Order::Listed),
                    ("random", Order::Random),
                    ("by-travel", Order::ByTravel),
                ],
            )
            .or(Order::Listed)
            .value,
        seed: table.whole("seed").at_most(MAX_SEED).or(1).value,
        no_load: table.choice("no_load", NoLoadPolicy::WORDS).or(NoLoadPolicy::EveryTouch).value,
        angle: table
            .choice(
                "angle",
                [("known", AngleKnowledge::Known), ("unknown", AngleKnowledge::Unknown)],
            )
            .or(AngleKnowledge::Known),
        model: table
            .choice(
                "model",
                [("learnt", ModelOrigin::Learnt), ("described", ModelOrigin::Described)],
            )
            .or(ModelOrigin::Learnt)
            .value,
        touch: table.section("touch", touch).required().value,
        approach: table.section("approach", |table| approach(table, has_aim)).required().value,
        no_load_sweep: table
            .section("no_load_sweep", |table| sweep::read_no_load(table, has_aim))
            .required()
            .value,
        contact_sweep: table
            .section("contact_sweep", |table| sweep::read(table, has_aim))
            .required()
            .value,
        blind: table.section("blind", blind).optional().map(|blind| blind.value),
        limits: table.section("limits", limits).optional().map(|limits| limits.value),
        faults: Faults::new(""),
    }
}

/// The angle of a key whose range is that of `angles_deg`.
pub(crate) fn contact_angle(degrees: f64) -> ContactAngle {
    ContactAngle::new(degrees).expect("the range of the key lies in [0°, 90°)")
}

/// Plausible depths and heights of a protocol, mm: from below the accuracy of any stage to above
/// the thickness of any sample. A number outside is likely to be in another unit.
const DEPTH_MM: RangeInclusive<f64> = 0.005..=50.0;
/// The slip that may go unnoticed if the protocol does not say, as a part of the indentation. The shift
/// grows with the root of the depth or less, so that it is wrong by half of this at most.
const SLIP_PART: f64 = 0.05;
/// The same as [`DEPTH_MM`] for the steps of a search, mm.
pub(crate) const STEP_MM: RangeInclusive<f64> = 0.0005..=10.0;

/// The slowest descents: below, a descent of a millimetre takes a minute.
const SLOW_MM_PER_S: RangeInclusive<f64> = 0.02..=10.0;

fn touch(table: &mut Table<'_>) -> TouchKeys {
    TouchKeys {
        indentation_mm: table.number("indentation_mm").range(DEPTH_MM).required(),
        halfway_mm: table.number("halfway_mm").range(DEPTH_MM).optional(),
        dwell_s: table.number("dwell_s").range(0.0..=3600.0).or(0.0).value,
        on_refusal: table
            .choice("on_refusal", RefusalPolicy::WORDS)
            .or(RefusalPolicy::Record)
            .value,
    }
}

fn approach(table: &mut Table<'_>, has_aim: bool) -> ApproachKeys {
    ApproachKeys {
        start_above_mm: table.number("start_above_mm").range(DEPTH_MM).required(),
        give_up_below_mm: table.number("give_up_below_mm").range(DEPTH_MM).required(),
        coarse_step_mm: table.number("coarse_step_mm").range(STEP_MM).required(),
        fine_step_mm: table.number("fine_step_mm").range(STEP_MM).required_unless(has_aim),
        // More than the whole impedance hardly changes by.
        contact_threshold: table.number("contact_threshold").range(0.001..=1.0).required().value,
        settle_s: table.number("settle_s").range(0.0..=60.0).required().value,
        cycles: table.count("cycles").range(1..=100_000).required().value,
        slip_mm: table.number("slip_mm").range(0.0..=*STEP_MM.end()).optional(),
        method: table
            .choice(
                "method",
                [("stepped", ApproachMethod::Stepped), ("descent", ApproachMethod::Descent)],
            )
            .or(ApproachMethod::Stepped),
        speed_mm_per_s: table.number("speed_mm_per_s").above(0.0).optional(),
        slow_speed_mm_per_s: table.number("slow_speed_mm_per_s").range(SLOW_MM_PER_S).optional(),
    }
}

fn blind(table: &mut Table<'_>) -> BlindPhase {
    BlindPhase {
        trials: table.count("trials").range(1..=100_000).required(),
        order: table
            .choice(
                "order",
                [("drawn", BlindOrder::Drawn), ("by-mounting", BlindOrder::ByMounting)],
            )
            .or(BlindOrder::Drawn)
            .value,
        classes: table.count("classes").at_least(1).required(),
        min_angle_deg: table.number("min_angle_deg").range(0.0..=MAX_ANGLE_DEG).or(0.0),
        max_angle_deg: table.number("max_angle_deg").range(0.0..=MAX_ANGLE_DEG).required(),
    }
}

fn limits(table: &mut Table<'_>) -> Limits {
    Limits {
        max_indentation_mm: table.number("max_indentation_mm").range(DEPTH_MM).optional(),
        max_duration_h: table.number("max_duration_h").above(0.0).optional(),
    }
}

impl RefusalPolicy {
    const WORDS: [(&'static str, Self); 5] = [
        ("record", Self::Record),
        ("repeat", Self::Repeat),
        ("widen", Self::Widen),
        ("abort", Self::Abort),
        ("ask", Self::Ask),
    ];
}

impl NoLoadPolicy {
    /// The word in protocol files.
    pub const fn word(self) -> &'static str {
        match self {
            Self::EveryTouch => "every-touch",
            Self::EveryPose => "every-pose",
            Self::EverySample => "every-sample",
            Self::ByDrift => "by-drift",
            Self::Once => "once",
        }
    }

    /// The policy of a word in protocol files; `None` if there is no such word.
    pub fn of_word(word: &str) -> Option<Self> {
        Self::WORDS.into_iter().find_map(|(own, policy)| (own == word).then_some(policy))
    }

    const WORDS: [(&'static str, Self); 5] = [
        (Self::EveryTouch.word(), Self::EveryTouch),
        (Self::EveryPose.word(), Self::EveryPose),
        (Self::EverySample.word(), Self::EverySample),
        (Self::ByDrift.word(), Self::ByDrift),
        (Self::Once.word(), Self::Once),
    ];
}
