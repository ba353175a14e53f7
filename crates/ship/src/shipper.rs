//! Ships runs.

use std::{
    cell::RefCell,
    collections::{BTreeMap, BTreeSet, btree_map::Entry},
};

use rig_report::export::{self, ExportError, SealDocument};
use rig_store::{Digest, Reader, Run, StoreError};
use rig_verify::{ObjectError, verify_object};

use crate::{
    BenchKey, KeyError, Label, LabelError, ObjectStore, StorageError,
    names::{self, Names},
    receipt::{Receipt, sha256},
};

/// Ships the runs of benches of one laboratory to an object store.
#[derive(Debug)]
pub struct Shipper {
    store: ObjectStore,
    lab: Label,
    bench: Option<Label>,
    key: Option<BenchKey>,
    /// The names that were in the store, by folder of a bench.
    listed: RefCell<BTreeMap<String, BTreeSet<String>>>,
}

/// What became of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// It was put in the store, and read back from there.
    Shipped {
        /// Name of the object.
        object: String,
    },
    /// It was there already.
    Present {
        /// Name of the object.
        object: String,
    },
    /// The store has an object of this run with other records.
    Clash {
        /// Name of the other object.
        object: String,
    },
}

/// Why a run is not shipped.
#[derive(Debug, thiserror::Error)]
pub enum ShipError {
    /// The journal.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The object store.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// The object cannot be made.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The id of the bench in the journal.
    #[error("the id of the bench in the journal cannot name an object")]
    Bench(#[from] LabelError),
    /// The seal cannot be signed.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The receipt cannot be written or read.
    #[error("receipt of {object}")]
    Receipt {
        /// Name of the object.
        object: String,
        /// The error of the JSON.
        source: serde_json::Error,
    },
    /// An object cannot be checked.
    #[error("object {object} cannot be checked")]
    Object {
        /// Name of the object.
        object: String,
        /// What is wrong with it.
        source: ObjectError,
    },
    /// The object was in the store, and is not there any more.
    #[error(
        "{object} is not in the store, and its receipt is: bring it back from a copy of the store, or move the receipt away and \
         ship the run again"
    )]
    Lost {
        /// Name of the object.
        object: String,
    },
    /// The object in the store is not that of the run.
    #[error("{object} is not the run in the journal: {what}")]
    Differs {
        /// Name of the object.
        object: String,
        /// What is wrong.
        what: String,
    },
}

impl ShipError {
    /// Whether the run or its object is at fault, and not the system or another program.
    pub const fn is_of_run(&self) -> bool {
        matches!(
            self,
            Self::Differs { .. }
                | Self::Lost { .. }
                | Self::Object { .. }
                | Self::Receipt { .. }
                | Self::Store(
                    StoreError::Broken { .. }
                        | StoreError::Archived { .. }
                        | StoreError::NotSealed { .. }
                )
        )
    }
}

impl Shipper {
    /// A shipper to this store. Without `bench`, a bench has its id as its name. With `key`, seals are signed.
    pub fn new(
        store: ObjectStore,
        lab: Label,
        bench: Option<Label>,
        key: Option<BenchKey>,
    ) -> Self {
        Self { store, lab, bench, key, listed: RefCell::default() }
    }

    /// Ships a sealed run of any kind. An object that is there is not written again; one without a receipt is
    /// read and checked.
    ///
    /// # Errors
    /// [`ShipError`]. The object is in the store as a whole or not at all.
    pub fn ship(&self, reader: &Reader, run: &Run) -> Result<Outcome, ShipError> {
        let names = self.names(reader, run)?;
        if let Some(outcome) = self.found(&names) {
            return Ok(outcome);
        }
        let (sealed, records) = reader.sealed(run.id)?;
        let seal = sealed.seal();
        let signature = self.key.as_ref().map(|key| key.sign(seal)).transpose()?;
        let mut object = Vec::new();
        export::sealed(&SealDocument::new(&sealed, signature), &records, &mut object)?;
        drop(records);
        // Beside the receipt of another file it would be refuted for good.
        if self.has_receipt(&names) {
            let receipt = Receipt::read(&names.object, &self.store.get(&names.receipt)?)?;
            let is_absent = || self.store.get(&names.object).is_err_and(|error| error.is_absent());
            if receipt.sha256 != sha256(&object) && is_absent() {
                return Err(ShipError::Lost { object: names.object });
            }
        }
        let is_new = self.store.put_new(&names.object, &object.into())?;
        let back = self.store.get(&names.object)?;
        let verdict = verify_object(back.clone(), None)
            .map_err(|source| ShipError::Object { object: names.object.clone(), source })?;
        let differs = |what| ShipError::Differs { object: names.object.clone(), what };
        if let Some(finding) = verdict.findings.first() {
            return Err(differs(finding.to_string()));
        }
        if verdict.seal != seal.to_string() {
            return Err(differs(format!(
                "its seal is {}, and that of the run is {seal}",
                verdict.seal
            )));
        }
        let receipt = Receipt::new(&names.object, &back, verdict);
        self.store.put_new(&names.receipt, &receipt.json()?)?;
        Ok(if is_new {
            Outcome::Shipped { object: names.object }
        } else {
            Outcome::Present { object: names.object }
        })
    }

    fn names(&self, reader: &Reader, run: &Run) -> Result<Names, ShipError> {
        let (_, bench) = reader.origin(run.id)?;
        let bench = self.bench.clone().map_or_else(|| bench.parse(), Ok)?;
        let of_bench = names::of_bench(&self.lab, &bench);
        let head = reader.last_digest(run.id)?.unwrap_or(Digest::START);
        let names = Names::new(&of_bench, run.id, &run.started_at, head);
        let mut listed = self.listed.borrow_mut();
        if let Entry::Vacant(entry) = listed.entry(of_bench) {
            let found = self.store.list(entry.key())?;
            entry.insert(found.into_iter().collect());
        }
        Ok(names)
    }

    /// What the store had of a run when it was listed.
    fn found(&self, names: &Names) -> Option<Outcome> {
        let listed = self.listed.borrow();
        let of_run = |all: &BTreeSet<String>| {
            let all =
                all.range(names.run.clone()..).take_while(|name| name.starts_with(&names.run));
            all.filter(|name| names::is_object(name)).cloned().collect::<Vec<_>>()
        };
        let objects: Vec<_> = listed.values().flat_map(of_run).collect();
        if let Some(other) = objects.iter().find(|name| **name != names.object) {
            return Some(Outcome::Clash { object: other.clone() });
        }
        let is_there = !objects.is_empty() && self.has_receipt(names);
        is_there.then(|| Outcome::Present { object: names.object.clone() })
    }

    /// Whether the store had the receipt of a run when it was listed.
    fn has_receipt(&self, names: &Names) -> bool {
        self.listed.borrow().values().any(|all| all.contains(&names.receipt))
    }
}
