//! The model of a run, learnt from its main touches and judged by them.
//!
//! Every main touch gives a stiffness. Under a model that holds, the touches of one sample agree at
//! all angles and in all directions within their uncertainties. χ² of their differences judges the
//! model; the quantities that the touches identify are fitted until χ² is least.

mod errors;
mod evidence;
mod fit;
mod joint;
mod judge;
mod known;
mod linear;
mod pair;
mod shared;

use rig_contact::{
    Depth, Friction, Sensor, SensorDesign,
    inverse::{InverseError, TiltInference},
};

pub(crate) use errors::{Entering, TouchErrors};
pub(crate) use judge::{BY_CHANCE, chi2_probability};
pub use judge::{Evidence, ModelCheck, Pattern, Residual, SlipNoticed, Verdict};
pub(crate) use shared::{Chi2Expected, sharing};

use crate::{
    budget::Budget,
    stiffness::{Compensation, PosedTouch, Young},
};

/// Where the model of a run comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelSource {
    /// From the main touches of the run, as far as they identify it.
    Learnt,
    /// From the rig file alone.
    Described,
}

/// The quantities of a model that a run may learn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// Tangential over normal contact stiffness, 0 without friction.
    pub tangential_ratio: f64,
    /// From the middle plane of the bimorph to the centre of the ball, mm.
    pub arm_mm: f64,
    /// Whether the stage holds the depth, while the sensor deflects.
    pub deflects: bool,
}

/// A quantity that has a slope.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Term {
    /// [`Terms::tangential_ratio`].
    TangentialRatio,
    /// [`Terms::arm_mm`].
    Arm,
}

impl Term {
    /// The word in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::TangentialRatio => "tangential_ratio",
            Self::Arm => "arm_mm",
        }
    }

    const fn of(self, terms: &Terms) -> f64 {
        match self {
            Self::TangentialRatio => terms.tangential_ratio,
            Self::Arm => terms.arm_mm,
        }
    }

    /// The terms with this one at a value, or at the end of its range.
    fn set(self, terms: &Terms, value: f64) -> Terms {
        match self {
            Self::TangentialRatio => {
                Terms { tangential_ratio: value.clamp(0.0, RATIO_MAX), ..*terms }
            }
            Self::Arm => Terms { arm_mm: value.clamp(ARM_LEAST_MM, ARM_MOST_MM), ..*terms },
        }
    }

    /// Whether the value is at an end of its range.
    fn is_at_end(self, terms: &Terms) -> bool {
        let value = self.of(terms);
        [f64::NEG_INFINITY, f64::INFINITY]
            .map(|end| self.of(&self.set(terms, end)))
            .contains(&value)
    }

    /// A step that is small against every scale of the models.
    const fn step(self) -> f64 {
        match self {
            Self::TangentialRatio => 0.01,
            Self::Arm => 0.08,
        }
    }
}

/// Mindlin's ratio is between 2/3 and 1; a contact that is bonded to a thin layer may have more.
const RATIO_MAX: f64 = 1.5;
/// The range of arms that a fit may try, mm.
const ARM_LEAST_MM: f64 = 0.1;
const ARM_MOST_MM: f64 = 30.0;

/// Standard deviation of the exponent of the depth by which a real contact deviates from its law, where
/// the stage holds the depth: the sensor gives way to a stiff sample, which is then less deep than a soft one.
/// Against Sneddon's law, neo-Hookean samples that relax by 10 % have an exponent of 0.08, and those of Hertz's
/// law -0.1; this is an even distribution up to 0.1. The touches of one depth do not show it.
const LAW_EXPONENT_SIGMA: f64 = 0.058;

/// A learnt quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearntTerm {
    /// The quantity.
    pub term: Term,
    /// Its value by the rig file.
    pub described: f64,
    /// Its value by the main touches.
    pub value: f64,
    /// The standard deviation of `value`.
    pub sigma: f64,
}

/// The main touches of a run, and what is known of its samples.
#[derive(Debug, Clone, Copy)]
pub struct MainTouches<'a> {
    /// The touches.
    pub touches: &'a [PosedTouch],
    /// Known Young's modulus of each sample, MPa.
    pub known_mpa: &'a [Option<f64>],
    /// Standard deviation of the stiffness from one point of a sample to the next, relative.
    pub sample_rel: f64,
    /// Correlation of the depths of the touches, where the error of the screw was measured; `None` where touches at one
    /// place of the stages are taken to share a part of it.
    pub depth_correlation: Option<&'a [Vec<f64>]>,
    /// Covariance of the shifts of two touches by their references, Hz²; `None` if no touches share one.
    pub reference_hz2: Option<&'a [Vec<f64>]>,
}

/// The model of a run.
#[derive(Debug, Clone)]
pub struct RunModel {
    compensation: Compensation,
    terms: Terms,
    described: Terms,
    learnt: Vec<LearntTerm>,
    /// Covariance of the terms of [`ModelReading::gradient`], in their order.
    covariance: Vec<Vec<f64>>,
    /// For each learnt term, the model on both sides of its value.
    sides: Vec<[(Terms, Compensation); 2]>,
    /// The model that holds the depth in the other way, if the touches could choose it.
    rival: Option<(Terms, Compensation)>,
    errors: TouchErrors,
    check: Option<ModelCheck>,
}

/// The stiffness of a touch or a site before the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelReading {
    /// Young's modulus with the uncertainty of the touch or site alone.
    pub young: Young,
    /// The parts of that uncertainty.
    pub budget: Budget,
    /// The change of its logarithm for a unit of each learnt term, of the exponent of the depth if the stage
    /// holds the depth, and from the model to its rival if it has one; empty for a site, which learns nothing.
    pub gradient: Vec<f64>,
}

impl ModelReading {
    /// The stiffness of a site whose angle was inferred with the model by the rig file.
    pub fn of_site(described: &Compensation, found: &TiltInference) -> Self {
        let young = Young { mpa: found.young_mpa.value, sigma_mpa: found.young_mpa.sigma };
        Self { young, budget: Budget::of_site(described, found), gradient: Vec::new() }
    }
}

impl RunModel {
    /// The model by the rig file, or by the main touches; in both cases judged by the main touches.
    pub fn of(described: &Compensation, main: &MainTouches<'_>, source: ModelSource) -> Self {
        fit::model(described, main, source)
    }

    /// The model by the rig file, judged by the stiffness of sites whose angle was found together with it:
    /// the sites of one sample give one stiffness. Each site is an index of a sample and its stiffness; `shared` is the
    /// relative covariance of two different sites by their references.
    pub fn of_sites(
        described: &Compensation,
        sites: &[(usize, Young)],
        shared: &[Vec<f64>],
    ) -> Self {
        let terms = Terms::of(described, &[]);
        Self {
            compensation: described.clone(),
            terms,
            described: terms,
            learnt: Vec::new(),
            covariance: Vec::new(),
            sides: Vec::new(),
            rival: None,
            // A site has the variation from point to point in its own uncertainty.
            errors: TouchErrors::default(),
            check: judge::of_sites(sites, shared),
        }
    }

    /// This model with the residuals renumbered by the caller's list of touches.
    #[must_use]
    pub fn with_touches(mut self, indices: &[usize]) -> Self {
        for residual in self.check.iter_mut().flat_map(|check| &mut check.residuals) {
            residual.touch = indices[residual.touch];
        }
        self
    }

    /// The quantities of the model.
    pub const fn terms(&self) -> &Terms {
        &self.terms
    }

    /// The terms as the rig file describes them.
    pub const fn described(&self) -> &Terms {
        &self.described
    }

    /// The learnt quantities; whether the stage holds the depth is not among them.
    pub fn learnt(&self) -> &[LearntTerm] {
        &self.learnt
    }

    /// Covariance of the learnt quantities, in their order, of the growth of the contact with depth if the stage
    /// holds the depth, and the probability of the other way to hold the depth if the touches chose between both.
    pub fn covariance(&self) -> &[Vec<f64>] {
        &self.covariance
    }

    /// The errors of the main touches, in the list of the caller.
    pub(crate) const fn errors(&self) -> &TouchErrors {
        &self.errors
    }

    /// The judgement by the main touches; `None` when they leave no degree of freedom.
    pub const fn check(&self) -> Option<&ModelCheck> {
        self.check.as_ref()
    }

    /// The stiffness of a touch at a known pose.
    ///
    /// # Errors
    /// [`InverseError`].
    pub fn of_touch(&self, touch: &PosedTouch) -> Result<ModelReading, InverseError> {
        let one = self.compensation.of_touch(&self.terms.touch(touch))?;
        let gradient = |[low, high]: &[(Terms, Compensation); 2], learnt: &LearntTerm| {
            let log = |(terms, model): &(Terms, Compensation)| model.log_young(&terms.touch(touch));
            let width = learnt.term.of(&high.0) - learnt.term.of(&low.0);
            Ok((log(high)? - log(low)?) / width)
        };
        let gradient: Result<Vec<f64>, InverseError> =
            self.sides.iter().zip(&self.learnt).map(|(side, term)| gradient(side, term)).collect();
        let mut gradient = gradient?;
        gradient.extend(self.terms.deflects.then(|| {
            // Outside of the law there is no stiffness either.
            self.compensation.log_sunk(&self.terms.touch(touch), one.young_mpa).unwrap_or(0.0)
        }));
        gradient.extend(self.rival.as_ref().map(|(terms, model)| {
            // Outside of the rival there is nothing to compare.
            model.log_young(&terms.touch(touch)).map_or(0.0, |log| log - one.young_mpa.ln())
        }));
        let young = Young { mpa: one.young_mpa, sigma_mpa: one.sigma_mpa };
        let budget = Budget::of_touch(&self.compensation, touch, &one);
        Ok(ModelReading { young, budget, gradient })
    }
}

impl Terms {
    fn of(compensation: &Compensation, touches: &[PosedTouch]) -> Self {
        let is_held = |touch: &PosedTouch| matches!(touch.depth, Depth::Stage { .. });
        Self {
            tangential_ratio: compensation.tangential_ratio(),
            arm_mm: compensation.models.sensor().design().arm_mm,
            deflects: touches.iter().any(is_held),
        }
    }

    /// A touch whose depth is held as in these terms.
    fn touch(&self, touch: &PosedTouch) -> PosedTouch {
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) = touch.depth;
        let depth = if self.deflects {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        };
        PosedTouch { depth, ..*touch }
    }
}

impl Compensation {
    /// This description with other terms; `None` for an arm that no sensor of this length has.
    fn with(&self, terms: &Terms) -> Option<Self> {
        let design = SensorDesign { arm_mm: terms.arm_mm, ..*self.models.sensor().design() };
        let sensor = Sensor::new(design).ok()?;
        let friction = Friction::Elastic { tangential_ratio: terms.tangential_ratio };
        Some(Self { models: rig_contact::Models::new(&sensor, self.law), friction, ..self.clone() })
    }
}

#[cfg(test)]
mod tests;
