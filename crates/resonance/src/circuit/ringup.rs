//! The model of a reading during the ring-up.
//!
//! A change of the drive excites the free motion of a motional branch, which decays with the time
//! constant Q/(πf), a tenth of a second and more. If the drive is known at every moment, that motion is
//! known too, and readings need not wait for its decay.
//!
//! The branch obeys q″ + 2γq′ + ωs²q = ωs²C1·v with v = Re e^{jφ(t)} and continuous φ. Its charge is
//! C1·Re(e^{jφ}/D(ω) + A e^{st}) with s = −γ + j√(ωs² − γ²). Charge and current are continuous at a
//! change of frequency, which gives the new A. A lock-in over a time T of whole cycles measures
//!
//! ```text
//!   h = jω/D + e^{−jφ}/T · [ sA·E(s) + (sA)*·E(s*) ],   E(σ) = (e^{σT} − 1)/(σ − jω)
//! ```
//!
//! and the admittance jωC0(1 − j tan δ) + C1·h. It is linear in C0, C0·tan δ and C1.

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::circuit::dual::{Dual, Value};

const J: Complex64 = Complex64::I;

/// One stay at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Visit {
    pub(crate) frequency_hz: f64,
    /// Time from the change of frequency to the start of the integration, s.
    pub(crate) settle_s: f64,
    /// Integration time, a whole number of cycles, s.
    pub(crate) integration_s: f64,
    /// Time from the end of the integration to the next change of frequency, s.
    pub(crate) rest_s: f64,
}

/// The motion of a branch of unit motional capacitance under a drive of 1 V.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion<V> {
    /// Complex frequency of the free motion, rad/s.
    s: V,
    /// 1/ωs².
    inverse_stiffness: V,
    /// Factor of ω in the loss term: 1/(Q ωs).
    damping: V,
    /// Re(s) and 1/Im(s), which convert a jump of charge and current into one of the free motion.
    gamma: V,
    inverse_ringing: V,
    /// The present free charge is Re(free).
    free: V,
    /// The present forced charge is Re(forced · e^{jφ}).
    forced: V,
    /// Present ω of the drive, rad/s; 0 before it starts.
    omega: f64,
    /// Present phase of the drive, in turns.
    turns: f64,
}

/// The response of the branch in a reading.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Response<V> {
    /// The motional admittance per farad of C1, rad/s.
    pub(crate) motional: V,
    /// The contribution of an unknown past: the admittance for a free motion of unit amplitude at the
    /// start of the first visit, with phase 0 or a quarter turn.
    pub(crate) past: [V; 2],
}

/// ωs and Q as plain numbers; [`with_slopes`] adds derivatives with respect to their logarithms.
pub(crate) fn plain(resonance_hz: f64, q: f64) -> (Complex64, Complex64) {
    (Complex64::from(TAU * resonance_hz), Complex64::from(q))
}

/// See [`plain`].
pub(crate) fn with_slopes(resonance_hz: f64, q: f64) -> (Dual, Dual) {
    let (omega, q) = plain(resonance_hz, q);
    (
        Dual { value: omega, by: [omega, Complex64::ZERO] },
        Dual { value: q, by: [Complex64::ZERO, q] },
    )
}

impl<V: Value> Motion<V> {
    /// A branch at rest, before a drive that starts at its crest.
    pub(crate) fn at_rest((omega_s, q): (V, V)) -> Self {
        let half = Complex64::from(0.5);
        let inverse_omega = omega_s.recip();
        let inverse_q = q.recip();
        let gamma = (omega_s * inverse_q).times(half);
        // Newton's root gives √(1 − 1/4Q²) with less code than the derivative of its logarithm.
        let ratio = V::constant(Complex64::ONE) - (inverse_q * inverse_q).times(half * half);
        let ringing = omega_s * root(ratio);
        let zero = V::constant(Complex64::ZERO);
        Self {
            s: ringing.times(J) - gamma,
            inverse_stiffness: inverse_omega * inverse_omega,
            damping: inverse_omega * inverse_q,
            gamma,
            inverse_ringing: ringing.recip(),
            free: zero,
            forced: zero,
            omega: 0.0,
            turns: 0.0,
        }
    }

    /// Simulates a visit and returns its response. `past` is the remaining fraction of a free motion at
    /// the start of the first visit; it is updated.
    pub(crate) fn visit(&mut self, visit: &Visit, past: &mut V) -> Response<V> {
        self.drive_at(visit.frequency_hz);
        self.rest(visit.settle_s, past);
        let (omega, t) = (self.omega, visit.integration_s);
        let decay = self.s.times(Complex64::from(t)).exp();
        let one = V::constant(Complex64::ONE);
        let shift = V::constant(J * omega);
        let turned = Complex64::cis(-TAU * self.turns) / t;
        // s·E(s), and the same expression at s*.
        let direct = (self.s * (decay - one) * (self.s - shift).recip()).times(turned);
        let mirrored = self.s.conj();
        let mirrored = (mirrored * (decay.conj() - one) * (mirrored - shift).recip()).times(turned);
        let response = |free: V| free * direct + free.conj() * mirrored;
        let motional = self.forced.times(J * omega) + response(self.free);
        let past_now = [response(*past), response(past.times(J))];
        let stay = t + visit.rest_s;
        let left =
            if visit.rest_s > 0.0 { self.s.times(Complex64::from(stay)).exp() } else { decay };
        self.pass(stay, left);
        *past = *past * left;
        Response { motional, past: past_now }
    }

    /// The drive goes on for some time.
    pub(crate) fn rest(&mut self, seconds: f64, past: &mut V) {
        if seconds > 0.0 {
            let decay = self.s.times(Complex64::from(seconds)).exp();
            self.pass(seconds, decay);
            *past = *past * decay;
        }
    }

    /// Changes the frequency; charge and current are continuous.
    fn drive_at(&mut self, frequency_hz: f64) {
        let omega = TAU * frequency_hz;
        let one = V::constant(Complex64::ONE);
        let response = (one - self.inverse_stiffness.times(Complex64::from(omega * omega))
            + self.damping.times(J * omega))
        .recip();
        let phase = Complex64::cis(TAU * self.turns);
        let charge = (self.forced - response).times(phase).re();
        let current =
            (self.forced.times(J * self.omega) - response.times(J * omega)).times(phase).re();
        let quarter = (current + self.gamma * charge) * self.inverse_ringing;
        self.free = self.free + charge - quarter.times(J);
        self.forced = response;
        self.omega = omega;
    }

    fn pass(&mut self, seconds: f64, decay: V) {
        self.free = self.free * decay;
        self.turns = (self.turns + self.omega / TAU * seconds).fract();
    }
}

/// The square root of a number near 1.
fn root<V: Value>(x: V) -> V {
    // Newton's iteration for 1/√x: the start has the right value, and the last step gives the
    // derivative.
    let half = Complex64::from(0.5);
    let start = V::constant(1.0 / x.value().sqrt());
    let three = V::constant(Complex64::from(3.0));
    x * (start * (three - x * start * start)).times(half)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numerical integration of charge and current of a branch of 1 F under 1 V, with the lock-in.
    struct DriveIntegral {
        omega_s: f64,
        q: f64,
        state: [f64; 2],
        phase: f64,
    }

    impl DriveIntegral {
        fn drive(&mut self, frequency_hz: f64, seconds: f64) -> Complex64 {
            let omega = TAU * frequency_hz;
            let steps = (seconds * frequency_hz * 3000.0).ceil().max(1.0);
            let dt = seconds / steps;
            let slope = |t: f64, [x, y]: [f64; 2]| {
                let force = self.omega_s.powi(2) * ((self.phase + omega * t).cos() - x);
                let lock_in = y * Complex64::cis(-(self.phase + omega * t));
                ([y, force - self.omega_s / self.q * y], lock_in)
            };
            let (mut state, mut sum, mut step) = (self.state, Complex64::ZERO, 0.0);
            while step < steps {
                let t = step * dt;
                let on = |by: [f64; 2], h: f64| [state[0] + h * by[0], state[1] + h * by[1]];
                let (a, la) = slope(t, state);
                let (b, lb) = slope(t + 0.5 * dt, on(a, 0.5 * dt));
                let (c, lc) = slope(t + 0.5 * dt, on(b, 0.5 * dt));
                let (d, ld) = slope(t + dt, on(c, dt));
                for i in 0..2 {
                    state[i] += dt / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
                }
                sum += dt / 6.0 * (la + 2.0 * lb + 2.0 * lc + ld);
                step += 1.0;
            }
            self.state = state;
            self.phase += omega * seconds;
            2.0 / seconds * sum
        }
    }

    const VISITS: [Visit; 5] = [
        visit(130.0, 0.0, 2.0, 0.0),
        visit(139.0, 0.0031, 1.0, 0.0021),
        visit(141.3, 0.02, 5.0, 0.0),
        visit(150.0, 0.0, 3.0, 0.013),
        visit(139.5, 0.0007, 12.0, 0.0),
    ];

    const fn visit(frequency_hz: f64, settle_s: f64, cycles: f64, rest_s: f64) -> Visit {
        Visit { frequency_hz, settle_s, integration_s: cycles / frequency_hz, rest_s }
    }

    /// Checks the response from rest, and that to a free motion of charge and current.
    #[test]
    fn the_closed_form_agrees_with_blind_integration() {
        for q in [0.8, 8.0, 100.0] {
            let omega_s = TAU * 140.0;
            for state in [[0.0, 0.0], [1.7, -300.0]] {
                let mut blind = DriveIntegral { omega_s, q, state, phase: 0.0 };
                let mut motion = Motion::at_rest(plain(140.0, q));
                let mut past = Complex64::ONE;
                // Re a = charge and Re sa = current.
                let s = motion.s;
                let amplitude = [state[0], (s.re * state[0] - state[1]) / s.im];
                for visit in VISITS {
                    let response = motion.visit(&visit, &mut past);
                    let found = response.motional
                        + amplitude[0] * response.past[0]
                        + amplitude[1] * response.past[1];
                    blind.drive(visit.frequency_hz, visit.settle_s.max(1e-12));
                    let expected = blind.drive(visit.frequency_hz, visit.integration_s);
                    blind.drive(visit.frequency_hz, visit.rest_s.max(1e-12));
                    let error = (found - expected).norm() / expected.norm();
                    assert!(error < 1e-7, "Q {q}, {state:?}, {visit:?}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn slopes_agree_with_differences() {
        let h = 1e-5_f64;
        let run = |frequency_hz: f64, q: f64| {
            let mut motion = Motion::at_rest(plain(frequency_hz, q));
            let mut past = Complex64::ONE;
            VISITS.map(|visit| {
                let response = motion.visit(&visit, &mut past);
                [response.motional, response.past[0], response.past[1]]
            })
        };
        let mut motion = Motion::at_rest(with_slopes(140.0, 30.0));
        let mut past = Dual::constant(Complex64::ONE);
        let up = h.exp();
        let (higher, lower) = (run(140.0 * up, 30.0), run(140.0 / up, 30.0));
        let (sharper, broader) = (run(140.0, 30.0 * up), run(140.0, 30.0 / up));
        for (i, visit) in VISITS.iter().enumerate() {
            let response = motion.visit(visit, &mut past);
            for (k, found) in
                [response.motional, response.past[0], response.past[1]].iter().enumerate()
            {
                let by_frequency = (higher[i][k] - lower[i][k]) / (2.0 * h);
                let by_q = (sharper[i][k] - broader[i][k]) / (2.0 * h);
                let size = found.value.norm() + by_frequency.norm() + by_q.norm();
                assert!((found.by[0] - by_frequency).norm() < 1e-6 * size, "{i} {k}");
                assert!((found.by[1] - by_q).norm() < 1e-6 * size, "{i} {k}");
            }
        }
    }

    #[test]
    fn after_many_time_constants_only_the_steady_response_is_left() {
        let mut motion = Motion::at_rest(plain(140.0, 30.0));
        let mut past = Complex64::ONE;
        let response = motion.visit(&visit(139.0, 5.0, 3.0, 0.0), &mut past);
        let u = 139.0 / 140.0;
        let steady = Complex64::new(0.0, TAU * 139.0) / Complex64::new(1.0 - u * u, u / 30.0);
        assert!((response.motional - steady).norm() < 1e-12 * steady.norm());
        assert!(past.norm() < 1e-30 && response.past[0].norm() < 1e-20);
    }
}
