//! The page of the study.

use super::{
    Args, ProtocolTrials, by_angle, by_sample, charts, percent,
    protocol::TouchProtocol,
    summary::{Share, TrialSummary},
};
use crate::{
    page::{Page, Table},
    paper_bench::SAMPLES_MPA,
};

/// The page on the trials of all protocols.
pub(super) fn page(args: &Args, all: &[ProtocolTrials]) -> Page {
    let title = "Compensation of the contact angle".to_owned();
    let mut page = Page { title, parts: Vec::new() };
    page.text(format!(
        "This page is written by `cargo run --release -p rig-study -- compensation --out \
         docs/studies`, in half a minute on two cores, with {} trials of each protocol and seed {}. \
         The same seed gives the same bytes on any number of cores.",
        args.trials, args.seed
    ));
    page.text(
        "A shift falls by a tenth to a third from upright to 45°, and the fall depends on the \
         direction. The analysis of a run compensates this: it turns each shift into a stiffness with \
         its uncertainty, by the sensor that the rig file describes \
         ([decision 7](../decisions/0007-the-rig-file-describes-the-sensor.md)). This page shows \
         how well that stiffness agrees with the truth of a simulated bench, whose sensor is that of \
         the analysis, and the limits.",
    );
    page.heading("Trials");
    page.text(
        "Each trial draws one of the paper's five samples (0.045, 0.104, 0.235, 0.320, 0.649 MPa) and \
         a contact angle evenly from [0°, 45°]. The standard deviations of the nuisances are 0.3 Hz \
         for each shift, 20 µm for the surface found, 2 µm for each depth below it, 1° of slope, and \
         3 % of stiffness from point to point. The truth is the reference model, of sixteen elements \
         with losses. The inference uses tier E1s, as reports do.",
    );
    page.text(
        "A sample is recognised by its stiffness among the five nominal ones; a refused trial counts \
         as not recognised. The error is relative to the stiffness of the touched point; for three \
         directions, which touch three points, it is relative to the stiffness of the sample.",
    );
    page.table(protocols(all));
    let known = trials_of(all, TouchProtocol::KnownAngle);
    page.text("One touch at a known angle, by sample:");
    page.table(samples(known));
    for (file, chart) in charts(all) {
        page.chart(file, chart);
    }
    page.data("samples.csv", super::samples_table(all));
    page.data("angles.csv", super::angles_table(all));
    page.heading("Limits");
    limits(&mut page, all);
    page
}

fn trials_of(all: &[ProtocolTrials], protocol: TouchProtocol) -> &ProtocolTrials {
    all.iter().find(|one| one.protocol == protocol).expect("every protocol has trials")
}

fn with_interval(share: Option<Share>) -> String {
    share.map_or_else(String::new, |Share { value, low, high }| {
        let [value, low, high] = [value, low, high].map(|part| percent(Some(part), 2));
        format!("{value} ({low} to {high})")
    })
}

fn protocols(all: &[ProtocolTrials]) -> Table {
    let mut table = Table::new(&[
        "protocol",
        "recognised, % (95 % interval)",
        "refused",
        "error, % rms",
        "coverage of the 95 % intervals, %",
    ]);
    for ProtocolTrials { protocol, trials } in all {
        let summary = TrialSummary::of(trials);
        let has_stiffness = *protocol != TouchProtocol::ShiftAlone;
        table.row([
            protocol.name().to_owned(),
            with_interval(summary.recognition()),
            if has_stiffness { summary.refused().to_string() } else { String::new() },
            percent(summary.rms(), 2),
            percent(summary.coverage().map(|share| share.value), 2),
        ]);
    }
    table
}

fn samples(known: &ProtocolTrials) -> Table {
    let mut table = Table::new(&["sample", "MPa", "error, % rms", "within 3 %, %", "coverage, %"]);
    for (sample, summary) in by_sample(&known.trials) {
        table.row([
            (sample + 1).to_string(),
            SAMPLES_MPA[sample].to_string(),
            percent(summary.rms(), 2),
            percent(summary.within_3_percent(), 1),
            percent(summary.coverage().map(|share| share.value), 2),
        ]);
    }
    table
}

fn limits(page: &mut Page, all: &[ProtocolTrials]) {
    let steepest = |protocol| {
        let summary = by_angle(&trials_of(all, protocol).trials).last().map(|(_, summary)| summary);
        let summary = summary.expect("there are groups of angles");
        let coverage = percent(summary.coverage().map(|share| share.value), 0);
        format!("{coverage} % of the trials, with a bias of {} %", percent(summary.bias(), 0))
    };
    let known = by_angle(&trials_of(all, TouchProtocol::KnownAngle).trials)
        .filter_map(|(_, summary)| Some(summary.coverage()?.value));
    let (least, most) =
        known.fold((1.0_f64, 0.0_f64), |(least, most), one| (least.min(one), most.max(one)));
    page.text(
        "Two depths hardly help. Depth and angle enter shallow contacts as one product, and an error \
         of 20 µm of the surface hides the rest. The inference reports this: `is_angle_identified` is \
         false, and the correlation of stiffness and angle is above 0.97 \
         ([inverses.md](inverses.md)).",
    );
    page.text(format!(
        "Coverage holds on average over all angles. The prior of an unknown angle is even, which is \
         not true at the ends of the range: between 40° and 45° the intervals of four spins contain \
         the truth in {}; those of three directions in {}. With a known angle, the coverage of each \
         group of five degrees lies between {} % and {} %.",
        steepest(TouchProtocol::Spins),
        steepest(TouchProtocol::Directions),
        percent(Some(least), 1),
        percent(Some(most), 1)
    ));
    page.text(
        "The intervals of three directions are too wide for stiff samples, because the inference \
         assumes that the scatter of a sample passes into its shift undiminished.",
    );
    page.text(
        "The classes are the nominal stiffnesses; a run calibrates its own classes on the main \
         touches. The trials contain random errors and the error of tier E1s against the reference. \
         They contain no wrong description of the sensor, which the calibration of a run corrects, and \
         no tissue that slips or is not linear.",
    );
    page.heading("In a run");
    page.text(
        "With `angle = \"known\"` in a protocol, the default, the analysis infers a stiffness from each \
         touch at its set angle. With `angle = \"unknown\"` it takes the touches of a sample at one \
         angle from front, back and left as one site, and infers stiffness, angle and azimuth \
         together. The report states the calibration and its uncertainty, the angles that were not \
         identified, and the refused sites.",
    );
}
