//! The benches of the fault campaign: makes of devices, scene and protocol of a few touches.

use std::{
    fmt::{self, Display},
    path::PathBuf,
};

use rand_core::Rng;
use rand_pcg::Pcg64;
use rig_files::rig_file::RigFile;
use rig_model::{Mm, Position};
use rig_store::Source;
use rig_tests::changed;
use rigd::{
    loaded_rig::{Instruments, LoadedRig, LoadedScene},
    protocol_file::LoadedProtocol,
};

/// Random numbers of one seed.
#[derive(Debug)]
pub(crate) struct Draw(Pcg64);

impl Draw {
    pub(crate) fn new(seed: u64, stream: u128) -> Self {
        Self(Pcg64::new(u128::from(seed), stream))
    }

    /// Evenly between the ends.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / 2_f64.powi(53)
    }

    /// A whole number below `bound`.
    pub(crate) fn below(&mut self, bound: u64) -> u64 {
        self.0.next_u64() % bound.max(1)
    }

    /// One of the choices.
    pub(crate) fn one_of<'a, T>(&mut self, choices: &'a [T]) -> &'a T {
        let index = usize::try_from(self.below(choices.len() as u64)).unwrap_or_default();
        &choices[index]
    }

    /// Whether something of this probability happens.
    pub(crate) fn happens(&mut self, probability: f64) -> bool {
        self.between(0.0, 1.0) < probability
    }
}

/// A bench with its protocol. The undisturbed run of each is made once, so that there is a limited
/// number of them.
#[derive(Debug)]
pub(crate) struct Bench {
    rig: RigFile,
    rig_text: Source,
    scene: rig_sim::world::Scene,
    scene_text: Source,
    pub(crate) protocol: LoadedProtocol,
    /// Makes of its devices.
    pub(crate) makes: &'static str,
    /// Whether the drive of the linear stage forgets its position when it is switched off, and has no
    /// homing that is known to lead upwards.
    pub(crate) forgets_position: bool,
    /// Whether a sample that is placed again is stiffer or softer there.
    pub(crate) is_uneven: bool,
    /// Whether the surface is looked for again after each sweep.
    pub(crate) has_slip_check: bool,
}

/// Patience with a linear stage that does not answer, s: longer than the shorter interruptions of the menu.
pub(crate) const PATIENCE_S: f64 = 60.0;

/// Number of different benches whose surfaces are found in steps.
const IN_STEPS: u64 = 1024;

/// Number of all benches. Those above the ones in steps are the first of these, with descents.
pub(crate) const BENCHES: u64 = IN_STEPS + IN_STEPS / 2;

/// A part of the program, so that its digest says what was played, and no edit of a file disturbs a long
/// campaign.
const RIG: &str = include_str!("../../config/rigs/simulated.toml");
const SCENE: &str = include_str!("../../config/scenes/paper.toml");

const SERIAL_ANALYZER: &str = r#"{ serial = "/dev/serial/by-id/analyzer", baud = 38400 }"#;
const SERIAL_BUS: &str = r#"{ serial = "/dev/serial/by-id/drives", baud = 115200 }"#;
const AZ: &str = r#"register_map = "oriental-az""#;
const LEADSHINE_PR: &str = "leadshine-pr";

/// Makes of analyzers: dialect, highest level, V, and whether it is on the network.
const ANALYZERS: [(&str, u32, bool); 5] = [
    ("hioki-im3536", 5, false),
    ("keysight-e4980a", 2, true),
    ("hp-4284a", 2, true),
    ("tonghui-th283x", 2, false),
    ("keysight-e4990a", 1, true),
];

/// Changes of a file: texts, and what takes their place.
type Changes = &'static [(&'static str, &'static str)];

/// Drives: their name here, whether they forget their position, and changes of the rig file.
const DRIVES: [(&str, bool, Changes); 5] = [
    ("oriental-az", false, &[]),
    ("oriental-az on TCP", false, &[(SERIAL_BUS, r#"{ tcp = "127.0.0.1:502" }"#)]),
    (LEADSHINE_PR, true, &LEADSHINE),
    ("iai-rc", true, &IAI),
    ("iai-rc homing up", false, &IAI_UP),
];

/// The simulated drive has the resolution of the factory.
const LEADSHINE: [(&str, &str); 3] = [
    (AZ, r#"register_map = "leadshine-pr""#),
    ("steps_per_revolution = 1000", "steps_per_revolution = 10000"),
    ("deg_per_step = 0.01", "deg_per_step = 0.01\nsteps_per_revolution = 10000"),
];

const IAI: [(&str, &str); 3] = [
    (AZ, r#"register_map = "iai-rc""#),
    ("mm_per_step = 0.001", "mm_per_step = 0.01"),
    ("tolerance_mm = 0.002", "tolerance_mm = 0.01"),
];

const IAI_UP: [(&str, &str); 5] = [
    (AZ, r#"register_map = "iai-rc""#),
    ("mm_per_step = 0.001", "mm_per_step = -0.01"),
    ("zero_mm = 0\n", "zero_mm = 45\n"),
    ("tolerance_mm = 0.002", "tolerance_mm = 0.01"),
    ("# homes = \"up\"", "homes = \"up\""),
];

/// Samples, with windows that hold their resonances in contact, Hz.
const SAMPLES: [(&str, f64, f64); 5] = [
    ("1", 136.0, 166.0),
    ("2", 138.0, 176.0),
    ("3", 144.0, 196.0),
    ("4", 150.0, 212.0),
    ("5", 170.0, 262.0),
];

impl Bench {
    /// The bench of this number.
    pub(crate) fn new(number: u64) -> Self {
        if number < IN_STEPS { Self::in_steps(number) } else { Self::descending(number - IN_STEPS) }
    }

    /// The speed at which a probe may go into a sample, mm/s.
    pub(crate) const fn contact_speed_mm_per_s(&self) -> f64 {
        self.rig.limits.motion.contact_speed_mm_per_s
    }

    /// Whether its drives have an alarm when they stall.
    pub(crate) fn has_alarm_at_stall(&self) -> bool {
        self.makes == LEADSHINE_PR
    }

    fn in_steps(number: u64) -> Self {
        let draw = &mut Draw::new(number, 0xbe9c);
        let (dialect, level_v, is_tcp) = *draw.one_of(&ANALYZERS);
        let (makes, forgets_position, drive) = *draw.one_of(&DRIVES);
        let is_uneven = draw.happens(0.3);
        let (rig, rig_text) = rig(dialect, level_v, is_tcp, drive);
        let (scene, scene_text) = scene(number, is_uneven, draw);
        let loaded = LoadedRig {
            path: PathBuf::new(),
            instruments: Instruments::shipped(&rig).expect("shipped instruments"),
            file: rig.clone(),
            source: rig_text.clone(),
            scene: Some(LoadedScene { scene: scene.clone(), source: scene_text.clone() }),
        };
        let protocol = protocol(level_v, draw);
        // A tissue that stays indented needs a protocol without the check. There the contact sense stands
        // alone.
        let has_slip_check = draw.happens(0.75);
        let slip = if has_slip_check { "" } else { "slip_mm = 0\n" };
        let protocol = changed(&protocol, &[("cycles = 10\n", &format!("cycles = 10\n{slip}"))]);
        let protocol = LoadedProtocol::check("campaign", &protocol, &loaded.facts())
            .unwrap_or_else(|faults| panic!("bench {number}: {faults}\n{protocol}"));
        Self {
            rig,
            rig_text,
            scene,
            scene_text,
            protocol,
            makes,
            forgets_position,
            is_uneven,
            has_slip_check,
        }
    }

    /// The bench of this number with a protocol that finds its surfaces by descents, if its analyzer can stream.
    pub(crate) fn descending(number: u64) -> Self {
        let bench = Self::in_steps(number);
        let draw = &mut Draw::new(number, 0xde5c);
        let speed = format!("speed_mm_per_s = {:.2}\n", draw.between(0.3, 0.75));
        let stated = if draw.happens(0.5) { &*speed } else { "" };
        let cycles = *draw.one_of(&[2, 3, 5]);
        let keys = format!("cycles = {cycles}\nmethod = \"descent\"\n{stated}");
        // The first one is that of the approach.
        let toml = bench.protocol.source.toml.replacen("cycles = 10\n", &keys, 1);
        match LoadedProtocol::check("campaign", &toml, &bench.load().facts()) {
            Ok(protocol) => Self { protocol, ..bench },
            // One that measures whole traces, or is too slow.
            Err(_) => bench,
        }
    }

    /// The clear position.
    pub(crate) fn rest(&self) -> Position<Mm> {
        self.rig.limits.linear.rest_target().position()
    }

    /// The rig, to be opened.
    pub(crate) fn load(&self) -> LoadedRig {
        let scene = LoadedScene { scene: self.scene.clone(), source: self.scene_text.clone() };
        LoadedRig {
            path: PathBuf::new(),
            instruments: Instruments::shipped(&self.rig).expect("shipped instruments"),
            file: self.rig.clone(),
            source: self.rig_text.clone(),
            scene: Some(scene),
        }
    }
}

/// The texts of its three files.
impl Display for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let texts = [&self.rig_text, &self.scene_text, &self.protocol.source];
        texts.iter().try_for_each(|source| f.write_str(&source.toml))
    }
}

fn rig(dialect: &str, level_v: u32, is_tcp: bool, drive: &[(&str, &str)]) -> (RigFile, Source) {
    let dialect = format!("dialect = \"{dialect}\"");
    let level = format!("max_level_v = {level_v}");
    let patience = &*format!("patience_s = {PATIENCE_S}");
    let mut changes = vec![
        ("dialect = \"hioki-im3536\"", &*dialect),
        ("max_level_v = 5", &*level),
        ("person = \"answers\"", "person = \"waits\""),
        ("surface_tolerance_mm = 0.3", "surface_tolerance_mm = 0.2"),
        ("patience_s = 120", patience),
    ];
    if is_tcp {
        changes.push((SERIAL_ANALYZER, r#"{ tcp = "127.0.0.1:5025" }"#));
    }
    changes.extend(drive);
    let toml = changed(RIG, &changes);
    let rig = RigFile::read("rig", &toml).unwrap_or_else(|faults| panic!("{faults}"));
    let name = rig.name.clone();
    (rig, Source { name, toml })
}

/// The bench of the paper with other noise and drift. On an even one a sample has the same stiffness
/// and height each time it is placed.
fn scene(number: u64, is_uneven: bool, draw: &mut Draw) -> (rig_sim::world::Scene, Source) {
    let seed = format!("seed = {number}");
    let noise = format!("impedance_rel = {:.4}", draw.between(0.0025, 0.008));
    let warm = format!("warm_up_hz = {:.3}", draw.between(-0.5, 0.5));
    let mut changes = vec![
        ("seed = 2020", &*seed),
        ("impedance_rel = 0.005", &*noise),
        ("warm_up_hz = 0.3", &*warm),
        // The cheapest model of the sensor will do.
        ("tolerance_hz = 0.5", "tolerance_hz = 20"),
    ];
    if !is_uneven {
        changes.extend([
            ("mounting_mm = 0.06", "mounting_mm = 0"),
            ("slope_deg = 1\n", "slope_deg = 0\n"),
            ("stiffness_rel = 0.03\n", "stiffness_rel = 0\n"),
            ("screw_mm = 0.014", "screw_mm = 0"),
        ]);
    }
    let toml = changed(SCENE, &changes);
    let scene = rig_sim::scene::read("scene", &toml).unwrap_or_else(|faults| panic!("{faults}"));
    let name = scene.name.clone();
    (scene, Source { name, toml })
}

/// One touch, or two; uniform sweeps, or sometimes planned ones.
fn protocol(level_v: u32, draw: &mut Draw) -> String {
    let (sample, min_hz, max_hz) = *draw.one_of(&SAMPLES);
    let direction = *draw.one_of(&["front", "back", "left"]);
    let angles = *draw.one_of(&["[0]", "[15]", "[30]", "[45]", "[0]", "[30]", "[0, 30]"]);
    let (no_load, contact) = if draw.happens(0.04) {
        ("target_sigma_hz = 0.1".to_owned(), "target_sigma_hz = 0.2".to_owned())
    } else {
        let uniform = |points: u32, settle_s: f64| {
            format!(
                "method = \"uniform\"\npoints = {points}\nsettle_s = {settle_s}\n\
                 target_sigma_hz = 2"
            )
        };
        (uniform(13, 1.5), uniform(15, 1.0))
    };
    format!(
        "name = \"campaign\"\nsamples = [\"{sample}\"]\ndirections = [\"{direction}\"]\n\
         angles_deg = {angles}\nno_load = \"every-sample\"\n\
         [touch]\nindentation_mm = 0.5\ndwell_s = 0.5\n\
         [approach]\nstart_above_mm = 0.4\ngive_up_below_mm = 0.4\ncoarse_step_mm = 0.1\n\
         fine_step_mm = 0.02\ncontact_threshold = 0.1\nsettle_s = 0.1\ncycles = 10\n\
         [no_load_sweep]\nmin_hz = 132\nmax_hz = 150\n{no_load}\ntime_limit_s = 30\ncycles = 20\n\
         level_v = {level_v}\n\
         [contact_sweep]\nmin_hz = {min_hz}\nmax_hz = {max_hz}\n{contact}\ntime_limit_s = 30\n\
         cycles = 20\nlevel_v = {level_v}\n"
    )
}
