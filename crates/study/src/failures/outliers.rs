//! Outliers among the readings: wrong by any factor, with the wrong sign, or stuck, alone and in bursts.

use rig_model::{Impedance, PointResult, Reading, random::Stream};

/// Length of a burst of outliers: mostly one, sometimes two or four.
const fn burst_length(uniform: f64) -> u32 {
    if uniform < 0.7 {
        1
    } else if uniform < 0.9 {
        2
    } else {
        4
    }
}
const BURST_MEAN: f64 = 1.5;

/// A source of outliers.
#[derive(Debug, Clone)]
pub(super) struct Outliers {
    share: f64,
    random: Stream,
    /// Readings left of the present burst.
    burst: u32,
    /// Kind of the present burst, from 0 to 1.
    kind: f64,
    last: Option<Impedance>,
}

impl Outliers {
    /// Outliers of this share of the readings.
    pub(super) const fn new(share: f64, random: Stream) -> Self {
        Self { share, random, burst: 0, kind: 0.0, last: None }
    }

    /// Replaces the reading if it is an outlier.
    pub(super) fn apply(&mut self, reading: &mut Reading) {
        if self.burst == 0 && self.random.uniform() < self.share / BURST_MEAN {
            self.burst = burst_length(self.random.uniform());
            self.kind = self.random.uniform();
        }
        let PointResult::Value(value) = &mut reading.measured else { return };
        if self.burst > 0 {
            self.burst -= 1;
            // From 0.01 to 100.
            let factor = 10_f64.powf(4.0 * self.random.uniform() - 2.0);
            match self.kind {
                kind if kind < 0.4 => {
                    value.resistance_ohm *= factor;
                    value.reactance_ohm *= factor;
                }
                kind if kind < 0.6 => value.resistance_ohm *= factor,
                kind if kind < 0.7 => value.reactance_ohm = -value.reactance_ohm,
                kind if kind < 0.8 => {
                    value.resistance_ohm = -value.resistance_ohm;
                    value.reactance_ohm = -value.reactance_ohm;
                }
                _ => *value = self.last.unwrap_or(*value),
            }
        }
        self.last = Some(*value);
    }
}
