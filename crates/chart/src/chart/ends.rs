//! Names at the right ends of series, beside the plot, in place of a legend.

use super::series::Series;
use crate::{
    COLOURS,
    svg::{FONT_PX, Svg, width_of},
};

/// Least distance of two names, px.
const STEP_PX: f64 = 14.0;
/// From the plot to a name, px.
const LEADER_PX: f64 = 12.0;

/// A name and the vertical value of the last point of its series.
struct End<'a> {
    name: &'a str,
    colour: usize,
    value: f64,
}

/// The names at the ends.
pub(super) struct Ends<'a>(Vec<End<'a>>);

impl<'a> Ends<'a> {
    pub(super) fn of(series: &'a [Series]) -> Self {
        let end = |series: &'a Series| {
            let (name, last) = (series.end.as_deref()?, series.points.last()?);
            Some(End { name, colour: series.colour % COLOURS, value: last.y })
        };
        Self(series.iter().filter_map(end).collect())
    }

    /// The room beside the plot, px.
    pub(super) fn width(&self) -> f64 {
        let widest = self.0.iter().map(|end| width_of(end.name, FONT_PX)).fold(0.0, f64::max);
        if self.0.is_empty() { 0.0 } else { LEADER_PX + 4.0 + widest }
    }

    /// Draws each name as near to its value as the others leave room.
    pub(super) fn draw(&self, svg: &mut Svg, right: f64, y_of: impl Fn(f64) -> f64) {
        let mut all: Vec<(f64, &End<'_>)> =
            self.0.iter().map(|end| (y_of(end.value), end)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let wanted: Vec<f64> = all.iter().map(|(y, _)| *y).collect();
        for ((y, end), at) in all.iter().zip(apart(&wanted)) {
            svg.line(&format!("line s{}", end.colour), (right + 1.0, *y), (right + LEADER_PX, at));
            svg.text("key", (right + LEADER_PX + 4.0, at + 4.0), "start", end.name);
        }
    }
}

/// Rising positions with at least a step between two, whose squared distances from the wanted ones are least.
fn apart(wanted: &[f64]) -> Vec<f64> {
    // Less the steps before it, a position may only rise: neighbours that fall share their mean.
    let mut blocks: Vec<(f64, usize)> = Vec::new();
    for (index, y) in wanted.iter().enumerate() {
        let mut block = (y - STEP_PX * index as f64, 1);
        while let Some(&(sum, count)) = blocks.last()
            && sum / count as f64 > block.0 / block.1 as f64
        {
            blocks.pop();
            block = (sum + block.0, count + block.1);
        }
        blocks.push(block);
    }
    let levels =
        blocks.iter().flat_map(|&(sum, count)| std::iter::repeat_n(sum / count as f64, count));
    levels.enumerate().map(|(index, level)| level + STEP_PX * index as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_where_they_are_if_there_is_room_and_share_it_otherwise() {
        assert_eq!(apart(&[10.0, 50.0]), [10.0, 50.0]);
        assert_eq!(apart(&[10.0, 12.0, 100.0]), [4.0, 18.0, 100.0]);
        assert_eq!(apart(&[0.0, 0.0, 0.0]), [-14.0, 0.0, 14.0]);
        assert_eq!(apart(&[]), []);
    }
}
