//! The queue on a nats-server of its own, with workers that compute nothing.

use std::{io, ops::Range, path::Path, time::Duration};

use rig_hub::{Authority, live::NatsServer};
use tempfile::TempDir;

use crate::{
    chunk::{Chunk, Kind, Work, cut},
    error::QueueError,
    server::{Filled, Known, Queue, Redelivery},
    work::{Next, Taken},
};

/// Time after which a chunk of a worker that is gone goes to another one. No test waits for it: each waits for what comes.
const SILENT: Duration = Duration::from_millis(300);
/// Longer than all that is waited for.
const WITHIN: Duration = Duration::from_secs(30);
const REDELIVERY: Redelivery = Redelivery { after: Some(SILENT), deliveries: Some(2) };

/// The work of a program.
fn work(program: &str) -> Work {
    let [title, content] = ["the menu x", "menu"].map(str::to_owned);
    let program = program.to_owned();
    Work { kind: "campaign", noun: "seed", alone: "play them alone", title, content, program }
}

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
        Queue::connect(&server, None, work(program))
    }

    fn queue(&self) -> Queue {
        self.connect("a").unwrap()
    }
}

/// Chunks of 25 numbers.
fn chunks(count: u64) -> Vec<Chunk> {
    cut(1..1 + 25 * count, 25).collect()
}

/// What a worker would have computed: the numbers, and a result.
type Piece = (u64, u64, f64);

const fn piece(chunk: Chunk, result: f64) -> Piece {
    (chunk.first, chunk.count, result)
}

#[track_caller]
fn take(queue: &Queue) -> Taken {
    match queue.take(WITHIN).unwrap() {
        Next::Taken(taken) => *taken,
        other => panic!("{other:?}"),
    }
}

/// Error of a worker.
#[derive(Debug, thiserror::Error)]
enum WorkerError {
    #[error(transparent)]
    Queue(#[from] QueueError),
    #[error(transparent)]
    Output(#[from] io::Error),
}

/// Computes all that is left, and returns the number of chunks.
fn compute_all(queue: &Queue) -> usize {
    let mut out = Vec::new();
    let computed = queue.work(WITHIN, &mut out, |chunk| {
        Ok::<_, WorkerError>((piece(chunk, 0.0), "computed".to_owned()))
    });
    computed.unwrap();
    String::from_utf8(out).unwrap().matches("  computed\n").count()
}

#[track_caller]
fn gathered(queue: &Queue, numbers: Range<u64>) -> Vec<(Chunk, Piece)> {
    queue.gather(&numbers, WITHIN).unwrap()
}

#[track_caller]
fn not_gathered(queue: &Queue, numbers: Range<u64>, within: Duration) -> QueueError {
    queue.gather::<Piece>(&numbers, within).unwrap_err()
}

#[test]
#[ignore = "starts a nats-server"]
fn a_queue_that_is_filled_twice_has_each_chunk_once_until_it_is_computed() {
    let site = Site::new();
    let (one, two) = (site.queue(), site.queue());
    let filled = |queue: &Queue, count| {
        let Filled { added, queued, computed } = queue.fill(&chunks(count), REDELIVERY).unwrap();
        (added, queued, computed)
    };
    assert_eq!(filled(&one, 3), (3, 0, 0));
    assert_eq!(filled(&two, 4), (1, 3, 0));
    let taken = take(&one);
    assert_eq!(filled(&two, 4), (0, 4, 0));
    one.finish(&taken, &piece(taken.chunk, 0.0)).unwrap();
    assert_eq!(filled(&one, 4), (0, 3, 1));
    assert_eq!(compute_all(&two), 3);
    assert_eq!(filled(&one, 5), (1, 0, 4));
    let mut found: Vec<_> = gathered(&one, 1..101).into_iter().map(|(chunk, _)| chunk).collect();
    found.sort_unstable();
    assert_eq!(found, chunks(4));

    for (first, count) in [(90, 25), (1, 24), (1, 26), (2, 3), (0, 200), (105, 1)] {
        let refused = one.fill(&[Chunk { first, count }], REDELIVERY);
        assert!(matches!(refused, Err(QueueError::Overlap { .. })), "{refused:?}");
    }
    let late = not_gathered(&two, 1..126, Duration::ZERO);
    let expected =
        "there is no piece of seeds 101 to 125 after 0 s; 1 chunks wait for a worker, and 0 were";
    assert!(late.to_string().starts_with(expected), "{late}");
    compute_all(&one);
    let lost = not_gathered(&two, 1..151, WITHIN);
    let expected = "the queue has neither a chunk nor a piece of seeds 126 to 150: --fill it again";
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
    queue.finish(&second, &piece(second.chunk, 0.0)).unwrap();
    assert_eq!((first.chunk.first, first.delivery), (1, 1));
    drop(first);
    let again = take(&queue);
    assert_eq!((again.chunk.first, again.delivery, again.deliveries), (1, 2, 2));
    drop(again);
    assert!(matches!(queue.take(WITHIN).unwrap(), Next::Empty));
    let given_up = not_gathered(&queue, 1..51, WITHIN);
    let expected = "the server has given up seeds 1 to 25 after 2 workers each";
    assert!(given_up.to_string().starts_with(expected), "{given_up}");
    let filled = queue.fill(&chunks(2), REDELIVERY).unwrap();
    assert_eq!(filled, Filled { added: 1, queued: 0, computed: 1 });
    assert_eq!(compute_all(&queue), 1);
    assert_eq!(gathered(&queue, 1..51).len(), 2);
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
    two.finish(&again, &piece(chunk, 0.0)).unwrap();
    assert!(matches!(two.take(Duration::ZERO).unwrap(), Next::WithOthers(1)));
    one.finish(&kept, &piece(kept.chunk, 0.0)).unwrap();
    assert!(matches!(two.take(WITHIN).unwrap(), Next::Empty));
}

/// Its worker says that it is at work as often as the queue had it when the chunk was taken.
#[test]
#[ignore = "starts a nats-server"]
fn a_queue_that_is_filled_again_leaves_the_chunks_of_workers_with_them() {
    let site = Site::new();
    let (one, two) = (site.queue(), site.queue());
    let long = Redelivery { after: Some(3 * WITHIN), deliveries: Some(5) };
    one.fill(&chunks(1), long).unwrap();
    let taken = take(&one);
    let lease = || {
        let workers = two.runtime.block_on(two.workers()).unwrap();
        let config = &workers.cached_info().config;
        (config.ack_wait, config.max_deliver)
    };
    two.fill(&chunks(2), Redelivery::default()).unwrap();
    assert_eq!(lease(), (3 * WITHIN, 5));
    two.fill(&chunks(3), long).unwrap();
    for other in [REDELIVERY, Redelivery { deliveries: Some(6), ..Redelivery::default() }] {
        let refused = two.fill(&chunks(4), other).unwrap_err();
        assert!(matches!(refused, QueueError::Lease { .. }), "{refused}");
    }
    let refused = two.fill(&chunks(4), REDELIVERY).unwrap_err().to_string();
    assert!(refused.contains("after 90 s, at most 5 times") && refused.contains("0.3 s and 2"));
    assert_eq!(lease(), (3 * WITHIN, 5));
    one.finish(&taken, &piece(taken.chunk, 0.0)).unwrap();
    assert_eq!(compute_all(&one), 2);
    // Nobody relies on it any more.
    assert_eq!(two.fill(&chunks(4), REDELIVERY).unwrap().added, 1);
    assert_eq!(lease(), (SILENT, 2));
    two.fill(&chunks(4), Redelivery::default()).unwrap();
    assert_eq!((lease(), compute_all(&one)), ((SILENT, 2), 1));
}

#[test]
#[ignore = "starts a nats-server"]
fn a_new_queue_has_the_limits_of_the_manual() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(1), Redelivery::default()).unwrap();
    let taken = take(&queue);
    assert_eq!(taken.deliveries, 3);
    let workers = queue.runtime.block_on(queue.workers()).unwrap();
    assert_eq!(workers.cached_info().config.ack_wait, Duration::from_secs(60));
}

#[test]
#[ignore = "starts a nats-server"]
fn who_fills_what_another_one_fills_looks_again() {
    let site = Site::new();
    let (one, two) = (site.queue(), site.queue());
    // Both have looked before one of them adds: in a new queue, and in one that has had chunks.
    for first in [1, 201] {
        let cut = |size| cut(first..first + 100, size).collect::<Vec<_>>();
        let look = |queue: &Queue| queue.runtime.block_on(queue.look(REDELIVERY)).unwrap();
        let add = |queue: &Queue, chunks: &[Chunk], known: &mut Known| {
            queue.runtime.block_on(queue.add(chunks, known)).unwrap()
        };
        let (mut known, mut late) = (look(&one), look(&two));
        let filled = add(&one, &cut(25), &mut known).unwrap();
        assert_eq!(filled, Filled { added: 4, queued: 0, computed: 0 });
        assert_eq!(add(&two, &cut(20), &mut late), None);
        assert_eq!(add(&two, &cut(25), &mut look(&two)).unwrap().queued, 4);
        let refused = two.fill(&cut(20), REDELIVERY);
        assert!(matches!(refused, Err(QueueError::Overlap { .. })), "{refused:?}");
    }
    assert_eq!(compute_all(&one), 8);
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
    assert_eq!(compute_all(&queues[0]), 10);
}

#[test]
#[ignore = "starts a nats-server"]
fn numbers_that_cut_a_chunk_are_not_waited_for() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(2), REDELIVERY).unwrap();
    let refuses = |numbers: Range<u64>, expected: &str| {
        let refused = not_gathered(&queue, numbers, WITHIN).to_string();
        assert!(refused.starts_with(expected) && !refused.contains("--fill"), "{refused}");
    };
    refuses(1..31, "the chunk of seeds 26 to 50 is in part outside of seeds 1 to 30: --gather the");
    compute_all(&queue);
    refuses(2..51, "the chunk of seeds 1 to 25 is in part outside of seeds 2 to 50: --gather the");
    assert_eq!(gathered(&queue, 26..51).len(), 1);
}

#[test]
#[ignore = "starts a nats-server"]
fn a_worker_with_another_program_takes_nothing() {
    let site = Site::new();
    let (queue, other) = (site.queue(), site.connect("b").unwrap());
    assert!(matches!(other.take(WITHIN), Err(QueueError::NotFilled { .. })));
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    for refused in [other.take(WITHIN).unwrap_err(), not_gathered(&other, 1..26, WITHIN)] {
        let QueueError::NotFilled { others, .. } = &refused else { panic!("{refused}") };
        assert_eq!(others[..], ["the menu x with the program a"]);
    }
    // Also when there are chunks for both.
    assert_eq!(other.fill(&chunks(2), REDELIVERY).unwrap().added, 2);
    assert_eq!((compute_all(&queue), compute_all(&other)), (1, 2));
    assert_eq!((gathered(&queue, 1..26).len(), gathered(&other, 1..51).len()), (1, 2));
}

#[test]
#[ignore = "starts a nats-server"]
fn a_server_that_is_killed_while_a_chunk_is_computed_is_waited_for() {
    let mut site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(2), Redelivery { after: Some(WITHIN), deliveries: Some(2) }).unwrap();
    let taken = take(&queue);
    site.kill();
    site.start("");
    queue.finish(&taken, &piece(taken.chunk, 0.0)).unwrap();
    assert_eq!(compute_all(&queue), 1);
    assert_eq!(gathered(&queue, 1..51).len(), 2);
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
    let refused = queue.finish(&taken, &piece(taken.chunk, 0.0)).unwrap_err();
    assert!(matches!(refused, QueueError::Server { .. }), "{refused}");
    assert!(matches!(queue.take(WITHIN), Err(QueueError::Server { .. })));
    assert!(matches!(site.connect("a"), Err(QueueError::Connect { .. })));
    site.start_bare("");
    assert!(matches!(site.connect("a"), Err(QueueError::NoJetStream { .. })));
}

#[test]
#[ignore = "starts a nats-server"]
fn a_chunk_that_is_computed_twice_has_two_pieces_to_the_last_bit() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let taken = take(&queue);
    let results = [0.1 + 0.2, 5e-324];
    for result in results {
        queue.finish(&taken, &piece(taken.chunk, result)).unwrap();
    }
    let found: Vec<_> = gathered(&queue, 1..26).into_iter().map(|(_, piece)| piece.2).collect();
    assert_eq!(
        found.iter().map(|found| found.to_bits()).collect::<Vec<_>>(),
        results.map(f64::to_bits)
    );
}

#[test]
#[ignore = "starts a nats-server"]
fn a_piece_that_is_larger_than_a_message_may_be_is_refused_with_both_sizes() {
    let mut site = Site::new();
    site.kill();
    site.start("max_payload: 1000");
    let queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let taken = take(&queue);
    // With its two quotation marks.
    let of_bytes = |bytes: usize| "x".repeat(bytes - 2);
    let refused = queue.finish(&taken, &of_bytes(1001)).unwrap_err().to_string();
    let (expected, most) = ("the piece of seeds 1 to 25 has 1001 bytes", "at most 1000 bytes");
    assert!(refused.starts_with(expected) && refused.contains(most), "{refused}");
    queue.finish(&taken, &of_bytes(1000)).unwrap();
    assert_eq!(queue.gather::<String>(&(1..26), WITHIN).unwrap().len(), 1);
}

#[test]
#[ignore = "starts a nats-server"]
fn what_is_not_a_piece_is_named() {
    let site = Site::new();
    let queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let subject = queue.work.subject(Kind::Piece, chunks(1)[0]);
    queue.runtime.block_on(async {
        queue.context.publish(subject, "{}".into()).await.unwrap().await.unwrap();
    });
    let refused = not_gathered(&queue, 1..26, WITHIN).to_string();
    assert_eq!(refused, "the piece of seeds 1 to 25 in the queue cannot be read");
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
        Queue::connect(&server, files, work("a"))
    };
    // Without its own certificate.
    connect("right", Some(&files)).unwrap_err();
    authority.sign_client("worker", &files, "worker").unwrap();
    connect("right", None).unwrap_err();
    let refused = connect("wrong", Some(&files)).unwrap_err().to_string();
    assert!(refused.contains("authorization") && !refused.contains("wrong"), "{refused}");
    let queue = connect("right", Some(&files)).unwrap();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    assert_eq!(compute_all(&queue), 1);
}

#[test]
#[ignore = "starts a nats-server"]
fn a_chunk_is_acknowledged_only_when_its_piece_is_stored() {
    let site = Site::new();
    let mut queue = site.queue();
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    queue.patience = Duration::ZERO;
    let delete =
        async { queue.context.delete_stream(queue.work.stream(Kind::Piece)).await.unwrap() };
    queue.runtime.block_on(delete);
    let taken = take(&queue);
    let refused = queue.finish(&taken, &piece(taken.chunk, 0.0)).unwrap_err();
    assert!(matches!(refused, QueueError::Server { .. }), "{refused}");
    drop(taken);
    queue.fill(&chunks(1), REDELIVERY).unwrap();
    let again = take(&queue);
    assert_eq!(again.delivery, 2);
    queue.finish(&again, &piece(again.chunk, 0.0)).unwrap();
    assert_eq!(gathered(&queue, 1..26).len(), 1);
}
