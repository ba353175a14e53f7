//! Walks through the records in the order in which they were written.

use std::collections::BTreeMap;

use rusqlite::Connection;
use serde::Deserialize;

use crate::{
    aim,
    amendment::{self, Amendment, Amends},
    archived,
    chain::Chain,
    copies::Copies,
    finding::{Check, Findings, Verdict},
    journal::{self, Entry, Journal},
    labels::Labels,
    list,
    motion::{Motion, Probe, Turn},
    plan,
    record::{
        Amended, BlackBox, Fault, Operator, Outcome, Record, Resumed, RunFinished, RunStarted,
        Sweep,
    },
    refused::{self, Refused},
    results::{self, Accepted},
    screw,
    seam::Stated,
    settings::{Rig, Settings},
};

/// Checks a run that was read from this database.
pub(crate) fn check(connection: &Connection, journal: &Journal) -> Verdict {
    if let Some(note) = &journal.note {
        return archived::check(connection, journal, note);
    }
    let mut walk = Walk {
        kind: match (&*journal.run.kind, &journal.amended) {
            ("run", _) => Kind::Run,
            (_, Some(_)) => Kind::Amendment,
            _ => Kind::Session,
        },
        name: journal.run.name.clone(),
        given_up: None,
        findings: Findings::default(),
        chain: Chain::new(),
        settings: None,
        stated: None,
        amends: None,
        amendment: None,
        motion: Motion::new(),
        labels: Labels::new(journal),
        accepted: Vec::new(),
        refused: Vec::new(),
        copies: Copies::default(),
        coming: coming(journal),
        program: None,
        before: None,
        last_own: None,
        foreign: false,
        skip: None,
        fault: None,
        is_stopped: false,
        ending: None,
    };
    if let Some((started, stated)) = &journal.amended {
        walk.stated = Some(stated.clone());
        walk.settings = Settings::read(started).ok();
        let (run, touches) = (journal.run.name.clone(), started.touches.clone());
        walk.amends = Some(Amends { run, touches, head: journal.head.clone() });
    }
    if journal.run.kind == "amendment" && journal.amended.is_none() && !journal.is_alone {
        let what = "an amendment of a run that is not in this journal";
        walk.findings.add(Check::Ends, 1, what, &journal.run.name, "none");
    }
    let before =
        journal::before(connection, journal.run.key, |entry| walk.pass(entry, &journal.sessions));
    if let Err(error) = before {
        let what = "the database is damaged before the first record";
        walk.findings.add(Check::Readable, 0, what, "records", error);
    }
    for entry in &journal.entries {
        walk.pass(entry, &journal.sessions);
    }
    walk.end(journal);
    let (records, digest) = (walk.chain.records(), walk.chain.digest());
    results::check(&walk.accepted, &mut walk.findings);
    refused::check(&walk.refused, &mut walk.findings);
    let mut findings = walk.findings.0;
    findings.sort_by_key(|finding| finding.record);
    Verdict {
        run: journal.run.id.clone(),
        is_sound: findings.is_empty(),
        records,
        sweeps: walk.accepted.len() as u64,
        digest,
        checker: env!("CARGO_PKG_VERSION").to_owned(),
        archived: None,
        findings,
        notes: Vec::new(),
    }
}

/// The rig files with which the run goes on at a later start of the program. Those that cannot be read are found there.
fn coming(journal: &Journal) -> BTreeMap<u64, Rig> {
    let (mut coming, mut before) = (BTreeMap::new(), None);
    for entry in journal.entries.iter().filter(|entry| entry.is_own) {
        let is_another = before.replace(entry.epoch).is_some_and(|before| before != entry.epoch);
        if is_another
            && let Ok(Record::Resumed(resumed)) = serde_json::from_str(&entry.payload)
            && let Some(Ok(rig)) = resumed.rig.map(|rig| toml::from_str(&rig.toml))
        {
            coming.insert(entry.epoch, rig);
        }
    }
    coming
}

/// The frames that a record keeps come before it.
fn kept_before(seq: u64, rig_us: u64, black_box: &BlackBox, findings: &mut Findings) {
    if let Some(frame) = black_box.frames.iter().find(|frame| frame.rig_us > rig_us) {
        let what = "a frame later than the record that keeps it, µs";
        findings.add(Check::Time, seq, what, format!("at most {rig_us}"), frame.rig_us);
    }
}

/// What a journal is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A protocol that is replayed.
    Run,
    /// A touch of a run that is measured again or left out.
    Amendment,
    /// The time between runs.
    Session,
}

/// Kinds of records that may come while an axis moves, and say nothing of the time at which it began.
const DURING_A_MOVE: [&str; 6] =
    ["stalled", "clock_jumped", "operator", "fault", "black_box", "state_changed"];

struct Walk {
    kind: Kind,
    /// Name in the list of runs.
    name: String,
    /// How a run that was given up must end.
    given_up: Option<String>,
    findings: Findings,
    chain: Chain,
    settings: Option<Settings>,
    /// What the last part of the run states of its rig.
    stated: Option<Stated>,
    /// What an amendment is of, and what it does.
    amends: Option<Amends>,
    amendment: Option<Amendment>,
    motion: Motion,
    labels: Labels,
    accepted: Vec<Accepted>,
    refused: Vec<Refused>,
    copies: Copies,
    /// The rig files that a later start of the program has, by its epoch. They hold from its first move on.
    coming: BTreeMap<u64, Rig>,
    /// Epoch of the program whose rig moves.
    program: Option<u64>,
    /// Epoch of the last record, whether it is one of this run, and its time, µs.
    before: Option<(u64, bool, u64)>,
    /// Epoch and time of the last record of this run, µs.
    last_own: Option<(u64, u64)>,
    /// Whether a record of another run or session came after the last one of this run.
    foreign: bool,
    /// The amendment that leaves a touch out.
    skip: Option<i64>,
    /// The first fault of this run.
    fault: Option<u64>,
    /// Whether a person has ended the run.
    is_stopped: bool,
    /// The last record, if it is the end.
    ending: Option<(u64, RunFinished)>,
}

impl Walk {
    fn pass(&mut self, entry: &Entry, sessions: &BTreeMap<u64, u64>) {
        if let Some(rig) = self.coming.remove(&entry.epoch)
            && let Some(settings) = &mut self.settings
        {
            settings.rig = rig;
        }
        if entry.is_of_session && self.program != Some(entry.epoch) {
            // Another start of the program, with a clock of its own.
            self.program = Some(entry.epoch);
            self.motion = Motion::new();
        }
        self.check_order(entry);
        if entry.is_own {
            self.own(entry, sessions);
        } else {
            self.foreign |= self.chain.records() > 0 && !self.is_of_skip(entry);
            self.other(entry);
        }
        if !DURING_A_MOVE.contains(&&*entry.kind) {
            self.motion.pass(entry.rig_us);
        }
    }

    /// The runs and the session of an epoch have one clock. The end of a session whose program was killed
    /// is written by the next one, with the time of its last record.
    fn check_order(&mut self, entry: &Entry) {
        let &Entry { epoch, is_own, rig_us, .. } = entry;
        if entry.kind == "run_finished" {
            return;
        }
        if let Some((before, was_own, before_us)) = self.before.replace((epoch, is_own, rig_us))
            && (before, was_own) == (epoch, !is_own)
            && rig_us < before_us
        {
            let what = "the time of a record lies before that of another run or session, µs";
            let seq = if is_own { entry.seq } else { self.chain.records() };
            self.findings.add(Check::Time, seq, what, format!("at least {before_us}"), rig_us);
        }
    }

    /// Whether a record leaves a touch out, which a person may do during the run.
    fn is_of_skip(&mut self, entry: &Entry) -> bool {
        let record = serde_json::from_str(&entry.payload);
        if matches!(record, Ok(Record::Amended(amended)) if amended.what == "skip") {
            self.skip = Some(entry.key);
        }
        self.skip == Some(entry.key)
    }

    /// A record of another run or session, which only moves the axes.
    fn other(&mut self, entry: &Entry) {
        let Ok(record) = serde_json::from_str(&entry.payload) else { return };
        let mut unsaid = Findings::default();
        // Its own protocol is not known here.
        self.motion.turn = Turn::Free;
        match record {
            Record::Intent(intent) => self.motion.intent(entry.seq, &intent, None, &mut unsaid),
            Record::Moved(moved) => {
                let settings = self.settings.as_ref();
                self.motion.moved(entry.seq, entry.rig_us, &moved, settings, &mut unsaid);
            }
            Record::Fault(fault) => self.motion.fault(entry.seq, &fault.probe, &mut unsaid),
            Record::Operator(operator) => self.operator(&operator),
            _ => {}
        }
    }

    /// A run without an end was cut off by the end of its program, which has written nothing since.
    fn check_cut(&mut self, seq: u64, next: Option<u64>, sessions: &BTreeMap<u64, u64>) {
        let is_cut = self.kind == Kind::Run && self.ending.is_none();
        let Some((epoch, rig_us)) = self.last_own.filter(|_| is_cut) else { return };
        if next == Some(epoch) || sessions.get(&epoch).is_some_and(|last| rig_us < *last) {
            let what = "a run without an end, after which its program went on";
            self.findings.add(Check::Ends, seq, what, "an end", "none");
        }
    }

    fn own(&mut self, entry: &Entry, sessions: &BTreeMap<u64, u64>) {
        let seq = entry.seq;
        let record = serde_json::from_str::<Record>(&entry.payload);
        let opens = match &record {
            Ok(Record::Resumed(resumed)) => Some(resumed.epoch),
            Ok(Record::GivenUp(given_up)) => Some(given_up.epoch),
            _ => None,
        };
        self.chain.follow(entry, opens, &mut self.findings);
        if opens.is_some() {
            self.check_cut(seq, opens, sessions);
        }
        self.last_own = Some((entry.epoch, entry.rig_us));
        let record = match record {
            Ok(record) => record,
            Err(error) => {
                let what = format!("a record of the kind {}", entry.kind);
                self.findings.add(Check::Readable, seq, what, "a known kind of record", error);
                return;
            }
        };
        let word = serde_json::from_str::<KindOf>(&entry.payload).map(|of| of.kind);
        if word.as_ref().ok() != Some(&entry.kind) {
            let what = "the kind of a record is not that of its content";
            self.findings.add(Check::Readable, seq, what, word.unwrap_or_default(), &entry.kind);
        }
        if let Some((end, _)) = self.ending.take_if(|_| opens.is_none() || self.given_up.is_some())
        {
            let what = "a record after the end of the run";
            let expected = format!("record {end} as the last");
            self.findings.add(Check::Ends, seq, what, expected, &entry.kind);
        }
        // A session goes on while its runs are under way.
        if std::mem::take(&mut self.foreign) && self.kind == Kind::Run && opens.is_none() {
            let what = "records of another run or session lie before this one";
            self.findings.add(Check::OneWriter, seq, what, "the records of one run", "another");
        }
        let is_first = matches!(record, Record::RunStarted(_) | Record::Amended(_));
        if self.kind != Kind::Session && (seq == 1) != is_first {
            let what = "the first record, and no other, has the settings of the run";
            self.findings.add(Check::Ends, seq, what, "run_started", &entry.kind);
        }
        self.copies.take((seq, entry.epoch), &record, &mut self.findings);
        let is_its_end = matches!(record, Record::Amended(_) | Record::RunFinished(_));
        if self.amendment == Some(Amendment::Skip) && !is_its_end {
            let what = "a record of a touch that is left out";
            self.findings.add(Check::Row, seq, what, "the end", &entry.kind);
        }
        if self.given_up.is_some() && !matches!(record, Record::RunFinished(_)) {
            let what = "a record of a run that was given up";
            self.findings.add(Check::Ends, seq, what, "the end", &entry.kind);
        }
        self.record(entry, record);
    }

    fn record(&mut self, entry: &Entry, record: Record) {
        let Entry { seq, rig_us, .. } = *entry;
        let Self { motion, labels, findings, .. } = self;
        let settings = self.settings.as_ref();
        match record {
            Record::RunStarted(started) => self.started(seq, *started),
            Record::StepStarted(started) => {
                labels.step_started((seq, rig_us), started, motion, settings, findings);
            }
            Record::PromptAsked(asked) => labels.asked(seq, &asked, motion, settings, findings),
            Record::PromptAnswered(answered) => labels.answered(seq, &answered, motion, findings),
            Record::RefusalAsked {} => motion.is_waiting = true,
            Record::RefusalAnswered(answered) => {
                labels.decided((seq, rig_us), &answered, motion, settings, findings);
            }
            Record::Intent(intent) => {
                labels.declared(seq, &intent.what, findings);
                if let Some(settings) = settings.filter(|_| intent.what == "indent") {
                    labels.indents(seq, intent.to, settings, findings);
                }
                motion.intent(seq, &intent, settings, findings);
            }
            Record::Moved(moved) => {
                motion.moved(seq, rig_us, &moved, settings, findings);
                labels.moved(motion, rig_us, settings);
            }
            Record::Descended(descended) => {
                motion.went_down(seq, rig_us, &descended, settings, findings);
                labels.descended(seq, rig_us, descended, motion, settings, findings);
            }
            Record::SurfaceFound(found) => {
                labels.surface_found(seq, rig_us, &found, motion, settings, findings);
                motion.found_surface(found.position_mm, settings);
            }
            Record::SurfaceNotFound(lost) => {
                let search = ("approach", &*lost.step, &lost.pose, &*lost.trail);
                labels.searched(seq, rig_us, search, motion, settings, findings);
                labels.searches_in_steps();
                labels.lost_surface(&lost.trail);
            }
            Record::SurfaceChecked(checked) => {
                labels.surface_checked(seq, rig_us, &checked, motion, settings, findings);
            }
            Record::Sweep(sweep) => {
                labels.sweep(seq, rig_us, &sweep, motion, settings, findings);
                self.keep(seq, sweep);
            }
            Record::TouchResult(result) => {
                labels.measured(seq, &result, motion, settings, findings);
                labels.references.touch_measured((seq, rig_us), &result, settings, findings);
            }
            Record::TouchRefused(refused) => {
                labels.refused(seq, &refused, motion, settings, findings);
                labels.references.touch_refused(rig_us, findings);
            }
            Record::ReferenceJumped(jumped) => labels.references.jumped(seq, &jumped, findings),
            Record::Operator(operator) => self.operator(&operator),
            Record::Fault(fault) => self.faulted(seq, &fault),
            Record::BlackBox(black_box) => kept_before(seq, rig_us, &black_box, findings),
            Record::StateChanged(changed) => {
                motion.changed(&changed.state);
            }
            // A sweep that was held up is measured again, and is held against its readings as any.
            Record::RetractTried(tried) => motion.tried(seq, &tried.probe, findings),
            Record::Stalled(stalled) => labels.stalled(rig_us, stalled.stalled_s),
            Record::ClockJumped {} => {}
            Record::Resumed(resumed) => self.resumed(seq, &resumed),
            Record::GivenUp(_) => self.give_up(),
            Record::Amended(amended) => self.amended(seq, &amended),
            // It is held against the run that it is about.
            Record::Archived(_) => {}
            Record::RunFinished(finished) => self.finished(seq, finished),
        }
    }

    /// The first record of an amendment.
    fn amended(&mut self, seq: u64, amended: &Amended) {
        amendment::check(seq, amended, self.amends.as_ref(), &mut self.findings);
        screw::check(amended.calibrations.as_deref().unwrap_or_default(), seq, &mut self.findings);
        if amended.what == "skip" {
            self.amendment = Some(Amendment::Skip);
        } else {
            self.amendment = Some(Amendment::Redo);
            if let Some(stated) = &self.stated {
                stated.redone(seq, amended, &mut self.findings);
            }
            self.begins(seq, "a touch was measured again");
        }
        let touch = self.amends.as_ref().and_then(|amends| amends.touch(&amended.step)).cloned();
        let protocol = self.settings.as_ref().map(|settings| &settings.protocol);
        self.labels.amend(touch, protocol);
    }

    /// Keeps a sweep, to fit its readings at the end.
    fn keep(&mut self, seq: u64, sweep: Box<Sweep>) {
        if matches!(sweep.outcome, Outcome::Refused { .. }) {
            let before = self.accepted.last().and_then(Accepted::circuit);
            self.refused.extend(before.map(|before| Refused { seq, sweep, before }));
            return;
        }
        let bench = |sweep: &Sweep| sweep.fit.as_ref().and_then(|fit| fit.bench);
        let before = self.accepted.last().and_then(|last| bench(&last.sweep));
        let is_survey = bench(&sweep).is_some_and(|bench| before != Some(bench));
        self.accepted.push(Accepted { seq, sweep, is_survey });
    }

    fn started(&mut self, seq: u64, started: RunStarted) {
        let findings = &mut self.findings;
        match Settings::read(&started) {
            Ok(settings) => {
                plan::check(&started, &settings.protocol, seq, findings);
                plan::check_name(&self.name, &started, &settings.protocol, seq, findings);
                aim::check(&settings.protocol, started.aim.as_ref(), seq, findings);
                plan::check_files(&started, &settings.rig, seq, findings);
                screw::check(&started.calibrations, seq, findings);
                self.settings = Some(settings);
            }
            Err(error) => {
                let what = "the rig file or the protocol in the journal cannot be read";
                findings.add(Check::Readable, seq, what, "TOML with the known keys", error);
            }
        }
        self.begins(seq, "a run began");
        self.stated = Some(Stated::of(&started));
        let protocol = self.settings.as_ref().map(|settings| &settings.protocol);
        self.labels.begin(seq, started.plan, started.touches, protocol, &mut self.findings);
    }

    /// The run goes on, with a clock of its own, at the next touch that has no outcome.
    fn resumed(&mut self, seq: u64, resumed: &Resumed) {
        let findings = &mut self.findings;
        if let (Some(rig), Some(settings)) = (&resumed.rig, &mut self.settings) {
            match toml::from_str(&rig.toml) {
                Ok(rig) => settings.rig = rig,
                Err(error) => {
                    let what = "the rig file in the journal cannot be read";
                    findings.add(Check::Readable, seq, what, "TOML with the known keys", error);
                }
            }
        }
        screw::check(resumed.calibrations.as_deref().unwrap_or_default(), seq, findings);
        if let Some(stated) = &mut self.stated {
            stated.resumed(seq, resumed, findings);
        }
        (self.fault, self.ending) = (None, None);
        self.begins(seq, "a run goes on");
        self.labels.resume(seq, resumed, &mut self.findings);
    }

    /// The run ends with the status of its last part.
    fn give_up(&mut self) {
        let ending = self.ending.take().map(|(_, finished)| finished.status);
        self.given_up = Some(ending.unwrap_or_else(|| "interrupted".to_owned()));
    }

    /// What begins moves only on a rig that is not latched, with the probe clear.
    fn begins(&mut self, seq: u64, what: &str) {
        if let Some(fault) = self.motion.fault {
            let found = format!("the fault of record {fault}");
            let latched = format!("{what} on a latched rig");
            self.findings.add(Check::Stopped, seq, latched, "acknowledged", found);
        }
        if self.motion.probe != Probe::Clear {
            let what = format!("{what} while the probe was not shown clear");
            self.findings.add(Check::FalseClear, seq, what, "clear", self.motion.probe.name());
        }
        // A command to end that came before is not about this.
        (self.motion.turn, self.is_stopped) = (Turn::Forbidden, false);
    }

    fn faulted(&mut self, seq: u64, Fault { probe, cause }: &Fault) {
        self.motion.fault(seq, probe, &mut self.findings);
        self.labels.faulted(cause);
        self.fault = self.fault.or(Some(seq));
    }

    fn operator(&mut self, operator: &Operator) {
        match operator.action.as_str() {
            "prepare" | "acknowledge" | "home with nothing below the probe" => {
                self.motion.prepare();
            }
            "abort" | "stop" => {
                self.motion.lose_positions();
                self.motion.is_waiting = false;
                self.is_stopped = true;
            }
            _ => {}
        }
    }

    fn finished(&mut self, seq: u64, finished: RunFinished) {
        let findings = &mut self.findings;
        let status = finished.status.as_str();
        let probe = self.motion.probe;
        self.labels.check_contradiction(findings);
        if let Some(given_up) = self.given_up.as_ref().filter(|given_up| *given_up != status) {
            let what = "the ending of a run that was given up is that of its last part";
            findings.add(Check::Ends, seq, what, given_up, status);
        }
        // What a program that was killed has not ended is ended by the next one.
        let is_redone = self.amendment == Some(Amendment::Redo) && status != "interrupted";
        if (self.kind == Kind::Run || is_redone) && self.given_up.is_none() {
            let is_whole = status.starts_with("completed");
            self.labels.step_ended(!is_whole, findings);
            self.labels.finish(seq, status, findings);
            let is_clear = probe == Probe::Clear;
            if !is_clear && (is_whole || status == "aborted") {
                let what = "a run ended while the probe was not shown clear";
                findings.add(Check::EndsClear, seq, what, "clear", probe.name());
            }
            let is_explained = match status {
                "completed" | "completed_with_refusals" => self.fault.is_none() && !self.is_stopped,
                "aborted" => self.fault.is_none() && self.is_stopped,
                "faulted" => self.fault.is_some(),
                _ => false,
            };
            if !is_explained {
                let what = "the ending does not follow from the records";
                let fault = self.fault.map_or("no fault", |_| "a fault");
                let stop = if self.is_stopped { "a command to end" } else { "no command to end" };
                findings.add(Check::Ends, seq, what, format!("after {fault} and {stop}"), status);
            }
        }
        self.ending = Some((seq, finished));
    }

    fn end(&mut self, journal: &Journal) {
        self.copies.end(&mut self.findings);
        let last = self.chain.records();
        self.check_cut(last, None, &journal.sessions);
        if let Some(damage) = &journal.damage {
            let what = "the database is damaged behind this record";
            self.findings.add(Check::Readable, last, what, "records", damage);
        }
        let ending = self.ending.as_ref().map(|(_, finished)| finished.status.as_str());
        let status = journal.run.status.as_str();
        let is_right = ending.map_or(status == "running", |ending| ending == status);
        if !is_right {
            let what = "the last record and the list of runs have different endings";
            self.findings.add(Check::Ends, last, what, status, ending.unwrap_or("none"));
        }
        let is_whole = ending.is_some_and(|ending| ending.starts_with("completed"));
        let ends =
            ending.is_some() && (self.kind != Kind::Run || is_whole || self.given_up.is_some());
        self.chain.check_list(journal, ends, &mut self.findings);
        list::check(journal, &mut self.findings);
    }
}

/// The kind that the content of a record states.
#[derive(Debug, Deserialize)]
struct KindOf {
    kind: String,
}
