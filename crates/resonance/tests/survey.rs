//! What a survey finds on a bench, and what it is worth to the sweeps after it. The plant is the exact
//! motion in time.

#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use std::{
    f64::consts::{FRAC_2_PI, TAU},
    time::Duration,
};

use num_complex::Complex64;
use rig_model::{Reading, RigTime, SweepMethod, SweepPoint, SweepRequest};
use rig_resonance::{Bench, Circuit, FitOutcome, Next, NoisePrior, Planner, Prior, Reason};
use support::{Plant, Random, circuit, impedance, measured, request};

const NOISE: f64 = 0.005;
const SECONDS: u32 = 20;
/// Between two readings, s.
const GAP_S: f64 = 1e-3;

/// A sensor, perhaps with a second mode, on an analyzer with a phase error.
struct Scene {
    sensor: Plant,
    second: Option<(Plant, Circuit)>,
    phase: Complex64,
    /// How much longer than it is the gap after the first reading at a frequency seems to be, s: the
    /// reading began later than recorded.
    late_s: f64,
    noise: f64,
    /// tan δ of a dielectric of constant phase, whose capacitance falls with the frequency.
    constant_phase: f64,
    /// Resistance, ohm, and inductance, H, of cables in series.
    stray: (f64, f64),
    /// Largest additional length of a gap, and largest error of its recorded length, s.
    gaps_s: (f64, f64),
    now: RigTime,
    last_hz: f64,
    random: Random,
}

impl Scene {
    /// The second mode has this part of the capacitance of the first and lies this many linewidths above.
    fn new(sensor: Circuit, (part, linewidths): (f64, f64), phase_deg: f64, seed: u64) -> Self {
        let second = (part > 0.0).then(|| {
            let resonance_hz = sensor.resonance_hz + linewidths * sensor.linewidth_hz();
            let second = Circuit { resonance_hz, c1_farad: part * sensor.c1_farad, ..sensor };
            (Plant::at_rest(second), Circuit { c1_farad: 0.0, ..second })
        });
        Self {
            sensor: Plant::at_rest(sensor),
            second,
            phase: Complex64::cis(phase_deg.to_radians()),
            late_s: 0.0,
            noise: NOISE,
            constant_phase: 0.0,
            stray: (0.0, 0.0),
            gaps_s: (0.0, 0.0),
            now: RigTime::from_micros(1_000_000),
            last_hz: 0.0,
            random: Random::new(seed),
        }
    }

    fn measure(&mut self, point: &SweepPoint) -> Reading {
        let is_first = point.frequency_hz.total_cmp(&self.last_hz).is_ne();
        if is_first {
            let turns = self.random.between(0.0, 1.0);
            self.sensor.jump(turns);
            if let Some((second, _)) = &mut self.second {
                second.jump(turns);
            }
            self.last_hz = point.frequency_hz;
        }
        let (mut reading, after) = self.sensor.visit(point, self.now, self.noise, &mut self.random);
        let mut ohm = impedance(&reading);
        if let Some((second, fixed)) = &mut self.second {
            let (other, _) = second.visit(point, self.now, 0.0, &mut self.random);
            let motional = 1.0 / impedance(&other) - fixed.admittance_siemens(point.frequency_hz);
            ohm = 1.0 / (1.0 / ohm + motional);
        }
        // The admittance is (jf)^(1 - n), of which that without losses is in the plant.
        let lossless = Complex64::new(0.0, TAU * point.frequency_hz * self.sensor.circuit.c0_farad);
        let n = FRAC_2_PI * self.constant_phase.atan();
        let other = Complex64::new(0.0, point.frequency_hz / 140.0).powf(-n) - 1.0;
        let (resistance_ohm, inductance_h) = self.stray;
        let stray_ohm = Complex64::new(resistance_ohm, TAU * point.frequency_hz * inductance_h);
        ohm = 1.0 / (1.0 / ohm + lossless * other) + stray_ohm;
        let (longest_s, error_s) = self.gaps_s;
        let gap_s = GAP_S + self.random.between(0.0, longest_s);
        self.sensor.drive(point.frequency_hz, gap_s);
        if let Some((second, _)) = &mut self.second {
            second.drive(point.frequency_hz, gap_s);
        }
        reading.measured = measured(ohm * self.phase);
        let late_s = if is_first { self.late_s } else { 0.0 };
        let recorded_s = (gap_s + error_s * self.random.between(-1.0, 1.0)).max(0.0);
        self.now = after + Duration::from_secs_f64(late_s + recorded_s);
        reading
    }

    /// Runs a sweep; the verdict, what is known of the bench after it, and the number of readings.
    fn sweep(
        &mut self,
        request: &SweepRequest,
        bench: Option<Bench>,
    ) -> (FitOutcome, Option<Bench>, usize) {
        let noise = Some(NoisePrior { at_ten_cycles: self.noise, degrees_of_freedom: 1000.0 });
        let prior = Prior { noise, ..Prior::anywhere(request.window, bench) };
        let mut planner = Planner::new(request, Some(&prior));
        for _ in 0..1000 {
            match planner.next() {
                Next::Measure(points) => {
                    let readings: Vec<Reading> =
                        points.iter().map(|point| self.measure(point)).collect();
                    planner.add(&readings);
                }
                Next::Finished(verdict) => {
                    return (verdict, planner.bench(), planner.readings().len());
                }
            }
        }
        panic!("no end after 1000 rounds");
    }

    fn survey(&mut self) -> (FitOutcome, Option<Bench>, usize) {
        self.sweep(&request(SweepMethod::Survey { seconds: SECONDS }), None)
    }
}

const SENSORS: [(f64, f64); 4] = [(30.0, 0.1), (100.0, 0.02), (30.0, 0.02), (100.0, 0.1)];

fn sensor((q, k_eff_squared): (f64, f64), seed: u64) -> Circuit {
    let resonance_hz = Random::new(seed).between(130.0, 150.0);
    Circuit { resonance_hz, ..circuit(q, k_eff_squared) }
}

#[test]
fn a_survey_finds_the_phase_error_and_later_sweeps_are_right_with_it() {
    let phases_deg = [0.5, -2.0, 0.0].into_iter().cycle();
    for ((seed, of), phase_deg) in (1..=12).zip(SENSORS.into_iter().cycle()).zip(phases_deg) {
        let truth = sensor(of, seed);
        let mut scene = Scene::new(truth, (0.0, 0.0), phase_deg, seed);
        let (verdict, bench, readings) = scene.survey();
        let (Some(found), Some(bench)) = (verdict.accepted(), bench) else {
            panic!("seed {seed}: {verdict:?}")
        };
        assert!(readings < 2000, "seed {seed}: {readings} readings");
        let is_near = |off: f64, sigma: f64| off.abs() < 4.5 * sigma;
        assert!(is_near(found.resonance_hz - truth.resonance_hz, found.sigma_hz), "seed {seed}");
        let off_rad = bench.phase_rad - phase_deg.to_radians();
        assert!(is_near(off_rad, bench.phase_sigma_rad), "seed {seed}: {off_rad} {bench:?}");
        assert!(bench.phase_sigma_rad < 5e-3 && bench.mode_sigma < 0.03, "seed {seed}: {bench:?}");

        let (verdict, ..) = scene.sweep(&request(SweepMethod::Adaptive), Some(bench));
        let Some(found) = verdict.accepted() else { panic!("seed {seed}: {verdict:?}") };
        let off_hz = found.resonance_hz - truth.resonance_hz;
        assert!(is_near(off_hz, found.sigma_hz), "seed {seed}: {off_hz} {}", found.sigma_hz);
    }
}

#[test]
fn a_survey_finds_the_dispersion_of_a_dielectric_of_constant_phase() {
    let tangents = [0.02, 0.05, 0.0, 0.01].into_iter().cycle().skip(1);
    for ((seed, of), tangent) in (1..=15).zip(SENSORS.into_iter().cycle()).zip(tangents) {
        let truth = sensor(of, seed);
        let scene = Scene::new(truth, (0.0, 0.0), 0.3, seed);
        let mut scene = Scene { constant_phase: tangent, ..scene };
        let (verdict, bench, _) = scene.survey();
        let Some(bench) = bench else { panic!("seed {seed}: {verdict:?}") };
        let is_near = |off: f64, sigma: f64| off.abs() < 4.5 * sigma;
        let dispersion_farad = -FRAC_2_PI * tangent.atan() * truth.c0_farad;
        let off_farad = bench.dispersion_farad - dispersion_farad;
        let context = format!("seed {seed}, tan δ {tangent}: {bench:?}");
        assert!(is_near(off_farad, bench.dispersion_sigma_farad), "{context}");
        assert!(bench.dispersion_sigma_farad < 0.01 * truth.c0_farad, "{context}");
        assert!(
            is_near(bench.phase_rad - 0.3_f64.to_radians(), bench.phase_sigma_rad),
            "{context}"
        );
        let (verdict, ..) = scene.sweep(&request(SweepMethod::Adaptive), Some(bench));
        let Some(found) = verdict.accepted() else { panic!("{context}: {verdict:?}") };
        assert!(is_near(found.resonance_hz - truth.resonance_hz, found.sigma_hz), "{context}");
    }
}

#[test]
fn a_survey_refuses_a_dispersion_beyond_that_of_a_sensor_as_such() {
    for ((seed, of), tangent) in
        (1..=12).zip(SENSORS.into_iter().cycle()).zip([0.2, 0.3].into_iter().cycle())
    {
        let scene = Scene::new(sensor(of, seed), (0.0, 0.0), 0.3, seed);
        let (verdict, bench, _) = Scene { constant_phase: tangent, ..scene }.survey();
        assert!(bench.is_none(), "seed {seed}: {bench:?}");
        let FitOutcome::Refused(refusal) = verdict else { panic!("seed {seed}: {verdict:?}") };
        assert_eq!(refusal.reason, Reason::Dispersion, "seed {seed}, tan δ {tangent}");
    }
}

/// The sensor has tens of kiloohms, and most of what a cable adds looks like a phase error.
#[test]
fn a_cable_in_series_moves_the_resonance_by_less_than_half_a_standard_deviation() {
    let mut compared = 0;
    for (seed, of) in (1..=12).zip(SENSORS.into_iter().cycle()) {
        let found = |stray| {
            let scene = Scene::new(sensor(of, seed), (0.0, 0.0), 0.3, seed);
            let mut scene = Scene { stray, ..scene };
            let (verdict, bench, _) = scene.survey();
            assert!(bench.is_some(), "seed {seed}: {verdict:?}");
            let (verdict, ..) = scene.sweep(&request(SweepMethod::Adaptive), bench);
            *verdict.accepted().expect("a resonance")
        };
        let (without, with) = (found((0.0, 0.0)), found((20.0, 1e-3)));
        let moved_hz = with.resonance_hz - without.resonance_hz;
        // Other readings have another noise.
        if with.points == without.points {
            compared += 1;
            assert!(moved_hz.abs() < 0.5 * without.sigma_hz, "seed {seed}: {moved_hz}");
        }
    }
    assert!(compared > 0, "all sweeps were planned in another way");
}

#[test]
fn a_survey_refuses_a_second_mode_that_a_planned_sweep_can_miss() {
    let places = [-0.5, 1.0, -1.0, 2.5, 0.5].into_iter().cycle();
    for ((seed, of), place) in (1..=10).zip(SENSORS.into_iter().cycle()).zip(places) {
        let mut scene = Scene::new(sensor(of, seed), (0.05, place), 0.3, seed);
        let (verdict, bench, _) = scene.survey();
        let FitOutcome::Refused(refusal) = &verdict else { panic!("seed {seed}: {verdict:?}") };
        assert!(matches!(refusal.reason, Reason::SecondMode { .. }), "seed {seed}: {refusal}");
        assert_eq!(bench, None);
    }
}

#[test]
fn a_first_reading_that_begins_late_is_no_second_mode() {
    let late_ms = [1.0, 0.5, 2.0, 5.0].into_iter().cycle();
    for ((seed, of), late_ms) in (1..=12).zip(SENSORS.into_iter().cycle()).zip(late_ms) {
        let truth = sensor(of, seed);
        let scene = |second| {
            let scene = Scene::new(truth, second, 0.3, seed);
            Scene { late_s: 1e-3 * late_ms, ..scene }
        };
        let mut alone = scene((0.0, 0.0));
        let (verdict, bench, _) = alone.survey();
        let Some(bench) = bench else { panic!("seed {seed}: {verdict:?}") };
        let off_ms = 1e3 * bench.first_gap_s + late_ms;
        // A short and weak free decay tells less of the times.
        let allowed_ms = if of == (30.0, 0.02) { 1.2 } else { 0.5 };
        assert!(off_ms.abs() < allowed_ms, "seed {seed}: {off_ms} of {late_ms}");
        let off_rad = bench.phase_rad - 0.3_f64.to_radians();
        assert!(off_rad.abs() < 4.5 * bench.phase_sigma_rad, "seed {seed}: {off_rad} {bench:?}");
        for verdict in [verdict, alone.sweep(&request(SweepMethod::Adaptive), Some(bench)).0] {
            let Some(found) = verdict.accepted() else { panic!("seed {seed}: {verdict:?}") };
            let off_hz = found.resonance_hz - truth.resonance_hz;
            assert!(
                off_hz.abs() < 4.5 * found.sigma_hz,
                "seed {seed}: {off_hz} {}",
                found.sigma_hz
            );
        }
        // A true one is still refused.
        let (verdict, bench, _) = scene((0.05, 1.0)).survey();
        assert!(matches!(verdict, FitOutcome::Refused(_)), "seed {seed}: {verdict:?}");
        assert_eq!(bench, None);
    }
}

#[test]
fn a_survey_of_a_resonance_that_drifts_finds_the_phase_error_and_no_second_mode() {
    let rates_hz_per_s = [0.01, -0.003, -0.01, 0.003].into_iter().cycle();
    let (mut squares, seeds) = (0.0, 24);
    for ((seed, of), rate) in (1..=seeds).zip(SENSORS.into_iter().cycle()).zip(rates_hz_per_s) {
        let truth = sensor(of, seed);
        let mut scene = Scene::new(truth, (0.0, 0.0), 0.3, seed);
        scene.sensor.drift_hz_per_s = rate;
        let (verdict, bench, _) = scene.survey();
        let Some(bench) = bench else { panic!("seed {seed}: {verdict:?}") };
        let off = (bench.phase_rad - 0.3_f64.to_radians()) / bench.phase_sigma_rad;
        assert!(off.abs() < 4.5, "seed {seed}: {off}");
        squares += off * off;
    }
    // The sum has a standard deviation of about the root of twice their number.
    let seeds = seeds as f64;
    assert!(squares < seeds + 4.0 * (2.0 * seeds).sqrt(), "{squares} of {seeds} surveys");
}

#[test]
fn a_phase_error_that_no_analyzer_has_is_refused() {
    let mut scene = Scene::new(sensor((30.0, 0.1), 3), (0.0, 0.0), 20.0, 3);
    let (verdict, bench, _) = scene.survey();
    assert!(matches!(verdict, FitOutcome::Refused(_)), "{verdict:?}");
    assert_eq!(bench, None);
}

#[test]
fn a_survey_of_readings_with_little_noise_begins_far_from_their_circuit() {
    for seed in 1..=60 {
        let truth = sensor((100.0, 0.1), seed);
        let mut scene =
            Scene { noise: 1e-3, gaps_s: (2e-3, 1e-3), ..Scene::new(truth, (0.0, 0.0), 0.3, seed) };
        let (verdict, bench, _) = scene.survey();
        let Some(found) = verdict.accepted() else { panic!("seed {seed}: {verdict:?}") };
        let off_hz = found.resonance_hz - truth.resonance_hz;
        assert!(off_hz.abs() < 4.5 * found.sigma_hz, "seed {seed}: {off_hz} {}", found.sigma_hz);
        assert!(bench.is_some(), "seed {seed}");
    }
}
