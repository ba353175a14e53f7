//! Touches with the errors that a bench makes.

use rig_contact::{Contact, ContactLaw, Direction, Friction, Models, Pose, Tier};

use crate::paper_bench::{Control, INDENTATION_MM, tissue};
use rig_model::random::Stream;

/// How well touches are made, as standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nuisances {
    /// Of a frequency, Hz.
    pub(crate) shift_hz: f64,
    /// Of the depth, mm: of finding the surface.
    pub(crate) depth_mm: f64,
    /// Of the contact angle, degrees.
    pub(crate) angle_deg: f64,
    /// Of the stiffness from place to place, relative.
    pub(crate) young_rel: f64,
    /// How far the probe stands beside the axis of the tilt, mm: the surface comes nearer on one
    /// side. Not a standard deviation, because it stays.
    pub(crate) eccentricity_mm: f64,
}

impl Nuisances {
    /// None at all.
    pub(crate) const NONE: Self =
        Self { shift_hz: 0.0, depth_mm: 0.0, angle_deg: 0.0, young_rel: 0.0, eccentricity_mm: 0.0 };

    /// The bench on which this project's goals stand.
    pub(crate) const BENCH: Self = Self {
        shift_hz: 0.3,
        depth_mm: 0.02,
        angle_deg: 1.0,
        young_rel: 0.03,
        eccentricity_mm: 0.0,
    };
}

/// How touches are made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way<'a> {
    pub(crate) models: &'a Models,
    pub(crate) tier: Tier,
    pub(crate) law: ContactLaw,
    pub(crate) friction: Friction,
    pub(crate) control: Control,
    pub(crate) nuisances: Nuisances,
}

impl Way<'_> {
    /// The contact that is meant.
    pub(crate) fn contact(&self, direction: Direction, angle_deg: f64) -> Contact {
        self.contact_at(direction, angle_deg, INDENTATION_MM)
    }

    fn contact_at(&self, direction: Direction, angle_deg: f64, depth_mm: f64) -> Contact {
        // An error of the tilt beyond upright leans the other way.
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

    /// The shift that a touch reads, Hz; it may be negative where noise is all there is.
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
        // Drawn always, so that one nuisance does not change the draws of another.
        let [of_shift, of_depth, of_angle, of_young] = std::array::from_fn(|_| random.normal());
        let angle = angle_deg + tilt_deg * of_angle;
        let aside = side * eccentricity_mm * angle.to_radians().tan();
        // Deeper than the contact law is as deep as the law.
        let deepest = self.law.depth_limit_rel() * self.models.sensor().design().probe_radius_mm
            / angle.to_radians().cos();
        let depth = (INDENTATION_MM + depth_mm * of_depth + aside).min(0.999_999 * deepest);
        let young = young_mpa * (young_rel * of_young).exp();
        let contact = self.contact_at(direction, angle, depth);
        let found = self.models.predict(self.tier, &tissue(young), &contact).expect(
            "depths are kept within the law, and samples are softer than the tiers' limits",
        );
        found.shift_hz + shift_hz * of_shift
    }

    /// The shift without any error, Hz.
    pub(crate) fn exact_hz(&self, young_mpa: f64, direction: Direction, angle_deg: f64) -> f64 {
        self.models
            .predict(self.tier, &tissue(young_mpa), &self.contact(direction, angle_deg))
            .expect("the paper's contacts are within every tier")
            .shift_hz
    }
}
