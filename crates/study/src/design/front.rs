//! The front: the designs that no other design beats.

use rayon::prelude::*;

use super::{grid::Design, merit::Merit};

/// Indices of the designs that no other design beats in all merits, in their order.
pub(super) fn front(designs: &[(Design, Option<Merit>)]) -> Vec<usize> {
    let mut merits: Vec<(usize, Merit)> = designs
        .iter()
        .enumerate()
        .filter_map(|(index, (_, merit))| Some((index, (*merit)?)))
        .collect();
    // Designs that beat many come first, so that most comparisons end early.
    merits.sort_by(|a, b| a.1.angle_influence.total_cmp(&b.1.angle_influence));
    let mut front: Vec<usize> = merits
        .par_iter()
        .filter(|(_, merit)| !merits.iter().any(|(_, other)| other.beats(merit)))
        .map(|(index, _)| *index)
        .collect();
    front.sort_unstable();
    front
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper_bench::Control;

    #[test]
    fn a_design_stays_unless_another_is_better_in_one_merit_and_worse_in_none() {
        let design = Design {
            length_mm: 35.0,
            radius_mm: 0.5,
            indentation_mm: 0.5,
            arm_mm: 8.0,
            control: Control::Indentation,
        };
        let merit = |angle_influence, discrimination, sensitivity_hz_per_mpa, point_s| {
            let merit = Merit { angle_influence, discrimination, sensitivity_hz_per_mpa, point_s };
            (design, Some(merit))
        };
        let designs = [
            merit(0.2, 0.1, 130.0, 0.8),
            merit(0.2, 0.1, 129.0, 0.8),
            merit(0.3, 0.1, 140.0, 0.8),
            (design, None),
            merit(0.2, 0.1, 130.0, 0.7),
        ];
        assert_eq!(front(&designs), [2, 4]);
        // Equals do not beat each other.
        assert_eq!(front(&[designs[0], designs[0]]), [0, 1]);
    }
}
