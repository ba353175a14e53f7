//! Which tier a scene needs: the cheapest whose largest error stays below what the scene asks.
//!
//! The errors are measured against the reference over a grid of contacts, and kept for the
//! reference sensor in a table that a test measures anew. Any other sensor is measured when it is
//! asked for, which takes about a millisecond.

use std::fmt;

use crate::{
    Contact, ContactLaw, Depth, Direction, Models, Pose, Refusal, Sensor, SensorDesign, Tier,
    Tissue,
};

mod stored;

/// What a scene may hold, and so what its model must be right about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
    /// The sensor.
    pub sensor: Sensor,
    /// The stiffest tissue.
    pub stiffest: Tissue,
    /// The deepest contact along the probe; a stage move when the stage is what the scene moves.
    pub deepest: Depth,
    /// The largest contact angle, rad.
    pub tilt_max_rad: f64,
    /// Whether it needs an impedance and not only a shift.
    pub needs_impedance: bool,
}

/// The tier chosen for a scene, and why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// The tier.
    pub tier: Tier,
    /// The cheapest contact law that reaches the scene's depth.
    pub law: ContactLaw,
    /// The largest error of the tier in such scenes, Hz.
    pub error_hz: f64,
    /// The error that the scene allows, Hz.
    pub tolerance_hz: f64,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tier, law, error_hz, tolerance_hz } = self;
        let (tier, law) = (tier.name(), law.name());
        write!(f, "tier {tier} with {law} contact: within {error_hz:.3} Hz of the reference, ")?;
        write!(f, "where {tolerance_hz} Hz are allowed")
    }
}

impl Tier {
    /// The cheapest tier and contact law whose largest error is at most `tolerance_hz` in the
    /// scene; the reference when no other will do or when the scene is outside the table.
    ///
    /// # Errors
    /// [`Refusal::Law`] when no contact law reaches the scene's depth.
    pub fn cheapest_for(scene: &Scene, tolerance_hz: f64) -> Result<Choice, Refusal> {
        let errors = scene.errors()?;
        let (tier, error_hz) = Self::ALL
            .into_iter()
            .zip(errors.of_tiers_hz)
            .filter(|(tier, _)| tier.validity().has_impedance || !scene.needs_impedance)
            .find(|&(_, error_hz)| error_hz <= tolerance_hz)
            .unwrap_or((Self::Reference, 0.0));
        Ok(Choice { tier, law: errors.law, error_hz, tolerance_hz })
    }
}

/// The largest error of each tier in a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneErrors {
    /// In the order of [`Tier::ALL`], Hz; infinite where the tier refuses or nothing is known.
    pub of_tiers_hz: [f64; Tier::ALL.len()],
    /// The cheapest contact law that reaches the scene's depth.
    pub law: ContactLaw,
}

impl Scene {
    /// The largest error of each tier in this scene.
    ///
    /// # Errors
    /// [`Refusal::Law`] when no contact law reaches the scene's depth.
    pub fn errors(&self) -> Result<SceneErrors, Refusal> {
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) =
            self.deepest;
        let section = self.sensor.section();
        let depth_rel = (along_probe_mm / self.sensor.design().probe_radius_mm).max(0.0);
        let series = ContactLaw::SneddonSeries;
        let law = if depth_rel <= series.depth_limit_rel() { series } else { ContactLaw::Sneddon };
        let radius_m = law.at(depth_rel)?.radius_rel * section.radius_m;
        let ratio = 2.0 * self.stiffest.contact_modulus_pa() * radius_m / section.tip_n_per_m();
        let is_stage = matches!(self.deepest, Depth::Stage { .. });
        let cell = Cell::containing(is_stage, self.tilt_max_rad, ratio);
        let table = ErrorTable::of(&self.sensor);
        let of_tiers_hz = Tier::ALL.map(|tier| match cell {
            // The yardstick itself.
            _ if tier == Tier::Reference => 0.0,
            Some(cell) => table.largest_hz(tier, cell),
            None => f64::INFINITY,
        });
        Ok(SceneErrors { of_tiers_hz, law })
    }
}

/// Largest contact angles of the table's cells, degrees.
pub const TILTS_DEG: [f64; 4] = [0.0, 15.0, 30.0, 45.0];
/// Largest contact stiffnesses of the table's cells, over that of the sensor's tip.
///
/// For the reference sensor at a depth of one ball radius these are 0.1, 0.35, 0.65, 1 and 3 MPa.
pub const RATIOS: [f64; 5] = [0.25, 0.85, 1.6, 2.5, 7.5];

/// A cell of the table: every contact up to this tilt and this stiffness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Whether the depth is a move of the stage.
    pub is_stage: bool,
    /// Index in [`TILTS_DEG`].
    pub tilt: usize,
    /// Index in [`RATIOS`].
    pub ratio: usize,
}

impl Cell {
    /// The smallest cell that contains such contacts, if any does.
    fn containing(is_stage: bool, tilt_rad: f64, ratio: f64) -> Option<Self> {
        const ROUNDING_DEG: f64 = 1e-9;
        let tilt_deg = tilt_rad.to_degrees() - ROUNDING_DEG;
        let tilt = TILTS_DEG.iter().position(|&largest| tilt_deg <= largest)?;
        let ratio = RATIOS.iter().position(|&largest| ratio <= largest)?;
        Some(Self { is_stage, tilt, ratio })
    }
}

/// The largest error of every tier in every cell, Hz; infinite where the tier refuses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorTable([[[[f64; 5]; 4]; 2]; Tier::ALL.len()]);

/// Stiffness ratios at which the errors are measured: a few below each cell's largest.
const MEASURED_RATIOS: [f64; 10] = [0.01, 0.1, 0.25, 0.5, 0.85, 1.2, 1.6, 2.5, 4.0, 7.5];
/// Contact angles at which they are measured, degrees.
const MEASURED_TILTS_DEG: [f64; 7] = [0.0, 7.5, 15.0, 22.5, 30.0, 37.5, 45.0];
/// Depths at which they are measured, in ball radii.
const MEASURED_DEPTHS: [f64; 2] = [0.5, 1.0];

impl ErrorTable {
    /// The stored table for the reference sensor, one measured now for any other.
    pub fn of(sensor: &Sensor) -> Self {
        if *sensor.design() == SensorDesign::reference() {
            stored::REFERENCE
        } else {
            Self::measure(sensor)
        }
    }

    /// Measures every tier, with the series contact radius, against the reference with the exact
    /// one over the grid of contacts.
    pub fn measure(sensor: &Sensor) -> Self {
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

    /// The largest error of a tier in a cell, Hz; infinite when the tier refuses such contacts.
    pub const fn largest_hz(&self, tier: Tier, cell: Cell) -> f64 {
        self.0[tier as usize][cell.is_stage as usize][cell.tilt][cell.ratio]
    }
}

/// Raises every cell that contains the contact to its error.
fn raise(cells: &mut [[f64; 5]; 4], tilt_deg: f64, ratio: f64, error: f64) {
    for (row, tilt_max) in cells.iter_mut().zip(TILTS_DEG) {
        for (cell, ratio_max) in row.iter_mut().zip(RATIOS) {
            if tilt_deg <= tilt_max && ratio <= ratio_max {
                *cell = cell.max(error);
            }
        }
    }
}

/// The tissue whose contact stiffness, upright and fully indented, is `ratio` times the tip's.
fn tissue_of_ratio(sensor: &Sensor, depth_rel: f64, ratio: f64) -> Tissue {
    let section = sensor.section();
    let radius_m = ContactLaw::Sneddon.at_valid(depth_rel).radius_rel * section.radius_m;
    let modulus_pa = ratio * section.tip_n_per_m() / (2.0 * radius_m);
    Tissue::soft(modulus_pa * 0.75e-6).expect("a positive ratio gives a positive stiffness")
}

#[cfg(test)]
mod tests;
