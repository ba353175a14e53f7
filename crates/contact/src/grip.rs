//! Whether friction holds a contact while the ball is pressed in.
//!
//! The contact sticks from the first touch on. Two things then load it along the surface: the tilt,
//! and the bending sensor, whose arm drags the ball sideways. Both are followed in small steps of the
//! depth, with the stiffness that the contact has there.

use crate::{ContactLaw, Pose, section::Section};

/// Steps of the depth. The error of the ratio falls with their number.
const STEPS: u32 = 200;

type Vector = [f64; 3];

/// The largest ratio of the forces along and across the surface on the way to a depth.
///
/// The contact has the contact modulus `modulus_pa` and the tangential over normal stiffness
/// `tangential_ratio`; the depth is normal to the surface in ball radii.
pub(crate) fn needed_friction(
    section: &Section,
    pose: &Pose,
    law: ContactLaw,
    modulus_pa: f64,
    tangential_ratio: f64,
    depth_rel: f64,
) -> f64 {
    let n = pose.normal();
    let tilt = n[0].hypot(n[1]) / n[2];
    let rigid = tangential_ratio * tilt;
    if tangential_ratio == 0.0 || depth_rel <= 0.0 {
        return rigid;
    }
    // Two directions along the surface.
    let side = if n[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let first = unit(less(side, scaled(dot(side, n), n)));
    let second = cross(n, first);
    let up = [0.0, 0.0, 1.0];
    let give = |force: Vector| compliance(section, n, force);
    let [of_normal, of_first, of_second] = [n, first, second].map(give);
    let step_m = depth_rel / f64::from(STEPS) * section.radius_m;
    let (mut normal, mut along, mut most) = (0.0, [0.0; 2], rigid);
    for step in 0..STEPS {
        let middle = law.at_valid(depth_rel * (f64::from(step) + 0.5) / f64::from(STEPS));
        let stiffness = 2.0 * modulus_pa * section.radius_m * middle.radius_rel;
        let push = stiffness * step_m;
        // The stage moves on until the tissue is one step deeper; what the ball then moves along the
        // surface loads the contact. Both unknown forces along the surface act on that motion.
        let moved = |force: Vector| scaled(dot(n, force) / n[2], up);
        let own = |force: Vector, axis: Vector| dot(axis, less(force, moved(force)));
        let drive = |axis: Vector| dot(axis, up) * step_m / n[2] - push * own(of_normal, axis);
        let soft = 1.0 / (tangential_ratio * stiffness);
        let (a, b) = (soft + own(of_first, first), own(of_second, first));
        let (c, d) = (own(of_first, second), soft + own(of_second, second));
        let (p, q) = (drive(first), drive(second));
        let determinant = a * d - b * c;
        along[0] += (p * d - b * q) / determinant;
        along[1] += (a * q - p * c) / determinant;
        normal += push;
        most = f64::max(most, along[0].hypot(along[1]) / normal);
    }
    most
}

/// The motion of the point of contact for a force on it.
fn compliance(section: &Section, n: Vector, force: Vector) -> Vector {
    let (l, r) = (section.length_m, section.radius_m);
    let [x, y] = section.offset_m;
    let point = [x - r * n[0], y - r * n[1], -section.arm_m - r * n[2]];
    let moment = cross(point, force);
    let bent = |force: f64, moment: f64, rigidity: f64| {
        let end = (force * l / 3.0 + moment / 2.0) * l * l / rigidity;
        let slope = (force * l / 2.0 + moment) * l / rigidity;
        (end, slope)
    };
    // A positive slope along the bimorph is a negative turn about the axis to the left.
    let (w, slope) = bent(force[2], -moment[1], section.bending_n_m2);
    let (v, yaw) = bent(force[1], moment[2], section.lateral_n_m2);
    let turn = [moment[0] * l / section.torsion_n_m2, -slope, yaw];
    let turned = cross(turn, point);
    [turned[0], v + turned[1], w + turned[2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn scaled(by: f64, vector: Vector) -> Vector {
    vector.map(|value| by * value)
}

fn less(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn unit(vector: Vector) -> Vector {
    scaled(1.0 / dot(vector, vector).sqrt(), vector)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Direction, Sensor};

    fn needed(young_mpa: f64, direction: Direction, degrees: f64) -> f64 {
        let pose = Pose::leaning(direction, degrees.to_radians()).unwrap();
        let modulus_pa = young_mpa * 1e6 / 0.75;
        let depth_rel = degrees.to_radians().cos();
        let sensor = Sensor::reference();
        needed_friction(
            sensor.section(),
            &pose,
            ContactLaw::Sneddon,
            modulus_pa,
            2.0 / 3.0,
            depth_rel,
        )
    }

    /// Values of another program for samples 1 to 5, upright at 0.5 mm.
    #[test]
    fn an_upright_ball_is_dragged_by_its_arm() {
        for (young_mpa, expected) in
            [(0.045, 0.02), (0.104, 0.05), (0.235, 0.10), (0.320, 0.14), (0.649, 0.26)]
        {
            let found = needed(young_mpa, Direction::Front, 0.0);
            assert!((found - expected).abs() < 0.012, "{young_mpa} MPa: {found}");
        }
    }

    #[test]
    fn a_soft_tissue_needs_the_friction_of_a_rigid_sensor() {
        for direction in Direction::ALL {
            let found = needed(1e-6, direction, 30.0);
            let rigid = 2.0 / 3.0 * 30.0_f64.to_radians().tan();
            assert!((found / rigid - 1.0).abs() < 1e-3, "{direction:?}: {found}");
        }
    }
}
