//! The results for programs.

use rig_analysis::{
    model::{Evidence, Pattern, RunModel, Term},
    run::{RunCalibration, ScaleSource},
};
use rig_record::CitedCalibration;
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    data::{DIRECTIONS, RunData},
    results::{
        RunResults, aim::AimSummary, budget::StiffnessBudget, recognition::Recognition,
        status::Tally, stiffness::Stiffness, touches::TouchRow,
    },
};

/// The results of a run. The fields are an interface: scripts read them.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct RunSummary {
    /// Id of the run.
    pub run_id: String,
    /// Whether no real device took part.
    pub is_simulated: bool,
    /// `running`, or the ending.
    pub status: &'static str,
    /// Whether it has ended for good; otherwise it can be resumed.
    pub is_sealed: bool,
    /// Touches that gave a shift; the same as `touches_measured`.
    pub touches: usize,
    /// Touches of the protocol.
    pub touches_planned: usize,
    /// Touches that gave a shift.
    pub touches_measured: usize,
    /// Touches that were made and gave none.
    pub touches_refused: usize,
    /// Touches that a person left out.
    pub touches_skipped: usize,
    /// Touches that were not made to their end.
    pub touches_not_reached: usize,
    /// Prompts that were answered.
    pub prompts: u32,
    /// From beginning to end on the rig's clock, s, without the time from an interruption to the resumption.
    pub rig_seconds: f64,
    /// The duration that was expected at the beginning, least and most, s on the rig's clock; `None`
    /// for a run that was made without an estimate.
    pub expected_seconds: Option<[f64; 2]>,
    /// What the protocol wants of its touches, and what became of it; `None` if it states every setting.
    pub aim: Option<AimSummary>,
    /// From beginning to end by the wall clock, s; `None` during the run.
    pub wall_seconds: Option<f64>,
    /// The last daily check of the bench before the run; `None` if there was none.
    pub daily_check: Option<DailyCheckSummary>,
    /// Mean resonance with the probe clear, Hz.
    pub no_load_hz: Option<f64>,
    /// The shifts of the main touches.
    pub shifts: Vec<ShiftSummary>,
    /// Shift against known stiffness: the chord from the softest to the stiffest sample at the
    /// smallest angle, mean of the directions, Hz/MPa.
    pub sensitivity_hz_per_mpa: Option<f64>,
    /// The blind touches by k-means on their shifts.
    pub classification: Option<ClassificationSummary>,
    /// The stiffness of the samples from the main touches, with the angle compensated.
    pub stiffness: Vec<StiffnessSummary>,
    /// The common factor of all stiffnesses; `None` without a stiffness.
    pub calibration: Option<CalibrationSummary>,
    /// The model behind the stiffness and its judgement; `None` when the touches leave no degree of freedom.
    pub model: Option<ModelSummary>,
    /// The blind touches by every method, that of `classification` first.
    pub recognition: Vec<RecognitionSummary>,
    /// Every planned touch with its result.
    pub touch_results: Vec<TouchRow>,
}

/// The last daily check of the bench before a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct DailyCheckSummary {
    /// `accepted`, `look` or `not to be trusted`.
    pub verdict: String,
    /// When it was made, UTC.
    pub made: String,
    /// Name of the person.
    pub person: String,
    /// Name of its file in `calibrations` of the data directory.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
}

/// The shift of one sample at one pose.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ShiftSummary {
    /// Name of the sample.
    pub sample: String,
    /// The direction: `front`, `back` or `left`.
    pub direction: &'static str,
    /// The contact angle, degrees.
    pub angle_deg: f64,
    /// The shift, Hz; the mean of the repeats.
    pub shift_hz: f64,
    /// Its standard deviation from the fits and the references, of which its touches may share some, Hz. Other rows may share
    /// them too.
    pub sigma_hz: f64,
}

/// The recognition of the blind touches by k-means on their shifts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct ClassificationSummary {
    /// Number of classified blind touches.
    pub trials: u32,
    /// Blind touches in the cluster of their sample.
    pub correct: u32,
    /// `correct` over `trials`.
    pub rate: f64,
}

/// The stiffness of a sample.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct StiffnessSummary {
    /// Name of the sample.
    pub sample: String,
    /// Young's modulus, MPa; none when no touch gave one.
    pub stiffness_mpa: Option<f64>,
    /// Its standard deviation, those of calibration and model included, MPa; none if the sample sets the scale.
    pub sigma_mpa: Option<f64>,
    /// The parts of its standard deviation by cause; none if the sample sets the scale.
    pub budget: Option<StiffnessBudget>,
    /// Whether its touches alone give the factor of the calibration: the stiffness is then the known one again, and no
    /// measurement of the sample.
    pub sets_scale: bool,
    /// Known Young's modulus, MPa.
    pub known_mpa: Option<f64>,
    /// Number of touches with a stiffness; of sites, when the angle is unknown.
    pub used: usize,
    /// Number of planned touches or sites.
    pub planned: usize,
}

/// The common factor of all stiffnesses of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct CalibrationSummary {
    /// Every stiffness was divided by this: what the samples of known stiffness ask for, or 1 without any.
    pub factor: f64,
    /// Its relative standard deviation.
    pub sigma_rel: f64,
    /// Number of samples of known stiffness that give the factor; 0 if the description gives it.
    pub samples: usize,
    /// The contact angle of the compared touches, degrees; `None` if they have all angles, or none was compared.
    pub angle_deg: Option<f64>,
    /// Relative standard deviation of the factor by the description of the sensor, which takes it to be 1.
    pub described_rel: f64,
    /// Whether the factor differs from 1 by more than both standard deviations make by chance in one of a hundred runs.
    pub is_beyond_description: bool,
    /// Mean free resonance measured, over that of the sensor described. Shifts were divided by it.
    pub resonance_ratio: f64,
}

impl StiffnessSummary {
    fn of(stiffness: &Stiffness, data: &RunData, sample: usize) -> Self {
        let (found, basis) = (stiffness.of_sample(sample), stiffness.basis(data, sample));
        let measured = found.filter(|found| !found.sets_scale);
        Self {
            sample: data.samples()[sample].name.clone(),
            stiffness_mpa: found.map(|found| found.young_mpa),
            sigma_mpa: measured.map(|found| found.sigma_mpa),
            budget: measured.map(|found| StiffnessBudget::of(&found.budget, found.young_mpa)),
            sets_scale: found.is_some_and(|found| found.sets_scale),
            known_mpa: data.samples()[sample].stiffness_mpa,
            used: basis.used,
            planned: basis.planned,
        }
    }
}

impl CalibrationSummary {
    fn of(calibration: &RunCalibration) -> Self {
        let (samples, angle_deg) = match calibration.source {
            ScaleSource::Known { samples, angle_deg } => (samples, angle_deg),
            ScaleSource::Described => (0, None),
        };
        Self {
            factor: calibration.factor,
            sigma_rel: calibration.sigma_rel,
            samples,
            angle_deg,
            described_rel: calibration.described_rel,
            is_beyond_description: calibration.beyond_description().is_some(),
            resonance_ratio: calibration.resonance_ratio,
        }
    }
}

/// The model behind the stiffness, judged by the main touches.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ModelSummary {
    /// `holds`, `strained` or `rejected`.
    pub verdict: &'static str,
    /// χ² of the residuals of the main touches for each degree of freedom.
    pub chi2_per_dof: f64,
    /// Number of degrees of freedom.
    pub degrees_of_freedom: usize,
    /// The cause that explains most of a misfit: `friction`, `arm`, `depth` or `sample`, or `known` if the
    /// samples of known stiffness do not have one factor; `None` while the model holds, or when none explains it.
    pub pattern: Option<&'static str>,
    /// For the patterns `sample` and `known`: the name of the sample that differs most.
    pub pattern_sample: Option<String>,
    /// What one further term for each cause would change, largest first; `known` at the end.
    pub evidence: Vec<EvidenceSummary>,
    /// Relative standard deviation that scatter and misfit of the residuals add to every stiffness.
    pub added_rel: f64,
    /// Tangential over normal contact stiffness.
    pub tangential_ratio: TermSummary,
    /// Length of the probe's arm, mm.
    pub arm_mm: TermSummary,
    /// The least exponent of the depth, by which the contact deviates from its law, that touches like these
    /// show in 95 % of the runs; `None` if they cannot show any, and unless the model holds.
    pub depth_exponent_noticed: Option<f64>,
    /// The coefficient of friction below which at least one main touch slides; `None` if the touches cannot show a
    /// slip, and unless the model holds.
    pub slip_begins_below: Option<f64>,
    /// A contact that slips below this coefficient of friction is noticed by touches like these in 95 % of the runs;
    /// `None` if they do not show so much of any slip, and unless the model holds.
    pub slip_noticed_below: Option<f64>,
    /// `indentation` or `stage`: whichever holds the depth.
    pub depth: &'static str,
    /// What holds the depth by the rig file.
    pub depth_described: &'static str,
}

/// The evidence for a cause of misfit.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct EvidenceSummary {
    /// `friction`, `arm`, `depth`, `sample` or `known`.
    pub pattern: &'static str,
    /// χ² that one further term removes; for `sample`, the excess of its own χ²; for `known`, that of χ² about the
    /// common factor.
    pub chi2_removed: f64,
    /// Probability of as much under a model that holds.
    pub probability: f64,
}

/// A quantity of the model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct TermSummary {
    /// The value used.
    pub value: f64,
    /// Its standard deviation, if it was learnt from the main touches.
    pub sigma: Option<f64>,
    /// The value by the rig file.
    pub described: f64,
}

impl ModelSummary {
    /// The summary of a judged model.
    fn of(model: &RunModel, data: &RunData) -> Option<Self> {
        let check = model.check()?;
        let (terms, described) = (model.terms(), model.described());
        let term = |term: Term, value: f64, described: f64| TermSummary {
            value,
            sigma: model.learnt().iter().find(|one| one.term == term).map(|one| one.sigma),
            described,
        };
        let depth = |deflects: bool| if deflects { "stage" } else { "indentation" };
        let evidence = |one: &Evidence| EvidenceSummary {
            pattern: one.pattern.name(),
            chi2_removed: one.chi2_removed,
            probability: one.probability,
        };
        let sample = |pattern: Pattern| match pattern {
            Pattern::Sample(sample) | Pattern::Known(sample) => {
                Some(data.samples()[sample].name.clone())
            }
            Pattern::Friction | Pattern::Arm | Pattern::Depth => None,
        };
        let (ratio, arm) = (Term::TangentialRatio, Term::Arm);
        Some(Self {
            verdict: check.verdict.name(),
            chi2_per_dof: check.chi2_per_dof(),
            degrees_of_freedom: check.freedom,
            pattern: check.pattern.map(Pattern::name),
            pattern_sample: check.pattern.and_then(sample),
            evidence: check.evidence.iter().map(evidence).collect(),
            added_rel: check.added_rel,
            tangential_ratio: term(ratio, terms.tangential_ratio, described.tangential_ratio),
            arm_mm: term(arm, terms.arm_mm, described.arm_mm),
            depth_exponent_noticed: check.exponent_noticed,
            slip_begins_below: check.slip_noticed.map(|slip| slip.begins_below),
            slip_noticed_below: check.slip_noticed.and_then(|slip| slip.below),
            depth: depth(terms.deflects),
            depth_described: depth(described.deflects),
        })
    }
}

/// The recognition of the blind touches by one method.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct RecognitionSummary {
    /// The method: `k-means`, `k-means-log` or `calibrated-stiffness`.
    pub method: &'static str,
    /// Number of classified blind touches.
    pub trials: u32,
    /// Recognised blind touches.
    pub correct: u32,
    /// `correct` over `trials`.
    pub rate: f64,
    /// The lower end of its 95 % interval.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

impl DailyCheckSummary {
    fn of(cited: &CitedCalibration) -> Option<Self> {
        let CitedCalibration { made, person, file, sha256, verdict, .. } = cited.clone();
        Some(Self { verdict: verdict?, made, person, file, sha256 })
    }
}

impl RunResults {
    /// The results for programs.
    pub fn summary(&self) -> RunSummary {
        let Self { run, data, .. } = self;
        let shift = |mean: &rig_analysis::shift::DirectionMean| ShiftSummary {
            sample: data.samples()[mean.sample].name.clone(),
            direction: DIRECTIONS[mean.direction].name(),
            angle_deg: mean.angle_deg,
            shift_hz: mean.mean.shift_hz,
            sigma_hz: mean.mean.sigma_hz,
        };
        let classification = self.classification.as_ref().and_then(|classification| {
            let score = &classification.score;
            let (trials, correct, rate) = (score.trials, score.correct, score.rate()?);
            Some(ClassificationSummary { trials, correct, rate })
        });
        let statuses = self.touches.iter().map(|row| row.status);
        let Tally { planned, measured, refused, skipped, not_reached } = Tally::of(statuses);
        let recognition = |found: &Recognition| {
            let (low, high) = found.interval();
            let Recognition { method, trials, correct, .. } = *found;
            let (method, rate) = (method.name(), found.rate());
            RecognitionSummary { method, trials, correct, rate, low, high }
        };
        RunSummary {
            run_id: run.id.to_string(),
            is_simulated: data.is_simulated(),
            status: run.status.name(),
            is_sealed: run.is_sealed,
            touches: measured,
            touches_planned: planned,
            touches_measured: measured,
            touches_refused: refused,
            touches_skipped: skipped,
            touches_not_reached: not_reached,
            prompts: data.prompts,
            rig_seconds: data.rig_s(),
            expected_seconds: data.expected().map(|expected| [expected.least_s, expected.most_s]),
            aim: self.aim.clone(),
            wall_seconds: run.wall_s,
            daily_check: data.daily_check().and_then(DailyCheckSummary::of),
            no_load_hz: self.no_load.map(|no_load| no_load.mean_hz),
            shifts: self.direction_means.iter().map(shift).collect(),
            sensitivity_hz_per_mpa: self
                .sensitivity
                .as_ref()
                .map(|found| found.sensitivity.chord.hz_per_mpa),
            classification,
            stiffness: self
                .stiffness
                .iter()
                .flat_map(|found| {
                    self.samples()
                        .into_iter()
                        .map(|sample| StiffnessSummary::of(found, data, sample))
                })
                .collect(),
            calibration: (self.stiffness.as_ref().ok())
                .map(|found| CalibrationSummary::of(&found.calibration)),
            model: (self.stiffness.as_ref().ok())
                .and_then(|found| ModelSummary::of(&found.model, data)),
            recognition: self.recognitions.iter().map(recognition).collect(),
            touch_results: self.touches.clone(),
        }
    }
}
