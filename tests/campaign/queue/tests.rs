//! The options of a campaign from a queue, and its pieces in a ledger.

use clap::Parser;

use super::*;

#[test]
fn an_option_of_another_form_is_refused() {
    let accepts = |words: &str| {
        let words = format!("campaign --queue nats://host {words}");
        Arguments::try_parse_from(words.split_whitespace()).is_ok()
    };
    for words in [
        "--fill --seeds 5 --chunk 2 --silent-s 5 --deliveries 2",
        "--worker --jobs 2 --within-s 5 --queue-files directory",
        "--gather --seeds 5 --page page.md --within-s 0",
    ] {
        assert!(accepts(words), "{words}");
    }
    for words in [
        "",
        "--fill --worker",
        "--fill --chunk 0",
        "--fill --within-s 5",
        "--worker --seeds 5",
        "--worker --first-seed 5",
        "--worker --until-failed",
        "--worker --deliveries 2",
        "--worker --page page.md",
        "--gather",
        "--gather --page page.md --chunk 5",
        "--worker --engine",
        "--worker --vary",
        "--worker --protocol smoke.toml",
        "--fill --merge ledger.json --page page.md",
    ] {
        assert!(!accepts(words), "{words}");
    }
}

#[test]
fn a_chunk_that_is_played_twice_counts_once_unless_its_runs_differ_and_no_other_piece_is_taken() {
    let page = Path::new("page.md");
    let chunk = Chunk { first: 1, count: 25 };
    let piece = |digest| Piece {
        first_seed: 1,
        seeds: 25,
        jobs: 1,
        seconds: 1.0,
        software: "rigd".to_owned(),
        program: "a".to_owned(),
        counts: Counts { runs: 25, digest, ..Counts::default() },
    };
    let merged = |pieces: Vec<(Chunk, Piece)>, program| {
        let mut all = Ledger::new(ledger::menu());
        merge(&mut all, page, pieces, program).map(|()| all.counts().runs)
    };
    assert_eq!(merged(vec![(chunk, piece(7)), (chunk, piece(7))], "a").unwrap(), 25);
    let differ = merged(vec![(chunk, piece(7)), (chunk, piece(8))], "a");
    assert!(matches!(differ, Err(QueueError::Ledger(LedgerError::Digests { .. }))), "{differ:?}");
    for (chunk, program) in [(Chunk { first: 26, count: 25 }, "a"), (chunk, "b")] {
        let other = merged(vec![(chunk, piece(7))], program);
        assert!(matches!(other, Err(QueueError::Foreign { .. })), "{other:?}");
    }
}
