//! Surface and rotary axis by a rule, well enough that the first touch finds the surface where it is expected.

use rig_files::rig_file::RigFile;

use super::{Early, agreed, jog};
use crate::{
    Asked, Bench, Change, Finding, JogAxis, Value, agreement::Agreement, finding::rounded,
};

/// Division of a rule, and what a person may be wrong by with it, mm.
const RULE_STEP_MM: f64 = 0.1;
const RULE_LIMIT_MM: f64 = 0.3;

/// Limit of acceptance, mm.
const LIMIT_MM: f64 = 0.5;

/// Readings that must agree.
const READINGS: usize = 3;

pub(super) async fn carry_out<B: Bench>(
    rig: &RigFile,
    bench: &mut B,
) -> Result<Finding, Early<B::Trouble>> {
    let geometry = &rig.limits.geometry;
    let at = jog(bench, JogAxis::Linear, 0.0).await?.at;
    let zero = rig.linear.scale.zero.value();
    let measured = [
        // A gap that is wrong by much is the zero of the axis; that of the rig file then moves with it.
        (Asked::Gap, "place.gap", "linear.zero_mm", at - geometry.surface.value(), zero),
        (
            Asked::AbovePivot,
            "place.surface_above_pivot",
            "geometry.surface_above_pivot_mm",
            geometry.surface_above_pivot_mm,
            geometry.surface_above_pivot_mm,
        ),
        (
            Asked::BesidePivot,
            "place.probe_beside_pivot",
            "geometry.probe_beside_pivot_mm",
            geometry.probe_beside_pivot_mm,
            geometry.probe_beside_pivot_mm,
        ),
    ];
    let (mut values, mut changes) = (Vec::new(), Vec::new());
    for (asked, name, key, expected, from) in measured {
        let agreement = Agreement::new(READINGS, 2.0 * RULE_STEP_MM);
        let value = agreed(bench, asked, agreement).await?;
        let standard_uncertainty = RULE_LIMIT_MM.hypot(RULE_STEP_MM / 2.0) / 3.0_f64.sqrt();
        values.push(Value { name, value, standard_uncertainty, unit: "mm" });
        if (value - expected).abs() > LIMIT_MM {
            changes.push(Change { key, from, to: rounded(from + value - expected, 4) });
        }
    }
    Ok(Finding::of(values, changes))
}
