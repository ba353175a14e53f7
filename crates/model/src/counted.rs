//! Numbers of things in messages.

use std::fmt::Display;

/// A number of things: `1 touch`, `2 touches`, `3 samples`. `one` is the singular of a regular noun.
pub fn counted<N: Copy + Display + PartialEq + From<u8>>(count: N, one: &str) -> String {
    let ending = match one {
        _ if count == N::from(1) => "",
        _ if one.ends_with("ch") => "es",
        _ => "s",
    };
    format!("{count} {one}{ending}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_has_no_plural() {
        let said = [0_u32, 1, 2].map(|count| counted(count, "touch"));
        assert_eq!(said, ["0 touches", "1 touch", "2 touches"]);
        assert_eq!(counted(2_usize, "no-load reference"), "2 no-load references");
    }
}
