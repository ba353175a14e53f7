//! The motion of the sensor in a reading. That of a resonance that moves is integrated, in steps during which it rests.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::beside::Course;

/// Steps of a reading, and of the time between two.
const STEPS: u32 = 8;
/// Difference of an unknown by which a slope is found.
const DIFFERENCE: f64 = 1e-6;

/// The motion in a reading, as an admittance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mean {
    /// The mean of the forced motion of a capacitance of 1.
    pub(super) forced: Complex64,
    /// The mean of a free decay whose amplitude is 1 at the first reading of the stay.
    pub(super) free: Complex64,
}

impl Mean {
    /// With this capacitance and this amplitude of the free decay.
    pub(super) fn motion(&self, c1: f64, amplitude: Complex64) -> Complex64 {
        c1 * self.forced + amplitude * self.free
    }
}

/// A resonance with what follows from it.
pub(super) struct Branch {
    pub(super) q: f64,
    pub(super) omega: f64,
    /// Complex frequency of the free decay, rad/s, and its slopes by ln f and ln Q.
    pub(super) s: Complex64,
    by_q: Complex64,
}

impl Branch {
    /// With this logarithm of the resonance and of the quality factor.
    pub(super) fn new(ln_f: f64, ln_q: f64) -> Self {
        let (omega, q) = (TAU * ln_f.exp(), ln_q.exp().max(0.51));
        let ringing = (1.0 - 0.25 / (q * q)).sqrt();
        let s = omega * Complex64::new(-0.5 / q, ringing);
        let by_q = omega * Complex64::new(0.5 / q, 0.25 / (q * q) / ringing);
        Self { q, omega, s, by_q }
    }

    /// That of a resonance whose logarithm is larger by this.
    pub(super) fn moved(&self, shift: f64) -> Self {
        let by = shift.exp();
        Self { q: self.q, omega: self.omega * by, s: self.s * by, by_q: self.by_q * by }
    }

    /// 1/D and the slopes of D by ln f and ln Q.
    pub(super) fn response(&self, omega: f64) -> (Complex64, Complex64, Complex64) {
        let u = omega / self.omega;
        let (square, loss) = (u * u, Complex64::I * u / self.q);
        ((1.0 - square + loss).inv(), 2.0 * square - loss, -loss)
    }
}

/// The mean of e^{λt} over a reading that begins at `t` and takes `span`, and its slope by λ.
pub(super) fn decay(lambda: Complex64, t: f64, span: f64) -> (Complex64, Complex64) {
    let x = lambda * span;
    let (before, growth) = ((lambda * t).exp(), x.exp());
    let mean = (growth - 1.0) / x;
    (before * mean, before * (mean * t + (growth - mean) / x * span))
}

/// The motion in a reading beside a resonance that rests, and its slopes by ln f, ln Q, a change and the time.
pub(super) fn resting(
    branch: &Branch,
    omega: f64,
    (start_s, integration_s): (f64, f64),
    (c1, amplitude): (f64, Complex64),
) -> (Mean, [Complex64; 4]) {
    let drive = Complex64::new(0.0, omega);
    let (response, by_f, by_q) = branch.response(omega);
    let rate = branch.s - drive;
    let (free, by_rate) = decay(rate, start_s, integration_s);
    let by_forced = -drive * c1 * response * response;
    let by_s = amplitude * by_rate;
    let mean = Mean { forced: drive * response, free };
    (
        mean,
        [
            by_s * branch.s + by_forced * by_f,
            by_s * branch.by_q + by_forced * by_q,
            Complex64::ZERO,
            amplitude * rate * free,
        ],
    )
}

/// A stay beside a resonance that moves.
#[derive(Debug, Clone)]
pub(super) struct Passage {
    pub(super) course: Course,
    pub(super) omega: f64,
    /// The begin of its first reading, s after that of the first stay.
    pub(super) begin_s: f64,
    /// From there to the begin of each reading, s, and the integration time, s.
    pub(super) readings: Vec<(f64, f64)>,
}

impl Passage {
    /// The motion in each reading, and by how much it would be larger if the reading were later, 1/s. The unknowns are
    /// ln f and ln Q, and the change of ln f.
    fn means(&self, [ln_f, ln_q, change]: [f64; 3]) -> Vec<[Mean; 2]> {
        let drive = Complex64::new(0.0, self.omega);
        let stated = self.course.done(self.course.stated_s);
        // The forced motion of a resonance that rests as at this time, and the rate of the free decay.
        let resting = |s: f64| {
            let ln_f = ln_f + change * (self.course.done(self.begin_s + s) - stated);
            let branch = Branch::new(ln_f, ln_q);
            (drive * branch.response(self.omega).0, branch.s - drive)
        };
        let (mut now_s, mut forced, mut free) = (0.0, resting(0.0).0, Complex64::ONE);
        let mut until = |s: f64| {
            let step_s = (s - now_s) / f64::from(STEPS);
            let (mut of_forced, mut of_free) = (Complex64::ZERO, Complex64::ZERO);
            for _ in 0..STEPS {
                let (rest, rate) = resting(now_s + 0.5 * step_s);
                let grown = (rate * step_s).exp();
                let integral = if step_s == 0.0 { Complex64::ZERO } else { (grown - 1.0) / rate };
                of_forced += rest * step_s + (forced - rest) * integral;
                of_free += free * integral;
                forced = rest + (forced - rest) * grown;
                free *= grown;
                now_s += step_s;
            }
            [of_forced, of_free, forced, free]
        };
        let of_reading = |&(start_s, integration_s): &(f64, f64)| {
            let [.., forced, free] = until(start_s);
            let [of_forced, of_free, forced_after, free_after] = until(start_s + integration_s);
            let mean =
                |forced, free| Mean { forced: forced / integration_s, free: free / integration_s };
            [mean(of_forced, of_free), mean(forced_after - forced, free_after - free)]
        };
        self.readings.iter().map(of_reading).collect()
    }

    /// The motion in each reading with its slopes by ln f and ln Q, the change and the time, for this capacitance and
    /// this amplitude of the free decay.
    pub(super) fn slopes(
        &self,
        unknowns: [f64; 3],
        c1: f64,
        amplitude: Complex64,
    ) -> Vec<(Mean, [Complex64; 4])> {
        let means = self.means(unknowns);
        let beside = |unknown: usize, by: f64| {
            let mut unknowns = unknowns;
            unknowns[unknown] += by;
            self.means(unknowns)
        };
        let pairs = [0, 1, 2].map(|i| [beside(i, DIFFERENCE), beside(i, -DIFFERENCE)]);
        let of_reading = |(i, [mean, rise]): (usize, [Mean; 2])| {
            let [by_f, by_q, by_change] = pairs.each_ref().map(|[more, less]| {
                let [more, less] = [more, less].map(|of| of[i][0].motion(c1, amplitude));
                (more - less) / (2.0 * DIFFERENCE)
            });
            (mean, [by_f, by_q, by_change, rise.motion(c1, amplitude)])
        };
        means.into_iter().enumerate().map(of_reading).collect()
    }
}
