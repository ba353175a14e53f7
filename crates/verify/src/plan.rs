//! The planned touches against the protocol.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    finding::{Check, Findings},
    layout,
    record::{RunStarted, Touch},
    settings::{Blind, Protocol, Rig, Scene},
};

/// Steps of the angles of blind touches, degrees.
const BLIND_STEP_DEG: f64 = 0.01;

/// Checks that the plan has each pose of each sample once for each repeat, and as many blind touches
/// as asked for.
pub(crate) fn check(
    started: &RunStarted,
    protocol: &Protocol,
    record: u64,
    findings: &mut Findings,
) {
    let mut add = |what: &str, expected: String, found: String| {
        findings.add(Check::Plan, record, what, expected, found);
    };
    let names: Vec<&str> = started.samples.iter().map(|sample| sample.name.as_str()).collect();
    if names != protocol.samples {
        add("the samples differ", protocol.samples.join(", "), names.join(", "));
    }
    let (count, stated) = (started.touches.len(), started.plan.touches);
    if count != stated as usize {
        add("the number of planned touches differs", stated.to_string(), count.to_string());
    }
    let steps: BTreeSet<&str> = started.touches.iter().map(|touch| touch.step.as_str()).collect();
    if steps.len() != count {
        add(
            "two planned touches have the same address",
            count.to_string(),
            steps.len().to_string(),
        );
    }
    let mut expected: BTreeMap<String, i64> = BTreeMap::new();
    for sample in &protocol.samples {
        for direction in &protocol.directions {
            for angle in &protocol.angles_deg {
                for repeat in 1..=protocol.repeats {
                    *expected.entry(main_step(sample, direction, *angle, repeat)).or_default() += 1;
                }
            }
        }
    }
    let trials = protocol.blind.as_ref().map_or(0, |blind| blind.trials);
    let mut blind = 0;
    let is_by_mounting = protocol.blind.as_ref().is_some_and(Blind::is_by_mounting);
    for touch in &started.touches {
        let Touch { step, phase, sample, pose, repeat } = touch;
        if phase == "main" {
            let address = main_step(sample, &pose.direction, pose.angle_deg, *repeat);
            *expected.entry(address.clone()).or_default() -= 1;
            if *step != address {
                add("the address of a touch is not that of its pose", address, step.clone());
            }
            continue;
        }
        blind += 1;
        let is_drawn = protocol.blind.as_ref().is_some_and(|blind| {
            let range = blind.min_angle_deg - 0.5 * BLIND_STEP_DEG
                ..=blind.max_angle_deg + 0.5 * BLIND_STEP_DEG;
            range.contains(&pose.angle_deg)
        });
        let is_known =
            protocol.samples.contains(sample) && protocol.directions.contains(&pose.direction);
        let is_in_order = if is_by_mounting { *repeat <= trials } else { *repeat == blind };
        if !(is_drawn && is_known && *step == format!("blind/{repeat}") && is_in_order) {
            let what = "a blind touch is not one that the protocol can draw";
            add(what, format!("blind/{blind} within the section [blind]"), format!("{touch:?}"));
        }
    }
    check_order(started, protocol, &mut add);
    for (step, missing) in expected.into_iter().filter(|(_, count)| *count != 0) {
        let found = if missing > 0 { "none" } else { "one too many" };
        add("a touch of the protocol", format!("{step} once"), found.to_owned());
    }
    if blind != trials {
        add("the number of blind touches differs", trials.to_string(), blind.to_string());
    }
    let (mountings, apart) = mountings(&started.touches);
    if is_by_mounting && apart != mountings {
        let what = "blind touches that are to be made by mounting";
        add(what, format!("{apart} mountings"), mountings.to_string());
    }
}

/// The name of a run and its seed are those of its protocol.
pub(crate) fn check_name(
    name: &str,
    started: &RunStarted,
    protocol: &Protocol,
    record: u64,
    findings: &mut Findings,
) {
    let mut differ = |what: &str, expected: &str, found: &str| {
        if expected != found {
            findings.add(Check::Plan, record, what, expected, found);
        }
    };
    if let Some(of_file) = protocol.name.as_deref().map(str::trim) {
        differ("the name of the run in the list", of_file, name.trim());
        differ("the name of the protocol", of_file, started.protocol.name.trim());
    }
    if let (Some(of_file), Some(stated)) = (protocol.seed(), started.seed) {
        differ("the seed of the run", &of_file.to_string(), &stated.to_string());
    }
}

/// The main touches come first, in the order of the protocol. A random one is drawn, and not known here.
fn check_order(
    started: &RunStarted,
    protocol: &Protocol,
    add: &mut impl FnMut(&str, String, String),
) {
    if layout::NoLoad::of(protocol).is_none() {
        let policy = protocol.no_load.clone().unwrap_or_default();
        add("when the no-load resonance is measured", "a known word".to_owned(), policy);
    }
    let is_main = |touch: &&Touch| touch.phase == "main";
    let first: Vec<&Touch> = started.touches.iter().take_while(is_main).collect();
    let later = started.touches.iter().skip(first.len()).find(is_main);
    if let Some(touch) = later {
        add("a main touch behind a blind one", "none".to_owned(), touch.step.clone());
    }
    let Some(order) = layout::main_order(protocol) else { return };
    let planned = first.iter().map(|touch| touch.step.clone());
    let expected = order.iter().map(|&(sample, direction, angle_deg, repeat)| {
        main_step(sample, direction, angle_deg, repeat)
    });
    let apart = expected.zip(planned).find(|(expected, planned)| expected != planned);
    if let Some((expected, planned)) = apart {
        add("the order of the main touches", expected, planned);
    }
}

/// The number of mountings of sample and sensor that the blind touches need in their order, and that of
/// different ones among them.
fn mountings(touches: &[Touch]) -> (usize, usize) {
    let blind = touches.iter().filter(|touch| touch.phase != "main");
    let mut all: Vec<(&str, bool)> =
        blind.map(|touch| (touch.sample.as_str(), touch.pose.direction == "left")).collect();
    all.dedup();
    let apart: BTreeSet<_> = all.iter().collect();
    (all.len(), apart.len())
}

fn main_step(sample: &str, direction: &str, angle_deg: f64, repeat: u32) -> String {
    format!("main/{sample}/{direction}/{angle_deg}/{repeat}")
}

/// Checks that the run says of its bench what the files say that it keeps: whether it is simulated, and
/// how stiff its samples are.
pub(crate) fn check_files(started: &RunStarted, rig: &Rig, record: u64, findings: &mut Findings) {
    let scene = started.scene.as_ref().map(|scene| toml::from_str::<Scene>(&scene.toml));
    let is_simulated = rig.connection.as_deref() == Some("simulated");
    if [started.is_simulated, started.scene.is_some()] != [is_simulated; 2] {
        let what = "whether the run is simulated";
        let expected = rig.connection.as_deref().unwrap_or("none");
        findings.add(Check::Plan, record, what, expected, started.is_simulated);
    }
    let known = match &scene {
        Some(Ok(scene)) => &scene.samples,
        Some(Err(error)) => {
            let what = "the scene in the journal cannot be read";
            findings.add(Check::Readable, record, what, "TOML with the known keys", error);
            return;
        }
        None => &rig.samples,
    };
    for sample in &started.samples {
        let of_file = known.iter().find(|known| known.name == sample.name);
        let of_file = of_file.and_then(|known| known.stiffness_mpa);
        if of_file != sample.stiffness_mpa {
            let what = format!("the stiffness of sample {}, MPa", sample.name);
            let (expected, found) = (format!("{of_file:?}"), format!("{:?}", sample.stiffness_mpa));
            findings.add(Check::Sample, record, what, expected, found);
        }
    }
}
