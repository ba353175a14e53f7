//! Exports of runs.
//!
//! Tables of sweeps, readings and searches, and the records, are sent while they are made: a few records at a time
//! are read from the journal, and the next ones only when the client has taken these. Memory and threads are used for
//! no client that is slow, and the size of the run does not matter. The touches, the documents and HDF5 are made of
//! the results of the run, and are built in one piece. Each export counts as under way until it is sent or given up.

use std::{
    convert::Infallible,
    io::{self, Write},
    mem,
    sync::{Arc, Mutex, PoisonError},
};

use axum::{
    body::{Body, Bytes},
    extract::{Path, Query, State, rejection::QueryRejection},
    http::header,
    response::{IntoResponse, Response},
};
use futures_util::stream;
use rig_model::with_causes;
use rig_report::export::{
    self, ExportError, Hdf5Export, RunColumns, TableExport, TableFormat, TableName,
};
use rig_store::{Pages, Reader, RunId, StoreError, intact};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::{runtime::Handle, sync::OwnedSemaphorePermit};

use super::{Problem, Shared};

/// Exports that may be under way at a time. Each has the journal open and, as Parquet, a group of rows in memory.
pub(super) const EXPORTS_MAX: usize = 8;
/// A part is sent when it has this size, bytes.
pub(super) const PART: usize = 256 << 10;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ExportOptions {
    #[serde(default)]
    format: ExportFormat,
    /// With `csv` or `parquet`: which table.
    #[serde(default)]
    table: ExportTable,
}

#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum ExportFormat {
    /// A table as CSV.
    #[default]
    Csv,
    /// A table as Parquet.
    Parquet,
    /// All tables as HDF5.
    Hdf5,
    /// `csv` of the sweeps.
    Sweeps,
    /// `csv` of the readings.
    Readings,
    /// `csv` of the searches.
    Searches,
    /// Every record.
    Jsonl,
    /// The event model of bluesky.
    Documents,
}

#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum ExportTable {
    #[default]
    Touches,
    Sweeps,
    Readings,
    Searches,
}

impl ExportOptions {
    /// The table to write; `None` for the formats that are no tables.
    const fn table(&self) -> Option<(TableName, TableFormat)> {
        let name = match self.table {
            ExportTable::Touches => TableName::Touches,
            ExportTable::Sweeps => TableName::Sweeps,
            ExportTable::Readings => TableName::Readings,
            ExportTable::Searches => TableName::Searches,
        };
        match self.format {
            ExportFormat::Csv => Some((name, TableFormat::Csv)),
            ExportFormat::Parquet => Some((name, TableFormat::Parquet)),
            ExportFormat::Sweeps => Some((TableName::Sweeps, TableFormat::Csv)),
            ExportFormat::Readings => Some((TableName::Readings, TableFormat::Csv)),
            ExportFormat::Searches => Some((TableName::Searches, TableFormat::Csv)),
            ExportFormat::Hdf5 | ExportFormat::Jsonl | ExportFormat::Documents => None,
        }
    }

    fn media_type(&self) -> &'static str {
        match (self.table(), self.format) {
            (Some((_, TableFormat::Csv)), _) => CSV,
            (Some((_, TableFormat::Parquet)), _) => "application/vnd.apache.parquet",
            (None, ExportFormat::Hdf5) => "application/x-hdf5",
            (None, _) => "application/jsonl",
        }
    }

    fn file(&self) -> String {
        match (self.table(), self.format) {
            (Some((name, format)), _) => format!("{}.{}", name.name(), format.extension()),
            (None, ExportFormat::Hdf5) => "tables.h5".to_owned(),
            (None, ExportFormat::Documents) => "documents.jsonl".to_owned(),
            (None, _) => "records.jsonl".to_owned(),
        }
    }
}

const CSV: &str = "text/csv; charset=utf-8";

/// Sends an export of a run.
pub(super) async fn show(
    State(shared): State<Shared>,
    Path(id): Path<String>,
    options: Result<Query<ExportOptions>, QueryRejection>,
) -> Result<Response, Problem> {
    let id = shared.run(&id).await?;
    let Query(options) = options?;
    let place = shared.place_of_export()?;
    let (media_type, file) = (options.media_type(), options.file());
    let data = shared.inner.data.clone();
    let inner = Arc::clone(&shared.inner);
    let begun = shared.build(move |reader| {
        let simulated = if reader.is_simulated(id) { "-simulated" } else { "" };
        let disposition = format!("attachment; filename=\"{id}{simulated}-{file}\"");
        let form = match (options.table(), options.format) {
            (Some((TableName::Touches, _)), _) => None,
            (Some(table), _) => Some(Some(table)),
            (None, ExportFormat::Jsonl) => Some(None),
            (None, _) => None,
        };
        if let Some(table) = form {
            // It is read on while the client takes it, whatever is asked of others meanwhile.
            let export = Export::begin(Reader::open(&data)?, id, table, place)?;
            return Ok((disposition, Begun::Parts(Box::new(export))));
        }
        let found = inner.results.of(reader, id)?;
        intact(id, &found.check)?;
        let records = reader.amended(id)?;
        let mut bytes = Vec::new();
        match options.table() {
            None if matches!(options.format, ExportFormat::Hdf5) => {
                let mut tables = Hdf5Export::new(false);
                tables.add(&found.results, &records).map(|()| bytes = tables.finish())
            }
            None => export::documents(&found.results, &records, &mut bytes),
            Some((name, format)) => {
                export::table(name, format, &found.results, &records, &mut bytes)
            }
        }
        .map_err(|error| Problem::internal(&with_causes(&error)))?;
        Ok((disposition, Begun::Whole(bytes, place)))
    });
    let (disposition, begun) = begun.await?;
    let headers =
        [(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_DISPOSITION, disposition)];
    Ok(match begun {
        Begun::Whole(bytes, place) => {
            let length = [(header::CONTENT_LENGTH, bytes.len().to_string())];
            (headers, length, whole(bytes.into(), place)).into_response()
        }
        Begun::Parts(export) => {
            (headers, sent(export, shared.inner.builders.clone())).into_response()
        }
    })
}

impl Shared {
    /// One of the exports that may be under way.
    pub(super) fn place_of_export(&self) -> Result<OwnedSemaphorePermit, Problem> {
        Arc::clone(&self.inner.exports).try_acquire_owned().map_err(|_| {
            let detail =
                format!("{EXPORTS_MAX} exports or long plans are under way, which is the limit");
            Problem::busy(detail)
        })
    }
}

/// An export that can be sent.
enum Begun {
    /// All of it, and its place among the exports that may be under way.
    Whole(Vec<u8>, OwnedSemaphorePermit),
    Parts(Box<Export>),
}

/// An export that is made in parts.
struct Export {
    reader: Reader,
    run: RunId,
    pages: Pages,
    form: Form,
    made: Made,
    /// One of the exports that may be under way.
    _place: OwnedSemaphorePermit,
}

enum Form {
    Table(Box<(TableExport<Made>, RunColumns)>),
    Records,
    /// All of it is made.
    Ended,
}

/// What was made and not yet sent. Clones are the same.
#[derive(Debug, Clone, Default)]
struct Made(Arc<Mutex<Vec<u8>>>);

/// Why an export ends before its end.
#[derive(Debug, thiserror::Error)]
enum Cut {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Export(#[from] ExportError),
    #[error("the builder has panicked")]
    Panicked,
}

impl Export {
    /// Checks all records of the run.
    fn begin(
        reader: Reader,
        run: RunId,
        table: Option<(TableName, TableFormat)>,
        place: OwnedSemaphorePermit,
    ) -> Result<Self, Problem> {
        let made = Made::default();
        let (pages, form) = match table {
            None => (reader.pages(run)?, Form::Records),
            Some((name, format)) => {
                let pages = reader.amended_pages(run)?;
                let epochs = pages.epochs().to_vec();
                let of = RunColumns::new(&reader.run(run)?, epochs, pages.is_simulated());
                let table = TableExport::new(name, format, false, made.clone())
                    .map_err(|error| Problem::internal(&with_causes(&error)))?;
                (pages, Form::Table(Box::new((table, of))))
            }
        };
        Ok(Self { reader, run, pages, form, made, _place: place })
    }

    /// The next part; none at the end.
    fn part(&mut self) -> Result<Option<Bytes>, Cut> {
        while self.made.size() < PART && !matches!(self.form, Form::Ended) {
            let page = self.reader.next_page(&mut self.pages)?;
            match &mut self.form {
                _ if page.is_empty() => {
                    if let Form::Table(table) = mem::replace(&mut self.form, Form::Ended) {
                        table.0.finish()?;
                    }
                }
                Form::Table(table) => {
                    let (table, of) = &mut **table;
                    table.add_records(of, &page)?;
                }
                Form::Records => export::jsonl(&page, &mut self.made)?,
                Form::Ended => {}
            }
        }
        Ok(Some(self.made.take()).filter(|part| !part.is_empty()))
    }
}

impl Made {
    fn size(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    fn take(&self) -> Bytes {
        mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner)).into()
    }
}

impl Write for Made {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A document in parts as the client takes them. It keeps its place until the last one is taken, or the client is gone.
pub(super) fn whole(bytes: Bytes, place: OwnedSemaphorePermit) -> Body {
    let parts = stream::unfold((bytes, place), |(mut bytes, place)| async move {
        let part = bytes.split_to(PART.min(bytes.len()));
        (!part.is_empty()).then_some((Ok::<_, Infallible>(part), (bytes, place)))
    });
    Body::from_stream(parts)
}

/// The parts as the client takes them. A part that cannot be made ends the connection, so that the client sees that
/// something is missing.
fn sent(export: Box<Export>, builders: Handle) -> Body {
    let parts = stream::try_unfold(Some(export), move |export| {
        let builders = builders.clone();
        async move {
            let Some(mut export) = export else { return Ok(None) };
            let run = export.run;
            let made = builders.spawn_blocking(move || (export.part(), export)).await;
            match made.map_err(|_| Cut::Panicked).and_then(|(part, export)| Ok((part?, export))) {
                Ok((part, export)) => Ok(part.map(|part| (part, Some(export)))),
                Err(cut) => {
                    tracing::warn!(%run, error = with_causes(&cut), "an export was cut short");
                    Err(cut)
                }
            }
        }
    });
    Body::from_stream(parts)
}

#[cfg(test)]
mod tests {
    use axum::body::to_bytes;
    use http_body_util::BodyExt;
    use tokio::sync::Semaphore;

    use super::*;

    #[tokio::test]
    async fn a_document_keeps_its_place_until_it_is_taken_or_given_up() {
        let places = Arc::new(Semaphore::new(1));
        let begin = || {
            let place = Arc::clone(&places).try_acquire_owned().unwrap();
            whole(vec![7_u8; 2 * PART + 1].into(), place)
        };
        let mut body = begin();
        let first = body.frame().await.unwrap().unwrap().into_data().unwrap();
        assert_eq!((first.len(), places.available_permits()), (PART, 0));
        let rest = to_bytes(body, usize::MAX).await.unwrap();
        assert_eq!((rest.len(), places.available_permits()), (PART + 1, 1));
        drop(begin());
        assert_eq!(places.available_permits(), 1);
    }
}
