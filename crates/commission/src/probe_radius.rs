//! The radius of the ball from touches on a pin, judged against the rig file.

use rig_model::Geometry;

use crate::{
    Calibration, Change, Finding, Value, Verdict,
    finding::rounded,
    metrology::{NoGeometry, PinPrior, PinRadius, PinTouch, TouchNoise, fit_pin},
};

/// Standard uncertainty of the radius of a gauge pin, with its form and its axis beside the rotary axis by up to 1°, mm.
const PIN_MM: f64 = 0.001;

/// Largest relative standard uncertainty of a radius that is accepted: half as large a part of a stiffness.
const UNCERTAIN_REL: f64 = 0.05;

/// Largest relative difference from the rig file for which a change is asked. A larger one has another reason than the error
/// of a radius that somebody has measured: a pin of another radius is not told from a ball of another radius.
const OTHER_REL: f64 = 0.2;

/// Difference that is accepted beside twice the standard uncertainty, mm: a quarter of a percent of a stiffness.
const LENGTH_MM: f64 = 0.002;

/// Standard deviation of a length that the step `geometry` accepts, mm: half a millimetre, as likely here as there.
const BY_RULE_MM: f64 = 0.289;

/// What the rig file says, and a rule has shown in the step `geometry`.
pub fn prior_by_rule(geometry: &Geometry) -> PinPrior {
    let Geometry { surface, surface_above_pivot_mm, probe_radius_mm, .. } = geometry;
    let variance = BY_RULE_MM.powi(2);
    PinPrior {
        axis_mm: surface.value() - surface_above_pivot_mm - probe_radius_mm,
        probe_beside_pivot_mm: geometry.probe_beside_pivot_mm,
        // Two lengths make the height.
        covariance_mm2: [[2.0 * variance, 0.0], [0.0, variance]],
    }
}

/// What touches on blocks have shown, by their record with the same radius in the rig file; `None` for a record without
/// these values.
pub fn prior_by_blocks(blocks: &Calibration, probe_radius_mm: f64) -> Option<PinPrior> {
    let place = |name: &str| blocks.values.iter().position(|value| value.name == name);
    let at = [
        place("geometry.surface_mm")?,
        place("geometry.surface_above_pivot_mm")?,
        place("geometry.probe_beside_pivot_mm")?,
    ];
    let [surface, above, beside] = at.map(|at| blocks.values[at].value);
    let covariance = |i: usize, j: usize| Some(*blocks.covariance.get(at[i])?.get(at[j])?);
    let shared = covariance(0, 2)? - covariance(1, 2)?;
    Some(PinPrior {
        axis_mm: surface - above - probe_radius_mm,
        probe_beside_pivot_mm: beside,
        covariance_mm2: [
            [covariance(0, 0)? + covariance(1, 1)? - 2.0 * covariance(0, 1)?, shared],
            [shared, covariance(2, 2)?],
        ],
    })
}

/// Judges touches on a pin of radius `pin_mm` against the radius of the ball in the rig file. The values are the radius of
/// the ball, the place of the axis of the pin, and the probe beside the rotary axis.
///
/// # Errors
/// [`NoGeometry`].
pub fn probe_radius(
    touches: &[PinTouch],
    noise: &TouchNoise,
    prior: &PinPrior,
    (pin_mm, rig_file_mm): (f64, f64),
) -> Result<Finding, NoGeometry> {
    let found = fit_pin(touches, noise, prior, (pin_mm, rig_file_mm))?;
    let mut covariance = found.covariance_mm2;
    covariance[0][0] += PIN_MM.powi(2);
    let PinRadius {
        probe_radius_mm,
        pin_beside_pivot_mm,
        pin_above_pivot_mm,
        probe_beside_pivot_mm,
        ..
    } = found;
    let rows = [
        (KEY, probe_radius_mm),
        ("pin.beside_pivot_mm", pin_beside_pivot_mm),
        ("pin.above_pivot_mm", pin_above_pivot_mm),
        ("geometry.probe_beside_pivot_mm", probe_beside_pivot_mm),
    ];
    let sigma = |index: usize| f64::sqrt(covariance[index][index]);
    let value = |(index, (name, value)): (usize, (&'static str, f64))| Value {
        name,
        value,
        standard_uncertainty: sigma(index),
        unit: "mm",
    };
    let values = rows.into_iter().enumerate().map(value).collect();
    let verdict = verdict(probe_radius_mm, sigma(0), rig_file_mm);
    let covariance = covariance.iter().map(|row| row.to_vec()).collect();
    Ok(Finding { verdict, ..Finding::of(values, Vec::new()).with_covariance(covariance) })
}

/// The key of the rig file.
const KEY: &str = "geometry.probe_radius_mm";

fn verdict(found_mm: f64, sigma_mm: f64, rig_file_mm: f64) -> Verdict {
    let limit_mm = UNCERTAIN_REL * rig_file_mm;
    if sigma_mm > limit_mm {
        return Verdict::Failed(format!(
            "the standard uncertainty of {KEY} is {sigma_mm:.3} mm, where at most {limit_mm:.3} mm is allowed"
        ));
    }
    let off_mm = (found_mm - rig_file_mm).abs();
    if off_mm > OTHER_REL * rig_file_mm {
        return Verdict::Failed(format!(
            "{KEY} is {found_mm:.3} ± {sigma_mm:.3} mm by the pin, and {rig_file_mm} mm in the rig file; a change of at most \
             {:.0} % is made by a pin",
            100.0 * OTHER_REL
        ));
    }
    if off_mm > LENGTH_MM + 2.0 * sigma_mm {
        let change = Change { key: KEY, from: rig_file_mm, to: rounded(found_mm, 4) };
        return Verdict::RigFile(vec![change]);
    }
    Verdict::Accepted
}
