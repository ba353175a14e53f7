//! What the models of the sensor say of touches before they are made, for a protocol with an aim.

use std::cell::OnceCell;

use rig_analysis::{
    screw::{ScrewMap, Way},
    stiffness::Compensation,
};
use rig_contact::Pose;
use rig_protocol::{ExpectedTouch, NoSensitivity, Sensitivity, TouchModel};

use crate::{calibrations, loaded_rig::RigFacts};

/// The sensor of a rig file, the samples that are known, and the error of the linear screw as a run would take it out.
#[derive(Debug)]
pub(crate) struct RigModel<'a> {
    rig: &'a RigFacts,
    // Both are made when they are first asked for: most protocols have no aim.
    compensation: OnceCell<Compensation>,
    screw: OnceCell<Option<Screw>>,
}

/// The map of the screw that a run would cite.
#[derive(Debug)]
struct Screw {
    file: String,
    map: ScrewMap,
}

impl<'a> RigModel<'a> {
    pub(crate) const fn new(rig: &'a RigFacts) -> Self {
        Self { rig, compensation: OnceCell::new(), screw: OnceCell::new() }
    }

    /// File of the calibration whose map was used; `None` if none was.
    pub(crate) fn screw_file(&self) -> Option<String> {
        Some(self.screw.get()?.as_ref()?.file.clone())
    }

    /// The standard deviation of the depth of a touch by the map of the screw, mm; `None` where the run would have that of
    /// the rig file.
    fn depth_sigma_mm(&self, touch: &ExpectedTouch<'_>) -> Option<f64> {
        let Screw { map, .. } = self.screw.get_or_init(|| Screw::of(self.rig)).as_ref()?;
        let position_mm = touch.surface_mm - touch.indentation_mm;
        let way: Way = map.way(touch.surface_mm, position_mm)?;
        Some(map.sigma_mm(&way))
    }
}

impl Screw {
    /// The map among the calibrations that hold now. Those that cannot be read are not cited by a run either.
    fn of(rig: &RigFacts) -> Option<Self> {
        let cited = calibrations::cited(&rig.basis, rig.data.as_deref()?).ok()?;
        let (file, map) = cited.into_iter().find_map(|cited| Some((cited.file, cited.screw?)))?;
        let map = ScrewMap::new(&map.heights_mm, &map.errors_mm, &map.covariance_um2).ok()?;
        Some(Self { file, map })
    }
}

impl TouchModel for RigModel<'_> {
    fn sensitivity(&self, touch: &ExpectedTouch<'_>) -> Result<Sensitivity, NoSensitivity> {
        let known = self.rig.stiffness_mpa.iter().find(|(name, _)| name == touch.sample);
        let young_mpa = known.map(|(_, mpa)| *mpa).or(touch.assumed_mpa);
        let young_mpa = young_mpa.ok_or(NoSensitivity::UnknownSample)?;
        let sensor = &self.rig.sensor;
        // The surface is a part of its own.
        let compensation = self.compensation.get_or_init(|| Compensation::new(sensor, 0.0));
        let pose = Pose::leaning(touch.pose.direction, touch.pose.angle.radians());
        let pose = pose.map_err(|_| NoSensitivity::OutsideModel)?;
        let depth = sensor.depth(touch.indentation_mm);
        let of = compensation.sensitivity(pose, depth, young_mpa);
        let of = of.map_err(|_| NoSensitivity::OutsideModel)?;
        let by_map = self.depth_sigma_mm(touch).map(|sigma_mm| of.per_mm * sigma_mm);
        Ok(Sensitivity {
            per_hz: of.per_hz,
            per_mm: of.per_mm,
            of_depth: by_map.unwrap_or(of.of_depth),
            of_angle: of.of_angle,
        })
    }
}
