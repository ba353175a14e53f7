//! What a person is asked, and the answers.

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
    /// How far the probe rose in the last step, by a dial gauge.
    Dial,
    /// Tilt of the table, by an angle gauge.
    Gauge,
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
            Self::Dial => {
                "Dial gauge, set to zero before the step: how far did the probe rise, in mm? Negative if it sank."
            }
            Self::Gauge => {
                "Angle gauge on the table: its tilt in degrees? Positive if the edge on the side of the tip of the \
                 bimorph is lower."
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
            Self::NoSample | Self::PressStop | Self::ReleaseStop => &[Choice::Yes, Choice::No],
            Self::ProbeWent => &[Choice::Up, Choice::Down, Choice::Nowhere],
            Self::EdgeSank => &[Choice::Tip, Choice::Clamp, Choice::Neither],
            Self::Dial | Self::Gauge | Self::Gap | Self::AbovePivot | Self::BesidePivot => &[],
        }
    }

    /// What answers it, for a person.
    pub fn expected(self) -> String {
        let words: Vec<_> = self.choices().iter().map(|choice| choice.name()).collect();
        match words.split_last() {
            None => "a number such as -0.25".to_owned(),
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
        let answer = if choices.is_empty() {
            let number = word.replace(',', ".").parse::<f64>().ok();
            number.filter(|reading| reading.is_finite()).map(Answer::Reading)
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
        ] {
            assert!(asked.read(text).is_err(), "{asked:?} {text:?}");
        }
        let error = Asked::EdgeSank.read("left").unwrap_err().to_string();
        assert_eq!(error, "\"left\" is no answer; answer with tip, clamp or neither");
    }
}
