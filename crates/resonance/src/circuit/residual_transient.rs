//! The error of unsettled readings if the drive between two points is unknown.
//!
//! A change of the drive excites a free decay of the motional branch. Its amplitude depends on the
//! unknown phase of the drive at that moment, but it is bounded by the forced motions before and after,
//! and its decay is known. So it is treated as an error of known variance and random phase, and each
//! reading is weighted by how far it has settled.
//!
//! ```text
//!   E|A|² = |1/D(ω)|² + |1/D(ω before)|² + remainder of earlier free motions
//! ```

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::circuit::ringup::Visit;

/// Safety factor of the time constant, which is an estimate and usually slightly too short. With it the
/// stated uncertainties of sweeps planned by this model hold.
const MARGIN: f64 = 1.5;

/// The free motion of a branch of unit motional capacitance under a drive of 1 V.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ResidualTransient {
    /// ωs, rad/s, and Q.
    omega_s: f64,
    q: f64,
    /// Complex frequency of the free motion, rad/s.
    s: Complex64,
    /// Present mean square of its amplitude.
    square: f64,
    /// Mean square at the last reading; infinite after a change of the frequency.
    read: f64,
    /// The frequency of the drive, Hz, and |1/D|² there. Before the first visit it is unknown and
    /// assumed to be the resonance.
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

    /// Simulates a visit and returns the variance of each part of the measured motional admittance per
    /// farad of C1, in (rad/s)².
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
        // Readings of one stay share the same motion. Only the part that decayed in between is new
        // information.
        let new = (1.0 - square / self.read).max(f64::MIN_POSITIVE);
        let variance = 0.5 * MARGIN * square * response / new;
        self.read = square;
        self.rest(settle_s + integration_s + rest_s);
        variance
    }

    /// Continues the drive for this time, s.
    pub(crate) fn rest(&mut self, seconds: f64) {
        self.square *= (2.0 * self.s.re * seconds).exp();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::circuit::ringup::{Motion, plain};

    /// Compares with random phases of the drive at each change, from the closed-form ring-up.
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
                // The wait varies the phase at which the first drive ends. A short stay far away, whose
                // own ringing is negligible, varies the phase at which the second begins.
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
