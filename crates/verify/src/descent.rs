//! A descent with a stream of readings: whether it went on although it touched, and where its surface lies.

mod onset;

use crate::{
    finding::{Check, Findings},
    fit::is_usable,
    labels::CLOCK_SLACK_S,
    record::{Descended, Reading, SurfaceFound},
    settings::Protocol,
};

pub(crate) use onset::Free;

/// The first readings of a descent are those of the clear probe.
const REFERENCES: usize = 8;
/// The readings after the first one that touches without doubt: one that is under way when the decision comes,
/// and one until the stage rests.
const AFTER_CONTACT: usize = 2;
/// A relative change of this many limits, and this, is a contact without doubt.
const LIMITS: f64 = 1.5;
const SLACK: f64 = 0.03;
/// The probe at rest after a contact changes the impedance by this part of the limit at least.
const PART_AT_REST: f64 = 0.3;
/// The surface may lie this many of its standard deviations, and this, mm, from the one found here.
const SIGMAS: f64 = 5.0;
const MODEL_MM: f64 = 0.006;

/// The mean impedance of the clear probe at the beginning of a descent, ohm.
pub(crate) fn clear_impedance(descended: &Descended) -> Option<[f64; 2]> {
    let first: Vec<[f64; 2]> =
        descended.readings.iter().filter_map(parts).take(REFERENCES).collect();
    let mean = |part: usize| first.iter().map(|one| one[part]).sum::<f64>() / first.len() as f64;
    (first.len() == REFERENCES).then(|| [mean(0), mean(1)])
}

fn parts(reading: &Reading) -> Option<[f64; 2]> {
    is_usable(reading).then_some([reading.resistance_ohm?, reading.reactance_ohm?])
}

fn change([re, im]: [f64; 2], [clear_re, clear_im]: [f64; 2]) -> f64 {
    (re - clear_re).hypot(im - clear_im) / clear_re.hypot(clear_im)
}

/// Checks the readings of a descent: their order, and that it did not go on in contact.
pub(crate) fn check(
    seq: u64,
    rig_us: u64,
    descended: &Descended,
    protocol: &Protocol,
    findings: &mut Findings,
) {
    let (mut last_s, end_s) = (f64::NEG_INFINITY, rig_us as f64 / 1e6);
    for (index, reading) in descended.readings.iter().enumerate() {
        let begin_s = reading.begin_s();
        if begin_s < last_s || end_s + CLOCK_SLACK_S < reading.end_s() {
            let what = format!("the time of reading {} of the descent, s", index + 1);
            let expected = format!("from {last_s:.3} to {end_s:.3}");
            let found = format!("{begin_s:.3} to {:.3}", reading.end_s());
            findings.add(Check::ReadingTime, seq, what, expected, found);
        }
        last_s = begin_s;
    }
    let Some(clear) = clear_impedance(descended) else {
        if descended.end == "contact" {
            let what = "a contact without readings of the clear probe before it";
            findings.add(Check::Surface, seq, what, REFERENCES, descended.readings.len());
        }
        return;
    };
    let limit = protocol.approach.contact_threshold;
    let touches = |reading: &Reading| {
        parts(reading).is_none_or(|parts| LIMITS * limit + SLACK < change(parts, clear))
    };
    let after = descended.readings.iter().skip(REFERENCES).skip_while(|one| !touches(one)).count();
    if after > 1 + AFTER_CONTACT {
        let what = "readings of a descent from the first that touches on";
        let most = Some((1 + AFTER_CONTACT).to_string());
        findings.within(Check::SearchStep, seq, what, "at most", after, most);
    }
    if descended.end == "contact" {
        let least = 0.5 * limit - SLACK;
        let largest = descended.readings.iter().skip(REFERENCES).rev().take(1 + AFTER_CONTACT);
        let largest = largest.filter_map(parts).map(|parts| change(parts, clear));
        let largest = largest.fold(0.0, f64::max);
        if largest < least {
            let what = "the largest change of the last readings of a descent that ended in contact";
            findings.within(
                Check::Surface,
                seq,
                what,
                "a contact",
                largest,
                Some(least.to_string()),
            );
        }
    }
}

/// Checks the surface of a descent against a fit of its own, and that the probe touched at rest.
pub(crate) fn check_surface(
    seq: u64,
    found: &SurfaceFound,
    descended: &Descended,
    free: Option<Free>,
    protocol: &Protocol,
    findings: &mut Findings,
) {
    // A protocol with an aim may leave the fine step to it.
    if let Some(fine) = protocol.approach.fine_step_mm.filter(|fine| *fine < found.sigma_mm) {
        let what = "the standard deviation of the surface of a descent, mm";
        findings.within(Check::Surface, seq, what, "less", found.sigma_mm, Some(fine.to_string()));
    }
    let (Some(clear), Some(free)) = (clear_impedance(descended), free) else {
        let what = "a surface of a descent whose clear probe was not read";
        findings.add(Check::Surface, seq, what, REFERENCES, descended.readings.len());
        return;
    };
    let least = PART_AT_REST * protocol.approach.contact_threshold;
    let last = found.trail.last().and_then(|tried| parts(&tried.reading));
    let at_rest = last.map_or(0.0, |parts| change(parts, clear));
    if at_rest < least {
        let what = "the change of the impedance at rest, where a descent found a surface";
        findings.within(Check::Surface, seq, what, "a contact", at_rest, Some(least.to_string()));
    }
    let Some(way) = onset::Way::of(descended) else {
        let what = "positions on the way of a descent that found a surface";
        findings.add(Check::Surface, seq, what, "at least 3", descended.way.len());
        return;
    };
    let at_rest = found.trail.iter().map(|tried| &tried.reading);
    let readings: Vec<&Reading> = descended.readings.iter().chain(at_rest).collect();
    let own_mm = onset::surface_mm(&free, &readings, clear, &way, found.position_mm);
    let what = "the surface, mm: where the readings of the descent show the onset of a contact";
    let limit = SIGMAS * found.sigma_mm + MODEL_MM;
    findings.agree(Check::Surface, seq, what, (own_mm, found.position_mm), limit);
}
