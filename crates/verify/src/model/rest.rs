//! A beam at rest under the force of the surface on its ball, found by repeated substitution.

use super::beam::Beam;

/// Where the force holds the end of the beam.
#[derive(Debug, Clone, Copy)]
pub(super) struct AtRest {
    /// Force on the ball along the bimorph, to the left, along the probe, N.
    pub(super) force_n: [f64; 3],
    /// Deflection, slope and twist of the end.
    pub(super) end: [f64; 3],
    /// Motion of the ball along the normal for each newton, m.
    pub(super) give_m_per_n: f64,
}

/// Each substitution shrinks the error to an eighth or less, and to a hundredth for common samples.
const SUBSTITUTIONS: u32 = 10;
/// A force that turns the end by more has the effects of one that turns it by this, rad.
const TURN_MOST_RAD: f64 = 0.15;

impl AtRest {
    pub(super) fn of(beam: &Beam, n: &[f64; 3], force_n: f64) -> Self {
        let h = beam.arm_m;
        let first = beam.bent(&[n[2], h * n[0], h * n[1]]);
        let turn = force_n * first[1].hypot(first[2]);
        let held = force_n * TURN_MOST_RAD / turn.max(TURN_MOST_RAD);
        let mut end = [0.0; 3];
        for _ in 0..SUBSTITUTIONS {
            // The motion of the ball along the normal for each motion of the bent beam's end.
            let shorter = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|one| beam.shorter(&end, &one));
            let along = [
                n[2] - n[0] * shorter[0],
                n[0] * (h - shorter[1]) + n[2] * h * end[1],
                n[1] * h + n[2] * h * end[2],
            ];
            end = beam.bent(&along.map(|one| held * one));
        }
        let x = h * end[1] - 0.5 * beam.shorter(&end, &end);
        let z = end[0] + 0.5 * h * (end[1] * end[1] + end[2] * end[2]);
        // Without a force the ratio is that of the smallest one.
        let per_n = if held > 0.0 {
            (n[0] * x + n[1] * h * end[2] + n[2] * z) / held
        } else {
            n[2] * first[0] + h * (n[0] * first[1] + n[1] * first[2])
        };
        let aside = n[1] * n[1] * beam.length_m.powi(3) / (3.0 * beam.lateral_n_m2);
        Self { force_n: n.map(|one| held * one), end, give_m_per_n: per_n + aside }
    }
}
