//! Removes the records of runs from PostgreSQL that are in verified objects.
//!
//! ```text
//!   sealed, typed and judged ─▶ older than the time for which records are kept ─▶ its object is read and checked
//!                                                                                   │ its seal is that of the run
//!                                                                                   ▼
//!                                                                            records removed
//! ```

use std::{
    collections::{BTreeMap, btree_map::Entry},
    sync::Arc,
};

use rig_model::with_causes;
use rig_ship::{ObjectStore, ShipError, StorageError, StoredObject, objects};
use serde::Serialize;
use tokio::task::{JoinError, spawn_blocking};
use tokio_postgres::Client;

use crate::batch::hex;

/// What a call has done.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Pruned {
    /// Runs whose records were removed.
    pub runs: i64,
    /// Number of these records.
    pub records: i64,
    /// Runs that are old enough and stayed, by the reason.
    pub stayed: BTreeMap<String, i64>,
}

/// Why nothing more was removed.
#[derive(Debug, thiserror::Error)]
pub enum PruneError {
    /// PostgreSQL refuses.
    #[error("PostgreSQL refuses")]
    Refused(#[from] tokio_postgres::Error),
    /// The object store cannot be listed.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// The check of an object was not ended.
    #[error("check of an object")]
    Check(#[from] JoinError),
}

/// Removes the records of runs of which the hub took the last record more than `keep_days` days ago, where `store` has
/// the run. Each object is read and checked before.
///
/// # Errors
/// [`PruneError`]; the runs before stay removed.
pub async fn prune(
    client: &Client,
    store: ObjectStore,
    keep_days: i32,
) -> Result<Pruned, PruneError> {
    let address = store.address().to_string();
    let store = Arc::new(store);
    let list = Arc::clone(&store);
    let mut by_run = BTreeMap::<String, Vec<StoredObject>>::new();
    for object in spawn_blocking(move || objects(&list)).await?? {
        by_run.entry(object.run().to_owned()).or_default().push(object);
    }
    let mut done = Pruned::default();
    for (run, seal) in old(client, keep_days).await? {
        let checked = match (must_stay(client, &run).await?, by_run.remove(&run)) {
            (Some(reason), _) => Err(reason),
            (None, None) => Err("it has no object".to_owned()),
            (None, Some(objects)) => check(&store, objects, &hex(&seal)).await?,
        };
        match checked {
            Ok(object) => {
                let records = remove(client, &run, &object, &seal, keep_days).await?;
                done.runs += i64::from(records > 0);
                done.records += records;
            }
            Err(reason) => match done.stayed.entry(reason) {
                Entry::Occupied(mut entry) => *entry.get_mut() += 1,
                Entry::Vacant(entry) => _ = entry.insert(1),
            },
        }
    }
    client.batch_execute("SELECT hub.drop_empty_partitions()").await?;
    let note = "INSERT INTO hub.pruning (keep_days, objects, runs, records, stayed) VALUES ($1, $2, $3, $4, $5)";
    let stayed: i64 = done.stayed.values().sum();
    client.execute(note, &[&keep_days, &address, &done.runs, &done.records, &stayed]).await?;
    Ok(done)
}

/// The runs with records that are old enough, amendments behind the others: id and seal.
async fn old(
    client: &Client,
    keep_days: i32,
) -> Result<Vec<(String, Vec<u8>)>, tokio_postgres::Error> {
    let select = "
        SELECT r.id::text, coalesce(r.seal, '')
        FROM hub.run AS r
        WHERE r.pruned_at IS NULL AND r.received_at < now() - make_interval(days => $1)
          AND hub.taken_at(r) < now() - make_interval(days => $1)
        ORDER BY r.kind = 'amendment', r.id";
    let rows = client.query(select, &[&keep_days]).await?;
    Ok(rows.iter().map(|row| (row.get(0), row.get(1))).collect())
}

/// Why a run must stay, whatever its object is. What was removed before it in this call counts: an amendment stays with its run.
async fn must_stay(client: &Client, run: &str) -> Result<Option<String>, tokio_postgres::Error> {
    let select = "SELECT hub.must_stay(r) FROM hub.run AS r WHERE r.id = $1::text::uuid";
    Ok(client.query_one(select, &[&run]).await?.get(0))
}

/// The name of the first object that is sound and has this seal, or why there is none.
async fn check(
    store: &Arc<ObjectStore>,
    objects: Vec<StoredObject>,
    seal: &str,
) -> Result<Result<String, String>, JoinError> {
    let (store, seal) = (Arc::clone(store), seal.to_owned());
    spawn_blocking(move || {
        let sound = |object: &StoredObject| match object.check(&store, None) {
            Ok(verdict) if !verdict.is_sound => {
                Err(format!("its object is {}", verdict.sentence()))
            }
            Ok(verdict) if verdict.seal != seal => Err("its object has another seal".to_owned()),
            Ok(_) => Ok(object.name.clone()),
            Err(ShipError::Storage(error)) => Err(format!("its object: {}", with_causes(&error))),
            Err(_) => Err("its object cannot be read".to_owned()),
        };
        let mut reason = "it has no object".to_owned();
        for object in &objects {
            match sound(object) {
                Ok(name) => return Ok(name),
                Err(found) => reason = found,
            }
        }
        Err(reason)
    })
    .await
}

async fn remove(
    client: &Client,
    run: &str,
    object: &str,
    seal: &[u8],
    keep_days: i32,
) -> Result<i64, tokio_postgres::Error> {
    let prune = "SELECT hub.prune_run($1::text::uuid, $2, $3, make_interval(days => $4))";
    Ok(client.query_one(prune, &[&run, &object, &seal, &keep_days]).await?.get(0))
}
