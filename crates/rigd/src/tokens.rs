//! The tokens of persons and programs: `tokens.json` in the data directory.
//!
//! The file has a fingerprint of each token and never the token itself. `rigd token` writes it; the daemon
//! reads it again when it has changed, so that a token that is revoked opens nothing from then on.

use std::{
    collections::BTreeMap,
    fmt::{self, Write as _},
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{SystemTime, UNIX_EPOCH},
};

use clap::ValueEnum;
use rig_record::Digest;
use rig_store::make_directory;
use rig_system::files::{RANDOM_NUMBERS, Stamp, forbidden_mode, with_mode};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::{durable, operator::Operator};

const FILE: &str = "tokens.json";
/// Time of the last use of each token, written by the daemon alone.
const USES_FILE: &str = "tokens-used.json";
/// Held by the program that changes the list.
const LOCK_FILE: &str = "tokens.lock";
/// Writing by the group or by others.
const MODE_FORBIDDEN: u32 = 0o022;
/// A lab has some ten people and programs.
const TOKENS_MAX: usize = 256;
/// Recognised by programs that look for secrets in files.
const PREFIX: &str = "rigd_";

/// What the client with a token may do. Each role includes those before it.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    JsonSchema,
    ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Read everything, and stop the rig
    View,
    /// Lead the rig: runs, sweeps, moves, answers
    Operate,
    /// End the turn of another person
    Admin,
}

impl Role {
    /// Its name in files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::View => "view",
            Self::Operate => "operate",
            Self::Admin => "admin",
        }
    }
}

/// A new secret of 256 random bits.
pub struct Secret(String);

impl Secret {
    /// Makes one from the random numbers of the system.
    ///
    /// # Errors
    /// The system gives none.
    pub fn new() -> io::Result<Self> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(io::Error::other)?;
        let mut text = PREFIX.to_owned();
        for byte in bytes {
            // Writing to a string does not fail.
            _ = write!(text, "{byte:02x}");
        }
        Ok(Self(text))
    }

    /// The secret itself.
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret")
    }
}

/// SHA-256 of a secret. A secret of 256 random bits cannot be found from it.
pub fn fingerprint(secret: &str) -> String {
    Digest::from_bytes(Sha256::digest(secret.as_bytes()).into()).to_string()
}

/// A token in the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NamedToken {
    /// The person or program, as the journal names it.
    pub name: String,
    /// What it may do.
    pub role: Role,
    /// SHA-256 of the token, hexadecimal.
    pub sha256: String,
    /// When it was made, s since 1970.
    pub made_unix_s: u64,
}

/// Why the tokens cannot be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum TokensError {
    /// The file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system, or of its content.
        source: io::Error,
    },
    /// Other users could change it.
    #[error(
        "{} has mode {mode:03o}: other users could add a token of their own; run `chmod 600 {}`",
        path.display(), path.display()
    )]
    Open {
        /// Path of the file.
        path: PathBuf,
        /// Permission bits of the file.
        mode: u32,
    },
    /// Each name has one token.
    #[error("{name} has a token; `rigd token revoke {name}` ends it first")]
    Taken {
        /// The name asked for.
        name: Operator,
    },
    /// There is no token to revoke.
    #[error("there is no token of {name}; `rigd token list` shows the names")]
    Unknown {
        /// The name asked for.
        name: Operator,
    },
    /// The list is full.
    #[error("there are {TOKENS_MAX} tokens, which is the limit; revoke those that are not used")]
    Full,
}

/// The tokens of a data directory; none without the file.
///
/// # Errors
/// [`TokensError`] names the file and its fault.
pub fn read(data: &Path) -> Result<Vec<NamedToken>, TokensError> {
    let path = data.join(FILE);
    let failed = |source| TokensError::File { path: path.clone(), source };
    let file = match File::open(&path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(failed(error)),
    };
    let metadata = file.metadata().map_err(failed)?;
    if let Some(mode) = forbidden_mode(&metadata, MODE_FORBIDDEN) {
        return Err(TokensError::Open { path, mode });
    }
    let text = io::read_to_string(file).map_err(failed)?;
    serde_json::from_str(&text).map_err(|error| failed(error.into()))
}

/// Makes a token, and keeps its fingerprint.
///
/// # Errors
/// [`TokensError`]; nothing has changed then.
pub fn make(data: &Path, name: &Operator, role: Role) -> Result<Secret, TokensError> {
    let _turn = lock(data)?;
    let mut tokens = read(data)?;
    if tokens.iter().any(|token| token.name == name.as_str()) {
        return Err(TokensError::Taken { name: name.clone() });
    }
    if tokens.len() >= TOKENS_MAX {
        return Err(TokensError::Full);
    }
    let failed = |source| TokensError::File { path: PathBuf::from(RANDOM_NUMBERS), source };
    let secret = Secret::new().map_err(failed)?;
    tokens.push(NamedToken {
        name: name.to_string(),
        role,
        sha256: fingerprint(secret.reveal()),
        made_unix_s: unix_s(),
    });
    replace(&data.join(FILE), &tokens)?;
    Ok(secret)
}

/// Takes a token out.
///
/// # Errors
/// [`TokensError`]; nothing has changed then.
pub fn revoke(data: &Path, name: &Operator) -> Result<(), TokensError> {
    let _turn = lock(data)?;
    let mut tokens = read(data)?;
    let before = tokens.len();
    tokens.retain(|token| token.name != name.as_str());
    if tokens.len() == before {
        return Err(TokensError::Unknown { name: name.clone() });
    }
    replace(&data.join(FILE), &tokens)
}

/// When each token was last used, by its fingerprint, s since 1970.
pub fn uses(data: &Path) -> BTreeMap<String, u64> {
    // It is a convenience: an unreadable file is as none.
    let text = fs::read_to_string(data.join(USES_FILE)).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

fn lock(data: &Path) -> Result<File, TokensError> {
    let path = data.join(LOCK_FILE);
    let failed = |source| TokensError::File { path: path.clone(), source };
    make_directory(data).map_err(failed)?;
    let mut options = File::options();
    let options = with_mode(options.create(true).truncate(false).write(true), 0o600);
    let file = options.open(&path).map_err(failed)?;
    file.lock().map_err(failed)?;
    Ok(file)
}

fn replace(path: &Path, value: &impl Serialize) -> Result<(), TokensError> {
    let written = durable::replace(path, value, durable::FOR_OWNER);
    written.map_err(|source| TokensError::File { path: path.to_path_buf(), source })
}

/// The present time, s since 1970.
pub fn unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// The tokens as the daemon knows them.
#[derive(Debug)]
pub struct Tokens {
    data: PathBuf,
    known: Mutex<Known>,
}

#[derive(Debug, Default)]
struct Known {
    stamp: Option<Stamp>,
    /// By fingerprint.
    tokens: BTreeMap<String, (Operator, Role)>,
    uses: BTreeMap<String, u64>,
    is_kept: bool,
    /// There has been a token since the start.
    is_in_use: bool,
}

impl Tokens {
    /// The tokens of a data directory.
    ///
    /// # Errors
    /// [`TokensError`] names the file and its fault.
    pub fn open(data: &Path) -> Result<Self, TokensError> {
        read(data)?;
        let known = Known { uses: uses(data), is_kept: true, ..Known::default() };
        Ok(Self { data: data.to_path_buf(), known: Mutex::new(known) })
    }

    /// Whether clients must have a token. Once there has been one, taking the last one out opens nothing.
    pub fn is_in_use(&self) -> bool {
        self.current().is_in_use
    }

    /// Who has the token with this fingerprint, and what it may do.
    pub fn find(&self, fingerprint: &str) -> Option<(Operator, Role)> {
        let mut known = self.current();
        let found = known.tokens.get(fingerprint)?.clone();
        known.uses.insert(fingerprint.to_owned(), unix_s());
        known.is_kept = false;
        Some(found)
    }

    /// Writes the times of the last uses, if there is news.
    pub fn keep_uses(&self) {
        let mut known = self.current();
        let Known { tokens, uses, .. } = &mut *known;
        uses.retain(|fingerprint, _| tokens.contains_key(fingerprint));
        if std::mem::replace(&mut known.is_kept, true) {
            return;
        }
        let uses = known.uses.clone();
        drop(known);
        if let Err(error) = replace(&self.data.join(USES_FILE), &uses) {
            tracing::warn!(%error, "the last uses of tokens cannot be kept");
        }
    }

    /// As the file is now.
    fn current(&self) -> MutexGuard<'_, Known> {
        // Nothing that holds it panics.
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let stamp = fs::metadata(self.data.join(FILE)).ok().map(|file| Stamp::of(&file));
        if stamp != known.stamp {
            known.stamp = stamp;
            known.tokens = match read(&self.data) {
                Ok(tokens) => tokens.into_iter().filter_map(entry).collect(),
                Err(error) => {
                    let error = rig_model::with_causes(&error);
                    tracing::warn!(error, "no token is accepted");
                    BTreeMap::new()
                }
            };
            known.is_in_use |= stamp.is_some();
        }
        known
    }
}

fn entry(token: NamedToken) -> Option<(String, (Operator, Role))> {
    Some((token.sha256, (token.name.parse().ok()?, token.role)))
}

// Modes of files are of Unix.
#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use tempfile::TempDir;

    use super::*;

    #[test]
    fn a_token_is_found_until_it_is_revoked_and_is_in_no_file() {
        let data = TempDir::new().unwrap();
        let (ada, script) = ("ada".parse().unwrap(), "night script".parse().unwrap());
        let tokens = Tokens::open(data.path()).unwrap();
        assert!(!tokens.is_in_use());
        let secret = make(data.path(), &ada, Role::Operate).unwrap();
        let other = make(data.path(), &script, Role::View).unwrap();
        assert!(matches!(make(data.path(), &ada, Role::View), Err(TokensError::Taken { .. })));
        assert!(tokens.is_in_use());
        let of = |secret: &Secret| tokens.find(&fingerprint(secret.reveal()));
        assert_eq!(of(&secret), Some((ada.clone(), Role::Operate)));
        assert_eq!(of(&other), Some((script.clone(), Role::View)));
        tokens.keep_uses();
        for file in fs::read_dir(data.path()).unwrap() {
            let path = file.unwrap().path();
            let text = fs::read_to_string(&path).unwrap();
            assert!(!text.contains(&secret.reveal()[PREFIX.len()..]), "{}", path.display());
            assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        }
        revoke(data.path(), &ada).unwrap();
        assert!(matches!(revoke(data.path(), &ada), Err(TokensError::Unknown { .. })));
        assert_eq!((of(&secret), of(&other)), (None, Some((script.clone(), Role::View))));
        revoke(data.path(), &script).unwrap();
        assert!(of(&other).is_none() && tokens.is_in_use());
        assert_eq!(Tokens::open(data.path()).unwrap().known.lock().unwrap().uses.len(), 2);
    }

    #[test]
    fn a_file_that_others_can_change_or_that_is_broken_lets_nobody_in() {
        let data = TempDir::new().unwrap();
        let secret = make(data.path(), &"ada".parse().unwrap(), Role::Admin).unwrap();
        let tokens = Tokens::open(data.path()).unwrap();
        let path = data.path().join(FILE);
        let text = fs::read_to_string(&path).unwrap();
        let is_in = || tokens.find(&fingerprint(secret.reveal())).is_some();
        assert!(is_in());
        for broken in ["", "[", "[{}]", &text.replace("admin", "root")] {
            fs::write(&path, broken).unwrap();
            assert!(!is_in() && tokens.is_in_use(), "{broken}");
            assert!(matches!(Tokens::open(data.path()), Err(TokensError::File { .. })));
        }
        fs::write(&path, &text).unwrap();
        assert!(is_in());
        fs::set_permissions(&path, fs::Permissions::from_mode(0o622)).unwrap();
        assert!(matches!(Tokens::open(data.path()), Err(TokensError::Open { .. })));
    }
}
