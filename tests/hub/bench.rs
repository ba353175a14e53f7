//! A bench with its journal: what it measures, how it is killed, and the copies of its journal.

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader},
    net::{Ipv4Addr, SocketAddr, TcpListener},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use rig_store::{Digest, Reader, RunKind, back_up};
use tempfile::TempDir;

use crate::{
    deed::{HUB_STATES, HubState},
    newer,
    support::{Hub, contents_of, server},
    worker::{AT_EVENT, Unended},
};

/// Runs as lines, by id.
pub(crate) type Contents = BTreeMap<String, Vec<String>>;
/// How often each thing has happened.
pub(crate) type Counts = BTreeMap<String, u64>;

/// The library by which a program has another clock, of the Debian package `faketime`.
pub(crate) const FAKETIME: &str = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1";
/// Seconds of a year, by which the clock of a computer is wrong.
const YEAR: &str = "31557600";
/// Longest time in which PostgreSQL does what a killed program had sent.
const QUIET_WITHIN: Duration = Duration::from_secs(120);
/// A run of four touches has about this many events.
pub(crate) const EVENTS: u32 = 150;

/// A bench.
pub(crate) struct Bench {
    pub(crate) rng: Pcg64,
    pub(crate) role: String,
    pub(crate) data: TempDir,
    pub(crate) objects: TempDir,
    /// Certificate, key and authority.
    pub(crate) files: [PathBuf; 3],
    pub(crate) database: String,
    backup: Option<TempDir>,
    /// What the hub has of runs that a restored journal does not have any more.
    pub(crate) lost: Contents,
    /// The sealed runs of journals that are gone, of which there may be objects.
    pub(crate) gone: Contents,
}

impl Bench {
    pub(crate) async fn new(seed: u64, hub: &Hub) -> Self {
        let role = hub.bench(&format!("seed-{seed}")).await;
        Self {
            rng: Pcg64::seed_from_u64(seed),
            data: TempDir::new().unwrap(),
            objects: TempDir::new().unwrap(),
            files: server().certify(&role).unwrap(),
            database: hub.database.clone(),
            role,
            backup: None,
            lost: Contents::new(),
            gone: Contents::new(),
        }
    }

    pub(crate) fn below(&mut self, end: u32) -> u32 {
        self.rng.next_u32() % end
    }

    /// A number below `end`, small ones as often as large ones.
    pub(crate) fn up_to(&mut self, end: u32) -> u32 {
        let bits = self.below(end.ilog2() + 1);
        self.below(1 << (bits + 1)).min(end)
    }

    /// Measures a run with a hub that is well, dead or silent, by a clock that may be a year off.
    pub(crate) fn measure(&mut self, counts: &mut Counts) {
        let unended = self.unended();
        let hub = HUB_STATES[self.below(4) as usize];
        *counts.entry(format!("measured, hub {hub:?}")).or_default() += 1;
        *counts.entry(format!("unended: {unended:?}")).or_default() += 1;
        let seed = u64::from(self.below(1000));
        let data = self.data.path().to_owned();
        self.measured(&data, hub, unended, seed, counts);
    }

    /// Measures the first run of this journal, and the same run in another one without a hub: each time of the rig's
    /// clock must be the same.
    pub(crate) fn measure_beside(&mut self, seed: u64, counts: &mut Counts) {
        let alone = TempDir::new().unwrap();
        let hub = HUB_STATES[1 + self.below(3) as usize];
        *counts.entry(format!("beside one without a hub, hub {hub:?}")).or_default() += 1;
        self.measured(alone.path(), HubState::None, Unended::Leave, seed, counts);
        let data = self.data.path().to_owned();
        self.measured(&data, hub, Unended::Leave, seed, counts);
        let [head, without] = [&data, alone.path()].map(head_of_run);
        assert_eq!(head, without, "a run with a hub that is {hub:?} is another run");
    }

    fn measured(
        &mut self,
        data: &Path,
        hub: HubState,
        unended: Unended,
        seed: u64,
        counts: &mut Counts,
    ) {
        let silent = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut command = worker("measure", data);
        command.args(["--seed", &seed.to_string(), "--unended", name_of(unended)]);
        match hub {
            HubState::None => {}
            HubState::Well => self.ship_to(&mut command, port_of_hub()),
            HubState::Dead => self.ship_to(&mut command, (Ipv4Addr::LOCALHOST, 1).into()),
            HubState::Silent => self.ship_to(&mut command, silent.local_addr().unwrap()),
        }
        if let Some(sign) = ["+", "-"].get(self.below(6) as usize) {
            *counts.entry(format!("clock {sign}1 year")).or_default() += 1;
            command.env("LD_PRELOAD", FAKETIME).env("FAKETIME", format!("{sign}{YEAR}"));
            command.env("FAKETIME_DONT_FAKE_MONOTONIC", "1");
        }
        let status = command.status().unwrap();
        assert!(status.success(), "measuring ended: {status}");
    }

    /// Measures a run in the format of a newer rigd.
    pub(crate) fn measure_newer(&mut self, counts: &mut Counts) {
        let (data, seed) = (self.data.path().to_owned(), u64::from(self.below(1000)));
        self.measured(&data, HubState::None, Unended::Leave, seed, counts);
        newer::convert(&data);
    }

    /// Kills the rig in the middle of a run, or in the middle of one that it has resumed.
    pub(crate) fn kill_rig(&mut self) {
        let events = self.below(EVENTS).to_string();
        let mut command = worker("measure", self.data.path());
        command.args(["--unended", name_of(self.unended()), "--tell-after", &events]);
        self.ship_to(&mut command, port_of_hub());
        let mut rig = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut told = String::new();
        BufReader::new(rig.stdout.take().unwrap()).read_line(&mut told).unwrap();
        assert_eq!(told.trim(), AT_EVENT);
        kill(&mut rig);
    }

    fn unended(&mut self) -> Unended {
        [Unended::Resume, Unended::GiveUp, Unended::Leave][self.below(3) as usize]
    }

    /// Ends every run, so that two copies of the journal cannot go on with the same one.
    pub(crate) fn end_all(&mut self, counts: &mut Counts) {
        let data = self.data.path().to_owned();
        self.measured(&data, HubState::None, Unended::GiveUp, 1, counts);
    }

    /// Measures in a journal, and leaves what was not ended as it is.
    pub(crate) fn measure_in(&mut self, data: &Path, counts: &mut Counts) {
        let seed = u64::from(self.below(1000));
        self.measured(data, HubState::None, Unended::Leave, seed, counts);
    }

    /// Copies the journal, if every run and session has its end.
    pub(crate) fn back_up(&mut self) -> bool {
        let Ok(reader) = Reader::open(self.data.path()) else { return false };
        if reader.runs().unwrap().iter().any(|run| !run.is_sealed) {
            return false;
        }
        self.backup = Some(self.copy());
        true
    }

    /// A copy of the journal.
    pub(crate) fn copy(&self) -> TempDir {
        let copy = TempDir::new().unwrap();
        back_up(self.data.path(), copy.path(), &[]).unwrap();
        copy
    }

    /// Waits until PostgreSQL does nothing for this bench: it may still commit what a killed program had sent.
    pub(crate) async fn is_quiet(&self, hub: &Hub) {
        let at_work = format!("pg_stat_activity WHERE usename = '{}'", self.role);
        let until = Instant::now() + QUIET_WITHIN;
        while hub.count(&at_work).await > 0 {
            assert!(
                Instant::now() < until,
                "{} is still at work after {QUIET_WITHIN:?}",
                self.role
            );
        }
    }

    /// Goes on with the backup. What was shipped of other runs stays in the hub, as it was.
    pub(crate) async fn restore(&mut self, hub: &Hub) -> bool {
        let Some(backup) = self.backup.take() else { return false };
        self.is_quiet(hub).await;
        let (before, kept) = (contents_of(self.data.path()), contents_of(backup.path()));
        for (run, lines) in hub.contents_of(&self.role).await {
            if kept.contains_key(&run) || self.lost.contains_key(&run) {
                continue;
            }
            assert!(lines.iter().all(|line| before[&run].contains(line)), "{run}");
            self.lost.insert(run, lines);
        }
        let sealed =
            before.into_iter().filter(|(run, lines)| is_sealed(lines) && !kept.contains_key(run));
        self.gone.extend(sealed);
        self.data = backup;
        true
    }

    /// Has a worker ship to a hub at this address.
    pub(crate) fn ship_to(&self, command: &mut Command, address: SocketAddr) {
        command.args(["--hub", &address.to_string(), "--database", &self.database]);
        self.identify(command);
    }

    /// Gives a worker the name and the files of this bench.
    pub(crate) fn identify(&self, command: &mut Command) {
        command.args(["--role", &self.role]);
        for file in &self.files {
            command.arg("--file").arg(file);
        }
    }
}

/// This program as a worker on a journal.
pub(crate) fn worker(task: &str, data: &Path) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.arg(task).arg(data);
    command
}

pub(crate) fn port_of_hub() -> SocketAddr {
    (Ipv4Addr::LOCALHOST, server().port()).into()
}

/// Kills a program as the system does, and waits for its end.
pub(crate) fn kill(program: &mut Child) {
    program.kill().unwrap();
    program.wait().unwrap();
}

/// Whether the lines of a run end with those of a seal.
pub(crate) fn is_sealed(lines: &[String]) -> bool {
    lines.last().is_some_and(|line| line.split('|').count() == 5)
}

const fn name_of(unended: Unended) -> &'static str {
    match unended {
        Unended::Resume => "resume",
        Unended::GiveUp => "give-up",
        Unended::Leave => "leave",
    }
}

/// The last digest of the only run of a journal.
pub(crate) fn head_of_run(data: &Path) -> Digest {
    let reader = Reader::open(data).unwrap();
    let runs = reader.runs().unwrap();
    let run = runs.iter().find(|run| run.kind == RunKind::Run).unwrap();
    reader.last_digest(run.id).unwrap().unwrap()
}
