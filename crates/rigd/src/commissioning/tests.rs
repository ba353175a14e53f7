//! A program that is killed while the limits or the homing of a bench are shown: the bench stays as it is, and the next
//! program goes on with what the disk has. And the stop of an abort.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    pin::pin,
    time::Duration,
};

use rig_commission::{Calibration, Kind, Why, holding};
use rig_engine::Command;
use rig_model::{Position, random::Stream};
use rig_sim::SimHandle;
use rig_store::{Reader, Record};
use tempfile::TempDir;
use tokio::time::sleep;

use super::*;
use crate::rig::open_in;

/// How often the moment of the kill is looked for, by the clock of the rig.
const LOOK: Duration = Duration::from_millis(200);

/// Starts of the commissioning before the test gives up.
const STARTS: usize = 8;

/// A bench as its rig file says, but for a small zero of its table.
struct Bench {
    folder: TempDir,
    sim: Option<SimHandle>,
    /// How long each step of the last program has taken, by the clock of the rig.
    steps: BTreeMap<Step, Duration>,
    /// The records are those of a bench whose drives had found their zeros.
    has_zeros: bool,
}

/// How a program ended.
enum End {
    Commissioned,
    Killed,
    /// What it said last.
    Failed(String),
}

impl Bench {
    fn new(seed: u64, drive: &str, travel_mm: [f64; 2]) -> Self {
        let folder = TempDir::new().unwrap();
        let config = |path| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path);
        let changed = |path: PathBuf, changes: &[(&str, &str)]| {
            let mut text = fs::read_to_string(path).unwrap();
            for (old, new) in changes {
                assert!(text.contains(old), "{old}");
                text = text.replace(old, new);
            }
            text
        };
        let scene = changed(
            config("scenes/new-bench.toml"),
            &[
                ("seed = 2020", &format!("seed = {seed}")),
                ("mm_per_step = 0.00102", "mm_per_step = 0.001"),
                ("deg_per_step = -0.01", "deg_per_step = 0.01"),
                ("zero_deg = 0.8", "zero_deg = 0.05"),
                ("wrong_answers = 0.1", "wrong_answers = 0"),
                ("travel_mm = [0, 50]", &format!("travel_mm = {travel_mm:?}")),
                ("homing_mm = 0", "homing_mm = 0.0005"),
                ("homing_deg = 0", "homing_deg = 0.001"),
            ],
        );
        fs::write(folder.path().join("scene.toml"), scene).unwrap();
        let rig = changed(
            config("rigs/simulated.toml"),
            &[("../scenes/paper.toml", "scene.toml"), ("\"oriental-az\"", &format!("\"{drive}\""))],
        );
        fs::write(folder.path().join("rig.toml"), rig).unwrap();
        Self { folder, sim: None, steps: BTreeMap::new(), has_zeros: false }
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn rig(&self) -> LoadedRig {
        LoadedRig::load(&self.folder.path().join("rig.toml")).unwrap()
    }

    fn records(&self) -> Vec<Calibration> {
        calibrations::read(&self.data()).unwrap()
    }

    fn accepted(&self, kind: Kind) -> usize {
        self.records().iter().filter(|one| one.kind == kind && one.is_accepted()).count()
    }

    fn held(&self, kind: Kind) -> Result<Calibration, Why> {
        let now_s = jiff::Timestamp::now().as_second();
        holding(kind, &self.records(), &self.rig().basis(), now_s).cloned()
    }

    /// A program that begins the commissioning where the disk says, and is killed so long after `kill` has begun.
    async fn live(&mut self, kill: Option<(Step, Duration)>) -> End {
        let (handle, rig) = open_in(self.rig(), &self.data(), self.sim.clone()).await.unwrap();
        self.sim = handle.simulation().cloned();
        if std::mem::take(&mut self.has_zeros) {
            self.sim.as_ref().unwrap().person(0).home_drives();
        }
        let of = Commissioned::of(&self.rig(), self.data());
        let (commissioning, steps) = (Commissioning::new(handle.clone(), of), &mut self.steps);
        steps.clear();
        let life = async {
            // Nothing that was not shown is trusted.
            let up = Command::MoveLinear(Position::new(30.0));
            let refused = handle.command(up, None, "Ada").await;
            assert!(matches!(refused, Err(RequestRefusal::NotCommissioned { .. })), "{refused:?}");
            commissioning.start("Ada".to_owned(), None).await.unwrap();
            loop {
                sleep(LOOK).await;
                let (step, last) = {
                    let progress = commissioning.progress();
                    (progress.step, progress.said.last().cloned().unwrap_or_default())
                };
                let Some(step) = step else {
                    let is_done = last.starts_with("The rig is commissioned");
                    return if is_done { End::Commissioned } else { End::Failed(last) };
                };
                let lasted = steps.entry(step).or_default();
                if kill.is_some_and(|(at, after)| at == step && *lasted >= after) {
                    return End::Killed;
                }
                *lasted += LOOK;
            }
        };
        // What is not polled again is killed: nothing more is sent or written.
        let mut serving = pin!(rig.serve());
        tokio::select! {
            biased;
            () = &mut serving => panic!("the rig has ended"),
            end = life => end,
        }
    }

    /// Starts the commissioning until it has ended well, as a person does. Gives the starts that failed.
    async fn finish(&mut self) -> Vec<String> {
        let mut failures = Vec::new();
        while failures.len() < STARTS {
            match self.live(None).await {
                End::Commissioned => return failures,
                End::Failed(why) => failures.push(why),
                End::Killed => unreachable!("nothing kills it"),
            }
        }
        panic!("not commissioned: {failures:#?}");
    }
}

const TRAVEL_MM: [f64; 2] = [0.0, 48.7];

/// Kills of a drive, at moments all over the step.
const KILLS: u32 = 6;

/// Benches with the records of the steps before this one, each killed once in this step.
async fn killed(step: Step, drive: &str, seed: u64, mut check: impl AsyncFnMut(u32, Bench)) {
    let mut whole = Bench::new(seed, drive, TRAVEL_MM);
    whole.resume("a whole commissioning").await;
    let (mut chance, mut kills) = (Stream::new(seed, 165), 0);
    for kill in 0..KILLS {
        let part = (f64::from(kill) + chance.uniform()) / f64::from(KILLS);
        let mut bench = Bench::new(seed + u64::from(kill), drive, TRAVEL_MM);
        bench.take_records(&whole, step);
        let end = bench.live(Some((step, whole.steps[&step].mul_f64(part)))).await;
        // A step that begins elsewhere may be over before.
        if matches!(end, End::Killed) {
            kills += 1;
            check(kill, bench).await;
        }
    }
    assert!(kills + 2 >= KILLS, "{drive}: {kills} kills came within the step {}", step.name());
}

impl Bench {
    /// Takes the records of the steps before this one from another bench.
    fn take_records(&mut self, other: &Self, step: Step) {
        self.has_zeros = true;
        let folder = self.data().join(calibrations::FOLDER);
        fs::create_dir_all(&folder).unwrap();
        for before in Step::ALL.into_iter().take_while(|before| *before != step) {
            for entry in fs::read_dir(other.data().join(calibrations::FOLDER)).unwrap() {
                let entry = entry.unwrap();
                let name = entry.file_name().into_string().unwrap();
                if name.starts_with(Kind::from(before).name()) {
                    fs::copy(entry.path(), folder.join(name)).unwrap();
                }
            }
        }
    }

    /// Finishes, and gives the number of homings that failed: one of twenty does, because its indicator ranges over more than is
    /// allowed. Nothing else fails.
    async fn resume(&mut self, what: &str) -> usize {
        let failures = self.finish().await;
        let is_homing = |why: &String| why.starts_with("step homing failed: the indicator at the ");
        assert!(failures.len() <= 2 && failures.iter().all(is_homing), "{what}: {failures:#?}");
        failures.len()
    }
}

#[tokio::test(start_paused = true)]
async fn a_kill_in_the_middle_of_the_limits_leaves_no_record_and_they_are_found_again() {
    killed(Step::Limits, "oriental-az", 1, async |kill, mut bench| {
        assert_eq!(bench.held(Kind::Limits).map(drop), Err(Why::Never), "kill {kill}");
        let before = bench.accepted(Kind::Geometry);
        let again = bench.resume(&format!("kill {kill}")).await;
        let found = bench.held(Kind::Limits).unwrap();
        for (name, truth) in
            [("linear.upper_end", TRAVEL_MM[1]), ("linear.lower_end", TRAVEL_MM[0])]
        {
            let value = found.values.iter().find(|value| value.name == name).unwrap();
            let off = (value.value - truth).abs() / value.standard_uncertainty;
            assert!(off < 4.0, "kill {kill}: {value:?}, {truth} in truth");
        }
        assert_eq!(bench.accepted(Kind::Geometry), before + again, "kill {kill}");
    })
    .await;
}

#[tokio::test(start_paused = true)]
async fn a_kill_in_the_middle_of_a_homing_voids_what_rests_on_the_zero() {
    for (drive, seed) in [("oriental-az", 100), ("leadshine-pr", 200)] {
        let mut voided = 0;
        killed(Step::Homing, drive, seed, async |kill, mut bench| {
            let why = bench.held(Kind::Homing).map(drop).unwrap_err();
            let kinds = [Kind::Scale, Kind::Geometry, Kind::Limits, Kind::Signs];
            let before = kinds.map(|kind| bench.accepted(kind));
            let again = bench.resume(&format!("{drive}, kill {kill}")).await;
            // The power had gone: scale, geometry and limits are shown by the zero that the drives have now.
            let is_begun = why == Why::Begun;
            voided += usize::from(is_begun);
            let more = usize::from(is_begun) + again;
            let [scale, geometry, limits, signs] = before;
            let expected = [scale + more, geometry + more, limits + more, signs];
            let found = kinds.map(|kind| bench.accepted(kind));
            assert_eq!(found, expected, "{drive}, kill {kill}");
        })
        .await;
        assert!(voided >= 3, "{drive}: {voided} kills came after the power had gone");
    }
}

#[tokio::test(start_paused = true)]
async fn the_stop_of_an_abort_is_on_record_with_who_aborted() {
    let bench = Bench::new(1, "oriental-az", TRAVEL_MM);
    let (handle, rig) = open_in(bench.rig(), &bench.data(), None).await.unwrap();
    let of = Commissioned::of(&bench.rig(), bench.data());
    let commissioning = Commissioning::new(handle, of);
    let life = async {
        commissioning.start("Ada".to_owned(), None).await.unwrap();
        // The simulated person answers in no time: whenever time passes, a drive is at work.
        while commissioning.progress().step.unwrap() != Step::Scale {
            sleep(LOOK).await;
        }
        commissioning.abort("Bob".to_owned()).unwrap();
        while commissioning.progress().step.is_some() {
            sleep(LOOK).await;
        }
    };
    let mut serving = pin!(rig.serve());
    tokio::select! {
        biased;
        () = &mut serving => panic!("the rig has ended"),
        () = life => {}
    }
    let said = commissioning.progress().said.last().cloned();
    assert_eq!(said.as_deref(), Some("step scale: aborted"));
    let events = Reader::open(&bench.data()).unwrap().events_after(0, 10_000).unwrap();
    let stopped = events.iter().filter_map(|stored| match stored.record().unwrap() {
        Record::Operator(operator) if operator.action == "stop" => Some(operator.who),
        _ => None,
    });
    assert_eq!(stopped.collect::<Vec<_>>(), ["Bob"]);
}
