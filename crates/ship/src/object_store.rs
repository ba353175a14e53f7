//! An object store: what is put there under a name stays as it is.

use std::io;

use bytes::Bytes;

use crate::{Address, folder::Folder};

/// An object store.
#[derive(Debug)]
pub struct ObjectStore {
    address: Address,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    Folder(Folder),
}

/// Why an object store cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StorageError {
    /// A file of a folder.
    #[error("{path}")]
    File {
        /// Path of the file.
        path: String,
        /// The error of the system.
        source: io::Error,
    },
}

impl ObjectStore {
    /// The object store at an address. A folder is made when the first object is put there.
    pub fn at(address: Address) -> Self {
        let kind = match &address {
            Address::Folder(root) => Kind::Folder(Folder::new(root.clone())),
        };
        Self { address, kind }
    }

    /// Where it is.
    pub const fn address(&self) -> &Address {
        &self.address
    }

    /// The names of all objects that begin with `below`, which is empty or ends with a slash, in order.
    ///
    /// # Errors
    /// [`StorageError`].
    pub fn list(&self, below: &str) -> Result<Vec<String>, StorageError> {
        match &self.kind {
            Kind::Folder(folder) => folder.list(below),
        }
    }

    /// An object.
    ///
    /// # Errors
    /// [`StorageError`], also if there is none.
    pub fn get(&self, name: &str) -> Result<Bytes, StorageError> {
        match &self.kind {
            Kind::Folder(folder) => folder.get(name),
        }
    }

    /// Puts an object, which is whole and on disk when this returns. One that is there already stays as it is.
    /// Returns whether there was none.
    ///
    /// # Errors
    /// [`StorageError`]. The object is there as a whole or not at all.
    pub fn put_new(&self, name: &str, object: &Bytes) -> Result<bool, StorageError> {
        match &self.kind {
            Kind::Folder(folder) => folder.put_new(name, object),
        }
    }
}
