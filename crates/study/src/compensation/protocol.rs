//! The compared protocols: touches and their inference.

use std::f64::consts::FRAC_PI_2;

use rig_analysis::{
    classify::{Class, Classifier, Decision},
    stiffness::{Compensation, PosedTouch},
};
use rig_contact::{
    ContactLaw, Depth, Direction, Models, Pose, SensorDescription, Tier,
    inverse::{AzimuthPrior, InverseError, ShiftSigmas, SiteTouch, TiltInference},
};

use super::truth::{ENCODER_MM, MAX_ANGLE_RAD, NUISANCES, TruthModel};
use crate::paper_bench::{ANGLES_DEG, INDENTATION_MM, SAMPLES_MPA, contact, tissue};
use rig_model::random::Stream;

/// A protocol of touches with its inference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TouchProtocol {
    /// One shift, classified among the shifts of all poses, without compensation or stiffness.
    ShiftAlone,
    /// One touch at a known direction and angle; the slope of the surface is unknown.
    KnownAngle,
    /// One touch at a known direction and an unknown angle.
    OneTouch,
    /// Two depths at one point, at a known direction and an unknown angle.
    TwoDepths,
    /// Four spins of the probe at one point; angle and azimuth are unknown.
    Spins,
    /// One touch from each of three directions at three points of a sample; angle and azimuth are
    /// unknown.
    Directions,
}

/// The smaller depth of [`TouchProtocol::TwoDepths`], mm.
const SHALLOW_MM: f64 = 0.25;
/// Half width of a 95 % interval in standard deviations.
const HALF_95: f64 = 1.959963984540054;

/// The result of one trial.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trial {
    /// Index of the true sample.
    pub(super) sample: usize,
    /// Contact angle, rad.
    pub(super) angle_rad: f64,
    /// Index of the recognised sample; `None` if none was recognised.
    pub(super) recognised_as: Option<usize>,
    /// Error of the stiffness; `None` for a refusal.
    pub(super) stiffness: Option<StiffnessError>,
}

/// A stiffness compared with the truth.
#[derive(Debug, Clone, Copy)]
pub(super) struct StiffnessError {
    /// Relative error of the stiffness.
    pub(super) error_rel: f64,
    /// Whether the 95 % interval contains the truth.
    pub(super) is_covered: bool,
}

/// The inference and the classifiers.
#[derive(Debug)]
pub(super) struct Analysis {
    /// Touches of one point, whose surface is found once.
    compensation: Compensation,
    /// Touches of several points, each with its own surface.
    across_points: Compensation,
    /// Classes of the shifts of all poses.
    shifts: Classifier,
    /// Classes of the stiffness.
    stiffness: Classifier,
}

impl TouchProtocol {
    pub(super) const ALL: [Self; 6] = [
        Self::ShiftAlone,
        Self::KnownAngle,
        Self::OneTouch,
        Self::TwoDepths,
        Self::Spins,
        Self::Directions,
    ];

    /// The name in tables.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::ShiftAlone => "shift alone",
            Self::KnownAngle => "angle known",
            Self::OneTouch => "unknown one touch",
            Self::TwoDepths => "unknown two depths",
            Self::Spins => "unknown four spins",
            Self::Directions => "unknown three directions",
        }
    }

    /// One trial.
    pub(super) fn trial(
        self,
        truth: &TruthModel,
        analysis: &Analysis,
        random: &mut Stream,
    ) -> Trial {
        let sample = random.pick(&[0, 1, 2, 3, 4]);
        let angle_rad = MAX_ANGLE_RAD * random.uniform();
        let site = Site { truth, sample, angle_rad };
        let Outcome { recognised_as, stiffness } = match self {
            Self::ShiftAlone => site.shift_alone(analysis, random),
            Self::KnownAngle => site.known_angle(analysis, random),
            Self::OneTouch => site.depths(analysis, &[INDENTATION_MM], random),
            Self::TwoDepths => site.depths(analysis, &[SHALLOW_MM, INDENTATION_MM], random),
            Self::Spins => site.spins(analysis, random),
            Self::Directions => site.directions(analysis, random),
        };
        Trial { sample, angle_rad, recognised_as, stiffness }
    }
}

/// A touch in a known direction, with the true stiffness of its point.
struct TiltedTouch {
    shift_hz: f64,
    direction: Direction,
    young_mpa: f64,
}

/// The site of a trial.
struct Site<'a> {
    truth: &'a TruthModel,
    sample: usize,
    angle_rad: f64,
}

/// The outcome of an inference; the default is a refusal.
#[derive(Debug, Clone, Copy, Default)]
struct Outcome {
    recognised_as: Option<usize>,
    stiffness: Option<StiffnessError>,
}

const DEPTH: Depth = Depth::Indentation { along_probe_mm: INDENTATION_MM };

impl Site<'_> {
    fn shift_alone(&self, analysis: &Analysis, random: &mut Stream) -> Outcome {
        let TiltedTouch { shift_hz, .. } = self.tilted_touch(random);
        let sigma_rel = NUISANCES.shift_hz / shift_hz;
        Outcome { recognised_as: class(&analysis.shifts, shift_hz, sigma_rel), stiffness: None }
    }

    /// One touch with the slope of its surface.
    fn tilted_touch(&self, random: &mut Stream) -> TiltedTouch {
        let direction = random.pick(&Direction::ALL);
        let point = TruthModel::point(self.sample, random);
        let angle_rad = self.angle_rad + TruthModel::slope_rad(random);
        let azimuth_rad = direction.azimuth_rad();
        let shift_hz =
            self.truth.measure_hz(&point, angle_rad, azimuth_rad, INDENTATION_MM, random);
        TiltedTouch { shift_hz, direction, young_mpa: point.young_mpa }
    }

    fn known_angle(&self, analysis: &Analysis, random: &mut Stream) -> Outcome {
        let TiltedTouch { shift_hz, direction, young_mpa: truth_mpa } = self.tilted_touch(random);
        let pose = Pose::leaning(direction, self.angle_rad).expect("the angle is acute");
        let sigma_hz = NUISANCES.shift_hz;
        let touch = PosedTouch {
            sample: self.sample,
            pose,
            depth: DEPTH,
            shift_hz,
            sigma_hz,
            reference_sigma_hz: 0.0,
            halfway: None,
            stage_sigma_mm: None,
        };
        let Ok(one) = analysis.compensation.of_touch(&touch) else { return Outcome::default() };
        let stiffness = StiffnessError {
            error_rel: one.young_mpa / truth_mpa - 1.0,
            is_covered: (one.young_mpa - truth_mpa).abs() <= HALF_95 * one.sigma_mpa,
        };
        let recognised_as =
            class(&analysis.stiffness, one.young_mpa, one.sigma_mpa / one.young_mpa);
        Outcome { recognised_as, stiffness: Some(stiffness) }
    }

    fn depths(&self, analysis: &Analysis, depths_mm: &[f64], random: &mut Stream) -> Outcome {
        let azimuth_rad = random.pick(&Direction::ALL).azimuth_rad();
        let point = TruthModel::point(self.sample, random);
        let touch = |&depth_mm: &f64| SiteTouch {
            shift_hz: self.truth.measure_hz(&point, self.angle_rad, azimuth_rad, depth_mm, random),
            sigmas: ShiftSigmas::of_resonance(NUISANCES.shift_hz),
            spin_rad: 0.0,
            depth: Depth::Indentation { along_probe_mm: depth_mm },
        };
        let touches: Vec<SiteTouch> = depths_mm.iter().map(touch).collect();
        let azimuth = AzimuthPrior::Known(azimuth_rad);
        let found = analysis.compensation.of_site(&touches, MAX_ANGLE_RAD, azimuth);
        analysis.outcome(&found, point.young_mpa)
    }

    fn spins(&self, analysis: &Analysis, random: &mut Stream) -> Outcome {
        let azimuth_rad = 4.0 * FRAC_PI_2 * random.uniform();
        let point = TruthModel::point(self.sample, random);
        let touches = [0.0, 1.0, 2.0, 3.0].map(|quarters| {
            let spin_rad = quarters * FRAC_PI_2;
            let at_rad = azimuth_rad - spin_rad;
            let shift_hz =
                self.truth.measure_hz(&point, self.angle_rad, at_rad, INDENTATION_MM, random);
            let sigmas = ShiftSigmas::of_resonance(NUISANCES.shift_hz);
            SiteTouch { shift_hz, sigmas, spin_rad, depth: DEPTH }
        });
        let azimuth = AzimuthPrior::Unknown;
        let found = analysis.compensation.of_site(&touches, MAX_ANGLE_RAD, azimuth);
        analysis.outcome(&found, point.young_mpa)
    }

    /// Each direction touches another point, with its own stiffness, slope and surface. The truth
    /// is the stiffness of the sample.
    fn directions(&self, analysis: &Analysis, random: &mut Stream) -> Outcome {
        let touches = Direction::ALL.map(|direction| {
            let point = TruthModel::point(self.sample, random);
            let angle_rad = self.angle_rad + TruthModel::slope_rad(random);
            let at_rad = direction.azimuth_rad();
            let shift_hz = self.truth.measure_hz(&point, angle_rad, at_rad, INDENTATION_MM, random);
            // A shift grows at most as fast as the stiffness.
            let sigmas = ShiftSigmas {
                sample_hz: NUISANCES.young_rel * shift_hz.abs(),
                ..ShiftSigmas::of_resonance(NUISANCES.shift_hz)
            };
            SiteTouch { shift_hz, sigmas, spin_rad: -at_rad, depth: DEPTH }
        });
        let azimuth = AzimuthPrior::Unknown;
        let found = analysis.across_points.of_site(&touches, MAX_ANGLE_RAD, azimuth);
        analysis.outcome(&found, SAMPLES_MPA[self.sample])
    }
}

impl Analysis {
    pub(super) fn new() -> Self {
        let described = Compensation {
            angle_sigma_rad: NUISANCES.angle_deg.to_radians(),
            ..Compensation::new(&SensorDescription::reference(), 0.0)
        };
        let compensation = Compensation {
            shared_depth_sigma_mm: NUISANCES.depth_mm,
            depth_sigma_mm: ENCODER_MM,
            ..described.clone()
        };
        let depth_sigma_mm = NUISANCES.depth_mm.hypot(ENCODER_MM);
        let across_points = Compensation { depth_sigma_mm, ..described };
        let class = |young: f64| Class { centre: young.ln(), spread: NUISANCES.young_rel };
        let stiffness =
            Classifier::with_classes(SAMPLES_MPA.map(class).to_vec()).expect("the samples differ");
        let shifts = shift_classes(&compensation.models);
        Self { compensation, across_points, shifts, stiffness }
    }

    fn outcome(&self, found: &Result<TiltInference, InverseError>, truth_mpa: f64) -> Outcome {
        let Ok(TiltInference { young_mpa: young, .. }) = found else { return Outcome::default() };
        let stiffness = StiffnessError {
            error_rel: young.value / truth_mpa - 1.0,
            is_covered: young.contains(truth_mpa),
        };
        let recognised_as = class(&self.stiffness, young.value, young.sigma / young.value);
        Outcome { recognised_as, stiffness: Some(stiffness) }
    }
}

/// Classes of shifts, calibrated at the paper's poses.
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
