//! A reading while the probe moves: the sensor follows the depth within the integration.
//!
//! The way is cut into pieces of [`PIECE`]. In each one the circuit is that of its middle, so that the error
//! falls with the square of the piece; charge and current go on from piece to piece, and with them the ring-up
//! of the sensor. A clear way is one piece, which ends where the probe touches. At 2 mm/s the pieces are wrong by less than a
//! thousandth of the impedance, against a noise of a hundredth in two cycles
//! (`the_pieces_of_a_reading_agree_with_fine_ones`).
//!
//! Such a reading is computed while time passes: a command that stops the probe in the middle of a reading is in it.
//! A reading that begins at rest is computed at once, because most of them end as they began. The plant is kept as
//! it was; when anything changes before the end, the reading starts again from there and goes on in pieces.

use std::{f64::consts::TAU, time::Duration};

use num_complex::Complex64;
use rig_model::RigTime;

use super::{RINGS, World};
use crate::{clock::after, plant::Plant};

/// Length of a piece of the way in contact.
const PIECE: Duration = Duration::from_micros(250);
/// The frequency at which the static capacitance is that of the sensor, Hz.
const DISPERSION_FROM_HZ: f64 = 140.0;

/// A reading that is under way.
#[derive(Debug, Clone)]
pub(super) struct OpenReading {
    done: RigTime,
    /// Noise and phase error of the analyzer, as a factor of the impedance.
    factor: Complex64,
    /// What the dielectric has beside the capacitance of the plant.
    dispersion_siemens: Complex64,
    value: Value,
}

#[derive(Debug, Clone)]
enum Value {
    /// The probe rests: the impedance is known from the beginning, if nothing changes before the end.
    Whole {
        impedance_ohm: Complex64,
        /// The plant at the beginning, and the time of it.
        plant: Plant,
        began: RigTime,
        /// The time of the whole cycles, s.
        duration_s: f64,
    },
    /// The probe moves, or something has changed.
    Moving {
        /// The drive at the beginning, V.
        drive: Complex64,
        /// Integral of the demodulated current so far, A·s, in the frame of that drive.
        charge: Complex64,
        /// The time integrated so far, and that of the whole cycles, s.
        integrated_s: f64,
        duration_s: f64,
    },
}

impl Value {
    /// Of a reading that begins with the plant as it is.
    fn from_now(plant: &Plant, duration_s: f64) -> Self {
        let drive = plant.drive();
        Self::Moving { drive, charge: Complex64::ZERO, integrated_s: 0.0, duration_s }
    }
}

impl World {
    /// Begins a reading of an ideal lock-in over `cycles` cycles and returns when it ends.
    pub fn begin_reading(&mut self, now: RigTime, cycles: u32) -> RigTime {
        self.glide(now);
        self.reading = None;
        let is_moving = self.mounted.is_some() && self.linear.is_moving(now);
        if is_moving {
            self.watch(now);
            self.glide_piecewise(now);
        } else {
            self.follow_plant(now);
        }
        let duration_s = f64::from(cycles) / self.plant.frequency_hz();
        let done = after(now, duration_s);
        let value = if is_moving {
            Value::from_now(&self.plant, duration_s)
        } else {
            let (plant, began) = (self.plant.clone(), now);
            let impedance_ohm = self.plant.measure(cycles);
            // The plant has moved on by exactly its cycles; the clock rounds them up.
            self.plant.advance((done.since(now).as_secs_f64() - duration_s).max(0.0));
            self.plant_at = done;
            Value::Whole { impedance_ohm, plant, began, duration_s }
        };
        let sigma = self.scene.nuisances.impedance_rel * (10.0 / f64::from(cycles)).sqrt();
        let noise = Complex64::new(self.noise.normal(), self.noise.normal());
        let turn = Complex64::cis(self.scene.nuisances.analyzer_phase_deg.to_radians());
        let (factor, dispersion_siemens) =
            (turn * (1.0 + sigma * noise), self.dispersion_siemens());
        self.reading = Some(OpenReading { done, factor, dispersion_siemens, value });
        done
    }

    /// Ends the reading that was begun last, at its end, and returns it with the noise of the scene, in ohm.
    /// `None` if no reading was begun.
    pub fn end_reading(&mut self) -> Option<Complex64> {
        let done = self.reading.as_ref()?.done;
        self.glide(done);
        let OpenReading { factor, dispersion_siemens, value, .. } = self.reading.take()?;
        let impedance_ohm = match value {
            Value::Whole { impedance_ohm, .. } => impedance_ohm,
            Value::Moving { drive, charge, duration_s, .. } => drive * duration_s / charge,
        };
        Some(impedance_ohm / (1.0 + impedance_ohm * dispersion_siemens) * factor)
    }

    /// What the dielectric has beside a capacitance that is the same at all frequencies.
    fn dispersion_siemens(&self) -> Complex64 {
        let hz = self.plant.frequency_hz();
        let part = (hz / DISPERSION_FROM_HZ).powf(self.scene.nuisances.capacitance_slope) - 1.0;
        Complex64::new(0.0, TAU * hz * self.plant.circuit().capacitance_f * part)
    }

    /// A whole reading with the noise of the scene, in ohm, and its end time.
    pub fn measure(&mut self, now: RigTime, cycles: u32) -> (Complex64, RigTime) {
        let done = self.begin_reading(now, cycles);
        (self.end_reading().unwrap_or(Complex64::ZERO), done)
    }

    /// Brings an open reading up to `now`, before anything changes.
    pub(super) fn glide(&mut self, now: RigTime) {
        let Some(reading) = &mut self.reading else { return };
        let done = reading.done;
        match &reading.value {
            Value::Moving { .. } => self.glide_piecewise(now.min(done)),
            Value::Whole { .. } if done <= now => {}
            Value::Whole { plant, began, duration_s, .. } => {
                self.plant.clone_from(plant);
                self.plant_at = *began;
                reading.value = Value::from_now(&self.plant, *duration_s);
                // Nothing has changed since the beginning.
                self.integrate(now.since(self.plant_at).as_secs_f64());
                self.plant_at = self.plant_at.max(now);
            }
        }
    }

    /// Lets the plant follow the moving probe up to `now`.
    fn glide_piecewise(&mut self, now: RigTime) {
        self.glide_in(now, PIECE);
    }

    /// The same in pieces of this length.
    pub(super) fn glide_in(&mut self, now: RigTime, piece: Duration) {
        while self.plant_at < now {
            let from = self.plant_at;
            self.is_plant_loaded = self.indentation_mm(from) > 0.0;
            // The way and the screw never run backwards, so that both ends tell a clear way.
            let until = match (self.is_plant_loaded, self.indentation_mm(now) > 0.0) {
                (false, false) => now,
                (false, true) => self.crossing(from, now),
                (true, _) => now.min(from + piece),
            };
            let middle = RigTime::from_micros(from.as_micros().midpoint(until.as_micros()));
            let circuit = self.circuit(middle);
            self.plant.set_circuit(circuit).expect(RINGS);
            self.integrate(until.since(from).as_secs_f64());
            self.plant_at = until;
        }
        self.is_plant_loaded = self.indentation_mm(self.plant_at) > 0.0;
    }

    /// Lets time pass in the plant, and integrates as far as the cycles of an open reading go.
    fn integrate(&mut self, seconds: f64) {
        let Some(OpenReading {
            value: Value::Moving { drive, charge, integrated_s, duration_s },
            ..
        }) = &mut self.reading
        else {
            return self.plant.advance(seconds);
        };
        let part_s = seconds.min(*duration_s - *integrated_s).max(0.0);
        // From the frame of the drive here to that at the beginning of the reading.
        let turned = *drive / self.plant.drive();
        *charge += turned * self.plant.integrate(part_s);
        *integrated_s += part_s;
        self.plant.advance((seconds - part_s).max(0.0));
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{AxisId, Nuisances, Profile, Scene},
        *,
    };
    use crate::scene::matched;

    fn at(seconds: f64) -> RigTime {
        RigTime::ZERO + Duration::from_secs_f64(seconds)
    }

    /// A bench without nuisances whose probe goes down into a sample from 0.1 mm above it, from 10 s on.
    fn descending(sample: &str, speed: f64) -> World {
        let mut world = World::new(Scene { nuisances: Nuisances::NONE, ..matched() }, 1).unwrap();
        world.place_sample(RigTime::ZERO, sample).unwrap();
        world.set_frequency(RigTime::ZERO, 140.4);
        let surface_mm = world.scene().place.surface_mm;
        let fast = Profile { speed: 50.0, acceleration: 1000.0, deceleration: 1000.0 };
        world.drive(at(0.0), AxisId::Linear).start(at(0.0), surface_mm + 0.1, &fast);
        world.measure(at(9.9), 2);
        let slow = Profile { speed, acceleration: 200.0, deceleration: 200.0 };
        world.drive(at(10.0), AxisId::Linear).start(at(10.0), surface_mm - 0.4, &slow);
        world
    }

    /// Readings of two cycles, each 6 ms after the one before, until the probe is `depth_mm` deep.
    fn readings(world: &mut World, piece: Option<Duration>, depth_mm: f64) -> Vec<Complex64> {
        let mut now = at(10.001);
        let mut found = Vec::new();
        while world.indentation_mm(now) < depth_mm {
            let done = world.begin_reading(now, 2);
            if let Some(piece) = piece {
                world.glide_in(done, piece);
            }
            found.extend(world.end_reading());
            now = done + Duration::from_millis(6);
        }
        found
    }

    #[test]
    fn the_pieces_of_a_reading_agree_with_fine_ones() {
        for (sample, speed) in [("1", 1.0), ("3", 1.0), ("5", 1.0), ("1", 2.0), ("5", 2.0)] {
            let fine = Duration::from_micros(20);
            let fine = readings(&mut descending(sample, speed), Some(fine), 0.1);
            let coarse = readings(&mut descending(sample, speed), None, 0.1);
            assert!(fine.len() == coarse.len() && fine.len() > 4, "{}", fine.len());
            let error =
                |(one, other): (&Complex64, &Complex64)| (one - other).norm() / other.norm();
            let worst = coarse.iter().zip(&fine).map(error).fold(0.0, f64::max);
            assert!(worst < 6e-4, "sample {sample} at {speed} mm/s: {worst}");
            let changed = error((&fine[fine.len() - 1], &fine[0]));
            assert!(0.05 < changed, "sample {sample} at {speed} mm/s: {changed}");
        }
    }

    #[test]
    fn a_stop_within_a_reading_is_in_it() {
        let stopped = |after_s: Option<f64>| {
            let mut world = descending("3", 1.0);
            let now = at(10.13);
            let done = world.begin_reading(now, 2);
            if let Some(seconds) = after_s {
                let moment = now + Duration::from_secs_f64(seconds);
                world.drive(moment, AxisId::Linear).stop(moment, 200.0);
            }
            let value = world.end_reading().unwrap();
            (value, world.indentation_mm(done))
        };
        let (going, deep_mm) = stopped(None);
        let (at_once, shallow_mm) = stopped(Some(0.001));
        let (late, _) = stopped(Some(0.0135));
        assert!(shallow_mm + 0.008 < deep_mm, "{shallow_mm} {deep_mm}");
        assert!((going - at_once).norm() > 3.0 * (going - late).norm());
    }

    /// A bench with the probe at rest, 0.05 mm deep in sample 3 since long.
    fn resting() -> World {
        let mut world = World::new(Scene { nuisances: Nuisances::NONE, ..matched() }, 1).unwrap();
        world.place_sample(RigTime::ZERO, "3").unwrap();
        world.set_frequency(RigTime::ZERO, 140.4);
        let target = world.scene().place.surface_mm - 0.05;
        let fast = Profile { speed: 50.0, acceleration: 1000.0, deceleration: 1000.0 };
        world.drive(at(0.0), AxisId::Linear).start(at(0.0), target, &fast);
        world
    }

    #[test]
    fn a_move_that_begins_within_a_reading_at_rest_is_in_it() {
        let deeper = Profile { speed: 2.0, acceleration: 200.0, deceleration: 200.0 };
        let moved_at = |after_s: Option<f64>| {
            let mut world = resting();
            let now = at(10.0);
            let done = world.begin_reading(now, 20);
            if let Some(seconds) = after_s {
                let moment = now + Duration::from_secs_f64(seconds);
                let target = world.scene().place.surface_mm - 0.45;
                world.drive(moment, AxisId::Linear).start(moment, target, &deeper);
            }
            (world.end_reading().unwrap(), done)
        };
        let (rest, done) = moved_at(None);
        let differs = |after_s| (moved_at(Some(after_s)).0 - rest).norm() / rest.norm();
        let (early, late) = (differs(0.02), differs(0.12));
        assert!(0.05 < early && late < 0.5 * early, "{early} {late}");
        // A move that begins with the end of the reading leaves it as it is.
        let at_end = differs(done.since(at(10.0)).as_secs_f64());
        assert!(at_end == 0.0, "{at_end}");
    }

    /// The pieces of an undisturbed reading make the same impedance as the closed form.
    #[test]
    fn a_disturbance_without_effect_leaves_a_reading_at_rest_as_it_is() {
        let reading = |is_disturbed: bool| {
            let mut world = resting();
            // Still ringing after the step of the frequency.
            world.set_frequency(at(9.99), 141.0);
            world.begin_reading(at(10.0), 20);
            if is_disturbed {
                world.drive(at(10.05), AxisId::Rotary).stop(at(10.05), 100.0);
            }
            world.end_reading().unwrap()
        };
        let (whole, pieces) = (reading(false), reading(true));
        assert!((whole - pieces).norm() < 1e-9 * whole.norm(), "{whole} {pieces}");
    }

    #[test]
    fn a_reading_at_rest_that_is_given_up_leaves_the_plant_in_the_present() {
        let mut world = resting();
        let done = world.begin_reading(at(10.0), 2000);
        world.set_frequency(at(10.2), 150.0);
        let given_up = world.measure(at(10.3), 2).0;
        assert!(at(20.0) < done);
        let mut other = resting();
        other.set_frequency(at(10.2), 150.0);
        let expected = other.measure(at(10.3), 2).0;
        // The phase of the new frequency is that of the same moment.
        assert!((given_up - expected).norm() < 1e-9 * expected.norm(), "{given_up} {expected}");
    }

    #[test]
    fn a_reading_that_nobody_ends_leaves_no_trace() {
        let mut world = descending("3", 1.0);
        world.begin_reading(at(10.13), 200);
        world.set_frequency(at(10.2), 150.0);
        let whole = world.measure(at(30.0), 2).0;
        let mut other = descending("3", 1.0);
        other.set_frequency(at(10.2), 150.0);
        let settled = other.measure(at(30.0), 2).0;
        assert!((whole - settled).norm() < 1e-9 * settled.norm(), "{whole} {settled}");
    }
}
