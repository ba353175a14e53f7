//! The stiffness of the touches and samples of a run at known angles, from its shifts: the model is
//! learnt and judged, the stiffness is calibrated by the known samples.

mod calibration;

use rig_contact::inverse::InverseError;

pub use calibration::{ComparedAt, Reading, RunCalibration, ScaleSource};

use crate::{
    budget::{Budget, Part},
    model::{MainTouches, ModelSource, RunModel, sharing},
    stiffness::{Compensation, PosedTouch, SampleStiffness, Young},
};

/// The touches of a run, with what is known beforehand.
#[derive(Debug, Clone, Copy)]
pub struct RunTouches<'a> {
    /// Touches of the main phase.
    pub main: &'a [PosedTouch],
    /// Touches of the blind phase. Their samples take no part in any result.
    pub blind: &'a [PosedTouch],
    /// Known Young's modulus of each sample, MPa.
    pub known_mpa: &'a [Option<f64>],
    /// Standard deviation of the stiffness from one point of a sample to the next, relative.
    pub sample_rel: f64,
    /// Correlation of the depths of the main touches, where the error of the screw was measured.
    pub depth_correlation: Option<&'a [Vec<f64>]>,
    /// Covariance of the shifts of two touches by their references, Hz², of the main touches and then the blind ones;
    /// `None` if no touches share one.
    pub reference_hz2: Option<&'a [Vec<f64>]>,
    /// Mean free resonance measured, over that of the sensor described.
    pub resonance_ratio: f64,
    /// Relative standard deviation of the common factor, without a known sample.
    pub scale_rel: f64,
}

/// The stiffness of a touch or a site, calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunYoung {
    /// The stiffness with the uncertainty of the touch alone.
    pub own: Young,
    /// The whole uncertainty by cause, those of calibration and model included.
    pub budget: Budget,
}

impl RunYoung {
    /// The stiffness with its whole uncertainty.
    pub fn whole(&self) -> Young {
        let Young { mpa, .. } = self.own;
        Young { mpa, sigma_mpa: self.budget.total() * mpa }
    }
}

/// The calibrated stiffness of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunSample {
    /// Index of the sample.
    pub sample: usize,
    /// Young's modulus, MPa.
    pub young_mpa: f64,
    /// Its standard deviation, those of calibration and model included, MPa.
    pub sigma_mpa: f64,
    /// The parts of that standard deviation by cause.
    pub budget: Budget,
    /// Standard deviation of the touches about it, MPa, when there are several.
    pub spread_mpa: Option<f64>,
    /// Known Young's modulus, MPa.
    pub known_mpa: Option<f64>,
    /// Whether its touches alone give the factor of the run. Its stiffness is then the known one again, its
    /// standard deviation is that of nothing measured, and neither is to be stated.
    pub sets_scale: bool,
    /// Number of touches or sites with a stiffness.
    pub touches: usize,
}

/// The stiffness of a run.
#[derive(Debug, Clone)]
pub struct RunStiffness {
    /// The correction of the description by known samples.
    pub calibration: RunCalibration,
    /// Each sample with a stiffness, in order.
    pub samples: Vec<RunSample>,
    /// Each main touch.
    pub main: Vec<Result<RunYoung, InverseError>>,
    /// Each blind touch.
    pub blind: Vec<Result<RunYoung, InverseError>>,
}

/// What the relative errors of main touches or sites share by their references.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SharedReferences {
    /// The covariance of two different main ones, with zeros on the diagonal; empty if nothing is shared.
    pub main: Vec<Vec<f64>>,
    /// The covariance of each blind one with the main ones; empty if nothing is shared.
    pub blind: Vec<Vec<f64>>,
}

impl SharedReferences {
    /// By the relative change of each main and each blind one for 1 Hz of its reference, and the covariance of the
    /// references of two of them, the blind ones behind the main ones, Hz².
    pub fn of(main: &[f64], blind: &[f64], hz2: impl Fn(usize, usize) -> f64) -> Self {
        let all: Vec<f64> = main.iter().chain(blind).copied().collect();
        let mut rows = sharing(&all, hz2);
        for row in &mut rows {
            row.truncate(main.len());
        }
        let blind = rows.split_off(main.len());
        Self { main: rows, blind }
    }

    /// The covariance of two different main ones.
    pub fn between(&self, i: usize, j: usize) -> f64 {
        self.main.get(i).map_or(0.0, |row| row[j])
    }

    /// That of touches at known angles.
    fn of_touches(touches: &RunTouches<'_>, main: &[Reading], blind: &[Reading]) -> Self {
        let Some(hz2) = touches.reference_hz2 else { return Self::default() };
        let per_hz = |(reading, touch): (&Reading, &PosedTouch)| {
            let of = |part| reading.found.as_ref().map_or(0.0, |found| found.budget.of(part));
            of(Part::Sweep).hypot(of(Part::Reference)) / touch.sigma_hz
        };
        let main: Vec<f64> = main.iter().zip(touches.main).map(per_hz).collect();
        let blind: Vec<f64> = blind.iter().zip(touches.blind).map(per_hz).collect();
        Self::of(&main, &blind, |i, j| hz2[i][j])
    }
}

/// The stiffness of a run at known angles, with its model.
pub fn at_known_angles(
    described: &Compensation,
    touches: &RunTouches<'_>,
    source: ModelSource,
) -> (RunStiffness, RunModel) {
    let RunTouches { main, blind, known_mpa, sample_rel, depth_correlation, reference_hz2, .. } =
        *touches;
    let main_touches =
        MainTouches { touches: main, known_mpa, sample_rel, depth_correlation, reference_hz2 };
    let model = RunModel::of(described, &main_touches, source);
    let reading = |touch: &PosedTouch| {
        let found = model.of_touch(touch);
        Reading { sample: touch.sample, found }
    };
    let main_readings: Vec<Reading> = main.iter().map(reading).collect();
    let blind_readings: Vec<Reading> = blind.iter().map(reading).collect();
    // At the smallest angle, an error of the angle changes the stiffness least.
    let angle = |touch: &PosedTouch| touch.pose.angle_rad();
    let least = main.iter().map(angle).min_by(f64::total_cmp);
    let at = ComparedAt {
        angle_deg: least.map(f64::to_degrees),
        is_there: main.iter().map(|touch| Some(angle(touch)) == least).collect(),
    };
    let shared = SharedReferences::of_touches(touches, &main_readings, &blind_readings);
    (calibrated(touches, [&main_readings, &blind_readings], &shared, &at, &model), model)
}

/// Calibrates the stiffness of main and blind touches, or of sites.
pub fn calibrated(
    touches: &RunTouches<'_>,
    [main, blind]: [&[Reading]; 2],
    shared: &SharedReferences,
    at: &ComparedAt,
    model: &RunModel,
) -> RunStiffness {
    let calibration = RunCalibration::of(main, shared, at, touches, model);
    let blind_touch = |(index, reading)| {
        calibration.blind_touch(reading, shared.blind.get(index).map_or(&[], Vec::as_slice))
    };
    let blind = blind.iter().enumerate().map(blind_touch).collect();
    let main_touch = |(index, reading)| calibration.main_touch(reading, index);
    let main_touches = main.iter().enumerate().map(main_touch).collect();
    let sample = |(sample, known_mpa): (usize, &Option<f64>)| {
        let of_sample = || main.iter().enumerate().filter(|(_, one)| one.sample == sample);
        let found: Vec<Young> =
            of_sample().filter_map(|(_, one)| Some(one.found.as_ref().ok()?.young)).collect();
        let mean = SampleStiffness::mean(sample, &found, of_sample().count() - found.len())?;
        Some(calibration.sample(&mean, of_sample(), *known_mpa))
    };
    let samples = touches.known_mpa.iter().enumerate().filter_map(sample).collect();
    RunStiffness { samples, main: main_touches, blind, calibration }
}

#[cfg(test)]
mod tests;
