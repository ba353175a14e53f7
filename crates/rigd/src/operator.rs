//! The operator: the name that the journal keeps with each command.

use std::{env, fmt, str::FromStr};

use rig_system::person;

/// Longer than any login name and any full name that fits a line of the report.
const LENGTH_MAX: usize = 64;

/// Characters of a name in addition to letters and digits, as in full names, login names, mail
/// addresses and Windows accounts.
const MARKS: &str = " .-_@'\\";

/// The name of a person or a program that gives commands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Operator(String);

/// A name that the journal does not take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the name of an operator is 1 to {LENGTH_MAX} letters, digits, spaces and any of . - _ @ ' \\, \
     and does not begin or end with a space"
)]
pub struct OperatorError;

impl Operator {
    /// The user who is logged in, as the environment says; otherwise the number of the user.
    pub fn login() -> Self {
        Self::logged_in().0
    }

    /// The person who is logged in, with the variable that says it.
    pub(crate) fn logged_in() -> (Self, Option<&'static str>) {
        let name = |variable| Some((env::var(variable).ok()?.parse().ok()?, Some(variable)));
        let named = person::LOGIN_VARIABLES.iter().copied().find_map(name);
        named.unwrap_or_else(|| (Self(person::without_a_name()), None))
    }

    /// The name, 1 to 64 characters.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for Operator {
    type Err = OperatorError;

    fn from_str(name: &str) -> Result<Self, OperatorError> {
        let is_allowed = |letter: char| letter.is_alphanumeric() || MARKS.contains(letter);
        let is_name = (1..=LENGTH_MAX).contains(&name.chars().count())
            && name.chars().all(is_allowed)
            && name.trim() == name;
        if is_name { Ok(Self(name.to_owned())) } else { Err(OperatorError) }
    }
}

impl fmt::Display for Operator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_people_and_accounts_are_taken_and_nothing_else() {
        let long = "a".repeat(LENGTH_MAX);
        for name in
            ["ada", "Ada Lovelace", "J\u{fc}rgen", "LAB\\ada", "ada@lab.example", "7", &long]
        {
            assert_eq!(name.parse::<Operator>().unwrap().as_str(), name);
        }
        let longer = "a".repeat(LENGTH_MAX + 1);
        let control = ["a\nb", "a\0", "\u{1b}[2J", "a\u{202e}b"];
        let markup = ["<b>", "=1+1", "a,b", "a\"b", "", " ", " ada", "ada ", &longer];
        for name in control.into_iter().chain(markup) {
            assert_eq!(name.parse::<Operator>(), Err(OperatorError), "{name:?}");
        }
    }
}
