//! Every sweep of a run as a small picture.

use std::fmt::Write as _;

use maud::{Markup, html};
use rig_record::{Phase, Sweep, SweepOutcome, SweepPurpose, TouchSettings};

use crate::{data::RunData, units::fixed};

/// Width and height of a picture, in its own units.
const SIZE: (f64, f64) = (64.0, 36.0);
/// Room for a mark at the edge.
const MARGIN: f64 = 3.0;

/// The sweeps of one touch: its reference and those in contact.
struct Group<'a> {
    step: &'a str,
    sweeps: Vec<&'a Sweep>,
}

/// One picture for each touch with its sweeps.
pub(super) fn small_multiples(data: &RunData) -> Markup {
    let mut groups: Vec<Group<'_>> = Vec::new();
    for sweep in &data.sweeps {
        let step = sweep.step.as_deref().unwrap_or("no step");
        let step = step.strip_suffix("/no-load").unwrap_or(step);
        match groups.iter_mut().find(|group| group.step == step) {
            Some(group) => group.sweeps.push(sweep),
            None => groups.push(Group { step, sweeps: vec![sweep] }),
        }
    }
    html! {
        div.multiples {
            @for group in &groups { (picture(group, &short(data, group.step))) }
        }
        p.note {
            "Conductance against frequency in every sweep, each scaled to its own largest value: grey with the \
             probe clear, blue in contact, with a line at the resonance; red and with a cross where the sweep \
             was refused. The frequency axis of a picture covers its sweeps."
        }
    }
}

/// The name of a touch for a small place: `3 left 30°`, `blind 7`.
fn short(data: &RunData, step: &str) -> String {
    let planned = data.planned.iter().find(|planned| planned.settings.step == step);
    planned.map_or_else(
        || step.to_owned(),
        |planned| {
            let TouchSettings { phase, sample, pose, repeat, .. } = &planned.settings;
            match phase {
                Phase::Blind => format!("blind {repeat}"),
                Phase::Main => format!("{sample} {} {}°", pose.direction.name(), pose.angle_deg),
            }
        },
    )
}

fn picture(group: &Group<'_>, short: &str) -> Markup {
    let frequencies =
        || group.sweeps.iter().flat_map(|sweep| &sweep.readings).map(|one| one.frequency_hz);
    let low = frequencies().fold(f64::INFINITY, f64::min);
    let high = frequencies().fold(f64::NEG_INFINITY, f64::max);
    let x = |hz: f64| MARGIN + (SIZE.0 - 2.0 * MARGIN) * (hz - low) / (high - low).max(1e-9);
    let is_refused = group.sweeps.iter().any(|sweep| is_refused(sweep));
    let range = format!("{} Hz to {} Hz", fixed(low, 0), fixed(high, 0));
    let refusals = if is_refused { ", refused" } else { "" };
    let title = format!("{}: {} sweeps{refusals}, {range}", group.step, group.sweeps.len());
    html! {
        figure.refused[is_refused] {
            svg viewBox=(format!("0 0 {} {}", SIZE.0, SIZE.1)) role="img" aria-label=(title) {
                @for sweep in &group.sweeps { (curve(sweep, &x)) }
                @if is_refused { path.refused d="M55 5l5 5m0 -5l-5 5" {} }
            }
            figcaption { (short) }
        }
    }
}

fn is_refused(sweep: &Sweep) -> bool {
    matches!(sweep.outcome, SweepOutcome::Refused { .. })
}

/// The readings of a sweep as dots, and its resonance as a line.
fn curve(sweep: &Sweep, x: &impl Fn(f64) -> f64) -> Markup {
    let conductance = |r: f64, x: f64| r / (r * r + x * x);
    let values = sweep.readings.iter().filter_map(|reading| {
        let (r, x) = reading.impedance_ohm()?;
        Some((reading.frequency_hz, conductance(r, x))).filter(|(_, value)| value.is_finite())
    });
    let values: Vec<_> = values.collect();
    let largest = values.iter().map(|(_, value)| value.abs()).fold(f64::MIN_POSITIVE, f64::max);
    let mut dots = String::new();
    for (hz, value) in values {
        let y = SIZE.1 - MARGIN - (SIZE.1 - 2.0 * MARGIN) * (value / largest).max(0.0);
        // Writing to a string cannot fail.
        _ = write!(dots, "M{:.0} {y:.0}h0", x(hz));
    }
    let class = match (is_refused(sweep), sweep.purpose) {
        (true, _) => "refused",
        (false, SweepPurpose::NoLoad) => "clear",
        (false, _) => "contact",
    };
    html! {
        path class=(format!("dots {class}")) d=(dots) {}
        @if let SweepOutcome::Accepted { resonance_hz, .. } = sweep.outcome {
            path class=(class) d=(format!("M{:.1} 0V{}", x(resonance_hz), SIZE.1)) {}
        }
    }
}
