//! The charts of time against error.

use rig_chart::{Axis, Chart, Series, Stroke};

use super::{
    cell::Cell,
    reader::Reader,
    trial::Group,
    way::{LIMIT_S, Way},
};
use crate::{analyzer::WINDOW, bound::integration_floor};

/// The least part of the sweeps that must be answered for the error to be shown.
const ANSWERS_MIN: f64 = 0.5;

/// Time of measuring against error in one cell.
pub(super) fn time_against_error(cell: &Cell, groups: &[Group]) -> Chart {
    let mut chart = Chart::new(
        &format!("Time of measuring against error: {cell}"),
        "Root mean square error of the resonance, bias included, against the time that its sweep \
         takes; dashed in the same colour the Cramér–Rao bound of the same sweeps, and below all \
         the bound of integrating at the best frequencies without ever waiting.",
        Axis::log("time of measuring (s)"),
        Axis::log("error (Hz rms)"),
    );
    chart.size_px = (720, 460);
    let of_cell = || groups.iter().filter(|group| group.cell == *cell);
    let is_of = |group: &Group, name: &str, reader: Reader| {
        group.way.name() == name && group.reader == reader
    };
    for (colour, name) in WAYS.into_iter().enumerate() {
        let of_way = || of_cell().filter(|group| is_of(group, name, Reader::Production));
        let found = of_way().filter_map(|group| point(group, Group::rmse_hz));
        push(&mut chart, Series::joined(name, colour, found));
        let bounds = of_way().filter_map(|group| point(group, Group::bound_hz));
        let bounds = Series { name: None, ..Series::line(name, colour, bounds) };
        push(&mut chart, Series { stroke: Some(Stroke::Dashed), ..bounds });
    }
    for (index, reader) in Reader::SHOWN.into_iter().enumerate() {
        let even = of_cell().filter(|group| is_of(group, WAYS[0], reader));
        let found = even.filter_map(|group| point(group, Group::rmse_hz));
        let name = format!("uniform, {}", reader.name());
        push(&mut chart, Series::scatter(&name, WAYS.len() + index, found));
    }
    let floor = Series::line("integration alone", 6, floor(cell));
    push(&mut chart, Series { stroke: Some(Stroke::Dashed), ..floor });
    chart
}

/// The kinds of ways, in the order of their colours.
const WAYS: [&str; 4] = [
    Way::Even { points: 0 }.name(),
    Way::Fast { points: 0, cycles: 0 }.name(),
    Way::Settled { target_hz: 0.0 }.name(),
    Way::Transient { target_hz: 0.0 }.name(),
];

/// A chart says nothing of series without points.
fn push(chart: &mut Chart, series: Series) {
    if !series.points.is_empty() {
        chart.series.push(series);
    }
}

fn point(group: &Group, error_hz: impl Fn(&Group) -> Option<f64>) -> Option<(f64, f64)> {
    let answered = group.answers() as f64 / group.trials.len() as f64;
    (answered >= ANSWERS_MIN).then_some(())?;
    Some((group.time_s(0.5), error_hz(group)?))
}

/// The bound of integration alone, over the times that planners take.
fn floor(cell: &Cell) -> Vec<(f64, f64)> {
    [0.05, LIMIT_S].map(|time_s| (time_s, floor_hz(cell, time_s))).to_vec()
}

/// The bound of integrating for so long at the best frequencies, without ever waiting, Hz.
pub(super) fn floor_hz(cell: &Cell, time_s: f64) -> f64 {
    let frequencies: Vec<f64> = (0..=280).map(|i| WINDOW.min_hz + 0.2 * f64::from(i)).collect();
    cell.noise * integration_floor(&cell.middle(), &frequencies) / time_s.sqrt()
}
