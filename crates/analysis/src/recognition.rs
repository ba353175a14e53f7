//! Recognition as the paper defines it: each sample has a range of shifts, and the ranges that contain
//! the shift of a point decide.

/// A range of shifts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Smallest shift, Hz.
    pub min_hz: f64,
    /// Largest shift, Hz.
    pub max_hz: f64,
}

impl Range {
    /// The smallest range that contains these shifts; `None` without shifts.
    pub fn of(shifts_hz: impl IntoIterator<Item = f64>) -> Option<Self> {
        shifts_hz.into_iter().fold(None, |range, shift| {
            let Self { min_hz, max_hz } = range.unwrap_or(Self { min_hz: shift, max_hz: shift });
            Some(Self { min_hz: min_hz.min(shift), max_hz: max_hz.max(shift) })
        })
    }

    /// Whether the shift lies inside the closed range.
    pub fn contains(&self, shift_hz: f64) -> bool {
        self.min_hz <= shift_hz && shift_hz <= self.max_hz
    }
}

/// The judgement of a point of a known sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judgement {
    /// The point lies in the range of its sample only.
    Recognised,
    /// The point lies in the range of its sample and in other ranges: "it may be misjudged".
    Ambiguous {
        /// Number of other ranges that contain the point.
        others: usize,
    },
    /// The point lies outside its sample's range.
    Missed,
}

/// The credit for ambiguous points in a recognition rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Credit {
    /// Counted as recognised.
    Full,
    /// One over the number of ranges that contain the point: a guess among them.
    Shared,
    /// Counted as not recognised.
    None,
}

/// Judges a point of `sample` by the ranges of all samples.
///
/// # Panics
/// When `sample` has no range.
pub fn judge(ranges: &[Range], sample: usize, shift_hz: f64) -> Judgement {
    if !ranges[sample].contains(shift_hz) {
        return Judgement::Missed;
    }
    let others = ranges
        .iter()
        .enumerate()
        .filter(|&(other, range)| other != sample && range.contains(shift_hz))
        .count();
    if others == 0 { Judgement::Recognised } else { Judgement::Ambiguous { others } }
}

/// The number of points with each judgement.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Tally {
    /// Points in the range of their sample only.
    pub recognised: u32,
    /// `ambiguous[n − 1]`: points in the range of their sample and in n others.
    pub ambiguous: Vec<u32>,
    /// Points outside their sample's range.
    pub missed: u32,
}

impl Tally {
    /// Counts a judgement.
    pub fn add(&mut self, judgement: Judgement) {
        match judgement {
            Judgement::Recognised => self.recognised += 1,
            Judgement::Missed => self.missed += 1,
            Judgement::Ambiguous { others } => {
                self.ambiguous.resize(self.ambiguous.len().max(others), 0);
                self.ambiguous[others - 1] += 1;
            }
        }
    }

    /// Number of judged points.
    pub fn points(&self) -> u32 {
        self.recognised + self.missed + self.ambiguous.iter().sum::<u32>()
    }

    /// The share of recognised points; `None` without points.
    pub fn rate(&self, credit: Credit) -> Option<f64> {
        let points = self.points();
        if points == 0 {
            return None;
        }
        let of_ambiguous = |(index, &count): (usize, &u32)| {
            f64::from(count)
                * match credit {
                    Credit::Full => 1.0,
                    Credit::Shared => (index as f64 + 2.0).recip(),
                    Credit::None => 0.0,
                }
        };
        let ambiguous: f64 = self.ambiguous.iter().enumerate().map(of_ambiguous).sum();
        Some((f64::from(self.recognised) + ambiguous) / f64::from(points))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGES: [Range; 3] = [
        Range { min_hz: 6.0, max_hz: 8.0 },
        Range { min_hz: 30.0, max_hz: 40.0 },
        Range { min_hz: 38.0, max_hz: 50.0 },
    ];

    #[test]
    fn a_point_is_judged_by_every_range_with_its_ends() {
        for (sample, shift_hz, expected) in [
            (0, 6.0, Judgement::Recognised),
            (0, 8.001, Judgement::Missed),
            (1, 37.999, Judgement::Recognised),
            (1, 38.0, Judgement::Ambiguous { others: 1 }),
            (1, 40.0, Judgement::Ambiguous { others: 1 }),
            (2, 37.0, Judgement::Missed),
            (2, f64::NAN, Judgement::Missed),
        ] {
            assert_eq!(judge(&RANGES, sample, shift_hz), expected, "{sample} {shift_hz}");
        }
    }

    #[test]
    fn ambiguous_points_count_in_full_in_part_or_not() {
        let mut tally = Tally::default();
        assert_eq!(tally.rate(Credit::Full), None);
        for judgement in [
            Judgement::Recognised,
            Judgement::Ambiguous { others: 1 },
            Judgement::Ambiguous { others: 2 },
            Judgement::Missed,
        ] {
            tally.add(judgement);
        }
        assert_eq!(tally.points(), 4);
        assert_eq!(tally.rate(Credit::Full), Some(0.75));
        assert_eq!(tally.rate(Credit::Shared), Some((1.0 + 0.5 + 1.0 / 3.0) / 4.0));
        assert_eq!(tally.rate(Credit::None), Some(0.25));
    }

    #[test]
    fn a_range_holds_what_it_was_made_of() {
        assert_eq!(Range::of([]), None);
        assert_eq!(Range::of([7.0, 6.0, 8.0]), Some(RANGES[0]));
    }
}
