//! Mnemonics in their short and long forms.

/// A mnemonic as manuals write it: `FREQuency`, whose capitals are the short form.
///
/// Digits at the end belong to both forms: `PARameter1` is `PAR1` or `PARAMETER1`, and nothing
/// between.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Mnemonic<'a> {
    text: &'a str,
    n_short: usize,
    n_long: usize,
}

impl<'a> Mnemonic<'a> {
    pub(crate) const fn new(text: &'a str) -> Self {
        let bytes = text.as_bytes();
        let mut n_long = bytes.len();
        while 0 < n_long && bytes[n_long - 1].is_ascii_digit() {
            n_long -= 1;
        }
        let mut n_short = 0;
        while n_short < n_long && !bytes[n_short].is_ascii_lowercase() {
            n_short += 1;
        }
        Self { text, n_short, n_long }
    }

    /// The digits at the end.
    pub(crate) fn digits(self) -> &'a str {
        &self.text[self.n_long..]
    }

    /// Long form without the digits.
    pub(crate) fn long(self) -> &'a str {
        &self.text[..self.n_long]
    }

    /// Short form without the digits.
    pub(crate) fn short(self) -> &'a str {
        &self.text[..self.n_short]
    }

    /// Whether `word` without its digits is the short or the long form.
    pub(crate) fn matches_stem(self, stem: &[u8]) -> bool {
        stem.eq_ignore_ascii_case(self.short().as_bytes())
            || stem.eq_ignore_ascii_case(self.long().as_bytes())
    }

    /// Whether `word` is one of the two forms.
    pub(crate) fn matches(self, word: &[u8]) -> bool {
        let (stem, digits) = split_digits(word);
        digits == self.digits().as_bytes() && self.matches_stem(stem)
    }
}

/// Separates a mnemonic from the digits at its end.
pub(crate) fn split_digits(word: &[u8]) -> (&[u8], &[u8]) {
    let n_digits = word.iter().rev().take_while(|byte| byte.is_ascii_digit()).count();
    word.split_at(word.len() - n_digits)
}

/// The short form of a mnemonic in the notation of manuals: `MEASure` gives `MEAS`, `PARameter1`
/// gives `PAR1`. A mnemonic without lower case is its own short form.
pub(crate) fn short_form(word: &str) -> String {
    let mnemonic = Mnemonic::new(word);
    format!("{}{}", mnemonic.short(), mnemonic.digits())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_and_long_form_match_and_nothing_between() {
        let rows = [
            ("INITiate", "INIT", true),
            ("INITiate", "initiate", true),
            ("INITiate", "INITIA", false),
            ("INITiate", "INI", false),
            ("ABcc", "ab", true),
            ("ABcc", "abcc", true),
            ("ABcc", "abc", false),
            ("AB", "a", false),
            ("PARameter1", "PAR1", true),
            ("PARameter1", "PARAMETER1", true),
            ("PARameter1", "PAR", false),
            ("PARameter1", "PAR2", false),
            ("MOD10A", "mod10a", true),
            ("MOD10A", "mod10", false),
        ];
        for (pattern, word, expected) in rows {
            assert_eq!(
                Mnemonic::new(pattern).matches(word.as_bytes()),
                expected,
                "{pattern} {word}"
            );
        }
    }
}
