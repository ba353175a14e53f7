//! The choice of a tier: the cheapest one whose largest error is within a tolerance.
//!
//! The errors are measured against the reference over a grid of contacts. A stored table holds them
//! for the reference sensor, and a test measures that table again. Any other sensor is measured on
//! demand, in about a millisecond.

use std::fmt;

use crate::{
    Contact, ContactLaw, Depth, Direction, Models, Pose, Refusal, Sensor, SensorDesign, Tier,
    Tissue,
};

mod stored;

/// The contacts that a model must predict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Requirements {
    /// Sensor in all of these contacts.
    pub sensor: Sensor,
    /// The stiffest tissue.
    pub stiffest: Tissue,
    /// The deepest contact along the probe.
    pub deepest: Depth,
    /// The largest contact angle, rad.
    pub tilt_max_rad: f64,
    /// Whether the model must give an impedance and not only a shift.
    pub needs_impedance: bool,
}

/// The chosen tier, with its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Cheapest sufficient tier.
    pub tier: Tier,
    /// The cheapest contact law that reaches the required depth.
    pub law: ContactLaw,
    /// The largest error of the tier in such contacts, Hz.
    pub error_hz: f64,
    /// The allowed error, Hz.
    pub tolerance_hz: f64,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tier, law, error_hz, tolerance_hz } = self;
        let (tier, law) = (tier.name(), law.name());
        write!(f, "tier {tier} with {law} contact: within {error_hz:.3} Hz of the reference, ")?;
        write!(f, "{tolerance_hz} Hz allowed")
    }
}

impl Tier {
    /// The cheapest tier and contact law whose largest error is at most `tolerance_hz`. It is the
    /// reference when no other tier suffices or when the contacts are outside the table.
    ///
    /// # Errors
    /// [`Refusal::Law`] when no contact law reaches the required depth.
    pub fn cheapest_for(required: &Requirements, tolerance_hz: f64) -> Result<Choice, Refusal> {
        let errors = required.tier_errors()?;
        let (tier, error_hz) = Self::ALL
            .into_iter()
            .zip(errors.of_tiers_hz)
            .filter(|(tier, _)| tier.validity().has_impedance || !required.needs_impedance)
            .find(|&(_, error_hz)| error_hz <= tolerance_hz)
            .unwrap_or((Self::Reference, 0.0));
        Ok(Choice { tier, law: errors.law, error_hz, tolerance_hz })
    }
}

/// The largest error of each tier in the required contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TierErrors {
    /// In the order of [`Tier::ALL`], Hz; infinite when the tier refuses or the table ends.
    pub of_tiers_hz: [f64; Tier::ALL.len()],
    /// The cheapest contact law that reaches the required depth.
    pub law: ContactLaw,
}

impl Requirements {
    /// The largest error of each tier in these contacts.
    ///
    /// # Errors
    /// [`Refusal::Law`] when no contact law reaches the required depth.
    pub fn tier_errors(&self) -> Result<TierErrors, Refusal> {
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) =
            self.deepest;
        let section = self.sensor.section();
        let depth_rel = (along_probe_mm / self.sensor.design().probe_radius_mm).max(0.0);
        let series = ContactLaw::SneddonSeries;
        let law = if depth_rel <= series.depth_limit_rel() { series } else { ContactLaw::Sneddon };
        let radius_m = law.at(depth_rel)?.radius_rel * section.radius_m;
        let ratio = 2.0 * self.stiffest.contact_modulus_pa() * radius_m / section.tip_n_per_m();
        let is_stage = matches!(self.deepest, Depth::Stage { .. });
        let range = ContactRange::containing(is_stage, self.tilt_max_rad, ratio);
        let table = ErrorTable::of(&self.sensor);
        let of_tiers_hz = Tier::ALL.map(|tier| match range {
            // Errors are measured against it.
            _ if tier == Tier::Reference => 0.0,
            Some(range) => table.largest_hz(tier, range),
            None => f64::INFINITY,
        });
        Ok(TierErrors { of_tiers_hz, law })
    }
}

/// Largest contact angles of the ranges, degrees.
pub(crate) const TILTS_DEG: [f64; 4] = [0.0, 15.0, 30.0, 45.0];
/// Largest contact stiffnesses of the ranges, over that of the sensor's tip.
///
/// For the reference sensor at a depth of one ball radius these are 0.1, 0.35, 0.65, 1 and 3 MPa.
pub(crate) const RATIOS: [f64; 5] = [0.25, 0.85, 1.6, 2.5, 7.5];

/// Every contact up to this tilt and this stiffness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ContactRange {
    /// Whether the depth is a move of the stage.
    pub(crate) is_stage: bool,
    /// Index in [`TILTS_DEG`].
    pub(crate) tilt: usize,
    /// Index in [`RATIOS`].
    pub(crate) ratio: usize,
}

impl ContactRange {
    /// The smallest range that contains such contacts, if one does.
    fn containing(is_stage: bool, tilt_rad: f64, ratio: f64) -> Option<Self> {
        const ROUNDING_DEG: f64 = 1e-9;
        let tilt_deg = tilt_rad.to_degrees() - ROUNDING_DEG;
        let tilt = TILTS_DEG.iter().position(|&largest| tilt_deg <= largest)?;
        let ratio = RATIOS.iter().position(|&largest| ratio <= largest)?;
        Some(Self { is_stage, tilt, ratio })
    }
}

/// The largest error of every tier in every range, Hz; infinite when the tier refuses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ErrorTable([[[[f64; 5]; 4]; 2]; Tier::ALL.len()]);

/// Stiffness ratios at which the errors are measured: a few in each range.
const MEASURED_RATIOS: [f64; 10] = [0.01, 0.1, 0.25, 0.5, 0.85, 1.2, 1.6, 2.5, 4.0, 7.5];
/// Contact angles at which the errors are measured, degrees.
const MEASURED_TILTS_DEG: [f64; 7] = [0.0, 7.5, 15.0, 22.5, 30.0, 37.5, 45.0];
/// Depths at which the errors are measured, in ball radii.
const MEASURED_DEPTHS: [f64; 2] = [0.5, 1.0];

impl ErrorTable {
    /// The stored table for the reference sensor; for any other sensor a newly measured one.
    pub(crate) fn of(sensor: &Sensor) -> Self {
        if *sensor.design() == SensorDesign::reference() {
            stored::REFERENCE
        } else {
            Self::measure(sensor)
        }
    }

    /// Measures the error of every tier over the grid of contacts. The tiers use the series contact
    /// radius, the reference the exact one.
    pub(crate) fn measure(sensor: &Sensor) -> Self {
        let mut table = Self([[[[0.0; 5]; 4]; 2]; Tier::ALL.len()]);
        let models = Models::new(sensor, ContactLaw::SneddonSeries);
        for depth_rel in MEASURED_DEPTHS {
            for ratio in MEASURED_RATIOS {
                for tilt_deg in MEASURED_TILTS_DEG {
                    for is_stage in [false, true] {
                        table.measure_one(&models, depth_rel, ratio, tilt_deg, is_stage);
                    }
                }
            }
        }
        table
    }

    fn measure_one(
        &mut self,
        models: &Models,
        depth_rel: f64,
        ratio: f64,
        tilt_deg: f64,
        is_stage: bool,
    ) {
        let sensor = models.sensor();
        let tissue = tissue_of_ratio(sensor, depth_rel, ratio);
        let along_probe_mm = depth_rel * sensor.design().probe_radius_mm;
        let depth = if is_stage {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        };
        for direction in Direction::ALL {
            let pose = Pose::leaning(direction, tilt_deg.to_radians())
                .expect("the grid's angles are below a right angle");
            let exact = Contact::new(pose, depth);
            let truth = models
                .predict(Tier::Reference, &tissue, &exact)
                .expect("the grid's depths are within Sneddon's solution")
                .shift_hz;
            let cheap = Contact { law: ContactLaw::SneddonSeries, ..exact };
            let shift = |tier| models.predict(tier, &tissue, &cheap).map(|found| found.shift_hz);
            for (tier, row) in Tier::ALL.into_iter().zip(&mut self.0) {
                if tier == Tier::Reference {
                    continue;
                }
                let error = shift(tier).map_or(f64::INFINITY, |found| (found - truth).abs());
                raise(&mut row[usize::from(is_stage)], tilt_deg, ratio, error);
            }
        }
    }

    /// The largest error of a tier in a range, Hz; infinite when the tier refuses such contacts.
    pub(crate) const fn largest_hz(&self, tier: Tier, range: ContactRange) -> f64 {
        self.0[tier as usize][range.is_stage as usize][range.tilt][range.ratio]
    }
}

/// Raises the error of every range that contains the contact.
fn raise(ranges: &mut [[f64; 5]; 4], tilt_deg: f64, ratio: f64, error: f64) {
    for (row, tilt_max) in ranges.iter_mut().zip(TILTS_DEG) {
        for (largest, ratio_max) in row.iter_mut().zip(RATIOS) {
            if tilt_deg <= tilt_max && ratio <= ratio_max {
                *largest = largest.max(error);
            }
        }
    }
}

/// The tissue whose contact stiffness, with the probe upright and fully indented, is `ratio` times
/// that of the tip.
fn tissue_of_ratio(sensor: &Sensor, depth_rel: f64, ratio: f64) -> Tissue {
    let section = sensor.section();
    let radius_m = ContactLaw::Sneddon.at_valid(depth_rel).radius_rel * section.radius_m;
    let modulus_pa = ratio * section.tip_n_per_m() / (2.0 * radius_m);
    Tissue::soft(modulus_pa * 0.75e-6).expect("a positive ratio gives a positive stiffness")
}

#[cfg(test)]
mod tests;
