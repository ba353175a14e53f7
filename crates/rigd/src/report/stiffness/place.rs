//! Touches whose angle is not known: those of one sample at one angle are one place, probed from
//! several directions as if the probe had been turned about its own axis.

use rig_analysis::stiffness::{Compensation, PosedTouch};
use rig_contact::inverse::{InverseError, SiteTouch, TiltInference};

/// What the touches of a place say together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::report) struct Place {
    /// Which sample it was.
    pub(in crate::report) sample: usize,
    /// The angle that was set, which took no part in the inference, degrees.
    pub(in crate::report) angle_deg: f64,
    /// Which repeat it was.
    pub(in crate::report) repeat: u32,
    /// How many touches it had.
    pub(in crate::report) touches: usize,
    /// Stiffness as the model reads it, angle and azimuth; or why they are refused.
    pub(in crate::report) found: Result<TiltInference, InverseError>,
}

impl Place {
    /// Whether a touch of this sample belongs to the place.
    pub(super) fn holds(&self, touch: &rig_record::Touch, sample: usize) -> bool {
        let settings = &touch.touch;
        (self.sample, self.angle_deg, self.repeat)
            == (sample, settings.pose.angle_deg, settings.repeat)
    }
}

/// A touch of the main phase with its repeat.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probed {
    pub(super) touch: PosedTouch,
    pub(super) angle_deg: f64,
    pub(super) repeat: u32,
}

/// How places are read.
#[derive(Debug)]
pub(super) struct Unknown<'a> {
    pub(super) compensation: &'a Compensation,
    /// Of the stiffness from one point of a sample to the next, relative.
    pub(super) sample_rel: f64,
    /// The largest angle that there may be.
    pub(super) max_angle_rad: f64,
}

impl Unknown<'_> {
    /// The places of the main phase, ordered by sample, angle and repeat.
    pub(super) fn places(&self, mut touches: Vec<Probed>) -> Vec<Place> {
        let key = |one: &Probed| (one.touch.sample, one.angle_deg, one.repeat);
        // Stable, so that directions stay in the order in which they were touched.
        touches.sort_by(|a, b| {
            (a.touch.sample.cmp(&b.touch.sample))
                .then(a.angle_deg.total_cmp(&b.angle_deg))
                .then(a.repeat.cmp(&b.repeat))
        });
        let place = |probed: &[Probed]| Place {
            sample: probed[0].touch.sample,
            angle_deg: probed[0].angle_deg,
            repeat: probed[0].repeat,
            touches: probed.len(),
            found: self.infer(probed.iter().map(|probed| &probed.touch)),
        };
        touches.chunk_by(|a, b| key(a) == key(b)).map(place).collect()
    }

    /// What touches of one place say together.
    pub(super) fn infer<'a>(
        &self,
        touches: impl IntoIterator<Item = &'a PosedTouch>,
    ) -> Result<TiltInference, InverseError> {
        let touch = |touch: &PosedTouch| SiteTouch {
            shift_hz: touch.shift_hz,
            // Each direction touches a point of its own. No shift grows faster than stiffness does.
            sigma_hz: touch.sigma_hz.hypot(self.sample_rel * touch.shift_hz),
            // A surface that leans to the left looks to the front when the probe has turned there.
            spin_rad: -touch.pose.azimuth_rad(),
            depth: touch.depth,
        };
        let touches: Vec<SiteTouch> = touches.into_iter().map(touch).collect();
        self.compensation.of_site(&touches, self.max_angle_rad)
    }
}
