//! The sensor as an electrical load in time: exact, between any two moments, for any step of the
//! drive.
//!
//! A resonance rings up and dies away with a time constant of many cycles, so that a reading taken
//! too early shows the past of the drive as well as the sensor. This module carries the motional
//! state (the charge and the current of the series branch) through every change of frequency and of
//! the sensor itself, and integrates the lock-in over it in closed form. Where the circuit comes
//! from, and what noise and rounding do to the result, is left to others.
//!
//! ```text
//!        ┌──── C0 (1 − j tan δ) ────┐
//!   v ───┤                          ├───      v(t) = Re(V e^{jωt}), phase continuous
//!        └──── R1 ─── L1 ─── C1 ────┘
//! ```

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_contact::Circuit;

/// The circuit does not ring: its quality is at most 1/2, or no number.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("quality factor {q} is not above 1/2: the sensor does not ring")]
pub struct NotRinging {
    /// The quality factor.
    pub q: f64,
}

/// The elements of a circuit, as its equations of motion want them.
#[derive(Debug, Clone, Copy)]
struct Elements {
    parallel_f: f64,
    loss_tangent: f64,
    resistance_ohm: f64,
    inductance_h: f64,
    series_f: f64,
    /// The free motion e^{st} of the series branch, s = −γ + jω, in rad/s.
    free: Complex64,
}

impl Elements {
    fn of(circuit: &Circuit) -> Result<Self, NotRinging> {
        let Circuit { series_resonance_hz, q, capacitance_f, capacitance_ratio, dielectric_loss } =
            *circuit;
        // Written so that a quality that is not a number is refused too.
        if !(q > 0.5 && q.is_finite()) {
            return Err(NotRinging { q });
        }
        let omega = TAU * series_resonance_hz;
        let series_f = capacitance_f * capacitance_ratio;
        let inductance_h = 1.0 / (omega * omega * series_f);
        let damping = omega / (2.0 * q);
        let ringing = omega * (1.0 - 0.25 / (q * q)).sqrt();
        Ok(Self {
            parallel_f: capacitance_f,
            loss_tangent: dielectric_loss,
            resistance_ohm: omega * inductance_h / q,
            inductance_h,
            series_f,
            free: Complex64::new(-damping, ringing),
        })
    }

    fn parallel_admittance(&self, omega: f64) -> Complex64 {
        omega * self.parallel_f * Complex64::new(self.loss_tangent, 1.0)
    }

    fn series_impedance(&self, omega: f64) -> Complex64 {
        let reactance = omega * self.inductance_h - 1.0 / (omega * self.series_f);
        Complex64::new(self.resistance_ohm, reactance)
    }
}

/// A circuit under a sinusoidal drive, with its memory.
#[derive(Debug, Clone)]
pub struct Plant {
    circuit: Circuit,
    elements: Elements,
    frequency_hz: f64,
    /// The drive now: v = Re(drive). It turns with time and never jumps.
    drive: Complex64,
    charge_coulomb: f64,
    current_ampere: f64,
}

impl Plant {
    /// A circuit at rest, whose drive of 1 V begins now at its crest.
    ///
    /// # Errors
    /// [`NotRinging`].
    pub fn at_rest(circuit: Circuit, frequency_hz: f64) -> Result<Self, NotRinging> {
        let elements = Elements::of(&circuit)?;
        let drive = Complex64::ONE;
        Ok(Self {
            circuit,
            elements,
            frequency_hz,
            drive,
            charge_coulomb: 0.0,
            current_ampere: 0.0,
        })
    }

    /// The present circuit.
    pub fn circuit(&self) -> &Circuit {
        &self.circuit
    }

    /// The frequency of the drive, in Hz.
    pub fn frequency_hz(&self) -> f64 {
        self.frequency_hz
    }

    /// Changes the circuit now. Charge and current stay: nothing mechanical jumps.
    ///
    /// # Errors
    /// [`NotRinging`]; the circuit then stays.
    pub fn set_circuit(&mut self, circuit: Circuit) -> Result<(), NotRinging> {
        self.elements = Elements::of(&circuit)?;
        self.circuit = circuit;
        Ok(())
    }

    /// Changes the frequency of the drive now, without a jump of its phase.
    pub fn set_frequency(&mut self, frequency_hz: f64) {
        self.frequency_hz = frequency_hz;
    }

    /// Changes the amplitude of the drive by a factor, now, without a jump of its phase.
    pub(crate) fn scale_drive(&mut self, factor: f64) {
        self.drive *= factor;
    }

    /// Turns the phase of the drive now, by this many radians.
    pub fn turn_drive(&mut self, radians: f64) {
        self.drive *= Complex64::cis(radians);
    }

    /// Lets time pass.
    pub fn advance(&mut self, seconds: f64) {
        let transient = self.transient();
        self.drive *= Complex64::cis(TAU * self.frequency_hz * seconds);
        let steady = self.steady_current();
        let s = self.elements.free;
        let left = transient * (s * seconds).exp();
        // The charge is the integral of the current; of Re(A e^{st}) it is Re(A e^{st} / s).
        let omega = TAU * self.frequency_hz;
        self.current_ampere = steady.re + left.re;
        self.charge_coulomb = (steady / Complex64::new(0.0, omega)).re + (left / s).re;
    }

    /// The impedance that a lock-in finds over the next `cycles` whole cycles, in ohm. Time passes.
    pub fn measure(&mut self, cycles: u32) -> Complex64 {
        let omega = TAU * self.frequency_hz;
        let duration_s = f64::from(cycles) / self.frequency_hz;
        let transient = self.transient();
        // Re(A e^{st}) after demodulation by e^{-jωt}: half of A at s − jω and half of its
        // conjugate at s* − jω. Over whole cycles e^{-jωT} is 1.
        let part = |amplitude: Complex64, s: Complex64| {
            amplitude * ((s * duration_s).exp() - 1.0) / (s - Complex64::new(0.0, omega))
        };
        let s = self.elements.free;
        let ringing_current = (part(transient, s) + part(transient.conj(), s.conj())) / duration_s;
        let parallel_current = self.elements.parallel_admittance(omega) * self.drive;
        let current = self.steady_current() + ringing_current + parallel_current;
        let impedance_ohm = self.drive / current;
        self.advance(duration_s);
        impedance_ohm
    }

    /// The drive now, V.
    pub(crate) fn drive(&self) -> Complex64 {
        self.drive
    }

    /// The integral of the current over the next `seconds`, demodulated by a lock-in in the frame of the drive
    /// now, in A·s. Time passes. Over whole cycles it is the current of [`measure`](Self::measure) times their
    /// duration.
    pub(crate) fn integrate(&mut self, seconds: f64) -> Complex64 {
        let omega = TAU * self.frequency_hz;
        let transient = self.transient();
        let steady = self.steady_current() + self.elements.parallel_admittance(omega) * self.drive;
        // 2 Re(A e^{st}) e^{-jωt} is A e^{(s−jω)t} + A* e^{(s*−jω)t}, for the steady current with s = jω.
        let part = |amplitude: Complex64, s: Complex64| {
            let s = s - Complex64::new(0.0, omega);
            amplitude * ((s * seconds).exp() - 1.0) / s
        };
        let s = self.elements.free;
        let ringing = part(transient, s) + part(transient.conj(), s.conj());
        let mirrored = part(steady.conj(), Complex64::new(0.0, -omega));
        self.advance(seconds);
        steady * seconds + mirrored + ringing
    }

    fn steady_current(&self) -> Complex64 {
        self.drive / self.elements.series_impedance(TAU * self.frequency_hz)
    }

    /// The amplitude A of the free motion Re(A e^{st}) of the current: what distinguishes the state
    /// from the steady one.
    fn transient(&self) -> Complex64 {
        let omega = TAU * self.frequency_hz;
        let steady = self.steady_current();
        let current = self.current_ampere - steady.re;
        let charge = self.charge_coulomb - (steady / Complex64::new(0.0, omega)).re;
        let s = self.elements.free;
        Complex64::new(current, (s.norm_sqr() * charge - s.re * current) / s.im)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circuit(resonance_hz: f64, quality: f64) -> Circuit {
        Circuit {
            series_resonance_hz: resonance_hz,
            q: quality,
            capacitance_f: 27.4e-9,
            capacitance_ratio: 0.08,
            dielectric_loss: 0.018,
        }
    }

    /// The same circuit integrated blindly: fourth-order Runge–Kutta on charge and current, with
    /// the lock-in as two more integrals.
    struct Integrator {
        charge: f64,
        current: f64,
        phase: f64,
    }

    impl Integrator {
        fn run(&mut self, circuit: &Circuit, frequency_hz: f64, seconds: f64) -> Complex64 {
            let omega = TAU * frequency_hz;
            let elements = Elements::of(circuit).unwrap();
            let steps = (seconds * frequency_hz * 4000.0).ceil().max(1.0);
            let dt = seconds / steps;
            let slope = |t: f64, q: f64, i: f64| {
                let volt = (self.phase + omega * t).cos();
                let rate = (volt - elements.resistance_ohm * i - q / elements.series_f)
                    / elements.inductance_h;
                (i, rate, i * Complex64::cis(-omega * t))
            };
            let (mut q, mut i, mut sum) = (self.charge, self.current, Complex64::ZERO);
            let mut t = 0.0;
            while t < seconds - 0.5 * dt {
                let a = slope(t, q, i);
                let b = slope(t + 0.5 * dt, q + 0.5 * dt * a.0, i + 0.5 * dt * a.1);
                let c = slope(t + 0.5 * dt, q + 0.5 * dt * b.0, i + 0.5 * dt * b.1);
                let d = slope(t + dt, q + dt * c.0, i + dt * c.1);
                q += dt / 6.0 * (a.0 + 2.0 * b.0 + 2.0 * c.0 + d.0);
                i += dt / 6.0 * (a.1 + 2.0 * b.1 + 2.0 * c.1 + d.1);
                sum += dt / 6.0 * (a.2 + 2.0 * b.2 + 2.0 * c.2 + d.2);
                t += dt;
            }
            let drive = Complex64::cis(self.phase);
            (self.charge, self.current, self.phase) = (q, i, self.phase + omega * seconds);
            let parallel_current = elements.parallel_admittance(omega) * drive;
            drive / (2.0 / seconds * sum + parallel_current)
        }
    }

    #[test]
    fn the_closed_form_agrees_with_blind_integration_through_every_kind_of_change() {
        for quality in [0.7, 8.0, 100.0] {
            let free = circuit(140.4, quality);
            let touched = circuit(181.0, 0.6 * quality.max(1.0));
            let mut plant = Plant::at_rest(free, 130.0).unwrap();
            let mut blind = Integrator { charge: 0.0, current: 0.0, phase: 0.0 };
            let visits = [
                (free, 130.0, 0.0, 2),
                (free, 139.0, 0.0031, 1),
                (free, 141.3, 0.02, 5),
                (touched, 141.3, 0.0007, 3),
                (touched, 190.0, 0.0, 4),
            ];
            for (circuit, frequency_hz, settle_s, cycles) in visits {
                plant.set_circuit(circuit).unwrap();
                plant.set_frequency(frequency_hz);
                plant.advance(settle_s);
                let found = plant.measure(cycles);
                if settle_s > 0.0 {
                    blind.run(&circuit, frequency_hz, settle_s);
                }
                let expected = blind.run(&circuit, frequency_hz, f64::from(cycles) / frequency_hz);
                let error = (found - expected).norm() / expected.norm();
                assert!(error < 1e-8, "Q {quality}, {frequency_hz} Hz: {found} {expected} {error}");
            }
        }
    }

    #[test]
    fn after_many_time_constants_only_the_steady_impedance_is_left() {
        let mut plant = Plant::at_rest(circuit(140.4, 30.0), 139.0).unwrap();
        let early = plant.measure(1);
        plant.advance(5.0);
        let late = plant.measure(1);
        let steady = plant.circuit().impedance_ohm(139.0);
        assert!((late - steady).norm() < 1e-12 * steady.norm());
        assert!((early - steady).norm() > 0.1 * steady.norm());
    }

    #[test]
    fn time_may_be_cut_anywhere_and_the_drive_has_no_influence_on_impedance() {
        let mut whole = Plant::at_rest(circuit(140.4, 30.0), 139.0).unwrap();
        let mut cut = whole.clone();
        cut.scale_drive(5.0);
        whole.advance(0.0437);
        for piece in [0.0100, 0.0007, 0.0330] {
            cut.advance(piece);
        }
        let (whole, cut) = (whole.measure(2), cut.measure(2));
        assert!((whole - cut).norm() < 1e-11 * whole.norm(), "{whole} {cut}");
    }

    #[test]
    fn a_reading_in_pieces_is_the_whole_reading() {
        let mut whole = Plant::at_rest(circuit(140.4, 30.0), 139.0).unwrap();
        whole.advance(0.0123);
        let mut cut = whole.clone();
        let drive = cut.drive();
        let duration_s = 2.0 / 139.0;
        let mut charge = Complex64::ZERO;
        for part in [0.1, 0.35, 0.05, 0.5] {
            let turned = drive / cut.drive();
            charge += turned * cut.integrate(part * duration_s);
        }
        let (whole, cut) = (whole.measure(2), drive * duration_s / charge);
        assert!((whole - cut).norm() < 1e-11 * whole.norm(), "{whole} {cut}");
    }

    #[test]
    fn a_turn_of_the_drive_sets_the_branch_ringing_at_its_own_frequency() {
        let mut plant = Plant::at_rest(circuit(140.4, 30.0), 140.4).unwrap();
        plant.advance(5.0);
        let settled = plant.measure(1);
        plant.turn_drive(std::f64::consts::PI);
        let turned = plant.measure(1);
        assert!((turned - settled).norm() > settled.norm(), "{turned} {settled}");
        plant.advance(5.0);
        assert!((plant.measure(1) - settled).norm() < 1e-10 * settled.norm());
    }

    #[test]
    fn a_circuit_that_does_not_ring_is_refused() {
        assert!(Plant::at_rest(circuit(140.4, 0.501), 139.0).is_ok());
        let refused = Plant::at_rest(circuit(140.4, 0.5), 139.0).unwrap_err();
        assert_eq!(refused, NotRinging { q: 0.5 });
        let mut plant = Plant::at_rest(circuit(140.4, 30.0), 139.0).unwrap();
        assert!(plant.set_circuit(circuit(140.4, f64::NAN)).is_err());
        assert_eq!(plant.circuit().q, 30.0);
    }
}
