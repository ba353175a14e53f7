//! The depth of touches with the error of the linear screw taken out of it, where a calibration that the run cites has
//! measured it.

use rig_analysis::{
    screw::{NoScrewMap, ScrewMap, Way},
    stiffness::{Halfway, PosedTouch},
};
use rig_contact::Depth;
use rig_record::{CitedCalibration, RunStarted, Touch};

/// The map of the screw of a run.
#[derive(Debug)]
pub(super) struct Depths<'a> {
    cited: Option<(&'a CitedCalibration, ScrewMap)>,
}

/// What the map of the screw does to the depths of a run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MappedDepths {
    /// Name of the file of the calibration.
    pub(crate) file: String,
    /// Touches whose depth is on the map, and all touches.
    pub(crate) touches: [usize; 2],
    /// The smallest and the largest error that is taken out of a depth, mm.
    pub(crate) errors_mm: [f64; 2],
    /// Root mean square of the standard deviations that are left, mm.
    pub(crate) sigma_mm: f64,
}

impl<'a> Depths<'a> {
    /// The map that a run cites.
    pub(super) fn of(started: &'a RunStarted) -> Result<Self, NoScrewMap> {
        let cited =
            started.calibrations.iter().find_map(|cited| Some((cited, cited.screw.as_ref()?)));
        let Some((cited, map)) = cited else { return Ok(Self { cited: None }) };
        let map = ScrewMap::new(&map.heights_mm, &map.errors_mm, &map.covariance_um2)?;
        Ok(Self { cited: Some((cited, map)) })
    }

    /// The way of a touch on the map; `None` without a map, or outside of it. The way to half of the depth is on it as
    /// well, because it lies between.
    fn way(&self, touch: &Touch) -> Option<(&ScrewMap, Way)> {
        let (_, map) = self.cited.as_ref()?;
        Some((map, map.way(touch.surface_mm, touch.linear_mm)?))
    }

    /// The touch with its true depth.
    pub(super) fn correct(&self, touch: &Touch, posed: PosedTouch) -> PosedTouch {
        let Some((map, way)) = self.way(touch) else { return posed };
        let depth = match posed.depth {
            Depth::Indentation { along_probe_mm } => {
                Depth::Indentation { along_probe_mm: along_probe_mm - way.error_mm }
            }
            Depth::Stage { along_probe_mm } => {
                Depth::Stage { along_probe_mm: along_probe_mm - way.error_mm }
            }
        };
        let halfway = posed.halfway.zip(touch.halfway).and_then(|(posed, halfway)| {
            let way = map.way(touch.surface_mm, halfway.linear_mm)?;
            Some(Halfway { along_probe_mm: posed.along_probe_mm - way.error_mm, ..posed })
        });
        PosedTouch { depth, halfway, stage_sigma_mm: Some(map.sigma_mm(&way)), ..posed }
    }

    /// Correlation of the depths of touches whose surfaces have this standard deviation, mm; `None` without a map.
    /// It is zero where a touch is not on the map.
    pub(super) fn correlation(&self, touches: &[&Touch], surface_mm: f64) -> Option<Vec<Vec<f64>>> {
        let (_, map) = self.cited.as_ref()?;
        let ways: Vec<Option<(Way, f64)>> = touches
            .iter()
            .map(|touch| {
                let (map, way) = self.way(touch)?;
                Some((way, map.sigma_mm(&way).hypot(surface_mm)))
            })
            .collect();
        let entry = |a: &Option<(Way, f64)>, b: &Option<(Way, f64)>| match (a, b) {
            (Some((a, of_a)), Some((b, of_b))) if of_a * of_b > 0.0 => {
                map.covariance_mm2(a, b) / (of_a * of_b)
            }
            _ => 0.0,
        };
        Some(ways.iter().map(|a| ways.iter().map(|b| entry(a, b)).collect()).collect())
    }

    /// What the map does to these touches; `None` without a map.
    pub(super) fn summary(&self, touches: &[Touch]) -> Option<MappedDepths> {
        let (cited, map) = self.cited.as_ref()?;
        let ways: Vec<Way> = touches.iter().filter_map(|touch| Some(self.way(touch)?.1)).collect();
        let errors = ways.iter().map(|way| [way.error_mm; 2]);
        let range = errors.reduce(|[least, most], [error, _]| [least.min(error), most.max(error)]);
        let squares: f64 = ways.iter().map(|way| map.sigma_mm(way).powi(2)).sum();
        Some(MappedDepths {
            file: cited.file.clone(),
            touches: [ways.len(), touches.len()],
            errors_mm: range.unwrap_or_default(),
            sigma_mm: (squares / ways.len().max(1) as f64).sqrt(),
        })
    }
}

impl MappedDepths {
    /// What was taken out of the depths, as a sentence.
    pub(crate) fn sentence(&self) -> String {
        let Self { file, touches: [mapped, all], errors_mm: [least, most], sigma_mm } = self;
        format!(
            "the error of the screw by {file} is taken out of {mapped} of {all}: {:+.1} to {:+.1} µm, known to {:.1} µm",
            1e3 * least,
            1e3 * most,
            1e3 * sigma_mm,
        )
    }
}
