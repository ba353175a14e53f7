//! The depth of touches with the error of the linear screw taken out of it, as a calibration on hard blocks has
//! measured it.
//!
//! ```text
//!   true depth = depth by the drive − (e(surface) − e(position of the sweep))
//! ```
//!
//! where e(h) is what the drive says at the height h, less the true height. Between the heights of the map it is a
//! straight line. Where one end of the way is outside of the map, nothing is known of it.

/// Fewest heights between which there is a way.
const HEIGHTS: usize = 2;

/// The error of a screw at heights, with its covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct ScrewMap {
    heights_mm: Vec<f64>,
    errors_mm: Vec<f64>,
    covariance_mm2: Vec<Vec<f64>>,
}

/// A map that is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoScrewMap {
    /// The lists do not have the same length, or are too short.
    #[error(
        "the map of the screw has {heights} heights, {errors} errors and {rows} rows of covariances; at least {HEIGHTS} of each are needed"
    )]
    Sizes {
        /// Number of heights.
        heights: usize,
        /// Number of errors.
        errors: usize,
        /// Number of rows.
        rows: usize,
    },
    /// Heights that do not grow, values that are not finite, or a negative variance.
    #[error("the map of the screw has a value at height number {index} that no screw has")]
    Value {
        /// Number of the height, from 1.
        index: usize,
    },
}

/// The way from the surface to the position of a sweep, on the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Way {
    /// What the depth by the drive is larger than the true one, mm.
    pub error_mm: f64,
    /// The index of a height and its weight, two for each end.
    parts: [(usize, f64); 4],
}

impl ScrewMap {
    /// A map from heights and errors in mm, and the lower triangle of their covariance in µm².
    ///
    /// # Errors
    /// [`NoScrewMap`].
    pub fn new(
        heights_mm: &[f64],
        errors_mm: &[f64],
        triangle_um2: &[Vec<f64>],
    ) -> Result<Self, NoScrewMap> {
        let count = heights_mm.len();
        let is_triangle = triangle_um2.iter().enumerate().all(|(i, row)| row.len() == i + 1);
        if count < HEIGHTS || [errors_mm.len(), triangle_um2.len()] != [count; 2] || !is_triangle {
            let (errors, rows) = (errors_mm.len(), triangle_um2.len());
            return Err(NoScrewMap::Sizes { heights: count, errors, rows });
        }
        let is_wrong = |index: &usize| {
            let grows = *index == 0 || heights_mm[index - 1] < heights_mm[*index];
            let row = &triangle_um2[*index];
            let is_finite = row.iter().all(|entry| entry.is_finite())
                && heights_mm[*index].is_finite()
                && errors_mm[*index].is_finite();
            !(grows && is_finite && row[*index] >= 0.0)
        };
        if let Some(index) = (0..count).find(is_wrong) {
            return Err(NoScrewMap::Value { index: index + 1 });
        }
        let entry = |i: usize, j: usize| 1e-6 * triangle_um2[i.max(j)][i.min(j)];
        Ok(Self {
            heights_mm: heights_mm.to_vec(),
            errors_mm: errors_mm.to_vec(),
            covariance_mm2: (0..count).map(|i| (0..count).map(|j| entry(i, j)).collect()).collect(),
        })
    }

    /// The way between two positions of the drive, mm; `None` if one of them is outside of the map.
    pub fn way(&self, surface_mm: f64, position_mm: f64) -> Option<Way> {
        let [from, to] = [self.at(surface_mm)?, self.at(position_mm)?];
        let parts = [from[0], from[1], (to[0].0, -to[0].1), (to[1].0, -to[1].1)];
        let error_mm = parts.iter().map(|(index, weight)| weight * self.errors_mm[*index]).sum();
        Some(Way { error_mm, parts })
    }

    /// The covariance of the errors of two ways, mm².
    pub fn covariance_mm2(&self, a: &Way, b: &Way) -> f64 {
        let entry = |(i, by): &(usize, f64)| {
            let row = &self.covariance_mm2[*i];
            by * b.parts.iter().map(|(j, other)| other * row[*j]).sum::<f64>()
        };
        a.parts.iter().map(entry).sum()
    }

    /// The standard deviation of the error of a way, mm.
    pub fn sigma_mm(&self, way: &Way) -> f64 {
        self.covariance_mm2(way, way).max(0.0).sqrt()
    }

    /// The two heights around a position, with their weights.
    fn at(&self, position_mm: f64) -> Option<[(usize, f64); 2]> {
        let above = self.heights_mm.iter().position(|height| *height >= position_mm)?;
        if above == 0 {
            return (self.heights_mm[0] <= position_mm).then_some([(0, 1.0), (0, 0.0)]);
        }
        let (low, high) = (self.heights_mm[above - 1], self.heights_mm[above]);
        let part = (position_mm - low) / (high - low);
        Some([(above - 1, 1.0 - part), (above, part)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of 10 and 20 µm, 0.1 mm apart, of which 3 of 4 µm² are common.
    fn map() -> ScrewMap {
        ScrewMap::new(&[1.0, 1.1], &[0.01, 0.02], &[vec![4.0], vec![3.0, 4.0]]).unwrap()
    }

    #[test]
    fn a_way_has_the_difference_of_its_ends_and_what_they_do_not_share() {
        let map = map();
        let way = map.way(1.1, 1.0).unwrap();
        assert!((way.error_mm - 0.01).abs() < 1e-12, "{way:?}");
        assert!((map.sigma_mm(&way) - 0.001 * 2.0_f64.sqrt()).abs() < 1e-12);
        let half = map.way(1.05, 1.0).unwrap();
        assert!((half.error_mm - 0.005).abs() < 1e-12, "{half:?}");
        assert!((map.covariance_mm2(&way, &half) - 1e-6).abs() < 1e-12);
        let none = map.way(1.05, 1.05).unwrap();
        assert!(none.error_mm.abs() < 1e-12, "{none:?}");
        assert!(map.sigma_mm(&none) < 1e-12);
    }

    #[test]
    fn a_way_that_leaves_the_map_is_not_on_it() {
        for (from, to) in [(1.0, 0.999), (1.101, 1.0), (f64::NAN, 1.0)] {
            assert_eq!(map().way(from, to), None, "{from} {to}");
        }
        assert!(map().way(1.1, 1.0).is_some());
    }

    #[test]
    fn lists_that_are_no_map_are_refused() {
        let two = [vec![4.0], vec![3.0, 4.0]];
        let sizes = NoScrewMap::Sizes { heights: 2, errors: 1, rows: 2 };
        assert_eq!(ScrewMap::new(&[1.0, 1.1], &[0.0], &two), Err(sizes));
        assert!(ScrewMap::new(&[1.0], &[0.0], &two[..1]).is_err());
        assert!(ScrewMap::new(&[1.0, 1.1], &[0.0; 2], &[vec![4.0], vec![4.0]]).is_err());
        let second = Err(NoScrewMap::Value { index: 2 });
        assert_eq!(ScrewMap::new(&[1.0, 1.0], &[0.0; 2], &two), second);
        assert_eq!(ScrewMap::new(&[1.0, 1.1], &[0.0, f64::NAN], &two), second);
        assert_eq!(ScrewMap::new(&[1.0, 1.1], &[0.0; 2], &[vec![4.0], vec![3.0, -4.0]]), second);
    }
}
