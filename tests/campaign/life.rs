//! One seed of the fault campaign: the whole daemon below HTTP on a simulated bench, the persons and
//! clients around it, and what they see of it. All of it is on one paused clock.

mod by_hand;
mod person;

use std::{cell::Cell, collections::BTreeSet, pin::pin, time::Duration};

use rig_engine::{RigState, RunPhase};
use rig_model::Clearance;
use rig_sim::{
    SimHandle, control,
    world::{AxisId, ViolationKind},
};
use rig_store::{MemoryDisk, Reader, RunId};
use rig_verify::MemoryJournal;
use rigd::rig::{self, RigHandle, Status};
use tokio::time::{Instant, sleep, sleep_until};

use self::by_hand::ByHand;

use crate::{
    bench::Bench,
    counts::Phase,
    faults::{Fault, MENU, Order, Trouble},
    judge::{self, Touches},
};

/// A fault that began.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Begun {
    /// The row of the menu.
    pub(crate) row: usize,
    pub(crate) phase: Phase,
    /// The last record before it.
    pub(crate) event: u64,
}

impl Begun {
    pub(crate) fn fault(&self) -> Fault {
        MENU[self.row].1
    }
}

/// What became of a seed.
#[derive(Debug, Default)]
pub(crate) struct Played {
    /// The faults that began.
    pub(crate) begun: Vec<Begun>,
    /// What must never be.
    pub(crate) violations: Vec<String>,
    pub(crate) touches: Touches,
    /// Whether a sample was placed again, so that it may lie otherwise.
    pub(crate) is_placed_again: bool,
    pub(crate) kills: u64,
    pub(crate) resumptions: u64,
    pub(crate) latches: u64,
    /// Sweeps during which steps were lost, and whose resonance the checker refutes.
    pub(crate) refuted: u64,
    /// How often lost steps took the probe deeper than the sample bears, without a command or beyond the
    /// knowledge of the rig.
    pub(crate) sunk: u64,
    /// How often a person lifted the probe by hand.
    pub(crate) lifts: u64,
    /// How deep the probe was in the sample, in truth, while its surface was looked for, mm.
    pub(crate) searched_mm: f64,
    /// Digests of the run and of its end on the rig's clock: the same for the same seed.
    pub(crate) digest: u64,
    /// The records of the run, one to a line, if they are asked for.
    pub(crate) records: Vec<String>,
}

/// Acknowledgements and resumptions while faults go on, and afterwards.
const TRIES_IN_TROUBLE: u32 = 3;
const TRIES: u32 = 8;
/// Longest time of each part on the rig's clock: longer than the patience of the way out.
const PART: Duration = Duration::from_secs(4 * 3600);
/// Starts of the daemon.
const STARTS: u32 = 12;

/// The end of one life of the daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    /// Killed at this moment, and started again after this time, s.
    Killed { for_s: u64 },
    /// To be closed and started again, as for a journal that cannot be written.
    Restart,
    /// The run is complete, or something is wrong for good.
    Finished,
}

/// A bench, its computer, and the people around.
#[expect(clippy::struct_excessive_bools, reason = "each is a fact about the bench or its person")]
pub(crate) struct Life<'a> {
    bench: &'a Bench,
    disk: MemoryDisk,
    simulation: Option<SimHandle>,
    troubles: Vec<Waiting>,
    /// Every fault that began.
    all: Vec<Trouble>,
    is_mended: bool,
    tries_left: u32,
    part_ends: Instant,
    run: Option<RunId>,
    sessions: BTreeSet<RunId>,
    kill_at: Option<(u64, u64)>,
    was_killed_in_contact: bool,
    is_late: bool,
    is_wrong: bool,
    /// What the person does by hand when the rig is idle, the last first.
    by_hand: Vec<ByHand>,
    /// Target and place of the linear stage since its journal failed, and how often it was sent down.
    unrecorded: Option<(f64, f64, u32)>,
    /// The answer or the command that the person gives next.
    person_at: Option<(Instant, u64)>,
    prompts: u64,
    last_state: Option<RigState>,
    played: Played,
}

/// The load is within this of what the motor says, by screw, play and lost steps, mm.
const SCREW_MM: f64 = 0.4;

/// A fault that waits for its moment.
#[derive(Debug)]
struct Waiting {
    trouble: Trouble,
    changes: u64,
    due: Option<Instant>,
}

/// The disk of a bench's computer, and the checker's connection to it.
#[derive(Debug)]
struct Computer {
    disk: MemoryDisk,
    checker: MemoryJournal,
}

impl Computer {
    /// One with an empty disk.
    fn new() -> Self {
        let disk = MemoryDisk::new().expect("a journal in memory");
        let checker = MemoryJournal::open(disk.uri()).expect("a journal in memory");
        Self { disk, checker }
    }
}

thread_local! {
    /// The computer of the last run on this thread, whose disk is wiped for the next one: its
    /// connections have their statements.
    static LAST: Cell<Option<Computer>> = const { Cell::new(None) };
}

/// Plays a bench with these faults.
pub(crate) fn play(bench: &Bench, troubles: &[Trouble], has_records: bool) -> Played {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .start_paused(true)
        .build()
        .expect("a runtime without I/O");
    let wiped = LAST.take().filter(|computer| computer.disk.wipe().is_ok());
    let Computer { disk, checker } = wiped.unwrap_or_else(Computer::new);
    let played = runtime.block_on(async {
        let waiting =
            |trouble: &Trouble| Waiting { trouble: trouble.clone(), changes: 0, due: None };
        let mut life = Life {
            bench,
            disk: disk.clone(),
            simulation: None,
            troubles: troubles.iter().map(waiting).collect(),
            all: Vec::new(),
            is_mended: troubles.is_empty(),
            tries_left: TRIES_IN_TROUBLE,
            part_ends: Instant::now() + PART,
            run: None,
            sessions: BTreeSet::new(),
            kill_at: None,
            was_killed_in_contact: false,
            is_late: false,
            is_wrong: false,
            by_hand: Vec::new(),
            unrecorded: None,
            person_at: None,
            prompts: 0,
            last_state: None,
            played: Played::default(),
        };
        Box::pin(life.play()).await;
        life.judge(&checker);
        if has_records {
            life.played.records = judge::records(&life.disk);
        }
        life.played
    });
    LAST.set(Some(Computer { disk, checker }));
    played
}

impl Life<'_> {
    async fn play(&mut self) {
        for _ in 0..STARTS {
            match Box::pin(self.live()).await {
                End::Killed { for_s } => {
                    self.played.kills += 1;
                    self.was_killed_in_contact |= self.is_in_contact();
                    sleep(Duration::from_secs(for_s)).await;
                }
                End::Restart => {}
                End::Finished => return,
            }
        }
        self.fail("not finished after 12 starts of the daemon");
    }

    /// One life of the daemon.
    async fn live(&mut self) -> End {
        let opened =
            rig::open_in_memory(self.bench.load(), &self.disk, self.simulation.clone()).await;
        let (handle, rig) = match opened {
            Ok(opened) => opened,
            Err(error) if self.is_mended => {
                self.fail(&format!("cannot be opened: {}", rig_model::with_causes(&error)));
                return End::Finished;
            }
            Err(_) => {
                // A person looks after the bench.
                self.mend();
                return End::Restart;
            }
        };
        self.simulation = handle.simulation().cloned();
        let state = handle.status().borrow().snapshot.state;
        if std::mem::take(&mut self.was_killed_in_contact) && state != RigState::Latched {
            self.fail("not latched at the start after a kill in contact");
        }
        self.sessions.insert(handle.status().borrow().session);
        (self.person_at, self.last_state, self.kill_at) = (None, None, None);
        self.unrecorded = None;
        let mut serving = pin!(rig.serve());
        let end = tokio::select! {
            biased;
            () = &mut serving => {
                self.fail("the daemon ended by itself");
                End::Finished
            }
            end = self.act(&handle) => end,
        };
        if !matches!(end, End::Killed { .. }) {
            tokio::join!(handle.close(), serving);
        }
        end
    }

    /// Acts on the daemon until it ends.
    async fn act(&mut self, handle: &RigHandle) -> End {
        let mut watch = handle.status();
        loop {
            let status = watch.borrow_and_update().clone();
            self.look(&status);
            self.begin_troubles(handle, &status).await;
            if let Some((at, nth)) = self.kill_at
                && at <= status.last_event
            {
                return End::Killed { for_s: 7 * nth };
            }
            if let Some(end) = self.serve_person(handle, &status).await {
                return end;
            }
            let dues = self.troubles.iter().filter_map(|waiting| waiting.due);
            let next = dues.chain(self.person_at.map(|(at, _)| at)).min();
            let next = next.unwrap_or(self.part_ends).min(self.part_ends);
            tokio::select! {
                biased;
                changed = watch.changed() => {
                    if changed.is_err() {
                        return End::Finished;
                    }
                }
                () = sleep_until(next) => {}
            }
        }
    }

    /// Whether the probe is in the sample, in truth.
    fn is_in_contact(&self) -> bool {
        let simulation = self.simulation.as_ref();
        simulation.is_some_and(|rig| rig.with(|now, rig| rig.world().is_in_contact(now)))
    }

    /// What is wrong at this moment.
    fn look(&mut self, status: &Status) {
        if self.is_in_contact() && status.snapshot.clearance == Clearance::Clear {
            self.fail("said clear while in contact");
        }
        let state = status.snapshot.state;
        if self.last_state.replace(state) != Some(state) && state == RigState::Latched {
            self.played.latches += 1;
        }
        if status.journal_error.is_some() {
            self.look_at_unrecorded();
        }
        if let Some(simulation) = &self.simulation
            && Phase::of(status) == Some(Phase::Run(RunPhase::Search))
        {
            let deep_mm = simulation.with(|now, rig| rig.world().indentation_mm(now));
            self.played.searched_mm = self.played.searched_mm.max(deep_mm);
        }
    }

    /// Without a journal the probe is not lowered below its clear position. The move under way when it
    /// fails may be seen afterwards.
    fn look_at_unrecorded(&mut self) {
        let Some(simulation) = &self.simulation else { return };
        let (target, at) = simulation.with(|now, rig| {
            let stage = rig.world().stage(AxisId::Linear);
            (stage.target(), stage.load(now))
        });
        let (before, was_at, count) = self.unrecorded.unwrap_or((target, at, 0));
        // A motor that halts on its way up has its position as its target.
        let is_down = target < before && target < was_at - SCREW_MM;
        let is_lower = is_down && target < self.bench.rest().value();
        let count = count + u32::from(is_lower);
        self.unrecorded = Some((target, at, count));
        if count > 1 {
            self.fail("lowered the probe after the journal had failed");
        }
    }

    /// Begins the faults whose moment has come.
    async fn begin_troubles(&mut self, handle: &RigHandle, status: &Status) {
        if self.is_mended {
            return;
        }
        let now = Instant::now();
        let phase = Phase::of(status);
        let mut begun = Vec::new();
        self.troubles.retain_mut(|waiting| {
            if waiting.due.is_none() && phase == Some(waiting.trouble.phase) {
                waiting.changes += 1;
                if waiting.trouble.nth_change <= waiting.changes {
                    waiting.due = Some(now + Duration::from_secs_f64(waiting.trouble.after_s));
                }
            }
            let is_due = waiting.due.is_some_and(|due| due <= now);
            if is_due {
                begun.push(waiting.trouble.clone());
            }
            !is_due
        });
        for trouble in begun {
            // Between phases it counts as of its own.
            let (phase, event) = (phase.unwrap_or(trouble.phase), status.last_event);
            self.played.begun.push(Begun { row: trouble.row, phase, event });
            self.begin(handle, status, &trouble).await;
            self.all.push(trouble);
        }
    }

    async fn begin(&mut self, handle: &RigHandle, status: &Status, trouble: &Trouble) {
        let order = |order: Order, by: &'static str| handle.command(order.command(), None, by);
        match trouble.fault() {
            Fault::Frame(words) => self.say(&format!("fault {words} {}", trouble.trigger)),
            Fault::Device(words) => self.say(&format!("fault {words}")),
            Fault::Drives(both) => both.iter().for_each(|one| self.say(&format!("fault {one}"))),
            Fault::Disk(failure) => self.disk.fail_from(trouble.nth, failure),
            Fault::Kill => {
                self.kill_at = Some((status.last_event + trouble.nth - 1, trouble.nth));
            }
            // What the state does not allow is refused.
            Fault::Person(one) => _ = order(one, "client 1").await,
            Fault::Clients(one, two) => {
                _ = tokio::join!(order(one, "client 1"), order(two, "client 2"));
            }
            Fault::DeadButton => _ = order(Order::Stop, "client 1").await,
            Fault::Late => self.is_late = true,
            Fault::WrongAnswer => self.is_wrong = true,
            Fault::ByHand => {
                self.by_hand = vec![ByHand::Turn, ByHand::Lower];
                _ = order(Order::Abort, "client 1").await;
            }
        }
    }

    fn say(&self, words: &str) {
        let Some(simulation) = &self.simulation else { return };
        simulation.with(|now, rig| {
            control::execute(now, rig, words).unwrap_or_else(|error| panic!("{words}: {error}"));
        });
    }

    fn fail(&mut self, what: &str) {
        if !self.played.violations.iter().any(|known| known == what) {
            self.played.violations.push(what.to_owned());
        }
    }

    /// Judges what was left behind: the truth of the bench, the journal and the results.
    fn judge(&mut self, checker: &MemoryJournal) {
        if let Some(simulation) = &self.simulation {
            let (is_in_contact, violations, hit) = simulation.with(|now, rig| {
                let world = rig.world();
                let hit = world.fastest_hit_mm_per_s(now);
                (world.is_in_contact(now), world.violations(now).to_vec(), hit)
            });
            let limit = self.bench.contact_speed_mm_per_s();
            if let Some(fast) = judge::is_hit_fast(hit, limit, &self.played) {
                self.fail(&fast);
            }
            for violation in violations {
                if matches!(violation.kind, ViolationKind::SankTooDeep { .. })
                    || judge::is_beyond_knowledge(&violation.kind, &self.played)
                {
                    self.played.sunk += 1;
                } else {
                    self.fail(&violation.kind.to_string());
                }
            }
            if is_in_contact {
                self.fail("in contact at the end");
            }
        }
        if let Some(deep) = judge::is_search_deep(&self.played) {
            self.fail(&deep);
        }
        let Some(run) = self.run else { return self.fail("no run began") };
        let prompts = self.bench.protocol.summary.prompts as u64;
        self.played.is_placed_again = prompts < self.prompts;
        let journals: Vec<RunId> = self.sessions.iter().copied().chain([run]).collect();
        let reader = Reader::open_in_memory(&self.disk).expect("the journal can be read");
        match judge::findings(checker, &journals) {
            Ok(findings) => {
                let sweeps = if findings.is_empty() {
                    Vec::new()
                } else {
                    reader.unchecked(run, &["sweep"]).expect("the journal can be read")
                };
                for (of, finding) in findings {
                    if of == run.to_string() && judge::is_refuted(&finding, &self.played, &sweeps) {
                        self.played.refuted += 1;
                    } else {
                        self.fail(&format!("not sound: {finding}"));
                    }
                }
            }
            Err(error) => self.fail(&format!("not sound: {error}")),
        }
        let digest = reader.last_digest(run).ok().flatten().map(|digest| digest.to_string());
        let digest = digest.and_then(|digest| u64::from_str_radix(&digest[..16], 16).ok());
        self.played.digest = digest.unwrap_or_default();
        match judge::touches(&reader, run) {
            Ok(touches) => self.played.touches = touches,
            Err(error) => self.fail(&error.to_string()),
        }
    }
}
