//! The commands of an instrument, declared as data.
//!
//! ```
//! use rig_scpi::{Node, Tree, command, query, setting};
//!
//! #[derive(Clone, Copy)]
//! enum Meter {
//!     Frequency,
//!     Fetch,
//!     Trigger,
//! }
//!
//! const COMMANDS: &[Node<Meter>] = &[
//!     setting("[:SENSe]:FREQuency[:CW]", Meter::Frequency),
//!     query(":FETCh[:IMPedance][:FORMatted]", Meter::Fetch),
//!     command("*TRG", Meter::Trigger),
//! ];
//! assert!(Tree::new(COMMANDS).is_ok());
//! ```

use std::sync::Arc;

use crate::{
    grammar::mnemonic::split_digits,
    grammar::parse::Header,
    instrument::pattern::{Match, Pattern, PatternFault},
};

/// One command, one query, or both under the same header.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node<C> {
    pattern: &'static str,
    id: C,
    command: Option<Arity>,
    query: Option<Arity>,
}

/// Smallest and largest number of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Arity {
    pub(crate) min: usize,
    pub(crate) max: usize,
}

/// A command without parameters, unless [`Node::takes`] says otherwise.
pub const fn command<C: Copy>(pattern: &'static str, id: C) -> Node<C> {
    Node { pattern, id, command: Some(Arity { min: 0, max: 0 }), query: None }
}

/// A query without parameters, unless [`Node::asks`] says otherwise. The `?` is not written.
pub const fn query<C: Copy>(pattern: &'static str, id: C) -> Node<C> {
    Node { pattern, id, command: None, query: Some(Arity { min: 0, max: 0 }) }
}

/// A command with one parameter, and its query, which takes at most one (`FREQ? MAX`).
pub const fn setting<C: Copy>(pattern: &'static str, id: C) -> Node<C> {
    let command = Some(Arity { min: 1, max: 1 });
    Node { pattern, id, command, query: Some(Arity { min: 0, max: 1 }) }
}

impl<C: Copy> Node<C> {
    /// The command takes from `min` to `max` parameters.
    #[must_use]
    pub const fn takes(mut self, min: usize, max: usize) -> Self {
        self.command = Some(Arity { min, max });
        self
    }

    /// The query takes from `min` to `max` parameters.
    #[must_use]
    pub const fn asks(mut self, min: usize, max: usize) -> Self {
        self.query = Some(Arity { min, max });
        self
    }
}

/// Commands that were checked: every header means one of them or none. A clone is the same tree.
#[derive(Debug, Clone)]
pub struct Tree<C> {
    entries: Arc<[Entry<C>]>,
    // By the capitals a header may begin with; sorted, so that a look-up is a binary search.
    index: Arc<[(Box<[u8]>, usize)]>,
}

#[derive(Debug, Clone)]
struct Entry<C> {
    pattern: Pattern,
    node: Node<C>,
}

/// Why a tree cannot be built.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TreeError {
    /// A pattern is malformed.
    #[error("header pattern `{pattern}`: {fault}")]
    Pattern {
        /// The pattern as declared.
        pattern: &'static str,
        /// The fault of the pattern.
        fault: PatternFault,
    },
    /// Some header would mean two commands.
    #[error("header patterns `{first}` and `{second}` match the same header")]
    Ambiguous {
        /// The pattern declared first.
        first: &'static str,
        /// The pattern declared later.
        second: &'static str,
    },
    /// A command takes fewer parameters than it needs.
    #[error("header pattern `{pattern}`: at least {min} and at most {max} parameters")]
    Arity {
        /// The pattern as declared.
        pattern: &'static str,
        /// Fewest parameters.
        min: usize,
        /// Most parameters.
        max: usize,
    },
}

/// The parts of a header beyond its command.
#[derive(Debug, Clone)]
pub(crate) struct HeaderMatch {
    at: usize,
    pub(crate) arity: Arity,
    /// The command can be set and queried.
    pub(crate) is_setting: bool,
    pub(crate) suffixes: Vec<Option<u32>>,
    pub(crate) is_out_of_range: bool,
}

impl<C: Copy> Tree<C> {
    /// Checks `nodes`.
    ///
    /// # Errors
    /// The first pattern that is malformed, or the first two that some header matches both.
    pub fn new(nodes: &[Node<C>]) -> Result<Self, TreeError> {
        let mut entries: Vec<Entry<C>> = Vec::with_capacity(nodes.len());
        for node in nodes {
            let pattern = Pattern::parse(node.pattern)
                .map_err(|fault| TreeError::Pattern { pattern: node.pattern, fault })?;
            for Arity { min, max } in [node.command, node.query].into_iter().flatten() {
                if max < min {
                    return Err(TreeError::Arity { pattern: node.pattern, min, max });
                }
            }
            let rival = entries.iter().find(|entry| {
                let is_same_kind = (entry.node.command.is_some() && node.command.is_some())
                    || (entry.node.query.is_some() && node.query.is_some());
                is_same_kind && entry.pattern.overlaps(&pattern)
            });
            if let Some(rival) = rival {
                let (first, second) = (rival.node.pattern, node.pattern);
                return Err(TreeError::Ambiguous { first, second });
            }
            entries.push(Entry { pattern, node: *node });
        }
        let mut index: Vec<(Box<[u8]>, usize)> = entries
            .iter()
            .enumerate()
            .flat_map(|(at, entry)| entry.pattern.first_stems().map(move |stem| (stem, at)))
            .map(|(stem, at)| (stem.to_ascii_uppercase().into_bytes().into(), at))
            .collect();
        index.sort_unstable();
        index.dedup();
        Ok(Self { entries: entries.into(), index: index.into() })
    }

    /// Looks up the mnemonics of a whole header, from the root.
    pub(crate) fn find(&self, path: &[u8], header: &Header<'_>) -> Option<(C, HeaderMatch)> {
        let first = path.split(|byte| *byte == b':').next().unwrap_or(path);
        let stem = split_digits(first).0;
        let start = self.index.partition_point(|(known, _)| cmp_upper(known, stem).is_lt());
        self.index[start..]
            .iter()
            .take_while(|(known, _)| known.eq_ignore_ascii_case(stem))
            .find_map(|(_, at)| self.found(*at, path, header))
    }

    /// Beginning of an answer to `header`, if answers repeat their header.
    pub(crate) fn heading(&self, found: &HeaderMatch, path: &[u8]) -> String {
        self.entries[found.at].pattern.canonical(path) + " "
    }

    fn found(&self, at: usize, path: &[u8], header: &Header<'_>) -> Option<(C, HeaderMatch)> {
        let Entry { pattern, node } = &self.entries[at];
        let arity = if header.is_query { node.query? } else { node.command? };
        if pattern.is_common != header.is_common {
            return None;
        }
        let Match { suffixes, is_out_of_range } = pattern.matches(path)?;
        let is_setting = node.command.is_some() && node.query.is_some();
        Some((node.id, HeaderMatch { at, arity, is_setting, suffixes, is_out_of_range }))
    }
}

/// Compares capitals with letters of any case.
fn cmp_upper(capitals: &[u8], word: &[u8]) -> std::cmp::Ordering {
    capitals.iter().copied().cmp(word.iter().map(u8::to_ascii_uppercase))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_in_which_a_header_means_two_things_is_refused() {
        let fault = |nodes: &[Node<u8>]| Tree::new(nodes).expect_err("the tree is ambiguous");
        assert_eq!(
            fault(&[command("A[:B]", 0), command("C", 1), command("A", 2)]),
            TreeError::Ambiguous { first: "A[:B]", second: "A" }
        );
        assert_eq!(
            fault(&[setting("OUTPut#", 0), query("OUTPut1", 1)]),
            TreeError::Ambiguous { first: "OUTPut#", second: "OUTPut1" }
        );
        let fault_of = |pattern| TreeError::Pattern { pattern, fault: PatternFault::AllOptional };
        assert_eq!(fault(&[query("[:A]", 0)]), fault_of("[:A]"));
        assert_eq!(
            fault(&[command("A", 0).takes(2, 1)]),
            TreeError::Arity { pattern: "A", min: 2, max: 1 }
        );
        // A command and a query of the same name may be two things.
        assert!(Tree::new(&[command("A", 0), query("A", 1), command("*A", 2)]).is_ok());
    }

    #[test]
    fn a_look_up_finds_what_a_search_through_all_patterns_finds() {
        let nodes = [
            query("[:SENSe]:FREQuency[:CW]", 0),
            query("SENSe:BAND", 1),
            query("FREQuency:STARt", 2),
            query("F", 3),
            query("FREQ2", 4),
            query("OUTPut#[:STATe]", 5),
            query("Z", 6),
        ];
        let tree = Tree::new(&nodes).expect("no two match the same header");
        let words = ["sens", "SENSE", "freq", "FREQUENCY", "F", "FREQ1", "FREQ2", "outp3", "outp"];
        let mut headers: Vec<String> = words.map(str::to_owned).to_vec();
        for first in words {
            headers.extend(["freq", "cw", "band", "start", "stat"].map(|w| format!("{first}:{w}")));
        }
        let mut n_found = 0;
        for text in &headers {
            let (text, is_common, is_absolute) = (text.as_bytes(), false, false);
            let header = Header { text, is_common, is_absolute, is_query: true };
            let found = tree.find(text, &header).map(|(id, _)| id);
            let searched = nodes.iter().find(|node| {
                Pattern::parse(node.pattern).is_ok_and(|pattern| pattern.matches(text).is_some())
            });
            assert_eq!(found, searched.map(|node| node.id), "{}", text.escape_ascii());
            n_found += u32::from(found.is_some());
        }
        assert!(9 < n_found, "{n_found} headers were found");
    }
}
