//! Stiffness from shifts, with compensation of the contact angle.
//!
//! Each touch at a known angle gives a stiffness; those of one sample are averaged. A site at an
//! unknown angle needs several touches, each with the probe turned.

use rig_contact::{
    Contact, ContactLaw, Depth, Friction, Models, Pose, Refusal, Requirements, SensorDescription,
    Tier, Tissue,
    inverse::{
        AnglePrior, AzimuthPrior, InverseError, OneTouch, SiteTouch, TiltInference, TissueKind,
        TouchModel, TouchSigmas, infer_tilt,
    },
};

/// The model for the stiffness of touches, and the uncertainty of the touches.
#[derive(Debug, Clone, PartialEq)]
pub struct Compensation {
    /// Models of the sensor for `law`.
    pub models: Models,
    /// Model of the vibration.
    pub tier: Tier,
    /// Law of contact radius and force.
    pub law: ContactLaw,
    /// Behaviour along the surface.
    pub friction: Friction,
    /// Assumed properties of every sample.
    pub kind: TissueKind,
    /// Standard deviation of the depth error that the touches of one site share, mm.
    pub shared_depth_sigma_mm: f64,
    /// Standard deviation of the independent depth error of each touch, mm.
    pub depth_sigma_mm: f64,
    /// The part of it that is due to the surface found, mm.
    pub surface_sigma_mm: f64,
    /// Standard deviation of the contact angle, rad.
    pub angle_sigma_rad: f64,
}

/// One touch at a known pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosedTouch {
    /// Index of the sample.
    pub sample: usize,
    /// Pose of the probe against the surface.
    pub pose: Pose,
    /// Depth along the probe.
    pub depth: Depth,
    /// Resonance in contact less the no-load resonance, Hz.
    pub shift_hz: f64,
    /// Standard deviation of the shift, Hz.
    pub sigma_hz: f64,
    /// The part of it that is due to the reference, Hz.
    pub reference_sigma_hz: f64,
    /// The measurement on the way to the depth, if there was one.
    pub halfway: Option<Halfway>,
    /// Standard deviation of the depth by the linear stage, mm, where the error of its screw was measured and taken
    /// out; `None` where it is that of the description.
    pub stage_sigma_mm: Option<f64>,
}

/// The measurement of a touch at a smaller depth, at the same point and with the same reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Halfway {
    /// Depth along the probe, mm.
    pub along_probe_mm: f64,
    /// Resonance there less the no-load resonance, Hz.
    pub shift_hz: f64,
    /// Standard deviation of that resonance, Hz.
    pub sigma_hz: f64,
}

impl PosedTouch {
    /// The depth along the probe, mm.
    pub(crate) const fn along_probe_mm(&self) -> f64 {
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) = self.depth;
        along_probe_mm
    }

    /// The depth along the surface's normal, mm.
    pub(crate) fn normal_depth_mm(&self) -> f64 {
        self.along_probe_mm() * self.pose.cos()
    }

    /// The touch as it was halfway, if it was measured there.
    pub(crate) fn at_halfway(&self) -> Option<Self> {
        let Halfway { along_probe_mm, shift_hz, sigma_hz } = self.halfway?;
        let depth = match self.depth {
            Depth::Indentation { .. } => Depth::Indentation { along_probe_mm },
            Depth::Stage { .. } => Depth::Stage { along_probe_mm },
        };
        let sigma_hz = sigma_hz.hypot(self.reference_sigma_hz);
        Some(Self { depth, shift_hz, sigma_hz, halfway: None, ..*self })
    }
}

/// How the stiffness of a touch depends on what is measured, before it is made. All are relative to the stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchSensitivity {
    /// Change with the shift, 1/Hz.
    pub per_hz: f64,
    /// Change with the depth below the surface, 1/mm.
    pub per_mm: f64,
    /// Standard deviation due to the depth, as the description of the sensor states it.
    pub of_depth: f64,
    /// Standard deviation due to the contact angle.
    pub of_angle: f64,
}

/// A stiffness with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Young {
    /// Young's modulus, MPa.
    pub mpa: f64,
    /// Standard deviation, MPa.
    pub sigma_mpa: f64,
}

/// The stiffness of a sample from all of its touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleStiffness {
    /// Index of the sample.
    pub sample: usize,
    /// Weighted mean of Young's modulus, MPa.
    pub young_mpa: f64,
    /// Standard deviation of the mean, propagated from the touches, MPa.
    pub sigma_mpa: f64,
    /// Standard deviation of the touches about the mean, MPa; `None` for a single touch. It includes
    /// the variation over the sample.
    pub spread_mpa: Option<f64>,
    /// Number of touches or sites with a stiffness.
    pub touches: usize,
    /// Number of refused touches or sites.
    pub refused: usize,
}

impl SampleStiffness {
    /// The mean over the touches or sites of a sample; `None` when all were refused.
    pub fn mean(sample: usize, found: &[Young], refused: usize) -> Option<Self> {
        let weight = |one: &Young| (one.mpa / one.sigma_mpa).powi(2);
        let sum: f64 = found.iter().map(weight).sum();
        if found.is_empty() {
            return None;
        }
        // Errors are relative, and so are the weights: a small value is not more certain.
        let mean = found.iter().map(|one| weight(one) * one.mpa).sum::<f64>() / sum;
        let squares = found.iter().map(|one| (one.mpa - mean).powi(2)).sum::<f64>();
        let freedom = found.len() as f64 - 1.0;
        Some(Self {
            sample,
            young_mpa: mean,
            sigma_mpa: mean / sum.sqrt(),
            spread_mpa: (found.len() > 1).then(|| (squares / freedom).sqrt()),
            touches: found.len(),
            refused,
        })
    }
}

/// Allowed difference of the tier from the reference, Hz: the scatter of a touch on a quiet bench.
const TIER_TOLERANCE_HZ: f64 = 0.3;
/// The stiffest contact for which the tier is chosen, over the stiffness of the sensor's tip: that of the
/// paper's stiffest sample.
const STIFFEST_RATIO: f64 = 1.7;
/// The largest contact angle for which the tier is chosen.
const TILT_MAX_DEG: f64 = 45.0;

/// The cheapest tier for samples up to 1.7 times the stiffness of the sensor, indented by the radius of
/// the ball. A run may learn that the stage holds the depth, so that the tier takes both kinds of depth.
fn cheapest_tier(sensor: &SensorDescription) -> Tier {
    let along_probe_mm = sensor.sensor.design().probe_radius_mm;
    let friction = match sensor.friction {
        // A slip at some angle is no reason for another tier.
        Friction::Coulomb { .. } => Friction::Sticking,
        other => other,
    };
    let contact = Contact {
        pose: Pose::UPRIGHT,
        depth: Depth::Indentation { along_probe_mm },
        law: sensor.law,
        friction,
    };
    let cheapest = |deepest: Depth| {
        let load = sensor.sensor.load(&sensor.tissue(1.0).ok()?, &contact).ok()?;
        let of_one_mpa = Models::new(&sensor.sensor, sensor.law).stiffness_ratio(&load);
        let required = Requirements {
            sensor: sensor.sensor,
            stiffest: sensor.tissue(STIFFEST_RATIO / of_one_mpa).ok()?,
            deepest,
            law: sensor.law,
            friction,
            tilt_max_rad: TILT_MAX_DEG.to_radians(),
            needs_impedance: false,
        };
        Some(Tier::cheapest_for(&required, TIER_TOLERANCE_HZ).ok()?.tier)
    };
    let by_stage = cheapest(Depth::Stage { along_probe_mm });
    let dearer = cheapest(contact.depth).max(by_stage);
    // A sensor that the reference does not take to this stiffness is left to one element.
    dearer.filter(|tier| tier.validity().takes_stage_moves).unwrap_or(Tier::E1s)
}

impl Compensation {
    /// The model for touches of this sensor whose surfaces were found with this standard deviation,
    /// mm.
    pub fn new(sensor: &SensorDescription, surface_sigma_mm: f64) -> Self {
        Self {
            models: Models::new(&sensor.sensor, sensor.law),
            tier: cheapest_tier(sensor),
            law: sensor.law,
            friction: sensor.friction,
            kind: sensor.kind,
            // The surface is found again for every touch.
            shared_depth_sigma_mm: 0.0,
            depth_sigma_mm: sensor.uncertainty.depth_mm.hypot(surface_sigma_mm),
            surface_sigma_mm,
            angle_sigma_rad: sensor.uncertainty.angle_deg.to_radians(),
        }
    }

    /// The same for sites of touches with these depths: their standard deviation is the root mean square of those of
    /// all touches.
    #[must_use]
    pub fn at_depths_of(self, touches: &[PosedTouch]) -> Self {
        if touches.iter().all(|touch| touch.stage_sigma_mm.is_none()) {
            return self;
        }
        let squares: f64 = touches.iter().map(|touch| self.sigma_of_depth_mm(touch).powi(2)).sum();
        Self { depth_sigma_mm: (squares / touches.len() as f64).sqrt(), ..self }
    }

    /// Resonance of the free sensor, Hz.
    pub fn no_load_hz(&self) -> f64 {
        self.models.no_load_hz(self.tier)
    }

    /// The stiffness of one touch.
    ///
    /// # Errors
    /// [`InverseError`].
    pub fn of_touch(&self, touch: &PosedTouch) -> Result<OneTouch, InverseError> {
        let PosedTouch { pose, depth, shift_hz, sigma_hz, .. } = *touch;
        let Self { tier, law, friction, kind, .. } = *self;
        let contact = Contact { pose, depth, law, friction };
        let spread = TouchSigmas {
            shift_hz: sigma_hz,
            depth_mm: self.sigma_of_depth_mm(touch),
            angle_rad: self.angle_sigma_rad,
        };
        self.models.stiffness_of_touch(tier, shift_hz, spread, kind, &contact)
    }

    /// How the stiffness of a touch depends on what is measured, for a sample of this stiffness, to first order.
    ///
    /// # Errors
    /// [`InverseError`] outside of the model.
    pub fn sensitivity(
        &self,
        pose: Pose,
        depth: Depth,
        young_mpa: f64,
    ) -> Result<TouchSensitivity, InverseError> {
        // Small against every limit of the inverse; only the ratio counts.
        const SMALL: f64 = 1e-6;
        let Self { tier, law, friction, kind, .. } = *self;
        let contact = Contact { pose, depth, law, friction };
        let tissue = Tissue::new(young_mpa, kind.poisson, kind.loss)?;
        let shift_hz = self.models.predict(tier, &tissue, &contact)?.shift_hz;
        let small = TouchSigmas { shift_hz: SMALL, depth_mm: SMALL, angle_rad: SMALL };
        let one = self.models.stiffness_of_touch(tier, shift_hz, small, kind, &contact)?;
        let relative = |sigma_mpa: f64| sigma_mpa / SMALL / one.young_mpa;
        let per_mm = relative(one.sigma_of_depth_mpa);
        Ok(TouchSensitivity {
            per_hz: relative(one.sigma_of_shift_mpa),
            per_mm,
            of_depth: per_mm * self.sigma_of_one_depth_mm(),
            of_angle: relative(one.sigma_of_angle_mpa) * self.angle_sigma_rad,
        })
    }

    /// Standard deviation of the depth of this touch, mm.
    pub(crate) fn sigma_of_depth_mm(&self, touch: &PosedTouch) -> f64 {
        let stage_mm = |stage_mm: f64| stage_mm.hypot(self.surface_sigma_mm);
        touch.stage_sigma_mm.map_or_else(|| self.sigma_of_one_depth_mm(), stage_mm)
    }

    /// Standard deviation of the depth of one touch by the description, mm.
    fn sigma_of_one_depth_mm(&self) -> f64 {
        self.shared_depth_sigma_mm.hypot(self.depth_sigma_mm)
    }

    /// The logarithm of the stiffness of one touch in MPa, without its uncertainty.
    ///
    /// # Errors
    /// [`InverseError`].
    pub(crate) fn log_young(&self, touch: &PosedTouch) -> Result<f64, InverseError> {
        let Self { tier, law, friction, kind, .. } = *self;
        let contact = Contact { pose: touch.pose, depth: touch.depth, law, friction };
        Ok(self.models.young_of_shift_mpa(tier, touch.shift_hz, kind, &contact)?.ln())
    }

    /// The shift of a touch of this stiffness by the model, Hz; `None` outside of the model.
    pub(crate) fn shift_hz(&self, touch: &PosedTouch, young_mpa: f64) -> Option<f64> {
        let Self { tier, law, friction, kind, .. } = *self;
        let contact = Contact { pose: touch.pose, depth: touch.depth, law, friction };
        let tissue = Tissue::new(young_mpa, kind.poisson, kind.loss).ok()?;
        Some(self.models.predict(tier, &tissue, &contact).ok()?.shift_hz)
    }

    /// The logarithm of the depth at rest over the depth set, both along the normal; `None` outside of the
    /// model.
    pub(crate) fn log_sunk(&self, touch: &PosedTouch, young_mpa: f64) -> Option<f64> {
        let Self { law, friction, kind, .. } = *self;
        let contact = Contact { pose: touch.pose, depth: touch.depth, law, friction };
        let tissue = Tissue::new(young_mpa, kind.poisson, kind.loss).ok()?;
        let load = self.models.sensor().load(&tissue, &contact).ok()?;
        Some((load.depth_mm / touch.normal_depth_mm()).ln())
    }

    /// The friction that a touch needs to stick; `None` outside of the model.
    pub(crate) fn needed_friction(&self, touch: &PosedTouch, young_mpa: f64) -> Option<f64> {
        let Self { law, kind, .. } = *self;
        // No contact holds without friction, and its refusal says what it needs.
        let friction = Friction::Coulomb { coefficient: 0.0 };
        let contact = Contact { pose: touch.pose, depth: touch.depth, law, friction };
        let tissue = Tissue::new(young_mpa, kind.poisson, kind.loss).ok()?;
        match self.models.sensor().load(&tissue, &contact) {
            Err(Refusal::Slips { needed, .. }) => Some(needed),
            _ => None,
        }
    }

    /// The tangential over the normal contact stiffness.
    pub(crate) fn tangential_ratio(&self) -> f64 {
        match self.friction {
            Friction::Sticking | Friction::Coulomb { .. } => self.kind.tangential_ratio(),
            Friction::Elastic { tangential_ratio } => tangential_ratio,
            Friction::Frictionless => 0.0,
        }
    }

    /// The stiffness of each sample, ordered by sample. Samples without a usable touch are left out.
    pub fn by_sample(&self, touches: &[PosedTouch]) -> Vec<SampleStiffness> {
        let mut touches = touches.to_vec();
        // The sort is stable: touches stay in their order.
        touches.sort_by_key(|touch| touch.sample);
        touches
            .chunk_by(|a, b| a.sample == b.sample)
            .filter_map(|touches| {
                let found: Vec<Young> = touches
                    .iter()
                    .filter_map(|touch| self.of_touch(touch).ok())
                    .map(|one| Young { mpa: one.young_mpa, sigma_mpa: one.sigma_mpa })
                    .collect();
                SampleStiffness::mean(touches[0].sample, &found, touches.len() - found.len())
            })
            .collect()
    }

    /// Stiffness, angle and azimuth of one site at an unknown angle of at most `max_angle_rad`, from
    /// touches at different depths or spins of the probe.
    ///
    /// # Errors
    /// [`InverseError`].
    pub fn of_site(
        &self,
        touches: &[SiteTouch],
        max_angle_rad: f64,
        azimuth: AzimuthPrior,
    ) -> Result<TiltInference, InverseError> {
        let Self { tier, law, friction, kind, shared_depth_sigma_mm, depth_sigma_mm, .. } = *self;
        let touch_model =
            TouchModel { tier, law, friction, kind, shared_depth_sigma_mm, depth_sigma_mm };
        let angle = AnglePrior::Within { max_rad: max_angle_rad };
        infer_tilt(&self.models, touches, &touch_model, angle, azimuth)
    }
}

#[cfg(test)]
mod tests {
    use rig_contact::{Direction, inverse::ShiftSigmas};

    use super::*;

    const MOVED: Depth = Depth::Stage { along_probe_mm: 0.5 };

    fn compensation() -> Compensation {
        Compensation {
            shared_depth_sigma_mm: 0.02,
            depth_sigma_mm: 0.002,
            ..Compensation::new(&SensorDescription::reference(), 0.0)
        }
    }

    /// Touches of a sample in all directions and angles, read by a finer model.
    fn touches(compensation: &Compensation, sample: usize, young_mpa: f64) -> Vec<PosedTouch> {
        let tissue = rig_contact::Tissue::soft(young_mpa).unwrap();
        let mut touches = Vec::new();
        for direction in Direction::ALL {
            for degrees in [0.0_f64, 15.0, 30.0, 45.0] {
                let pose = Pose::leaning(direction, degrees.to_radians()).unwrap();
                let contact = Contact::new(pose, MOVED);
                let shift_hz = compensation
                    .models
                    .predict(Tier::Reference, &tissue, &contact)
                    .unwrap()
                    .shift_hz;
                touches.push(PosedTouch {
                    sample,
                    pose,
                    depth: MOVED,
                    shift_hz,
                    sigma_hz: 0.3,
                    reference_sigma_hz: 0.0,
                    halfway: None,
                    stage_sigma_mm: None,
                });
            }
        }
        touches
    }

    /// The stiffness that a touch states has the parts that the sensitivity promises.
    #[test]
    fn the_sensitivity_is_that_of_the_touches() {
        let compensation = compensation();
        for touch in touches(&compensation, 0, 0.235) {
            let of = compensation.sensitivity(touch.pose, touch.depth, 0.235).unwrap();
            let found = compensation.of_touch(&touch).unwrap();
            let pairs = [
                (of.per_hz * touch.sigma_hz, found.sigma_of_shift_mpa),
                (of.of_depth, found.sigma_of_depth_mpa),
                (of.of_angle, found.sigma_of_angle_mpa),
            ];
            for (promised, sigma_mpa) in pairs {
                let stated = sigma_mpa / found.young_mpa;
                assert!((promised - stated).abs() < 0.01 * stated.max(1e-6), "{of:?} {found:?}");
            }
        }
        assert!(compensation.sensitivity(Pose::UPRIGHT, MOVED, -1.0).is_err());
    }

    /// The shifts fall by a fifth over these angles; the stiffness does not.
    #[test]
    fn the_angle_is_compensated_within_a_percent() {
        let compensation = compensation();
        let mut all = Vec::new();
        for (sample, young_mpa) in [0.045, 0.104, 0.235, 0.320, 0.649].into_iter().enumerate() {
            all.extend(touches(&compensation, sample, young_mpa));
        }
        all.reverse();
        let found = compensation.by_sample(&all);
        assert_eq!(found.len(), 5);
        for (stiffness, expected) in found.iter().zip([0.045, 0.104, 0.235, 0.320, 0.649]) {
            assert!((stiffness.young_mpa / expected - 1.0).abs() < 0.005, "{stiffness:?}");
            assert!(stiffness.spread_mpa.unwrap() / expected < 0.005, "{stiffness:?}");
            assert!(stiffness.sigma_mpa / expected < 0.02, "{stiffness:?}");
            assert_eq!((stiffness.touches, stiffness.refused), (12, 0));
        }
    }

    /// Samples with a loss factor of 1 need the losses in the model, and no others do.
    #[test]
    fn the_tier_is_the_cheapest_for_the_samples_described() {
        let of_loss = |loss: f64| {
            let mut described = SensorDescription::reference();
            described.kind.loss = loss;
            Compensation::new(&described, 0.0).tier
        };
        assert_eq!(of_loss(0.1), Tier::E1s);
        assert_eq!(of_loss(1.0), Tier::Reference);
    }

    #[test]
    fn refused_touches_are_counted_and_a_sample_without_any_other_is_left_out() {
        let compensation = compensation();
        let mut of_one = touches(&compensation, 0, 0.235);
        of_one[0].shift_hz = -0.1;
        assert!(matches!(compensation.of_touch(&of_one[0]), Err(InverseError::NoContact { .. })));
        let found = compensation.by_sample(&of_one);
        assert_eq!((found[0].touches, found[0].refused), (11, 1));
        assert!(compensation.by_sample(&of_one[..1]).is_empty());
    }

    #[test]
    fn a_place_at_an_unknown_angle_is_read_from_four_spins() {
        let compensation = compensation();
        let tissue = rig_contact::Tissue::soft(0.32).unwrap();
        let spins = [0.0_f64, 90.0, 180.0, 270.0].map(|degrees| {
            let spin_rad = degrees.to_radians();
            let pose = Pose::new(0.4, 1.0 - spin_rad).unwrap();
            let contact = Contact::new(pose, MOVED);
            let shift_hz =
                compensation.models.predict(Tier::Reference, &tissue, &contact).unwrap().shift_hz;
            let sigmas = ShiftSigmas::of_resonance(0.1);
            SiteTouch { shift_hz, sigmas, spin_rad, depth: MOVED }
        });
        let found =
            compensation.of_site(&spins, 45.0_f64.to_radians(), AzimuthPrior::Unknown).unwrap();
        assert!(found.young_mpa.contains(0.32), "{found:?}");
        assert!(found.angle_rad.contains(0.4), "{found:?}");
        assert!(found.young_mpa.sigma / 0.32 < 0.04, "{found:?}");
    }
}
