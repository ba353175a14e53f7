//! Surface and rotary axis by a rule, well enough that the first touch finds the surface where it is expected: at each tilt, where
//! the errors of the three lengths add up.

use rig_files::rig_file::RigFile;
use rig_model::{Deg, Geometry, Position, Span};

use super::{Early, agreed, confirm, jog};
use crate::{
    Asked, Bench, Change, Finding, JogAxis, Value, agreement::Agreement, finding::rounded,
};

/// Division of a rule, and what a person may be wrong by with it, mm.
const RULE_STEP_MM: f64 = 0.1;
const RULE_LIMIT_MM: f64 = 0.3;

/// Limit of acceptance, mm.
const LIMIT_MM: f64 = 0.5;

/// Tilts at which the surface is compared, over the soft limits of the rotary stage: it changes slowly between them.
const TILTS: u8 = 100;

/// Readings that must agree.
const READINGS: usize = 3;

pub(super) async fn carry_out<B: Bench>(
    rig: &RigFile,
    bench: &mut B,
) -> Result<Finding, Early<B::Trouble>> {
    let geometry = &rig.limits.geometry;
    find_zeros(bench).await?;
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
    let (mut values, mut found) = (Vec::new(), Vec::new());
    for (asked, name, key, expected, from) in measured {
        let agreement = Agreement::new(READINGS, 2.0 * RULE_STEP_MM);
        let value = agreed(bench, asked, agreement).await?;
        let standard_uncertainty = RULE_LIMIT_MM.hypot(RULE_STEP_MM / 2.0) / 3.0_f64.sqrt();
        values.push(Value { name, value, standard_uncertainty, unit: "mm" });
        found.push((
            value - expected,
            Change { key, from, to: rounded(from + value - expected, 4) },
        ));
    }
    let by_mm = found.iter().map(|(by_mm, _)| *by_mm).collect::<Vec<_>>();
    let is_changed = to_change(geometry, rig.limits.rotary.soft(), [by_mm[0], by_mm[1], by_mm[2]]);
    let changes = found.into_iter().zip(is_changed).filter(|(_, is_changed)| *is_changed);
    Ok(Finding::of(values, changes.map(|((_, change), _)| change).collect()))
}

/// Asks for the zeros of drives that do not know where their axes are. This is the first step that rests on them.
async fn find_zeros<B: Bench>(bench: &mut B) -> Result<(), Early<B::Trouble>> {
    const AXES: [JogAxis; 2] = [JogAxis::Linear, JogAxis::Rotary];
    let mut is_homed = true;
    for axis in AXES {
        is_homed &= jog(bench, axis, 0.0).await?.is_homed;
    }
    if is_homed {
        return Ok(());
    }
    confirm(bench, Asked::FindZero).await?;
    bench.remark(OTHER_ZERO);
    for axis in AXES {
        if !jog(bench, axis, 0.0).await?.is_homed {
            let name = axis.name();
            return Err(Early::Failed(format!(
                "{name}: its drive says still that it does not know where the axis is"
            )));
        }
    }
    Ok(())
}

/// What is said of a zero that was found.
const OTHER_ZERO: &str = "Steps that were accepted before rest on the zero that the drive had then: `rigd commission changed zero` asks for them again.";

/// Which of gap, height above the rotary axis and distance beside it are to be changed, that differ from the rig file by so much, mm:
/// those beyond the limit, and then the largest ones, until the surface is where it is expected at each tilt.
fn to_change(geometry: &Geometry, tilts: Span<Deg>, by_mm: [f64; 3]) -> [bool; 3] {
    let mut is_changed = by_mm.map(|by_mm| by_mm.abs() > LIMIT_MM);
    let mut largest_first = [0, 1, 2];
    largest_first.sort_by(|a, b| by_mm[*b].abs().total_cmp(&by_mm[*a].abs()));
    for length in largest_first {
        let left: [f64; 3] = std::array::from_fn(|at| if is_changed[at] { 0.0 } else { by_mm[at] });
        if off_mm(geometry, tilts, left) <= geometry.surface_tolerance_mm {
            break;
        }
        is_changed[length] = true;
    }
    is_changed
}

/// How far the surface is at most from where it is expected, over these tilts, if the three lengths differ by so much, mm.
fn off_mm(geometry: &Geometry, tilts: Span<Deg>, [gap, above, beside]: [f64; 3]) -> f64 {
    let measured = Geometry {
        // A larger gap is a lower surface.
        surface: geometry.surface.offset(-gap),
        surface_above_pivot_mm: geometry.surface_above_pivot_mm + above,
        probe_beside_pivot_mm: geometry.probe_beside_pivot_mm + beside,
        ..*geometry
    };
    let (min, max) = (tilts.min.value(), tilts.max.value());
    let off_at = |index: u8| {
        let tilt = Position::new(min + (max - min) * f64::from(index) / f64::from(TILTS));
        (measured.surface_at_tilt(tilt).value() - geometry.surface_at_tilt(tilt).value()).abs()
    };
    (0..=TILTS).map(off_at).fold(0.0, f64::max)
}
