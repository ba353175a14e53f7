//! The queue on a nats-server of its own, with workers that play nothing.

use std::{
    path::Path,
    sync::atomic::{AtomicU64, Ordering},
    time::Duration,
};

use clap::Parser;
use rig_hub::{Authority, live::NatsServer};
use tempfile::TempDir;

use super::{
    chunk::{Chunk, Kind, Player, cut},
    error::QueueError,
    server::{Filled, Known, Queue, Redelivery},
    work::{Next, Taken},
};
use crate::{
    Arguments,
    campaign::Counts,
    ledger::{Ledger, LedgerError, Piece},
};

/// Time after which a chunk of a worker that is gone goes to another one. No test waits for it: each waits for what comes.
const SILENT: Duration = Duration::from_millis(300);
/// Longer than all that is waited for.
const WITHIN: Duration = Duration::from_secs(30);
const REDELIVERY: Redelivery = Redelivery { after: SILENT, deliveries: 2 };

/// The menu, whose digest takes long.
const MENU: &str = "menu";

/// A server that can be killed and started again.
struct Site {
    directory: TempDir,
    port: u16,
    server: Option<NatsServer>,
}

impl Site {
    fn new() -> Self {
        let (directory, port) = (tempfile::tempdir().unwrap(), NatsServer::free_port().unwrap());
        let mut site = Self { directory, port, server: None };
        site.start("");
        site
    }

    /// Starts the server with `JetStream` and further lines of its configuration.
    fn start(&mut self, settings: &str) {
        let store = self.directory.path().join("jetstream");
        self.start_bare(&format!("jetstream {{ store_dir: {store:?} }}\n{settings}"));
    }

    fn start_bare(&mut self, settings: &str) {
        let text = format!("listen: \"127.0.0.1:{}\"\n{settings}", self.port);
        self.server = Some(NatsServer::with(self.directory.path(), &text).unwrap());
    }

    fn kill(&mut self) {
        self.server = None;
    }

    fn connect(&self, program: &str) -> Result<Queue, QueueError> {
        let server = format!("nats://127.0.0.1:{}", self.port).parse().unwrap();
        let player = Player { menu: MENU.to_owned(), program: program.to_owned() };
        Queue::connect(&server, None, player)
    }

    fn queue(&self) -> Queue {
        self.connect("a").unwrap()
    }
}

/// Chunks of 25 seeds.
fn chunks(count: u64) -> Vec<Chunk> {
    cut(1..1 + 25 * count, 25).collect()
}

/// What a worker would have played, with a digest of all runs.
fn piece(chunk: Chunk, digest: u64) -> Piece {
    let Chunk { first_seed, seeds } = chunk;
    let counts = Counts { runs: seeds, digest, ..Counts::default() };
    let (software, program) = ("rigd".to_owned(), "a".to_owned());
    Piece { first_seed, seeds, jobs: 1, seconds: 1.0, software, program, counts }
}

#[track_caller]
fn take(queue: &Queue) -> Taken {
    match queue.take(WITHIN).unwrap() {
        Next::Taken(taken) => *taken,
        other => panic!("{other:?}"),
    }
}

/// Plays all that is left, and returns the number of chunks.
fn play_all(queue: &Queue) -> u64 {
    let count = AtomicU64::new(0);
    super::work(queue, WITHIN, |chunk| {
        count.fetch_add(1, Ordering::Relaxed);
        piece(chunk, chunk.first_seed)
    })
    .unwrap();
    count.into_inner()
}

#[track_caller]
fn merged(pieces: &[Piece]) -> Ledger {
    let mut ledger = Ledger::new(MENU.to_owned());
    let other = Ledger { pieces: pieces.to_vec(), ..Ledger::new(MENU.to_owned()) };
    ledger.merge(Path::new("page.md"), other).unwrap();
    ledger
}

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
        "--worker --deliveries 2",
        "--worker --page page.md",
        "--gather",
        "--gather --page page.md --chunk 5",
        "--worker --engine",
        "--fill --merge ledger.json --page page.md",
    ] {
        assert!(!accepts(words), "{words}");
    }
}

#[test]
#[ignore = "starts a nats-server"]
fn a_queue_that_is_filled_twice_has_each_chunk_once_until_it_is_played() {
    let site = Site::new();
    let (one, two) = (site.queue(), site.queue());
    let filled = |queue: &Queue, count| {
        let Filled { added, queued, played } = queue.fill(&chunks(count), REDELIVERY).unwrap();
        (added, queued, played)
    };
    assert_eq!(filled(&one, 3), (3, 0, 0));
    assert_eq!(filled(&two, 4), (1, 3, 0));
    let taken = take(&one);
    assert_eq!(filled(&two, 4), (0, 4, 0));
    one.finish(&taken, &piece(taken.chunk, taken.chunk.first_seed)).unwrap();
    assert_eq!(filled(&one, 4), (0, 3, 1));
    assert_eq!(play_all(&two), 3);
    assert_eq!(filled(&one, 5), (1, 0, 4));
    let ledger = merged(&one.gather(&(1..101), WITHIN).unwrap());
    assert_eq!((ledger.pieces.len(), ledger.counts().runs), (4, 100));

    for (first_seed, seeds) in [(90, 25), (1, 24), (1, 26), (2, 3), (0, 200), (105, 1)] {
        let refused = one.fill(&[Chunk { first_seed, seeds }], REDELIVERY);
        assert!(matches!(refused, Err(QueueError::Overlap { .. })), "{refused:?}");
    }
    let late = two.gather(&(1..126), Duration::ZERO).unwrap_err();
    let expected =
        "seeds 101 to 125 have no piece after 0 s; 1 chunks wait for a worker, and 0 were";
    assert!(late.to_string().starts_with(expected), "{late}");
    play_all(&one);
    let lost = two.gather(&(1..151), WITHIN).unwrap_err();
    let expected = "seeds 126 to 150 are not in the queue, and have no piece: --fill it again";
    assert_eq!(lost.to_string(), expected);
}

#[test]
#[ignore = "starts a nats-server"]
fn a_chunk_whose_workers_are_gone_goes_to_others_and_is_given_up_by_name() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(2), REDELIVERY).unwrap();
    // The first chunk alone is left.
    let (first, second) = (take(&queue), take(&queue));
    queue.finish(&second, &piece(second.chunk, 0)).unwrap();
    assert_eq!((first.chunk.first_seed, first.delivery), (1, 1));
    drop(first);
    let again = take(&queue);
    assert_eq!((again.chunk.first_seed, again.delivery, again.deliveries), (1, 2, 2));
    drop(again);
    assert!(matches!(queue.take(WITHIN).unwrap(), Next::Empty));
    let given_up = queue.gather(&(1..51), WITHIN).unwrap_err();
    let expected = "seeds 1 to 25 were given up after 2 workers each";
    assert!(given_up.to_string().starts_with(expected), "{given_up}");
    let filled = queue.fill(&chunks(2), REDELIVERY).unwrap();
    assert_eq!(filled, Filled { added: 1, queued: 0, played: 1 });
    assert_eq!(play_all(&queue), 1);
    assert_eq!(queue.gather(&(1..51), WITHIN).unwrap().len(), 2);
}

/// The chunk of a worker that says nothing comes back. One that was taken before it would have come back as well.
#[test]
#[ignore = "starts a nats-server"]
fn a_chunk_that_takes_long_stays_with_its_worker() {
    let site = Site::new();
    let (one, two) = (site.queue(), site.queue());
    one.fill(&chunks(2), REDELIVERY).unwrap();
    let (kept, left) = (take(&one), take(&one));
    let chunk = left.chunk;
    drop(left);
    let again = take(&two);
    assert_eq!((again.chunk, again.delivery), (chunk, 2));
    two.finish(&again, &piece(chunk, 0)).unwrap();
    assert!(matches!(two.take(Duration::ZERO).unwrap(), Next::WithOthers(1)));
    one.finish(&kept, &piece(kept.chunk, 0)).unwrap();
    assert!(matches!(two.take(WITHIN).unwrap(), Next::Empty));
}

#[test]
#[ignore = "starts a nats-server"]
fn who_fills_what_another_one_fills_looks_again() {
    let site = Site::new();
    let (one, two) = (site.queue(), site.queue());
    // Both have looked before one of them adds: in a new queue, and in one that has had chunks.
    for first_seed in [1, 201] {
        let cut = |size| cut(first_seed..first_seed + 100, size).collect::<Vec<_>>();
        let look = |queue: &Queue| queue.runtime.block_on(queue.look(REDELIVERY)).unwrap();
        let add = |queue: &Queue, chunks: &[Chunk], known: &mut Known| {
            queue.runtime.block_on(queue.add(chunks, known)).unwrap()
        };
        let (mut known, mut late) = (look(&one), look(&two));
        let filled = add(&one, &cut(25), &mut known).unwrap();
        assert_eq!(filled, Filled { added: 4, queued: 0, played: 0 });
        assert_eq!(add(&two, &cut(20), &mut late), None);
        assert_eq!(add(&two, &cut(25), &mut look(&two)).unwrap().queued, 4);
        let refused = two.fill(&cut(20), REDELIVERY);
        assert!(matches!(refused, Err(QueueError::Overlap { .. })), "{refused:?}");
    }
    assert_eq!(play_all(&one), 8);
}

#[test]
#[ignore = "starts a nats-server"]
fn of_two_that_fill_at_once_each_chunk_is_added_by_one() {
    let site = Site::new();
    let queues = [site.queue(), site.queue()];
    // Each is behind the other one at most once for each of its chunks.
    let filled = std::thread::scope(|scope| {
        let fill = |queue| scope.spawn(move || Queue::fill(queue, &chunks(10), REDELIVERY));
        queues.each_ref().map(fill).map(|filled| filled.join().unwrap().unwrap())
    });
    assert_eq!(filled[0].added + filled[1].added, 10, "{filled:?}");
    assert_eq!(play_all(&queues[0]), 10);
}

#[test]
#[ignore = "starts a nats-server"]
fn seeds_that_cut_a_chunk_are_not_waited_for() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(2), REDELIVERY).unwrap();
    let refuses = |seeds: std::ops::Range<u64>, expected: &str| {
        let refused = queue.gather(&seeds, WITHIN).unwrap_err().to_string();
        assert!(refused.starts_with(expected) && !refused.contains("--fill"), "{refused}");
    };
    refuses(1..31, "seeds 1 to 30 begin or end within the chunk of seeds 26 to 50: --gather the");
    play_all(&queue);
    refuses(2..51, "seeds 2 to 50 begin or end within the chunk of seeds 1 to 25: --gather the");
    assert_eq!(queue.gather(&(26..51), WITHIN).unwrap().len(), 1);
}

#[test]
#[ignore = "starts a nats-server"]
fn a_worker_with_another_program_takes_nothing() {
    let site = Site::new();
    let (queue, other) = (site.queue(), site.connect("b").unwrap());
    assert!(matches!(other.take(WITHIN), Err(QueueError::NotFilled { .. })));
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    for refused in [other.take(WITHIN).unwrap_err(), other.gather(&(1..26), WITHIN).unwrap_err()] {
        let QueueError::NotFilled { others, .. } = &refused else { panic!("{refused}") };
        assert_eq!(others[..], ["menu-a"]);
    }
    // Also when there are chunks for both.
    assert_eq!(other.fill(&chunks(2), REDELIVERY).unwrap().added, 2);
    assert_eq!((play_all(&queue), play_all(&other)), (1, 2));
    // Its pieces say that they are of the program `a`.
    assert!(matches!(other.gather(&(1..51), WITHIN), Err(QueueError::Foreign { .. })));
}

#[test]
#[ignore = "starts a nats-server"]
fn a_server_that_is_killed_while_a_chunk_is_played_is_waited_for() {
    let mut site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(2), Redelivery { after: WITHIN, deliveries: 2 }).unwrap();
    let taken = take(&queue);
    site.kill();
    site.start("");
    queue.finish(&taken, &piece(taken.chunk, 0)).unwrap();
    assert_eq!(play_all(&queue), 1);
    assert_eq!(queue.gather(&(1..51), WITHIN).unwrap().len(), 2);
}

#[test]
#[ignore = "starts a nats-server"]
fn a_server_that_stays_away_is_an_error() {
    let mut site = Site::new();
    let mut queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let taken = take(&queue);
    site.kill();
    queue.patience = Duration::from_millis(200);
    queue.context.set_timeout(Duration::from_millis(100));
    let refused = queue.finish(&taken, &piece(taken.chunk, 0)).unwrap_err();
    assert!(matches!(refused, QueueError::Server { .. }), "{refused}");
    assert!(matches!(queue.take(WITHIN), Err(QueueError::Server { .. })));
    assert!(matches!(site.connect("a"), Err(QueueError::Connect { .. })));
    site.start_bare("");
    assert!(matches!(site.connect("a"), Err(QueueError::NoJetStream { .. })));
}

#[test]
#[ignore = "starts a nats-server"]
fn a_chunk_that_is_played_twice_counts_once_unless_its_runs_differ() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let taken = take(&queue);
    queue.finish(&taken, &piece(taken.chunk, 7)).unwrap();
    queue.finish(&taken, &piece(taken.chunk, 7)).unwrap();
    let pieces = queue.gather(&(1..26), WITHIN).unwrap();
    assert_eq!((pieces.len(), merged(&pieces).counts().runs), (2, 25));
    queue.finish(&taken, &piece(taken.chunk, 8)).unwrap();
    let pieces = queue.gather(&(1..26), WITHIN).unwrap();
    let merged = Ledger::new(MENU.to_owned())
        .merge(Path::new("page.md"), Ledger { pieces, ..Ledger::new(MENU.to_owned()) });
    assert!(matches!(merged, Err(LedgerError::Digests { .. })), "{merged:?}");
}

#[test]
#[ignore = "starts a nats-server"]
fn what_is_not_a_piece_is_named() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let subject = queue.player.subject(Kind::Piece, chunks(1)[0]);
    queue.runtime.block_on(async {
        queue.context.publish(subject, "{}".into()).await.unwrap().await.unwrap();
    });
    let refused = queue.gather(&(1..26), WITHIN).unwrap_err();
    assert!(matches!(&refused, QueueError::Piece { seeds, .. } if *seeds == (1..26)), "{refused}");
}

#[test]
#[ignore = "starts a nats-server"]
fn a_server_may_ask_for_a_certificate_and_a_password() {
    let mut site = Site::new();
    let files = site.directory.path().join("files");
    let authority = Authority::open_or_make(&files).unwrap();
    let [certificate, key] = authority.sign_server(vec!["127.0.0.1".to_owned()], "nats").unwrap();
    site.kill();
    let authority_file = authority.certificate();
    site.start(&format!(
        "tls {{ cert_file: {certificate:?}, key_file: {key:?}, ca_file: {authority_file:?}, verify: true }}\n\
         authorization {{ user: lab, password: right }}\n"
    ));
    let connect = |password: &str, files: Option<&Path>| {
        let server = format!("tls://lab:{password}@127.0.0.1:{}", site.port).parse().unwrap();
        let player = Player { menu: MENU.to_owned(), program: "a".to_owned() };
        Queue::connect(&server, files, player)
    };
    // Without its own certificate.
    connect("right", Some(&files)).unwrap_err();
    authority.sign_client("worker", &files, "worker").unwrap();
    connect("right", None).unwrap_err();
    let refused = connect("wrong", Some(&files)).unwrap_err().to_string();
    assert!(refused.contains("authorization") && !refused.contains("wrong"), "{refused}");
    let queue = connect("right", Some(&files)).unwrap();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    assert_eq!(play_all(&queue), 1);
}

#[test]
#[ignore = "starts a nats-server"]
fn a_chunk_is_acknowledged_only_when_its_piece_is_stored() {
    let site = Site::new();
    let mut queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    queue.patience = Duration::ZERO;
    let delete = async { queue.context.delete_stream(Kind::Piece.stream()).await.unwrap() };
    queue.runtime.block_on(delete);
    let taken = take(&queue);
    let refused = queue.finish(&taken, &piece(taken.chunk, 0)).unwrap_err();
    assert!(matches!(refused, QueueError::Server { .. }), "{refused}");
    drop(taken);
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let again = take(&queue);
    assert_eq!(again.delivery, 2);
    queue.finish(&again, &piece(again.chunk, 0)).unwrap();
    assert_eq!(queue.gather(&(1..26), WITHIN).unwrap().len(), 1);
}
