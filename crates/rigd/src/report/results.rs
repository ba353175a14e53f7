//! What the touches of a run say together.

use rig_analysis::{
    cluster,
    no_load::{self, NoLoadMeasurement, NoLoadSummary},
    score::{self, Score},
    sensitivity::{self, SampleShift, Sensitivity},
    shift::{self, AngleMean, DirectionMean, TouchShift},
};
use rig_record::{Circuit, Direction, Phase, Sweep, SweepPurpose, SweepVerdict, Touch};

use super::{
    data::RunData,
    recognition::{Recognition, recognitions},
    stiffness::{NoStiffness, Stiffness},
    touches::{self, GridRow},
};

/// The directions, in the order in which the analysis counts them.
pub(super) const DIRECTIONS: [Direction; 3] = [Direction::Front, Direction::Back, Direction::Left];

/// The results of a run.
#[derive(Debug)]
pub(super) struct RunResults {
    /// The main touches as they were planned, by sample and angle.
    pub(super) grid: Vec<GridRow>,
    /// The main touches that were measured, by sample, angle and direction.
    pub(super) cells: Vec<DirectionMean>,
    /// The same, averaged over the directions.
    pub(super) means: Vec<AngleMean>,
    /// How the shift grows with stiffness.
    pub(super) sensitivity: Option<SensitivityAt>,
    /// The references.
    pub(super) references: Vec<NoLoadMeasurement>,
    /// What these have in common.
    pub(super) no_load: Option<NoLoadSummary>,
    /// The blind touches, sorted.
    pub(super) classification: Option<Classification>,
    /// The stiffness of the samples, with the angle compensated.
    pub(super) stiffness: Result<Stiffness, NoStiffness>,
    /// The blind touches, recognised by several methods.
    pub(super) recognitions: Vec<Recognition>,
    /// What the sweeps cost.
    pub(super) cost: SweepCost,
}

/// The sensitivity and where it was taken.
#[derive(Debug)]
pub(super) struct SensitivityAt {
    /// The contact angle, degrees.
    pub(super) angle_deg: f64,
    /// The sensitivity.
    pub(super) sensitivity: Sensitivity,
}

/// The blind touches, sorted into clusters without their labels.
#[derive(Debug)]
pub(super) struct Classification {
    /// The touches.
    pub(super) trials: Vec<Trial>,
    /// Mean shift of each cluster, Hz, ascending.
    pub(super) centres_hz: Vec<f64>,
    /// The agreement with the labels.
    pub(super) score: Score,
}

/// One blind touch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trial {
    /// Its number in the protocol.
    pub(super) number: u32,
    /// Its shift, Hz.
    pub(super) shift_hz: f64,
    /// Its standard deviation, Hz.
    pub(super) sigma_hz: f64,
    /// Which sample it was.
    pub(super) sample: usize,
    /// Into which cluster it fell.
    pub(super) cluster: usize,
}

/// What the sweeps cost on the rig's clock, beside what common practice would have.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct SweepCost {
    /// Sweeps that gave a resonance.
    pub(super) sweeps: u32,
    /// What they took, s.
    pub(super) taken_s: f64,
    /// What [`practice_s`] would have taken for the same resonances, s.
    pub(super) practice_s: f64,
}

impl RunResults {
    pub(super) fn of(data: &RunData) -> Self {
        let sample = |touch: &Touch| data.sample(&touch.touch.sample);
        let of_phase = |phase| data.touches.iter().filter(move |t| t.touch.phase == phase);
        let main: Vec<TouchShift> = of_phase(Phase::Main)
            .filter_map(|touch| Some(shift_of(touch, sample(touch)?)))
            .collect();
        let blind: Vec<(&Touch, usize)> =
            of_phase(Phase::Blind).filter_map(|touch| Some((touch, sample(touch)?))).collect();
        let cells = shift::by_direction(&main);
        let means = shift::by_angle(&cells);
        let references: Vec<NoLoadMeasurement> = data.sweeps.iter().filter_map(reference).collect();
        let classification = classify(data, &blind);
        let stiffness = Stiffness::of(data);
        Self {
            recognitions: recognitions(data, classification.as_ref(), stiffness.as_ref().ok()),
            stiffness,
            sensitivity: sensitivity_at_smallest_angle(data, &means),
            no_load: no_load::summarize(&references),
            classification,
            cost: SweepCost::of(&data.sweeps),
            grid: touches::grid(data),
            cells,
            means,
            references,
        }
    }

    /// The shift of a sample at an angle in a direction, where it was measured.
    pub(super) fn cell(
        &self,
        sample: usize,
        angle_deg: f64,
        direction: usize,
    ) -> Option<&DirectionMean> {
        let is_here = |cell: &&DirectionMean| {
            (cell.sample, cell.angle_deg, cell.direction) == (sample, angle_deg, direction)
        };
        self.cells.iter().find(is_here)
    }

    /// The mean of the directions of a sample at an angle, where one was measured.
    pub(super) fn mean(&self, sample: usize, angle_deg: f64) -> Option<&AngleMean> {
        self.means.iter().find(|mean| (mean.sample, mean.angle_deg) == (sample, angle_deg))
    }

    /// The samples that were to be touched in the main phase.
    pub(super) fn samples(&self) -> Vec<usize> {
        let mut samples: Vec<usize> = self.grid.iter().map(|row| row.sample).collect();
        samples.dedup();
        samples
    }

    /// The directions of the main touches that were planned.
    pub(super) fn directions(&self) -> Vec<usize> {
        let is_planned =
            |&direction: &usize| self.grid.iter().any(|row| row.directions[direction].planned > 0);
        (0..DIRECTIONS.len()).filter(is_planned).collect()
    }

    /// The contact angles of the main touches, ascending, degrees.
    pub(super) fn angles_deg(&self) -> Vec<f64> {
        let mut angles: Vec<f64> = self.cells.iter().map(|cell| cell.angle_deg).collect();
        angles.sort_by(f64::total_cmp);
        angles.dedup();
        angles
    }
}

fn shift_of(touch: &Touch, sample: usize) -> TouchShift {
    TouchShift {
        sample,
        direction: match touch.touch.pose.direction {
            Direction::Front => 0,
            Direction::Back => 1,
            Direction::Left => 2,
        },
        angle_deg: touch.touch.pose.angle_deg,
        shift_hz: touch.shift_hz,
        sigma_hz: touch.shift_sigma_hz,
    }
}

fn reference(sweep: &Sweep) -> Option<NoLoadMeasurement> {
    let SweepVerdict::Accepted { resonance_hz, sigma_hz, .. } = sweep.verdict else { return None };
    let first = sweep.readings.first()?;
    (sweep.purpose == SweepPurpose::NoLoad).then_some(NoLoadMeasurement {
        time_s: first.started_s,
        frequency_hz: resonance_hz,
        sigma_hz,
    })
}

/// The sensitivity from the samples of known stiffness, at the smallest angle, averaged over the
/// directions: nearest to the touch along the normal by which others define it.
fn sensitivity_at_smallest_angle(data: &RunData, means: &[AngleMean]) -> Option<SensitivityAt> {
    let angle_deg = means.iter().map(|mean| mean.angle_deg).min_by(f64::total_cmp)?;
    let point = |mean: &AngleMean| {
        Some(SampleShift {
            stiffness_mpa: data.samples().get(mean.sample)?.stiffness_mpa?,
            shift_hz: mean.mean.shift_hz,
            sigma_hz: mean.mean.standard_error_hz(),
        })
    };
    let points: Vec<SampleShift> =
        means.iter().filter(|mean| mean.angle_deg == angle_deg).filter_map(point).collect();
    let sensitivity = sensitivity::sensitivity(&points).ok()?;
    Some(SensitivityAt { angle_deg, sensitivity })
}

/// Sorts the blind touches by the optimal k-means; none when they cannot fill the classes.
fn classify(data: &RunData, blind: &[(&Touch, usize)]) -> Option<Classification> {
    let classes = usize::try_from(data.started.as_ref()?.classes?).ok()?;
    let shifts: Vec<f64> = blind.iter().map(|(touch, _)| touch.shift_hz).collect();
    let clustering = cluster::optimal(&shifts, classes).ok()?;
    let labels: Vec<usize> = blind.iter().map(|&(_, sample)| sample).collect();
    let score = score::score(&labels, &clustering.clusters, data.samples().len(), classes);
    let trial = |(&(touch, sample), &cluster): (&(&Touch, usize), &usize)| Trial {
        number: touch.touch.repeat,
        shift_hz: touch.shift_hz,
        sigma_hz: touch.shift_sigma_hz,
        sample,
        cluster,
    };
    let trials = blind.iter().zip(&clustering.clusters).map(trial).collect();
    Some(Classification { trials, centres_hz: clustering.centres, score })
}

impl Classification {
    /// The sample for which the cluster of this blind touch stands.
    pub(super) fn class_of(&self, number: u32) -> Option<usize> {
        let trial = self.trials.iter().find(|trial| trial.number == number)?;
        self.score.label_of[trial.cluster]
    }

    /// Whether a touch is in the cluster that stands for its sample.
    pub(super) fn is_correct(&self, trial: &Trial) -> bool {
        self.score.label_of[trial.cluster] == Some(trial.sample)
    }
}

impl SweepCost {
    fn of(sweeps: &[Sweep]) -> Self {
        let mut cost = Self::default();
        for sweep in sweeps {
            let SweepVerdict::Accepted { resonance_hz, circuit: Some(circuit), .. } = sweep.verdict
            else {
                continue;
            };
            let (Some(first), Some(last)) = (sweep.readings.first(), sweep.readings.last()) else {
                continue;
            };
            cost.sweeps += 1;
            cost.taken_s += last.started_s + last.settle_s + last.integration_s - first.started_s;
            cost.practice_s += practice_s(resonance_hz, &circuit);
        }
        cost
    }
}

/// What a careful sweep without a plan takes, s: 201 points, at each of them five time constants of
/// settling and ten cycles of integration.
fn practice_s(resonance_hz: f64, circuit: &Circuit) -> f64 {
    let time_constant_s = circuit.quality_factor / (std::f64::consts::PI * resonance_hz);
    201.0 * (5.0 * time_constant_s + 10.0 / resonance_hz)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn practice_takes_as_long_as_a_careful_sweep_by_hand() {
        #[track_caller]
        fn check(quality_factor: f64, expected_s: f64) {
            let circuit = Circuit {
                quality_factor,
                static_capacitance_f: 27e-9,
                capacitance_ratio: 0.05,
                loss_tangent: 0.02,
                loss_tangent_sigma: None,
            };
            let found_s = practice_s(140.0, &circuit);
            assert!((found_s - expected_s).abs() < 0.05, "{found_s} s, expected {expected_s} s");
        }
        // 201 · (5 Q/π + 10)/140, by hand.
        check(10.0, 37.2);
        check(30.0, 82.9);
        check(100.0, 242.9);
    }
}
