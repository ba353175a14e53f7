//! An object store: what is put there under a name stays as it is.

use std::io;

use bytes::Bytes;

#[cfg(feature = "s3")]
use crate::s3::S3;
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
    #[cfg(feature = "s3")]
    S3(S3),
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
    /// The program has no S3.
    #[cfg(not(feature = "s3"))]
    #[error("this rigd was built without S3; build it with `--features s3`, or give `folder:DIR`")]
    NoS3,
    /// A bucket of S3.
    #[cfg(feature = "s3")]
    #[error("object store of S3")]
    S3(#[from] Box<object_store::Error>),
    /// The system gives no runtime for requests.
    #[cfg(feature = "s3")]
    #[error("requests to S3")]
    Runtime(#[source] io::Error),
}

impl StorageError {
    /// Whether the store has no object of this name.
    pub(crate) fn is_absent(&self) -> bool {
        match self {
            Self::File { source, .. } => source.kind() == io::ErrorKind::NotFound,
            #[cfg(not(feature = "s3"))]
            Self::NoS3 => false,
            #[cfg(feature = "s3")]
            Self::S3(error) => matches!(**error, object_store::Error::NotFound { .. }),
            #[cfg(feature = "s3")]
            Self::Runtime(_) => false,
        }
    }
}

impl ObjectStore {
    /// The object store at an address. A folder is made when the first object is put there.
    ///
    /// # Errors
    /// [`StorageError`] if S3 cannot be used; nothing is asked of it yet.
    pub fn at(address: Address) -> Result<Self, StorageError> {
        let kind = match &address {
            Address::Folder(root) => Kind::Folder(Folder::new(root.clone())),
            #[cfg(feature = "s3")]
            Address::S3 { bucket, prefix } => Kind::S3(S3::new(bucket, prefix)?),
            #[cfg(not(feature = "s3"))]
            Address::S3 { .. } => return Err(StorageError::NoS3),
        };
        Ok(Self { address, kind })
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
            #[cfg(feature = "s3")]
            Kind::S3(s3) => s3.list(below),
        }
    }

    /// An object.
    ///
    /// # Errors
    /// [`StorageError`], also if there is none.
    pub fn get(&self, name: &str) -> Result<Bytes, StorageError> {
        match &self.kind {
            Kind::Folder(folder) => folder.get(name),
            #[cfg(feature = "s3")]
            Kind::S3(s3) => s3.get(name),
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
            #[cfg(feature = "s3")]
            Kind::S3(s3) => s3.put_new(name, object),
        }
    }
}
