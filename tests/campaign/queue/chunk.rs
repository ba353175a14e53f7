//! Chunks of a campaign: seeds in a row, for one menu and one program.

use std::ops::Range;

/// Largest number of chunks of one call of `--fill`.
pub(crate) const CHUNKS_MAX: u64 = 100_000;

/// What plays the seeds: another menu or another program would play something else.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Player {
    /// As in a ledger.
    pub(crate) menu: String,
    /// As in a piece of a ledger.
    pub(crate) program: String,
}

/// Seeds in a row that one worker plays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Chunk {
    pub(crate) first_seed: u64,
    pub(crate) seeds: u64,
}

/// What a message is: its stream, and the first part of its subject that differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Seeds that wait for a worker.
    Chunk,
    /// What a worker has played.
    Piece,
}

impl Kind {
    const fn name(self) -> &'static str {
        match self {
            Self::Chunk => "chunk",
            Self::Piece => "piece",
        }
    }

    /// The name of the stream of these messages.
    pub(crate) const fn stream(self) -> &'static str {
        match self {
            Self::Chunk => "rigd-campaign-chunks",
            Self::Piece => "rigd-campaign-pieces",
        }
    }

    /// The subjects of all of these messages.
    pub(crate) fn subjects(self) -> String {
        format!("rigd.campaign.{}.*.*.*.*", self.name())
    }
}

impl Player {
    /// The name of the consumer that all workers of this player share.
    pub(crate) fn consumer(&self) -> String {
        format!("{}-{}", self.menu, self.program)
    }

    /// The subjects of this player.
    pub(crate) fn subjects(&self, kind: Kind) -> String {
        format!("rigd.campaign.{}.{}.{}.*.*", kind.name(), self.menu, self.program)
    }

    /// The subject of a chunk or its piece.
    pub(crate) fn subject(&self, kind: Kind, chunk: Chunk) -> String {
        let Self { menu, program } = self;
        let Chunk { first_seed, seeds } = chunk;
        format!("rigd.campaign.{}.{menu}.{program}.{first_seed}.{seeds}", kind.name())
    }

    /// The chunk of a subject; `None` if the subject is not one of this player.
    pub(crate) fn chunk(&self, kind: Kind, subject: &str) -> Option<Chunk> {
        let mut parts = subject.rsplit('.');
        let (seeds, first_seed) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        let chunk = Chunk { first_seed, seeds };
        (self.subject(kind, chunk) == subject).then_some(chunk)
    }
}

impl Chunk {
    /// The seeds.
    pub(crate) const fn range(self) -> Range<u64> {
        self.first_seed..self.first_seed.saturating_add(self.seeds)
    }

    /// Whether some seeds are those of another chunk, and others are not.
    pub(crate) fn is_partly(self, other: Self) -> bool {
        self != other && share(&self.range(), &other.range())
    }

    /// Whether these seeds begin or end within the chunk.
    pub(crate) const fn is_cut_by(self, seeds: &Range<u64>) -> bool {
        let own = self.range();
        share(&own, seeds) && !is_within(&own, seeds)
    }
}

/// Whether both have a seed.
const fn share(one: &Range<u64>, other: &Range<u64>) -> bool {
    one.start < other.end && other.start < one.end
}

/// Whether all of these seeds are in others.
pub(crate) const fn is_within(seeds: &Range<u64>, others: &Range<u64>) -> bool {
    others.start <= seeds.start && seeds.end <= others.end
}

/// Cuts seeds into chunks of this size. The last one may be smaller.
pub(crate) fn cut(seeds: Range<u64>, size: u64) -> impl Iterator<Item = Chunk> {
    let size = size.max(1);
    let count = seeds.end.saturating_sub(seeds.start).div_ceil(size);
    (0..count).map(move |number| {
        let first_seed = seeds.start + number * size;
        Chunk { first_seed, seeds: size.min(seeds.end - first_seed) }
    })
}

/// The seeds that no chunk has, in ascending order. Chunks that reach beyond the seeds do not count.
pub(crate) fn missing(
    seeds: Range<u64>,
    played: impl IntoIterator<Item = Chunk>,
) -> Vec<Range<u64>> {
    let is_part = |chunk: &Chunk| is_within(&chunk.range(), &seeds);
    let mut played: Vec<_> = played.into_iter().filter(is_part).collect();
    played.sort_unstable();
    let mut missing = Vec::new();
    let mut next = seeds.start;
    for chunk in played {
        let range = chunk.range();
        if next < range.start {
            missing.push(next..range.start);
        }
        next = next.max(range.end);
    }
    if next < seeds.end {
        missing.push(next..seeds.end);
    }
    missing
}

#[cfg(test)]
mod tests {
    use super::*;

    fn player(menu: &str, program: &str) -> Player {
        Player { menu: menu.to_owned(), program: program.to_owned() }
    }

    const fn chunk(first_seed: u64, seeds: u64) -> Chunk {
        Chunk { first_seed, seeds }
    }

    #[test]
    fn chunks_have_every_seed_once_and_a_longer_range_begins_with_the_same_ones() {
        for (seeds, size) in [(1..101, 25), (7..8, 25), (5..5, 3), (1..102, 25), (3..10, 0)] {
            let chunks: Vec<_> = cut(seeds.clone(), size).collect();
            let all: Vec<_> = chunks.iter().flat_map(|chunk| chunk.range()).collect();
            assert_eq!(all, seeds.clone().collect::<Vec<_>>(), "{seeds:?} by {size}");
            assert!(missing(seeds, chunks).is_empty());
        }
        let (few, many): (Vec<_>, Vec<_>) = (cut(1..51, 25).collect(), cut(1..101, 25).collect());
        assert_eq!(few[..], many[..2]);
        assert_eq!(cut(u64::MAX - 3..u64::MAX, 2).count(), 2);
    }

    #[test]
    fn a_subject_gives_the_chunk_back_to_its_player_alone() {
        let player_a = player("a", "1");
        let subject = player_a.subject(Kind::Chunk, chunk(26, 25));
        assert_eq!(subject, "rigd.campaign.chunk.a.1.26.25");
        assert_eq!(player_a.chunk(Kind::Chunk, &subject), Some(chunk(26, 25)));
        assert_eq!(player_a.chunk(Kind::Piece, &subject), None);
        assert_eq!(player("b", "1").chunk(Kind::Chunk, &subject), None);
        assert_eq!(player("a", "2").chunk(Kind::Chunk, &subject), None);
        for wrong in ["", "25", "rigd.campaign.chunk.a.1.026.25", "rigd.campaign.chunk.a.1.26.-1"] {
            assert_eq!(player_a.chunk(Kind::Chunk, wrong), None, "{wrong}");
        }
    }

    #[test]
    fn missing_seeds_are_those_of_no_chunk_within_the_range() {
        let check = |played: &[Chunk], expected: &[(u64, u64)]| {
            let missing = missing(1..101, played.iter().copied());
            let missing: Vec<_> = missing.iter().map(|seeds| (seeds.start, seeds.end)).collect();
            assert_eq!(missing, expected, "{played:?}");
        };
        check(&[], &[(1, 101)]);
        check(&[chunk(26, 25), chunk(1, 25)], &[(51, 101)]);
        check(&[chunk(1, 25), chunk(51, 25), chunk(51, 25)], &[(26, 51), (76, 101)]);
        check(&[chunk(1, 100), chunk(101, 25)], &[]);
        check(&[chunk(0, 101), chunk(76, 26)], &[(1, 101)]);
    }

    #[test]
    fn a_chunk_is_partly_another_one_if_they_share_seeds_and_differ() {
        assert!(chunk(1, 25).is_partly(chunk(25, 25)));
        assert!(chunk(1, 25).is_partly(chunk(1, 24)));
        assert!(!chunk(1, 25).is_partly(chunk(1, 25)));
        assert!(!chunk(1, 25).is_partly(chunk(26, 25)));
    }

    #[test]
    fn seeds_cut_a_chunk_if_they_begin_or_end_within_it() {
        for (seeds, is_cut) in [
            (1..51, false),
            (26..51, false),
            (1..26, false),
            (51..60, false),
            (30..31, true),
            (1..50, true),
            (27..100, true),
        ] {
            assert_eq!(chunk(26, 25).is_cut_by(&seeds), is_cut, "{seeds:?}");
        }
    }
}
