//! Where a run goes on, and where one of its touches is measured again: what has changed since the part before, which a
//! person has confirmed.

use crate::{
    finding::{Check, Findings},
    record::{Amended, Change, Cited, Device, Resumed, RunStarted, Source},
};

const RIG_FILE: &str = "rig file";
const SCENE_FILE: &str = "scene file";
const INSTRUMENT_FILE: &str = "instrument file of the ";
const SOFTWARE: &str = "software";
/// Begins of changes of what a run cites.
const CITED: [&str; 2] = ["calibration (", "correction ("];

/// What the last part of a run states of its rig.
#[derive(Debug, Clone)]
pub(crate) struct Stated {
    rig: Source,
    scene: Option<Source>,
    /// Journals without it say nothing of a change.
    software: Option<String>,
    devices: Option<Vec<Device>>,
    calibrations: Vec<Cited>,
}

/// What is stated anew.
#[derive(Debug, Clone, Copy)]
struct Anew<'a> {
    rig: Option<&'a Source>,
    scene: Option<&'a Source>,
    software: Option<&'a String>,
    devices: Option<&'a [Device]>,
    calibrations: Option<&'a [Cited]>,
    changes: &'a [Change],
}

impl Stated {
    pub(crate) fn of(started: &RunStarted) -> Self {
        let RunStarted { rig, scene, software, devices, calibrations, .. } = started.clone();
        Self { rig, scene, software, devices, calibrations }
    }

    pub(crate) const fn rig(&self) -> &Source {
        &self.rig
    }

    /// The run goes on: the changes that are said are those that are.
    pub(crate) fn resumed(&mut self, seq: u64, resumed: &Resumed, findings: &mut Findings) {
        let Resumed { rig, scene, software, devices, calibrations, changes, .. } = resumed;
        let (devices, calibrations) = (devices.as_deref(), calibrations.as_deref());
        let (rig, scene, software) = (rig.as_ref(), scene.as_ref(), software.as_ref());
        let anew = Anew { rig, scene, software, devices, calibrations, changes };
        self.check(seq, &anew, false, findings);
        self.take(resumed);
    }

    /// The run goes on.
    pub(crate) fn take(&mut self, resumed: &Resumed) {
        let Resumed { rig, scene, software, devices, calibrations, .. } = resumed;
        if let Some(rig) = rig {
            self.rig = rig.clone();
        }
        if let Some(calibrations) = calibrations {
            self.calibrations.clone_from(calibrations);
        }
        self.scene = scene.clone().or(self.scene.take());
        self.software = software.clone().or(self.software.take());
        self.devices = devices.clone().or(self.devices.take());
    }

    /// A touch is measured again. A change of the scene is said without the scene.
    pub(crate) fn redone(&self, seq: u64, amended: &Amended, findings: &mut Findings) {
        let Amended { rig, software, devices, calibrations, changes, .. } = amended;
        let (rig, software) = (rig.as_ref(), software.as_ref());
        let is_scene = changes.iter().any(|change| change.what == SCENE_FILE);
        let other = Source { name: String::new(), toml: String::new() };
        let scene = is_scene.then_some(&other);
        let (devices, calibrations) = (Some(devices.as_slice()), calibrations.as_deref());
        let anew = Anew { rig, scene, software, devices, calibrations, changes };
        self.check(seq, &anew, true, findings);
    }

    fn check(&self, seq: u64, anew: &Anew<'_>, is_redo: bool, findings: &mut Findings) {
        let whose =
            if is_redo { "of a touch that is measured again" } else { "of a run that goes on" };
        for (what, file, before) in
            [(RIG_FILE, anew.rig, Some(&self.rig)), (SCENE_FILE, anew.scene, self.scene.as_ref())]
        {
            if file.is_some() && file == before {
                let what = format!("a change of the {what} {whose}");
                findings.add(Check::Plan, seq, what, "another one than before", "the same");
            }
        }
        let expected = self.changes(anew);
        let is_known = self.software.is_some() && anew.software.is_some();
        // Journals of before say that a calibration has changed, and a redo also that the rig file has, without what it is now:
        // the touches that follow rest on none.
        let is_held = |change: &&Change| match &*change.what {
            SOFTWARE => is_known,
            RIG_FILE => anew.rig.is_some() || !is_redo,
            what => {
                anew.calibrations.is_some() || !CITED.iter().any(|begin| what.starts_with(begin))
            }
        };
        let found: Vec<String> = anew.changes.iter().filter(is_held).map(text).collect();
        if found != expected && self.devices.is_some() && anew.devices.is_some() {
            let what = format!("the changes since the part before, {whose}");
            findings.add(Check::Plan, seq, what, format!("{expected:?}"), format!("{found:?}"));
        }
    }

    /// The changes in their order.
    fn changes(&self, anew: &Anew<'_>) -> Vec<String> {
        let change = |what: &str, was: &str, is: &str| {
            let [what, was, is] = [what, was, is].map(str::to_owned);
            text(&Change { what, was, is })
        };
        let mut changes = Vec::new();
        changes.extend(anew.rig.map(|_| change(RIG_FILE, "", "")));
        changes.extend(anew.scene.map(|_| change(SCENE_FILE, "", "")));
        if let (Some(was), Some(is)) = (&self.software, anew.software)
            && was != is
        {
            changes.push(change(SOFTWARE, was, is));
        }
        let before = self.devices.iter().flatten();
        for Device { role, identity, instrument } in anew.devices.unwrap_or_default() {
            let known = before.clone().find(|device| device.role == *role);
            let was = known.map_or("none", |device| &device.identity);
            if was != identity {
                changes.push(change(role, was, identity));
            }
            if known.and_then(|device| device.instrument.as_ref()) != instrument.as_ref() {
                changes.push(change(&format!("{INSTRUMENT_FILE}{role}"), "", ""));
            }
        }
        let cited = anew.calibrations.map(|now| cited_anew(&self.calibrations, now));
        let is_same = cited.as_ref().is_some_and(Vec::is_empty);
        changes.extend(is_same.then(|| "a calibration or a correction".to_owned()));
        changes.extend(cited.into_iter().flatten().map(|change| text(&change)));
        changes
    }
}

/// The calibrations and corrections that are others than before, in their order. A daily check is made each day, and is none
/// of them.
fn cited_anew(before: &[Cited], now: &[Cited]) -> Vec<Change> {
    let mut kinds: Vec<&Cited> = Vec::new();
    for cited in before.iter().chain(now).filter(|cited| cited.verdict.is_none()) {
        if kinds.iter().all(|known| known.kind != cited.kind) {
            kinds.push(cited);
        }
    }
    let of = |all: &[Cited], kind: &str| all.iter().find(|cited| cited.kind == kind).cloned();
    let word = |cited: Option<&Cited>| {
        cited.map_or_else(|| "none".to_owned(), |of| format!("{} of {}", of.file, of.made))
    };
    let changed = |Cited { kind, cable, .. }: &Cited| {
        let (was, is) = (of(before, kind), of(now, kind));
        let is_other = was.as_ref().map(|of| &of.sha256) != is.as_ref().map(|of| &of.sha256);
        let group = if cable.is_some() { "correction" } else { "calibration" };
        let what = format!("{group} ({kind})");
        is_other.then(|| Change { what, was: word(was.as_ref()), is: word(is.as_ref()) })
    };
    kinds.into_iter().filter_map(changed).collect()
}

/// A change in a word. What a change of a file says of its keys is not held against the file.
fn text(Change { what, was, is }: &Change) -> String {
    if [RIG_FILE, SCENE_FILE].contains(&&**what) || what.starts_with(INSTRUMENT_FILE) {
        what.clone()
    } else {
        format!("{what}: {was} → {is}")
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn stated() -> Stated {
        let source = |toml: &str| Source { name: "bench".to_owned(), toml: toml.to_owned() };
        let device = |role: &str| Device {
            role: role.to_owned(),
            identity: "A 1".to_owned(),
            instrument: None,
        };
        Stated {
            rig: source("a = 1"),
            scene: Some(source("b = 1")),
            software: Some("rigd 1".to_owned()),
            devices: Some(vec![device("analyzer"), device("linear drive")]),
            calibrations: Vec::new(),
        }
    }

    fn resumed(change: impl Fn(&mut Value)) -> Resumed {
        let device = |role: &str| json!({ "role": role, "identity": "A 1" });
        let mut resumed = json!({
            "epoch": 2, "who": "a person", "touches_done": 0, "touches_left": 0, "software": "rigd 1",
            "devices": [device("analyzer"), device("linear drive")],
        });
        change(&mut resumed);
        serde_json::from_value(resumed).unwrap()
    }

    /// What is stated, its keys, and the number of findings.
    type Row<'a> = (&'a str, &'a [(&'a str, Value)], usize);

    #[test]
    fn only_changes_that_are_said_and_are_there_are_sound() {
        let rig = json!({ "name": "bench", "toml": "a = 2" });
        let of_rig = json!({ "what": "rig file", "was": "bench: a = 1", "is": "bench: a = 2" });
        let of_program = json!({ "what": "software", "was": "rigd 1", "is": "rigd 2" });
        let of_analyzer = json!({ "what": "analyzer", "was": "A 1", "is": "B 2" });
        let of_scale = json!({ "what": "calibration (scale)", "was": "none", "is": "a of b" });
        let scale = json!([{ "kind": "scale", "file": "a", "made": "b", "sha256": "c" }]);
        let same = json!({ "name": "bench", "toml": "a = 1" });
        let instrument = json!({ "name": "hioki", "toml": "c = 1" });
        let own = |role: &str| json!({ "role": role, "identity": "A 1", "instrument": instrument });
        let own = json!([own("analyzer"), { "role": "linear drive", "identity": "A 1" }]);
        let of_file =
            json!({ "what": "instrument file of the analyzer", "was": "none", "is": "hioki" });
        let rows: [Row<'_>; 14] = [
            ("nothing", &[], 0),
            ("a rig file", &[("rig", rig.clone()), ("changes", json!([of_rig]))], 0),
            ("a rig file that is not said to have changed", &[("rig", rig)], 1),
            ("a change of the rig file without one", &[("changes", json!([of_rig]))], 1),
            ("the same rig file", &[("rig", same), ("changes", json!([of_rig]))], 1),
            ("a program", &[("software", json!("rigd 2")), ("changes", json!([of_program]))], 0),
            ("a program that is not said to have changed", &[("software", json!("rigd 2"))], 1),
            ("a device that did not change", &[("changes", json!([of_analyzer]))], 1),
            ("an instrument file", &[("devices", own.clone()), ("changes", json!([of_file]))], 0),
            ("an instrument file that is not said to have changed", &[("devices", own)], 1),
            (
                "a calibration",
                &[("calibrations", scale.clone()), ("changes", json!([of_scale]))],
                0,
            ),
            ("a calibration that is not said to have changed", &[("calibrations", scale)], 1),
            // As journals of before have it.
            ("a change of a calibration without one", &[("changes", json!([of_scale]))], 0),
            ("calibrations as before", &[("calibrations", json!([]))], 1),
        ];
        for (name, values, expected) in rows {
            let resumed = resumed(|resumed| {
                for (key, value) in values {
                    resumed[*key] = value.clone();
                }
            });
            let mut findings = Findings::default();
            stated().resumed(2, &resumed, &mut findings);
            assert_eq!(findings.0.len(), expected, "{name}: {findings:?}");
        }
    }

    #[test]
    fn what_an_older_journal_does_not_state_has_not_changed() {
        let mut findings = Findings::default();
        let resumed = resumed(|resumed| resumed["devices"] = Value::Null);
        let mut older = Stated { software: None, ..stated() };
        older.resumed(2, &resumed, &mut findings);
        assert!(findings.0.is_empty(), "{findings:?}");
    }
}
