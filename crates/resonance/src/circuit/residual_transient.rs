//! How far readings may be off because they have not settled, where nothing is known of what the
//! drive does between two points.
//!
//! A change of the drive sets the motional branch ringing. How strongly depends on the phase of the
//! drive at that moment, which nobody knows here; but the free motion cannot be larger than what the
//! forced motions before and after it have in common, and from there on its decay is known. So it is
//! taken for an error of known variance and unknown phase, and a reading counts for as much as it
//! has settled.
//!
//! ```text
//!   E|A|² = |1/D(ω)|² + |1/D(ω before)|² + what is left of earlier free motions
//! ```

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::circuit::ringup::Visit;

/// The time constant is an estimate too, and a little too short more often than not when it is used.
/// So much makes claims of sweeps planned by it come true.
const MARGIN: f64 = 1.5;

/// The free motion of a branch of unit motional capacitance under a drive of 1 V.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ResidualTransient {
    /// ωs and Q.
    omega_s: f64,
    q: f64,
    /// Complex frequency of the free motion, rad/s.
    s: Complex64,
    /// Mean square of its amplitude now.
    square: f64,
    /// The same when it was last read; infinite after a change of the frequency.
    read: f64,
    /// The frequency of the drive, Hz, and |1/D|² there. Nothing is known before the first visit:
    /// it may have been the resonance.
    frequency_hz: f64,
    forced: f64,
}

impl ResidualTransient {
    pub(crate) fn new(resonance_hz: f64, q: f64) -> Self {
        let omega_s = TAU * resonance_hz;
        let ringing = omega_s * (1.0 - 0.25 / (q * q)).max(0.0).sqrt();
        let s = Complex64::new(-0.5 * omega_s / q, ringing);
        Self { omega_s, q, s, square: 0.0, read: f64::INFINITY, frequency_hz: 0.0, forced: q * q }
    }

    /// One visit: the variance of each part of the motional admittance per farad of C1 that is read
    /// in it, in (rad/s)².
    pub(crate) fn visit(&mut self, visit: &Visit) -> f64 {
        let Visit { frequency_hz, settle_s, integration_s, rest_s } = *visit;
        #[expect(clippy::float_cmp, reason = "the same number was sent to the analyzer")]
        if frequency_hz != self.frequency_hz {
            let u = TAU * frequency_hz / self.omega_s;
            let forced = 1.0 / Complex64::new(1.0 - u * u, u / self.q).norm_sqr();
            self.square += forced + self.forced;
            (self.frequency_hz, self.forced) = (frequency_hz, forced);
            self.read = f64::INFINITY;
        }
        let omega = Complex64::new(0.0, TAU * frequency_hz);
        let part = |s: Complex64| {
            (s * ((s * integration_s).exp() - 1.0) / ((s - omega) * integration_s)).norm_sqr()
        };
        let response = part(self.s) + part(self.s.conj());
        let square = self.square * (2.0 * self.s.re * settle_s).exp();
        // Readings of one stay hear the same motion. Only what has died away in between is new.
        let new = (1.0 - square / self.read).max(f64::MIN_POSITIVE);
        let variance = 0.5 * MARGIN * square * response / new;
        self.read = square;
        self.rest(settle_s + integration_s + rest_s);
        variance
    }

    /// The drive goes on for some time.
    pub(crate) fn rest(&mut self, seconds: f64) {
        self.square *= (2.0 * self.s.re * seconds).exp();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::circuit::ringup::{Motion, plain};

    /// Random phases of the drive at each change, in closed form by the ring-up.
    #[test]
    fn its_variance_is_that_of_a_drive_whose_phase_jumps() {
        let visit = |frequency_hz, settle_s, cycles: f64| Visit {
            frequency_hz,
            settle_s,
            integration_s: cycles / frequency_hz,
            rest_s: 0.0,
        };
        let (first, second) = (visit(139.0, 2.0, 5.0), visit(147.0, 0.05, 6.0));
        let mut residual = ResidualTransient::new(140.0, 30.0);
        residual.visit(&first);
        let expected = residual.visit(&second) / MARGIN;
        let u: f64 = 147.0 / 140.0;
        let settled = Complex64::new(0.0, TAU * 147.0) / Complex64::new(1.0 - u * u, u / 30.0);
        let turns = 64;
        let mut sum = 0.0;
        for i in 0..turns {
            for j in 0..turns {
                // Waiting turns the phase at which the first drive ends; a short stay far away, whose
                // own ringing hardly matters, turns that at which the second begins.
                let mut motion = Motion::at_rest(plain(140.0, 30.0));
                let mut past = Complex64::ONE;
                let turn = f64::from(i) / f64::from(turns) / 139.0;
                let gap = f64::from(j) / f64::from(turns) / 1e6;
                motion.visit(&Visit { rest_s: turn, ..first }, &mut past);
                motion.visit(
                    &Visit { settle_s: gap, integration_s: 1e-6, ..visit(1e6, 0.0, 1.0) },
                    &mut past,
                );
                let response = motion.visit(&second, &mut past).motional;
                sum += 0.5 * (response - settled).norm_sqr();
            }
        }
        let found = sum / f64::from(turns * turns);
        assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
    }

    #[test]
    fn it_dies_away_with_the_time_constant_and_starts_anew_only_with_the_frequency() {
        let mut residual = ResidualTransient::new(140.0, 30.0);
        let stay =
            |frequency_hz| Visit { frequency_hz, settle_s: 0.05, integration_s: 0.02, rest_s: 0.0 };
        let first = residual.visit(&stay(139.0));
        let again = residual.visit(&stay(139.0));
        let decay = (-TAU * 140.0 / 30.0 * 0.07).exp();
        assert!((again / first / (decay / (1.0 - decay)) - 1.0).abs() < 1e-12);
        assert!(residual.visit(&stay(139.1)) > 0.5 * first);
    }
}
