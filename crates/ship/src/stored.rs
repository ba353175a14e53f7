//! The objects that a store has, and their check.

use rig_verify::{Check, Finding, ObjectVerdict, verify_object};

use crate::{
    ObjectStore, PublicKey, ShipError, StorageError, names,
    receipt::{Receipt, sha256},
};

/// An object in a store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredObject {
    /// Its name.
    pub name: String,
    /// Whether it has a receipt: it was read back after it had been put there.
    pub has_receipt: bool,
    /// Whether only its receipt is there: it was lost since.
    pub is_lost: bool,
}

/// All objects of a store, in the order of their names, and those of which there is only a receipt.
///
/// # Errors
/// [`StorageError`].
pub fn objects(store: &ObjectStore) -> Result<Vec<StoredObject>, StorageError> {
    let names = store.list("")?;
    let is_there = |name: &String| names.binary_search(name).is_ok();
    let there = names.iter().filter(|name| names::is_object(name)).map(|name| StoredObject {
        name: name.clone(),
        has_receipt: is_there(&names::receipt_of(name)),
        is_lost: false,
    });
    let lost =
        names.iter().filter_map(|name| names::object_of(name)).filter(|name| !is_there(name));
    let lost = lost.map(|name| StoredObject { name, has_receipt: true, is_lost: true });
    let mut all: Vec<_> = there.chain(lost).collect();
    all.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(all)
}

impl StoredObject {
    /// The id of its run, as its name has it.
    pub fn run(&self) -> &str {
        names::run_of(&self.name)
    }

    /// Reads and checks the object: what it has in itself, its name, and its receipt if it has one. With `key`, it
    /// must be signed by it.
    ///
    /// # Errors
    /// [`ShipError`] if the object cannot be read at all. Other faults are findings.
    pub fn check(
        &self,
        store: &ObjectStore,
        key: Option<&PublicKey>,
    ) -> Result<ObjectVerdict, ShipError> {
        let object = &self.name;
        let bytes = match store.get(object) {
            // It may have been put since the store was listed.
            Err(error) if self.is_lost && error.is_absent() => {
                return Err(ShipError::Lost { object: object.clone() });
            }
            bytes => bytes?,
        };
        let mut verdict = verify_object(bytes.clone(), key.map(PublicKey::bytes))
            .map_err(|source| ShipError::Object { object: object.clone(), source })?;
        let mut differs = |what: &str, expected: String, found: String| {
            let (check, what) = (Check::List, what.to_owned());
            verdict.findings.push(Finding { check, record: 0, what, expected, found, limit: None });
        };
        if !names::is_named(object, &verdict.run, &verdict.digest) {
            let expected =
                format!("that of run {} and last digest {}", verdict.run, verdict.digest);
            differs("the name of the object", expected, object.clone());
        }
        if self.has_receipt {
            let receipt = Receipt::read(object, &store.get(&names::receipt_of(object))?)?;
            let found = sha256(&bytes);
            if receipt.sha256 != found {
                differs("the SHA-256 of the object", receipt.sha256, found);
            }
        }
        verdict.is_sound = verdict.findings.is_empty();
        Ok(verdict)
    }
}
