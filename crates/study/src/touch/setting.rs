//! Settings of protocol, rig and scene that are tried.

use std::{fs, path::Path};

use rigd::{files::FileError, loaded_rig::LoadedRig, protocol_file::LoadedProtocol};
use toml::{Table, Value};

use crate::outcome::StudyError;

/// A file of the configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum File {
    Protocol,
    Rig,
    Scene,
}

/// The truth behind a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scene {
    /// The shipped one, which the rig file does not describe exactly.
    Paper,
    /// The one that the rig file describes.
    Matched,
}

impl Scene {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Matched => "matched",
        }
    }
}

/// A change of one key, as its path and its value in TOML; without a value the key is left out.
type Change = (File, &'static str, &'static str);

/// Changes of the shipped configuration.
#[derive(Debug)]
pub(super) struct Setting {
    /// What is changed; settings of one knob are points of one line.
    pub(super) knob: &'static str,
    pub(super) value: &'static str,
    pub(super) changes: &'static [Change],
    /// Whether the aim of the protocol chooses the other settings; otherwise they are those that it has chosen
    /// as shipped.
    is_aimed: bool,
}

const fn one(knob: &'static str, value: &'static str, changes: &'static [Change]) -> Setting {
    Setting { knob, value, changes, is_aimed: false }
}

const fn aimed(knob: &'static str, value: &'static str, changes: &'static [Change]) -> Setting {
    Setting { knob, value, changes, is_aimed: true }
}

/// The name of the configuration without a change.
pub(super) const SHIPPED: &str = "as shipped";
/// The name of several changes at once.
pub(super) const TOGETHER: &str = "together";

use File::{Protocol, Rig, Scene as Bench};

/// A descent as fast as the contact, and nothing that can be left out; the last change leaves the dwell out.
const FASTEST: [Change; 7] = [
    (Protocol, "approach.method", "\"descent\""),
    (Protocol, "approach.speed_mm_per_s", "2"),
    // So that two readings and a stop press no deeper.
    (Protocol, "approach.coarse_step_mm", "0.2"),
    (Rig, "limits.contact_speed_mm_per_s", "2"),
    (Protocol, "no_load", "\"by-drift\""),
    (Protocol, "approach.slip_mm", "0"),
    (Protocol, "touch.dwell_s", "0"),
];

/// Changes of one knob after the other, and some together; the first has none.
pub(super) const SETTINGS: [Setting; 53] = [
    one(SHIPPED, "", &[]),
    one(
        "before the aim",
        "",
        &[
            (Protocol, "contact_sweep.target_sigma_hz", "0.05"),
            (Protocol, "no_load_sweep.target_sigma_hz", "0.02"),
            (Protocol, "approach.fine_step_mm", "0.015"),
            (Protocol, "no_load", "\"every-sample\""),
        ],
    ),
    aimed("aim, %", "2.5", &[(Protocol, "aim.stiffness_percent", "2.5")]),
    aimed("aim, %", "3.5", &[(Protocol, "aim.stiffness_percent", "3.5")]),
    aimed("aim, %", "4", &[(Protocol, "aim.stiffness_percent", "4")]),
    aimed("aim, %", "8", &[(Protocol, "aim.stiffness_percent", "8")]),
    aimed(
        "aim, s a touch",
        "5.5",
        &[(Protocol, "aim.stiffness_percent", ""), (Protocol, "aim.seconds_per_touch", "5.5")],
    ),
    aimed(
        "aim, s a touch",
        "7",
        &[(Protocol, "aim.stiffness_percent", ""), (Protocol, "aim.seconds_per_touch", "7")],
    ),
    one("contact sweep, Hz", "0.02", &[(Protocol, "contact_sweep.target_sigma_hz", "0.02")]),
    one("contact sweep, Hz", "0.1", &[(Protocol, "contact_sweep.target_sigma_hz", "0.1")]),
    one("contact sweep, Hz", "0.2", &[(Protocol, "contact_sweep.target_sigma_hz", "0.2")]),
    one("contact sweep, Hz", "0.5", &[(Protocol, "contact_sweep.target_sigma_hz", "0.5")]),
    one("no-load sweep, Hz", "0.01", &[(Protocol, "no_load_sweep.target_sigma_hz", "0.01")]),
    one("no-load sweep, Hz", "0.05", &[(Protocol, "no_load_sweep.target_sigma_hz", "0.05")]),
    one("no-load sweep, Hz", "0.1", &[(Protocol, "no_load_sweep.target_sigma_hz", "0.1")]),
    one("no-load sweep, Hz", "0.2", &[(Protocol, "no_load_sweep.target_sigma_hz", "0.2")]),
    one("reference", "every touch", &[(Protocol, "no_load", "\"every-touch\"")]),
    one("reference", "every sample", &[(Protocol, "no_load", "\"every-sample\"")]),
    one("reference", "once", &[(Protocol, "no_load", "\"once\"")]),
    one("survey, s", "20", &[(Protocol, "no_load_sweep.survey_s", "20")]),
    one(
        "survey, s",
        "none",
        &[(Protocol, "no_load_sweep.survey_s", ""), (Protocol, "no_load_sweep.level_check", "")],
    ),
    one("fine step, mm", "0.005", &[(Protocol, "approach.fine_step_mm", "0.005")]),
    one("fine step, mm", "0.01", &[(Protocol, "approach.fine_step_mm", "0.01")]),
    one("fine step, mm", "0.03", &[(Protocol, "approach.fine_step_mm", "0.03")]),
    one("fine step, mm", "0.05", &[(Protocol, "approach.fine_step_mm", "0.05")]),
    one("coarse step, mm", "0.05", &[(Protocol, "approach.coarse_step_mm", "0.05")]),
    one("coarse step, mm", "0.2", &[(Protocol, "approach.coarse_step_mm", "0.2")]),
    one("cycles of a step", "1", &[(Protocol, "approach.cycles", "1")]),
    one("cycles of a step", "5", &[(Protocol, "approach.cycles", "5")]),
    one("cycles of a step", "20", &[(Protocol, "approach.cycles", "20")]),
    one("threshold", "0.05", &[(Protocol, "approach.contact_threshold", "0.05")]),
    one("threshold", "0.25", &[(Protocol, "approach.contact_threshold", "0.25")]),
    one("dwell, s", "0", &[(Protocol, "touch.dwell_s", "0")]),
    one("dwell, s", "2", &[(Protocol, "touch.dwell_s", "2")]),
    one("check of slip", "none", &[(Protocol, "approach.slip_mm", "0")]),
    one("two depths", "0.25 mm", &[(Protocol, "touch.halfway_mm", "0.25")]),
    one("order", "listed", &[(Protocol, "order", "\"listed\"")]),
    one("order", "random", &[(Protocol, "order", "\"random\"")]),
    one("tolerance, mm", "0.25", &[(Rig, "geometry.surface_tolerance_mm", "0.25")]),
    one("tolerance, mm", "0.5", &[(Rig, "geometry.surface_tolerance_mm", "0.5")]),
    one("travel, mm/s", "10", &[(Rig, "limits.travel_speed_mm_per_s", "10")]),
    one("in contact, mm/s", "0.5", &[(Rig, "limits.contact_speed_mm_per_s", "0.5")]),
    one("in contact, mm/s", "2", &[(Rig, "limits.contact_speed_mm_per_s", "2")]),
    one(
        "descent, mm/s",
        "0.5",
        &[
            (Protocol, "approach.method", "\"descent\""),
            (Protocol, "approach.speed_mm_per_s", "0.5"),
        ],
    ),
    one(
        "descent, mm/s",
        "1",
        &[(Protocol, "approach.method", "\"descent\""), (Protocol, "approach.speed_mm_per_s", "1")],
    ),
    one(
        "descent, mm/s",
        "2, in contact too",
        &[
            (Protocol, "approach.method", "\"descent\""),
            (Protocol, "approach.speed_mm_per_s", "2"),
            // So that two readings and a stop press no deeper.
            (Protocol, "approach.coarse_step_mm", "0.2"),
            (Rig, "limits.contact_speed_mm_per_s", "2"),
        ],
    ),
    one(
        TOGETHER,
        "fine step 0.03 mm, contact sweep 0.1 Hz",
        &[
            (Protocol, "approach.fine_step_mm", "0.03"),
            (Protocol, "contact_sweep.target_sigma_hz", "0.1"),
        ],
    ),
    one(
        TOGETHER,
        "fine step 0.03 mm, contact sweep 0.2 Hz, no check of slip",
        &[
            (Protocol, "approach.fine_step_mm", "0.03"),
            (Protocol, "contact_sweep.target_sigma_hz", "0.2"),
            (Protocol, "approach.slip_mm", "0"),
        ],
    ),
    one(
        TOGETHER,
        "reference once, no check of slip",
        &[(Protocol, "no_load", "\"once\""), (Protocol, "approach.slip_mm", "0")],
    ),
    one(
        TOGETHER,
        "fine step 0.05 mm, sweeps 0.2 Hz, reference once, no check of slip, no dwell",
        &[
            (Protocol, "approach.fine_step_mm", "0.05"),
            (Protocol, "contact_sweep.target_sigma_hz", "0.2"),
            (Protocol, "no_load_sweep.target_sigma_hz", "0.2"),
            (Protocol, "no_load", "\"once\""),
            (Protocol, "approach.slip_mm", "0"),
            (Protocol, "touch.dwell_s", "0"),
        ],
    ),
    one(
        TOGETHER,
        "descent at 2 mm/s, in contact too, reference by drift, no check of slip",
        FASTEST.split_at(6).0,
    ),
    one(
        TOGETHER,
        "descent at 2 mm/s, in contact too, reference by drift, no check of slip, no dwell",
        &FASTEST,
    ),
    one(
        TOGETHER,
        "fine step 0.005 mm, sweeps 0.02 Hz, reference at every touch",
        &[
            (Protocol, "approach.fine_step_mm", "0.005"),
            (Protocol, "contact_sweep.target_sigma_hz", "0.02"),
            (Protocol, "no_load", "\"every-touch\""),
        ],
    ),
];

/// Benches on which the search for the surface has trouble.
pub(super) const TROUBLES: [Setting; 38] = [
    one("noise of ten cycles", "0.01", &[(Bench, "nuisances.impedance_rel", "0.01")]),
    one("noise of ten cycles", "0.02", &[(Bench, "nuisances.impedance_rel", "0.02")]),
    one("noise of ten cycles", "0.05", &[(Bench, "nuisances.impedance_rel", "0.05")]),
    one("noise of ten cycles", "0.1", &[(Bench, "nuisances.impedance_rel", "0.1")]),
    one("height of a mounting, mm", "0.12", &[(Bench, "nuisances.mounting_mm", "0.12")]),
    one("height of a mounting, mm", "0.25", &[(Bench, "nuisances.mounting_mm", "0.25")]),
    one("height of a mounting, mm", "0.5", &[(Bench, "nuisances.mounting_mm", "0.5")]),
    one("surface, mm from the rig file", "-2", &[(Bench, "place.surface_mm", "8.0")]),
    one("surface, mm from the rig file", "-0.5", &[(Bench, "place.surface_mm", "9.5")]),
    one("surface, mm from the rig file", "+0.5", &[(Bench, "place.surface_mm", "10.5")]),
    one("surface, mm from the rig file", "+2", &[(Bench, "place.surface_mm", "12.0")]),
    one(
        "surface above the axis, mm wrong",
        "0.3",
        &[(Bench, "place.surface_above_pivot_mm", "4.3")],
    ),
    one("surface above the axis, mm wrong", "1", &[(Bench, "place.surface_above_pivot_mm", "5")]),
    one("probe beside the axis, mm wrong", "0.3", &[(Bench, "place.probe_beside_pivot_mm", "0.6")]),
    one("probe beside the axis, mm wrong", "1", &[(Bench, "place.probe_beside_pivot_mm", "1.3")]),
    one("slope, °", "3", &[(Bench, "nuisances.slope_deg", "3")]),
    one("slope, °", "6", &[(Bench, "nuisances.slope_deg", "6")]),
    one("screw, mm", "0.03", &[(Bench, "nuisances.screw_mm", "0.03")]),
    one("screw, mm", "0.06", &[(Bench, "nuisances.screw_mm", "0.06")]),
    one("backlash, mm", "0.01", &[(Bench, "nuisances.linear_backlash_mm", "0.01")]),
    one("backlash, mm", "0.03", &[(Bench, "nuisances.linear_backlash_mm", "0.03")]),
    one("backlash, mm", "0.1", &[(Bench, "nuisances.linear_backlash_mm", "0.1")]),
    one("encoder, steps", "1", &[(Bench, "nuisances.encoder_steps", "1")]),
    one("encoder, steps", "3", &[(Bench, "nuisances.encoder_steps", "3")]),
    one("drift, Hz in an hour", "1", &[(Bench, "nuisances.drift.walk_hz_per_sqrt_hour", "1")]),
    one("drift, Hz in an hour", "5", &[(Bench, "nuisances.drift.walk_hz_per_sqrt_hour", "5")]),
    one("drift, Hz in an hour", "20", &[(Bench, "nuisances.drift.walk_hz_per_sqrt_hour", "20")]),
    one("relaxing part of the force", "0.3", &[(Bench, "contact.relaxation_part", "0.3")]),
    one("relaxing part of the force", "0.6", &[(Bench, "contact.relaxation_part", "0.6")]),
    one("loss of the tissue", "0.3", &[(Bench, "contact.tissue_loss", "0.3")]),
    one("loss of the tissue", "1", &[(Bench, "contact.tissue_loss", "1")]),
    one("debris on the tip, mm", "0.03", &[(Bench, "nuisances.debris_mm", "0.03")]),
    one("debris on the tip, mm", "0.1", &[(Bench, "nuisances.debris_mm", "0.1")]),
    one("debris on the tip, mm", "0.3", &[(Bench, "nuisances.debris_mm", "0.3")]),
    one("edge of the sample, mm from the axis", "3.5", &[(Bench, "place.edge_mm", "3.5")]),
    one("edge of the sample, mm from the axis", "3", &[(Bench, "place.edge_mm", "3")]),
    one("latency of the analyzer, s", "0.001", &[(Bench, "nuisances.analyzer_command_s", "0.001")]),
    one("latency of the analyzer, s", "0.01", &[(Bench, "nuisances.analyzer_command_s", "0.01")]),
];

/// The shipped files.
#[derive(Debug)]
pub(super) struct Files {
    protocol: Table,
    /// The same without its aim, with the settings that the aim chooses on the shipped rig.
    settled: Table,
    rig: Table,
    paper: Table,
    matched: Table,
}

impl Files {
    pub(super) fn read(config: &Path) -> Result<Self, StudyError> {
        let read = |name: &str| {
            let path = config.join(name);
            let text =
                fs::read_to_string(&path).map_err(|source| StudyError::File { path, source })?;
            text.parse::<Table>().map_err(StudyError::arguments)
        };
        let protocol = read("protocols/three-direction.toml")?;
        Ok(Self {
            settled: settled(&protocol, config)?,
            protocol,
            rig: read("rigs/simulated.toml")?,
            paper: read("scenes/paper.toml")?,
            matched: read("scenes/matched.toml")?,
        })
    }

    /// The texts of protocol, rig and scene with a setting and a seed. The rig names its scene `scene.toml`.
    pub(super) fn changed(&self, setting: &Setting, scene: Scene, seed: u32) -> [String; 3] {
        let scene = match scene {
            Scene::Paper => &self.paper,
            Scene::Matched => &self.matched,
        };
        let protocol = if setting.is_aimed { &self.protocol } else { &self.settled };
        let mut tables = [protocol.clone(), self.rig.clone(), scene.clone()];
        let seed = Value::Integer(i64::from(seed));
        set(&mut tables[0], "seed", Some(seed.clone()));
        set(&mut tables[2], "seed", Some(seed));
        set(&mut tables[1], "simulation.scene", Some(Value::String("scene.toml".to_owned())));
        for (file, key, value) in setting.changes {
            set(&mut tables[*file as usize], key, parsed(value));
        }
        tables.map(|table| table.to_string())
    }
}

/// The protocol with the settings that its aim chooses on the shipped rig, and without the aim.
fn settled(protocol: &Table, config: &Path) -> Result<Table, StudyError> {
    let rig =
        LoadedRig::load(&config.join("rigs/simulated.toml")).map_err(StudyError::arguments)?;
    let loaded = LoadedProtocol::check("three-direction.toml", &protocol.to_string(), &rig.facts());
    let plan = loaded.map_err(|faults| StudyError::arguments(FileError::Faults(faults)))?.plan;
    let mut settled = protocol.clone();
    settled.remove("aim");
    let number = |value: f64| Some(Value::Float(value));
    let values = [
        ("contact_sweep.target_sigma_hz", number(plan.contact_sweep.target_sigma_hz)),
        ("no_load_sweep.target_sigma_hz", number(plan.no_load_sweep.target_sigma_hz)),
        ("approach.fine_step_mm", number(plan.touch.approach.fine_step_mm)),
        ("no_load", Some(Value::String(plan.no_load.word().to_owned()))),
    ];
    for (key, value) in values {
        set(&mut settled, key, value);
    }
    Ok(settled)
}

/// A value in TOML; `None` for an empty text.
fn parsed(text: &str) -> Option<Value> {
    let table = format!("value = {text}").parse::<Table>();
    (!text.is_empty()).then(|| table.expect("the values of the settings are TOML")["value"].clone())
}

/// Sets a key, or removes it.
fn set(table: &mut Table, key: &str, value: Option<Value>) {
    let Some((section, rest)) = key.split_once('.') else {
        match value {
            Some(value) => _ = table.insert(key.to_owned(), value),
            None => _ = table.remove(key),
        }
        return;
    };
    let section = table.entry(section).or_insert_with(|| Value::Table(Table::new()));
    set(section.as_table_mut().expect("a section of the shipped files"), rest, value);
}

#[cfg(test)]
mod tests {
    use std::{collections::HashSet, path::PathBuf};

    use tempfile::TempDir;

    use super::*;

    /// Each setting changes the shipped files, and each rig can run its protocol.
    #[test]
    fn every_setting_is_a_bench_that_can_run_and_none_is_twice() {
        let config = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let files = Files::read(&config).unwrap();
        let mut seen = HashSet::new();
        for setting in SETTINGS.iter().chain(&TROUBLES) {
            let texts = files.changed(setting, Scene::Paper, 1);
            let folder = TempDir::new().unwrap();
            for (name, text) in ["protocol.toml", "rig.toml", "scene.toml"].iter().zip(&texts) {
                fs::write(folder.path().join(name), text).unwrap();
            }
            let name = format!("{}: {}", setting.knob, setting.value);
            let rig = LoadedRig::load(&folder.path().join("rig.toml"))
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            LoadedProtocol::load(&folder.path().join("protocol.toml"), &rig.facts())
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(seen.insert(texts), "{name} is there twice");
        }
    }
}
