//! The depth of touches with the error of the linear screw taken out of it, where a calibration that the run cites has
//! measured it.

use rig_analysis::{
    screw::{NoScrewMap, ScrewMap, Way},
    stiffness::{Halfway, PosedTouch},
};
use rig_contact::Depth;
use rig_record::{CitedCalibration, Touch};

use crate::data::{Part, RunData};

/// The maps of the screw of a run.
#[derive(Debug)]
pub(super) struct Depths<'a> {
    data: &'a RunData,
    /// That of each part of the run, if it cites one.
    maps: Vec<Option<(&'a CitedCalibration, ScrewMap)>>,
}

/// What the map of the screw does to the depths of a run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MappedDepths {
    /// Name of the file of the calibration; of several, their names.
    pub(crate) file: String,
    /// Touches whose depth is on the map, and all touches.
    pub(crate) touches: [usize; 2],
    /// The smallest and the largest error that is taken out of a depth, mm.
    pub(crate) errors_mm: [f64; 2],
    /// Root mean square of the standard deviations that are left, mm.
    pub(crate) sigma_mm: f64,
}

impl<'a> Depths<'a> {
    /// The maps that a run cites.
    pub(super) fn of(data: &'a RunData) -> Result<Self, NoScrewMap> {
        let map = |part: &'a Part| {
            let mut cited = part.calibrations.iter();
            let cited = cited.find_map(|cited| Some((cited, cited.screw.as_ref()?)));
            let read = cited.map(|(cited, map)| {
                let map = ScrewMap::new(&map.heights_mm, &map.errors_mm, &map.covariance_um2)?;
                Ok((cited, map))
            });
            read.transpose()
        };
        Ok(Self { data, maps: data.parts.iter().map(map).collect::<Result<_, _>>()? })
    }

    /// The map on which a touch rests.
    fn map_of(&self, touch: &Touch) -> Option<&(&'a CitedCalibration, ScrewMap)> {
        self.maps.get(self.data.part_of(touch))?.as_ref()
    }

    /// The way of a touch on the map; `None` without a map, or outside of it. The way to half of the depth is on it as
    /// well, because it lies between.
    fn way(&self, touch: &Touch) -> Option<(&ScrewMap, Way)> {
        let (_, map) = self.map_of(touch)?;
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
    /// It is zero where a touch is not on the map, and between touches on two maps.
    pub(super) fn correlation(&self, touches: &[&Touch], surface_mm: f64) -> Option<Vec<Vec<f64>>> {
        self.maps.iter().find(|map| map.is_some())?;
        let ways: Vec<Option<(&str, Way, f64)>> = touches
            .iter()
            .map(|touch| {
                let (cited, _) = self.map_of(touch)?;
                let (map, way) = self.way(touch)?;
                Some((cited.sha256.as_str(), way, map.sigma_mm(&way).hypot(surface_mm)))
            })
            .collect();
        let entry = |(first, a): (&&Touch, &Option<(&str, Way, f64)>), b: &Option<_>| {
            let (Some((of_map, a, of_a)), Some((of_other, b, of_b))) = (a, b) else { return 0.0 };
            match self.map_of(first) {
                Some((_, map)) if of_map == of_other && of_a * of_b > 0.0 => {
                    map.covariance_mm2(a, b) / (of_a * of_b)
                }
                _ => 0.0,
            }
        };
        let row = |first| ways.iter().map(|b| entry(first, b)).collect();
        Some(touches.iter().zip(&ways).map(row).collect())
    }

    /// What the maps do to these touches; `None` without a map.
    pub(super) fn summary(&self, touches: &[Touch]) -> Option<MappedDepths> {
        let mut files: Vec<&str> =
            self.maps.iter().flatten().map(|(cited, _)| cited.file.as_str()).collect();
        files.dedup();
        if files.is_empty() {
            return None;
        }
        let ways: Vec<(&ScrewMap, Way)> =
            touches.iter().filter_map(|touch| self.way(touch)).collect();
        let errors = ways.iter().map(|(_, way)| [way.error_mm; 2]);
        let range = errors.reduce(|[least, most], [error, _]| [least.min(error), most.max(error)]);
        let squares: f64 = ways.iter().map(|(map, way)| map.sigma_mm(way).powi(2)).sum();
        Some(MappedDepths {
            file: files.join(" and "),
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
