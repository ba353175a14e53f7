//! The stiffness of one touch at a known angle.

use super::{InverseError, RELATIVE_SIGMA_MAX, TissueKind};
use crate::{
    Contact, ContactPatch, Depth, LawError, Load, Models, Pose, Refusal, Tier, Tissue, equilibrium,
    models::check_control, rest::Rest,
};

/// The standard deviations of the inputs of one touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchSigmas {
    /// Standard deviation of the shift, Hz.
    pub shift_hz: f64,
    /// Standard deviation of the depth along the probe, mm; mostly from the surface found.
    pub depth_mm: f64,
    /// Standard deviation of the contact angle, rad.
    pub angle_rad: f64,
}

/// A stiffness with its uncertainty, split by cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneTouch {
    /// Young's modulus, MPa.
    pub young_mpa: f64,
    /// Its standard deviation, MPa.
    pub sigma_mpa: f64,
    /// The part of the standard deviation due to the shift, MPa.
    pub sigma_of_shift_mpa: f64,
    /// The part due to the depth, MPa.
    pub sigma_of_depth_mpa: f64,
    /// The part due to the angle, MPa.
    pub sigma_of_angle_mpa: f64,
}

impl Models {
    /// The Young's modulus in MPa whose contact gives this shift by this tier.
    ///
    /// # Errors
    /// [`InverseError::NoContact`] for a shift or a depth that is not positive;
    /// [`InverseError::Refused`] when the stiffness lies outside the tier, as for a shift near
    /// saturation, or when the contact lies outside its law.
    pub fn young_of_shift_mpa(
        &self,
        tier: Tier,
        shift_hz: f64,
        kind: TissueKind,
        contact: &Contact,
    ) -> Result<f64, InverseError> {
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) =
            contact.depth;
        if !(shift_hz.is_finite() && shift_hz > 0.0 && along_probe_mm > 0.0) {
            return Err(InverseError::NoContact { shift_hz });
        }
        check_control(tier, contact)?;
        let tissue = kind.with(1.0)?;
        let normal = self.normal_of_shift(tier, shift_hz, &tissue, contact)?;
        let section = self.sensor().section();
        let patch = self.patch_of_stiffness(normal, contact).map_err(Refusal::from)?;
        self.check_turn(tier, &contact.pose, normal * force_m(section.radius_m, &patch))?;
        let of_one_mpa = 2.0 * tissue.contact_modulus_pa() * section.radius_m * patch.radius_rel;
        let young_mpa = normal / of_one_mpa;
        contact.check_grip(self.sensor(), &kind.with(young_mpa)?, patch.depth_rel)?;
        Ok(young_mpa)
    }

    /// The normal contact stiffness in N/m that gives this shift.
    fn normal_of_shift(
        &self,
        tier: Tier,
        shift_hz: f64,
        tissue: &Tissue,
        contact: &Contact,
    ) -> Result<f64, Refusal> {
        let tangential_ratio = contact.tangential_ratio(tissue);
        let radius_m = self.sensor().section().radius_m;
        let deepest = contact.law.at_valid(contact.law.depth_limit_rel());
        let shift = |normal: f64| {
            // A trial stiffness may rest deeper than the law holds.
            let patch = self.patch_of_stiffness(normal, contact).unwrap_or(deepest);
            let load = Load {
                normal_n_per_m: normal,
                tangential_n_per_m: normal * tangential_ratio,
                force_n: normal * force_m(radius_m, &patch),
                ..Load::NONE
            };
            self.shift_of_load(tier, tissue, &contact.pose, &load)
        };
        let limit = tier.validity().stiffness_ratio_max.min(STIFFEST_RATIO);
        let stiffest = limit * self.tip_n_per_m();
        if shift(stiffest) < shift_hz {
            return Err(Refusal::OutOfReach { tier, shift_hz, limit });
        }
        // Tier T2's inverse is closed and within a few percent where shifts are not saturated.
        let pose = &contact.pose;
        let guess = self.lumped().stiffness_of_tilted(pose, shift_hz, tangential_ratio);
        let start = guess.min(stiffest).ln();
        Ok(rising_root(|log| (shift(log.exp()) / shift_hz).ln(), start, stiffest.ln()).exp())
    }

    /// The contact with this normal stiffness, N/m.
    fn patch_of_stiffness(&self, normal: f64, contact: &Contact) -> Result<ContactPatch, LawError> {
        let section = self.sensor().section();
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) =
            contact.depth;
        let move_rel = along_probe_mm * 1e-3 * contact.pose.cos() / section.radius_m;
        match contact.depth {
            Depth::Indentation { .. } => contact.law.at(move_rel),
            Depth::Stage { .. } => {
                equilibrium::of_known_stiffness(contact.law, move_rel, |force_over_radius| {
                    let force_n = 0.5 * normal * section.radius_m * force_over_radius;
                    normal * Rest::of(section, &contact.pose, force_n).compliance_m_per_n
                })
            }
        }
    }

    /// The stiffness of one touch with its uncertainty, to first order in each input.
    ///
    /// # Errors
    /// As [`Models::young_of_shift_mpa`]; [`InverseError::TooUncertain`] when the standard deviation
    /// is more than half the value.
    pub fn stiffness_of_touch(
        &self,
        tier: Tier,
        shift_hz: f64,
        spread: TouchSigmas,
        kind: TissueKind,
        contact: &Contact,
    ) -> Result<OneTouch, InverseError> {
        let young_mpa = self.young_of_shift_mpa(tier, shift_hz, kind, contact)?;
        let slope = |of: &dyn Fn(f64) -> (f64, Contact), step: f64| {
            let at = |step: f64| -> Result<f64, InverseError> {
                let (young_mpa, contact) = of(step);
                Ok(self.predict(tier, &kind.with(young_mpa)?, &contact)?.shift_hz)
            };
            // One-sided: the contact may lie at the end of its law.
            Ok::<f64, InverseError>((at(0.0)? - at(-step)?) / step)
        };
        let per_log = slope(&|step| (young_mpa * step.exp(), *contact), LOG_STEP)?;
        let per_mm = slope(&|step| (young_mpa, deeper(contact, step)), DEPTH_STEP_MM)?;
        let per_rad = slope(&|step| (young_mpa, leaning(contact, step)), ANGLE_STEP_RAD)?;
        let [shift, depth, angle] =
            [spread.shift_hz, per_mm * spread.depth_mm, per_rad * spread.angle_rad]
                .map(|shift_hz| young_mpa * (shift_hz / per_log).abs());
        let sigma_mpa = shift.hypot(depth).hypot(angle);
        let relative = sigma_mpa / young_mpa;
        if relative.is_nan() || relative > RELATIVE_SIGMA_MAX {
            return Err(InverseError::TooUncertain { relative, limit: RELATIVE_SIGMA_MAX });
        }
        Ok(OneTouch {
            young_mpa,
            sigma_mpa,
            sigma_of_shift_mpa: shift,
            sigma_of_depth_mpa: depth,
            sigma_of_angle_mpa: angle,
        })
    }
}

/// The force of a contact over its normal stiffness, m.
fn force_m(radius_m: f64, patch: &ContactPatch) -> f64 {
    if patch.radius_rel == 0.0 {
        return 0.0;
    }
    0.5 * radius_m * patch.force_rel / patch.radius_rel
}

/// Steps of the numerical slopes, small against every scale of the models.
const LOG_STEP: f64 = 1e-5;
const DEPTH_STEP_MM: f64 = 1e-6;
const ANGLE_STEP_RAD: f64 = 1e-5;
/// For tiers without a limit: this stiffness clamps the end.
const STIFFEST_RATIO: f64 = 1e9;

fn deeper(contact: &Contact, by_mm: f64) -> Contact {
    let depth = match contact.depth {
        Depth::Indentation { along_probe_mm } => {
            Depth::Indentation { along_probe_mm: along_probe_mm + by_mm }
        }
        Depth::Stage { along_probe_mm } => Depth::Stage { along_probe_mm: along_probe_mm + by_mm },
    };
    Contact { depth, ..*contact }
}

/// The contact with another angle; a negative angle leans the surface the other way.
fn leaning(contact: &Contact, by_rad: f64) -> Contact {
    let angle = contact.pose.angle_rad() + by_rad;
    let azimuth = contact.pose.azimuth_rad();
    let azimuth = if angle < 0.0 { azimuth + std::f64::consts::PI } else { azimuth };
    let pose = Pose::new(angle.abs(), azimuth).unwrap_or(contact.pose);
    Contact { pose, ..*contact }
}

/// Largest last step of the logarithm. The remaining error is about its square.
const ROOT_TOLERANCE: f64 = 1e-8;
const ROOT_STEPS_MAX: u32 = 100;
/// e^−700 is near the smallest positive number.
const LOWEST_LOG: f64 = -700.0;

/// The root below `high` of a rising function whose slope is near one for small values.
fn rising_root(function: impl Fn(f64) -> f64, start: f64, mut high: f64) -> f64 {
    let mut low = LOWEST_LOG;
    let mut at = start;
    let mut before: Option<(f64, f64)> = None;
    for _ in 0..ROOT_STEPS_MAX {
        let value = function(at);
        if value < 0.0 {
            low = at;
        } else {
            high = at;
        }
        let slope = match before {
            Some((x, y)) if x != at && y != value => (value - y) / (at - x),
            _ => 1.0,
        };
        // A shift that rounds to zero has no logarithm.
        before = value.is_finite().then_some((at, value));
        let next = at - value / slope;
        let next = if low <= next && next <= high { next } else { 0.5 * (low + high) };
        let step = (next - at).abs();
        at = next;
        if step <= ROOT_TOLERANCE {
            break;
        }
    }
    at
}

#[cfg(test)]
mod tests;
