//! The measurement of one frequency: number of triggers, and averages of each.

use rig_files::instrument::dialect::{CommandSet, Dialect, IntegrationRule};
use rig_model::{Impedance, PointResult, ReadingFlag};
use rig_scpi::{DataError, Datum};

/// The settings of the instrument for a trigger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TriggerSettings {
    /// As the instrument will round it.
    pub(crate) frequency_hz: f64,
    /// Measurements that one trigger averages.
    pub(crate) averages: u32,
    /// Between the trigger and the first of them, s.
    pub(crate) delay_s: f64,
}

/// The triggers and measurements that contain a requested number of cycles.
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

    /// Spreads the cycles by the rule of an instrument file, at this frequency.
    pub(crate) fn by_rule(cycles: u32, frequency_hz: f64, rule: &IntegrationRule) -> Self {
        Self::new(cycles, rule.cycles.at(frequency_hz), rule.averages_max)
    }

    /// The cycles of one trigger.
    pub(crate) fn cycles_per_trigger(self) -> f64 {
        f64::from(self.averages) * f64::from(self.cycles_per_average)
    }
}

/// How long an analyzer integrates for a reading of this many cycles at this frequency, s. It may be longer than these
/// cycles, because an instrument measures no shorter than its fastest speed.
pub fn integration_s(dialect: &Dialect, cycles: u32, frequency_hz: f64) -> f64 {
    let cycles = match &dialect.commands {
        CommandSet::TraceE4990a => f64::from(cycles.max(1)),
        CommandSet::Points(commands) => {
            let integration = Integration::by_rule(cycles, frequency_hz, &commands.integration);
            f64::from(integration.triggers) * integration.cycles_per_trigger()
        }
    };
    cycles / frequency_hz
}

/// The result of two data of an answer and their flag. If one of them is not a number, there is no
/// value.
pub(crate) fn measured(
    resistance: &Datum,
    reactance: &Datum,
    flag: Option<ReadingFlag>,
) -> Result<PointResult, DataError> {
    match (resistance.number(), reactance.number(), flag) {
        (Err(error @ (DataError::Malformed { .. } | DataError::Type { .. })), _, _)
        | (_, Err(error @ (DataError::Malformed { .. } | DataError::Type { .. })), _) => Err(error),
        (Ok(resistance_ohm), Ok(reactance_ohm), None) => {
            Ok(PointResult::Value(Impedance { resistance_ohm, reactance_ohm }))
        }
        (Ok(resistance_ohm), Ok(reactance_ohm), Some(ReadingFlag::LowSignal)) => {
            Ok(PointResult::LowSignal(Impedance { resistance_ohm, reactance_ohm }))
        }
        _ => Ok(PointResult::Overload),
    }
}

/// The mean of several triggers. A missing or flagged value of one trigger makes the mean missing
/// or flagged.
pub(crate) fn mean(all: &[PointResult]) -> PointResult {
    let (mut sum, mut is_doubted) = (Impedance { resistance_ohm: 0.0, reactance_ohm: 0.0 }, false);
    for one in all {
        let (PointResult::Value(value) | PointResult::LowSignal(value)) = one else {
            return PointResult::Overload;
        };
        sum.resistance_ohm += value.resistance_ohm;
        sum.reactance_ohm += value.reactance_ohm;
        is_doubted |= matches!(one, PointResult::LowSignal(_));
    }
    let count = all.len() as f64;
    let mean = Impedance {
        resistance_ohm: sum.resistance_ohm / count,
        reactance_ohm: sum.reactance_ohm / count,
    };
    if is_doubted { PointResult::LowSignal(mean) } else { PointResult::Value(mean) }
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
        let value = |resistance_ohm| Impedance { resistance_ohm, reactance_ohm: -2.0 };
        let normal = measured(&one, &two, None).unwrap();
        assert_eq!(normal, PointResult::Value(value(1.5)));
        for bad in [Datum::Missing, Datum::Overload { is_negative: false }] {
            for flag in [None, Some(ReadingFlag::LowSignal), Some(ReadingFlag::Overload)] {
                assert_eq!(measured(&one, &bad, flag), Ok(PointResult::Overload));
                assert_eq!(measured(&bad, &two, flag), Ok(PointResult::Overload));
            }
        }
        let overload = Some(ReadingFlag::Overload);
        assert_eq!(measured(&one, &two, overload), Ok(PointResult::Overload));
        let word = Datum::Characters("NEAR".to_owned());
        assert!(measured(&word, &two, None).is_err());
        let low = PointResult::LowSignal(value(1.5));
        let other = PointResult::Value(value(4.5));
        assert_eq!(mean(&[normal, low, other]), PointResult::LowSignal(value(2.5)));
        assert_eq!(mean(&[normal, PointResult::Overload, low]), PointResult::Overload);
    }
}
