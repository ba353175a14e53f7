//! Runs in an object store: byte for byte those of the journal, put once, and every forgery is found.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{fs, path::Path};

use bytes::Bytes;
use rig_report::export::{self, SealDocument};
use rig_ship::{Address, BenchKey, ObjectStore, Outcome, PublicKey, ShipError, Shipper, objects};
use rig_store::{
    ClockJumped, Ending, GivenUp, Reader, Record, RunFinished, RunKind, SealedRun, Store,
    StoreError, StoredRecord,
};
use rig_verify::verify_object;
use tempfile::TempDir;

/// A data directory with a session, a run that was given up in a second epoch, and a run that can go on.
fn with_runs(data: &Path) {
    let jump = |jump_s| Record::ClockJumped(ClockJumped { jump_s });
    let store = Store::open(data).unwrap();
    let mut session = store.begin(RunKind::Session, "session").unwrap();
    session.append(5_000, &jump(0.5)).unwrap();
    let mut run = store.begin(RunKind::Run, "smöke").unwrap();
    for step in 1..400_u32 {
        run.append(u64::from(step) * 10_000, &jump(f64::from(step) / 7.0)).unwrap();
    }
    run.commit().unwrap();
    let id = run.id();
    drop((session, run, store));
    let store = Store::open(data).unwrap();
    let (epoch, who) = (store.epoch().unwrap(), "somebody".to_owned());
    let mut run = store.reopen(id).unwrap();
    run.append(7, &Record::GivenUp(GivenUp { epoch, who })).unwrap();
    run.append(9, &Record::RunFinished(RunFinished { status: Ending::Aborted })).unwrap();
    let mut open = store.begin(RunKind::Run, "open").unwrap();
    open.append(0, &jump(1.0)).unwrap();
    open.commit().unwrap();
}

fn object_store(folder: &TempDir) -> ObjectStore {
    ObjectStore::at(Address::Folder(folder.path().join("objects"))).unwrap()
}

fn shipper(folder: &TempDir, key: Option<BenchKey>) -> Shipper {
    Shipper::new(object_store(folder), "lab".parse().unwrap(), Some("left".parse().unwrap()), key)
}

/// Ships every run of a journal, oldest first.
fn ship(shipper: &Shipper, data: &Path) -> Vec<Result<Outcome, ShipError>> {
    let reader = Reader::open(data).unwrap();
    let runs = reader.runs().unwrap().into_iter().rev();
    runs.map(|run| shipper.ship(&reader, &run)).collect()
}

#[test]
fn the_objects_are_the_sealed_runs_and_are_put_once() {
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    with_runs(&data);
    let outcomes = ship(&shipper(&folder, None), &data);
    let is_shipped = |one: &Result<Outcome, _>| matches!(one, Ok(Outcome::Shipped { .. }));
    assert!(is_shipped(&outcomes[0]) && is_shipped(&outcomes[1]), "{outcomes:?}");
    assert!(matches!(outcomes[2], Err(ShipError::Store(StoreError::NotSealed { .. }))));

    let (store, reader) = (object_store(&folder), Reader::open(&data).unwrap());
    let found = objects(&store).unwrap();
    assert!(found.len() == 2 && found.iter().all(|object| object.has_receipt), "{found:?}");
    for object in &found {
        let verdict = object.check(&store, None).unwrap();
        assert!(verdict.is_sound && verdict.signed_by.is_none(), "{:?}", verdict.findings);
        let run = reader.run(verdict.run.parse().unwrap()).unwrap();
        assert_eq!((&verdict.name, verdict.records), (&run.name, run.records));
        assert_eq!(verdict.seal, reader.sealed(run.id).unwrap().0.seal().to_string());
    }
    let before: Vec<_> = found.iter().map(|object| store.get(&object.name).unwrap()).collect();
    let again = ship(&shipper(&folder, None), &data);
    assert!(again[..2].iter().all(|one| matches!(one, Ok(Outcome::Present { .. }))), "{again:?}");
    let after: Vec<_> = found.iter().map(|object| store.get(&object.name).unwrap()).collect();
    assert_eq!(before, after);
}

#[test]
fn an_object_without_a_receipt_is_read_before_it_counts() {
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    with_runs(&data);
    ship(&shipper(&folder, None), &data);
    let (store, root) = (object_store(&folder), folder.path().join("objects"));
    let receipts: Vec<_> =
        store.list("").unwrap().into_iter().filter(|name| name.contains("/_")).collect();
    assert_eq!(receipts.len(), 2);
    for name in &receipts {
        fs::remove_file(root.join(name)).unwrap();
    }
    let again = ship(&shipper(&folder, None), &data);
    assert!(again[..2].iter().all(|one| matches!(one, Ok(Outcome::Present { .. }))), "{again:?}");
    // Another file in the place of an object is not taken for it.
    for name in &receipts {
        fs::remove_file(root.join(name)).unwrap();
    }
    let object = objects(&store).unwrap()[0].name.clone();
    fs::remove_file(root.join(&object)).unwrap();
    fs::write(root.join(&object), b"PAR1 of somebody").unwrap();
    let refused = ship(&shipper(&folder, None), &data);
    let errors: Vec<_> = refused[..2].iter().filter_map(|one| one.as_ref().err()).collect();
    assert!(errors.len() == 1 && errors[0].is_of_run(), "{refused:?}");
    assert_eq!(store.get(&object).unwrap(), &b"PAR1 of somebody"[..]);
}

#[test]
fn an_object_that_is_lost_is_missed_by_its_receipt() {
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    with_runs(&data);
    ship(&shipper(&folder, None), &data);
    let all = objects(&object_store(&folder)).unwrap();
    fs::remove_file(folder.path().join("objects").join(&all[0].name)).unwrap();
    let found = objects(&object_store(&folder)).unwrap();
    assert_eq!(found.len(), all.len());
    assert!(found[0].is_lost && found[0].name == all[0].name, "{found:?}");
    let store = object_store(&folder);
    assert!(matches!(found[0].check(&store, None), Err(ShipError::Lost { .. })));
    assert!(found[1].check(&store, None).unwrap().is_sound);
    // It is not put there anew beside the receipt of another file.
    let key = BenchKey::make(&folder.path().join("key")).unwrap();
    let again = ship(&shipper(&folder, Some(key)), &data);
    let lost = again.iter().filter(|one| matches!(one, Err(ShipError::Lost { .. }))).count();
    assert_eq!(
        (lost, object_store(&folder).list("").unwrap().len()),
        (1, 2 * all.len() - 1),
        "{again:?}"
    );
    // The same file is.
    let healed = ship(&shipper(&folder, None), &data);
    assert!(healed.iter().any(|one| matches!(one, Ok(Outcome::Shipped { .. }))), "{healed:?}");
    assert!(objects(&store).unwrap().iter().all(|one| one.check(&store, None).unwrap().is_sound));
}

#[test]
fn two_runs_with_one_id_clash() {
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    with_runs(&data);
    let run = {
        let reader = Reader::open(&data).unwrap();
        reader.runs().unwrap().into_iter().find(|run| run.name == "open").unwrap()
    };
    // The bench was cloned: each copy gives the run up in its own way.
    let clone = folder.path().join("clone");
    fs::create_dir(&clone).unwrap();
    rig_store::back_up(&data, &clone, &[]).unwrap();
    Store::open(&data).unwrap().give_up(run.id, 1, "one").unwrap();
    Store::open(&clone).unwrap().give_up(run.id, 1, "another").unwrap();
    assert!(matches!(ship(&shipper(&folder, None), &data)[2], Ok(Outcome::Shipped { .. })));
    let clashes = ship(&shipper(&folder, None), &clone);
    assert!(matches!(clashes[2], Ok(Outcome::Clash { .. })), "{clashes:?}");
}

/// The run of two epochs, as it is in the journal.
fn sealed(folder: &TempDir) -> (SealedRun, Vec<StoredRecord>) {
    let data = folder.path().join("data");
    with_runs(&data);
    let reader = Reader::open(&data).unwrap();
    let run = reader.runs().unwrap().into_iter().find(|run| run.name == "smöke").unwrap();
    reader.sealed(run.id).unwrap()
}

fn object(run: &SealedRun, records: &[StoredRecord]) -> Bytes {
    let mut bytes = Vec::new();
    export::sealed(&SealDocument::new(run, None), records, &mut bytes).unwrap();
    bytes.into()
}

#[test]
fn every_forgery_is_found_in_the_object_alone() {
    type Forgery = fn(&mut SealedRun, &mut Vec<StoredRecord>);
    let folder = TempDir::new().unwrap();
    let (run, records) = sealed(&folder);
    let sound = verify_object(object(&run, &records), None).unwrap();
    assert!(sound.is_sound, "{:?}", sound.findings);
    let forgeries: [(&str, Forgery); 9] = [
        ("digest", |_, records| records[5].payload = records[6].payload.clone()),
        ("complete", |_, records| drop(records.remove(5))),
        ("digest", |_, records| records[5].rig_us += 1),
        ("seal", |_, records| drop(records.pop())),
        ("seal", |run, _| run.status = "completed".to_owned()),
        ("seal", |run, _| run.finished_at = run.finished_at.replace("20", "19")),
        ("time", |_, records| records[5].at = records[50].at.clone()),
        ("readable", |_, records| records[5].kind = "moved".to_owned()),
        ("time", |_, records| records.iter_mut().for_each(|record| record.epoch += 1)),
    ];
    for (index, (check, forge)) in forgeries.into_iter().enumerate() {
        let (mut forged, mut changed) = (run.clone(), records.clone());
        forge(&mut forged, &mut changed);
        // The forger writes the seal of the true run beside the changed content.
        let bytes = object(&forged, &changed);
        let (written, true_seal) = (forged.seal().to_string(), run.seal().to_string());
        let bytes = replaced(&bytes, &written, &true_seal);
        let verdict = verify_object(bytes, None).unwrap();
        let found: Vec<_> = verdict.findings.iter().map(|finding| finding.check.name()).collect();
        assert!(found.contains(&check), "forgery {index}: {found:?}");
    }
    // Whole files that are none.
    let whole = object(&run, &records);
    for cut in [0, 4, whole.len() / 2, whole.len() - 1] {
        assert!(verify_object(whole.slice(..cut), None).is_err(), "cut at {cut}");
    }
}

/// Bytes with every occurrence of a text replaced by another of the same length.
fn replaced(bytes: &Bytes, old: &str, new: &str) -> Bytes {
    let mut bytes = bytes.to_vec();
    let places: Vec<_> =
        bytes.windows(old.len()).enumerate().filter(|(_, at)| *at == old.as_bytes()).collect();
    let places: Vec<usize> = places.into_iter().map(|(place, _)| place).collect();
    assert!(!places.is_empty(), "the metadata is not compressed");
    for place in places {
        bytes[place..place + new.len()].copy_from_slice(new.as_bytes());
    }
    bytes.into()
}

#[test]
fn a_chain_that_was_rebuilt_is_found_by_its_signature() {
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    with_runs(&data);
    let (own, foreign) = (folder.path().join("own.key"), folder.path().join("foreign.key"));
    let own_key: PublicKey = BenchKey::make(&own).unwrap().public().parse().unwrap();
    let foreign_key: PublicKey = BenchKey::make(&foreign).unwrap().public().parse().unwrap();
    ship(&shipper(&folder, Some(BenchKey::read(&own).unwrap())), &data);
    let store = object_store(&folder);
    let stored = objects(&store).unwrap();
    for object in &stored {
        let verdict = object.check(&store, Some(&own_key)).unwrap();
        assert!(verdict.is_sound && verdict.signed_by.is_some(), "{:?}", verdict.findings);
        assert!(object.check(&store, None).unwrap().is_sound);
        assert!(!object.check(&store, Some(&foreign_key)).unwrap().is_sound);
        // A forger who takes the signature away, or changes a digit of it.
        let bytes = store.get(&object.name).unwrap();
        let key = verdict.signed_by.unwrap();
        let other = BenchKey::read(&foreign).unwrap().public();
        let forged = verify_object(replaced(&bytes, &key, &other), None).unwrap();
        assert!(!forged.is_sound, "another key");
    }
    let fresh = TempDir::new().unwrap();
    ship(&shipper(&fresh, None), &data);
    let store = object_store(&fresh);
    let unsigned = objects(&store).unwrap()[0].check(&store, Some(&own_key)).unwrap();
    assert!(!unsigned.is_sound, "not signed");
}

#[test]
fn an_object_under_the_name_of_another_is_found() {
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    with_runs(&data);
    ship(&shipper(&folder, None), &data);
    let (store, root) = (object_store(&folder), folder.path().join("objects"));
    let [one, two] = &objects(&store).unwrap()[..] else { panic!() };
    let bytes = store.get(&one.name).unwrap();
    fs::remove_file(root.join(&two.name)).unwrap();
    fs::write(root.join(&two.name), &bytes).unwrap();
    let verdict = two.check(&store, None).unwrap();
    assert_eq!(verdict.findings.len(), 2, "name and receipt: {:?}", verdict.findings);
}
