//! A bucket of S3, or of a program that speaks its protocol, as an object store.
//!
//! The place of the bucket and the credentials come from the variables of the environment that other programs use
//! too, such as `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT_URL` and
//! `AWS_CA_BUNDLE`. Without encryption it is spoken to only with `AWS_ALLOW_HTTP=true`.

mod http;

use std::time::Duration;

use bytes::Bytes;
use futures_util::TryStreamExt as _;
use object_store::{
    Error, ObjectMeta, ObjectStore as _, ObjectStoreExt as _, PutMode, RetryConfig,
    aws::{AmazonS3, AmazonS3Builder},
    path::Path,
};
use tokio::runtime::{Builder, Runtime};

use crate::StorageError;
use http::Connector;

/// A request that fails is sent again for this long.
const PATIENCE: Duration = Duration::from_secs(60);
const RETRIES: usize = 5;

#[derive(Debug)]
pub(crate) struct S3 {
    bucket: AmazonS3,
    /// The beginning of all keys: empty, or with a slash at its end.
    prefix: String,
    /// `None` only while it is dropped.
    runtime: Option<Runtime>,
}

impl Drop for S3 {
    fn drop(&mut self) {
        // An async function may drop it, and a runtime that waits for its threads there panics.
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

impl S3 {
    pub(crate) fn new(bucket: &str, prefix: &str) -> Result<Self, StorageError> {
        let retry =
            RetryConfig { max_retries: RETRIES, retry_timeout: PATIENCE, ..RetryConfig::default() };
        let bucket = AmazonS3Builder::from_env()
            .with_bucket_name(bucket)
            .with_http_connector(Connector)
            .with_retry(retry)
            .build()
            .map_err(Box::new)?;
        let runtime = Builder::new_current_thread().enable_all().build();
        let prefix = if prefix.is_empty() { String::new() } else { format!("{prefix}/") };
        Ok(Self { bucket, prefix, runtime: Some(runtime.map_err(StorageError::Runtime)?) })
    }

    /// The output of a request.
    fn block_on<T>(&self, request: impl Future<Output = T>) -> T {
        self.runtime.as_ref().expect("it is there until it is dropped").block_on(request)
    }

    fn path(&self, name: &str) -> Path {
        Path::from(format!("{}{name}", self.prefix))
    }

    pub(crate) fn list(&self, below: &str) -> Result<Vec<String>, StorageError> {
        let below = self.path(below);
        let listed = self.bucket.list(Some(&below)).try_collect::<Vec<ObjectMeta>>();
        let listed = self.block_on(listed).map_err(Box::new)?;
        let name = |object: &ObjectMeta| {
            Some(object.location.as_ref().strip_prefix(&self.prefix)?.to_owned())
        };
        let mut names: Vec<_> = listed.iter().filter_map(name).collect();
        names.sort();
        Ok(names)
    }

    pub(crate) fn get(&self, name: &str) -> Result<Bytes, StorageError> {
        let path = self.path(name);
        let get = async { self.bucket.get(&path).await?.bytes().await };
        Ok(self.block_on(get).map_err(Box::new)?)
    }

    /// Puts an object unless there is one: `If-None-Match: *`.
    pub(crate) fn put_new(&self, name: &str, object: &Bytes) -> Result<bool, StorageError> {
        let path = self.path(name);
        let put = self.bucket.put_opts(&path, object.clone().into(), PutMode::Create.into());
        match self.block_on(put) {
            Ok(_) => Ok(true),
            Err(Error::AlreadyExists { .. }) => Ok(false),
            Err(error) => Err(Box::new(error).into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_may_be_dropped_by_an_async_function() {
        let runtime = Builder::new_current_thread().build().unwrap();
        runtime.block_on(async { drop(S3::new("bucket", "").unwrap()) });
    }
}
