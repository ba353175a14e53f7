//! The checks of a protocol, alone and against the limits of a rig.

use std::fmt::Display;

use rig_files::{Faults, Location, settings::Setting};
use rig_model::{ContactAngle, Direction, Mm, Position, RigLimits};

use crate::{
    AngleKnowledge, Pose, Protocol, aim, descent,
    fault::{DepthLimit, ProtocolFault},
    protocol::{self, ApproachKeys, BlindPhase},
    sweep::SweepKeys,
};

/// Touches and blind trials of a protocol. More would keep a rig busy for two weeks and more.
const MAX_TOUCHES: usize = 100_000;

impl Protocol {
    /// Reads the `text` of a protocol `file`, and keeps its faults: see [`Protocol::faults`].
    pub fn read(file: &str, text: &str) -> Self {
        let (protocol, mut faults) = rig_files::settings::read(file, text, protocol::protocol);
        by_itself(&protocol, &mut faults);
        Self { faults, ..protocol }
    }

    /// The JSON Schema of protocol files.
    pub fn schema() -> serde_json::Value {
        rig_files::settings::schema("protocol of rigd", protocol::protocol)
    }
}

/// Checks that need no rig.
fn by_itself(protocol: &Protocol, faults: &mut Faults) {
    for sample in &protocol.samples {
        sample.check(faults, |name| {
            let is_fit = name.trim() == name && !name.contains('/');
            (!is_fit).then(|| ProtocolFault::SampleName { name: name.clone() })
        });
    }
    listed_twice(&protocol.samples, |name| format!("\"{name}\""), faults);
    listed_twice(&protocol.directions, |direction| format!("\"{}\"", direction.name()), faults);
    listed_twice(&protocol.angles, |angle| angle.degrees().to_string(), faults);
    let poses = protocol.samples.len() * protocol.directions.len() * protocol.angles.len();
    protocol.repeats.check(faults, |&repeats| {
        let touches = poses.saturating_mul(repeats as usize);
        let fault = ProtocolFault::TooManyTouches { touches, limit: MAX_TOUCHES };
        (touches > MAX_TOUCHES).then_some(fault)
    });
    protocol.angle.check(faults, |&angle| {
        let is_touched =
            |direction: &Direction| directions(protocol).any(|touched| touched == *direction);
        let missing = Direction::ALL.into_iter().find(|direction| !is_touched(direction));
        // No directions are the placeholder of a faulty list.
        let direction = missing.filter(|_| directions(protocol).next().is_some())?;
        (angle == AngleKnowledge::Unknown).then_some(ProtocolFault::UnknownAngleNeeds { direction })
    });
    approach(protocol, faults);
    aim::check(protocol, faults);
    descent::by_itself(protocol, faults);
    if let Some(blind) = &protocol.blind {
        blind_phase(blind, protocol.samples.len(), faults);
        let repeats = protocol.repeats.sound().copied().unwrap_or_default();
        let touches = poses.saturating_mul(repeats as usize);
        blind.trials.check(faults, |&trials| {
            let all = touches + trials as usize;
            let fault = ProtocolFault::TooManyTrials { trials, all, limit: MAX_TOUCHES };
            (touches <= MAX_TOUCHES && all > MAX_TOUCHES).then_some(fault)
        });
    }
}

fn listed_twice<T: PartialEq>(
    list: &[Setting<T>],
    written: impl Fn(&T) -> String,
    faults: &mut Faults,
) {
    for (index, item) in list.iter().enumerate() {
        let is_there = |earlier: &Setting<T>| earlier.sound() == Some(&item.value);
        item.check(faults, |value| {
            list[..index]
                .iter()
                .any(is_there)
                .then(|| ProtocolFault::ListedTwice { item: written(value), key: item.key })
        });
    }
}

fn approach(protocol: &Protocol, faults: &mut Faults) {
    let keys = &protocol.approach;
    if let (Some(&coarse), Some(&fine)) = (keys.coarse_step_mm.sound(), keys.fine_step_mm.sound())
        && fine > coarse
    {
        faults.refuse(&keys.fine_step_mm, &ProtocolFault::FineAboveCoarse { fine, coarse });
    }
    if let (Some(slip_mm), Some(&fine)) = (&keys.slip_mm, keys.fine_step_mm.sound()) {
        slip_mm.check(faults, |&slip| {
            (0.0 < slip && slip < fine).then_some(ProtocolFault::SlipBelowFine { slip, fine })
        });
    }
    let Some(&indentation) = protocol.touch.indentation_mm.sound() else { return };
    if let Some(halfway_mm) = &protocol.touch.halfway_mm {
        halfway_mm.check(faults, |&halfway| {
            (halfway >= indentation)
                .then_some(ProtocolFault::HalfwayTooDeep { halfway, indentation })
        });
    }
    if let Some(slip_mm) = &keys.slip_mm {
        slip_mm.check(faults, |&slip| {
            (slip > indentation)
                .then_some(ProtocolFault::SlipAboveIndentation { slip, indentation })
        });
    }
    keys.coarse_step_mm.check(faults, |&coarse| {
        (coarse > indentation)
            .then_some(ProtocolFault::CoarseAboveIndentation { coarse, indentation })
    });
}

fn blind_phase(blind: &BlindPhase, samples: usize, faults: &mut Faults) {
    let BlindPhase { trials, classes, min_angle_deg, max_angle_deg, order: _ } = blind;
    classes.check(faults, |&classes| {
        // No samples are the placeholder of a faulty list.
        (samples > 0 && classes as usize > samples)
            .then_some(ProtocolFault::MoreClassesThanSamples { classes, samples })
    });
    if let (Some(&trials_), Some(&classes)) = (trials.sound(), classes.sound())
        && trials_ < classes
    {
        faults.refuse(trials, &ProtocolFault::FewerTrialsThanClasses { trials: trials_, classes });
    }
    if let (Some(&min), Some(&max)) = (min_angle_deg.sound(), max_angle_deg.sound())
        && blind.angles().is_empty()
    {
        faults.refuse(max_angle_deg, &ProtocolFault::NoBlindAngle { min, max });
    }
}

/// Checks against the limits of a rig.
pub(crate) fn on_rig(protocol: &Protocol, limits: &RigLimits, faults: &mut Faults) {
    depths(protocol, limits, faults);
    sweep(&protocol.no_load_sweep.sweep, limits, faults);
    sweep(&protocol.contact_sweep, limits, faults);
    let tilts = tilts(protocol);
    descent::check(protocol, limits, faults);
    rotary(protocol, &tilts, limits, faults);
    linear(protocol, &tilts, limits, faults);
}

/// Checks that the simulated rig has the samples.
pub(crate) fn samples_are_known(protocol: &Protocol, known: &[String], faults: &mut Faults) {
    for sample in &protocol.samples {
        sample.check(faults, |name| {
            let fault =
                || ProtocolFault::UnknownSample { name: name.clone(), known: known.to_vec() };
            (!known.contains(name)).then(fault)
        });
    }
}

fn depths(protocol: &Protocol, limits: &RigLimits, faults: &mut Faults) {
    let own = protocol.max_indentation_mm().and_then(Setting::sound).copied();
    let rig = limits.motion.max_indentation_mm;
    let probe = 2.0 * limits.geometry.probe_radius_mm;
    protocol.touch.indentation_mm.check(faults, |&found| {
        // Only the strictest limit: keeping it keeps the others.
        let whose = [(rig, DepthLimit::Rig), (probe, DepthLimit::Probe)];
        let own = own.map(|own| (own, DepthLimit::Protocol));
        let limits = own.into_iter().chain(whose);
        let (limit, whose) = limits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (found > limit).then_some(ProtocolFault::TooDeep { found, limit, whose })
    });
    let limit = limits.linear.tolerance();
    protocol.approach.fine_step_mm.check(faults, |&found| {
        (found < limit).then_some(ProtocolFault::FinerThanStage { found, limit })
    });
}

fn sweep(sweep: &SweepKeys, limits: &RigLimits, faults: &mut Faults) {
    let (min, max) = limits.analyzer.frequency_hz;
    for edge in [&sweep.min_hz, &sweep.max_hz] {
        let key = edge.key;
        edge.check(faults, |&found| {
            let is_within = min <= found && found <= max;
            (!is_within).then_some(ProtocolFault::BeyondAnalyzer { key, found, min, max })
        });
    }
    let (least, limit) = (limits.analyzer.min_level_v, limits.analyzer.max_level_v);
    sweep.level_v.check(faults, |&found| {
        if found < least {
            return Some(ProtocolFault::LevelTooLow { found, limit: least });
        }
        (found > limit).then_some(ProtocolFault::LevelTooHigh { found, limit })
    });
}

/// An angle that sets the extremes of the stages, with its location.
struct Tilt {
    angle: ContactAngle,
    location: Location,
    /// As messages name it.
    subject: String,
}

fn tilts(protocol: &Protocol) -> Vec<Tilt> {
    fn tilt<T: Display>(setting: &Setting<T>, angle: impl Fn(&T) -> ContactAngle) -> Option<Tilt> {
        let (location, subject) = (setting.location, setting.to_string());
        setting.sound().map(|value| Tilt { angle: angle(value), location, subject })
    }
    let listed = protocol.angles.iter().filter_map(|setting| tilt(setting, |angle| *angle));
    let drawn = protocol.blind.iter().filter_map(|blind| {
        tilt(&blind.max_angle_deg, |degrees| protocol::contact_angle(*degrees))
    });
    listed.chain(drawn).collect()
}

fn directions(protocol: &Protocol) -> impl Iterator<Item = Direction> + Clone {
    protocol.directions.iter().filter_map(Setting::sound).copied()
}

fn rotary(protocol: &Protocol, tilts: &[Tilt], limits: &RigLimits, faults: &mut Faults) {
    let soft = limits.rotary.soft();
    let reach = |direction| match direction {
        Direction::Front | Direction::Left => soft.max.value(),
        Direction::Back => -soft.min.value(),
    };
    let reach_deg = directions(protocol).map(reach).fold(f64::INFINITY, f64::min);
    let tolerance = limits.rotary.tolerance();
    for (index, setting) in protocol.angles.iter().enumerate() {
        setting.check(faults, |&angle| {
            let by_deg = |other: &ContactAngle| (angle.degrees() - other.degrees()).abs();
            let mut earlier = protocol.angles[..index].iter().filter_map(Setting::sound);
            // The same angle is listed twice.
            let near = earlier.find(|other| **other != angle && by_deg(other) <= tolerance);
            near.map(|&other| ProtocolFault::SameTilt { angle, other, tolerance })
        });
    }
    let clear = limits.linear.rest_target().position();
    for Tilt { angle, location, subject } in tilts {
        let is_beyond = |direction: &Direction| !soft.contains(direction.rotary_position(*angle));
        if let Some(direction) = directions(protocol).find(is_beyond) {
            let rotary = direction.rotary_position(*angle);
            let subject = subject.clone();
            let fault = ProtocolFault::OutOfReach { subject, direction, rotary, soft, reach_deg };
            faults.refuse(*location, &fault);
        }
        let highest = limits.geometry.highest_sample_point(angle.degrees());
        if highest >= clear {
            let subject = subject.clone();
            faults.refuse(*location, &ProtocolFault::NotCleared { subject, highest, clear });
        }
    }
}

fn linear(protocol: &Protocol, tilts: &[Tilt], limits: &RigLimits, faults: &mut Faults) {
    let ApproachKeys { start_above_mm, give_up_below_mm, .. } = &protocol.approach;
    let steepest = tilts.iter().map(|tilt| tilt.angle).reduce(|a, b| if b > a { b } else { a });
    if let Some(angle) = steepest {
        // Along the vertical, a surface that lies elsewhere by t along its normal does so by t/cos α.
        let limit = limits.geometry.surface_tolerance_mm / angle.radians().cos();
        for setting in [start_above_mm, give_up_below_mm] {
            let key = setting.key;
            setting.check(faults, |&found| {
                let fault = ProtocolFault::WithinSurfaceTolerance { key, found, limit, angle };
                (found < limit).then_some(fault)
            });
        }
    }
    let touch = protocol.touch_settings(limits);
    let start = |pose: Pose| (touch.start(limits, pose), pose);
    let starts: Vec<_> = poses(protocol).into_iter().map(start).collect();
    let by_height =
        |a: &&(Position<Mm>, _), b: &&(Position<Mm>, _)| a.0.value().total_cmp(&b.0.value());
    let highest = starts.iter().max_by(by_height);
    let lowest = starts.iter().min_by(by_height);

    let clear = limits.linear.rest_target().position();
    if let Some(&(start, pose)) = highest {
        start_above_mm.check(faults, |&found| {
            let fault = ProtocolFault::StartsAboveClear { found, start, pose, clear };
            (start >= clear).then_some(fault)
        });
    }
    let soft = limits.linear.soft();
    if let (Some(&(_, pose)), Some(_)) = (lowest, protocol.touch.indentation_mm.sound()) {
        give_up_below_mm.check(faults, |_| {
            let floor = touch.floor(limits, pose);
            (floor < soft.min).then_some(ProtocolFault::BelowSoftLimits { floor, pose, soft })
        });
    }
}

/// Every pose in which the protocol may touch, those that a blind trial can draw included.
fn poses(protocol: &Protocol) -> Vec<Pose> {
    let listed = protocol.angles.iter().filter_map(Setting::sound).copied();
    let drawn = protocol.blind.iter().flat_map(BlindPhase::angles);
    let angles: Vec<_> = listed.chain(drawn).collect();
    let in_direction = |direction| angles.iter().map(move |&angle| Pose { direction, angle });
    directions(protocol).flat_map(in_direction).collect()
}
