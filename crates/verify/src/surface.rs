//! The surface found by a search: its height follows from the positions tried.

use crate::{
    finding::{Check, Findings},
    labels::CLOCK_SLACK_S,
    motion::{Descent, ROUNDING},
    record::{SurfaceFound, Tried},
    settings::Protocol,
};

/// Checks that the surface lies in the middle of the last clear position and the contact below it, and
/// that this bracket is no wider than the fine step.
pub(crate) fn check(seq: u64, found: &SurfaceFound, protocol: &Protocol, findings: &mut Findings) {
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
    let middle = 0.5 * (clear + contact);
    let what = "the surface, mm: the middle of the last clear position and the contact";
    findings.agree(Check::Surface, seq, what, (middle, found.position_mm), ROUNDING);
    let width = clear - contact;
    let sigma = width / 12.0_f64.sqrt();
    let what = "the standard deviation of the surface, mm: that of a uniform error";
    findings.agree(Check::Surface, seq, what, (sigma, found.sigma_mm), ROUNDING);
    let fine = protocol.approach.fine_step_mm;
    // Each end of the bracket is a read-back.
    let limit = 2.0 * fine;
    if width > limit {
        let what = "the bracket of the surface, mm";
        findings.within(Check::Surface, seq, what, fine, width, Some(limit.to_string()));
    }
}

/// The last clear position and the contact. A search goes down from a clear position and up from a
/// contact, so that the order of the positions says which is which; the last one is a contact.
fn bracket(trail: &[Tried]) -> Option<(f64, f64)> {
    let contact = trail.last()?.position_mm;
    let is_clear = |pair: &&[Tried]| pair[1].position_mm < pair[0].position_mm;
    let clear = trail.windows(2).filter(is_clear).map(|pair| pair[0].position_mm).next_back()?;
    (clear > contact).then_some((clear, contact))
}

/// Checks that each reading of a search was taken where the trail says, between two moves.
pub(crate) fn check_trail(
    seq: u64,
    rig_us: u64,
    trail: &[Tried],
    descent: Option<&Descent>,
    findings: &mut Findings,
) {
    let Some(descent) = descent else { return };
    let mut last_s = f64::NEG_INFINITY;
    for (index, Tried { position_mm, reading }) in trail.iter().enumerate() {
        let place = index + 1;
        let begin_s = reading.begin_s();
        let moves = descent.moves.iter().rev();
        let before =
            moves.clone().find(|(at_us, _)| *at_us as f64 / 1e6 <= begin_s + CLOCK_SLACK_S);
        let at_mm = before.map(|(_, at_mm)| *at_mm);
        let is_there = at_mm.is_some_and(|at_mm| (at_mm - position_mm).abs() <= ROUNDING);
        if !is_there {
            let what = format!("reading {place} of the search was not taken at its position, mm");
            let found = format!("{position_mm} at {begin_s:.3} s");
            let expected = at_mm.map_or_else(|| "a move before it".to_owned(), |at| at.to_string());
            findings.add(Check::Surface, seq, what, expected, found);
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
