//! Whether a stream of readings shows a contact: a sequential test against the readings at its beginning.
//!
//! A reading of a clear probe deviates from their mean by noise alone, so that T = |δ|²/2σ² has the
//! exponential distribution with mean 1. The sum S ← max(0, S + T − c) is a contact when it reaches h. Between
//! two zeros of S it reaches h with a probability of at most e^(−θh), where e^(−cθ) = 1 − θ: so a stream of N
//! clear readings is taken for a contact with a probability of at most N e^(−θh).
//!
//! A single reading that deviates by √(2(h + c)) = 6.9 σ is noticed at once, two in a row of 5.4 σ each, and
//! four of 4.4 σ. Whatever deviates by the contact threshold of the protocol is a contact without a test.
//!
//! # Source
//! Page, Biometrika 41 (1954) 100 (the sum); Kingman, J. R. Stat. Soc. B 32 (1970) 102 (the bound).

use num_complex::Complex64;
use rig_model::Impedance;

use crate::Resonance;

/// Number of readings in the mean with which the others are compared.
pub(super) const REFERENCES: usize = 8;

/// c, and the θ that belongs to it. Larger than the mean of T, also where the mean of the references is 3 of
/// its standard deviations off.
const SLACK: f64 = 5.0;
const DECAY: f64 = 0.993;

/// Number of readings of a stream, at the most, for the rate of false alarms.
const READINGS_MAX: f64 = 200.0;

/// The variance of the noise may be wrong by this many standard deviations of its estimate.
const NOISE_SIGMAS: f64 = 3.0;

/// What a reading says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watched {
    /// It belongs to the readings of the clear probe with which the others are compared.
    Reference,
    /// The probe is clear.
    Clear,
    /// The probe touches.
    Contact,
}

/// A sequential test for a contact.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactWatch {
    sum: Complex64,
    references: usize,
    /// Variance of each part of a relative deviation from the mean of the references.
    variance: f64,
    threshold: f64,
    limit: f64,
    statistic: f64,
}

impl ContactWatch {
    /// Probability with which a descent of at most 200 readings through air is taken for a contact.
    pub const FALSE_ALARMS: f64 = 1e-6;

    /// For readings of this many cycles. `threshold` is the relative change that is a contact in any case.
    pub fn new(free: &Resonance, cycles: f64, threshold: f64) -> Self {
        Self::with_false_alarms(free, cycles, threshold, Self::FALSE_ALARMS)
    }

    fn with_false_alarms(free: &Resonance, cycles: f64, threshold: f64, rate: f64) -> Self {
        let dof = free.noise_degrees_of_freedom.max(1.0);
        let unsure = 1.0 + NOISE_SIGMAS * (2.0 / dof).sqrt();
        let noise = free.noise_at_ten_cycles.powi(2) * 10.0 / cycles;
        Self {
            sum: Complex64::ZERO,
            references: 0,
            variance: noise * unsure * (1.0 + 1.0 / REFERENCES as f64),
            threshold,
            limit: (READINGS_MAX / rate).ln() / DECAY,
            statistic: 0.0,
        }
    }

    /// The mean of the references, ohm; `None` before they are complete.
    pub fn reference(&self) -> Option<Impedance> {
        let mean = self.sum / self.references as f64;
        let impedance = Impedance { resistance_ohm: mean.re, reactance_ohm: mean.im };
        (self.references == REFERENCES).then_some(impedance)
    }

    /// Number of readings at the beginning that are compared with nothing.
    pub const fn references() -> usize {
        REFERENCES
    }

    /// Forgets what the readings so far have added up to, after a false alarm; the references stay.
    pub const fn forget(&mut self) {
        self.statistic = 0.0;
    }

    /// Takes the next reading.
    pub fn read(&mut self, impedance: Impedance) -> Watched {
        let now = Complex64::new(impedance.resistance_ohm, impedance.reactance_ohm);
        if self.references < REFERENCES {
            self.sum += now;
            self.references += 1;
            return Watched::Reference;
        }
        let deviation = (now * REFERENCES as f64 / self.sum - 1.0).norm();
        let excess = 0.5 * deviation * deviation / self.variance - SLACK;
        self.statistic = (self.statistic + excess).max(0.0);
        // A reading that cannot be compared counts as contact.
        let is_clear = deviation <= self.threshold && self.statistic < self.limit;
        if is_clear { Watched::Clear } else { Watched::Contact }
    }
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::{super::model::tests::free, *};

    fn reading(stream: &mut Stream, sigma: f64, moved: Complex64) -> Impedance {
        let noise = Complex64::new(stream.normal(), stream.normal());
        let value = Complex64::new(900.0, -2400.0) * (1.0 + sigma * noise + moved);
        Impedance { resistance_ohm: value.re, reactance_ohm: value.im }
    }

    /// The rate itself is too low to be seen; with the same test at a higher one, the bound holds, with the
    /// mean of the references as it comes.
    #[test]
    fn a_clear_stream_is_taken_for_a_contact_as_rarely_as_is_stated() {
        let free = free();
        let sigma = free.noise_at_ten_cycles * 5.0_f64.sqrt();
        let (rate, streams) = (0.01, 20_000);
        let mut stream = Stream::of_seed(1);
        let mut alarms = 0;
        for _ in 0..streams {
            let mut watch = ContactWatch::with_false_alarms(&free, 2.0, 1.0, rate);
            let seen = |_: usize| watch.read(reading(&mut stream, sigma, Complex64::ZERO));
            alarms += u32::from((0..200).map(seen).any(|seen| seen == Watched::Contact));
        }
        let found = f64::from(alarms) / f64::from(streams);
        assert!(found <= rate, "{found}");
    }

    /// A change of m standard deviations of the test is noticed after (h + c)/(½m² − c) readings on average, or
    /// less than one more; the mean of the references is off too, so that some need longer.
    #[test]
    fn a_change_is_noticed_after_the_stated_number_of_readings() {
        let free = free();
        let sigma = free.noise_at_ten_cycles * 5.0_f64.sqrt();
        let (mut stream, streams) = (Stream::of_seed(2), 2000);
        for (sigmas, most) in [(9.0_f64, 2), (6.5, 4), (5.0, 12)] {
            let mut all = 0;
            for _ in 0..streams {
                let mut watch = ContactWatch::new(&free, 2.0, 1.0);
                for _ in 0..20 {
                    let seen = watch.read(reading(&mut stream, sigma, Complex64::ZERO));
                    assert_ne!(seen, Watched::Contact);
                }
                let moved = sigmas * watch.variance.sqrt() * Complex64::cis(stream.uniform());
                let mut after = 1;
                while watch.read(reading(&mut stream, sigma, moved)) != Watched::Contact {
                    after += 1;
                    assert!(after <= most, "{sigmas} standard deviations: {after} readings");
                }
                all += after;
            }
            let limit = ContactWatch::new(&free, 2.0, 1.0).limit;
            let stated = (limit + SLACK) / (0.5 * sigmas * sigmas - SLACK);
            let mean = f64::from(all) / f64::from(streams);
            assert!(mean < stated + 1.0, "{sigmas} standard deviations: {mean}, stated {stated}");
        }
    }

    #[test]
    fn the_threshold_of_the_protocol_and_what_is_no_number_are_contacts_at_once() {
        let free = free();
        for value in [Complex64::new(1000.0, -2400.0), Complex64::new(f64::NAN, 0.0)] {
            let mut watch = ContactWatch::new(&free, 1e-3, 0.02);
            let mut stream = Stream::of_seed(3);
            for _ in 0..REFERENCES {
                assert_eq!(watch.reference(), None);
                watch.read(reading(&mut stream, 0.0, Complex64::ZERO));
            }
            assert!(watch.reference().is_some());
            let seen = Impedance { resistance_ohm: value.re, reactance_ohm: value.im };
            assert_eq!(watch.read(seen), Watched::Contact);
        }
    }
}
