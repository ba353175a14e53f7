//! Chunks: numbers in a row, for one work and one program.

use std::{fmt, ops::Range};

/// Largest number of chunks of one filling.
pub const CHUNKS_MAX: u64 = 100_000;

/// Work that is cut into chunks, and the program that does it: another work or another program would compute something else.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Work {
    /// The kind of work, such as `campaign`. Each kind has streams of its own.
    pub kind: &'static str,
    /// What its numbers are, as a noun in messages: `seed`.
    pub noun: &'static str,
    /// How a chunk is computed without a queue, for messages.
    pub alone: &'static str,
    /// What the numbers mean, for messages.
    pub title: String,
    /// A digest of what the numbers mean.
    pub content: String,
    /// A digest of the program.
    pub program: String,
}

/// Numbers in a row that one worker computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Chunk {
    /// The first number.
    pub first: u64,
    /// How many there are.
    pub count: u64,
}

/// What a message is: its stream, and the first part of its subject that differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Numbers that wait for a worker.
    Chunk,
    /// What a worker has computed.
    Piece,
}

impl Kind {
    const fn name(self) -> &'static str {
        match self {
            Self::Chunk => "chunk",
            Self::Piece => "piece",
        }
    }
}

impl Work {
    /// The name of the stream of these messages of all works of this kind.
    pub(crate) fn stream(&self, kind: Kind) -> String {
        format!("rigd-{}-{}s", self.kind, kind.name())
    }

    /// The subjects of that stream.
    pub(crate) fn stream_subjects(&self, kind: Kind) -> String {
        format!("rigd.{}.{}.*.*.*.*", self.kind, kind.name())
    }

    /// The name of the consumer that all workers share.
    pub(crate) fn consumer(&self) -> String {
        format!("{}-{}", self.content, self.program)
    }

    /// The subjects of this work.
    pub(crate) fn subjects(&self, kind: Kind) -> String {
        let Self { content, program, .. } = self;
        format!("rigd.{}.{}.{content}.{program}.*.*", self.kind, kind.name())
    }

    /// The subject of a chunk or its piece.
    pub(crate) fn subject(&self, kind: Kind, chunk: Chunk) -> String {
        let Self { content, program, .. } = self;
        let Chunk { first, count } = chunk;
        format!("rigd.{}.{}.{content}.{program}.{first}.{count}", self.kind, kind.name())
    }

    /// The chunk of a subject; `None` if the subject is not one of this work.
    pub(crate) fn chunk(&self, kind: Kind, subject: &str) -> Option<Chunk> {
        let mut parts = subject.rsplit('.');
        let (count, first) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        let chunk = Chunk { first, count };
        (self.subject(kind, chunk) == subject).then_some(chunk)
    }

    /// These numbers.
    pub(crate) fn numbers(&self, numbers: &Range<u64>) -> Numbers {
        Numbers { noun: self.noun, ranges: vec![numbers.clone()] }
    }

    /// The numbers of these ranges.
    pub(crate) const fn all_numbers(&self, ranges: Vec<Range<u64>>) -> Numbers {
        Numbers { noun: self.noun, ranges }
    }
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} with the program {}", self.title, self.program)
    }
}

/// Largest number of ranges that are named.
const RANGES_NAMED: usize = 20;

/// Numbers of a work, as messages name them: `seeds 1 to 25, 51 to 75`.
#[derive(Debug)]
pub struct Numbers {
    pub(crate) noun: &'static str,
    ranges: Vec<Range<u64>>,
}

impl fmt::Display for Numbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { noun, ranges } = self;
        let is_one = |range: &Range<u64>| range.end.saturating_sub(range.start) == 1;
        let plural = if matches!(&ranges[..], [one] if is_one(one)) { "" } else { "s" };
        write!(f, "{noun}{plural}")?;
        for (index, range) in ranges.iter().take(RANGES_NAMED).enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(f, "{comma} {}", range.start)?;
            if !is_one(range) {
                write!(f, " to {}", range.end.saturating_sub(1))?;
            }
        }
        match ranges.len().saturating_sub(RANGES_NAMED) {
            0 => Ok(()),
            more => write!(f, " and {more} ranges more"),
        }
    }
}

impl Chunk {
    /// The numbers.
    pub const fn range(self) -> Range<u64> {
        self.first..self.first.saturating_add(self.count)
    }

    /// Whether some numbers are those of another chunk, and others are not.
    pub(crate) fn is_partly(self, other: Self) -> bool {
        self != other && share(&self.range(), &other.range())
    }

    /// Whether these numbers begin or end within the chunk.
    pub(crate) const fn is_cut_by(self, numbers: &Range<u64>) -> bool {
        let own = self.range();
        share(&own, numbers) && !is_within(&own, numbers)
    }
}

/// Whether both have a number.
const fn share(one: &Range<u64>, other: &Range<u64>) -> bool {
    one.start < other.end && other.start < one.end
}

/// Whether all of these numbers are in others.
pub(crate) const fn is_within(numbers: &Range<u64>, others: &Range<u64>) -> bool {
    others.start <= numbers.start && numbers.end <= others.end
}

/// Cuts numbers into chunks of this size. The last one may be smaller.
pub fn cut(numbers: Range<u64>, size: u64) -> impl Iterator<Item = Chunk> {
    let size = size.max(1);
    let count = numbers.end.saturating_sub(numbers.start).div_ceil(size);
    (0..count).map(move |number| {
        let first = numbers.start + number * size;
        Chunk { first, count: size.min(numbers.end - first) }
    })
}

/// The numbers that no chunk has, in ascending order. Chunks that reach beyond the numbers do not count.
pub(crate) fn missing(
    numbers: Range<u64>,
    found: impl IntoIterator<Item = Chunk>,
) -> Vec<Range<u64>> {
    let is_part = |chunk: &Chunk| is_within(&chunk.range(), &numbers);
    let mut found: Vec<_> = found.into_iter().filter(is_part).collect();
    found.sort_unstable();
    let mut missing = Vec::new();
    let mut next = numbers.start;
    for chunk in found {
        let range = chunk.range();
        if next < range.start {
            missing.push(next..range.start);
        }
        next = next.max(range.end);
    }
    if next < numbers.end {
        missing.push(next..numbers.end);
    }
    missing
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work(content: &str, program: &str) -> Work {
        let [content, program] = [content, program].map(str::to_owned);
        let title = format!("the menu {content}");
        Work { kind: "campaign", noun: "seed", alone: "play them alone", title, content, program }
    }

    const fn chunk(first: u64, count: u64) -> Chunk {
        Chunk { first, count }
    }

    #[test]
    fn chunks_have_every_number_once_and_a_longer_range_begins_with_the_same_ones() {
        for (numbers, size) in [(1..101, 25), (7..8, 25), (5..5, 3), (1..102, 25), (3..10, 0)] {
            let chunks: Vec<_> = cut(numbers.clone(), size).collect();
            let all: Vec<_> = chunks.iter().flat_map(|chunk| chunk.range()).collect();
            assert_eq!(all, numbers.clone().collect::<Vec<_>>(), "{numbers:?} by {size}");
            assert!(missing(numbers, chunks).is_empty());
        }
        let (few, many): (Vec<_>, Vec<_>) = (cut(1..51, 25).collect(), cut(1..101, 25).collect());
        assert_eq!(few[..], many[..2]);
        assert_eq!(cut(u64::MAX - 3..u64::MAX, 2).count(), 2);
    }

    #[test]
    fn a_subject_gives_the_chunk_back_to_its_work_alone() {
        let work_a = work("a", "1");
        let subject = work_a.subject(Kind::Chunk, chunk(26, 25));
        assert_eq!(subject, "rigd.campaign.chunk.a.1.26.25");
        assert_eq!(work_a.chunk(Kind::Chunk, &subject), Some(chunk(26, 25)));
        assert_eq!(work_a.chunk(Kind::Piece, &subject), None);
        assert_eq!(work("b", "1").chunk(Kind::Chunk, &subject), None);
        assert_eq!(work("a", "2").chunk(Kind::Chunk, &subject), None);
        for wrong in ["", "25", "rigd.campaign.chunk.a.1.026.25", "rigd.campaign.chunk.a.1.26.-1"] {
            assert_eq!(work_a.chunk(Kind::Chunk, wrong), None, "{wrong}");
        }
    }

    #[test]
    fn missing_numbers_are_those_of_no_chunk_within_the_range() {
        let check = |found: &[Chunk], expected: &[(u64, u64)]| {
            let missing = missing(1..101, found.iter().copied());
            let missing: Vec<_> =
                missing.iter().map(|numbers| (numbers.start, numbers.end)).collect();
            assert_eq!(missing, expected, "{found:?}");
        };
        check(&[], &[(1, 101)]);
        check(&[chunk(26, 25), chunk(1, 25)], &[(51, 101)]);
        check(&[chunk(1, 25), chunk(51, 25), chunk(51, 25)], &[(26, 51), (76, 101)]);
        check(&[chunk(1, 100), chunk(101, 25)], &[]);
        check(&[chunk(0, 101), chunk(76, 26)], &[(1, 101)]);
    }

    #[test]
    fn a_chunk_is_partly_another_one_if_they_share_numbers_and_differ() {
        assert!(chunk(1, 25).is_partly(chunk(25, 25)));
        assert!(chunk(1, 25).is_partly(chunk(1, 24)));
        assert!(!chunk(1, 25).is_partly(chunk(1, 25)));
        assert!(!chunk(1, 25).is_partly(chunk(26, 25)));
    }

    #[test]
    fn numbers_cut_a_chunk_if_they_begin_or_end_within_it() {
        for (numbers, is_cut) in [
            (1..51, false),
            (26..51, false),
            (1..26, false),
            (51..60, false),
            (30..31, true),
            (1..50, true),
            (27..100, true),
        ] {
            assert_eq!(chunk(26, 25).is_cut_by(&numbers), is_cut, "{numbers:?}");
        }
    }

    #[test]
    fn numbers_are_named_with_their_noun_and_a_bound() {
        let name = |ranges: &[Range<u64>]| work("a", "1").all_numbers(ranges.to_vec()).to_string();
        for (ranges, expected) in
            [([1..26, 30..31], "seeds 1 to 25, 30"), ([1..4, 7..8], "seeds 1 to 3, 7")]
        {
            assert_eq!(name(&ranges), expected);
        }
        let one = |range| name(&[range]);
        assert_eq!([one(1..26), one(7..8)], ["seeds 1 to 25", "seed 7"]);
        let many: Vec<_> = (0..23).map(|number| 10 * number..10 * number + 1).collect();
        assert!(name(&many).ends_with(", 180, 190 and 3 ranges more"), "{}", name(&many));
    }
}
