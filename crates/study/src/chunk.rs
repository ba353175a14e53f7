//! A study in chunks: each is computed by a process of its own, on whatever computer, and the page of all of them is that of
//! one process.
//!
//! The items of a study, in their order, are dealt to the chunks in turn. A chunk is a file that says of which study, program and
//! arguments it is, and has a digest of all that it says.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    str::FromStr,
};

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
    #[arg(long, value_name = "I/N", conflicts_with = "merge")]
    pub(crate) chunk: Option<ChunkNumber>,
    /// Write the page of these chunks. The other arguments are those with which they were computed.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub(crate) merge: Vec<PathBuf>,
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

/// A file.
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
    #[error("{}", path.display())]
    Unread { path: PathBuf, source: std::io::Error },
    #[error("{} is not a chunk of `rig-study {study}`", path.display())]
    Format { path: PathBuf, study: String, source: serde_json::Error },
    #[error("{} was altered: its digest is {stated}, and that of what it says is {found}", path.display())]
    Altered { path: PathBuf, stated: String, found: String },
    #[error("{} has {found} results, and this chunk has {expected}", path.display())]
    Length { path: PathBuf, found: usize, expected: usize },
    #[error("{} is a chunk of `{found}`, and chunks of `{expected}` are merged", path.display())]
    Study { path: PathBuf, found: String, expected: String },
    #[error(
        "{} was computed by the program {found}, and this is {expected}: all chunks are computed and merged by copies of one file",
        path.display()
    )]
    Program { path: PathBuf, found: String, expected: String },
    #[error("{} was computed with the arguments \"{found}\", and those of the page are \"{expected}\"", path.display())]
    Arguments { path: PathBuf, found: String, expected: String },
    #[error("{} is one of {found} chunks, and others are of {expected}", path.display())]
    Cut { path: PathBuf, found: usize, expected: usize },
    #[error(
        "chunk {number} is there twice, with the digests {} and {}: {} or {} is wrong, or the results do not depend on the \
         arguments alone", digests[0], digests[1], paths[0].display(), paths[1].display()
    )]
    Differ { number: usize, digests: [String; 2], paths: Box<[PathBuf; 2]> },
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

    /// Writes a chunk into the folder, and returns its path. Nobody sees half of it.
    pub(crate) fn write<T: Serialize>(
        self,
        folder: &Folder,
        chunk: ChunkNumber,
        results: Vec<T>,
    ) -> Result<PathBuf, StudyError> {
        let name = format!("{}-{}-of-{}.json", self.study, chunk.number, chunk.of);
        let software = SOFTWARE.to_owned();
        let mut file =
            Chunk { whole: self, software, place: chunk, results, digest: String::new() };
        file.digest = file.computed_digest()?;
        folder.replace(&name, &(serde_json::to_string(&file)? + "\n"))?;
        Ok(folder.path(&name))
    }

    /// The results of all items in their order. A chunk that is there twice counts once.
    ///
    /// # Errors
    /// A chunk that is missing, altered, or one of something else.
    pub(crate) fn merge<T: Serialize + DeserializeOwned>(
        &self,
        paths: &[PathBuf],
        items: usize,
    ) -> Result<Vec<T>, StudyError> {
        let mut chunks = BTreeMap::<usize, (&PathBuf, Chunk<T>)>::new();
        for path in paths {
            let chunk = self.read(path, items)?;
            let ChunkNumber { number, of } = chunk.place;
            if let Some((_, first)) = chunks.values().next()
                && first.place.of != of
            {
                let (path, found, expected) = (path.clone(), of, first.place.of);
                return Err(StudyError::refused(ChunkError::Cut { path, found, expected }));
            }
            match chunks.get(&number) {
                Some((_, known)) if known.digest == chunk.digest => {}
                Some((other, known)) => {
                    let digests = [known.digest.clone(), chunk.digest];
                    let paths = Box::new([(*other).clone(), path.clone()]);
                    return Err(StudyError::refused(ChunkError::Differ { number, digests, paths }));
                }
                None => _ = chunks.insert(number, (path, chunk)),
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

    /// A chunk of this whole.
    fn read<T: Serialize + DeserializeOwned>(
        &self,
        path: &Path,
        items: usize,
    ) -> Result<Chunk<T>, StudyError> {
        let to = path.to_owned();
        let refused = |error| Err(StudyError::refused(error));
        let text = match fs::read_to_string(path) {
            Ok(text) => text,
            Err(source) => return refused(ChunkError::Unread { path: to, source }),
        };
        let study = self.study.clone();
        let chunk: Chunk<T> = match serde_json::from_str(&text) {
            Ok(chunk) => chunk,
            Err(source) => return refused(ChunkError::Format { path: to, study, source }),
        };
        let computed = chunk.computed_digest()?;
        if chunk.digest != computed {
            let (stated, found) = (chunk.digest, computed);
            return refused(ChunkError::Altered { path: to, stated, found });
        }
        let differ = |of: fn(&Self) -> &String| {
            let (found, expected) = (of(&chunk.whole).clone(), of(self).clone());
            (found != expected).then_some((found, expected))
        };
        if let Some((found, expected)) = differ(|whole| &whole.study) {
            return refused(ChunkError::Study { path: to, found, expected });
        }
        if let Some((found, expected)) = differ(|whole| &whole.program) {
            return refused(ChunkError::Program { path: to, found, expected });
        }
        if let Some((found, expected)) = differ(|whole| &whole.arguments) {
            return refused(ChunkError::Arguments { path: to, found, expected });
        }
        let ChunkNumber { number, of } = chunk.place;
        if !(1..=of).contains(&number) {
            return refused(ChunkError::Cut { path: to, found: of, expected: number });
        }
        let (found, expected) = (chunk.results.len(), chunk.place.of(0..items).count());
        if found != expected {
            return refused(ChunkError::Length { path: to, found, expected });
        }
        Ok(chunk)
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
