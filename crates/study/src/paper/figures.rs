//! Figures 4, 6, 7 and 8, and the sensitivity.

mod angle;
mod directions;
mod sensitivity;
mod sensors;

use rig_chart::{Marker, Series, Stroke};
use rig_contact::{ContactLaw, Direction, Friction, Models, Sensor, Tier};

use crate::{
    page::Page,
    paper_bench::Control,
    simulate::{Nuisances, TouchSimulation},
};

pub(super) fn add(page: &mut Page) {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    angle::by_equation(page);
    directions::add(page, &noiseless(&models, Tier::Reference, Control::Indentation));
    angle::mean_of_directions(page, &models);
    sensitivity::add(page, &models);
    sensors::add(page);
}

pub(super) fn noiseless(models: &Models, tier: Tier, control: Control) -> TouchSimulation<'_> {
    TouchSimulation {
        models,
        tier,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        control,
        nuisances: Nuisances::NONE,
    }
}

/// The mean of the three directions, Hz.
pub(super) fn mean_hz(simulation: &TouchSimulation<'_>, young_mpa: f64, angle_deg: f64) -> f64 {
    let sum: f64 = Direction::ALL
        .iter()
        .map(|&direction| simulation.exact_hz(young_mpa, direction, angle_deg))
        .sum();
    sum / Direction::ALL.len() as f64
}

/// The largest less the smallest of the three directions at 45°, over their mean.
pub(super) fn spread(simulation: &TouchSimulation<'_>, young_mpa: f64) -> f64 {
    let shifts = Direction::ALL.map(|direction| simulation.exact_hz(young_mpa, direction, 45.0));
    let most = shifts.into_iter().fold(f64::MIN, f64::max);
    let least = shifts.into_iter().fold(f64::MAX, f64::min);
    (most - least) / mean_hz(simulation, young_mpa, 45.0)
}

/// How charts of all samples tell the directions apart.
pub(super) const fn direction_style(direction: Direction) -> (Marker, Stroke) {
    match direction {
        Direction::Front => (Marker::Circle, Stroke::Solid),
        Direction::Back => (Marker::Square, Stroke::Dashed),
        Direction::Left => (Marker::Up, Stroke::Dotted),
    }
}

/// The legend of the directions.
pub(super) fn direction_keys() -> impl Iterator<Item = Series> {
    Direction::ALL.into_iter().map(|direction| {
        let (marker, stroke) = direction_style(direction);
        Series::key(direction.name(), Some(marker), Some(stroke))
    })
}

/// The name of a sample, at the end of one of its directions.
pub(super) fn sample_at_end(sample: usize, direction: Direction) -> Option<String> {
    // To the left the shift is between those to the front and the back.
    (direction == Direction::Left).then(|| format!("sample {}", sample + 1))
}

/// Angles of the curves, degrees.
fn curve() -> impl Iterator<Item = f64> {
    (0..=45).map(f64::from)
}
