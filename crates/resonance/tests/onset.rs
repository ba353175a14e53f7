//! The surface from a descent on the simulated bench, whose contact is another one than the one that is fitted.

use std::time::Duration;

use num_complex::Complex64;
use rig_model::{Impedance, PointResult, Reading, RigTime};
use rig_resonance::{
    ContactWatch, EvenWay, FitOptions, FitOutcome, Latency, Onset, Resonance, Watched, fit,
};
use rig_sim::{
    scene::paper,
    world::{AxisId, Nuisances, Profile, Scene, World},
};

const PER_COMMAND: Duration = Duration::from_millis(6);
const ACCELERATION: f64 = 200.0;

fn at(seconds: f64) -> RigTime {
    RigTime::ZERO + Duration::from_secs_f64(seconds)
}

/// A reading whose frequency was set at `set_at`, and its end.
fn read(
    world: &mut World,
    hz: f64,
    set_at: RigTime,
    now: RigTime,
    cycles: u32,
) -> (Reading, RigTime) {
    let done = world.begin_reading(now, cycles);
    let value = world.end_reading().expect("a reading was begun");
    let Complex64 { re: resistance_ohm, im: reactance_ohm } = value;
    let reading = Reading {
        frequency_hz: hz,
        measured: PointResult::Value(Impedance { resistance_ohm, reactance_ohm }),
        started: set_at,
        settle_s: now.since(set_at).as_secs_f64(),
        integration_s: f64::from(cycles) / hz,
    };
    (reading, done)
}

/// The no-load resonance, from settled readings.
fn no_load(world: &mut World) -> (Resonance, RigTime) {
    let (mut now, mut readings) = (at(10.0), Vec::new());
    for step in 0..60 {
        let hz = 137.0 + 0.12 * f64::from(step);
        world.set_frequency(now, hz);
        let begin = now + Duration::from_secs(2);
        let (reading, done) = read(world, hz, now, begin, 20);
        readings.push(reading);
        now = done;
    }
    match fit(&readings, &FitOptions::default()) {
        FitOutcome::Accepted(resonance) => (resonance, now),
        FitOutcome::Refused(refusal) => panic!("{refusal}"),
    }
}

/// What a descent has found, and what is true, mm.
struct Descended {
    found: Result<Onset, rig_resonance::OnsetRefusal>,
    surface_mm: f64,
    /// How deep the probe was when the contact was noticed.
    noticed_mm: f64,
    /// How far the surface lies elsewhere if the no-load resonance is [`WRONG_HZ`] higher.
    moved_mm: Option<f64>,
}

/// As wrong as the no-load resonance of a planned sweep of the shipped protocols is in one of a thousand.
const WRONG_HZ: f64 = 0.03;

fn descend(sample: &str, seed: u64, speed: f64, late_s: f64) -> Descended {
    let nuisances = Nuisances { impedance_rel: 0.005, ..Nuisances::NONE };
    let mut world = World::new(Scene { nuisances, ..paper() }, seed).expect("the scene is sound");
    world.place_sample(RigTime::ZERO, sample).expect("the scene has it");
    let (free, mut now) = no_load(&mut world);
    let hz = free.resonance_hz;
    world.set_frequency(now, hz);
    let set_at = now;
    let fast = Profile { speed: 20.0, acceleration: ACCELERATION, deceleration: ACCELERATION };
    // At another height for each seed, so that the phase of readings and surface is any.
    let from_mm = world.scene().place.surface_mm + 0.1 + 0.2 * speed + 0.002 * (seed % 20) as f64;
    world.drive(now, AxisId::Linear).start(now, from_mm, &fast);
    now = now + Duration::from_secs(5);
    let slow = Profile { speed, ..fast };
    world.drive(now, AxisId::Linear).start(now, from_mm - 0.8, &slow);
    let began = now;
    let mut watch = ContactWatch::new(&free, 2.0, 0.1);
    let mut readings = Vec::new();
    let late = Duration::from_secs_f64(late_s);
    let noticed = loop {
        let begin = now + PER_COMMAND;
        let (mut reading, done) = read(&mut world, hz, set_at, begin + late, 2);
        reading.settle_s -= late_s;
        readings.push(reading);
        now = done;
        let PointResult::Value(value) = reading.measured else { unreachable!() };
        if watch.read(value) == Watched::Contact {
            break now;
        }
        assert!(now < began + Duration::from_secs(2), "no contact: {sample} {seed}");
    };
    let stopped = noticed + Duration::from_millis(5);
    world.drive(stopped, AxisId::Linear).stop(stopped, ACCELERATION);
    let rest_mm = world.stage(AxisId::Linear).target();
    for _ in 0..3 {
        let begin = now + PER_COMMAND;
        let (mut reading, done) = read(&mut world, hz, set_at, begin + late, 2);
        reading.settle_s -= late_s;
        // One that saw the stop is left out.
        if world.stage(AxisId::Linear).rests_from() < begin {
            readings.push(reading);
        }
        now = done;
    }
    let ramp_s = speed / ACCELERATION;
    let way = EvenWay {
        time_s: began.as_seconds() + ramp_s,
        at_mm: from_mm - 0.5 * speed * ramp_s,
        sigma_mm: 0.0,
        speed_mm_per_s: speed,
        rest_mm,
    };
    let depth_mm = world.truth(now).indentation_mm;
    let noticed_mm = depth_mm - (way.position_mm(noticed.as_seconds()) - rest_mm).max(0.0);
    let latency = Latency { mean_s: 0.0, sigma_s: 0.003 };
    let found = Onset::fit(&free, &readings, &way, latency, 0.01);
    let higher = Resonance { resonance_hz: free.resonance_hz + WRONG_HZ, ..free };
    let moved = Onset::fit(&higher, &readings, &way, latency, 0.01);
    let moved_mm = found.ok().zip(moved.ok()).map(|(one, other)| other.surface_mm - one.surface_mm);
    Descended { found, surface_mm: rest_mm + depth_mm, noticed_mm, moved_mm }
}

/// Errors in µm with their stated standard deviations, refusals, and depths at which contacts are noticed, µm.
fn errors(sample: &str, speed: f64, late_s: f64, seeds: u64) -> (Vec<(f64, f64)>, u32, Vec<f64>) {
    let (mut errors, mut refused, mut depths) = (Vec::new(), 0, Vec::new());
    for seed in 0..seeds {
        let Descended { found, surface_mm, noticed_mm, moved_mm } =
            descend(sample, seed, speed, late_s);
        depths.push(1e3 * noticed_mm);
        match found {
            Ok(onset) => {
                let moved_sigmas = moved_mm.map_or(0.0, |moved_mm| moved_mm / onset.sigma_mm);
                assert!(moved_sigmas.abs() < 0.5, "{sample}, {seed}: {moved_sigmas}");
                errors.push((1e3 * (onset.surface_mm - surface_mm), 1e3 * onset.sigma_mm));
            }
            Err(_) => refused += 1,
        }
    }
    depths.sort_by(f64::total_cmp);
    (errors, refused, depths)
}

/// At any latency within two standard deviations of what was expected. `cargo test -p rig-resonance --test onset -- --nocapture`
/// prints the figures.
#[test]
fn the_surface_is_found_within_its_standard_deviation() {
    // Speed, sample, latency, and the largest mean depth at which the contact is noticed, µm.
    let rows = [
        (1.0, "1", 0.0, 45.0),
        (1.0, "3", 0.0, 30.0),
        (1.0, "5", 0.0, 30.0),
        (1.0, "1", 0.004, 45.0),
        (1.0, "5", 0.004, 30.0),
        (2.0, "1", 0.0, 75.0),
        (2.0, "5", 0.004, 50.0),
    ];
    for (speed, sample, late_s, noticed_um) in rows {
        let (errors, refused, depths) = errors(sample, speed, late_s, 16);
        let n = errors.len() as f64;
        let bias = errors.iter().map(|(error, _)| error).sum::<f64>() / n - 1e3 * speed * late_s;
        let rms = (errors.iter().map(|(error, _)| error * error).sum::<f64>() / n).sqrt();
        let stated = errors.iter().map(|(_, sigma)| sigma).sum::<f64>() / n;
        let worst = errors.iter().map(|(e, s)| (e / s).abs()).fold(0.0, f64::max);
        let deepest = depths.last().copied().unwrap_or_default();
        let mean = depths.iter().sum::<f64>() / depths.len() as f64;
        let what = format!(
            "sample {sample}, {speed} mm/s, {late_s} s: bias {bias:.1}, rms {rms:.1}, stated {stated:.1} µm, \
             worst {worst:.1} σ, {refused} refused; noticed at {mean:.0}, at most {deepest:.0} µm"
        );
        println!("{what}");
        assert!(refused <= 3 && worst < 4.0 && rms < 2.0 * stated && stated < 10.0, "{what}");
        assert!(mean < noticed_um && bias.abs() < 4.0 * speed, "{what}");
    }
}
