//! The fit of readings with a free decay, and its checks.

use rig_model::{Reading, Window};

use super::{
    Hypothesis, Known, Stays,
    mode::{Modes, SecondMode},
    outliers::{self, Comparison, Criteria},
    search::{Effort, Search, allowed},
    start::Trials,
};
use crate::{
    FitOptions, FitOutcome, ModelOrder, Reason, Refusal, Resonance,
    circuit::trace::{CIRCUIT, ModelEstimate},
    diagnose::doubts::{
        POINTS_MIN, doubt_circuit, doubt_existence, doubt_loss, doubt_place, doubt_precision,
    },
    fit::grid::{CircuitPrior, Q_TYPICAL},
    noise::NOISE,
    noise::PooledVariance,
    numeric::dense::{Cholesky, condition, sandwich},
    numeric::descent::End,
    outcome::Spread,
};

/// Largest factor by which a second mode of any size may widen the standard deviation of the resonance.
/// With it a mode that shifts the resonance by four standard deviations gains sixteen.
pub(crate) const MODE_WIDENS: f64 = 1.2;

/// Largest change of the resonance during the sweep, in its standard deviations. Beyond it the shapes of a drift, and a resonance
/// that goes on evenly during a stay, are not exact enough.
const FOLLOWED_SIGMAS: f64 = 100.0;

/// Twice the log-likelihood gained by a drift above which a resonance that rests is refused.
const MOVES_GAIN: f64 = 25.0;

/// Largest number of wrong readings for which the circuit is searched again.
const SEARCHES: usize = 8;
/// The readings are compared within their stays at most this many times.
const FAR_ROUNDS: usize = 4;

/// The shapes of a drift are weighed again if the noise variance is not what it was taken for, within this factor.
const SAME_NOISE: f64 = 1.2;

/// Finds the resonance in readings of stays without settling.
pub(crate) fn fit(readings: &[Reading], options: &FitOptions) -> FitOutcome {
    let refused = |reason| FitOutcome::Refused(Refusal { reason, estimate: None });
    let noise = PooledVariance::known(&options.noise.unwrap_or(NOISE));
    let known = Known::with(noise.variance());
    let found = readings.iter().filter(|reading| reading.impedance().is_some()).count();
    if 2 * found < readings.len() {
        let overloaded = readings.len() - found;
        return refused(Reason::Saturated { overloaded, readings: readings.len() });
    }
    let Some(mut stays) = Stays::of(known, options.bench, readings).filter(|_| found >= POINTS_MIN)
    else {
        return refused(Reason::TooFewPoints { found, needed: POINTS_MIN });
    };
    if stays.degrees() < 1.0 {
        return refused(Reason::TooFewPoints { found, needed: found + 1 });
    }
    let window = window(readings, options);
    let Some((best, expected)) = weighed(&mut stays, readings, (window, noise), options) else {
        return refused(Reason::NotConverged);
    };
    judge(&stays, &best, &expected, noise, window)
}

/// The window of the fit: the span of the readings if none is given.
fn window(readings: &[Reading], options: &FitOptions) -> Window {
    let frequencies = || readings.iter().map(|reading| reading.frequency_hz);
    options.window.unwrap_or_else(|| Window {
        min_hz: frequencies().fold(f64::INFINITY, f64::min),
        max_hz: frequencies().fold(0.0, f64::max),
    })
}

/// Effective time of the resonance, s after the start of the first reading.
pub(crate) fn effective_time_s(readings: &[Reading], options: &FitOptions) -> Option<f64> {
    let noise = PooledVariance::known(&options.noise.unwrap_or(NOISE));
    let known = Known::with(noise.variance());
    let mut stays = Stays::of(known, options.bench, readings)?;
    let within = (window(readings, options), noise);
    let (best, expected) = weighed(&mut stays, readings, within, options)?;
    stays.effective_time_s(&best, &expected)
}

/// The most likely circuit, with the rounding of the readings.
fn weighed(
    stays: &mut Stays,
    readings: &[Reading],
    (window, noise): (Window, PooledVariance),
    options: &FitOptions,
) -> Option<(Hypothesis, CircuitPrior)> {
    let (mut best, expected) = best(stays, window, noise, options)?;
    if stays.weigh_rounding(readings, stays.known.variance) {
        best = stays.minimum(best.at, &expected);
    }
    Some((best, expected))
}

/// The most likely circuit, for the noise of the readings; `None` if another explains them nearly as
/// well.
pub(super) fn best(
    stays: &mut Stays,
    window: Window,
    noise: PooledVariance,
    options: &FitOptions,
) -> Option<(Hypothesis, CircuitPrior)> {
    let how = Comparison::of(stays.count());
    let expected = CircuitPrior::any(Q_TYPICAL).within(window);
    let follow = |stays: &mut Stays, best: &mut Hypothesis| {
        if let Some(following) = stays.following(best, &expected, (noise, window)) {
            (*stays, *best) = following;
        }
    };
    let mut trials = Trials::none();
    let mut best = if let Some(near) = options.near {
        let near = ModelEstimate::of(&near, stays.unit_farad);
        let is_suspect = |stays: &Stays, one: &Hypothesis| {
            Search { stays, trials: &Trials::none(), expected: &expected, noise }.is_suspect(one)
        };
        let (mut best, mut at) = (stays.minimum(near, &expected), near);
        follow(stays, &mut best);
        if is_suspect(stays, &best) {
            let all = stays.clone();
            let rows_max = how.rows_max(all.work.get());
            for _ in 0..FAR_ROUNDS {
                // A reading far from a rough circuit may agree with a better one.
                all.work.set(stays.work.get());
                let without = all.without_far(&at, how, rows_max);
                let is_same = without.has_same_readings(stays);
                *stays = without;
                if is_same {
                    break;
                }
                best = stays.minimum(at, &expected);
                at = best.at;
            }
        }
        best
    } else {
        trials = Trials::new(window);
        trials.add_all(stays);
        let search = Search { stays, trials: &trials, expected: &expected, noise };
        let mut found = search.run(Vec::new(), None, Effort::Trials);
        let mut best = found.pop().filter(|_| found.is_empty())?;
        follow(stays, &mut best);
        best
    };
    let search = Search { stays, trials: &trials, expected: &expected, noise };
    if search.is_suspect(&best) {
        let criteria = Criteria { expected: &expected, noise, within: window };
        let is_misfit = search.is_misfit(&best);
        let searches = match (options.near, how) {
            (Some(_), Comparison::Limited) => outliers::searches_of_step(stays, window, SEARCHES),
            (None, _) | (_, Comparison::Full) => SEARCHES,
        };
        match outliers::without(stays, std::slice::from_ref(&best), &criteria, searches) {
            Some(rest) => {
                *stays = rest.stays;
                let mut found = rest.found;
                best = found.pop().filter(|_| found.is_empty())?;
                follow(stays, &mut best);
            }
            None if is_misfit => return Some((best, expected)),
            None => {}
        }
    }
    // If the noise is poorly known, it is estimated from the readings.
    let degrees = stays.degrees();
    let cost = best.normal.cost * stays.known.variance;
    let assumed =
        std::mem::replace(&mut stays.known.variance, noise.with(cost, degrees).variance());
    let mut best = stays.minimum(best.at, &expected);
    if (stays.known.variance / assumed).ln().abs() > SAME_NOISE.ln() {
        follow(stays, &mut best);
    }
    Some((best, expected))
}

/// The result, or a refusal if a check fails.
fn judge(
    stays: &Stays,
    best: &Hypothesis,
    expected: &CircuitPrior,
    noise: PooledVariance,
    window: Window,
) -> FitOutcome {
    let refused = |reason, estimate| FitOutcome::Refused(Refusal { reason, estimate });

    let degrees = stays.degrees();
    // Relative to the prior noise, not to that of these readings.
    let scatter = best.normal.cost / degrees * stays.known.variance / noise.variance();
    let allowed = allowed(degrees, noise);
    let modes = Modes::new(stays, best);
    let (mut likeliest, mut widest) = (None::<SecondMode>, 0.0_f64);
    for mode in modes.all(expected, window) {
        widest = widest.max(mode.variance);
        if likeliest.is_none_or(|best| mode.gain > best.gain) {
            likeliest = Some(mode);
        }
    }
    let by_modes_hz = best.at.resonance_hz * widest.sqrt() / MODE_WIDENS;
    let curvature_hz = best.sigma_hz();
    let roughly = resonance(stays, best, noise, curvature_hz);
    let doubt = if best.end == End::OutOfSteps {
        Some(Reason::NotConverged)
    } else if let Some(mode) =
        likeliest.filter(|mode| mode.is_present_beside(best.normal.cost, degrees))
    {
        // Beside nothing there is no second mode.
        let alone = roughly.and_then(|found| doubt_existence(&found, gain(stays, best, &found)));
        Some(alone.unwrap_or(Reason::SecondMode { near_hz: mode.resonance_hz }))
    } else {
        // NaN must be refused too.
        let is_described = scatter < allowed;
        (!is_described).then_some(Reason::Misfit { found: scatter, allowed })
    };
    let doubt = doubt.or_else(|| {
        // A drift that the readings show and that could not be followed.
        let noise = (best.normal.cost / degrees).max(1.0);
        let is_moving =
            stays.drift.is_none() && stays.gain_by_drift(best, expected) > MOVES_GAIN * noise;
        // The last fit may have lengthened the decay of the circuit.
        (is_moving || !stays.has_slow_drift(&best.at)).then_some(Reason::Drift)
    });
    if let Some(reason) = doubt {
        return refused(reason, roughly);
    }
    let sigma_hz = stays.profile_sigma_hz(best, expected).max(by_modes_hz);
    let by_bench_hz = stays.shift_by_bench_hz(best, expected).unwrap_or(f64::NAN);
    let by_drift_hz = best.at.resonance_hz * stays.sigma_by_drift();
    let sigma_hz = (outliers::widening(stays) * sigma_hz).hypot(by_bench_hz).hypot(by_drift_hz);
    let found = resonance(stays, best, noise, sigma_hz).filter(|_| sigma_hz.is_finite());
    let Some(found) = found else {
        return refused(Reason::NotConverged, None);
    };
    // Outside of the window a place is stated if it is known.
    let outside = doubt_place(&found, window)
        .map(|place| doubt_precision(&found, found.sigma_hz).unwrap_or(place));
    let moved_hz = best.at.resonance_hz * stays.change_by_drift().abs();
    let is_followed = moved_hz < FOLLOWED_SIGMAS * found.sigma_hz;
    doubt_existence(&found, gain(stays, best, &found))
        .or((!is_followed).then_some(Reason::Drift))
        .or(outside)
        .or_else(|| doubt_circuit(&found, window))
        .or_else(|| doubt_loss(&best.at, &found))
        .or_else(|| doubt_precision(&found, found.sigma_hz))
        .map_or(FitOutcome::Accepted(found), |reason| refused(reason, Some(found)))
}

/// Twice the log-likelihood that the resonance gains over a capacitor, to second order.
fn gain(stays: &Stays, best: &Hypothesis, found: &Resonance) -> f64 {
    (best.at.c1 * stays.unit_farad).powi(2) / found.covariance[3][3]
}

/// The circuit with its uncertainty; the standard deviation of the resonance is that of its profile
/// likelihood.
fn resonance(
    stays: &Stays,
    best: &Hypothesis,
    noise: PooledVariance,
    sigma_hz: f64,
) -> Option<Resonance> {
    let (at, matrix) = (&best.at, &best.normal.matrix);
    let inverse = Cholesky::new(matrix, CIRCUIT, 0.0)?.inverse();
    let farad = stays.unit_farad;
    let slope = [
        [at.resonance_hz, 0.0, 0.0, 0.0, 0.0],
        [0.0, at.q, 0.0, 0.0, 0.0],
        [0.0, 0.0, farad, 0.0, 0.0],
        [0.0, 0.0, 0.0, farad, 0.0],
        [0.0, 0.0, -at.g / (at.c0 * at.c0), 0.0, 1.0 / at.c0],
    ];
    let variance = stays.known.variance;
    let by_drift = |i, j| stays.drift.map_or(0.0, |drift| drift.covariance(i, j));
    let leading = std::array::from_fn(|i| {
        std::array::from_fn(|j| (inverse[i][j] + by_drift(i, j)) / variance)
    });
    let cost = best.normal.cost * variance;
    let spread = Spread {
        covariance: sandwich(&slope, &leading),
        condition: condition(matrix, &inverse, CIRCUIT),
        cost,
        neighbours: variance,
        correlation: 1.0,
        count: stays.count(),
        degrees: stays.degrees(),
        settled: (cost, stays.degrees()),
        widened: 0.0,
    };
    let found =
        Resonance::new(&at.circuit(farad), &spread, ModelOrder::RingUp, Some(&noise.prior()));
    let wider = sigma_hz * sigma_hz - best.sigma_hz() * best.sigma_hz();
    let extra = stays.drift.map(|drift| drift.extra());
    Some(Resonance { extra, ..found.widened(wider.max(0.0)) })
}
