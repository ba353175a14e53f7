//! What a person is asked, and the answers.

use std::ops::RangeInclusive;

/// A question to the person at the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// Nothing is below the probe, the axes stand in the middle of their travel, a hand is at the stop.
    NoSample,
    /// Press the emergency stop.
    PressStop,
    /// Release it.
    ReleaseStop,
    /// Direction of the last step of the probe.
    ProbeWent,
    /// Edge that sank in the last step of the table.
    EdgeSank,
    /// Set the dial gauge to zero.
    DialZero,
    /// How far the probe rose in the last step, by a dial gauge.
    Dial,
    /// Tilt of the table, by an angle gauge.
    Gauge,
    /// A limit switch or the end of the travel stopped the axis.
    AtLimit,
    /// Take away what else stopped the axis.
    ClearWay,
    /// Hold the lower limit switch of the linear stage pressed.
    HoldSwitch,
    /// Let go of it.
    LetGo,
    /// How far the carriage can still go down, by a rule.
    WayDown,
    /// Take away the table, because the linear stage homes downwards.
    TableAway,
    /// Set one test indicator against the carriage and one against the edge of the table, both to zero.
    SetIndicators,
    /// Have the drives find their zero with their own program.
    FindZero,
    /// Take the power from both drives, and give it back.
    PowerCycle,
    /// The test indicator at the carriage.
    Indicator,
    /// The test indicator at the edge of the table.
    EdgeIndicator,
    /// Gap between the tip and a level sample, by a rule.
    Gap,
    /// Height of that surface above the rotary axis, by a rule.
    AbovePivot,
    /// Distance of the probe from the rotary axis, by a rule.
    BesidePivot,
}

/// A word that answers a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// It is so, or it is done.
    Yes,
    /// It is not so.
    No,
    /// The probe went away from the table.
    Up,
    /// The probe went towards the table.
    Down,
    /// The probe was not seen to move.
    Nowhere,
    /// The edge on the side of the tip of the bimorph sank.
    Tip,
    /// The edge on the side of its clamp sank.
    Clamp,
    /// Neither edge was seen to move.
    Neither,
}

/// The answer to a question.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// One of its words.
    Choice(Choice),
    /// A reading, in its unit.
    Reading(f64),
}

impl std::fmt::Display for Answer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Choice(choice) => f.write_str(choice.name()),
            Self::Reading(reading) => write!(f, "{reading:.3}"),
        }
    }
}

/// A text that does not answer the question.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{found}\" is no answer; answer with {expected}")]
pub struct NotAnAnswer {
    /// The text.
    pub found: String,
    /// What answers.
    pub expected: String,
}

impl Choice {
    /// The word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Yes => "yes",
            Self::No => "no",
            Self::Up => "up",
            Self::Down => "down",
            Self::Nowhere => "nowhere",
            Self::Tip => "tip",
            Self::Clamp => "clamp",
            Self::Neither => "neither",
        }
    }

    /// The sense of a motion that was seen: 1 for what a positive step does by convention, 0 for none.
    pub const fn sense(self) -> f64 {
        match self {
            Self::Up | Self::Tip => 1.0,
            Self::Down | Self::Clamp => -1.0,
            Self::Nowhere | Self::Neither | Self::Yes | Self::No => 0.0,
        }
    }
}

const TABLE_AWAY: &str = "The drive of the linear stage may look for its zero downwards. Take table, holder and dish away, and leave the \
     indicator at the carriage as it is. Is nothing below the probe, down to the end of its travel?";

const FIND_ZERO: &str = "A drive says that it does not know where its axis is. With the drives' own program, have it find its zero, and bring the \
     axis back to the middle of its travel; before, take table, holder and dish away if the linear stage homes downwards. Is it \
     done?";

impl Asked {
    /// The question.
    pub const fn text(self) -> &'static str {
        match self {
            Self::NoSample => {
                "Take sample and dish away. Bring both axes to the middle of their travel, by hand or with the \
                 drives' own program. Keep a hand at the emergency stop. Is it so?"
            }
            Self::PressStop => "Press the emergency stop. Is it pressed?",
            Self::ReleaseStop => {
                "Release the emergency stop, and clear what it set off on the drives. Is it released?"
            }
            Self::ProbeWent => "Where did the probe go?",
            Self::EdgeSank => "Which edge of the table sank?",
            Self::DialZero => {
                "Set the dial gauge to zero. Does its tip touch the carriage, and does it read zero?"
            }
            Self::Dial => {
                "Dial gauge, set to zero before the step: how far did the probe rise, in mm? Negative if it sank."
            }
            Self::Gauge => {
                "Angle gauge on the table: its tilt in degrees? Positive if the edge on the side of the tip of the \
                 bimorph is lower."
            }
            Self::AtLimit => {
                "Was it stopped by its limit switch or by the end of its travel, and by nothing else, such as a cable, a hand \
                 or the stop?"
            }
            Self::ClearWay => {
                "Take away what stopped it: nothing may be in the way of the axis up to its limit, and no hand. Is the way free?"
            }
            Self::HoldSwitch => {
                "Hold the lower limit switch of the linear stage pressed by hand. Is it pressed? Answer no if it has none."
            }
            Self::LetGo => "Let go of the switch. Is it released?",
            Self::WayDown => {
                "By a rule: how far can the carriage still go down before it presses its lower limit switch, or ends if it has \
                 none, in mm?"
            }
            Self::SetIndicators => {
                "Set a test indicator with divisions of 1 µm against the carriage of the probe, and a second one against the edge \
                 of the table on the side of the tip of the bimorph, 20 mm from its axis. Set both to zero. Is it done?"
            }
            Self::TableAway => TABLE_AWAY,
            Self::FindZero => FIND_ZERO,
            Self::PowerCycle => {
                "Switch the power of both drives off, wait ten seconds, and switch it on again. Is it on?"
            }
            Self::Indicator => {
                "Test indicator at the carriage: its reading in mm, such as 0.002? Positive if the carriage is higher than at zero."
            }
            Self::EdgeIndicator => {
                "Test indicator at the edge of the table: its reading in mm, such as 0.002? Positive if the edge is lower than at \
                 zero."
            }
            Self::Gap => {
                "Put a sample on the level table. By a rule: the gap between the tip of the probe and its surface, in \
                 mm?"
            }
            Self::AbovePivot => {
                "By a rule: the height of that surface above the axis of the rotary stage, in mm? Negative if it is \
                 below."
            }
            Self::BesidePivot => {
                "By a rule: the distance of the probe from the axis of the rotary stage, in mm? Positive towards the \
                 tip of the bimorph."
            }
        }
    }

    /// The words that answer it; none for a reading.
    pub const fn choices(self) -> &'static [Choice] {
        match self {
            Self::NoSample
            | Self::PressStop
            | Self::ReleaseStop
            | Self::AtLimit
            | Self::ClearWay
            | Self::HoldSwitch
            | Self::LetGo
            | Self::SetIndicators
            | Self::TableAway
            | Self::FindZero
            | Self::DialZero
            | Self::PowerCycle => &[Choice::Yes, Choice::No],
            Self::ProbeWent => &[Choice::Up, Choice::Down, Choice::Nowhere],
            Self::EdgeSank => &[Choice::Tip, Choice::Clamp, Choice::Neither],
            Self::Dial
            | Self::Gauge
            | Self::WayDown
            | Self::Indicator
            | Self::EdgeIndicator
            | Self::Gap
            | Self::AbovePivot
            | Self::BesidePivot => &[],
        }
    }

    /// The readings that a bench of this size can have, and their unit; `None` for words. A larger one is a slip: a comma that
    /// was forgotten, or another unit.
    fn readings(self) -> Option<(RangeInclusive<f64>, &'static str)> {
        match self {
            // A dial gauge has a stroke of at most 50 mm.
            Self::Dial => Some((-50.0..=50.0, "mm")),
            Self::Gauge => Some((-180.0..=180.0, "°")),
            Self::WayDown => Some((0.0..=500.0, "mm")),
            // A lever indicator has a range below 2 mm.
            Self::Indicator | Self::EdgeIndicator => Some((-2.0..=2.0, "mm")),
            Self::Gap => Some((0.0..=100.0, "mm")),
            Self::AbovePivot => Some((-100.0..=100.0, "mm")),
            Self::BesidePivot => Some((-20.0..=20.0, "mm")),
            _ => None,
        }
    }

    /// What answers it, for a person.
    pub fn expected(self) -> String {
        if let Some((range, unit)) = self.readings() {
            let (least, most) = (range.start(), range.end());
            let such = if *least < 0.0 { "-0.25" } else { "0.25" };
            return format!("a number from {least} to {most} {unit}, such as {such}");
        }
        let words: Vec<_> = self.choices().iter().map(|choice| choice.name()).collect();
        match words.split_last() {
            None => String::new(),
            Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
        }
    }

    /// Reads an answer.
    ///
    /// # Errors
    /// [`NotAnAnswer`].
    pub fn read(self, text: &str) -> Result<Answer, NotAnAnswer> {
        let word = text.trim().to_lowercase();
        let choices = self.choices();
        let answer = if let Some((range, _)) = self.readings() {
            let number = word.replace(',', ".").parse::<f64>().ok();
            number.filter(|reading| range.contains(reading)).map(Answer::Reading)
        } else {
            let starting = choices.iter().filter(|choice| choice.name().starts_with(&word));
            let mut starting = starting.copied().filter(|_| !word.is_empty());
            starting.next().filter(|_| starting.next().is_none()).map(Answer::Choice)
        };
        answer
            .ok_or_else(|| NotAnAnswer { found: text.trim().to_owned(), expected: self.expected() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_or_its_beginning_answers_and_anything_else_is_asked_for_again() {
        assert_eq!(Asked::ProbeWent.read(" Up\n"), Ok(Answer::Choice(Choice::Up)));
        assert_eq!(Asked::NoSample.read("y"), Ok(Answer::Choice(Choice::Yes)));
        assert_eq!(Asked::Dial.read("-9,98"), Ok(Answer::Reading(-9.98)));
        for (asked, text) in [
            (Asked::ProbeWent, ""),
            (Asked::ProbeWent, "tip"),
            (Asked::EdgeSank, "up"),
            (Asked::Dial, "ten"),
            (Asked::Dial, "nan"),
            (Asked::Dial, "inf"),
            (Asked::Gap, "1e308"),
            (Asked::BesidePivot, "300"),
            (Asked::WayDown, "-1"),
        ] {
            assert!(asked.read(text).is_err(), "{asked:?} {text:?}");
        }
        let error = Asked::EdgeSank.read("left").unwrap_err().to_string();
        assert_eq!(error, "\"left\" is no answer; answer with tip, clamp or neither");
        let error = Asked::BesidePivot.read("300").unwrap_err().to_string();
        let limits = "answer with a number from -20 to 20 mm, such as -0.25";
        assert_eq!(error, format!("\"300\" is no answer; {limits}"));
    }
}
