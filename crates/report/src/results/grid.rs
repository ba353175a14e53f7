//! The planned grid of the main phase.

use rig_record::Phase;

use super::status::Tally;
use crate::data::{DIRECTIONS, RunData};

/// The planned touches of the main phase at one angle of one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GridRow {
    pub(crate) sample: usize,
    pub(crate) angle_deg: f64,
    /// Counts by direction.
    pub(crate) directions: [Tally; DIRECTIONS.len()],
}

impl GridRow {
    /// Counts over the directions. A direction counts once, with any number of repeats.
    pub(crate) fn over_directions(&self) -> Tally {
        let mut all = Tally::default();
        for tally in self.directions.iter().filter(|tally| tally.planned > 0) {
            all.add(tally.status());
        }
        all
    }
}

/// The grid of the planned main touches, ordered by sample and angle.
pub(crate) fn grid(data: &RunData) -> Vec<GridRow> {
    let mut grid: Vec<GridRow> = Vec::new();
    for planned in data.planned.iter().filter(|planned| planned.settings.phase == Phase::Main) {
        let (pose, Some(sample)) = (planned.settings.pose, data.sample(&planned.settings.sample))
        else {
            continue;
        };
        let key = (sample, pose.angle_deg);
        let known = grid.iter().position(|row| (row.sample, row.angle_deg) == key);
        let index = known.unwrap_or(grid.len());
        if known.is_none() {
            let directions = [Tally::default(); DIRECTIONS.len()];
            grid.push(GridRow { sample, angle_deg: pose.angle_deg, directions });
        }
        let direction = DIRECTIONS.iter().position(|direction| *direction == pose.direction);
        if let Some(direction) = direction {
            grid[index].directions[direction].add(planned.status());
        }
    }
    grid.sort_by(|a, b| a.sample.cmp(&b.sample).then(a.angle_deg.total_cmp(&b.angle_deg)));
    grid
}
