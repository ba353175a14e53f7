//! The expected error of the touches of a plan, as a function of the settings.

use rig_model::Geometry;

use super::{
    AimSettings, ErrorPart, ExpectedTouch, NoSensitivity, Percents, Sensitivity, TouchModel,
};
use crate::{Action, Plan, expected_drift::ExpectedDrift, summary::Course};

/// A sweep ends when its standard deviation is expected to be this part of the target.
const REACHED: f64 = 0.97;

/// A touch of which nothing is expected.
#[derive(Debug)]
pub(super) struct Unexpected {
    /// Index of its step.
    pub(super) step: usize,
    pub(super) why: NoSensitivity,
}

/// How the stiffness of each touch of a plan depends on what is measured, in order.
pub(super) fn sensitivities(
    plan: &Plan,
    geometry: &Geometry,
    model: &dyn TouchModel,
    assumed_mpa: Option<f64>,
) -> Result<Vec<Sensitivity>, Unexpected> {
    let of = |(step, action): (usize, &Action)| {
        let Action::Touch(touch) = action else { return None };
        let expected = ExpectedTouch {
            sample: &plan.samples[touch.sample],
            assumed_mpa,
            pose: touch.pose,
            surface_mm: geometry.surface_at(touch.pose.direction, touch.pose.angle).value(),
            indentation_mm: plan.touch.indentation_mm,
        };
        Some(model.sensitivity(&expected).map_err(|why| Unexpected { step, why }))
    };
    plan.steps.iter().map(|step| &step.action).enumerate().filter_map(of).collect()
}

/// The errors of the touches of a plan, as functions of the settings.
#[derive(Debug)]
pub(super) struct Errors {
    /// The mean of all touches.
    mean: Terms,
    /// The touches one of which is the worst, whatever the settings are, each with the index of its step.
    extremes: Vec<(usize, Terms)>,
}

/// The relative variance of a stiffness: a sum of terms, each of which is a factor times the square of a setting, or
/// constant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Terms {
    /// For the variance of the shift, 1/Hz².
    per_hz2: f64,
    /// Due to the drift since the reference.
    of_drift: f64,
    /// For the variance of the surface, 1/mm².
    per_mm2: f64,
    of_depth: f64,
    of_angle: f64,
}

/// What is expected of settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Expected {
    /// In the order of [`ErrorPart::ALL`].
    pub(super) parts: [Percents; ErrorPart::ALL.len()],
    pub(super) together: Percents,
    /// The step of the touch whose standard deviation is largest.
    pub(super) worst_step: usize,
}

impl Errors {
    /// The touches of a plan with its expected course and their sensitivities in order. A reference counts as the run
    /// states it at the time: the next one, which narrows it, is not in it.
    pub(super) fn of(plan: &Plan, course: &Course, sensitivities: &[Sensitivity]) -> Self {
        let mut drift = ExpectedDrift::default();
        let mut sensitivities = sensitivities.iter();
        let mut touches: Vec<(usize, Terms)> = Vec::new();
        for (step, planned) in
            plan.steps.iter().enumerate().filter(|(step, _)| course.is_made[*step])
        {
            drift.passed(course.durations_s[step]);
            match planned.action {
                Action::NoLoad(_) => drift.measured(),
                Action::Prompt(_) => {}
                Action::Touch(_) => {
                    let drift_hz2 = drift.variance_hz2(0.0);
                    touches
                        .extend(sensitivities.next().map(|one| (step, Terms::of(one, drift_hz2))));
                }
            }
        }
        let count = touches.len().max(1) as f64;
        let mean = touches.iter().fold(Terms::default(), |sum, (_, terms)| {
            sum.with(terms, |sum, own| sum + own / count)
        });
        let mut extremes: Vec<(usize, Terms)> = Vec::new();
        for touch in touches {
            if !extremes.iter().any(|(_, other)| other.is_never_below(&touch.1)) {
                extremes.retain(|(_, other)| !touch.1.is_never_below(other));
                extremes.push(touch);
            }
        }
        Self { mean, extremes }
    }

    /// What the settings make of the touches.
    pub(super) fn at(&self, settings: &AimSettings) -> Expected {
        let all = self.mean.variances(settings);
        let mut worst = (0.0, 0, [0.0; ErrorPart::ALL.len()]);
        for (step, terms) in &self.extremes {
            let variances = terms.variances(settings);
            let variance: f64 = variances.iter().sum();
            worst = if variance > worst.0 { (variance, *step, variances) } else { worst };
        }
        let (worst, worst_step, of_worst) = worst;
        let percents = |all: f64, worst: f64| {
            let percent = |variance: f64| 100.0 * variance.sqrt();
            Percents { all: percent(all), worst: percent(worst) }
        };
        let parts =
            ErrorPart::ALL.map(|part| percents(all[part as usize], of_worst[part as usize]));
        Expected { parts, together: percents(all.iter().sum(), worst), worst_step }
    }
}

impl Terms {
    /// `drift_hz2` is the variance of the drift since the reference, Hz².
    fn of(sensitivity: &Sensitivity, drift_hz2: f64) -> Self {
        let Sensitivity { per_hz, per_mm, of_depth, of_angle } = *sensitivity;
        Self {
            per_hz2: per_hz * per_hz,
            of_drift: per_hz * per_hz * drift_hz2,
            per_mm2: per_mm * per_mm,
            of_depth: of_depth * of_depth,
            of_angle: of_angle * of_angle,
        }
    }

    fn with(self, other: &Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            per_hz2: of(self.per_hz2, other.per_hz2),
            of_drift: of(self.of_drift, other.of_drift),
            per_mm2: of(self.per_mm2, other.per_mm2),
            of_depth: of(self.of_depth, other.of_depth),
            of_angle: of(self.of_angle, other.of_angle),
        }
    }

    /// Whether the variance is at least that of another touch with any settings.
    fn is_never_below(&self, other: &Self) -> bool {
        let fixed = |terms: &Self| terms.of_drift + terms.of_depth + terms.of_angle;
        self.per_hz2 >= other.per_hz2
            && self.per_mm2 >= other.per_mm2
            && fixed(self) >= fixed(other)
    }

    /// Relative variances by cause, in the order of [`ErrorPart::ALL`].
    fn variances(&self, settings: &AimSettings) -> [f64; ErrorPart::ALL.len()] {
        // The bracket of the surface is one fine step wide.
        let surface_mm2 = settings.fine_step_mm.powi(2) / 12.0;
        [
            self.per_hz2 * (REACHED * settings.contact_sigma_hz).powi(2),
            self.per_hz2 * (REACHED * settings.no_load_sigma_hz).powi(2) + self.of_drift,
            self.per_mm2 * surface_mm2,
            self.of_depth,
            self.of_angle,
        ]
    }
}

impl Expected {
    /// What depth and angle make of the worst touch, %. No setting changes it.
    pub(super) fn fixed_percent(&self) -> f64 {
        let worst = |part: ErrorPart| self.parts[part as usize].worst;
        worst(ErrorPart::Depth).hypot(worst(ErrorPart::Angle))
    }
}
