//! The protocols that are compared: what is touched, and how it is read.

use std::f64::consts::FRAC_PI_2;

use rig_analysis::{
    classify::{Class, Classifier, Decision},
    stiffness::{Compensation, PosedTouch},
};
use rig_contact::{
    ContactLaw, Depth, Direction, Friction, Models, Pose, Sensor, Tier,
    inverse::{
        AnglePrior, AzimuthPrior, InverseError, SiteTouch, TiltInference, TissueKind, TouchModel,
        infer_tilt,
    },
};

use super::bench::{Bench, ENCODER_MM, MAX_ANGLE_RAD, NUISANCES};
use crate::paper_bench::{ANGLES_DEG, INDENTATION_MM, SAMPLES_MPA, contact, tissue};
use rig_model::random::Stream;

/// How a sample is touched and read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Protocol {
    /// One shift among the shifts of all poses: no angle is compensated, and there is no stiffness.
    ShiftAlone,
    /// One touch whose angle and direction are known to the slope of the surface.
    KnownAngle,
    /// One touch whose direction is known and whose angle is not.
    OneReading,
    /// Two depths of one point, its direction known and its angle not.
    TwoDepths,
    /// Four spins of the probe on one point, of which neither angle nor azimuth are known.
    Spins,
    /// One touch from each of three directions on three points of a sample, of which neither angle
    /// nor azimuth are known.
    Directions,
}

/// The smaller depth of [`Protocol::TwoDepths`], mm.
const SHALLOW_MM: f64 = 0.25;
/// Half of a 95 % interval in standard deviations.
const HALF_95: f64 = 1.959963984540054;

/// What one trial came to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trial {
    /// Which sample it was.
    pub(super) sample: usize,
    /// At which angle, rad.
    pub(super) angle_rad: f64,
    /// Which sample it was taken for.
    pub(super) taken_for: Option<usize>,
    /// The stiffness, unless it was refused.
    pub(super) found: Option<Found>,
}

/// A stiffness beside the truth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    /// The stiffness over the true one, less one.
    pub(super) error_rel: f64,
    /// Whether the 95 % interval holds the truth.
    pub(super) is_covered: bool,
}

/// All that reads touches.
#[derive(Debug)]
pub(super) struct Reader {
    compensation: Compensation,
    /// Of shifts of all poses.
    shifts: Classifier,
    /// Of stiffness.
    stiffness: Classifier,
}

impl Protocol {
    pub(super) const ALL: [Self; 6] = [
        Self::ShiftAlone,
        Self::KnownAngle,
        Self::OneReading,
        Self::TwoDepths,
        Self::Spins,
        Self::Directions,
    ];

    /// The word in tables.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::ShiftAlone => "shift alone",
            Self::KnownAngle => "angle known",
            Self::OneReading => "unknown one reading",
            Self::TwoDepths => "unknown two depths",
            Self::Spins => "unknown four spins",
            Self::Directions => "unknown three directions",
        }
    }

    /// One trial on the bench.
    pub(super) fn trial(self, bench: &Bench, reader: &Reader, random: &mut Stream) -> Trial {
        let sample = random.pick(&[0, 1, 2, 3, 4]);
        let angle_rad = MAX_ANGLE_RAD * random.uniform();
        let place = Place { bench, sample, angle_rad };
        let (taken_for, found) = match self {
            Self::ShiftAlone => (place.shift_alone(reader, random), None),
            Self::KnownAngle => place.known_angle(reader, random),
            Self::OneReading => place.depths(reader, &[INDENTATION_MM], random),
            Self::TwoDepths => place.depths(reader, &[SHALLOW_MM, INDENTATION_MM], random),
            Self::Spins => place.spins(reader, random),
            Self::Directions => place.directions(reader, random),
        };
        Trial { sample, angle_rad, taken_for, found }
    }
}

/// Where a trial touches.
struct Place<'a> {
    bench: &'a Bench,
    sample: usize,
    angle_rad: f64,
}

/// The sample that a trial was taken for, and the stiffness found.
type Answer = (Option<usize>, Option<Found>);

const DEPTH: Depth = Depth::Indentation { along_probe_mm: INDENTATION_MM };

impl Place<'_> {
    fn shift_alone(&self, reader: &Reader, random: &mut Stream) -> Option<usize> {
        let (shift_hz, ..) = self.tilted_touch(random);
        class(&reader.shifts, shift_hz, NUISANCES.shift_hz / shift_hz)
    }

    /// One touch with the slope of its surface: the shift, the direction, the true stiffness.
    fn tilted_touch(&self, random: &mut Stream) -> (f64, Direction, f64) {
        let direction = random.pick(&Direction::ALL);
        let point = Bench::point(self.sample, random);
        let angle_rad = self.angle_rad + Bench::slope_rad(random);
        let azimuth_rad = direction.azimuth_rad();
        let shift_hz =
            self.bench.measure_hz(&point, angle_rad, azimuth_rad, INDENTATION_MM, random);
        (shift_hz, direction, point.young_mpa)
    }

    fn known_angle(&self, reader: &Reader, random: &mut Stream) -> Answer {
        let (shift_hz, direction, truth_mpa) = self.tilted_touch(random);
        let pose = Pose::leaning(direction, self.angle_rad).expect("the angle is acute");
        let sigma_hz = NUISANCES.shift_hz;
        let touch = PosedTouch { sample: self.sample, pose, depth: DEPTH, shift_hz, sigma_hz };
        let Ok(one) = reader.compensation.of_touch(&touch) else { return (None, None) };
        let found = Found {
            error_rel: one.young_mpa / truth_mpa - 1.0,
            is_covered: (one.young_mpa - truth_mpa).abs() <= HALF_95 * one.sigma_mpa,
        };
        let taken_for = class(&reader.stiffness, one.young_mpa, one.sigma_mpa / one.young_mpa);
        (taken_for, Some(found))
    }

    fn depths(&self, reader: &Reader, depths_mm: &[f64], random: &mut Stream) -> Answer {
        let azimuth_rad = random.pick(&Direction::ALL).azimuth_rad();
        let point = Bench::point(self.sample, random);
        let touch = |&depth_mm: &f64| SiteTouch {
            shift_hz: self.bench.measure_hz(&point, self.angle_rad, azimuth_rad, depth_mm, random),
            sigma_hz: NUISANCES.shift_hz,
            spin_rad: 0.0,
            depth: Depth::Indentation { along_probe_mm: depth_mm },
        };
        let touches: Vec<SiteTouch> = depths_mm.iter().map(touch).collect();
        let touch_model = reader.touch_model(NUISANCES.depth_mm, ENCODER_MM);
        let azimuth = AzimuthPrior::Known(azimuth_rad);
        reader.answer(&reader.infer(&touches, &touch_model, azimuth), point.young_mpa)
    }

    fn spins(&self, reader: &Reader, random: &mut Stream) -> Answer {
        let azimuth_rad = 4.0 * FRAC_PI_2 * random.uniform();
        let point = Bench::point(self.sample, random);
        let touches = [0.0, 1.0, 2.0, 3.0].map(|quarters| {
            let spin_rad = quarters * FRAC_PI_2;
            let at_rad = azimuth_rad - spin_rad;
            let shift_hz =
                self.bench.measure_hz(&point, self.angle_rad, at_rad, INDENTATION_MM, random);
            SiteTouch { shift_hz, sigma_hz: NUISANCES.shift_hz, spin_rad, depth: DEPTH }
        });
        let touch_model = reader.touch_model(NUISANCES.depth_mm, ENCODER_MM);
        reader.answer(&reader.infer(&touches, &touch_model, AzimuthPrior::Unknown), point.young_mpa)
    }

    /// Each direction touches a point of its own, with its own stiffness, slope and surface; the
    /// truth is that of the sample.
    fn directions(&self, reader: &Reader, random: &mut Stream) -> Answer {
        let touches = Direction::ALL.map(|direction| {
            let point = Bench::point(self.sample, random);
            let angle_rad = self.angle_rad + Bench::slope_rad(random);
            let at_rad = direction.azimuth_rad();
            let shift_hz = self.bench.measure_hz(&point, angle_rad, at_rad, INDENTATION_MM, random);
            // No shift grows faster than the stiffness does.
            let sigma_hz = NUISANCES.shift_hz.hypot(NUISANCES.young_rel * shift_hz);
            SiteTouch { shift_hz, sigma_hz, spin_rad: -at_rad, depth: DEPTH }
        });
        let touch_model = reader.touch_model(0.0, NUISANCES.depth_mm.hypot(ENCODER_MM));
        let found = reader.infer(&touches, &touch_model, AzimuthPrior::Unknown);
        reader.answer(&found, SAMPLES_MPA[self.sample])
    }
}

impl Reader {
    pub(super) fn new() -> Self {
        let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
        let compensation = Compensation {
            models,
            tier: Tier::E1s,
            law: ContactLaw::Sneddon,
            friction: Friction::Sticking,
            kind: TissueKind::SOFT,
            shared_depth_sigma_mm: NUISANCES.depth_mm,
            depth_sigma_mm: ENCODER_MM,
            angle_sigma_rad: NUISANCES.angle_deg.to_radians(),
        };
        let class = |young: f64| Class { centre: young.ln(), spread: NUISANCES.young_rel };
        let stiffness =
            Classifier::with_classes(SAMPLES_MPA.map(class).to_vec()).expect("the samples differ");
        Self { shifts: shift_classes(&models), compensation, stiffness }
    }

    fn touch_model(&self, shared_depth_sigma_mm: f64, depth_sigma_mm: f64) -> TouchModel {
        let Compensation { tier, law, friction, kind, .. } = self.compensation;
        TouchModel { tier, law, friction, kind, shared_depth_sigma_mm, depth_sigma_mm }
    }

    fn infer(
        &self,
        touches: &[SiteTouch],
        touch_model: &TouchModel,
        azimuth: AzimuthPrior,
    ) -> Result<TiltInference, InverseError> {
        let angle = AnglePrior::Within { max_rad: MAX_ANGLE_RAD };
        infer_tilt(&self.compensation.models, touches, touch_model, angle, azimuth)
    }

    fn answer(&self, found: &Result<TiltInference, InverseError>, truth_mpa: f64) -> Answer {
        let Ok(TiltInference { young_mpa: young, .. }) = found else { return (None, None) };
        let found = Found {
            error_rel: young.value / truth_mpa - 1.0,
            is_covered: young.contains(truth_mpa),
        };
        (class(&self.stiffness, young.value, young.sigma / young.value), Some(found))
    }
}

/// Classes of shifts, calibrated on the paper's poses.
fn shift_classes(models: &Models) -> Classifier {
    let (mut shifts, mut labels) = (Vec::new(), Vec::new());
    for (sample, &young_mpa) in SAMPLES_MPA.iter().enumerate() {
        for direction in Direction::ALL {
            for angle_deg in ANGLES_DEG {
                let contact = contact(direction, angle_deg, DEPTH, ContactLaw::Sneddon);
                let prediction = models.predict(Tier::Reference, &tissue(young_mpa), &contact);
                shifts.push(prediction.expect("the paper's poses are within the law").shift_hz);
                labels.push(sample);
            }
        }
    }
    Classifier::calibrated(&shifts, &labels, SAMPLES_MPA.len()).expect("every sample has a class")
}

fn class(classifier: &Classifier, value: f64, sigma_rel: f64) -> Option<usize> {
    match classifier.classify(value, sigma_rel)? {
        Decision::Class { class, .. } => Some(class),
        Decision::Unknown { .. } => None,
    }
}
