//! The page of the study.

use rig_chart::{Axis, Chart, Marker, Point, Rule, Series, Stroke};

use super::{
    Args, Group,
    setting::{SHIPPED, Scene, TOGETHER},
    summary::Summary,
};
use crate::{
    bench_run::PHASES,
    files::Csv,
    page::{Page, Part, Table},
};

/// The file of the table in the folder of the page.
pub(super) const TABLE: &str = "touch.csv";
const TROUBLES_TABLE: &str = "troubles.csv";

/// Phases without which there is no touch: the time that only faster axes save.
const MOTION: [&str; 5] = ["rotation", "prompt", "indentation", "dwell", "retract"];

/// Time of an indent in the fastest maps of indentation, s: 200,000 in some hours.
///
/// # Source
/// Rossi, Tromas, Liu, Zou and Wheeler, MRS Bulletin (2025), doi:10.1557/s43577-025-00919-6, abstract.
const MAPPING_S: f64 = 1.0;

/// A touch that turns, travels, presses and waits as the shipped one does, and whose measurements take what they must, s.
const STRETCH_S: f64 = 3.9;

/// Knobs on one chart, each a line through the settings as shipped.
const CHARTS: [(&str, &str, &[&str]); 4] = [
    ("aims.svg", "Aims", &["aim, %", "aim, s a touch"]),
    (
        "search.svg",
        "The search",
        &["fine step, mm", "coarse step, mm", "cycles of a step", "threshold", "tolerance, mm"],
    ),
    (
        "sweeps.svg",
        "Sweeps and references",
        &["contact sweep, Hz", "no-load sweep, Hz", "reference", "survey, s", "two depths"],
    ),
    (
        "motion.svg",
        "Motion and waits",
        &["dwell, s", "check of slip", "order", "travel, mm/s", "in contact, mm/s"],
    ),
];

pub(super) fn page(args: &Args, groups: &[Group], troubles: &[Group]) -> Page {
    let title = "Time of a touch against its error".to_owned();
    let mut page = Page { title, parts: Vec::new() };
    page.text(format!(
        "This page is written by `cargo run --release -p rig-study -- touch --out docs/studies`. Each setting has \
         {} runs of `config/protocols/three-direction.toml` on the simulated bench, with the seeds {} to {} for \
         scene and protocol, so that a setting is compared with the shipped one on the same samples. The time is \
         that of the rig for each planned touch of the runs that came to their end, everything included: prompts, survey, \
         references, and the check of slip. The simulated person answers at once. Where the setting is not an aim, the protocol states the \
         settings that its aim chooses as shipped.",
        args.runs,
        args.seed,
        args.seed + args.runs - 1
    ));
    page.text(
        "The error is the logarithm of the stiffness that the run states over that of the touched point, which only \
         the simulator knows; root mean square of main and blind touches. It has all that a run has: sweep, \
         reference, surface, lead screw, slope of the surface, model, and the factor from the known samples, whose \
         points scatter by 3 %. It is compared with that of the settings as shipped over all touches; the standard error is \
         that of the ratios without one seed each. *Paper* is the shipped scene, whose sensor and contact are not those that the rig \
         file describes; *matched* is the scene that it describes.",
    );
    let of_scene = |scene| groups.iter().filter(move |group| group.scene == scene);
    let paper: Vec<&Group> = of_scene(Scene::Paper).collect();
    let matched: Vec<&Group> = of_scene(Scene::Matched).collect();
    let Some(base) = paper.iter().find(|group| group.setting.knob == SHIPPED) else { return page };
    page.heading("All settings");
    page.text(format!(
        "The line *motion* is the time in which only the axes move. *Indentation mapping* is an anchor: maps of more than \
         200,000 indents in some hours (E. Rossi, C. Tromas, Z. Liu, Y. Zou and J. M. Wheeler, MRS Bulletin, 2025, \
         [doi:10.1557/s43577-025-00919-6](https://doi.org/10.1557/s43577-025-00919-6)) take less than {MAPPING_S:.0} s for each; \
         they turn nothing, and travel some micrometres. *Stretch* is a touch of {STRETCH_S} s; the settings *together* \
         show what it costs. No published time of a point of a coordinate measuring machine was found that could be cited.",
    ));
    page.chart("front.svg", front_chart(&paper, &matched, base));
    for (file, title, knobs) in CHARTS {
        page.chart(file, knobs_chart(title, knobs, &paper, base));
    }
    page.table(settings(&paper, &matched));
    page.data(TABLE, csv(groups));
    page.heading("Where the time goes");
    page.text(
        "The settings as shipped, for each planned touch. What is under *motion* is left when search, sweeps and \
         references take no time.",
    );
    page.table(phases(&base.summary));
    page.heading("Where the search fails");
    page.text(
        "The shipped protocol on benches with more trouble than the shipped one, with the rig file unchanged. A \
         stiffness is wrong without notice if its error is beyond five of its stated standard deviations. *Coverage* is the \
         share of the stated 95 % intervals that have the stiffness of the point, also where the model of the run does not \
         hold. A run \
         that contradicts itself ends with a latched rig, and the touches after it are not reached.",
    );
    page.table(table_of_troubles(troubles));
    page.data(TROUBLES_TABLE, csv(troubles));
    let all = || groups.iter().chain(troubles);
    page.text("Runs that ended before their last touch, with the reason of the first one of each setting:");
    page.table(endings(all()));
    page.text(never(groups, troubles));
    page
}

/// What may never be, and how often it was.
fn never(groups: &[Group], troubles: &[Group]) -> String {
    let all = || groups.iter().chain(troubles);
    let sum = |count: fn(&Summary) -> usize| all().map(|one| count(&one.summary)).sum::<usize>();
    let (planned, measured) = (sum(Summary::planned), sum(Summary::measured));
    let reached = planned - sum(Summary::not_reached);
    format!(
        "Of the {reached} touches of this page that were reached ({planned} were planned), the sample was turned with the \
         probe in it, or pressed deeper than it bears: {}. Of the {measured} stiffnesses that were measured, wrong without \
         notice: {}. The way down to the first search of a run is \
         made in steps with a reading after each, so that a surface far above the place where the rig file has it ends \
         the run.",
        named(all(), Summary::violations),
        named(all(), Summary::wrong)
    )
}

/// The groups in which something was found, with their counts.
fn named<'a>(groups: impl Iterator<Item = &'a Group>, count: fn(&Summary) -> usize) -> String {
    let found = groups.filter(|group| count(&group.summary) > 0).map(|group| {
        let Group { setting, scene, summary } = group;
        format!("{} in \"{}: {}\" ({})", count(summary), setting.knob, setting.value, scene.name())
    });
    let found: Vec<String> = found.collect();
    if found.is_empty() { "none".to_owned() } else { found.join(", ") }
}

/// Time and error of a group, percent.
fn point(group: &Group) -> Option<Point> {
    let (x, y) = (group.summary.touch_s()?, 100.0 * group.summary.rms()?);
    let setting = group.setting;
    Some(Point { x, y, error: None, note: Some(format!("{} {}", setting.knob, setting.value)) })
}

/// The settings that no other beats in time and in error, in the order of their times. A run that ended early has no time
/// and, with fewer touches, another error.
fn front(groups: &[&Group]) -> Vec<Point> {
    let completed = groups.iter().filter(|group| group.summary.ended().is_none());
    let mut points: Vec<Point> = completed.filter_map(|group| point(group)).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    let mut least = f64::INFINITY;
    points.retain(|point| {
        let is_better = point.y < least;
        least = least.min(point.y);
        is_better
    });
    points
}

fn axes() -> [Axis; 2] {
    [Axis::linear("rig time of a touch, s"), Axis::linear("error of the stiffness, % rms")]
}

fn front_chart(paper: &[&Group], matched: &[&Group], base: &Group) -> Chart {
    let [x, y] = axes();
    let mut chart = Chart::new(
        "Time of a touch against its error",
        "Each point is a setting, circles on the shipped scene, squares on the scene that the rig file describes; the \
         lines join the settings that no other beats.",
        x.including(0.0),
        y.including(0.0),
    );
    for (colour, (name, groups)) in [("paper", paper), ("matched", matched)].into_iter().enumerate()
    {
        let points = groups.iter().filter_map(|group| point(group));
        chart.series.push(Series::scatter(name, colour, points.collect::<Vec<_>>()));
        let front = Series::line(&format!("{name}: front"), colour, front(groups));
        chart.series.push(Series { stroke: Some(Stroke::Dashed), ..front });
    }
    let shipped = Series::scatter(SHIPPED, 3, point(base));
    chart.series.push(Series { marker: Some(Marker::Ring), ..shipped });
    chart.rules.push(Rule::AtX { value: motion_s(&base.summary), label: "motion".to_owned() });
    chart.rules.push(Rule::AtX { value: MAPPING_S, label: "indentation mapping".to_owned() });
    chart.rules.push(Rule::AtX { value: STRETCH_S, label: "stretch".to_owned() });
    chart
}

fn knobs_chart(title: &str, knobs: &[&str], groups: &[&Group], base: &Group) -> Chart {
    let [x, y] = axes();
    let description = "Each line is a setting at its values, through the settings as shipped.";
    let mut chart = Chart::new(title, description, x, y);
    for (colour, knob) in knobs.iter().enumerate() {
        let of_knob = groups.iter().filter(|group| group.setting.knob == *knob);
        let mut points: Vec<Point> = of_knob.filter_map(|group| point(group)).collect();
        points.extend(point(base));
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        chart.series.push(Series::joined(knob, colour, points));
    }
    chart
}

fn percent(part: Option<f64>, decimals: usize) -> String {
    part.map_or(String::new(), |part| format!("{:.decimals$}", 100.0 * part))
}

/// The time of a touch, with the number of runs that it is from if some ended early.
fn seconds(summary: &Summary) -> String {
    let (timed, all) = summary.timed();
    let of = if timed < all { format!(" ({timed} of {all} runs)") } else { String::new() };
    summary.touch_s().map_or(String::new(), |time_s| format!("{time_s:.2}{of}"))
}

fn over(group: &Group, base: Option<&&Group>) -> String {
    let ratio = base.and_then(|base| group.summary.over(&base.summary));
    ratio.map_or(String::new(), |ratio| format!("{:.3} ± {:.3}", ratio.ratio, ratio.two_sigmas))
}

/// A page with the table of the settings alone.
pub(super) fn rows(groups: &[Group]) -> Page {
    let of_scene = |scene| groups.iter().filter(move |group| group.scene == scene);
    let paper: Vec<&Group> = of_scene(Scene::Paper).collect();
    let matched: Vec<&Group> = of_scene(Scene::Matched).collect();
    let parts = vec![Part::Table(settings(&paper, &matched)), Part::Table(endings(groups.iter()))];
    Page { title: "Settings".to_owned(), parts }
}

fn settings(paper: &[&Group], matched: &[&Group]) -> Table {
    let mut table = Table::new(&[
        "setting",
        "time of a touch, s, paper",
        "error, %",
        "over that as shipped, ± two standard errors",
        "measured of planned",
        "time, s, matched",
        "error, %",
        "over that as shipped",
    ]);
    for (own, twin) in paper.iter().zip(matched) {
        let (setting, summary) = (own.setting, &own.summary);
        let name = match setting.knob {
            SHIPPED | TOGETHER => format!("{} {}", setting.knob, setting.value),
            knob => format!("{knob}: {}", setting.value),
        };
        table.row([
            name.trim().to_owned(),
            seconds(summary),
            percent(summary.rms(), 2),
            over(own, paper.first()),
            format!("{} of {}", summary.measured(), summary.planned()),
            seconds(&twin.summary),
            percent(twin.summary.rms(), 2),
            over(twin, matched.first()),
        ]);
    }
    table
}

/// The time of a touch in which only the axes move, s.
fn motion_s(summary: &Summary) -> f64 {
    let phases_s = summary.phases_s();
    MOTION.iter().filter_map(|phase| phases_s.get(phase)).sum()
}

fn phases(summary: &Summary) -> Table {
    let mut table = Table::new(&["phase", "time, s", "kind"]);
    let phases_s = summary.phases_s();
    for phase in PHASES {
        let kind = if MOTION.contains(&phase) { "motion" } else { "measurement" };
        let time_s = phases_s.get(phase).copied().unwrap_or_default();
        table.row([phase.to_owned(), format!("{time_s:.3}"), kind.to_owned()]);
    }
    let all: f64 = phases_s.values().sum();
    table.row(["all".to_owned(), format!("{all:.3}"), String::new()]);
    table.row(["motion".to_owned(), format!("{:.3}", motion_s(summary)), String::new()]);
    table
}

fn table_of_troubles(troubles: &[Group]) -> Table {
    let mut table = Table::new(&[
        "bench",
        "measured, % of planned",
        "refused, %",
        "not reached, %",
        "time of a touch, s",
        "error, % rms",
        "largest error, %",
        "coverage, %",
        "wrong without notice",
    ]);
    for Group { setting, summary, .. } in troubles {
        let share = |count: usize| percent(Some(count as f64 / summary.planned().max(1) as f64), 1);
        table.row([
            format!("{}: {}", setting.knob, setting.value),
            share(summary.measured()),
            share(summary.refused()),
            share(summary.not_reached()),
            seconds(summary),
            percent(summary.rms(), 2),
            percent(summary.largest(), 1),
            percent(summary.coverage(), 1),
            summary.wrong().to_string(),
        ]);
    }
    table
}

/// The settings with a run that ended before its last touch.
fn endings<'a>(groups: impl Iterator<Item = &'a Group>) -> Table {
    let mut table = Table::new(&["setting", "scene", "runs", "reason of the first"]);
    for Group { setting, scene, summary } in groups {
        if let Some((runs, why)) = summary.ended() {
            let name = format!("{}: {}", setting.knob, setting.value);
            table.row([name, scene.name().to_owned(), runs.to_string(), why.to_owned()]);
        }
    }
    table
}

/// All groups as a table.
pub(super) fn csv(groups: &[Group]) -> String {
    let mut csv = Csv::new(&[
        "scene",
        "knob",
        "value",
        "planned",
        "refused",
        "not_reached",
        "wrong",
        "violations",
        "touch_s",
        "error_rms",
        "error_largest",
        "coverage",
    ]);
    let cell = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.6}"));
    // A cell holds no comma.
    let text = |text: &str| text.replace(", ", " + ");
    for Group { setting, scene, summary } in groups {
        csv.row([
            scene.name().to_owned(),
            text(setting.knob),
            text(setting.value),
            summary.planned().to_string(),
            summary.refused().to_string(),
            summary.not_reached().to_string(),
            summary.wrong().to_string(),
            summary.violations().to_string(),
            cell(summary.touch_s()),
            cell(summary.rms()),
            cell(summary.largest()),
            cell(summary.coverage()),
        ]);
    }
    csv.text().to_owned()
}
