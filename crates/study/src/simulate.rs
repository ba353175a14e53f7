//! Simulated touches with the errors of a bench.

use rig_contact::{Contact, ContactLaw, Direction, Friction, Models, Pose, Tier};

use crate::paper_bench::{Control, INDENTATION_MM, tissue};
use rig_model::random::Stream;

/// The error sources of a touch, as standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nuisances {
    /// Frequency noise, Hz.
    pub(crate) shift_hz: f64,
    /// Depth error, mm; mostly from the surface found.
    pub(crate) depth_mm: f64,
    /// Error of the contact angle, degrees.
    pub(crate) angle_deg: f64,
    /// Relative variation of the stiffness over a sample.
    pub(crate) young_rel: f64,
    /// Distance of the probe from the axis of the tilt, mm. A tilt brings the surface nearer on one
    /// side. This is a constant and not a standard deviation.
    pub(crate) eccentricity_mm: f64,
}

impl Nuisances {
    /// No errors.
    pub(crate) const NONE: Self =
        Self { shift_hz: 0.0, depth_mm: 0.0, angle_deg: 0.0, young_rel: 0.0, eccentricity_mm: 0.0 };

    /// The bench for which the goals of this project are stated.
    pub(crate) const BENCH: Self = Self {
        shift_hz: 0.3,
        depth_mm: 0.02,
        angle_deg: 1.0,
        young_rel: 0.03,
        eccentricity_mm: 0.0,
    };
}

/// A simulation of touches.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TouchSimulation<'a> {
    pub(crate) models: &'a Models,
    pub(crate) tier: Tier,
    pub(crate) law: ContactLaw,
    pub(crate) friction: Friction,
    pub(crate) control: Control,
    pub(crate) nuisances: Nuisances,
}

impl TouchSimulation<'_> {
    /// The nominal contact.
    pub(crate) fn contact(&self, direction: Direction, angle_deg: f64) -> Contact {
        self.contact_at(direction, angle_deg, INDENTATION_MM)
    }

    fn contact_at(&self, direction: Direction, angle_deg: f64, depth_mm: f64) -> Contact {
        // A negative angle leans the surface the other way.
        let turn = if angle_deg < 0.0 { std::f64::consts::PI } else { 0.0 };
        let angle_rad = angle_deg.abs().to_radians();
        let pose = if turn == 0.0 {
            Pose::leaning(direction, angle_rad)
        } else {
            Pose::new(angle_rad, direction.azimuth_rad() + turn)
        }
        .expect("the studies' angles are below a right angle");
        let Self { law, friction, control, .. } = *self;
        Contact { pose, depth: control.depth(depth_mm), law, friction }
    }

    /// The measured shift, Hz. Noise may make it negative. It is infinite where a rare error makes a
    /// contact of a force that the tier refuses, so that no range contains it.
    pub(crate) fn read_hz(
        &self,
        young_mpa: f64,
        direction: Direction,
        angle_deg: f64,
        random: &mut Stream,
    ) -> f64 {
        let Nuisances { shift_hz, depth_mm, angle_deg: tilt_deg, young_rel, eccentricity_mm } =
            self.nuisances;
        let side = match direction {
            Direction::Back => -1.0,
            Direction::Front | Direction::Left => 1.0,
        };
        // All four are drawn every time, so that one nuisance does not change the draws of another.
        let [of_shift, of_depth, of_angle, of_young] = std::array::from_fn(|_| random.normal());
        let angle = angle_deg + tilt_deg * of_angle;
        let aside = side * eccentricity_mm * angle.to_radians().tan();
        // The depth is limited to the validity of the contact law.
        let deepest = self.law.depth_limit_rel() * self.models.sensor().design().probe_radius_mm
            / angle.to_radians().cos();
        let depth = (INDENTATION_MM + depth_mm * of_depth + aside).min(0.999_999 * deepest);
        let young = young_mpa * (young_rel * of_young).exp();
        let contact = self.contact_at(direction, angle, depth);
        let found = self.models.predict(self.tier, &tissue(young), &contact);
        found.map_or(f64::INFINITY, |found| found.shift_hz) + shift_hz * of_shift
    }

    /// The shift without errors, Hz.
    pub(crate) fn exact_hz(&self, young_mpa: f64, direction: Direction, angle_deg: f64) -> f64 {
        self.models
            .predict(self.tier, &tissue(young_mpa), &self.contact(direction, angle_deg))
            .expect("the paper's contacts are within every tier")
            .shift_hz
    }
}
