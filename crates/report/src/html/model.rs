//! The model behind the stiffness: the verdict on it, what was learnt, the residuals.

use maud::{Markup, html};
use rig_analysis::model::{LearntTerm, ModelCheck, Pattern, RunModel, SlipNoticed, Term, Verdict};
use rig_chart::{Axis, Chart, Marker, Point, Rule, Series};
use rig_record::{Direction, Phase};

use super::{
    element::{drawn, fault, figure_row, table, text},
    figures::PANEL_PX,
};
use crate::{
    data::{DIRECTIONS, RunData},
    results::{RunResults, stiffness::Stiffness},
    units::{fixed, percent, with_sigma},
};

/// The model of a run; empty when the touches cannot judge it.
pub(super) fn model(results: &RunResults, stiffness: &Stiffness) -> Markup {
    let model = &stiffness.model;
    let Some(check) = model.check() else { return html! {} };
    html! {
        (verdict(&results.data, check))
        @if !learnt(model).is_empty() { p { (learnt(model)) } }
        (residuals(results, stiffness, check))
        @if check.verdict != Verdict::Holds { (evidence(&results.data, check)) }
        @else {
            p { (not_told(check)) }
            @if let Some(slip) = check.slip_noticed { p { (of_slip(&slip)) } }
        }
    }
}

/// The verdict in a sentence, marked when the model does not hold.
fn verdict(data: &RunData, check: &ModelCheck) -> Markup {
    let chi2 = format!(
        "χ² of the main touches is {} with {} degrees of freedom, {} for each",
        fixed(check.chi2, 1),
        check.freedom,
        fixed(check.chi2_per_dof(), 2),
    );
    let added = percent(check.added_rel);
    match check.verdict {
        Verdict::Holds => html! {
            p { "The model holds: " (chi2) ". A true model is called strained in one or two of a hundred runs." }
        },
        Verdict::Strained => html! {
            p {
                (fault("The model is strained")) ": " (chi2) (because(data, check)) ". The residuals add "
                (added) " to the uncertainty of every stiffness."
            }
        },
        Verdict::Rejected => html! {
            p {
                (fault("The model is rejected")) ": " (chi2) (because(data, check)) ". Every stiffness \
                below is by a model that these touches contradict; the residuals add " (added)
                " to its uncertainty."
            }
        },
    }
}

/// What a model that holds does not say.
fn not_told(check: &ModelCheck) -> String {
    /// Between Hertz's and Sneddon's law at one radius.
    const OTHER_LAW: f64 = 0.1;
    let advice = "The protocol key halfway_mm measures each touch at a second depth, which tells them apart.";
    let alike = "another contact law, a layered sample, or a thin one on a hard base";
    match check.exponent_noticed {
        None => format!(
            "It holds for these depths only: the touches cannot show {alike}, because each has the pattern of another \
             friction or arm. {advice}"
        ),
        Some(exponent) => {
            let seen = format!(
                "Touches like these show, in 95 of 100 runs, a contact whose exponent of the depth differs from that of its law \
                 by {} or more; Hertz's law and Sneddon's differ by about {OTHER_LAW}.",
                fixed(exponent, 2)
            );
            if exponent > OTHER_LAW {
                format!("{seen} They cannot show less of {alike}. {advice}")
            } else {
                seen
            }
        }
    }
}

/// What a model that holds says of a contact that slips.
fn of_slip(slip: &SlipNoticed) -> String {
    let SlipNoticed { begins_below, share_of_first, below } = *slip;
    let first = fixed(begins_below, 2);
    match below {
        Some(below) if below >= begins_below => format!(
            "At a coefficient of friction below {first} at least one of these touches slides; in 95 of 100 runs that is \
             noticed."
        ),
        Some(below) => format!(
            "A contact that slips at a coefficient of friction below about {} is noticed in 95 of 100 runs. Between that and \
             {first} it slides in the few touches that need most friction, of which one alone is noticed in {} of 100.",
            fixed(below, 2),
            fixed(100.0 * share_of_first, 0),
        ),
        None => format!(
            "At a coefficient of friction below {first} at least one of these touches slides. They are too few or too \
             uncertain to show it in 95 of 100 runs."
        ),
    }
}

fn because(data: &RunData, check: &ModelCheck) -> String {
    let Some(pattern) = check.pattern else {
        return "; no single cause explains the misfit".to_owned();
    };
    format!("; most of the misfit has the pattern of {}", name(data, pattern))
}

fn name(data: &RunData, pattern: Pattern) -> String {
    match pattern {
        Pattern::Friction => {
            "another friction, or of a contact that slips from some angle on".into()
        }
        Pattern::Arm => "another length of the probe's arm".into(),
        Pattern::Depth => "another growth of the contact with depth, or of another depth".into(),
        Pattern::Sample(sample) => format!("sample {} alone", data.samples()[sample].name),
        Pattern::Known(sample) => format!(
            "samples of known stiffness without one common factor, sample {} most",
            data.samples()[sample].name
        ),
    }
}

/// What the touches say of the model, in sentences.
fn learnt(model: &RunModel) -> String {
    let one = |learnt: &LearntTerm| {
        let (what, unit) = match learnt.term {
            Term::TangentialRatio => ("a tangential over normal contact stiffness of", ""),
            Term::Arm => ("an arm of", " mm"),
        };
        let value = with_sigma(learnt.value, learnt.sigma);
        format!("{what} {value}{unit} (rig file: {}{unit})", fixed(learnt.described, 3))
    };
    let mut found: Vec<String> = model.learnt().iter().map(one).collect();
    if model.terms().deflects != model.described().deflects {
        let held = if model.terms().deflects { "the stage" } else { "the indentation" };
        found.push(format!("a depth held by {held}, unlike the rig file"));
    }
    if found.is_empty() {
        return String::new();
    }
    format!(
        "Learnt from the main touches, and used for every stiffness: {}. The uncertainty of what was \
         learnt is part of every standard deviation.",
        found.join("; ")
    )
}

/// The residuals against the angle, one chart for each direction.
fn residuals(results: &RunResults, stiffness: &Stiffness, check: &ModelCheck) -> Markup {
    let largest = check.residuals.iter().map(|one| one.sigmas.abs()).fold(3.0, f64::max);
    let rows: Vec<_> = (results.touches.iter())
        .filter(|row| row.phase == Phase::Main.name())
        .filter_map(|row| Some((row, stiffness.residual(&row.step)?)))
        .collect();
    let mut charts = Vec::new();
    for direction in DIRECTIONS.map(Direction::name) {
        let here: Vec<_> = rows.iter().filter(|(row, _)| row.direction == direction).collect();
        if here.is_empty() {
            continue;
        }
        let mut chart = Chart::new(
            direction,
            &format!("Residuals of the main touches against the contact angle, {direction}."),
            Axis::linear("contact angle (°)").with_ticks(&results.angles_deg()),
            Axis::linear("residual (standard deviations)").including(largest).including(-largest),
        );
        chart.size_px = PANEL_PX;
        for (index, sample) in results.data.samples().iter().enumerate() {
            let points = here.iter().filter(|(row, _)| row.sample == sample.name);
            let points: Vec<Point> = points
                .map(|(row, residual)| Point {
                    x: row.angle_deg,
                    y: *residual,
                    error: None,
                    note: Some(format!("{}: {}", row.step, fixed(*residual, 2))),
                })
                .collect();
            if !points.is_empty() {
                let series = Series::scatter(&format!("sample {}", sample.name), index, points);
                chart.series.push(Series { marker: Some(Marker::of(index)), ..series });
            }
        }
        chart.rules.push(Rule::AtY { value: 0.0, label: String::new() });
        charts.push(drawn(&chart, &format!("fig-residual-{direction}")));
    }
    let caption = "Residuals of the model: logarithm of the stiffness of each main touch less that of its \
                   sample, in standard deviations. Under a model that holds they have no pattern.";
    figure_row(&html! { @for chart in &charts { (chart) } }, caption)
}

/// What each further term would change.
fn evidence(data: &RunData, check: &ModelCheck) -> Markup {
    let heads = ["a further term for", "removes of χ²", "probability by chance"];
    let rows: Vec<_> = (check.evidence.iter())
        .map(|one| {
            let probability = if one.probability < 1e-4 {
                "below 0.0001".to_owned()
            } else {
                fixed(one.probability, 4)
            };
            vec![text(name(data, one.pattern)), text(fixed(one.chi2_removed, 1)), text(probability)]
        })
        .collect();
    let caption = "What one further term would remove of χ². For a sample, it is the excess of its own; \
                   for the samples of known stiffness, that of χ² about their common factor.";
    table(caption, &heads, &rows)
}
