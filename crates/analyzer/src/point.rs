//! How one frequency is measured: how often it is triggered, and what the instrument averages.

use rig_model::ReadingFlag;
use rig_scpi::{DataError, Datum};

/// What the instrument is set to for a trigger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shot {
    /// As the instrument will round it.
    pub(crate) frequency_hz: f64,
    /// Measurements that one trigger averages.
    pub(crate) averages: u32,
    /// Between the trigger and the first of them, s.
    pub(crate) delay_s: f64,
}

/// How many measurements, in how many triggers, make up so many cycles at least.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Integration {
    pub(crate) triggers: u32,
    pub(crate) averages: u32,
    pub(crate) cycles_per_average: u32,
}

impl Integration {
    /// Spreads the cycles evenly over as few triggers as the instrument allows.
    pub(crate) fn new(cycles: u32, cycles_per_average: u32, averages_max: u32) -> Self {
        let averages = cycles.max(1).div_ceil(cycles_per_average);
        let triggers = averages.div_ceil(averages_max);
        Self { triggers, averages: averages.div_ceil(triggers), cycles_per_average }
    }

    /// The cycles of one trigger.
    pub(crate) fn cycles_per_trigger(self) -> f64 {
        f64::from(self.averages) * f64::from(self.cycles_per_average)
    }
}

/// What one trigger measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Impedance {
    pub(crate) resistance_ohm: f64,
    pub(crate) reactance_ohm: f64,
    pub(crate) flag: ReadingFlag,
}

impl Impedance {
    /// Two data of an answer. Where one of them is no number, there is no value, and nothing that
    /// could be mistaken for one.
    pub(crate) fn new(
        resistance: &Datum,
        reactance: &Datum,
        flag: ReadingFlag,
    ) -> Result<Self, DataError> {
        match (resistance.number(), reactance.number()) {
            (Ok(resistance_ohm), Ok(reactance_ohm)) if flag != ReadingFlag::Overload => {
                Ok(Self { resistance_ohm, reactance_ohm, flag })
            }
            (Err(error @ (DataError::Malformed { .. } | DataError::Type { .. })), _)
            | (_, Err(error @ (DataError::Malformed { .. } | DataError::Type { .. }))) => {
                Err(error)
            }
            _ => Ok(Self::OVERLOADED),
        }
    }

    const OVERLOADED: Self =
        Self { resistance_ohm: f64::NAN, reactance_ohm: f64::NAN, flag: ReadingFlag::Overload };

    /// The mean of several triggers; what one of them lacks, the mean lacks.
    pub(crate) fn mean(all: &[Self]) -> Self {
        let n = all.len() as f64;
        let flag = if all.iter().any(|one| one.flag == ReadingFlag::Overload) {
            ReadingFlag::Overload
        } else if all.iter().any(|one| one.flag == ReadingFlag::LowSignal) {
            ReadingFlag::LowSignal
        } else {
            ReadingFlag::Normal
        };
        Self {
            resistance_ohm: all.iter().map(|one| one.resistance_ohm).sum::<f64>() / n,
            reactance_ohm: all.iter().map(|one| one.reactance_ohm).sum::<f64>() / n,
            flag,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cycles_are_spread_over_as_few_triggers_as_there_may_be() {
        let rows = [
            ((1, 1, 256), (1, 1)),
            ((256, 1, 256), (1, 256)),
            ((257, 1, 256), (2, 129)),
            ((100_000, 1, 256), (391, 256)),
            ((20, 14, 256), (1, 2)),
            ((0, 14, 256), (1, 1)),
        ];
        for ((cycles, per_average, max), (triggers, averages)) in rows {
            let found = Integration::new(cycles, per_average, max);
            let expected = Integration { triggers, averages, cycles_per_average: per_average };
            assert_eq!(found, expected);
            let all = found.cycles_per_trigger() * f64::from(triggers);
            assert!(f64::from(cycles) <= all && averages <= max);
        }
    }

    #[test]
    fn what_is_no_number_is_flagged_and_holds_none() {
        let (one, two) = (Datum::Real(1.5), Datum::Integer(-2));
        let normal = Impedance::new(&one, &two, ReadingFlag::Normal).unwrap();
        assert_eq!((normal.resistance_ohm, normal.reactance_ohm), (1.5, -2.0));
        for bad in [Datum::Missing, Datum::Overload { is_negative: false }] {
            let found = Impedance::new(&one, &bad, ReadingFlag::Normal).unwrap();
            assert!(found.resistance_ohm.is_nan() && found.flag == ReadingFlag::Overload);
        }
        let word = Datum::Characters("NEAR".to_owned());
        assert!(Impedance::new(&word, &two, ReadingFlag::Normal).is_err());
        let low = Impedance { flag: ReadingFlag::LowSignal, ..normal };
        let mean = Impedance::mean(&[normal, low, Impedance { resistance_ohm: 4.5, ..normal }]);
        assert_eq!((mean.resistance_ohm, mean.flag), (2.5, ReadingFlag::LowSignal));
    }
}
