//! What the charts say of the last check.

use super::{CheckValues, Quantity};
use crate::control::{AVERAGE_LIMIT, BASELINE, Chart, Charted, Comparison, SCORE_LIMIT};

/// A score that no chance explains: one check in two million has it, and one in 250 000 on any of seven charts.
const CERTAIN_SCORE: f64 = 5.0;

/// A score that confirms an alarm of the check before it.
const CONFIRMING_SCORE: f64 = 2.0;

/// The verdict of a daily check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CheckVerdict {
    /// The bench is as it was.
    Accepted,
    /// Something may have changed, or too few checks were made to say: look, and check again.
    Look,
    /// Something has changed: what is measured now is not comparable with what was measured before.
    NotToBeTrusted,
}

impl CheckVerdict {
    /// Its name in records and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Look => "look",
            Self::NotToBeTrusted => "not to be trusted",
        }
    }
}

/// A quantity that has changed, as far as its chart can say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuantityAlarm {
    /// The quantity.
    pub quantity: Quantity,
    /// How it compares with the checks before.
    pub against: Comparison,
    /// Whether no chance explains it: it is far off, or the check before has shown it too.
    pub is_certain: bool,
}

/// The last check, judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// The verdict.
    pub verdict: CheckVerdict,
    /// Number of checks since the bench was changed, this one included.
    pub count: usize,
    /// The quantities that have changed.
    pub alarms: Vec<QuantityAlarm>,
    /// The chart of each quantity, in the order of [`Quantity::ALL`], over all checks.
    pub charts: Vec<Vec<Charted>>,
}

/// Judges the last of these checks, the oldest of which comes first. There is at least one.
///
/// Look: a chart has an alarm, or fewer than [`BASELINE`] checks came before. Not to be trusted: a score beyond 5, or an
/// alarm that the check before had too, on the same chart, with a score beyond 2 in its direction.
pub fn judge(checks: &[CheckValues]) -> Checked {
    let mut alarms = Vec::new();
    let charts = Quantity::ALL.map(|quantity| {
        let mut chart = Chart::new(quantity.least_sigma());
        let charted: Vec<_> = checks.iter().map(|check| chart.take(check.get(quantity))).collect();
        alarms.extend(alarm(quantity, &charted));
        charted
    });
    let verdict = if alarms.iter().any(|alarm| alarm.is_certain) {
        CheckVerdict::NotToBeTrusted
    } else if alarms.is_empty() && checks.len() > BASELINE {
        CheckVerdict::Accepted
    } else {
        CheckVerdict::Look
    };
    Checked { verdict, count: checks.len(), alarms, charts: charts.into() }
}

/// The alarm of the last value of a chart.
fn alarm(quantity: Quantity, charted: &[Charted]) -> Option<QuantityAlarm> {
    let mut last_first = charted.iter().rev().map(|charted| charted.against);
    let against = last_first.next().flatten().filter(Comparison::is_alarm)?;
    let before = last_first.next().flatten().filter(Comparison::is_alarm);
    let is_confirmed = before.is_some_and(|before| against.has_sign_of(&before))
        && against.score.abs() > CONFIRMING_SCORE;
    let is_certain = against.score.abs() > CERTAIN_SCORE || is_confirmed;
    Some(QuantityAlarm { quantity, against, is_certain })
}

impl Checked {
    /// Why it is not accepted, for a person.
    pub fn reason(&self) -> Option<String> {
        if self.verdict == CheckVerdict::Accepted {
            return None;
        }
        if self.alarms.is_empty() {
            return Some(format!(
                "the charts begin after {BASELINE} checks, and this is number {}",
                self.count
            ));
        }
        let one = |alarm: &QuantityAlarm| {
            let QuantityAlarm { quantity, against, .. } = alarm;
            format!(
                "{}: score {:.1} (limit {SCORE_LIMIT}), average of the last scores {:.2} (limit {AVERAGE_LIMIT:.2})",
                quantity.text(),
                against.score,
                against.average
            )
        };
        Some(self.alarms.iter().map(one).collect::<Vec<_>>().join("; "))
    }
}
