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

use crate::{
    grammar::Header,
    mnemonic::split_digits,
    pattern::{Pattern, PatternFault},
};

/// One command, one query, or both under the same header.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node<C> {
    pattern: &'static str,
    id: C,
    command: Option<Arity>,
    query: Option<Arity>,
}

/// How many parameters are taken: at least, at most.
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

/// Commands that were checked: every header means one of them or none.
#[derive(Debug, Clone)]
pub struct Tree<C> {
    entries: Vec<Entry<C>>,
    // By the capitals a header may begin with; sorted, so that a look-up is a binary search.
    index: Vec<(Box<[u8]>, usize)>,
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
        /// What is wrong with it.
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

/// What a header was found to mean.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Found<'a, C> {
    pub(crate) id: C,
    pub(crate) arity: Arity,
    /// It can be set and asked for.
    pub(crate) is_setting: bool,
    pub(crate) suffixes: Vec<Option<u32>>,
    pub(crate) is_out_of_range: bool,
    pub(crate) pattern: &'a Pattern,
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
        Ok(Self { entries, index })
    }

    /// Looks up the mnemonics of a whole header, from the root.
    pub(crate) fn find(&self, path: &[u8], header: &Header<'_>) -> Option<Found<'_, C>> {
        let first = path.split(|byte| *byte == b':').next().unwrap_or(path);
        let stem = split_digits(first).0;
        let start = self.index.partition_point(|(known, _)| cmp_upper(known, stem).is_lt());
        self.index[start..]
            .iter()
            .take_while(|(known, _)| known.eq_ignore_ascii_case(stem))
            .find_map(|(_, at)| self.entries[*at].matches(path, header))
    }
}

impl<C: Copy> Entry<C> {
    fn matches(&self, path: &[u8], header: &Header<'_>) -> Option<Found<'_, C>> {
        let arity = if header.is_query { self.node.query? } else { self.node.command? };
        if self.pattern.is_common != header.is_common {
            return None;
        }
        let found = self.pattern.matches(path)?;
        Some(Found {
            id: self.node.id,
            arity,
            is_setting: self.node.command.is_some() && self.node.query.is_some(),
            suffixes: found.suffixes,
            is_out_of_range: found.is_out_of_range,
            pattern: &self.pattern,
        })
    }
}

/// Compares capitals with letters of any case.
fn cmp_upper(capitals: &[u8], word: &[u8]) -> std::cmp::Ordering {
    capitals.iter().copied().cmp(word.iter().map(u8::to_ascii_uppercase))
}
