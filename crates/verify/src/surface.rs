//! The surface found by a search: its height follows from the positions tried.

use crate::{
    finding::{Check, Findings},
    labels::CLOCK_SLACK_S,
    motion::{Descent, ROUNDING},
    record::{FitNoise, Flag, SurfaceFound, Tried},
    settings::{Approach, Protocol},
};

/// Checks that the surface lies in the middle of the last clear position and the contact below it, and
/// that this bracket is no wider than the fine step.
pub(crate) fn check(
    seq: u64,
    found: &SurfaceFound,
    (protocol, noise): (&Protocol, Option<FitNoise>),
    findings: &mut Findings,
) {
    let Some((clear, contact)) = bracket(&found.trail) else {
        let what = "a surface without a clear position and a contact below it";
        findings.add(
            Check::Surface,
            seq,
            what,
            "a bracket",
            format!("{} readings", found.trail.len()),
        );
        return;
    };
    check_contacts(seq, &found.trail, &Threshold::of(&protocol.approach, noise), findings);
    if found.trail.last().and_then(parts).is_none() {
        let what = "the last reading of a search that found a surface";
        findings.add(Check::Surface, seq, what, "an impedance", "none");
    }
    let middle = 0.5 * (clear + contact);
    let what = "the surface, mm: the middle of the last clear position and the contact";
    findings.agree(Check::Surface, seq, what, (middle, found.position_mm), ROUNDING);
    let width = clear - contact;
    let sigma = width / 12.0_f64.sqrt();
    let what = "the standard deviation of the surface, mm: that of a uniform error";
    findings.agree(Check::Surface, seq, what, (sigma, found.sigma_mm), ROUNDING);
    let fine = protocol.approach.fine_step_mm();
    // Each end of the bracket is a read-back.
    let limit = 2.0 * fine;
    if width > limit {
        let what = "the bracket of the surface, mm";
        findings.within(Check::Surface, seq, what, fine, width, Some(limit.to_string()));
    }
}

/// An integration has at least this part of the cycles that the protocol asks for: frequencies are rounded.
const CYCLES_PART: f64 = 0.95;
/// The relative change of an impedance that counts as contact is compared with the clear probe here, and
/// with the probe at the last clear position of the search by this checker: both may differ by this much or by this many
/// standard deviations of the noise, and by half of the limit.
const THRESHOLD_SLACK: f64 = 0.03;
const THRESHOLD_SIGMAS: f64 = 4.0;

/// The relative change of an impedance that counts as contact, and what this checker allows beside it.
#[derive(Debug, Clone, Copy)]
struct Threshold {
    limit: f64,
    slack: f64,
}

impl Threshold {
    /// With the noise that was known before the last sweep.
    fn of(approach: &Approach, noise: Option<FitNoise>) -> Self {
        let of_reading = noise.map_or(0.0, |noise| {
            noise.at_ten_cycles * (10.0 / f64::from(approach.cycles.max(1))).sqrt()
        });
        // Both readings have it.
        let slack = THRESHOLD_SLACK.max(THRESHOLD_SIGMAS * 2.0_f64.sqrt() * of_reading);
        Self { limit: approach.contact_threshold, slack }
    }

    fn may_be_clear(&self, change: f64) -> bool {
        change <= 1.5 * self.limit + self.slack
    }

    fn may_be_contact(&self, change: f64) -> bool {
        0.5 * self.limit - self.slack <= change
    }
}

/// What the readings after a sweep say of the surface.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Again {
    /// It is still where the search found it.
    pub(crate) is_still_there: bool,
    /// The probe may touch above it.
    pub(crate) may_be_higher: bool,
    /// The probe may be free below it.
    pub(crate) may_be_lower: bool,
}

/// Checks that the surface was looked for at the right distances after a sweep. Returns what the readings
/// say of the surface that the search `found`.
pub(crate) fn check_again(
    seq: u64,
    (surface_mm, clear): (f64, Option<[f64; 2]>),
    trail: &[Tried],
    (protocol, noise): (&Protocol, Option<FitNoise>),
    tolerance_mm: f64,
    findings: &mut Findings,
) -> Again {
    // A reading that the analyzer flagged was repeated.
    let valid = trail.iter().copied().filter(|tried| tried.reading.flag == Flag::Normal);
    let trail = &valid.collect::<Vec<Tried>>()[..];
    let slip_mm = protocol.slip_mm().unwrap_or(f64::NAN);
    // Where the probe seemed to touch above the surface, its impedance when clear was read again.
    let anew_mm = slip_mm + protocol.approach.coarse_step_mm + protocol.touch.indentation_mm;
    let (asked, clear): (&[f64], _) = match trail {
        [_, again, ..] if trail.len() > 2 => (&[slip_mm, anew_mm, slip_mm, -slip_mm], parts(again)),
        [_, again] if again.position_mm > surface_mm => (&[slip_mm, anew_mm], None),
        _ => (&[slip_mm, -slip_mm], clear),
    };
    for (tried, asked_mm) in trail.iter().zip(asked) {
        let what = "the height at which the surface was looked for again, mm";
        let found_mm = tried.position_mm - surface_mm;
        findings.agree(Check::Surface, seq, what, (*asked_mm, found_mm), tolerance_mm + ROUNDING);
    }
    let threshold = Threshold::of(&protocol.approach, noise);
    let change = |tried: &Tried| clear.and_then(|clear| change(tried, clear));
    let may_touch = |tried: &Tried| change(tried).is_none_or(|by| threshold.may_be_contact(by));
    let may_be_free = |tried: &Tried| change(tried).is_none_or(|by| threshold.may_be_clear(by));
    let ([above, below] | [_, _, above, below]) = trail else {
        let may_be_higher = trail.iter().any(may_touch);
        return Again { is_still_there: false, may_be_higher, may_be_lower: false };
    };
    // Of a contact that has not quite decayed above, as much may be left as a light one changes.
    let is_changed = parts(above)
        .and_then(|free| self::change(below, free))
        .is_some_and(|by| threshold.may_be_contact(by));
    let is_known = change(above).is_some() && change(below).is_some();
    Again {
        is_still_there: is_known && may_be_free(above) && may_touch(below) && is_changed,
        // The probe went below because it was free above.
        may_be_higher: false,
        may_be_lower: may_be_free(below),
    }
}

/// The relative change of an impedance from that of the clear probe.
fn change(tried: &Tried, [clear_re, clear_im]: [f64; 2]) -> Option<f64> {
    let [re, im] = parts(tried)?;
    Some((re - clear_re).hypot(im - clear_im) / clear_re.hypot(clear_im))
}

/// What the order of the positions says of a reading of a search.
#[derive(Debug, Clone, Copy)]
struct Seen<'a> {
    tried: &'a Tried,
    /// The search went up from here.
    touches: bool,
    /// The order does not say what it was: the next reading has the same read-back; or the search went above the last
    /// clear position and read there again, because the contact might be a drift; or a clear reading at or below its
    /// position followed, so that it was no contact.
    is_open: bool,
    /// Counts how often the impedance of the clear probe was read again before.
    part: usize,
}

fn seen(trail: &[Tried]) -> Vec<Seen<'_>> {
    let (mut part, mut clear_mm) = (0, None);
    let next = trail.iter().skip(1).map(|tried| tried.position_mm).chain([f64::INFINITY]);
    let mut all = Vec::new();
    for (tried, next_mm) in trail.iter().zip(next) {
        let is_tied = tried.position_mm == next_mm;
        let touches = tried.position_mm < next_mm;
        let is_doubted = touches && next_mm.is_finite() && clear_mm.is_none_or(|mm| mm < next_mm);
        all.push(Seen { tried, touches, is_open: is_tied || is_doubted, part });
        part += usize::from(is_doubted);
        if !touches && !is_tied {
            clear_mm = Some(tried.position_mm);
        }
    }
    let mut lowest_clear_mm = f64::INFINITY;
    for one in all.iter_mut().rev() {
        one.is_open |= one.touches && lowest_clear_mm <= one.tried.position_mm;
        if !one.touches && !one.is_open {
            lowest_clear_mm = lowest_clear_mm.min(one.tried.position_mm);
        }
    }
    all
}

/// Checks that the readings of a search show a contact where the trail has one, and none elsewhere. A contact
/// that the search itself refuted claims nothing. They are compared with the mean of those of the clear probe, as it was
/// read again at last.
fn check_contacts(seq: u64, trail: &[Tried], threshold: &Threshold, findings: &mut Findings) {
    let seen = seen(trail);
    let parts_of = |part: usize| {
        let is_clear = move |one: &&Seen<'_>| one.part == part && !one.touches && !one.is_open;
        let clear = seen.iter().filter(is_clear);
        clear.filter_map(|one| parts(one.tried)).collect::<Vec<[f64; 2]>>()
    };
    for (index, one) in seen.iter().enumerate().filter(|(_, one)| !one.is_open) {
        let clear = parts_of(one.part);
        let mean = [0, 1]
            .map(|part| clear.iter().map(|parts| parts[part]).sum::<f64>() / clear.len() as f64);
        let is_shown = |change: &f64| {
            if one.touches {
                threshold.may_be_contact(*change)
            } else {
                threshold.may_be_clear(*change)
            }
        };
        let Some(change) = change(one.tried, mean).filter(|change| !is_shown(change)) else {
            continue;
        };
        let state = if one.touches { "in contact" } else { "clear" };
        let what = format!("reading {} of the search, {state}: relative change", index + 1);
        let slack = Some(format!("a half and {}", threshold.slack));
        findings.within(Check::Surface, seq, what, threshold.limit, change, slack);
    }
}

/// Resistance and reactance of a reading without a flag, ohm.
fn parts(tried: &Tried) -> Option<[f64; 2]> {
    let reading = &tried.reading;
    crate::fit::is_usable(reading).then_some([reading.resistance_ohm?, reading.reactance_ohm?])
}

/// The impedance at the last clear position of a search, ohm.
pub(crate) fn clear_impedance(trail: &[Tried]) -> Option<[f64; 2]> {
    let (clear, _) = bracket(trail)?;
    parts(trail.iter().rfind(|tried| tried.position_mm == clear)?)
}

/// The last clear position and the contact. A search goes down from a clear position and up from a
/// contact, so that the order of the positions says which is which; the last one is a contact.
fn bracket(trail: &[Tried]) -> Option<(f64, f64)> {
    let contact = trail.last()?.position_mm;
    let is_clear = |pair: &&[Tried]| pair[1].position_mm < pair[0].position_mm;
    let clear = trail.windows(2).filter(is_clear).map(|pair| pair[0].position_mm).next_back()?;
    (clear > contact).then_some((clear, contact))
}

/// Checks that each reading of a search was taken where the trail says, between two moves, with the
/// settling and the cycles of the protocol.
pub(crate) fn check_trail(
    seq: u64,
    rig_us: u64,
    trail: &[Tried],
    (descent, approach): (Option<&Descent>, Option<&Approach>),
    findings: &mut Findings,
) {
    let Some(descent) = descent else { return };
    if let (Some(way_us), Some(first)) = (descent.way_down_us, trail.first()) {
        let (way_s, begin_s) = (way_us as f64 / 1e6, first.reading.begin_s());
        if begin_s < way_s - CLOCK_SLACK_S {
            let what = "a move longer than a step of the search after a reading of it, s";
            let expected = format!("the first reading after {way_s:.3}");
            findings.add(Check::SearchStep, seq, what, expected, format!("{begin_s:.3}"));
        }
    }
    let mut last_s = f64::NEG_INFINITY;
    for (index, Tried { position_mm, reading }) in trail.iter().enumerate() {
        let place = index + 1;
        let begin_s = reading.begin_s();
        // A step of the search can take less time than the clocks may differ by.
        let last = |slack_s: f64| {
            let is_before = |(at_us, _): &&(u64, f64)| *at_us as f64 / 1e6 <= begin_s + slack_s;
            descent.moves.iter().rev().find(is_before)
        };
        let is_at = |(_, at_mm): &&(u64, f64)| (at_mm - position_mm).abs() <= ROUNDING;
        let before = last(0.0).filter(is_at).or_else(|| last(CLOCK_SLACK_S));
        let at_mm = before.map(|(_, at_mm)| *at_mm);
        let is_there = before.as_ref().is_some_and(is_at);
        if !is_there {
            let what = format!("reading {place} of the search was not taken at its position, mm");
            let found = format!("{position_mm} at {begin_s:.3} s");
            let expected = at_mm.map_or_else(|| "a move before it".to_owned(), |at| at.to_string());
            findings.add(Check::Surface, seq, what, expected, found);
        }
        if let (Some(approach), Some((at_us, _))) = (approach, before) {
            let settled_s = begin_s - *at_us as f64 / 1e6;
            let cycles = reading.integration_s * reading.frequency_hz;
            let has_settled = settled_s >= approach.settle_s - CLOCK_SLACK_S;
            if !has_settled || cycles < CYCLES_PART * f64::from(approach.cycles) {
                let what = format!("settling and cycles of reading {place} of the search");
                let expected = format!("{} s, {} cycles", approach.settle_s, approach.cycles);
                let found = format!("{settled_s:.3} s, {cycles:.1} cycles");
                findings.add(Check::Request, seq, what, expected, found);
            }
        }
        let is_in_order =
            begin_s >= last_s && reading.end_s() <= rig_us as f64 / 1e6 + CLOCK_SLACK_S;
        if !is_in_order {
            let what = format!("the time of reading {place} of the search, s");
            let expected = format!("from {last_s:.3} to {:.3}", rig_us as f64 / 1e6);
            let found = format!("{begin_s:.3} to {:.3}", reading.end_s());
            findings.add(Check::ReadingTime, seq, what, expected, found);
        }
        last_s = begin_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A search with these read-backs, mm, in contact below 10 mm.
    fn trail(positions_mm: &[f64]) -> Vec<Tried> {
        let tried = |position_mm: &f64| {
            let ohm = if *position_mm < 10.0 { 2000.0 } else { 1000.0 };
            let reading = serde_json::json!({
                "frequency_hz": 140.0, "resistance_ohm": ohm, "reactance_ohm": 0.0, "started_s": 0.0,
                "settle_s": 0.0, "integration_s": 0.01,
            });
            let reading = serde_json::from_value(reading).expect("a reading");
            Tried { position_mm: *position_mm, reading }
        };
        positions_mm.iter().map(tried).collect()
    }

    fn found(positions_mm: &[f64]) -> usize {
        let mut findings = Findings::default();
        let threshold = Threshold { limit: 0.1, slack: THRESHOLD_SLACK };
        check_contacts(1, &trail(positions_mm), &threshold, &mut findings);
        findings.0.len()
    }

    /// A reading like those of the clear probe counted as contact. The search went up and down again in finer steps, and
    /// found the probe clear there.
    #[test]
    fn a_contact_that_a_lower_clear_reading_refutes_is_none() {
        assert_eq!(found(&[10.3, 10.2, 10.1, 10.15, 10.09, 9.99]), 0);
        // Nothing was read as low as that again.
        assert_ne!(found(&[10.3, 10.2, 10.1, 10.15, 10.12, 9.99]), 0);
    }

    #[test]
    fn two_contacts_with_one_read_back_are_no_clear_reading() {
        assert_eq!(found(&[10.2, 10.1, 9.99]), 0);
        assert_eq!(found(&[10.2, 10.1, 9.99, 9.99]), 0);
        // Up from a contact, and down again.
        assert_eq!(found(&[10.2, 9.9, 10.05, 9.99, 9.99]), 0);
        // It went on downwards from a contact.
        assert_ne!(found(&[10.2, 9.99, 9.98]), 0);
    }
}
