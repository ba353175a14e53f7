//! The person at the computer.

/// Variables of the environment that name who is logged in, the first one that is set counts.
pub const LOGIN_VARIABLES: &[&str] = crate::system::LOGIN_VARIABLES;

/// What stands for the person where no variable names one: `uid` and a number on Unix.
///
/// A program on Windows has a name from its environment or none: there it says so.
pub fn without_a_name() -> String {
    crate::system::without_a_name()
}
