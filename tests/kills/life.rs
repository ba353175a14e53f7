//! One run, through all kills to its end.

use std::{collections::BTreeMap, path::PathBuf, pin::pin, time::Duration};

use rig_engine::{Command, RigState, RunStatus};
use rig_files::rig_file::RigFile;
use rig_model::{Clearance, random::Stream};
use rig_sim::{SimHandle, world::Scene};
use rig_store::{MemoryDisk, Reader, Record, RunId, Source};
use rig_tests::{changed, text};
use rigd::{
    loaded_rig::{Instruments, LoadedRig, LoadedScene},
    protocol_file::LoadedProtocol,
    rig::{self, RigHandle, Status},
};
use tokio::time::sleep;

/// Most kills in a run.
const KILLS_MAX: usize = 8;

/// The longest time until somebody starts the daemon again, s.
const DOWN_S: usize = 600;

/// Longest time of a life of the daemon on the rig's clock.
const LIFE: Duration = Duration::from_secs(4 * 3600);

/// Shifts may differ by this many standard deviations.
const SIGMAS: f64 = 6.0;

/// The stream that draws the kills.
const KILLS: u64 = 0x0411;

const PERSON: &str = "Ada";

/// What a campaign of kills has seen.
#[derive(Debug, Default, Clone)]
pub(crate) struct Counts {
    pub(crate) runs: u64,
    pub(crate) kills: u64,
    /// Kills with the probe in the sample, in truth.
    pub(crate) in_contact: u64,
    /// Kills of a run that was resumed.
    pub(crate) in_resumed: u64,
    pub(crate) touches: u64,
}

impl Counts {
    pub(crate) const fn add(&mut self, other: &Self) {
        self.runs += other.runs;
        self.kills += other.kills;
        self.in_contact += other.in_contact;
        self.in_resumed += other.in_resumed;
        self.touches += other.touches;
    }
}

/// A frequency shift with its standard deviation, Hz.
type Shift = (f64, f64);
/// The shifts of each touch.
type Touches = BTreeMap<String, Vec<Shift>>;

/// A run that has ended.
#[derive(Debug)]
pub(crate) struct Played {
    /// Number of its events.
    pub(crate) events: u64,
    pub(crate) counts: Counts,
    touches: Touches,
}

impl Played {
    /// Compares the touches with those of the whole run.
    pub(crate) fn compare(&self, whole: &Self) -> Result<(), String> {
        if !self.touches.keys().eq(whole.touches.keys()) {
            let [here, known] = [self, whole].map(|run| run.touches.keys().collect::<Vec<_>>());
            return Err(format!("touches {here:?} instead of {known:?}"));
        }
        for (step, shifts) in &self.touches {
            let [(shift_hz, sigma_hz)] = shifts[..] else {
                return Err(format!("{step} has {} outcomes", shifts.len()));
            };
            let (known_hz, known_sigma_hz) = whole.touches[step][0];
            if (shift_hz - known_hz).abs() > SIGMAS * sigma_hz.hypot(known_sigma_hz) {
                return Err(format!("{step}: {shift_hz:.3} Hz instead of {known_hz:.3} Hz"));
            }
        }
        Ok(())
    }
}

/// The bench of all runs, with samples that are the same each time they are placed.
#[derive(Debug)]
pub(crate) struct Bench {
    rig: Rig,
    protocol: LoadedProtocol,
}

#[derive(Debug)]
struct Rig {
    file: RigFile,
    source: Source,
    scene: Scene,
    scene_source: Source,
}

impl Rig {
    fn new() -> Self {
        let even: String = text("config/scenes/paper.toml")
            .lines()
            .map(|line| match line.split_once(" = ") {
                Some((key @ ("mounting_mm" | "slope_deg" | "stiffness_rel" | "screw_mm"), _)) => {
                    format!("{key} = 0.0\n")
                }
                _ => format!("{line}\n"),
            })
            .collect();
        let rig = text("config/rigs/simulated.toml");
        let source = |name: &str, toml: String| Source { name: name.to_owned(), toml };
        Self {
            file: RigFile::read("rig", &rig).expect("the shipped rig"),
            source: source("rig", rig),
            scene: rig_sim::scene::read("scene", &even).expect("the shipped scene"),
            scene_source: source("scene", even),
        }
    }

    fn load(&self) -> LoadedRig {
        let scene = LoadedScene { scene: self.scene.clone(), source: self.scene_source.clone() };
        LoadedRig {
            path: PathBuf::new(),
            instruments: Instruments::shipped(&self.file).expect("the shipped rig"),
            file: self.file.clone(),
            source: self.source.clone(),
            scene: Some(scene),
        }
    }
}

impl Bench {
    /// The shipped bench, with a protocol of four touches.
    pub(crate) fn new() -> Self {
        let smoke = changed(
            &text("config/protocols/smoke.toml"),
            &[
                ("directions = [\"front\", \"back\", \"left\"]", "directions = [\"left\"]"),
                ("angles_deg = [0, 45]", "angles_deg = [30]"),
                ("trials = 6", "trials = 2"),
            ],
        );
        let rig = Rig::new();
        let protocol = LoadedProtocol::check("short", &smoke, &rig.load().facts());
        let protocol = protocol.unwrap_or_else(|faults| panic!("{faults}"));
        Self { rig, protocol }
    }

    /// Plays the run of this number, with its kills; `events` is the number of events of a whole run, and
    /// 0 means no kill.
    pub(crate) fn play(&self, number: u64, events: u64) -> Result<Played, String> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .start_paused(true)
            .build()
            .map_err(|error| error.to_string())?;
        let mut draw = Stream::of_trial(number, KILLS, 0);
        let kills = if events == 0 { 0 } else { 1 + draw.below(KILLS_MAX) };
        runtime.block_on(async {
            let disk = MemoryDisk::new().map_err(|error| error.to_string())?;
            let counts = Counts::default();
            let mut life =
                Life { bench: self, disk, simulation: None, run: None, last_event: 0, counts };
            for _ in 0..kills {
                // On the average after a third of a run; one that comes late ends the kills.
                let most = usize::try_from(2 * events / 3).unwrap_or(usize::MAX).max(1);
                let after = 1 + draw.below(most) as u64;
                if !Box::pin(life.live(Some(after))).await? {
                    break;
                }
                sleep(Duration::from_secs(draw.below(DOWN_S) as u64)).await;
            }
            if Box::pin(life.live(None)).await? {
                return Err("killed without an order".to_owned());
            }
            life.judge()
        })
    }
}

/// A run on its way.
struct Life<'a> {
    bench: &'a Bench,
    disk: MemoryDisk,
    simulation: Option<SimHandle>,
    run: Option<RunId>,
    last_event: u64,
    counts: Counts,
}

impl Life<'_> {
    /// One life of the daemon. Says whether it was killed, as soon as it has written this many events.
    async fn live(&mut self, kill_after: Option<u64>) -> Result<bool, String> {
        let (was_in_contact, was_begun) = (self.is_in_contact(), self.run.is_some());
        let rig = self.bench.rig.load();
        let opened = rig::open_in_memory(rig, &self.disk, self.simulation.clone()).await;
        let (handle, rig) = opened.map_err(|error| rig_model::with_causes(&error))?;
        self.simulation = handle.simulation().cloned();
        let status = handle.status().borrow().clone();
        if was_in_contact && status.snapshot.state != RigState::Latched {
            return Err("not latched at the start after a kill in contact".to_owned());
        }
        let kill_at = kill_after.map_or(u64::MAX, |after| self.last_event + after);
        let mut serving = pin!(rig.serve());
        let is_killed = tokio::select! {
            biased;
            () = &mut serving => return Err("the daemon ended by itself".to_owned()),
            () = sleep(LIFE) => return Err("no end within 4 h of the rig's clock".to_owned()),
            is_killed = self.act(&handle, kill_at) => is_killed?,
        };
        self.last_event = self.last_event.max(handle.status().borrow().last_event);
        if is_killed {
            self.counts.kills += 1;
            self.counts.in_contact += u64::from(self.is_in_contact());
            let has_run = handle.status().borrow().run.is_some();
            self.counts.in_resumed += u64::from(has_run && was_begun);
        } else {
            tokio::join!(handle.close(), serving);
        }
        Ok(is_killed)
    }

    /// The person: acknowledges, starts and resumes the run until it is complete or the daemon is killed.
    async fn act(&mut self, handle: &RigHandle, kill_at: u64) -> Result<bool, String> {
        let mut status = handle.status();
        loop {
            let is_moment = |status: &Status| {
                let needs_person =
                    matches!(status.snapshot.state, RigState::Idle | RigState::Latched);
                needs_person || status.last_event >= kill_at
            };
            let now = status.wait_for(is_moment).await.map_err(|error| error.to_string())?.clone();
            if self.is_in_contact() && now.snapshot.clearance == Clearance::Clear {
                return Err("said clear while in contact".to_owned());
            }
            if now.last_event >= kill_at {
                return Ok(true);
            }
            let ending = now.run.as_ref().and_then(|run| run.ending);
            let refused = match (now.snapshot.state, self.run, ending) {
                (RigState::Latched, ..) => {
                    handle.command(Command::Acknowledge, None, PERSON).await.err()
                }
                (_, Some(_), Some(RunStatus::Completed)) => return Ok(false),
                (_, Some(_), Some(ending)) => {
                    return Err(format!("the run ended: {}", ending.name()));
                }
                (_, Some(run), None) if self.is_sealed(run)? => return Ok(false),
                (_, Some(run), None) => handle.resume(run, false, PERSON).await.err(),
                (_, None, _) => match handle.run(self.bench.protocol.clone(), PERSON).await {
                    Ok(run) => {
                        self.run = Some(run);
                        None
                    }
                    Err(refusal) => Some(refusal),
                },
            };
            if let Some(refusal) = refused {
                return Err(format!("a person cannot go on: {refusal}"));
            }
        }
    }

    fn is_in_contact(&self) -> bool {
        let simulation = self.simulation.as_ref();
        simulation.is_some_and(|rig| rig.with(|now, rig| rig.world().is_in_contact(now)))
    }

    /// A kill may have come after the end of the run.
    fn is_sealed(&self, run: RunId) -> Result<bool, String> {
        let reader = Reader::open_in_memory(&self.disk).map_err(|error| error.to_string())?;
        Ok(reader.run(run).map_err(|error| error.to_string())?.is_sealed)
    }

    /// Judges the truth of the bench and the journals.
    fn judge(mut self) -> Result<Played, String> {
        if let Some(simulation) = &self.simulation {
            let violations = simulation.with(|now, rig| rig.world().violations(now).to_vec());
            if let Some(violation) = violations.first() {
                return Err(violation.kind.to_string());
            }
        }
        if self.is_in_contact() {
            return Err("in contact at the end".to_owned());
        }
        let run = self.run.ok_or("no run began")?;
        let (touches, events) = self.read(run).map_err(|error| error.to_string())?;
        self.counts.runs += 1;
        self.counts.touches += touches.len() as u64;
        Ok(Played { events, counts: self.counts, touches })
    }

    fn read(&self, run: RunId) -> Result<(Touches, u64), Box<dyn std::error::Error>> {
        let reader = Reader::open_in_memory(&self.disk)?;
        let runs: Vec<_> = reader.runs()?.iter().map(|run| run.id.to_string()).collect();
        let verdicts = rig_verify::MemoryJournal::open(self.disk.uri())?.verify(&runs)?;
        if let Some(finding) = verdicts.iter().flat_map(|verdict| &verdict.findings).next() {
            return Err(format!("not sound: {finding}").into());
        }
        let (mut touches, records) = (Touches::new(), reader.records(run)?);
        for stored in &records {
            match stored.record()? {
                Record::TouchResult(touch) => touches
                    .entry(touch.touch.step)
                    .or_default()
                    .push((touch.shift_hz, touch.shift_sigma_hz)),
                Record::TouchRefused(refused) => {
                    return Err(
                        format!("{} refused: {}", refused.touch.step, refused.reason).into()
                    );
                }
                _ => {}
            }
        }
        Ok((touches, records.len() as u64))
    }
}
