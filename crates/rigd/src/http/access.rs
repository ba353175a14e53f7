//! Access to the daemon: its host names, the token of the clients, and the operator of requests
//! without one.

use std::{
    collections::BTreeSet,
    fmt, fs,
    io::{self, Read},
    net::IpAddr,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    str::FromStr,
};

use axum::http::uri::Authority;
use subtle::ConstantTimeEq;

use crate::operator::Operator;

/// A shorter secret could be guessed over the network.
const TOKEN_MIN: usize = 16;
/// A longer one would not fit a request beside its other headers.
const TOKEN_MAX: usize = 4096;
/// Permissions that the file of the token must not have: writing by the group, and any access by
/// others. The group may read it.
const MODE_FORBIDDEN: u32 = 0o037;

/// The rules of access.
#[derive(Debug)]
pub struct Access {
    hosts: BTreeSet<HostName>,
    token: Option<Token>,
    operator: Operator,
}

impl Access {
    /// Admits requests to a loopback name, to the address on which the daemon listens or to one of
    /// the names `allowed`, with the token, if there is one. Requests without an operator get
    /// `operator`.
    pub fn new(
        listen: IpAddr,
        allowed: impl IntoIterator<Item = HostName>,
        token: Option<Token>,
        operator: Operator,
    ) -> Self {
        let loopback = ["localhost", "127.0.0.1", "::1"].map(HostName::of).into_iter();
        let hosts = loopback.chain([HostName::of_address(listen)]).chain(allowed).collect();
        Self { hosts, token, operator }
    }

    /// Whether a client may call the daemon by this name. An address is always right when it is the
    /// one on which the connection arrived: no page of another site is loaded from there.
    pub(super) fn knows(&self, host: &HostName, arrived_at: Option<IpAddr>) -> bool {
        let is_here = arrived_at.is_some_and(|address| HostName::of_address(address) == *host);
        is_here || self.hosts.contains(host)
    }

    /// The token that a client must know.
    pub(super) const fn token(&self) -> Option<&Token> {
        self.token.as_ref()
    }

    /// Operator of requests that name none.
    pub(super) const fn operator(&self) -> &Operator {
        &self.operator
    }
}

/// A host without its port, in lower case and without the dot of the root.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct HostName(String);

impl HostName {
    /// The host of a URL or of a `Host` header.
    pub(super) fn of_authority(authority: &Authority) -> Self {
        Self::of(authority.host())
    }

    fn of(name: &str) -> Self {
        let name = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        match name.parse() {
            Ok(address) => Self::of_address(address),
            Err(_) => Self(name.strip_suffix('.').unwrap_or(name).to_ascii_lowercase()),
        }
    }

    fn of_address(address: IpAddr) -> Self {
        Self(address.to_canonical().to_string())
    }
}

/// Not the name of a host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected the name or the address of a host, such as bench.lab.example, without port or path"
)]
pub struct HostNameError;

impl FromStr for HostName {
    type Err = HostNameError;

    fn from_str(name: &str) -> Result<Self, HostNameError> {
        let is_allowed = |letter: char| letter.is_ascii_alphanumeric() || "-._".contains(letter);
        let is_name = !name.is_empty() && name.chars().all(is_allowed);
        if is_name || name.parse::<IpAddr>().is_ok() {
            Ok(Self::of(name))
        } else {
            Err(HostNameError)
        }
    }
}

/// The secret that a client sends as `Authorization: Bearer`.
pub struct Token(String);

/// Why a token cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file cannot be read.
    #[error("token file {}", path.display())]
    File {
        /// Path of the token file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// Other users could read or change it.
    #[error(
        "token file {} has mode {mode:03o}: other users could read or change it; run \
         `chmod 600 {}`",
        path.display(), path.display()
    )]
    Open {
        /// Path of the token file.
        path: PathBuf,
        /// Permission bits of the file.
        mode: u32,
    },
    /// Its content is not a token.
    #[error(
        "token file {} must hold one line of {TOKEN_MIN} to {TOKEN_MAX} visible ASCII characters, \
         such as `openssl rand -hex 32` writes",
        path.display()
    )]
    Unusable {
        /// Path of the token file.
        path: PathBuf,
    },
}

impl Token {
    /// Reads the file of a token.
    ///
    /// # Errors
    /// [`TokenError`] with the fault of the file and advice.
    pub fn read(path: &Path) -> Result<Self, TokenError> {
        let failed = |source| TokenError::File { path: path.to_path_buf(), source };
        let file = fs::File::open(path).map_err(failed)?;
        // Of the open file, even if the path now names another one.
        let mode = file.metadata().map_err(failed)?.permissions().mode() & 0o777;
        if mode & MODE_FORBIDDEN != 0 {
            return Err(TokenError::Open { path: path.to_path_buf(), mode });
        }
        let mut bytes = Vec::new();
        // One byte more than allowed shows that there are too many; the line may end in CR LF.
        file.take(TOKEN_MAX as u64 + 3).read_to_end(&mut bytes).map_err(failed)?;
        let text = String::from_utf8(bytes).unwrap_or_default();
        let token = text.trim_end_matches(['\r', '\n']);
        let is_token = (TOKEN_MIN..=TOKEN_MAX).contains(&token.len())
            && token.bytes().all(|byte| byte.is_ascii_graphic());
        if !is_token {
            return Err(TokenError::Unusable { path: path.to_path_buf() });
        }
        Ok(Self(token.to_owned()))
    }

    /// The value of `Authorization` that a client sends.
    pub(crate) fn bearer(&self) -> String {
        format!("Bearer {}", self.0)
    }

    /// Whether a client knows the token. The time of the comparison depends only on its length.
    pub(super) fn is(&self, given: &str) -> bool {
        self.0.as_bytes().ct_eq(given.as_bytes()).into()
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_names_of_this_daemon_are_its_names() {
        let allowed = ["Bench.lab.example".parse().unwrap()];
        let listen = "192.0.2.7".parse().unwrap();
        let access = Access::new(listen, allowed, None, Operator::login());
        let knows = |authority: &str, arrived_at: Option<&str>| {
            let authority: Authority = authority.parse().unwrap();
            let arrived_at = arrived_at.map(|address| address.parse().unwrap());
            access.knows(&HostName::of_authority(&authority), arrived_at)
        };
        let ours = [
            "localhost",
            "LOCALHOST:8137",
            "localhost.:1",
            "127.0.0.1:8137",
            "[::1]:8137",
            "[0:0:0:0:0:0:0:1]",
            "[::ffff:127.0.0.1]",
            "192.0.2.7",
            "bench.lab.example.:80",
        ];
        for name in ours {
            assert!(knows(name, None), "{name}");
        }
        let foreign = [
            "evil.example",
            "localhost.evil.example",
            "evillocalhost",
            "127.0.0.1.evil.example",
            "192.0.2.8",
            "127.0.0.2",
            "[::2]",
            "lab.example",
            "127.1",
            "2130706433",
            "0.0.0.0",
        ];
        for name in foreign {
            assert!(!knows(name, None), "{name}");
        }
        assert!(knows("192.0.2.8:8137", Some("192.0.2.8")) && knows("[fe80::1]", Some("fe80::1")));
        assert!(
            !knows("evil.example", Some("192.0.2.8")) && !knows("192.0.2.9", Some("192.0.2.8"))
        );
        for bad in ["", "a b", "http://a", "a:80", "*", "a/b", "[::1]"] {
            assert!(bad.parse::<HostName>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_token_is_taken_from_a_file_that_others_cannot_read() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("token");
        let read = |text: &[u8], mode: u32| {
            _ = fs::remove_file(&path);
            fs::write(&path, text).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            Token::read(&path)
        };
        let secret = b"0123456789abcdef\n";
        for mode in [0o600, 0o400, 0o640] {
            let token = read(secret, mode).unwrap();
            assert!(token.is("0123456789abcdef"), "{mode:o}");
            assert!(!token.is("0123456789abcdeg") && !token.is("") && !token.is("0123456789abcde"));
            assert_eq!(format!("{token:?}"), "Token");
        }
        for mode in [0o644, 0o604, 0o660, 0o666, 0o777] {
            let error = read(secret, mode).unwrap_err();
            assert!(
                matches!(error, TokenError::Open { mode: found, .. } if found == mode),
                "{error}"
            );
        }
        let long = [b'a'; TOKEN_MAX + 1];
        let bad: [&[u8]; 6] = [
            b"",
            b"short",
            b"one two three four five",
            b"0123456789abcdef\nmore",
            b"\xff\xfe",
            &long,
        ];
        for text in bad {
            assert!(matches!(read(text, 0o600), Err(TokenError::Unusable { .. })), "{text:?}");
        }
        assert!(read(&long[1..], 0o600).is_ok() && read(b"0123456789abcdef\r\n", 0o600).is_ok());
        assert!(matches!(Token::read(&path.join("gone")), Err(TokenError::File { .. })));
    }
}
