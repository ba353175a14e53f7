//! Figures 11, 12 and 13: the paper's experiment, by the daemon on the simulated bench.

use std::path::Path;

use rig_analysis::{
    classify::{Classifier, Decision},
    cluster::optimal,
    score::wilson_95,
    stiffness::{Compensation, PosedTouch},
};
use rig_chart::{Axis, Chart, Marker, Point, Rule, Series, Stroke};
use rig_contact::{ContactLaw, Depth, Direction, Models, Pose, Sensor, SensorDescription, Tier};
use rig_report::{RecognitionSummary, TouchRow};
use rig_store::{Ending, RunStatus};
use rigd::{loaded_rig::LoadedRig, protocol_file::LoadedProtocol};

use super::{
    Args,
    figures::{self, direction_keys, direction_style, noiseless, sample_at_end},
};
use crate::{
    bench_run::{BenchError, BenchRun},
    outcome::StudyError,
    page::{Page, Table},
    paper_bench::{ANGLES_DEG, Control, SAMPLES_MPA},
};

/// The results of a run that the page uses.
#[derive(Debug)]
struct PaperRun {
    rig_seconds: f64,
    no_load_hz: Option<f64>,
    sensitivity_hz_per_mpa: Option<f64>,
    recognition: Vec<RecognitionSummary>,
    touches: Vec<BenchTouch>,
}

/// A measured touch.
#[derive(Debug, Clone, PartialEq)]
struct BenchTouch {
    is_blind: bool,
    /// Index of the true sample, also for a blind touch.
    sample: usize,
    direction: Direction,
    angle_deg: f64,
    shift_hz: f64,
    shift_sigma_hz: f64,
    indentation_mm: f64,
}

impl PaperRun {
    /// Runs a protocol on a simulated rig.
    fn of(rig: &Path, protocol: &Path) -> Result<Self, BenchError> {
        let rig = LoadedRig::load(rig)?;
        let protocol = LoadedProtocol::load(protocol, &rig.facts())?;
        let results = BenchRun::of(rig, protocol)?.results;
        let (status, summary) = (results.run().status, results.summary());
        if status != RunStatus::Ended(Ending::Completed) {
            return Err(BenchError::NotCompleted { status: status.describe() });
        }
        let touch = |row: &TouchRow| {
            BenchTouch::of(row).ok_or_else(|| BenchError::NotATouch { step: row.step.clone() })
        };
        Ok(Self {
            rig_seconds: summary.rig_seconds,
            no_load_hz: summary.no_load_hz,
            sensitivity_hz_per_mpa: summary.sensitivity_hz_per_mpa,
            recognition: summary.recognition,
            touches: results.touches().iter().map(touch).collect::<Result<_, _>>()?,
        })
    }
}

impl BenchTouch {
    fn of(row: &TouchRow) -> Option<Self> {
        Some(Self {
            is_blind: row.phase == "blind",
            // The protocol numbers its samples from one, softest first.
            sample: row.sample.parse::<usize>().ok()?.checked_sub(1)?,
            direction: Direction::ALL.into_iter().find(|one| one.name() == row.direction)?,
            angle_deg: row.angle_deg,
            shift_hz: row.shift_hz?,
            shift_sigma_hz: row.shift_sigma_hz?,
            indentation_mm: row.indentation_mm?,
        })
    }
}

pub(super) fn add(page: &mut Page, args: &Args) -> Result<(), StudyError> {
    page.heading("Figures 11 to 13: the experiment on the simulated bench");
    if !args.bench {
        page.text(
            "Not run: with `--bench`, the rig of the daemon replays the paper's protocol on the \
             simulated bench.",
        );
        return Ok(());
    }
    let run = PaperRun::of(&args.rig, &args.protocol).map_err(StudyError::bench)?;
    page.text(format!(
        "The daemon replayed `{}` through its drivers against simulated instruments: {} touches in \
         {:.0} s on the rig's clock. As in a laboratory, it finds the surface before each touch \
         and fits the resonance to noisy impedances. The shifts:",
        args.protocol.display(),
        run.touches.len(),
        run.rig_seconds
    ));
    page.chart("figure-11.svg", figure_11(&run));
    page.chart("figure-12.svg", figure_12(&run));
    page.table(shifts(&run));
    page.text(
        "The paper's figures have no numbers; the paper calls them consistent with its simulation. \
         The bench adds noise, scatter of the samples and an uncertain surface to the model of \
         Figure 7, and its sensor, contact and depth differ from that model \
         ([decision 67](../decisions/0067-the-shipped-bench-is-not-its-description.md)). The means of the three directions beside those of Figure 7:",
    );
    page.table(against_model(&run));
    summary(page, &run);
    blind(page, &run);
    Ok(())
}

/// The mean shift of the main touches of a sample in a direction at an angle.
fn mean_hz(run: &PaperRun, sample: usize, direction: Option<Direction>, angle: f64) -> Option<f64> {
    let of_cell: Vec<f64> = run
        .touches
        .iter()
        .filter(|touch| !touch.is_blind && touch.sample == sample && touch.angle_deg == angle)
        .filter(|touch| direction.is_none_or(|direction| touch.direction == direction))
        .map(|touch| touch.shift_hz)
        .collect();
    (!of_cell.is_empty()).then(|| of_cell.iter().sum::<f64>() / of_cell.len() as f64)
}

fn angle_axis() -> Axis {
    Axis::linear("contact angle, °").with_ticks(&ANGLES_DEG)
}

fn figure_11(run: &PaperRun) -> Chart {
    let mut chart = Chart::new(
        "Figure 11: shift over the angle in three directions, simulated bench",
        "Shifts of five samples; solid lines and circles to the front, dashed lines and squares to \
         the back, dotted lines and triangles to the left.",
        angle_axis(),
        Axis::linear("shift, Hz").including(0.0),
    );
    chart.size_px = (720, 520);
    chart.series.extend(direction_keys());
    for sample in 0..SAMPLES_MPA.len() {
        for direction in Direction::ALL {
            let (marker, stroke) = direction_style(direction);
            let points: Vec<Point> = ANGLES_DEG
                .into_iter()
                .filter_map(|angle| {
                    Some(Point::from((angle, mean_hz(run, sample, Some(direction), angle)?)))
                })
                .collect();
            let joined = Series::joined("", sample, points);
            let (end, stroke) = (sample_at_end(sample, direction), Some(stroke));
            chart.series.push(Series { name: None, end, marker: Some(marker), stroke, ..joined });
        }
    }
    chart
}

fn figure_12(run: &PaperRun) -> Chart {
    let mut chart = Chart::new(
        "Figure 12: shift over the angle, mean of the directions, simulated bench",
        "Shifts of five samples, averaged over front, back and left.",
        angle_axis(),
        Axis::linear("shift, Hz").including(0.0),
    );
    for sample in 0..SAMPLES_MPA.len() {
        let points: Vec<(f64, f64)> = ANGLES_DEG
            .into_iter()
            .filter_map(|angle| Some((angle, mean_hz(run, sample, None, angle)?)))
            .collect();
        let joined = Series::joined(&format!("sample {}", sample + 1), sample, points);
        chart.series.push(joined.named_at_end());
    }
    chart
}

fn shifts(run: &PaperRun) -> Table {
    let mut table = Table::new(&["sample", "direction", "0°, Hz", "15°", "30°", "45°"]);
    for sample in 0..SAMPLES_MPA.len() {
        for direction in Direction::ALL.map(Some).into_iter().chain([None]) {
            let name = direction.map_or("mean", Direction::name).to_owned();
            let cells = ANGLES_DEG.map(|angle| {
                mean_hz(run, sample, direction, angle)
                    .map_or(String::new(), |hz| format!("{hz:.2}"))
            });
            table.row([(sample + 1).to_string(), name].into_iter().chain(cells));
        }
    }
    table
}

/// Figure 12 beside Figure 7.
fn against_model(run: &PaperRun) -> Table {
    let mut table = Table::new(&[
        "sample",
        "0°, bench, Hz",
        "0°, model",
        "difference, %",
        "45°, bench, Hz",
        "45°, model",
        "difference, %",
        "fall, bench, %",
        "fall, model",
    ]);
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let simulation = noiseless(&models, Tier::Reference, Control::Indentation);
    for (sample, &young) in SAMPLES_MPA.iter().enumerate() {
        let pair = |angle| {
            let found = mean_hz(run, sample, None, angle)?;
            Some((found, figures::mean_hz(&simulation, young, angle)))
        };
        let (Some(upright), Some(leaning)) = (pair(0.0), pair(45.0)) else { continue };
        let cells = |(found, model): (f64, f64)| {
            let difference = format!("{:+.1}", 100.0 * (found / model - 1.0));
            [format!("{found:.2}"), format!("{model:.2}"), difference]
        };
        let fall = |upright: f64, leaning: f64| format!("{:.1}", 100.0 * (1.0 - leaning / upright));
        let falls = [fall(upright.0, leaning.0), fall(upright.1, leaning.1)];
        let head = [(sample + 1).to_string()];
        table.row(head.into_iter().chain(cells(upright)).chain(cells(leaning)).chain(falls));
    }
    table
}

fn summary(page: &mut Page, run: &PaperRun) {
    let mut table = Table::new(&["quantity", "printed", "ours", "difference"]);
    let mut row = |what: &str, printed: f64, ours: Option<f64>| {
        let Some(ours) = ours else { return };
        let difference = format!("{:+.2}", ours - printed);
        table.row([what.to_owned(), printed.to_string(), format!("{ours:.2}"), difference]);
    };
    row("no-load resonance, Hz (experiment)", 137.6, run.no_load_hz);
    row("no-load resonance, Hz (simulation)", 140.4, run.no_load_hz);
    row("sensitivity, Hz/MPa (simulation)", 134.11, run.sensitivity_hz_per_mpa);
    page.table(table);
    page.text(
        "The 137.6 Hz of the experiment are 2 % below the 140.4 Hz of the simulation. A free \
         length that is 0.4 mm longer at the clamp would explain it. The no-load resonance must \
         therefore be measured in every session, as each run does here.",
    );
}

/// Figure 13, by the paper's method and by the methods of this project.
fn blind(page: &mut Page, run: &PaperRun) {
    let blind: Vec<&BenchTouch> = run.touches.iter().filter(|touch| touch.is_blind).collect();
    let known: Vec<&BenchTouch> = run.touches.iter().filter(|touch| !touch.is_blind).collect();
    if blind.is_empty() {
        return;
    }
    page.chart("figure-13.svg", figure_13(&blind));
    let by_method = |method: &str| {
        let found = run.recognition.iter().find(|found| found.method == method);
        found.map(|found| found.correct)
    };
    let mut table = Table::new(&["method", "printed", "ours, right", "of", "%", "95 % interval"]);
    let trials = u32::try_from(blind.len()).unwrap_or(u32::MAX);
    for (method, printed, right) in [
        ("k-means on shifts (the paper's)", "46 of 50", by_method("k-means")),
        ("k-means on logarithms of shifts", "", by_method("k-means-log")),
        ("centres calibrated on the main phase, shifts", "", by_calibrated_shift(&known, &blind)),
        (
            "centres calibrated on the main phase, compensated stiffness",
            "",
            by_method("calibrated-stiffness"),
        ),
    ] {
        let Some(right) = right else { continue };
        let (low, high) = wilson_95(right, trials);
        table.row([
            method.to_owned(),
            printed.to_owned(),
            right.to_string(),
            trials.to_string(),
            format!("{:.0}", 100.0 * f64::from(right) / f64::from(trials)),
            format!("{:.0} to {:.0}", 100.0 * low, 100.0 * high),
        ]);
    }
    page.table(table);
    page.text(
        "The stiffness of each sample from its touches, with the angle compensated by the model of \
         the rig file and without known samples. The differences show how far this model is from the \
         bench: a run learns its model from the main touches instead. Errors that all touches of one \
         mounting share, of the surface found and of the screw, do not show in their scatter; they are \
         one to two percent.",
    );
    page.table(stiffnesses(&known));
}

/// The number of blind touches that centres calibrated on the shifts of the main touches recognise.
fn by_calibrated_shift(known: &[&BenchTouch], blind: &[&BenchTouch]) -> Option<u32> {
    let (shifts, samples): (Vec<f64>, Vec<usize>) =
        known.iter().map(|touch| (touch.shift_hz, touch.sample)).unzip();
    let classifier = Classifier::calibrated(&shifts, &samples, SAMPLES_MPA.len()).ok()?;
    let is_right = |touch: &&&BenchTouch| {
        let decision = classifier.classify(touch.shift_hz, 0.0);
        matches!(decision, Some(Decision::Class { class, .. }) if class == touch.sample)
    };
    u32::try_from(blind.iter().filter(is_right).count()).ok()
}

fn figure_13(blind: &[&BenchTouch]) -> Chart {
    let mut chart = Chart::new(
        "Figure 13: shifts of the blind touches, simulated bench",
        "Shift of each blind touch in its order, coloured by the sample that was touched. A ring \
         marks a touch that k-means on shifts, the paper's method, puts into the class of another \
         sample; dashed lines are the borders between its classes.",
        Axis::linear("blind touch, in its order").with_range(0.0, blind.len() as f64 + 1.0),
        Axis::linear("shift, Hz").including(0.0),
    );
    for sample in 0..SAMPLES_MPA.len() {
        let points = (1_u16..)
            .zip(blind)
            .filter(|(_, touch)| touch.sample == sample)
            .map(|(number, touch)| (f64::from(number), touch.shift_hz));
        let name = format!("sample {}", sample + 1);
        chart.series.push(Series::scatter(&name, sample, points.collect::<Vec<_>>()));
    }
    let shifts: Vec<f64> = blind.iter().map(|touch| touch.shift_hz).collect();
    // The clusters are in the order of their centres, and the samples in that of their stiffness.
    if let Ok(found) = optimal(&shifts, SAMPLES_MPA.len()) {
        chart.series.push(Series::key("border of two classes", None, Some(Stroke::Dashed)));
        let borders = found.centres.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
        let rule = |value| Rule::AtY { value, label: String::new() };
        chart.rules.extend(borders.map(rule));
        let missed: Vec<(f64, f64)> = (1_u16..)
            .zip(blind.iter().zip(&found.clusters))
            .filter(|(_, (touch, cluster))| touch.sample != **cluster)
            .map(|(number, (touch, _))| (f64::from(number), touch.shift_hz))
            .collect();
        if !missed.is_empty() {
            let missed = Series::scatter("misclassified by k-means", 6, missed);
            chart.series.push(Series { marker: Some(Marker::Ring), ..missed });
        }
    }
    chart
}

fn posed(touch: &BenchTouch) -> PosedTouch {
    let pose = Pose::leaning(touch.direction, touch.angle_deg.to_radians())
        .expect("the daemon's angles are below a right angle");
    PosedTouch {
        sample: touch.sample,
        pose,
        depth: Depth::Indentation { along_probe_mm: touch.indentation_mm },
        shift_hz: touch.shift_hz,
        sigma_hz: touch.shift_sigma_hz,
        reference_sigma_hz: 0.0,
        halfway: None,
        stage_sigma_mm: None,
    }
}

fn stiffnesses(known: &[&BenchTouch]) -> Table {
    let compensation = Compensation::new(&SensorDescription::reference(), 0.0);
    let touches: Vec<PosedTouch> = known.iter().map(|touch| posed(touch)).collect();
    let mut table = Table::new(&[
        "sample",
        "set, MPa",
        "found, MPa",
        "difference, %",
        "scatter of a touch, %",
        "touches",
        "scatter of their mean, %",
    ]);
    for found in compensation.by_sample(&touches) {
        let set = SAMPLES_MPA[found.sample];
        let scatter = found.spread_mpa.map(|spread| 100.0 * spread / found.young_mpa);
        let percent = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.1}"));
        table.row([
            (found.sample + 1).to_string(),
            set.to_string(),
            format!("{:.4}", found.young_mpa),
            format!("{:+.1}", 100.0 * (found.young_mpa / set - 1.0)),
            percent(scatter),
            found.touches.to_string(),
            percent(scatter.map(|of_touch| of_touch / (found.touches as f64).sqrt())),
        ]);
    }
    table
}
