//! Header patterns as manuals write them: `[:SENSe]:FREQuency[:CW]`, `OUTPut#:STATe`, `*TRG`.

use crate::grammar::mnemonic::{Mnemonic, split_digits};

/// A pattern that was checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Pattern {
    pub(crate) is_common: bool,
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Node {
    mnemonic: Mnemonic<'static>,
    is_optional: bool,
    /// The allowed numbers at `#`.
    suffix: Option<(u32, u32)>,
}

/// Why a pattern is not one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PatternFault {
    /// A mnemonic is missing, has a character that is not allowed, or capitals after lower case.
    #[error("a mnemonic is missing or malformed")]
    Mnemonic,
    /// A mnemonic is longer than the standard allows.
    #[error("a mnemonic is longer than 12 characters")]
    MnemonicTooLong,
    /// Brackets must enclose one node with its colon: `[:NODE]`.
    #[error("brackets must enclose one node with its colon")]
    Brackets,
    /// The range of a suffix is not `#(low:high)`.
    #[error("a suffix must be `#` or `#(low:high)`")]
    Suffix,
    /// Nothing would be left when all optional nodes are left out.
    #[error("every node is optional")]
    AllOptional,
}

/// The parts of a header beyond its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Match {
    /// One for every `#` of the pattern.
    pub(crate) suffixes: Vec<Option<u32>>,
    /// Some suffix is outside its range: −114.
    pub(crate) is_out_of_range: bool,
}

impl Pattern {
    pub(crate) fn parse(text: &'static str) -> Result<Self, PatternFault> {
        if let Some(name) = text.strip_prefix('*') {
            let mnemonic = check(name)?;
            return Ok(Self {
                is_common: true,
                nodes: vec![Node { mnemonic, is_optional: false, suffix: None }],
            });
        }
        let mut nodes = Vec::new();
        let mut rest = text;
        while !rest.is_empty() {
            let (node, tail) = node(rest, nodes.is_empty())?;
            nodes.push(node);
            rest = tail;
        }
        if nodes.iter().all(|node| node.is_optional) {
            return Err(PatternFault::AllOptional);
        }
        Ok(Self { is_common: false, nodes })
    }

    /// Long forms of the mnemonics a header that matches may begin with, without digits.
    pub(crate) fn first_stems(&self) -> impl Iterator<Item = &'static str> {
        let n_first = self.nodes.iter().take_while(|node| node.is_optional).count() + 1;
        self.nodes
            .iter()
            .take(n_first)
            .flat_map(|node| [node.mnemonic.short(), node.mnemonic.long()])
    }

    /// Matches the mnemonics of a header, without a leading colon or asterisk.
    pub(crate) fn matches(&self, header: &[u8]) -> Option<Match> {
        let mut found = Match { suffixes: Vec::new(), is_out_of_range: false };
        if self.is_common {
            return self.nodes[0].mnemonic.matches(header).then_some(found);
        }
        match_nodes(&self.nodes, header, &mut found).then_some(found)
    }

    /// Long form in capitals of what `header`, which matches, names; as instruments answer it.
    pub(crate) fn canonical(&self, header: &[u8]) -> String {
        let mut words = header.split(|byte| *byte == b':').peekable();
        let mut text = String::new();
        for node in &self.nodes {
            let Some(word) = words.peek() else { break };
            if node.is_named_by(word) {
                text.push(if self.is_common { '*' } else { ':' });
                text.push_str(&node.mnemonic.long().to_ascii_uppercase());
                text.extend(split_digits(word).1.iter().map(|&digit| char::from(digit)));
                words.next();
            }
        }
        text
    }

    /// Whether some header matches both patterns.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        match (self.is_common, other.is_common) {
            (true, true) => self.nodes == other.nodes,
            (false, false) => nodes_overlap(&self.nodes, &other.nodes),
            _ => false,
        }
    }
}

/// One node from the front of `text`, with what follows.
fn node(text: &'static str, is_first: bool) -> Result<(Node, &'static str), PatternFault> {
    if let Some(inside) = text.strip_prefix('[') {
        let (inside, tail) = inside.split_once(']').ok_or(PatternFault::Brackets)?;
        let name = match inside.strip_prefix(':') {
            Some(name) => name,
            None if is_first => inside,
            None => return Err(PatternFault::Brackets),
        };
        return Ok((Node { is_optional: true, ..plain_node(name)? }, tail));
    }
    let text = match text.strip_prefix(':') {
        Some(text) => text,
        None if is_first => text,
        None => return Err(PatternFault::Mnemonic),
    };
    // A colon inside `#(1:4)` does not end the node.
    let mut depth = 0;
    let end = text.find(|c| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        depth == 0 && (c == ':' || c == '[')
    });
    let (name, tail) = text.split_at(end.unwrap_or(text.len()));
    Ok((plain_node(name)?, tail))
}

fn plain_node(name: &'static str) -> Result<Node, PatternFault> {
    let Some((name, range)) = name.split_once('#') else {
        return Ok(Node { mnemonic: check(name)?, is_optional: false, suffix: None });
    };
    let mnemonic = check(name)?;
    if !mnemonic.digits().is_empty() {
        return Err(PatternFault::Suffix);
    }
    let suffix = if range.is_empty() {
        (1, u32::MAX)
    } else {
        let range = range.strip_prefix('(').and_then(|range| range.strip_suffix(')'));
        let (low, high) =
            range.and_then(|range| range.split_once(':')).ok_or(PatternFault::Suffix)?;
        let low = low.parse().map_err(|_| PatternFault::Suffix)?;
        let high = high.parse().map_err(|_| PatternFault::Suffix)?;
        if high < low {
            return Err(PatternFault::Suffix);
        }
        (low, high)
    };
    Ok(Node { mnemonic, is_optional: false, suffix: Some(suffix) })
}

fn check(name: &'static str) -> Result<Mnemonic<'static>, PatternFault> {
    if 12 < name.len() {
        return Err(PatternFault::MnemonicTooLong);
    }
    let mnemonic = Mnemonic::new(name);
    let (short, long) = (mnemonic.short(), mnemonic.long());
    let tail = &long[short.len()..];
    let is_word = short.starts_with(|c: char| c.is_ascii_uppercase())
        && short.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
        && tail
            .bytes()
            .all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_');
    if is_word { Ok(mnemonic) } else { Err(PatternFault::Mnemonic) }
}

fn match_nodes(nodes: &[Node], header: &[u8], found: &mut Match) -> bool {
    let Some((node, others)) = nodes.split_first() else { return header.is_empty() };
    let end = header.iter().position(|byte| *byte == b':').unwrap_or(header.len());
    let (word, tail) = (&header[..end], header.get(end + 1..).unwrap_or(&[]));
    let (n_suffixes, was_out_of_range) = (found.suffixes.len(), found.is_out_of_range);
    if !header.is_empty() && match_word(node, word, found) && match_nodes(others, tail, found) {
        return true;
    }
    found.suffixes.truncate(n_suffixes);
    found.is_out_of_range = was_out_of_range;
    if !node.is_optional {
        return false;
    }
    found.suffixes.extend(node.suffix.map(|_| None));
    match_nodes(others, header, found)
}

fn match_word(node: &Node, word: &[u8], found: &mut Match) -> bool {
    if !node.is_named_by(word) {
        return false;
    }
    if let Some((low, high)) = node.suffix {
        let digits = split_digits(word).1;
        let number = (!digits.is_empty()).then(|| suffix_number(digits));
        found.suffixes.push(number);
        found.is_out_of_range |= number.is_some_and(|number| number < low || high < number);
    }
    true
}

fn nodes_overlap(left: &[Node], right: &[Node]) -> bool {
    let (Some((a, left_tail)), Some((b, right_tail))) = (left.split_first(), right.split_first())
    else {
        return left.iter().chain(right).all(|node| node.is_optional);
    };
    (words_overlap(a, b) && nodes_overlap(left_tail, right_tail))
        || (a.is_optional && nodes_overlap(left_tail, right))
        || (b.is_optional && nodes_overlap(left, right_tail))
}

fn words_overlap(a: &Node, b: &Node) -> bool {
    let forms = |node: &Node| {
        let digits = node.mnemonic.digits();
        [node.mnemonic.short(), node.mnemonic.long()].map(|stem| stem.to_owned() + digits)
    };
    forms(a).iter().any(|word| b.is_named_by(word.as_bytes()))
        || forms(b).iter().any(|word| a.is_named_by(word.as_bytes()))
}

/// The numeric suffix of a mnemonic. Without digits it is 1 (SCPI-99, volume 1, 6.2.5.2), in a
/// header as in a pattern.
fn suffix_number(digits: &[u8]) -> u32 {
    if digits.is_empty() {
        return 1;
    }
    digits
        .iter()
        .fold(0, |sum: u32, digit| sum.saturating_mul(10).saturating_add(u32::from(digit - b'0')))
}

impl Node {
    /// Whether `word` is this node.
    fn is_named_by(&self, word: &[u8]) -> bool {
        let (stem, digits) = split_digits(word);
        let own = self.mnemonic.digits().as_bytes();
        let is_number_right = suffix_number(digits) == suffix_number(own);
        self.mnemonic.matches_stem(stem) && (self.suffix.is_some() || is_number_right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn pattern(text: &'static str) -> Pattern {
        Pattern::parse(text).unwrap_or_else(|fault| panic!("`{text}`: {fault}"))
    }

    fn suffixes(text: &'static str, header: &str) -> Option<Vec<Option<u32>>> {
        let found = pattern(text).matches(header.as_bytes())?;
        (!found.is_out_of_range).then_some(found.suffixes)
    }

    #[test]
    fn every_subset_of_optional_nodes_matches_in_order() {
        let text = "ABcc[:BCCdddd][:CDEFGeeeee][:DEF]";
        let optional = [["bcc", "bccdddd"], ["cdefg", "CDEFGEEEEE"], ["def", "DEF"]];
        for subset in 0..8 {
            for form in 0..2 {
                let mut words = vec![["ab", "abcc"][form]];
                let chosen = (0..3).filter(|index| subset >> index & 1 == 1);
                words.extend(chosen.map(|index| optional[index][form]));
                assert_eq!(suffixes(text, &words.join(":")), Some(vec![]), "{words:?}");
                if 2 < words.len() {
                    words[1..].reverse();
                    assert_eq!(suffixes(text, &words.join(":")), None, "{words:?}");
                }
            }
        }
        for header in ["ab:ab", "bcc", "ab:bc", "ab:bcc:bcc", "a", "abc", "ab:def:cdefg"] {
            assert_eq!(suffixes(text, header), None, "{header}");
        }
        assert_eq!(suffixes("[:ABcc]:AACddd", "aac"), Some(vec![]));
        assert_eq!(suffixes("[:ABcc]:AACddd", "ab:aac"), Some(vec![]));
        assert_eq!(suffixes("[:ABcc]:AACddd", "ab"), None);
        // Backtracking: the optional node is named like the one behind it.
        assert_eq!(suffixes("[:A]:A[:B]", "a"), Some(vec![]));
        assert_eq!(suffixes("[:A]:A[:B]", "a:a:b"), Some(vec![]));
    }

    #[test]
    fn suffixes_are_numbers_at_the_end_and_within_their_range() {
        let text = ":OUTPut#[:MODulation#(2:3)]:FM";
        assert_eq!(suffixes(text, "OUTP3:MOD2:FM"), Some(vec![Some(3), Some(2)]));
        assert_eq!(suffixes(text, "OUTPUT:FM"), Some(vec![None, None]));
        assert_eq!(suffixes(text, "OUTP10:MODULATION:FM"), Some(vec![Some(10), None]));
        for header in ["OUTP0:FM", "OUTP:MOD1:FM", "OUTP:MOD4:FM", "OUTP99999999999:MOD9:FM"] {
            let found = pattern(text).matches(header.as_bytes()).expect("the name matches");
            assert!(found.is_out_of_range, "{header}");
        }
        assert_eq!(suffixes(text, "OUT10P:FM"), None);
        assert_eq!(suffixes(":PARameter1", "par1"), Some(vec![]));
        assert_eq!(suffixes(":TRIGger1[:SEQuence1]:SOURce", "trig:seq:sour"), Some(vec![]));
        assert_eq!(suffixes(":TRIGger1[:SEQuence1]:SOURce", "TRIGGER1:SOUR1"), Some(vec![]));
        assert_eq!(suffixes(":TRIGger1", "trig01"), Some(vec![]));
        assert_eq!(suffixes(":TRIGger1", "trig2"), None);
        assert_eq!(suffixes(":TRIGger2", "trig"), None);
        assert_eq!(suffixes(":FREQuency:CW", "freq1:cw1"), Some(vec![]));
        assert_eq!(suffixes(":FREQuency:CW", "freq2:cw"), None);
        assert_eq!(suffixes("*IDN", "idn1"), None);
        // A suffix of a node that was tried and left is forgotten.
        assert_eq!(suffixes("[:A#]:A:B", "a9:b"), None);
        assert_eq!(suffixes("[:A#(1:2)]:A#:B", "a9:b"), Some(vec![None, Some(9)]));
    }

    #[test]
    fn patterns_that_are_none_are_refused() {
        let rows = [
            ("", PatternFault::AllOptional),
            ("[:A][:B]", PatternFault::AllOptional),
            (":", PatternFault::Mnemonic),
            ("A::B", PatternFault::Mnemonic),
            ("A B", PatternFault::Mnemonic),
            ("1A", PatternFault::Mnemonic),
            ("abc", PatternFault::Mnemonic),
            ("ABcD", PatternFault::Mnemonic),
            ("A?", PatternFault::Mnemonic),
            ("*", PatternFault::Mnemonic),
            ("*IDN?", PatternFault::Mnemonic),
            ("A[:B", PatternFault::Brackets),
            ("A[B]", PatternFault::Brackets),
            ("A[:B:C]", PatternFault::Mnemonic),
            ("A]", PatternFault::Mnemonic),
            ("ABCDEFGHIJKLM", PatternFault::MnemonicTooLong),
            ("A#1", PatternFault::Suffix),
            ("A1#", PatternFault::Suffix),
            ("A#(1:)", PatternFault::Suffix),
            ("A#(2:1)", PatternFault::Suffix),
        ];
        for (text, fault) in rows {
            assert_eq!(Pattern::parse(text), Err(fault), "{text}");
        }
    }

    #[test]
    fn patterns_overlap_when_some_header_matches_both() {
        let rows = [
            ("A:B", "A:B", true),
            ("A:B", "A:C", false),
            ("A[:B]", "A", true),
            ("A[:B]", "A:B", true),
            ("A[:B]", "A:C", false),
            ("[:A]:B", "B[:C]", true),
            ("[:A]:B", "C:B", false),
            ("ABcc", "AB", true),
            ("ABcc", "ABCC", true),
            ("ABcc", "ABC", false),
            ("A#", "A1", true),
            ("A#", "A", true),
            ("A1", "A2", false),
            ("A1", "A", true),
            ("A2", "A", false),
            ("*A1", "*A", false),
            ("*TRG", "TRG", false),
            ("[:A][:B]:C", "[:B]:C[:D]", true),
        ];
        for (left, right, expected) in rows {
            let (left, right) = (pattern(left), pattern(right));
            assert_eq!(left.overlaps(&right), expected, "{left:?} {right:?}");
            assert_eq!(right.overlaps(&left), expected, "{right:?} {left:?}");
        }
    }

    #[test]
    fn answers_repeat_the_long_form_of_what_was_named() {
        let rows = [
            ("[:SENSe]:FREQuency[:CW]", "freq", ":FREQUENCY"),
            ("[:SENSe]:FREQuency[:CW]", "sens:freq:cw", ":SENSE:FREQUENCY:CW"),
            (":OUTPut#[:STATe]", "outp2", ":OUTPUT2"),
            (":PARameter1", "par1", ":PARAMETER1"),
            (":PARameter1", "par", ":PARAMETER"),
            ("*ESE", "ese", "*ESE"),
        ];
        for (text, header, expected) in rows {
            assert_eq!(pattern(text).canonical(header.as_bytes()), expected);
        }
    }
}
