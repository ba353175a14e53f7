//! What the stiffness of touches and sites has in common by their references.

use rig_analysis::{
    budget::Part,
    reference::Reference,
    run::{Reading, SharedReferences},
};

use super::Touched;
use crate::data::RunData;

/// The covariance of the scaled shifts of touches by their references, Hz², with the variance of each reference on the
/// diagonal; `None` if no two touches share one.
pub(super) fn by_references<'a>(
    data: &RunData,
    free_hz: f64,
    touches: impl Iterator<Item = &'a Touched<'a>>,
) -> Option<Vec<Vec<f64>>> {
    let scaled =
        |(touch, _): &Touched<'_>| (free_hz / touch.no_load_hz, data.between.reference(touch));
    let references: Vec<(f64, Reference)> = touches.map(scaled).collect();
    let entry = |(a, of_a): &(f64, Reference), (b, of_b): &(f64, Reference)| {
        a * b * of_a.covariance_hz2(of_b)
    };
    let row = |a| references.iter().map(|b| entry(a, b)).collect();
    let all: Vec<Vec<f64>> = references.iter().map(row).collect();
    let others = |(i, row): (usize, &Vec<f64>)| row[..i].iter().any(|entry| *entry != 0.0);
    all.iter().enumerate().any(others).then_some(all)
}

/// Touches that have one stiffness.
pub(super) struct Together {
    /// Their indices.
    touches: Vec<usize>,
    /// Relative change of the stiffness for 1 Hz of all of their references.
    per_hz: f64,
}

impl Together {
    /// The touches of a site, whose stiffness was found as if their references were independent. What they share of
    /// these is added to its variance. The touches of a site have much the same gain.
    pub(super) fn new(reading: &mut Reading, touches: Vec<usize>, hz2: &[Vec<f64>]) -> Self {
        let alone_hz2: f64 = touches.iter().map(|&i| hz2[i][i]).sum();
        let all_hz2: f64 =
            touches.iter().flat_map(|&i| touches.iter().map(move |&j| hz2[i][j])).sum();
        let Ok(found) = &mut reading.found else { return Self { touches, per_hz: 0.0 } };
        let of_reference = found.budget.of(Part::Reference);
        let per_hz = if alone_hz2 > 0.0 {
            touches.len() as f64 * of_reference / alone_hz2.sqrt()
        } else {
            0.0
        };
        if alone_hz2 > 0.0 && all_hz2 != alone_hz2 {
            let shared = (all_hz2 / alone_hz2).max(0.0).sqrt() * of_reference;
            found.budget = found.budget.with(Part::Reference, shared);
            let before = (found.young.sigma_mpa / found.young.mpa).powi(2);
            let after = before + shared.powi(2) - of_reference.powi(2);
            found.young.sigma_mpa = found.young.mpa * after.max(0.0).sqrt();
        }
        Self { touches, per_hz }
    }

    /// The covariance of the mean references of two groups, Hz².
    fn with_hz2(&self, other: &Self, hz2: &[Vec<f64>]) -> f64 {
        let pairs =
            self.touches.iter().flat_map(|&i| other.touches.iter().map(move |&j| hz2[i][j]));
        pairs.sum::<f64>() / (self.touches.len() * other.touches.len()).max(1) as f64
    }
}

/// What main and blind groups of touches share.
pub(super) fn of_groups(
    main: &[Together],
    blind: &[Together],
    hz2: &[Vec<f64>],
) -> SharedReferences {
    let all: Vec<&Together> = main.iter().chain(blind).collect();
    let per_hz = |groups: &[Together]| groups.iter().map(|one| one.per_hz).collect::<Vec<_>>();
    SharedReferences::of(&per_hz(main), &per_hz(blind), |i, j| all[i].with_hz2(all[j], hz2))
}
