//! The two measurements of a touch that was also measured halfway.

use rig_contact::inverse::OneTouch;

use crate::stiffness::{Compensation, PosedTouch};

/// The logarithm of the stiffness of a touch less that of the same touch halfway.
pub(super) struct Difference {
    pub(super) log: f64,
    pub(super) variance: f64,
    /// The part of the variance from the depth.
    pub(super) depth_variance: f64,
    /// Change for 1 Hz of the reference.
    pub(super) per_hz: f64,
}

impl Difference {
    /// Point, reference, surface and angle are the same at both depths, so that only the differences of
    /// what they change are left. The resonance and the depth itself err independently.
    pub(super) fn of(
        model: &Compensation,
        touch: &PosedTouch,
        deep: &OneTouch,
        halfway: &PosedTouch,
        at: impl Fn(&PosedTouch) -> Option<OneTouch>,
    ) -> Option<Self> {
        let before = at(halfway)?;
        let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
        let own = |one: &OneTouch, touch: &PosedTouch| {
            let parts = [one.sigma_of_shift_mpa, one.sigma_of_depth_mpa, one.sigma_of_angle_mpa];
            let reference = share(touch.reference_sigma_hz, touch.sigma_hz);
            (parts.map(|part| part / one.young_mpa), reference)
        };
        let ([shift, depth, angle], reference) = own(deep, touch);
        let ([shift_0, depth_0, angle_0], reference_0) = own(&before, halfway);
        let surface = share(model.surface_sigma_mm, model.sigma_of_depth_mm(touch));
        let squares = |a: f64, b: f64, common: f64| {
            (a * a + b * b) * (1.0 - common * common) + (common * (a - b)).powi(2)
        };
        let depth_variance = squares(depth, depth_0, surface);
        let resonance = |shift: f64, reference: f64| shift * shift * (1.0 - reference * reference);
        let references = (shift * reference - shift_0 * reference_0).powi(2);
        let variance = resonance(shift, reference)
            + resonance(shift_0, reference_0)
            + references
            + depth_variance
            + (angle - angle_0).powi(2);
        let log = (deep.young_mpa / before.young_mpa).ln();
        let per_hz = shift / touch.sigma_hz - shift_0 / halfway.sigma_hz;
        Some(Self { log, variance, depth_variance, per_hz })
    }
}
