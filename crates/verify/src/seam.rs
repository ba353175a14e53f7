//! Where a run goes on: what has changed since the part before, which a person has confirmed.

use crate::{
    finding::{Check, Findings},
    record::{Change, Device, Resumed, RunStarted, Source},
};

const RIG_FILE: &str = "rig file";
const SCENE_FILE: &str = "scene file";
const INSTRUMENT_FILE: &str = "instrument file of the ";
const SOFTWARE: &str = "software";
/// Begins of what is not held against the records here: calibrations and corrections.
const CITED: [&str; 2] = ["calibration (", "correction ("];

/// What the last part of a run states of its rig.
#[derive(Debug)]
pub(crate) struct Stated {
    rig: Source,
    scene: Option<Source>,
    /// Journals without it say nothing of a change.
    software: Option<String>,
    devices: Option<Vec<Device>>,
}

impl Stated {
    pub(crate) fn of(started: &RunStarted) -> Self {
        let RunStarted { rig, scene, software, devices, .. } = started;
        let (rig, scene) = (rig.clone(), scene.clone());
        Self { rig, scene, software: software.clone(), devices: devices.clone() }
    }

    /// The run goes on: the changes that are said are those that are.
    pub(crate) fn resumed(&mut self, seq: u64, resumed: &Resumed, findings: &mut Findings) {
        for (what, file, before) in [
            (RIG_FILE, resumed.rig.as_ref(), Some(&self.rig)),
            (SCENE_FILE, resumed.scene.as_ref(), self.scene.as_ref()),
        ] {
            if file.is_some() && file == before {
                let what = format!("a change of the {what} of a run that goes on");
                findings.add(Check::Plan, seq, what, "another one than before", "the same");
            }
        }
        let expected = self.changes(resumed);
        let is_held = |change: &&Change| {
            let is_cited = CITED.iter().any(|begin| change.what.starts_with(begin));
            let is_known = self.software.is_some() && resumed.software.is_some();
            !is_cited && (change.what != SOFTWARE || is_known)
        };
        let found: Vec<String> = resumed.changes.iter().filter(is_held).map(text).collect();
        if found != expected && self.devices.is_some() && resumed.devices.is_some() {
            let what = "the changes since the part before, of a run that goes on";
            findings.add(Check::Plan, seq, what, format!("{expected:?}"), format!("{found:?}"));
        }
        if let Some(rig) = &resumed.rig {
            self.rig = rig.clone();
        }
        self.scene = resumed.scene.clone().or(self.scene.take());
        self.software = resumed.software.clone().or(self.software.take());
        self.devices = resumed.devices.clone().or(self.devices.take());
    }

    /// The changes in their order.
    fn changes(&self, resumed: &Resumed) -> Vec<String> {
        let change = |what: &str, was: &str, is: &str| {
            let [what, was, is] = [what, was, is].map(str::to_owned);
            text(&Change { what, was, is })
        };
        let mut changes = Vec::new();
        changes.extend(resumed.rig.as_ref().map(|_| change(RIG_FILE, "", "")));
        changes.extend(resumed.scene.as_ref().map(|_| change(SCENE_FILE, "", "")));
        if let (Some(was), Some(is)) = (&self.software, &resumed.software)
            && was != is
        {
            changes.push(change(SOFTWARE, was, is));
        }
        let before = self.devices.iter().flatten();
        for Device { role, identity, instrument } in resumed.devices.iter().flatten() {
            let known = before.clone().find(|device| device.role == *role);
            let was = known.map_or("none", |device| &device.identity);
            if was != identity {
                changes.push(change(role, was, identity));
            }
            if known.and_then(|device| device.instrument.as_ref()) != instrument.as_ref() {
                changes.push(change(&format!("{INSTRUMENT_FILE}{role}"), "", ""));
            }
        }
        changes
    }
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
        let same = json!({ "name": "bench", "toml": "a = 1" });
        let instrument = json!({ "name": "hioki", "toml": "c = 1" });
        let own = |role: &str| json!({ "role": role, "identity": "A 1", "instrument": instrument });
        let own = json!([own("analyzer"), { "role": "linear drive", "identity": "A 1" }]);
        let of_file =
            json!({ "what": "instrument file of the analyzer", "was": "none", "is": "hioki" });
        let rows: [Row<'_>; 11] = [
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
            ("a calibration", &[("changes", json!([of_scale]))], 0),
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
