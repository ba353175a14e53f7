//! The results of a run, built once from its records; every output is a view of them.

pub(crate) mod aim;
pub(crate) mod budget;
pub(crate) mod classification;
pub(crate) mod cost;
pub(crate) mod grid;
pub(crate) mod recognition;
pub(crate) mod status;
pub(crate) mod stiffness;
pub(crate) mod touches;

use std::sync::Arc;

use rig_analysis::{
    no_load::{self, NoLoadMeasurement, NoLoadSummary},
    sensitivity::{self, SampleShift, Sensitivity},
    shift::{self, AngleMean, DirectionMean, TouchShift},
};
use rig_record::{
    Direction, Phase, Run, RunStarted, StoredRecord, Sweep, SweepOutcome, SweepPurpose, Touch,
    UnreadableRecord,
};

use crate::data::{DIRECTIONS, RunData};
use aim::AimSummary;
use classification::Classification;
use cost::SweepCost;
use grid::GridRow;
use recognition::{Recognition, recognitions};
use status::TouchStatus;
use stiffness::{NoStiffness, Stiffness};
use touches::TouchRow;

/// The results of a run.
#[derive(Debug)]
pub struct RunResults {
    pub(crate) run: Run,
    pub(crate) data: RunData,
    /// The planned main touches, by sample and angle.
    pub(crate) grid: Vec<GridRow>,
    /// The measured main touches, by sample, angle and direction.
    pub(crate) direction_means: Vec<DirectionMean>,
    /// The shifts averaged over the directions.
    pub(crate) angle_means: Vec<AngleMean>,
    pub(crate) sensitivity: Option<SensitivityAt>,
    /// The no-load sweeps.
    pub(crate) references: Vec<NoLoadMeasurement>,
    pub(crate) no_load: Option<NoLoadSummary>,
    /// The blind touches, sorted by k-means.
    pub(crate) classification: Option<Classification>,
    /// The stiffness of the samples, with the angle compensated.
    pub(crate) stiffness: Result<Arc<Stiffness>, NoStiffness>,
    /// The blind touches, recognised by several methods.
    pub(crate) recognitions: Vec<Recognition>,
    pub(crate) cost: SweepCost,
    /// What became of the aim of the protocol, if it has one.
    pub(crate) aim: Option<AimSummary>,
    /// A row for every planned touch, in the order of the plan.
    pub(crate) touches: Vec<TouchRow>,
}

/// The growth of the shift with stiffness at one angle.
#[derive(Debug)]
pub(crate) struct SensitivityAt {
    /// Contact angle, degrees.
    pub(crate) angle_deg: f64,
    pub(crate) sensitivity: Sensitivity,
}

impl RunResults {
    /// Number of planned blind touches without a shift, which could not be classified.
    pub(crate) fn blind_without_shift(&self) -> usize {
        let is_blind = |row: &&TouchRow| row.phase == Phase::Blind.name();
        let planned = self.touches.iter().filter(is_blind).count();
        let trials = self.classification.as_ref().map_or(0, |found| found.trials.len());
        planned.saturating_sub(trials)
    }

    /// The results of the `records` of a run, with those of its amendments behind them.
    ///
    /// # Errors
    /// [`UnreadableRecord`] when a record cannot be understood.
    pub fn new(run: &Run, records: &[StoredRecord]) -> Result<Self, UnreadableRecord> {
        Self::after(run, records, None)
    }

    /// Computes the results of a run that goes on. The stiffness, whose model takes long to learn, is that of earlier results of the run if
    /// no touch has come since.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn after(
        run: &Run,
        records: &[StoredRecord],
        earlier: Option<&Self>,
    ) -> Result<Self, UnreadableRecord> {
        let data = RunData::read(records)?;
        let shifts_of = |phase| data.touches.iter().filter(move |t| t.touch.phase == phase);
        let main = shifts_of(Phase::Main);
        let main: Vec<TouchShift> = main.filter_map(|touch| shift_of(touch, &data)).collect();
        let direction_means = shift::by_direction(&main);
        let angle_means = shift::by_angle(&main, &direction_means);
        let shared_hz2 = |angle_deg: f64, samples: [usize; 2]| {
            shift::between_samples_hz2(&main, &direction_means, angle_deg, samples)
        };
        let sensitivity = sensitivity_at_smallest_angle(&data, &angle_means, shared_hz2);
        let references: Vec<NoLoadMeasurement> =
            data.own_sweeps().iter().zip(&data.clock_zeros_s).filter_map(reference).collect();
        let classification = Classification::of(&data);
        let is_same = |earlier: &&Self| {
            earlier.data.touches == data.touches
                && earlier.data.started == data.started
                && earlier.data.rests_alike(&data)
        };
        let kept = earlier.filter(is_same).and_then(|earlier| earlier.stiffness.as_ref().ok());
        let stiffness = match kept {
            Some(kept) => Ok(Arc::clone(kept)),
            None => Stiffness::of(&data).map(Arc::new),
        };
        let known_stiffness = stiffness.as_deref().ok();
        let touches = touches::rows(run, &data, known_stiffness, classification.as_ref());
        Ok(Self {
            aim: AimSummary::of(&data, &touches),
            run: run.clone(),
            grid: grid::grid(&data),
            sensitivity,
            no_load: no_load::summarize(&references),
            recognitions: recognitions(&data, classification.as_ref(), known_stiffness),
            cost: SweepCost::of(&data.sweeps),
            touches,
            direction_means,
            angle_means,
            references,
            classification,
            stiffness,
            data,
        })
    }

    /// The run in the list of runs.
    pub fn run(&self) -> &Run {
        &self.run
    }

    /// The first record of the run; `None` if the journal is damaged there.
    pub fn started(&self) -> Option<&RunStarted> {
        self.data.started.as_ref()
    }

    /// Whether the model behind the stiffness holds: `holds`, `strained` or `rejected`; `None` when the
    /// touches cannot say.
    pub fn model_verdict(&self) -> Option<&'static str> {
        Some(self.stiffness.as_ref().ok()?.verdict()?.name())
    }

    /// The number of measured touches and the refused ones, as a sentence; `None` when every
    /// planned touch was measured, and none is marked.
    pub fn shortfall(&self) -> Option<String> {
        let is_whole = self.touches.iter().all(TouchRow::is_measured_without_doubt);
        (!is_whole).then(|| touches::sentence(&self.touches))
    }

    /// What to know of the values if the free resonance has jumped after touches.
    pub(crate) fn jump_note(&self) -> Option<String> {
        let jumped = self.touches.iter().filter(|row| row.is_reference_unsteady()).count();
        let measured = self.touches.iter().filter(|row| row.status == TouchStatus::Measured);
        let of = format!(
            "it jumped before the next reference of {jumped} of {} touches; their shifts may be wrong by it",
            measured.count()
        );
        (jumped > 0).then_some(of)
    }

    /// What the map of the screw does to the depths, if the run cites one.
    pub(crate) fn screw_note(&self) -> Option<String> {
        Some(self.stiffness.as_ref().ok()?.depths.as_ref()?.sentence())
    }

    /// What to know of the values if touches were not checked for slip.
    pub(crate) fn slip_note(&self) -> Option<String> {
        let measured = self.touches.iter().filter(|row| row.status == TouchStatus::Measured);
        let unchecked = self.touches.iter().filter(|row| row.is_slip_unchecked()).count();
        let of = format!(
            "none in {unchecked} of {} touches; steps lost there would not show",
            measured.count()
        );
        (unchecked > 0).then_some(of)
    }

    /// Every planned touch with its result, in the order of the plan.
    pub fn touches(&self) -> &[TouchRow] {
        &self.touches
    }

    /// The mean shift of a sample at an angle in a direction; `None` if it was not measured.
    pub(crate) fn direction_mean(
        &self,
        sample: usize,
        angle_deg: f64,
        direction: usize,
    ) -> Option<&DirectionMean> {
        let is_here = |mean: &&DirectionMean| {
            (mean.sample, mean.angle_deg, mean.direction) == (sample, angle_deg, direction)
        };
        self.direction_means.iter().find(is_here)
    }

    /// The mean of the directions of a sample at an angle; `None` if none was measured.
    pub(crate) fn angle_mean(&self, sample: usize, angle_deg: f64) -> Option<&AngleMean> {
        self.angle_means.iter().find(|mean| (mean.sample, mean.angle_deg) == (sample, angle_deg))
    }

    /// The samples of the planned main touches.
    pub(crate) fn samples(&self) -> Vec<usize> {
        let mut samples: Vec<usize> = self.grid.iter().map(|row| row.sample).collect();
        samples.dedup();
        samples
    }

    /// The directions of the planned main touches.
    pub(crate) fn directions(&self) -> Vec<usize> {
        let is_planned =
            |&direction: &usize| self.grid.iter().any(|row| row.directions[direction].planned > 0);
        (0..DIRECTIONS.len()).filter(is_planned).collect()
    }

    /// The contact angles of the measured main touches, ascending, degrees.
    pub(crate) fn angles_deg(&self) -> Vec<f64> {
        let mut angles: Vec<f64> = self.direction_means.iter().map(|mean| mean.angle_deg).collect();
        angles.sort_by(f64::total_cmp);
        angles.dedup();
        angles
    }
}

fn shift_of(touch: &Touch, data: &RunData) -> Option<TouchShift> {
    Some(TouchShift {
        sample: data.sample(&touch.touch.sample)?,
        direction: match touch.touch.pose.direction {
            Direction::Front => 0,
            Direction::Back => 1,
            Direction::Left => 2,
        },
        angle_deg: touch.touch.pose.angle_deg,
        shift_hz: touch.shift_hz,
        sigma_hz: touch.shift_sigma_hz,
        reference: data.between.reference(touch),
    })
}

fn reference((sweep, clock_zero_s): (&Sweep, &f64)) -> Option<NoLoadMeasurement> {
    let SweepOutcome::Accepted { resonance_hz, sigma_hz, .. } = sweep.outcome else { return None };
    let first = sweep.readings.first()?;
    (sweep.purpose == SweepPurpose::NoLoad).then_some(NoLoadMeasurement {
        time_s: clock_zero_s + first.started_s,
        frequency_hz: resonance_hz,
        sigma_hz,
    })
}

/// The sensitivity from the samples of known stiffness, averaged over the directions. The smallest
/// angle is nearest to the touch along the normal, by which others define a sensitivity.
fn sensitivity_at_smallest_angle(
    data: &RunData,
    means: &[AngleMean],
    shared_hz2: impl Fn(f64, [usize; 2]) -> f64,
) -> Option<SensitivityAt> {
    let angle_deg = means.iter().map(|mean| mean.angle_deg).min_by(f64::total_cmp)?;
    let point = |mean: &AngleMean| {
        let shift = SampleShift {
            stiffness_mpa: data.samples().get(mean.sample)?.stiffness_mpa?,
            shift_hz: mean.mean.shift_hz,
            sigma_hz: mean.mean.standard_error_hz(),
        };
        Some((mean.sample, shift))
    };
    let here = means.iter().filter(|mean| mean.angle_deg == angle_deg);
    let (samples, points): (Vec<usize>, Vec<SampleShift>) = here.filter_map(point).unzip();
    let shared_hz2 = |a: usize, b: usize| shared_hz2(angle_deg, [samples[a], samples[b]]);
    let sensitivity = sensitivity::sensitivity(&points, shared_hz2).ok()?;
    Some(SensitivityAt { angle_deg, sensitivity })
}
