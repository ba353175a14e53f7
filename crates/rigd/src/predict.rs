//! Predicted resonances of a plan, from the sensor in the rig file and the samples of known
//! stiffness.
//!
//! Nothing is measured, and no plan is refused because of a prediction. A window that misses its
//! resonance costs a run, so the person gets a warning.

use std::fmt;

use rig_contact::{
    Circuit, Contact, Models, Pose, PoseError, Refusal, Requirements, SensorDescription, Tier,
    Tissue, TissueError,
};
use rig_model::Window;
use rig_protocol::{Action, Plan, Touch};

use crate::loaded_rig::LoadedRig;

/// A predicted resonance closer than this to an edge of its window gives a warning. Half of it is
/// the half width at half power; the other half covers errors in the description of the sensor.
pub(crate) const EDGE_LINEWIDTHS: f64 = 1.0;

/// Allowed error of the model, in linewidths of the free sensor: a tenth of the margin.
const TOLERANCE_LINEWIDTHS: f64 = 0.1 * EDGE_LINEWIDTHS;

/// Predicted resonances of a plan.
#[derive(Debug)]
pub(crate) struct Predictions {
    /// The model by which they were predicted.
    pub(crate) tier: Tier,
    /// The prediction for the sweep of each step of the plan. A prompt has none.
    pub(crate) steps: Vec<Option<Result<Predicted, NotPredicted>>>,
}

/// A sweep of a protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SweepSection {
    NoLoad,
    Contact,
}

/// The resonance of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Predicted {
    pub(crate) section: SweepSection,
    pub(crate) resonance_hz: f64,
    /// Full width of the line at half its power, Hz.
    pub(crate) linewidth_hz: f64,
    pub(crate) window: Window,
}

/// The position of a resonance in its window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WindowPosition {
    Inside,
    NearEdge,
    Outside,
}

/// Why nothing is predicted of a touch.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum NotPredicted {
    #[error("the stiffness of sample \"{sample}\" is not known")]
    UnknownSample { sample: String },
    #[error(transparent)]
    Model(#[from] Refusal),
    #[error(transparent)]
    Tissue(#[from] TissueError),
    #[error(transparent)]
    Pose(#[from] PoseError),
}

/// An edge of a window that should be moved.
#[derive(Debug, PartialEq)]
pub(crate) struct Warning {
    pub(crate) section: SweepSection,
    pub(crate) edge: WindowEdge,
    pub(crate) window: Window,
    /// The steps whose resonance lies beyond the edge or near it, by index, the worst first.
    pub(crate) steps: Vec<usize>,
    /// Edge with enough margin for all of them, Hz.
    pub(crate) wanted_hz: f64,
}

/// An edge of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WindowEdge {
    Min,
    Max,
}

impl Predictions {
    /// Predicts the resonance of each step of a plan on a rig.
    pub(crate) fn of(plan: &Plan, rig: &LoadedRig) -> Self {
        let model = PlanningModel::new(plan, &rig.file.sensor, rig.known_samples());
        let step = |action: &Action| match action {
            Action::Prompt(_) => None,
            Action::NoLoad(_) => Some(Ok(model.no_load(plan))),
            Action::Touch(touch) => Some(model.touch(plan, touch)),
        };
        let steps = plan.steps.iter().map(|planned| step(&planned.action)).collect();
        Self { tier: model.tier, steps }
    }

    /// The windows that should be wider.
    pub(crate) fn warnings(&self) -> Vec<Warning> {
        let sections = [SweepSection::NoLoad, SweepSection::Contact];
        let edges = sections
            .into_iter()
            .flat_map(|section| [(section, WindowEdge::Min), (section, WindowEdge::Max)]);
        edges.filter_map(|(section, edge)| self.warning(section, edge)).collect()
    }

    fn warning(&self, section: SweepSection, edge: WindowEdge) -> Option<Warning> {
        let of_section = |(index, step): (usize, &Option<Result<Predicted, NotPredicted>>)| {
            let predicted = step.as_ref()?.as_ref().ok()?;
            (predicted.section == section).then_some((index, *predicted))
        };
        let mut near: Vec<(usize, Predicted)> = (self.steps.iter().enumerate())
            .filter_map(of_section)
            .filter(|(_, predicted)| predicted.room_linewidths(edge) < EDGE_LINEWIDTHS)
            .collect();
        near.sort_by(|(_, a), (_, b)| a.room_linewidths(edge).total_cmp(&b.room_linewidths(edge)));
        let window = near.first()?.1.window;
        let wanted = near.iter().map(|(_, predicted)| predicted.wanted_hz(edge));
        let wanted_hz = match edge {
            WindowEdge::Min => wanted.fold(f64::INFINITY, f64::min).floor(),
            WindowEdge::Max => wanted.fold(0.0, f64::max).ceil(),
        };
        let steps = near.into_iter().map(|(index, _)| index).collect();
        Some(Warning { section, edge, window, steps, wanted_hz })
    }

    /// The samples of the plan whose stiffness is not known, in order.
    pub(crate) fn unknown_samples(&self) -> Vec<&str> {
        let mut unknown: Vec<&str> = Vec::new();
        for step in self.steps.iter().flatten() {
            if let Err(NotPredicted::UnknownSample { sample }) = step
                && !unknown.contains(&sample.as_str())
            {
                unknown.push(sample);
            }
        }
        unknown
    }
}

impl Predicted {
    fn of(circuit: &Circuit, section: SweepSection, window: Window) -> Self {
        let Circuit { series_resonance_hz: resonance_hz, q, .. } = *circuit;
        Self { section, resonance_hz, linewidth_hz: resonance_hz / q, window }
    }

    /// The position of the resonance in its window.
    pub(crate) fn placing(&self) -> WindowPosition {
        let room = self.room_linewidths(WindowEdge::Min).min(self.room_linewidths(WindowEdge::Max));
        if room < 0.0 {
            WindowPosition::Outside
        } else if room < EDGE_LINEWIDTHS {
            WindowPosition::NearEdge
        } else {
            WindowPosition::Inside
        }
    }

    /// The room between the resonance and an edge, in linewidths; below zero beyond the edge.
    fn room_linewidths(&self, edge: WindowEdge) -> f64 {
        let room_hz = match edge {
            WindowEdge::Min => self.resonance_hz - self.window.min_hz,
            WindowEdge::Max => self.window.max_hz - self.resonance_hz,
        };
        room_hz / self.linewidth_hz
    }

    /// Edge with enough margin, Hz.
    fn wanted_hz(&self, edge: WindowEdge) -> f64 {
        let room_hz = EDGE_LINEWIDTHS * self.linewidth_hz;
        match edge {
            WindowEdge::Min => self.resonance_hz - room_hz,
            WindowEdge::Max => self.resonance_hz + room_hz,
        }
    }
}

impl SweepSection {
    /// The section of a protocol file.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::NoLoad => "no_load_sweep",
            Self::Contact => "contact_sweep",
        }
    }
}

impl WindowEdge {
    /// The key of a protocol file.
    pub(crate) const fn key(self) -> &'static str {
        match self {
            Self::Min => "min_hz",
            Self::Max => "max_hz",
        }
    }
}

impl WindowPosition {
    /// The word in results.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Inside => "inside",
            Self::NearEdge => "near_edge",
            Self::Outside => "outside",
        }
    }
}

impl fmt::Display for WindowPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Inside => "inside",
            Self::NearEdge => "near the edge",
            Self::Outside => "outside",
        })
    }
}

/// The sensor and its samples, in the model that is good enough for a plan.
struct PlanningModel<'a> {
    models: Models,
    tier: Tier,
    free: Circuit,
    sensor: &'a SensorDescription,
    /// The samples that are known, and how stiff they are, MPa.
    known: Vec<(String, f64)>,
}

impl<'a> PlanningModel<'a> {
    /// Chooses the cheapest tier with an impedance that agrees with the reference within a small part of
    /// the linewidth in every contact of the plan.
    fn new(plan: &Plan, sensor: &'a SensorDescription, known: Vec<(String, f64)>) -> Self {
        let models = Models::new(&sensor.sensor, sensor.law);
        let free = models.free_circuit();
        let in_plan = |(name, mpa): &(String, f64)| plan.samples.contains(name).then_some(*mpa);
        let stiffest_mpa = known.iter().filter_map(in_plan).fold(0.0, f64::max);
        let angles = plan.steps.iter().filter_map(|step| match step.action {
            Action::Touch(touch) => Some(touch.pose.angle.radians()),
            _ => None,
        });
        let tilt_max_rad = angles.fold(0.0, f64::max);
        let tolerance_hz = TOLERANCE_LINEWIDTHS * free.series_resonance_hz / free.q;
        let choice = sensor.tissue(stiffest_mpa).ok().and_then(|stiffest| {
            let deepest = sensor.depth(plan.touch.indentation_mm);
            let required = Requirements {
                sensor: sensor.sensor,
                stiffest,
                deepest,
                law: sensor.law,
                friction: sensor.friction,
                tilt_max_rad,
                needs_impedance: true,
            };
            Tier::cheapest_for(&required, tolerance_hz).ok()
        });
        let tier = choice.map_or(Tier::Reference, |choice| choice.tier);
        Self { models, tier, free, sensor, known }
    }

    fn no_load(&self, plan: &Plan) -> Predicted {
        Predicted::of(&self.free, SweepSection::NoLoad, plan.no_load_sweep.window)
    }

    fn touch(&self, plan: &Plan, touch: &Touch) -> Result<Predicted, NotPredicted> {
        let name = &plan.samples[touch.sample];
        let found = self.known.iter().find(|(known, _)| known == name);
        let Some(&(_, stiffness_mpa)) = found else {
            return Err(NotPredicted::UnknownSample { sample: name.clone() });
        };
        let tissue: Tissue = self.sensor.tissue(stiffness_mpa)?;
        let contact = Contact {
            pose: Pose::leaning(touch.pose.direction, touch.pose.angle.radians())?,
            depth: self.sensor.depth(plan.touch.indentation_mm),
            law: self.sensor.law,
            friction: self.sensor.friction,
        };
        let circuit = self.models.circuit(self.tier, &tissue, &contact)?;
        Ok(Predicted::of(&circuit, SweepSection::Contact, plan.contact_sweep.window))
    }
}
