//! What follows from the readings: every accepted resonance is fitted again.

use std::{f64::consts::PI, num::NonZero, thread};

use crate::{
    finding::{Check, Finding, Findings},
    fit::{self, Fitted, Motion, Stated},
    labels::READINGS_PER_OUTLIER,
    record::{Bench, Circuit, Extra, FitNoise, FitSettings, Outcome, Reading, Sweep},
    survey::{self, Doubt, corrected},
};

/// A stated resonance may differ from the fit of this checker by this many of its standard deviations.
/// The two weigh readings a little differently: of 4,174 planned sweeps on 120 benches, one in a hundred by more than 0.06,
/// the farthest by 0.45.
const RESONANCE_SIGMAS: f64 = 1.0;
/// A stated standard deviation over that of this checker, at least. In the same sweeps it was 0.985 or more.
const SIGMA_LEAST: f64 = 0.9;
const SIGMA_LEAST_ON_GRID: f64 = 0.6;
/// The same in the median of the planned sweeps of one purpose, from this number of them on. Of 120 runs it was 0.02 and
/// 1.02 at worst.
const TOGETHER: usize = 4;
const RESONANCE_SIGMAS_TOGETHER: f64 = 0.1;
const SIGMA_LEAST_TOGETHER: f64 = 0.98;
/// A reading is certainly wrong if the sweep without it has a cost that is lower by this, in units of its scatter. rigd leaves
/// out those that save 22; chance makes one that saves this in about two sweeps of a hundred.
const OUTLIER_GAIN: f64 = 15.0;
/// A stated standard deviation over that of this checker with a possible second mode, at most; and if readings were left out,
/// behind which more may be hidden.
const SIGMA_MOST: f64 = 2.0;
const SIGMA_MOST_OF_REST: f64 = 3.0;
/// What an unknown course of a moving resonance adds, as a part of its change.
const SHAPE: f64 = 0.1;
/// The same on a given grid, where other causes stay open too: over that of this checker without a second
/// mode, or in linewidths, whichever is more.
const SIGMA_MOST_ON_GRID: f64 = 10.0;
const SIGMA_LINEWIDTHS: f64 = 0.5;
/// The scatter about the fit may exceed the noise by this many standard deviations of χ².
const SCATTER_SIGMAS: f64 = 6.0;
/// Where nothing is known of the noise, it may be guessed this many times too small.
const GUESS: f64 = 5.0;
/// The stated time for which a resonance holds may differ from that of this checker by this part of the
/// duration of the sweep, and by more with few degrees of freedom, where the two weigh readings
/// differently: with seven readings the difference reached two sweeps, with twenty a tenth.
const TIME_SPANS: f64 = 0.15;
const TIME_SPANS_BY_DEGREES: f64 = 500.0;
/// The same as a part of the distance from the middle of the sweep.
const TIME_REL: f64 = 0.3;
/// The stated quality factor and ratio of capacitances over those of this checker.
const Q_RATIO: [f64; 2] = [0.5, 2.0];
/// Shortest time constant of a relaxation that readings with a free decay tell from it, in time constants of that
/// decay, and in durations of the sweep. rigd accepts none that is shorter than 1.8 such decays.
const RELAXATION_DECAYS: f64 = 1.75;
const RELAXATION_SPANS: f64 = 0.9 / 10.0;
/// Largest number of readings of which each is tried as a wrong one.
const SUSPECTS: usize = 60;
/// The stated static capacitance over that of this checker.
const CAPACITANCE_RATIO: [f64; 2] = [0.8, 1.25];
/// The stated loss tangent less that of this checker.
const LOSS: f64 = 0.25;
/// Each of these limits is at least this many standard deviations of this checker.
const CIRCUIT_SIGMAS: f64 = 5.0;
/// A circuit has five unknowns; fewer readings than this leave nothing to check it by.
pub(crate) const READINGS_MIN: usize = 7;
/// Fewer fits than this are not worth a thread.
const FITS_PER_THREAD: usize = 16;

/// An accepted sweep with its record.
#[derive(Debug, Clone)]
pub(crate) struct Accepted {
    pub(crate) seq: u64,
    pub(crate) sweep: Box<Sweep>,
    /// Whether it is the first sweep with what it states of the bench.
    pub(crate) is_survey: bool,
}

impl Accepted {
    /// The stated circuit.
    pub(crate) fn circuit(&self) -> Option<Circuit> {
        match &self.sweep.outcome {
            Outcome::Accepted { circuit, .. } => *circuit,
            Outcome::Refused { .. } => None,
        }
    }
}

/// A stated resonance beside that of this checker's fit of all readings.
#[derive(Debug, Clone, Copy)]
struct Agreement {
    /// Their difference, in stated standard deviations.
    off: f64,
    /// The stated standard deviation over that of this checker.
    sigma: f64,
}

/// Fits every accepted sweep, on all processors, and adds findings in the order of the sweeps.
pub(crate) fn check(sweeps: &[Accepted], findings: &mut Findings) {
    // To ask the system for its processors takes as long as a fit.
    let threads = if sweeps.len() <= FITS_PER_THREAD {
        1
    } else {
        thread::available_parallelism().map_or(1, NonZero::get)
    };
    let share = sweeps.len().div_ceil(threads).max(FITS_PER_THREAD);
    let of_share = |share: &[Accepted]| {
        let mut findings = Findings::default();
        let agree: Vec<_> = share.iter().map(|one| check_one(one, &mut findings)).collect();
        (findings.0, agree)
    };
    let mut agreements = Vec::new();
    if sweeps.len() <= share {
        let (found, agree) = of_share(sweeps);
        findings.0.extend(found);
        agreements = agree;
    } else {
        thread::scope(|scope| {
            let spawn = |share| scope.spawn(move || of_share(share));
            let running: Vec<_> = sweeps.chunks(share).map(spawn).collect();
            for (running, share) in running.into_iter().zip(sweeps.chunks(share)) {
                if let Ok((found, agree)) = running.join() {
                    findings.0.extend(found);
                    agreements.extend(agree);
                } else {
                    let seq = share.first().map_or(0, |first| first.seq);
                    findings.add(Check::Resonance, seq, "the fit of a sweep", "a result", "none");
                    agreements.extend(share.iter().map(|_| None));
                }
            }
        });
    }
    check_together(sweeps, &agreements, findings);
}

/// Small differences in most sweeps are no chance.
fn check_together(sweeps: &[Accepted], agreements: &[Option<Agreement>], findings: &mut Findings) {
    for purpose in ["no_load", "touch"] {
        let of = sweeps.iter().zip(agreements).filter(|(one, _)| one.sweep.purpose == purpose);
        let of: Vec<(u64, Agreement)> =
            of.filter_map(|(one, agreement)| Some((one.seq, (*agreement)?))).collect();
        let Some(&(seq, _)) = of.last().filter(|_| TOGETHER <= of.len()) else { continue };
        let median = |value: fn(&Agreement) -> f64| {
            let mut values: Vec<f64> = of.iter().map(|(_, agreement)| value(agreement)).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let off = median(|agreement| agreement.off.abs());
        if off.is_nan() || off > RESONANCE_SIGMAS_TOGETHER {
            let what = format!(
                "the resonances of the {purpose} sweeps: median difference from the fits, in standard deviations"
            );
            let limit = Some(RESONANCE_SIGMAS_TOGETHER.to_string());
            findings.within(Check::Resonance, seq, what, "0", off, limit);
        }
        let sigma = median(|agreement| agreement.sigma);
        if sigma.is_nan() || sigma < SIGMA_LEAST_TOGETHER {
            let what = format!(
                "the standard deviations of the {purpose} sweeps: median over those of the fits"
            );
            let limit = Some(SIGMA_LEAST_TOGETHER.to_string());
            findings.within(Check::Sigma, seq, what, "at least 1", sigma, limit);
        }
    }
}

/// Fits an accepted sweep. `None` on a given grid, and where something was found.
fn check_one(accepted: &Accepted, findings: &mut Findings) -> Option<Agreement> {
    let Accepted { seq, sweep, .. } = accepted;
    let of_sweep = sweep.readings.iter().skip(sweep.probe_readings);
    let readings: Vec<Reading> =
        of_sweep.filter(|reading| fit::has_place(reading)).copied().collect();
    let usable = places_of_usable(&readings).count();
    if usable < READINGS_MIN {
        let what = format!("sweep {}: the number of readings behind a resonance", sweep.number);
        let (found, expected) = (usable as f64, format!("at least {READINGS_MIN}"));
        findings.within(Check::Resonance, *seq, what, expected, found, None);
        return None;
    }
    let all = follows(accepted, &readings);
    let Outcome::Accepted { left_out, .. } = sweep.outcome else { return None };
    let most = left_out.min(usable.div_ceil(READINGS_PER_OUTLIER));
    let rest = nearest(&readings, &sweep.outcome, most).filter(|_| most > 0);
    // The statement must follow from the others as well. Two readings that are off by any factor keep each fit without one of
    // them from converging: those that are farthest from the stated circuit go first.
    let agreement = match (all, rest.map(|rest| follows(accepted, &rest))) {
        (Ok(all), Some(Ok(rest))) => {
            let nearer =
                |one: &Agreement, other: &Agreement| one.off.abs().total_cmp(&other.off.abs());
            Ok(all.into_iter().chain(rest).min_by(nearer))
        }
        (Ok(agreement), _) | (Err(_), Some(Ok(agreement))) => Ok(agreement),
        (Err(found), _) => without_worst(accepted, readings.clone(), (most, found)),
    };
    let agreement = agreement.map(|found| {
        let is_off = |found: &Agreement| found.off.abs() > RESONANCE_SIGMAS_TOGETHER;
        let has_doubt = most > 0 && found.as_ref().is_some_and(is_off);
        if has_doubt { without_outliers(accepted, readings, most).or(found) } else { found }
    });
    agreement.unwrap_or_else(|found| {
        findings.0.extend(found);
        None
    })
}

/// How well a result agrees with these readings, or what is found about it. A result on a given grid is not compared.
fn follows(accepted: &Accepted, readings: &[Reading]) -> Result<Option<Agreement>, Vec<Finding>> {
    let (found, _, agreement) = check_readings(accepted, readings);
    if found.0.is_empty() { Ok(agreement) } else { Err(found.0) }
}

/// The places of the readings with a value that can be used.
fn places_of_usable(readings: &[Reading]) -> impl Iterator<Item = usize> {
    readings.iter().enumerate().filter(|(_, one)| fit::is_usable(one)).map(|(index, _)| index)
}

/// The readings without the values of these.
fn without_values(readings: &[Reading], gone: &[usize]) -> Vec<Reading> {
    let mut rest = readings.to_vec();
    for &index in gone {
        rest[index] = fit::without_value(rest[index]);
    }
    rest
}

/// A sweep without one of its readings.
struct Without {
    scatter: f64,
    /// Whether its result follows from the others.
    is_explained: bool,
    agreement: Option<Agreement>,
    readings: Vec<Reading>,
}

/// The sweep without each of its readings, those with the least scatter first.
fn singles(accepted: &Accepted, readings: &[Reading]) -> Vec<Without> {
    let without = |k: usize| {
        let rest = without_values(readings, &[k]);
        let (found, scatter, agreement) = check_readings(accepted, &rest);
        Without { scatter, is_explained: found.0.is_empty(), agreement, readings: rest }
    };
    let all = suspects(readings).into_iter().map(without);
    let mut all: Vec<Without> = all.filter(|one| one.scatter.is_finite()).collect();
    all.sort_by(|a, b| a.scatter.total_cmp(&b.scatter));
    all
}

/// The same without the readings, at most `most`, whose absence lowers the scatter most, one after the other. `found` is what
/// is found with them.
fn without_worst(
    accepted: &Accepted,
    mut readings: Vec<Reading>,
    (most, found): (usize, Vec<Finding>),
) -> Result<Option<Agreement>, Vec<Finding>> {
    // Of two that are far off, each keeps the fit without the other from converging.
    let mut left = most;
    if most > 1
        && let Some((scatter, rest)) = without_pair(accepted, &readings)
    {
        let (found, _, agreement) = check_readings(accepted, &rest);
        if found.0.is_empty() {
            return Ok(agreement);
        }
        let single = singles(accepted, &readings).first().map_or(f64::INFINITY, |one| one.scatter);
        if scatter < single {
            (readings, left) = (rest, most - 2);
        }
    }
    for _ in 0..left {
        let all = singles(accepted, &readings);
        // Two readings may be about as far off: the record does not say which one was left out.
        if let Some(one) = all.iter().find(|one| one.is_explained) {
            return Ok(one.agreement);
        }
        let Some(best) = all.into_iter().next() else { break };
        readings = best.readings;
    }
    Err(found)
}

/// The two readings without which the scatter is least: the scatter, and the others.
fn without_pair(accepted: &Accepted, readings: &[Reading]) -> Option<(f64, Vec<Reading>)> {
    let suspects = suspects(readings);
    let pairs = suspects.iter().enumerate();
    let pairs =
        pairs.flat_map(|(n, one)| suspects[n + 1..].iter().map(move |other| [*one, *other]));
    let without = |gone: [usize; 2]| {
        let rest = without_values(readings, &gone);
        (check_readings(accepted, &rest).1, rest)
    };
    let all = pairs.map(without).filter(|(scatter, _)| scatter.is_finite());
    all.min_by(|one, other| one.0.total_cmp(&other.0))
}

/// How well a result agrees with the readings without those, at most `most`, that are certainly wrong; `None` without one.
fn without_outliers(
    accepted: &Accepted,
    mut readings: Vec<Reading>,
    most: usize,
) -> Option<Agreement> {
    let (_, mut scatter, _) = check_readings(accepted, &readings);
    let mut agreement = None;
    for _ in 0..most {
        let best = singles(accepted, &readings).into_iter().next()?;
        let count = places_of_usable(&readings).count() as f64;
        let gain = 2.0 * (count * scatter / best.scatter - (count - 1.0));
        if gain < OUTLIER_GAIN {
            break;
        }
        Without { scatter, agreement, readings, .. } = best;
    }
    agreement
}

/// The readings without the `most` ones whose impedance is farthest from that of a stated circuit, relative to it.
fn nearest(readings: &[Reading], outcome: &Outcome, most: usize) -> Option<Vec<Reading>> {
    let Outcome::Accepted { resonance_hz, circuit: Some(circuit), .. } = outcome else {
        return None;
    };
    let off = |reading: &Reading| {
        let stated = fit::impedance(circuit, *resonance_hz, reading.frequency_hz);
        (fit::measured(reading) - stated).norm() / stated.norm()
    };
    let mut by_distance: Vec<usize> = places_of_usable(readings).collect();
    by_distance.sort_by(|a, b| off(&readings[*b]).total_cmp(&off(&readings[*a])));
    Some(without_values(readings, by_distance.get(..most)?))
}

/// The readings that can be wrong, by their index: those that differ most from the others at their
/// frequency, because to try each of many would take minutes.
fn suspects(readings: &[Reading]) -> Vec<usize> {
    let parts = [|one: &Reading| one.resistance_ohm, |one: &Reading| one.reactance_ohm];
    let off = |reading: &Reading| {
        let is_here =
            |other: &&Reading| fit::is_usable(other) && other.frequency_hz == reading.frequency_hz;
        let [re, im] = parts.map(|part| {
            let mut here: Vec<f64> = readings.iter().filter(is_here).filter_map(part).collect();
            here.sort_by(f64::total_cmp);
            let median = here.get(here.len() / 2).copied().unwrap_or(f64::NAN);
            (part(reading).unwrap_or(f64::NAN) - median, median)
        });
        re.0.hypot(im.0) / re.1.hypot(im.1)
    };
    let mut all: Vec<usize> = places_of_usable(readings).collect();
    if all.len() > SUSPECTS {
        all.sort_by(|a, b| off(&readings[*b]).total_cmp(&off(&readings[*a])));
        all.truncate(SUSPECTS);
    }
    all
}

/// The findings about a result that follows from these readings, the scatter about their circuit, and how well the
/// result agrees with them.
fn check_readings(accepted: &Accepted, readings: &[Reading]) -> (Findings, f64, Option<Agreement>) {
    let Accepted { seq, sweep, is_survey } = accepted;
    let mut findings = Findings::default();
    let Outcome::Accepted { resonance_hz, sigma_hz, circuit, extra, effective_time_s, .. } =
        &sweep.outcome
    else {
        return (findings, f64::NAN, None);
    };
    let number = sweep.number;
    let mut add = |check, what: &str, expected: String, found: f64, limit: Option<String>| {
        findings.within(check, *seq, format!("sweep {number}: {what}"), expected, found, limit);
    };
    let settings = sweep.fit.as_ref();
    let motion = settings.map_or(Motion::Settled, Motion::of);
    let noise = settings.and_then(|FitSettings { noise, .. }| *noise);
    let stated = circuit.as_ref().filter(|_| *sigma_hz > 0.0 && sigma_hz.is_finite());
    let bench = settings.and_then(|settings| settings.bench);
    let bench = bench.filter(|_| motion != Motion::Settled);
    let fit_with = |bench: Option<&Bench>, circuit| {
        let (resonance_hz, effective_time_s) = (*resonance_hz, *effective_time_s);
        let stated = Stated { resonance_hz, circuit, extra: extra.as_ref(), effective_time_s };
        match bench {
            Some(bench) => {
                let motion = Motion::Ringing { first_gap_s: bench.first_gap_s };
                fit::fit(&corrected(readings, bench), motion, noise, stated)
            }
            None => fit::fit(readings, motion, noise, stated),
        }
    };
    if let (Some(circuit), Some(Extra::Relaxation { time_s, .. })) = (stated, extra) {
        let decay_s = circuit.quality_factor / (PI * resonance_hz);
        let span_s = span_s(readings);
        let least_s = f64::max(RELAXATION_DECAYS * decay_s, RELAXATION_SPANS * span_s);
        if !(least_s..f64::INFINITY).contains(time_s) {
            let what = "the time constant of the relaxation, s";
            add(Check::Resonance, what, format!("at least {least_s}"), *time_s, None);
            return (findings, f64::NAN, None);
        }
    }
    let fitted = stated.and_then(|circuit| Some((fit_with(bench.as_ref(), circuit)?, circuit)));
    let Some((fitted, circuit)) = fitted else {
        let what = "no resonance follows from the readings";
        add(Check::Resonance, what, "none".to_owned(), *resonance_hz, None);
        return (findings, f64::NAN, None);
    };
    check_outcome(&sweep.outcome, &fitted, readings, settings, &mut add);
    let Fitted { scatter, degrees, mode_sigma, .. } = fitted;
    let most = most_scatter(noise, degrees, SCATTER_SIGMAS);
    if scatter > most {
        let what = "the scatter of the readings about the circuit, over the known noise";
        add(Check::Resonance, what, "near 1".to_owned(), scatter, Some(most.to_string()));
    }
    if let Some(bench) = bench.filter(|_| *is_survey) {
        let cost = |bench: &Bench| {
            let fit = fit_with(Some(bench), circuit)?;
            Some(fit.scatter * fit.degrees)
        };
        for Doubt { check, what, expected, found, limit } in survey::doubts(
            &bench,
            cost,
            (scatter, degrees),
            circuit.static_capacitance_f,
            mode_sigma,
        ) {
            add(check, what, expected.to_string(), found, Some(limit));
        }
    }
    let off = (resonance_hz - fitted.resonance_hz) / sigma_hz;
    let agreement = Agreement { off, sigma: sigma_hz / fitted.sigma_hz };
    (findings, scatter, Some(agreement).filter(|_| motion != Motion::Settled))
}

/// Compares an outcome with the fit of this checker.
fn check_outcome(
    outcome: &Outcome,
    fitted: &Fitted,
    readings: &[Reading],
    settings: Option<&FitSettings>,
    add: &mut impl FnMut(Check, &str, String, f64, Option<String>),
) {
    let Outcome::Accepted { resonance_hz, sigma_hz, circuit, effective_time_s, left_out, .. } =
        outcome
    else {
        return;
    };
    let Fitted { resonance_hz: fit_hz, sigma_hz: fit_sigma, degrees, .. } = *fitted;
    let quality_factor = fitted.circuit.quality_factor;
    let limit = RESONANCE_SIGMAS * sigma_hz;
    if (fit_hz - resonance_hz).abs() > limit || !fit_hz.is_finite() {
        let what = "the resonance, Hz";
        add(Check::Resonance, what, fit_hz.to_string(), *resonance_hz, Some(limit.to_string()));
    }
    let is_ringing = settings.is_some_and(FitSettings::is_ringing);
    let least = if is_ringing { SIGMA_LEAST } else { SIGMA_LEAST_ON_GRID };
    let least_hz = least * fit_sigma;
    let most_hz = if is_ringing {
        let bench = settings.and_then(|settings| settings.bench);
        let phase_sigma = bench.map_or(0.0, |bench| bench.phase_sigma_rad);
        let static_f = fitted.circuit.static_capacitance_f;
        let dispersion = bench.and_then(|bench| bench.dispersion);
        let dispersion_sigma = dispersion.map_or(0.0, |found| found.dispersion_sigma_f / static_f);
        // With Q from 6 to 100 and couplings from 0.02 to 0.1 a phase error of a radian moves the resonance by no more than
        // a linewidth, and neither does a dispersion by which the capacitance changes as much as it is.
        let of_bench = phase_sigma.hypot(dispersion_sigma) * fit_hz / quality_factor;
        let of_fit = fitted.with_mode_hz.hypot(of_bench);
        let most = if *left_out > 0 { SIGMA_MOST_OF_REST } else { SIGMA_MOST };
        most * of_fit.hypot(SHAPE * fitted.moved_hz)
    } else {
        f64::max(SIGMA_MOST_ON_GRID * fit_sigma, SIGMA_LINEWIDTHS * fit_hz / quality_factor)
    };
    if !(least_hz..=most_hz).contains(sigma_hz) {
        let limit = Some(format!("from {least_hz} to {most_hz}"));
        add(Check::Sigma, "the standard deviation, Hz", fit_sigma.to_string(), *sigma_hz, limit);
    }
    if let (Some(fit_s), Some(time_s)) = (fitted.effective_time_s, *effective_time_s) {
        let limit_s = time_limit_s(readings, degrees, fit_s);
        if (time_s - fit_s).abs() > limit_s || !time_s.is_finite() {
            let what = "the time for which the resonance holds, s";
            let limit = Some(format!("{limit_s} s"));
            add(Check::ReadingTime, what, fit_s.to_string(), time_s, limit);
        }
    }
    let Some(circuit) = circuit else { return };
    for (what, expected, stated, [least, most]) in
        values(&fitted.circuit, &fitted.circuit_sigma, circuit)
    {
        if !(least..=most).contains(&stated) {
            let limit = Some(format!("from {least} to {most}"));
            add(Check::Resonance, what, expected.to_string(), stated, limit);
        }
    }
    let (beside, limit) = (fitted.beside_sigmas, CIRCUIT_SIGMAS);
    if beside.is_nan() || beside > limit {
        let what = "what is beside the circuit, in standard deviations from the fit";
        add(Check::Resonance, what, "0".to_owned(), beside, Some(limit.to_string()));
    }
}

/// Duration of these readings, s.
fn span_s(readings: &[Reading]) -> f64 {
    let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return 0.0 };
    last.end_s() - first.begin_s()
}

/// Largest difference between two statements of the time for which a resonance holds, s.
fn time_limit_s(readings: &[Reading], degrees: f64, fit_s: f64) -> f64 {
    let span_s = span_s(readings);
    let middle_s = readings.first().map_or(0.0, Reading::begin_s) + 0.5 * span_s;
    let spans = TIME_SPANS + TIME_SPANS_BY_DEGREES * degrees.powi(-2);
    spans * span_s + TIME_REL * (fit_s - middle_s).abs()
}

/// Largest scatter about a fit, over the noise that was known before, within this many standard deviations.
pub(crate) fn most_scatter(noise: Option<FitNoise>, degrees: f64, sigmas: f64) -> f64 {
    let (known, guess) =
        noise.map_or((4.0, GUESS * GUESS), |noise| (noise.degrees_of_freedom, 1.0));
    // The cube root of χ²/n is nearly normal with variance 2/9n (Wilson and Hilferty).
    let part = (2.0 / 9.0 * (1.0 / degrees + 1.0 / known)).sqrt();
    guess * (1.0 + sigmas * part).powi(3)
}

/// Name, value of this checker, stated value and its limits, of each value of a circuit. Few readings
/// determine some of them poorly.
fn values(
    found: &Circuit,
    sigma: &Circuit,
    stated: &Circuit,
) -> [(&'static str, f64, f64, [f64; 2]); 4] {
    let of = |factors: [f64; 2], value: f64, sigma: f64| {
        let sigmas = CIRCUIT_SIGMAS * sigma;
        let more = 1.0 + sigmas;
        let by_factor = [factors[0].min(1.0 / more) * value, factors[1].max(more) * value];
        // Where little is known, limits by factors mean nothing.
        let room = if sigmas < 1.0 { 0.0 } else { sigmas * value.abs() };
        [by_factor[0].min(by_factor[1]) - room, by_factor[0].max(by_factor[1]) + room]
    };
    let (q, c0) = (found.quality_factor, found.static_capacitance_f);
    let (ratio, loss) = (found.capacitance_ratio, found.loss_tangent);
    let positive = |limit: f64| limit.max(0.0);
    let of_loss = LOSS.max(CIRCUIT_SIGMAS * sigma.loss_tangent);
    [
        ("the quality factor", q, stated.quality_factor, of(Q_RATIO, q, sigma.quality_factor)),
        (
            "the static capacitance, F",
            c0,
            stated.static_capacitance_f,
            of(CAPACITANCE_RATIO, c0, sigma.static_capacitance_f),
        ),
        (
            "the ratio of capacitances",
            ratio,
            stated.capacitance_ratio,
            of(Q_RATIO, ratio, sigma.capacitance_ratio),
        ),
        // One below zero is stated as zero.
        (
            "the loss tangent",
            loss,
            stated.loss_tangent,
            [loss - of_loss, loss + of_loss].map(positive),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn loss_holds(found: f64, stated: f64, holds: bool) {
        let of = |loss_tangent| Circuit {
            quality_factor: 60.0,
            static_capacitance_f: 30e-9,
            capacitance_ratio: 0.1,
            loss_tangent,
        };
        let sigma = Circuit {
            quality_factor: 0.02,
            static_capacitance_f: 0.02,
            capacitance_ratio: 0.02,
            loss_tangent: 0.05,
        };
        let all = values(&of(found), &sigma, &of(stated));
        let broken = all.iter().filter(|(.., stated, [low, high])| !(low..=high).contains(&stated));
        let broken: Vec<_> = broken.map(|(what, ..)| *what).collect();
        assert_eq!(broken.is_empty(), holds, "{found} {stated}: {broken:?}");
    }

    #[test]
    fn a_loss_tangent_below_zero_is_stated_as_zero() {
        loss_holds(0.02, 0.03, true);
        loss_holds(0.02, 0.3, false);
        loss_holds(-0.458, 0.0, true);
        loss_holds(-0.458, -0.458, false);
        loss_holds(-0.458, 0.05, false);
        loss_holds(0.4, 0.0, false);
    }
}
