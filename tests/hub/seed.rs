//! The life of a bench: what is drawn for a seed, and what the hub and the object store must have at its end.

use std::process::Stdio;

use rig_hub::{Batch, InletError, admin};
use rig_store::Reader;

use crate::{
    bench::{self, Bench, Contents, Counts, is_sealed},
    deed::{DEEDS, Deed},
    objects, results, shipping,
    support::{Hub, assert_same, contents_of},
    telling::Nats,
    worker,
};

/// Things that happen to a bench.
const DEEDS_OF_A_BENCH: usize = 20;
/// Of this many benches, one is copied to another computer.
const CLONES: u32 = 4;

/// Plays a seed to its end.
///
/// # Panics
/// When a byte of the hub or of the object store is not that of the journal.
pub(crate) async fn play(seed: u64, hub: &mut Hub, nats: &Nats, counts: &mut Counts) {
    let mut bench = Bench::new(seed, hub).await;
    let clashes = hub.count("hub.clash").await;
    bench.measure_beside(seed, counts);
    let mut older = None;
    for _ in 0..DEEDS_OF_A_BENCH {
        let deed = draw(&mut bench);
        if act(&mut bench, deed, hub, &mut older, counts).await {
            *counts.entry(format!("{deed:?}")).or_default() += 1;
        }
    }
    if bench.below(CLONES) == 0 {
        clone(&mut bench, hub, counts).await;
    }
    nats.tell(&mut bench, hub, counts).await;
    judge(&bench, hub, counts).await;
    assert_eq!(hub.count("hub.clash").await, clashes, "records were put aside");
}

fn draw(bench: &mut Bench) -> Deed {
    let mut drawn = bench.below(DEEDS.iter().map(|(_, share)| share).sum());
    for (deed, share) in DEEDS {
        if drawn < share {
            return deed;
        }
        drawn -= share;
    }
    Deed::Send
}

/// Lets something happen, and says whether it could.
async fn act(
    bench: &mut Bench,
    deed: Deed,
    hub: &mut Hub,
    older: &mut Option<Batch>,
    counts: &mut Counts,
) -> bool {
    match deed {
        Deed::Measure => bench.measure(counts),
        Deed::Newer => bench.measure_newer(counts),
        Deed::KillRig => bench.kill_rig(),
        Deed::BackUp => return bench.back_up(),
        Deed::Restore => {
            *older = None;
            return bench.restore(hub).await;
        }
        Deed::PutObjects | Deed::KillObjects | Deed::FullObjects => put(bench, deed).await,
        Deed::KillShipper => shipping::kill_shipper(bench).await,
        Deed::Cut | Deed::Slow => shipping::by_bad_line(bench, deed, counts).await,
        _ => return shipping::meet(bench, deed, hub, older).await,
    }
    true
}

/// Has a program put the sealed runs in the object store. It may be killed, or have no space.
async fn put(bench: &mut Bench, deed: Deed) {
    let mut command = bench::worker("objects", bench.data.path());
    command.arg(bench.objects.path()).stdout(Stdio::null());
    if deed == Deed::FullObjects {
        // The size in blocks of 512 bytes; without the signal, writing fails as on a full disk.
        let blocks = bench.up_to(512).to_string();
        let program = command.get_program().to_owned();
        let arguments: Vec<_> = command.get_args().map(ToOwned::to_owned).collect();
        command = std::process::Command::new("sh");
        command.args(["-c", "trap '' XFSZ; ulimit -f \"$0\"; exec \"$@\"", &blocks]);
        command.arg(program).args(arguments).stdout(Stdio::null());
    }
    let mut program = command.spawn().unwrap();
    if deed == Deed::KillObjects {
        shipping::kill_later(bench, &mut program).await;
        return;
    }
    let status = program.wait().unwrap();
    assert!(status.success() || deed == Deed::FullObjects, "{status}");
}

/// Two computers go on with one journal, until the hub refuses both and a person decides for one.
async fn clone(bench: &mut Bench, hub: &Hub, counts: &mut Counts) {
    bench.end_all(counts);
    hub.ship(&bench.role, bench.data.path()).await.unwrap();
    let other = bench.copy();
    let paths = [bench.data.path().to_owned(), other.path().to_owned()];
    let mut refused = None;
    for turn in 0..8 {
        let data = &paths[turn % 2];
        bench.measure_in(data, counts);
        match hub.ship(&bench.role, data).await {
            Ok(_) => {}
            Err(InletError::Refused { .. }) => {
                refused = Some(data);
                break;
            }
            Err(error) => panic!("{error:?}"),
        }
    }
    assert!(refused.is_some(), "two copies went on, and the hub has not noticed");
    *counts.entry("clones found".to_owned()).or_default() += 1;
    let (journal, _) = Reader::open(bench.data.path()).unwrap().identity().unwrap();
    let mut admin = hub.another().await;
    admin::release_journal(&mut admin, &journal).await.unwrap();
    // The other computer gets an empty data directory. What the hub has of it stays.
    let (kept, left) = (contents_of(&paths[0]), contents_of(&paths[1]));
    for (run, lines) in hub.contents_of(&bench.role).await {
        if !kept.contains_key(&run) && !bench.lost.contains_key(&run) {
            assert!(lines.iter().all(|line| left[&run].contains(line)), "{run}");
            bench.lost.insert(run, lines);
        }
    }
}

/// Ships what is left, and compares the hub and the objects with the journal.
async fn judge(bench: &Bench, hub: &Hub, counts: &mut Counts) {
    let data = bench.data.path();
    hub.ship(&bench.role, data).await.unwrap();
    let journal = contents_of(data);
    let mut wanted = bench.lost.clone();
    wanted.extend(journal.clone());
    assert_same(&hub.contents_of(&bench.role).await, &wanted);
    *counts.entry("runs in the hub".to_owned()).or_default() += wanted.len() as u64;
    *counts.entry("stiffnesses in reports".to_owned()).or_default() +=
        results::compare(hub, data).await;
    for (run, put) in worker::objects(data, bench.objects.path()).unwrap() {
        if let Err(error) = put {
            panic!("{run}: {}", rig_model::with_causes(&error));
        }
    }
    judge_objects(bench, journal, counts);
}

/// Every sealed run is an object, and every object is a run that was sealed in this journal or in one that is gone.
fn judge_objects(bench: &Bench, journal: Contents, counts: &mut Counts) {
    let mut known = bench.gone.clone();
    let sealed: Contents = journal.into_iter().filter(|(_, lines)| is_sealed(lines)).collect();
    let found = objects::contents(bench.objects.path());
    *counts.entry("objects".to_owned()).or_default() += found.len() as u64;
    for run in sealed.keys() {
        assert!(found.contains_key(run), "run {run} has no object");
    }
    known.extend(sealed);
    for (run, lines) in found {
        assert_eq!(lines, objects::of_journal(&known[&run]), "the object of run {run}");
    }
}
