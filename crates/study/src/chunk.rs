//! A study in chunks: each is computed by a process of its own, on whatever computer, and the page of all of them is that of
//! one process.
//!
//! The items of a study, in their order, are dealt to the chunks in turn. A chunk is a file, or a piece in a queue, that says of which
//! study, program and arguments it is, and has a digest of all that it says.

use std::{
    collections::BTreeMap,
    fs,
    io::Write,
    path::{Path, PathBuf},
    str::FromStr,
};

use clap::builder::RangedU64ValueParser;
use rig_workqueue::{Action, CHUNKS_MAX, QueueArguments, Work, cut};
use rigd::{
    program::{self, head_of},
    rig::SOFTWARE,
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{files::Folder, outcome::StudyError};

/// A chunk that is computed, or chunks that are merged.
#[derive(Debug, Default, clap::Args)]
#[command(next_help_heading = "On many computers")]
pub(crate) struct ChunkArgs {
    /// Compute chunk I of N alone, and write it into the folder, as `STUDY-I-of-N.json`.
    #[arg(long, value_name = "I/N", conflicts_with_all = ["merge", "queue"])]
    chunk: Option<ChunkNumber>,
    /// Write the page of these chunks. The other arguments are those with which they were computed.
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "queue")]
    merge: Vec<PathBuf>,
    /// Number of chunks in the queue, the same for `--fill`, `--worker` and `--gather` [default: one for each part of the study]
    #[arg(
        long,
        value_name = "N",
        requires = "queue",
        value_parser = RangedU64ValueParser::<usize>::new().range(1..=CHUNKS_MAX)
    )]
    chunks: Option<usize>,
    #[command(flatten)]
    queue: QueueArguments,
}

/// What is left to do for a page.
pub(crate) enum Todo<T> {
    /// To compute everything, and to write the page into this folder.
    All(Folder),
    /// To write the page of these results.
    Page(Folder, Vec<T>),
    /// Nothing: this was a part.
    Nothing,
}

impl ChunkArgs {
    /// Does what these arguments ask for with the items of a study, whose page is to be written into a folder. `compute` gives the
    /// results of a chunk.
    ///
    /// # Errors
    /// A chunk that is missing, altered, or one of something else, a queue that is of no use, and files.
    pub(crate) fn run<T: Serialize + DeserializeOwned>(
        &self,
        whole: impl FnOnce() -> Result<Whole, StudyError>,
        items: usize,
        out_folder: &Path,
        out: &mut impl Write,
        compute: impl Fn(ChunkNumber) -> Vec<T>,
    ) -> Result<Todo<T>, StudyError> {
        let Some(asked) = self.queue.asked() else {
            // A folder that cannot be made is noticed before anything is computed.
            let folder = Folder::at(out_folder)?;
            return Ok(if let Some(chunk) = self.chunk {
                let path = whole()?.write(&folder, chunk, compute(chunk))?;
                writeln!(out, "{}", path.display())?;
                Todo::Nothing
            } else if self.merge.is_empty() {
                Todo::All(folder)
            } else {
                Todo::Page(folder, whole()?.merge(&self.merge, items)?)
            });
        };
        let of = self.chunks.unwrap_or(items);
        let whole = whole()?;
        let queue = || asked.connect(whole.work(of)?).map_err(StudyError::from);
        let chunks = 1..of as u64 + 1;
        match asked.action {
            Action::Fill(redelivery) => {
                let chunks: Vec<_> = cut(chunks, 1).collect();
                writeln!(out, "{}", queue()?.fill(&chunks, redelivery)?)?;
                Ok(Todo::Nothing)
            }
            Action::Work(within) => {
                queue()?.work(within, out, |chunk| {
                    let place = format!("{}/{of}", chunk.first).parse::<ChunkNumber>();
                    let place = place.map_err(StudyError::arguments)?;
                    let chunk = whole.chunk(place, compute(place))?;
                    let said = format!("{} results", chunk.results.len());
                    Ok::<_, StudyError>((chunk, said))
                })?;
                Ok(Todo::Nothing)
            }
            Action::Gather(within) => {
                let folder = Folder::at(out_folder)?;
                let pieces = queue()?.gather(&chunks, within)?;
                writeln!(out, "{} pieces", pieces.len())?;
                let named = |(chunk, piece): (rig_workqueue::Chunk, _)| {
                    Ok((format!("piece {} of the queue", chunk.first), piece))
                };
                let results = whole.join(pieces.into_iter().map(named), items)?;
                Ok(Todo::Page(folder, results))
            }
        }
    }
}

/// Which chunk of how many, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ChunkNumber {
    number: usize,
    of: usize,
}

/// A malformed number of a chunk.
#[derive(Debug, thiserror::Error)]
#[error("a chunk is I/N, such as 3/8: I from 1 to N")]
pub(crate) struct ChunkNumberError;

impl FromStr for ChunkNumber {
    type Err = ChunkNumberError;

    fn from_str(text: &str) -> Result<Self, ChunkNumberError> {
        let (number, of) = text.split_once('/').ok_or(ChunkNumberError)?;
        let read = |text: &str| text.parse::<usize>().map_err(|_| ChunkNumberError);
        let chunk = Self { number: read(number)?, of: read(of)? };
        if (1..=chunk.of).contains(&chunk.number) { Ok(chunk) } else { Err(ChunkNumberError) }
    }
}

impl ChunkNumber {
    /// The items of this chunk.
    pub(crate) fn of<T>(self, items: impl IntoIterator<Item = T>) -> impl Iterator<Item = T> {
        items.into_iter().skip(self.number - 1).step_by(self.of)
    }
}

/// What chunks are parts of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Whole {
    /// The name of the study.
    study: String,
    /// The first digits of the SHA-256 of the program's file.
    program: String,
    /// Every argument that changes the results.
    arguments: String,
}

/// A file, or a piece in a queue.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Chunk<T> {
    whole: Whole,
    /// Version and commit of the program.
    software: String,
    place: ChunkNumber,
    results: Vec<T>,
    /// The first digits of the SHA-256 of all of the above.
    digest: String,
}

/// Chunks that do not make a page.
#[derive(Debug, thiserror::Error)]
enum ChunkError {
    #[error("{name}")]
    Unread { name: String, source: std::io::Error },
    #[error("{name} is not a chunk of `rig-study {study}`")]
    Format { name: String, study: String, source: serde_json::Error },
    #[error("{name} was altered: its digest is {stated}, and that of what it says is {found}")]
    Altered { name: String, stated: String, found: String },
    #[error("{name} has {found} results, and this chunk has {expected}")]
    Length { name: String, found: usize, expected: usize },
    #[error("{name} is a chunk of `{found}`, and chunks of `{expected}` are merged")]
    Study { name: String, found: String, expected: String },
    #[error(
        "{name} was computed by the program {found}, and this is {expected}: all chunks are computed and merged by copies of one file"
    )]
    Program { name: String, found: String, expected: String },
    #[error(
        "{name} was computed with the arguments \"{found}\", and those of the page are \"{expected}\""
    )]
    Arguments { name: String, found: String, expected: String },
    #[error("{name} is one of {found} chunks, and others are of {expected}")]
    Cut { name: String, found: usize, expected: usize },
    #[error(
        "chunk {number} is there twice, with the digests {} and {}: {} or {} is wrong, or the results do not depend on the \
         arguments alone", digests[0], digests[1], names[0], names[1]
    )]
    Differ { number: usize, digests: [String; 2], names: Box<[String; 2]> },
    #[error("of {of} chunks these are missing: {}", list(missing))]
    Missing { of: usize, missing: Vec<usize> },
}

fn list(numbers: &[usize]) -> String {
    numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
}

impl Whole {
    /// A study of this program with these arguments.
    ///
    /// # Errors
    /// The program's file cannot be read.
    pub(crate) fn new(study: &str, arguments: String) -> Result<Self, StudyError> {
        Ok(Self { study: study.to_owned(), program: program::digest()?, arguments })
    }

    /// The work of a queue with this number of chunks.
    fn work(&self, chunks: usize) -> Result<Work, StudyError> {
        let Self { study, arguments, program } = self;
        Ok(Work {
            kind: "study",
            noun: "chunk",
            alone: "compute one alone, with --chunk I/N,",
            title: format!("{study} {arguments}, {chunks} chunks,"),
            content: head_of(serde_json::to_vec(&(study, arguments, chunks))?),
            program: program.clone(),
        })
    }

    /// A chunk with its digest.
    fn chunk<T: Serialize>(
        &self,
        place: ChunkNumber,
        results: Vec<T>,
    ) -> Result<Chunk<T>, StudyError> {
        let (whole, software) = (self.clone(), SOFTWARE.to_owned());
        let mut chunk = Chunk { whole, software, place, results, digest: String::new() };
        chunk.digest = chunk.computed_digest()?;
        Ok(chunk)
    }

    /// Writes a chunk into the folder, and returns its path. Nobody sees half of it.
    fn write<T: Serialize>(
        &self,
        folder: &Folder,
        place: ChunkNumber,
        results: Vec<T>,
    ) -> Result<PathBuf, StudyError> {
        let name = format!("{}-{}-of-{}.json", self.study, place.number, place.of);
        let chunk = self.chunk(place, results)?;
        folder.replace(&name, &(serde_json::to_string(&chunk)? + "\n"))?;
        Ok(folder.path(&name))
    }

    /// The results of all items in their order, from files. A chunk that is there twice counts once.
    ///
    /// # Errors
    /// A chunk that is missing, altered, or one of something else.
    fn merge<T: Serialize + DeserializeOwned>(
        &self,
        paths: &[PathBuf],
        items: usize,
    ) -> Result<Vec<T>, StudyError> {
        let read = |path: &PathBuf| Ok((path.display().to_string(), self.read(path)?));
        self.join(paths.iter().map(read), items)
    }

    /// The same from chunks with their names.
    fn join<T: Serialize>(
        &self,
        named: impl Iterator<Item = Result<(String, Chunk<T>), StudyError>>,
        items: usize,
    ) -> Result<Vec<T>, StudyError> {
        let mut chunks = BTreeMap::<usize, (String, Chunk<T>)>::new();
        for chunk in named {
            let (name, chunk) = chunk?;
            self.check(&name, &chunk, items)?;
            let ChunkNumber { number, of } = chunk.place;
            if let Some((_, first)) = chunks.values().next()
                && first.place.of != of
            {
                let (found, expected) = (of, first.place.of);
                return Err(StudyError::refused(ChunkError::Cut { name, found, expected }));
            }
            match chunks.get(&number) {
                Some((_, known)) if known.digest == chunk.digest => {}
                Some((other, known)) => {
                    let digests = [known.digest.clone(), chunk.digest];
                    let names = Box::new([other.clone(), name]);
                    return Err(StudyError::refused(ChunkError::Differ { number, digests, names }));
                }
                None => _ = chunks.insert(number, (name, chunk)),
            }
        }
        let of = chunks.values().next().map_or(0, |(_, chunk)| chunk.place.of);
        let missing: Vec<_> = (1..=of).filter(|number| !chunks.contains_key(number)).collect();
        if !missing.is_empty() {
            return Err(StudyError::refused(ChunkError::Missing { of, missing }));
        }
        let mut parts: Vec<_> =
            chunks.into_values().map(|(_, chunk)| chunk.results.into_iter()).collect();
        // The lengths were checked.
        Ok((0..items).filter_map(|item| parts[item % of].next()).collect())
    }

    fn read<T: DeserializeOwned>(&self, path: &Path) -> Result<Chunk<T>, StudyError> {
        let name = || path.display().to_string();
        let text = fs::read_to_string(path)
            .map_err(|source| StudyError::refused(ChunkError::Unread { name: name(), source }))?;
        serde_json::from_str(&text).map_err(|source| {
            let (name, study) = (name(), self.study.clone());
            StudyError::refused(ChunkError::Format { name, study, source })
        })
    }

    /// Checks that this is a chunk of this whole, and was not altered.
    fn check<T: Serialize>(
        &self,
        name: &str,
        chunk: &Chunk<T>,
        items: usize,
    ) -> Result<(), StudyError> {
        let name = name.to_owned();
        let refused = |error| Err(StudyError::refused(error));
        let computed = chunk.computed_digest()?;
        if chunk.digest != computed {
            let (stated, found) = (chunk.digest.clone(), computed);
            return refused(ChunkError::Altered { name, stated, found });
        }
        let differ = |of: fn(&Self) -> &String| {
            let (found, expected) = (of(&chunk.whole).clone(), of(self).clone());
            (found != expected).then_some((found, expected))
        };
        if let Some((found, expected)) = differ(|whole| &whole.study) {
            return refused(ChunkError::Study { name, found, expected });
        }
        if let Some((found, expected)) = differ(|whole| &whole.program) {
            return refused(ChunkError::Program { name, found, expected });
        }
        if let Some((found, expected)) = differ(|whole| &whole.arguments) {
            return refused(ChunkError::Arguments { name, found, expected });
        }
        let ChunkNumber { number, of } = chunk.place;
        if !(1..=of).contains(&number) {
            return refused(ChunkError::Cut { name, found: of, expected: number });
        }
        let (found, expected) = (chunk.results.len(), chunk.place.of(0..items).count());
        if found != expected {
            return refused(ChunkError::Length { name, found, expected });
        }
        Ok(())
    }
}

impl<T: Serialize> Chunk<T> {
    fn computed_digest(&self) -> Result<String, serde_json::Error> {
        let Self { whole, software, place, results, digest: _ } = self;
        Ok(head_of(serde_json::to_vec(&(whole, software, place, results))?))
    }
}

#[cfg(test)]
mod tests;
