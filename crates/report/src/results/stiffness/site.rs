//! Touches at an unknown angle: those of one sample at one angle and repeat are one site, touched
//! from several directions as if the probe had been turned about its own axis.

use rig_analysis::stiffness::{Compensation, PosedTouch};
use rig_contact::inverse::{AzimuthPrior, InverseError, ShiftSigmas, SiteTouch, TiltInference};

/// The result of the touches of a site together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Site {
    /// Index of the sample.
    pub(crate) sample: usize,
    /// The angle that was set, degrees. The inference does not use it.
    pub(crate) angle_deg: f64,
    /// Number of the repeat, from 1.
    pub(crate) repeat: u32,
    /// Number of touches.
    pub(crate) touches: usize,
    /// Stiffness before the calibration, angle and azimuth.
    pub(crate) found: Result<TiltInference, InverseError>,
}

impl Site {
    /// Whether a touch of this sample belongs to the site.
    pub(super) fn holds(&self, touch: &rig_record::Touch, sample: usize) -> bool {
        let settings = &touch.touch;
        (self.sample, self.angle_deg, self.repeat)
            == (sample, settings.pose.angle_deg, settings.repeat)
    }
}

/// A touch of the main phase with its repeat.
#[derive(Debug, Clone, Copy)]
pub(super) struct RepeatedTouch {
    pub(super) touch: PosedTouch,
    pub(super) angle_deg: f64,
    pub(super) repeat: u32,
}

/// The inference of stiffness, angle and azimuth.
#[derive(Debug)]
pub(super) struct UnknownAngle<'a> {
    pub(super) compensation: &'a Compensation,
    /// Standard deviation of the stiffness from one point of a sample to the next, relative.
    pub(super) sample_rel: f64,
    /// Largest possible angle, rad.
    pub(super) max_angle_rad: f64,
}

impl UnknownAngle<'_> {
    /// The sites of the main phase, ordered by sample, angle and repeat.
    pub(super) fn sites(&self, mut touches: Vec<RepeatedTouch>) -> Vec<Site> {
        let key = |one: &RepeatedTouch| (one.touch.sample, one.angle_deg, one.repeat);
        // The sort is stable: directions stay in the order in which they were touched.
        touches.sort_by(|a, b| {
            (a.touch.sample.cmp(&b.touch.sample))
                .then(a.angle_deg.total_cmp(&b.angle_deg))
                .then(a.repeat.cmp(&b.repeat))
        });
        let site = |touches: &[RepeatedTouch]| Site {
            sample: touches[0].touch.sample,
            angle_deg: touches[0].angle_deg,
            repeat: touches[0].repeat,
            touches: touches.len(),
            found: self.infer(touches.iter().map(|repeated| &repeated.touch)),
        };
        touches.chunk_by(|a, b| key(a) == key(b)).map(site).collect()
    }

    /// Stiffness, angle and azimuth from the touches of one site.
    pub(super) fn infer<'a>(
        &self,
        touches: impl IntoIterator<Item = &'a PosedTouch>,
    ) -> Result<TiltInference, InverseError> {
        let touch = |touch: &PosedTouch| SiteTouch {
            shift_hz: touch.shift_hz,
            sigmas: self.sigmas(touch),
            // A surface that leans to the left looks to the front when the probe has turned there.
            spin_rad: -touch.pose.azimuth_rad(),
            depth: touch.depth,
        };
        let touches: Vec<SiteTouch> = touches.into_iter().map(touch).collect();
        self.compensation.of_site(&touches, self.max_angle_rad, AzimuthPrior::Unknown)
    }

    fn sigmas(&self, touch: &PosedTouch) -> ShiftSigmas {
        let PosedTouch { shift_hz, sigma_hz, reference_sigma_hz, .. } = *touch;
        let reference_hz = reference_sigma_hz.min(sigma_hz);
        ShiftSigmas {
            resonance_hz: (sigma_hz * sigma_hz - reference_hz * reference_hz).sqrt(),
            reference_hz,
            // Each direction touches a point of its own. No shift grows faster than stiffness does.
            sample_hz: self.sample_rel * shift_hz.abs(),
        }
    }
}
