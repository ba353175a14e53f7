//! The grid of designs.

use std::{fmt, str::FromStr};

use crate::paper_bench::Control;

/// Evenly spaced values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GridAxis {
    from: f64,
    to: f64,
    count: u32,
}

/// A malformed span.
#[derive(Debug, thiserror::Error)]
#[error(
    "a range is VALUE or FROM:TO:COUNT with positive, rising values and a count from 2 to 2000"
)]
pub(super) struct GridAxisError;

impl FromStr for GridAxis {
    type Err = GridAxisError;

    fn from_str(text: &str) -> Result<Self, GridAxisError> {
        let parts: Vec<&str> = text.split(':').collect();
        let number = |text: &str| {
            text.parse::<f64>()
                .ok()
                .filter(|value| value.is_finite() && *value > 0.0)
                .ok_or(GridAxisError)
        };
        match parts[..] {
            [one] => Ok(Self { from: number(one)?, to: number(one)?, count: 1 }),
            [from, to, count] => {
                let span = Self {
                    from: number(from)?,
                    to: number(to)?,
                    count: count.parse().map_err(|_| GridAxisError)?,
                };
                let is_good = span.from < span.to && (2..=2000).contains(&span.count);
                if is_good { Ok(span) } else { Err(GridAxisError) }
            }
            _ => Err(GridAxisError),
        }
    }
}

impl fmt::Display for GridAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.count == 1 {
            return write!(f, "{}", self.from);
        }
        write!(f, "{}:{}:{}", self.from, self.to, self.count)
    }
}

impl GridAxis {
    fn values(self) -> impl Iterator<Item = f64> + Clone {
        let steps = f64::from(self.count.max(2) - 1);
        (0..self.count).map(move |i| self.from + (self.to - self.from) * f64::from(i) / steps)
    }
}

/// A sensor with its indentation. All other dimensions are those of the reference sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Design {
    pub(super) length_mm: f64,
    pub(super) radius_mm: f64,
    pub(super) indentation_mm: f64,
    pub(super) arm_mm: f64,
    pub(super) control: Control,
}

impl fmt::Display for Design {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { length_mm, radius_mm, indentation_mm, arm_mm, .. } = self;
        write!(f, "length {length_mm:.2} mm, ball {radius_mm:.3} mm, ")?;
        write!(f, "indentation {indentation_mm:.3} mm, arm {arm_mm:.2} mm")
    }
}

/// All designs of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    pub(super) lengths_mm: GridAxis,
    pub(super) radii_mm: GridAxis,
    pub(super) indentations_mm: GridAxis,
    pub(super) arms_mm: GridAxis,
    pub(super) control: Control,
}

impl Grid {
    /// The designs, one block for each length.
    pub(super) fn blocks(&self) -> Vec<Vec<Design>> {
        let Self { lengths_mm, radii_mm, indentations_mm, arms_mm, control } = *self;
        let block = |length_mm: f64| {
            let mut block = Vec::new();
            for radius_mm in radii_mm.values() {
                for indentation_mm in indentations_mm.values() {
                    for arm_mm in arms_mm.values() {
                        block.push(Design {
                            length_mm,
                            radius_mm,
                            indentation_mm,
                            arm_mm,
                            control,
                        });
                    }
                }
            }
            block
        };
        lengths_mm.values().map(block).collect()
    }
}

impl fmt::Display for Grid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { lengths_mm, radii_mm, indentations_mm, arms_mm, control } = self;
        write!(f, "length {lengths_mm} radius {radii_mm} indentation {indentations_mm} ")?;
        write!(f, "arm {arms_mm} {}", control.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_is_one_value_or_evenly_spaced_ones() {
        let values = |text: &str| text.parse::<GridAxis>().unwrap().values().collect::<Vec<_>>();
        assert_eq!(values("8"), [8.0]);
        assert_eq!(values("1:2:3"), [1.0, 1.5, 2.0]);
        for wrong in ["", "0", "2:1:3", "1:2:1", "1:2", "1:2:x", "1:2:3:4", "-1:2:3", "1:inf:3"] {
            assert!(wrong.parse::<GridAxis>().is_err(), "{wrong}");
        }
    }
}
