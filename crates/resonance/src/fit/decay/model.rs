//! The model of readings at one frequency with a free decay.

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::circuit::trace::{CIRCUIT, ModelEstimate};

/// The mean square of the free motion after each change of frequency, in units of the static
/// deflection: the difference of the forced motions before and after, and the remaining free motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Amplitude {
    at: ModelEstimate,
    square: f64,
    forced: f64,
}

impl Amplitude {
    /// Before the first stay, the motion may be as large as one at the resonance.
    pub(crate) fn new(at: &ModelEstimate) -> Self {
        Self { at: *at, square: 0.0, forced: at.q * at.q }
    }

    /// Changes to this frequency, `since_s` after the previous change.
    pub(crate) fn change(&mut self, frequency_hz: f64, since_s: f64) -> f64 {
        let ModelEstimate { resonance_hz, q, .. } = self.at;
        let u = frequency_hz / resonance_hz;
        let forced = 1.0 / Complex64::new(1.0 - u * u, u / q).norm_sqr();
        let left = self.square * (-TAU * resonance_hz / q * since_s).exp();
        self.square = forced + self.forced + left;
        self.forced = forced;
        self.square
    }
}

/// How the resonance moves during a stay.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_field_names, reason = "all have seconds in their unit")]
pub(super) struct Moving {
    /// Change of its logarithm per second, in the middle.
    pub(super) per_s: f64,
    /// The time at which it is that of the circuit, s after the start of the stay.
    pub(super) middle_s: f64,
    /// 1/τ of a relaxation, 1/s; 0 for a steady drift.
    pub(super) relaxation_per_s: f64,
}

impl Moving {
    /// Not at all.
    pub(super) const STILL: Self = Self { per_s: 0.0, middle_s: 0.0, relaxation_per_s: 0.0 };

    /// Whether a rate differs from this one by more than this part.
    pub(super) fn has_changed(&self, from: &Self, part: f64) -> bool {
        let has_changed = |now: f64, before: f64| (now - before).abs() > part * before.abs();
        has_changed(self.per_s, from.per_s)
            || has_changed(self.relaxation_per_s, from.relaxation_per_s)
    }
}

/// The model of readings at one frequency.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Model {
    /// s − jω, rad/s.
    pub(super) rate: Complex64,
    /// |s* − jω|².
    pub(super) mirrored: f64,
    /// ds/d ln fs and ds/d ln Q.
    pub(super) rate_by: [Complex64; 2],
    /// The steady-state admittance and its derivatives.
    pub(super) steady: Complex64,
    pub(super) by: [Complex64; CIRCUIT],
    /// C1·ωs: the admittance of a free motion as large as the static deflection.
    pub(super) unit: f64,
    pub(super) moving: Moving,
}

impl Model {
    pub(crate) fn new(at: &ModelEstimate, frequency_hz: f64) -> Self {
        let (omega, omega_s) = (TAU * frequency_hz, TAU * at.resonance_hz);
        let j_omega = Complex64::new(0.0, omega);
        let gamma = 0.5 * omega_s / at.q;
        let root = (1.0 - 0.25 / (at.q * at.q)).max(1e-3).sqrt();
        let s = Complex64::new(-gamma, omega_s * root);
        let u = frequency_hz / at.resonance_hz;
        let response = 1.0 / Complex64::new(1.0 - u * u, u / at.q);
        let branch = j_omega * response;
        let slope = -branch * response * at.c1;
        Self {
            rate: s - j_omega,
            mirrored: (s.conj() - j_omega).norm_sqr(),
            rate_by: [s, Complex64::new(gamma, omega_s * 0.25 / (at.q * at.q * root))],
            steady: omega * Complex64::new(at.g, at.c0) + at.c1 * branch,
            by: [
                slope * Complex64::new(2.0 * u * u, -u / at.q),
                slope * Complex64::new(0.0, -u / at.q),
                j_omega,
                branch,
                Complex64::from(omega),
            ],
            unit: at.c1.abs().max(1e-6) * omega_s,
            moving: Moving::STILL,
        }
    }

    /// The model of a resonance that moves.
    pub(super) const fn moving(self, moving: Moving) -> Self {
        Self { moving, ..self }
    }

    /// Change of the mean admittance of a reading with this free decay in it, whose amplitude is `amplitude`, by a
    /// resonance that moves.
    ///
    /// With λ = s − jω, the motion q' = (λ + s·L(t))·q + drive is, to first order in the change L of ln f, a forced
    /// motion that follows the resonance with a delay of up to the time constant of the decay, and a free decay times
    /// 1 + s·∫L from the start of the stay. With T the time since its middle m,
    ///
    /// ```text
    ///   L = ψT                    forced as at T + 1/λ                        free × 1 + ψ·s·(t²/2 − mt)
    ///   L = ψτ(1 − e^{−T/τ})      forced as at L = ψ(λτ(1 − e^{−T/τ}) + 1)/(λ + 1/τ)
    ///                             free × 1 + ψ·s·τ(t − τe^{m/τ}(1 − e^{−t/τ}))
    /// ```
    pub(super) fn by_motion(
        &self,
        moving: &Moving,
        amplitude: Complex64,
        decayed: &Decayed,
    ) -> Complex64 {
        let Moving { per_s, middle_s, relaxation_per_s: slows } = *moving;
        let Decayed { start_s, integration_s, .. } = *decayed;
        let from_middle_s = start_s + 0.5 * integration_s - middle_s;
        let (forced_s, free) = if slows > 0.0 {
            let over = 0.5 * slows * integration_s;
            let mean_past = (-slows * from_middle_s).exp() * over.sinh() / over;
            let forced_s = (self.rate * ((1.0 - mean_past) / slows) + 1.0) / (self.rate + slows);
            let slowed = self.rate - slows;
            let x = slowed * integration_s;
            let slowed = (slowed * start_s).exp() * (x.exp() - 1.0) / x;
            let slowing = (slows * middle_s).exp() * (decayed.value - slowed) / slows;
            (forced_s, (decayed.by_rate - slowing) / slows)
        } else {
            let free = 0.5 * decayed.by_rate_twice - middle_s * decayed.by_rate;
            (from_middle_s + 1.0 / self.rate, free)
        };
        per_s * (self.by[0] * forced_s + amplitude * self.rate_by[0] * free)
    }

    /// The factors common to readings of this integration time, s.
    fn over(&self, integration_s: f64) -> Integration {
        let x = self.rate * integration_s;
        let over = x.exp();
        let mean = (over - 1.0) / x;
        let slope = (over - mean) / self.rate;
        Integration {
            seconds: integration_s,
            mean,
            slope,
            curve: (over * integration_s - 2.0 * slope) / self.rate,
            mirrored: (over - 1.0).norm_sqr() / (self.mirrored * integration_s * integration_s),
        }
    }

    /// The free decay in a reading that starts at this time; `last` is the integration of the previous
    /// one.
    pub(super) fn decayed(
        &self,
        start_s: f64,
        integration_s: f64,
        last: &mut Option<Integration>,
    ) -> Decayed {
        let over = match last {
            Some(over) if over.seconds.to_bits() == integration_s.to_bits() => over,
            _ => last.insert(self.over(integration_s)),
        };
        over.after(start_s, (self.rate * start_s).exp())
    }

    /// The free decay in `count` readings at this spacing, s.
    pub(super) fn decays(
        &self,
        start_s: f64,
        (step_s, integration_s): (f64, f64),
        count: usize,
    ) -> Vec<Decayed> {
        let (over, step) = (self.over(integration_s), (self.rate * step_s).exp());
        let mut begin = (self.rate * start_s).exp();
        let of = |n: usize| {
            let decayed = over.after(start_s + n as f64 * step_s, begin);
            begin *= step;
            decayed
        };
        (0..count).map(of).collect()
    }

    /// The steady-state motional admittance.
    fn forced(&self, at: &ModelEstimate) -> Complex64 {
        at.c1 * self.by[3]
    }

    /// The motional admittance at this time after the start of the stay, with this amplitude of the
    /// free decay.
    pub(crate) fn motion(
        &self,
        at: &ModelEstimate,
        amplitude: Complex64,
        after_s: f64,
    ) -> Complex64 {
        self.forced(at) + amplitude * (self.rate * after_s).exp()
    }

    /// The amplitude of the free decay if the motion starts with this admittance.
    pub(crate) fn amplitude(&self, at: &ModelEstimate, motion: Complex64) -> Complex64 {
        motion - self.forced(at)
    }

    /// Cycles of an integration, in units of ten.
    pub(super) fn tens_of_cycles(&self, integration_s: f64) -> f64 {
        // The derivative with respect to the loss is the angular frequency.
        0.1 * integration_s * self.by[4].re / TAU
    }
}

/// The decay during an integration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Integration {
    seconds: f64,
    mean: Complex64,
    slope: Complex64,
    curve: Complex64,
    mirrored: f64,
}

/// The free decay in a reading.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Decayed {
    /// The begin of the reading, s after that of the stay, and its integration time, s.
    start_s: f64,
    integration_s: f64,
    /// E, dE/ds and d²E/ds².
    pub(super) value: Complex64,
    pub(super) by_rate: Complex64,
    pub(super) by_rate_twice: Complex64,
    /// |E(s*)|².
    pub(super) mirrored: f64,
}

impl Integration {
    /// The decay in a reading that starts at this time, s, with the decay until then.
    fn after(&self, start_s: f64, begin: Complex64) -> Decayed {
        let by_rate = self.mean * start_s + self.slope;
        Decayed {
            start_s,
            integration_s: self.seconds,
            value: begin * self.mean,
            by_rate: begin * by_rate,
            by_rate_twice: begin * ((by_rate + self.slope) * start_s + self.curve),
            mirrored: begin.norm_sqr() * self.mirrored,
        }
    }
}

/// A second mode in a stay, for a capacitance of 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Branch {
    /// Its decay and its rotation relative to the drive, rad/s.
    rate: Complex64,
    /// Its steady-state admittance; `free` is the amplitude of its free decay.
    forced: Complex64,
    free: Complex64,
}

impl Branch {
    /// A mode with this resonance and quality factor at this frequency, with this initial motion.
    pub(crate) fn new(mode_hz: f64, q: f64, frequency_hz: f64, motion: Complex64) -> Self {
        let u = frequency_hz / mode_hz;
        let omega = TAU * frequency_hz;
        let forced = Complex64::new(0.0, omega) / Complex64::new(1.0 - u * u, u / q);
        let root = (1.0 - 0.25 / (q * q)).max(1e-3).sqrt();
        let rate = TAU * mode_hz * Complex64::new(-0.5 / q, root) - Complex64::new(0.0, omega);
        Self { rate, forced, free: motion - forced }
    }

    /// The motion at this time after the start of the stay.
    pub(crate) fn motion(&self, after_s: f64) -> Complex64 {
        self.forced + self.free * self.decay(after_s)
    }

    /// The mean admittance over a reading.
    pub(super) fn mean(&self, start_s: f64, integration_s: f64) -> Complex64 {
        self.forced + self.free * self.decay(start_s) * self.share(integration_s)
    }

    /// The mean admittances over several readings of this integration time at this spacing, s.
    pub(super) fn means(
        self,
        start_s: f64,
        step_s: f64,
        integration_s: f64,
    ) -> impl Iterator<Item = Complex64> {
        let (first, step) = (self.free * self.decay(start_s), self.decay(step_s));
        let share = self.share(integration_s);
        std::iter::successors(Some(first * share), move |free| Some(free * step))
            .map(move |free| self.forced + free)
    }

    fn decay(&self, after_s: f64) -> Complex64 {
        (self.rate * after_s).exp()
    }

    /// The mean of the decay over an integration, relative to its initial value.
    fn share(&self, integration_s: f64) -> Complex64 {
        let x = self.rate * integration_s;
        (x.exp() - 1.0) / x
    }
}

/// The free motion of a stay.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ring {
    /// Its prior mean square, in units of the static deflection.
    pub(crate) square: f64,
    /// The amplitude a, in units of the admittance.
    pub(crate) amplitude: Complex64,
}
