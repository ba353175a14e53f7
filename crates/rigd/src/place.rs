//! The directories of rigd: where it looks for the rig file, the service file and the data.
//!
//! ```text
//!   system     /etc/rigd                          /var/lib/rigd
//!   user       $XDG_CONFIG_HOME/rigd              $XDG_DATA_HOME/rigd
//!   checkout   config/rigs, config/service        data                   (below the current directory)
//! ```
//!
//! The first place with a rig file is used as a whole, so that every command of a computer finds the same rig
//! and the same data. A service manager names other directories for the system.

use std::{
    env,
    ffi::OsString,
    path::{Path, PathBuf},
};

use serde::Serialize;

/// The shipped rig file, below the current directory: the last one that is looked for.
pub(crate) const SHIPPED_RIG: &str = "config/rigs/simulated.toml";

/// The configuration of the system, unless the service manager names another directory.
const SYSTEM_CONFIGURATION: &str = "/etc/rigd";
/// The data of the system, unless the service manager names another directory.
const SYSTEM_DATA: &str = "/var/lib/rigd";

/// The variables from which the directories are made.
pub(crate) const VARIABLES: [&str; 5] =
    ["CONFIGURATION_DIRECTORY", "STATE_DIRECTORY", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "HOME"];

/// Whose directories they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PlaceKind {
    /// Those of the computer.
    System,
    /// Those of the user.
    User,
    /// Those of the sources, below the current directory.
    Checkout,
}

/// Directories that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Place {
    pub(crate) kind: PlaceKind,
    /// The rig file, which decides whether the place is used.
    pub(crate) rig: PathBuf,
    /// The settings of the daemon; the file may be missing.
    pub(crate) service: PathBuf,
    /// The data directory.
    pub(crate) data: PathBuf,
}

impl PlaceKind {
    /// For a person.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::System => "the directories of the system",
            Self::User => "the directories of the user",
            Self::Checkout => "the current directory",
        }
    }
}

impl Place {
    fn of(kind: PlaceKind, configuration: &Path, data: PathBuf) -> Self {
        let (rig, service) = (configuration.join("rig.toml"), configuration.join("service.toml"));
        Self { kind, rig, service, data }
    }

    /// Whether it has a rig file. One that this user may not look at counts: it must not be passed over
    /// without a word.
    pub(crate) fn has_rig(&self) -> bool {
        self.rig.try_exists().unwrap_or(true)
    }

    /// The place that holds where no flag names another.
    pub(crate) fn found() -> Self {
        Self::first(Self::all(|name| env::var_os(name)))
    }

    /// All places, in the order of the search.
    pub(crate) fn all(variable: impl Fn(&str) -> Option<OsString>) -> Vec<Self> {
        // A service manager separates several directories by colons. A relative path names nothing.
        let first = |name: &str| {
            let value = variable(name)?;
            env::split_paths(&value).next().filter(|path| path.is_absolute())
        };
        let named =
            |name: &str| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
        let below_home = |folder: &str| Some(named("HOME")?.join(folder));
        let system = Self::of(
            PlaceKind::System,
            &first("CONFIGURATION_DIRECTORY").unwrap_or_else(|| SYSTEM_CONFIGURATION.into()),
            first("STATE_DIRECTORY").unwrap_or_else(|| SYSTEM_DATA.into()),
        );
        let configuration = named("XDG_CONFIG_HOME").or_else(|| below_home(".config"));
        let data = named("XDG_DATA_HOME").or_else(|| below_home(".local/share"));
        let user = configuration.zip(data).map(|(configuration, data)| {
            Self::of(PlaceKind::User, &configuration.join("rigd"), data.join("rigd"))
        });
        let checkout = Self {
            kind: PlaceKind::Checkout,
            rig: SHIPPED_RIG.into(),
            service: "config/service/service.toml".into(),
            data: "data".into(),
        };
        [Some(system), user, Some(checkout)].into_iter().flatten().collect()
    }

    /// The first place with a rig file, or the last one, where a missing file is said.
    fn first(all: Vec<Self>) -> Self {
        let mut all = all.into_iter();
        let last = all.next_back();
        all.find(Self::has_rig).or(last).unwrap_or_else(|| {
            Self::of(PlaceKind::System, Path::new(SYSTEM_CONFIGURATION), SYSTEM_DATA.into())
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[track_caller]
    fn check(variables: &[(&str, &str)], expected: &[(&str, &str)]) {
        let variable = |name: &str| {
            let value = variables.iter().find(|(known, _)| *known == name);
            value.map(|(_, value)| OsString::from(value))
        };
        let found: Vec<_> =
            Place::all(variable).into_iter().map(|place| (place.rig, place.data)).collect();
        let expected: Vec<_> =
            expected.iter().map(|(rig, data)| (PathBuf::from(rig), PathBuf::from(data))).collect();
        assert_eq!(found, expected);
    }

    const SYSTEM: (&str, &str) = ("/etc/rigd/rig.toml", "/var/lib/rigd");
    const CHECKOUT: (&str, &str) = (SHIPPED_RIG, "data");

    #[test]
    fn directories_come_from_their_variables_and_relative_ones_count_for_nothing() {
        check(&[], &[SYSTEM, CHECKOUT]);
        let home = ("/home/ada/.config/rigd/rig.toml", "/home/ada/.local/share/rigd");
        check(&[("HOME", "/home/ada")], &[SYSTEM, home, CHECKOUT]);
        check(
            &[("HOME", "/home/ada"), ("XDG_CONFIG_HOME", "config"), ("XDG_DATA_HOME", "/d")],
            &[SYSTEM, ("/home/ada/.config/rigd/rig.toml", "/d/rigd"), CHECKOUT],
        );
        check(
            &[("CONFIGURATION_DIRECTORY", "/run/a:/run/b"), ("STATE_DIRECTORY", "state")],
            &[("/run/a/rig.toml", "/var/lib/rigd"), CHECKOUT],
        );
    }

    #[test]
    fn the_first_place_with_a_rig_file_is_used_as_a_whole() {
        let folder = tempfile::TempDir::new().unwrap();
        let place = |kind, name: &str| {
            let at = folder.path().join(name);
            Place::of(kind, &at, at.join("data"))
        };
        let all = [
            place(PlaceKind::System, "a"),
            place(PlaceKind::User, "b"),
            place(PlaceKind::Checkout, "c"),
        ];
        let found = || Place::first(all.to_vec());
        assert_eq!(found(), all[2]);
        for (at, name) in [(1, "b"), (0, "a")] {
            fs::create_dir(folder.path().join(name)).unwrap();
            // A service file alone names no bench.
            fs::write(folder.path().join(name).join("service.toml"), "").unwrap();
            assert_ne!(found(), all[at]);
            fs::write(folder.path().join(name).join("rig.toml"), "").unwrap();
            assert_eq!(found(), all[at]);
        }
    }

    #[test]
    fn the_unit_the_package_and_the_manual_name_the_directories_of_the_system() {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let text = |file: &str| fs::read_to_string(shipped.join(file)).unwrap();
        let unit = text("config/service/rigd.service");
        let (rig, data) = (format!("{SYSTEM_CONFIGURATION}/rig.toml"), SYSTEM_DATA);
        for command in ["serve", "safe"] {
            assert!(unit.contains(&format!("/usr/bin/rigd {command} --rig {rig} --data {data}\n")));
        }
        // With these lines systemd sets the two variables to the same directories.
        for line in ["ConfigurationDirectory=rigd\n", "StateDirectory=rigd\n"] {
            assert!(unit.contains(line), "{line}");
        }
        let installed = text("config/service/debian/postinst");
        for directory in [SYSTEM_CONFIGURATION, SYSTEM_DATA] {
            let made = installed.lines().any(|line| {
                line.trim().starts_with("install -d") && line.ends_with(&format!(" {directory}"))
            });
            assert!(made && text("docs/service.md").contains(directory), "{directory}");
        }
    }
}
