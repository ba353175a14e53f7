//! What many readings of the free sensor say of the bench: the phase error of the analyzer, the dispersion of the
//! dielectric, and second modes.
//!
//! An analyzer may need more time for a reading that comes with its settings than for one without. The
//! host does not see it, and all stays have the same error of the time from their first reading to the
//! others. Fitted as one more unknown, it does not look like a second mode.
//!
//! The static capacitance of a piezoceramic falls by about 2/π·tan δ for each factor e of the frequency, 1.3 % at the
//! tan δ of 0.02 of a soft one: the real part of what its losses are the imaginary part of. Unknown, it looks like a
//! part of the resonance.

use num_complex::Complex64;
use rig_model::{Reading, Window};

use super::{
    Hypothesis, Known, Modelled, Stays, judge,
    model::{Branch, Moving},
    search::allowed,
    stay::WITH_BENCH,
    sums::Column,
};
use crate::{
    Bench, FitOptions, Reason,
    bench::dispersion,
    circuit::trace::CIRCUIT,
    diagnose::doubts::POINTS_MIN,
    fit::grid::CircuitPrior,
    noise::{NOISE, PooledVariance},
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// Indices of the unknowns after the circuit.
const MODE: usize = CIRCUIT;
const PHASE: usize = CIRCUIT + 1;
const FIRST_GAP: usize = CIRCUIT + 2;
const DISPERSION: usize = CIRCUIT + 3;
/// The circuit is fitted again at most this many times for what was found beside it.
const ROUNDS: usize = 8;
/// A disturbance within this many of its standard deviations of the last one is that one.
const SAME_SIGMAS: f64 = 0.1;
/// Standard deviation of the error of the first gap before it is measured, and largest error, s.
const FIRST_GAP_SIGMA_S: f64 = 3e-3;
const FIRST_GAP_MAX_S: f64 = 20e-3;
/// Standard deviation of the dispersion before it is measured, as a part of the static capacitance: a tan δ of 0.08.
const DISPERSION_SIGMA: f64 = 0.05;
/// Largest dispersion that is corrected, as a part of the static capacitance: that of a tan δ of 0.16, eight times that of a
/// soft piezoceramic.
const DISPERSION_MAX: f64 = 0.1;
/// Largest phase error of an analyzer, rad.
const PHASE_MAX: f64 = 0.1;
/// Smallest standard deviation of the phase error, rad: it changes with time and range.
const PHASE_SIGMA_MIN: f64 = 1e-4;
/// Number of trial frequencies of a second mode in a linewidth, and largest number of them.
const PER_WIDTH: f64 = 2.0;
const PLACES_MAX: f64 = 100.0;
/// A second mode nearer than this, in linewidths, cannot be distinguished from the first.
const NEAREST: f64 = 0.4;
/// Distance from the resonance, in linewidths, within which a possible mode matters to a later sweep.
const RELEVANT: f64 = 4.5;
/// Twice the log-likelihood that a second mode must gain. Chance reaches it in one survey of a thousand.
const MODE_GAIN: f64 = 18.0;
/// The same from which on a mode that is not certain counts with the size that it would have. Chance reaches it in one survey
/// of fifty.
const MODE_POSSIBLE: f64 = 9.0;

/// The knowledge of the bench from readings around the resonance `options.near`.
///
/// # Errors
/// A second mode or a phase error that no analyzer has, or a fit that does not converge.
pub(crate) fn learn(readings: &[Reading], options: &FitOptions) -> Result<Bench, Reason> {
    let noise = PooledVariance::known(&options.noise.unwrap_or(NOISE));
    let found = readings.iter().filter(|reading| reading.impedance().is_some()).count();
    let few = Reason::TooFewPoints { found, needed: POINTS_MIN };
    let window = options.window.ok_or(few)?;
    let mut bench = Bench {
        phase_rad: 0.0,
        phase_sigma_rad: f64::NAN,
        first_gap_s: 0.0,
        dispersion_farad: 0.0,
        dispersion_sigma_farad: f64::NAN,
        mode_sigma: f64::NAN,
        surveyed: window,
    };
    for round in 1..=ROUNDS {
        // Readings that seemed wrong with another phase or other times may be right.
        let known = Known::with(noise.variance());
        let mut stays = Stays::of(known, None, readings).ok_or(few)?;
        stays.correct(&bench);
        stays.lengthen_first_gaps(bench.first_gap_s);
        let found = judge::best(&mut stays, window, noise, options);
        let (best, expected) = found.ok_or(Reason::NotConverged)?;
        let normal = normal(&stays, &best, &expected, &bench, None);
        let Analyzer { phase, first_gap, dispersion, saved } =
            Analyzer::of(&normal).ok_or(Reason::NotConverged)?;
        let is_same = phase.is_same() && first_gap.is_same() && dispersion.is_same();
        if is_same || round == ROUNDS {
            // A second mode or a large dispersion may be what keeps them from converging.
            let modes = modes(&stays, &best, &expected, &bench);
            let more = modes.present.as_ref().map_or(0.0, |mode| mode.dispersion_step);
            let dispersion_now = bench.dispersion_farad / stays.unit_farad + more;
            if dispersion_now.abs() > DISPERSION_MAX * best.at.c0 {
                return Err(Reason::Dispersion);
            }
            if let Some(Mode { near_hz, .. }) = modes.present {
                return Err(Reason::SecondMode { near_hz });
            }
            if !is_same {
                return Err(Reason::NotConverged);
            }
            (bench.mode_sigma, bench.surveyed) = (modes.sigma, modes.surveyed);
            bench.phase_sigma_rad = phase.sigma.max(PHASE_SIGMA_MIN);
            bench.dispersion_sigma_farad = dispersion.sigma * stays.unit_farad;
            return Ok(bench);
        }
        bench.phase_rad += phase.step;
        let gap_s = bench.first_gap_s + first_gap.step;
        bench.first_gap_s = gap_s.clamp(-FIRST_GAP_MAX_S, FIRST_GAP_MAX_S);
        bench.dispersion_farad += dispersion.step * stays.unit_farad;
        if bench.phase_rad.abs() > PHASE_MAX {
            // Readings that no circuit describes say nothing of a phase.
            let degrees = stays.degrees();
            let cost = (best.normal.cost - saved) * stays.known.variance;
            let (found, allowed) = (cost / degrees / noise.variance(), allowed(degrees, noise));
            let is_described = found < allowed;
            return Err(if is_described {
                Reason::AnalyzerPhase
            } else {
                Reason::Misfit { found, allowed }
            });
        }
    }
    Err(Reason::NotConverged)
}

/// What remains of the errors of the analyzer and of a dispersion, and the cost that they save; without a second mode.
struct Analyzer {
    /// rad
    phase: Remainder,
    /// s
    first_gap: Remainder,
    /// In the unit of capacitance.
    dispersion: Remainder,
    saved: f64,
}

/// A change of an unknown, and its standard deviation.
struct Remainder {
    step: f64,
    sigma: f64,
}

impl Analyzer {
    fn of(normal: &Normal<WITH_BENCH>) -> Option<Self> {
        let mut normal = *normal;
        for i in 0..WITH_BENCH {
            (normal.matrix[MODE][i], normal.matrix[i][MODE]) = (0.0, 0.0);
        }
        (normal.matrix[MODE][MODE], normal.gradient[MODE]) = (1.0, 0.0);
        let factor = Cholesky::new(&normal.matrix, WITH_BENCH, 0.0)?;
        let (inverse, step) = (factor.inverse(), factor.solve(&normal.gradient));
        let saved = step.iter().zip(&normal.gradient).map(|(a, b)| a * b).sum();
        let of = |unknown: usize| Remainder {
            step: -step[unknown],
            sigma: inverse[unknown][unknown].sqrt(),
        };
        let (phase, first_gap, dispersion) = (of(PHASE), of(FIRST_GAP), of(DISPERSION));
        Some(Self { phase, first_gap, dispersion, saved })
    }
}

impl Remainder {
    fn is_same(&self) -> bool {
        self.step.abs() < SAME_SIGMAS * self.sigma
    }
}

/// What the readings say of second modes.
struct Modes {
    /// Root of the mean square of the capacitance of a possible one relative to the first, the largest of all places.
    sigma: f64,
    /// The frequencies in the window at which one would have been noticed; nowhere if no place was looked at.
    surveyed: Window,
    /// The one that gains most, if the readings require one.
    present: Option<Mode>,
}

/// A second mode that the readings require.
struct Mode {
    near_hz: f64,
    /// Twice the log-likelihood that it gains.
    gain: f64,
    /// The change of the dispersion if both are fitted, in the unit of capacitance.
    dispersion_step: f64,
}

/// The places at which a second mode is looked for, Hz: at the same distances from the resonance in every survey.
fn places(at_hz: f64, width_hz: f64, surveyed: Window) -> impl Iterator<Item = f64> {
    let length_hz = surveyed.max_hz - surveyed.min_hz;
    let step_hz = (width_hz / PER_WIDTH).max(length_hz / PLACES_MAX);
    let first = (NEAREST * width_hz / step_hz).ceil();
    let last = (surveyed.max_hz - at_hz).max(at_hz - surveyed.min_hz) / step_hz;
    let steps = std::iter::successors(Some(first), |step| Some(step + 1.0));
    let steps = steps.take_while(move |step| *step <= last);
    steps
        .flat_map(move |step| [at_hz - step * step_hz, at_hz + step * step_hz])
        .filter(move |hz| surveyed.contains(*hz))
}

/// Looks for a second mode beside this circuit.
fn modes(stays: &Stays, best: &Hypothesis, expected: &CircuitPrior, bench: &Bench) -> Modes {
    let window = bench.surveyed;
    let (at_hz, width_hz) = (best.at.resonance_hz, best.linewidth_hz());
    let half_hz = 0.5 * (window.max_hz - window.min_hz);
    let margin_hz = width_hz.min(0.5 * half_hz);
    let surveyed = Window { min_hz: window.min_hz + margin_hz, max_hz: window.max_hz - margin_hz };
    let (mut sigma, mut present) = (None::<f64>, None::<Mode>);
    for near_hz in places(at_hz, width_hz, surveyed) {
        let normal = normal(stays, best, expected, bench, Some(near_hz));
        let Some(factor) = Cholesky::new(&normal.matrix, WITH_BENCH, 0.0) else { continue };
        let step = factor.solve(&normal.gradient);
        let variance = factor.inverse()[MODE][MODE];
        let gain = step[MODE] * step[MODE] / variance;
        // Its capacitance is positive.
        if step[MODE] < 0.0
            && gain > MODE_GAIN
            && present.as_ref().is_none_or(|mode| mode.gain < gain)
        {
            present = Some(Mode { near_hz, gain, dispersion_step: -step[DISPERSION] });
        }
        if (near_hz - at_hz).abs() < RELEVANT * width_hz {
            let size = if step[MODE] < 0.0 && gain > MODE_POSSIBLE { step[MODE] } else { 0.0 };
            let of_place = size.hypot(variance.sqrt()) / best.at.c1;
            sigma = Some(sigma.map_or(of_place, |sigma| sigma.max(of_place)));
        }
    }
    let middle_hz = window.min_hz + half_hz;
    let nowhere = Window { min_hz: middle_hz, max_hz: middle_hz };
    let surveyed = if sigma.is_some() { surveyed } else { nowhere };
    Modes { sigma: sigma.unwrap_or(0.0), surveyed, present }
}

/// The normal equations of the circuit, a second mode at this frequency, the phase error, the error of
/// the first gap, the dispersion, of which those of `bench` are in the stays already, and a drift.
fn normal(
    stays: &Stays,
    best: &Hypothesis,
    expected: &CircuitPrior,
    bench: &Bench,
    mode_hz: Option<f64>,
) -> Normal<WITH_BENCH> {
    let at = best.at;
    let mode_hz = mode_hz.unwrap_or(at.resonance_hz);
    let ends_s = stays.all.iter().skip(1).map(|next| next.since_s).chain([0.0]);
    let span_s = stays.all.iter().map(|stay| stay.since_s).sum::<f64>().max(f64::MIN_POSITIVE);
    let mut sum = Normal::default();
    let (mut begin_s, mut before) = (0.0, None::<(Complex64, Complex64)>);
    for ((of, state), end_s) in stays.models(&at).zip(&best.states).zip(ends_s) {
        let Modelled { stay, at, model, .. } = of;
        begin_s += stay.since_s;
        let begin = model.motion(&at, state.amplitude(), 0.0);
        // At a change of frequency the drive jumps in phase by the same angle for both modes.
        let turn = before.map_or(Complex64::ZERO, |(end, _)| begin / end);
        let turn = if turn.is_normal() { turn / turn.norm() } else { Complex64::ZERO };
        let motion = before.map_or(Complex64::ZERO, |(_, end)| end) * turn;
        let mode = Branch::new(mode_hz, at.q, stay.frequency_hz, motion);
        let middle_s = stay.middle_s();
        let drift = Column::Drift {
            size: 2.0 * (begin_s + middle_s) / span_s - 1.0,
            moving: Moving { per_s: 2.0 / span_s, middle_s, ..Moving::STILL },
        };
        let disperses = dispersion(bench.surveyed, stay.frequency_hz);
        let of_stay = model.normal_for_bench(stay, &stays.known, state, (&mode, disperses, drift));
        sum.sum(&of_stay);
        before = Some((model.motion(&at, state.amplitude(), end_s), mode.motion(end_s)));
    }
    expected.add_to(&mut sum, &at, 1.0);
    let farad = stays.unit_farad;
    for (unknown, present, sigma) in [
        (FIRST_GAP, bench.first_gap_s, FIRST_GAP_SIGMA_S),
        (DISPERSION, bench.dispersion_farad / farad, DISPERSION_SIGMA * at.c0),
    ] {
        let precision = sigma.powi(-2);
        sum.matrix[unknown][unknown] += precision;
        sum.gradient[unknown] += precision * present;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_modes_are_looked_for_at_the_same_distances_on_both_sides_of_any_resonance() {
        let surveyed = Window { min_hz: 120.0, max_hz: 160.0 };
        for (at_hz, width_hz) in [(140.0, 4.0), (141.3, 4.0), (121.0, 1.5), (140.0, 0.3)] {
            let all: Vec<f64> = places(at_hz, width_hz, surveyed).collect();
            assert!(all.len() as f64 <= PLACES_MAX, "{}", all.len());
            assert!(all.iter().all(|hz| surveyed.contains(*hz)), "{all:?}");
            let step_hz = (width_hz / PER_WIDTH).max(0.4);
            let nearest = |side: f64| {
                let away = all.iter().map(|hz| side * (hz - at_hz)).filter(|hz| *hz > 0.0);
                away.fold(f64::INFINITY, f64::min)
            };
            for side in [-1.0, 1.0] {
                let found_hz = nearest(side);
                let is_nearest = NEAREST * width_hz <= found_hz + 1e-9
                    && found_hz < NEAREST * width_hz + step_hz;
                assert!(is_nearest, "{at_hz}, {width_hz}: {found_hz}");
            }
        }
        assert_eq!(places(140.0, 4.0, Window { min_hz: 139.0, max_hz: 141.0 }).count(), 0);
    }
}
