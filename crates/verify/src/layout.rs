//! The steps of a plan: what each touch needs before it, in the order of the touches.
//!
//! A sample is placed and the sensor turned where a touch needs another one than the touch before. The no-load resonance
//! is measured as the protocol says, and anew after a person was at the bench.

use crate::{
    record::{Action, Pose, Prompt, Touch},
    settings::{Protocol, orientation, tilt_deg},
};

/// When the no-load resonance is measured again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NoLoad {
    EveryTouch,
    EveryPose,
    EverySample,
    ByDrift,
    Once,
}

impl NoLoad {
    /// The policy of a protocol; `None` for an unknown word.
    pub(crate) fn of(protocol: &Protocol) -> Option<Self> {
        Some(match protocol.no_load.as_deref() {
            None | Some("every-touch") => Self::EveryTouch,
            Some("every-pose") => Self::EveryPose,
            Some("every-sample") => Self::EverySample,
            Some("by-drift") => Self::ByDrift,
            Some("once") => Self::Once,
            Some(_) => return None,
        })
    }

    /// Whether the reference of a touch that a person leaves out is left out with it.
    pub(crate) const fn is_of_one_touch(self) -> bool {
        matches!(self, Self::EveryTouch | Self::ByDrift)
    }
}

/// A step of a plan.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Planned {
    pub(crate) step: String,
    pub(crate) action: Action,
    /// The address of the touch that it is for.
    pub(crate) touch: String,
}

impl Planned {
    pub(crate) const fn is_touch(&self) -> bool {
        matches!(self.action, Action::Touch { .. })
    }

    pub(crate) const fn is_no_load(&self) -> bool {
        matches!(self.action, Action::NoLoad { .. })
    }
}

/// The steps of these touches in their order; `None` if a direction is not known.
pub(crate) fn steps<'a>(
    touches: impl IntoIterator<Item = &'a Touch>,
    no_load: NoLoad,
) -> Option<Vec<Planned>> {
    let mut bench = Bench { no_load, sample: None, orientation: None, pose: None };
    let mut steps = Vec::new();
    for touch in touches {
        bench.touch(touch, &mut steps)?;
    }
    Some(steps)
}

/// The bench after the steps so far.
struct Bench<'a> {
    no_load: NoLoad,
    sample: Option<&'a str>,
    orientation: Option<&'static str>,
    /// The pose of the last no-load measurement, until a person is at the bench.
    pose: Option<&'a Pose>,
}

impl<'a> Bench<'a> {
    fn touch(&mut self, touch: &'a Touch, steps: &mut Vec<Planned>) -> Option<()> {
        let Touch { step, phase, sample, pose, repeat } = touch;
        let mut push = |what: &str, action| {
            steps.push(Planned { step: format!("{step}{what}"), action, touch: step.clone() });
        };
        if self.sample != Some(sample) {
            let prompt = Prompt::PlaceSample { sample: sample.clone() };
            push("/place-sample", Action::Prompt { prompt });
            self.sample = Some(sample);
            self.asked();
        }
        let needed = orientation(&pose.direction)?;
        if self.orientation != Some(needed) {
            let prompt = Prompt::TurnSensor { orientation: needed.to_owned() };
            push("/turn-sensor", Action::Prompt { prompt });
            self.orientation = Some(needed);
            self.asked();
        }
        if self.needs_no_load(pose) {
            push("/no-load", Action::NoLoad { pose: pose.clone() });
            self.pose = Some(pose);
        }
        let (phase, sample) = (phase.clone(), sample.clone());
        push("", Action::Touch { phase, sample, pose: pose.clone(), repeat: *repeat });
        Some(())
    }

    fn asked(&mut self) {
        if self.no_load != NoLoad::Once {
            self.pose = None;
        }
    }

    fn needs_no_load(&self, pose: &Pose) -> bool {
        match self.no_load {
            NoLoad::EveryTouch | NoLoad::ByDrift => true,
            NoLoad::EveryPose => self.pose != Some(pose),
            NoLoad::EverySample | NoLoad::Once => self.pose.is_none(),
        }
    }
}

/// The main touches in the order of the protocol, each as sample, direction, angle and repeat; `None` if it is a random
/// one, which is drawn from a seed.
pub(crate) fn main_order(protocol: &Protocol) -> Option<Vec<(&str, &str, f64, u32)>> {
    let is_by_travel = match protocol.order.as_deref() {
        None | Some("listed") => false,
        Some("by-travel") => true,
        Some(_) => return None,
    };
    let mut angles = protocol.angles_deg.clone();
    angles.sort_by(f64::total_cmp);
    let (mut order, mut present) = (Vec::new(), None);
    for sample in &protocol.samples {
        let mut here_deg = 0.0;
        for mounted in orientations(protocol, present)? {
            let mut mounting = mounting(protocol, sample, mounted, &angles);
            if is_by_travel {
                by_travel(&mut mounting, here_deg);
            }
            here_deg = mounting.last().map_or(here_deg, tilt);
            present = Some(mounted);
            order.append(&mut mounting);
        }
    }
    Some(order)
}

/// The mountings of the listed directions, the present one first; `None` if a direction is not known.
fn orientations(protocol: &Protocol, present: Option<&'static str>) -> Option<Vec<&'static str>> {
    let listed = protocol.directions.iter().map(|direction| orientation(direction));
    let listed: Vec<&'static str> = listed.collect::<Option<_>>()?;
    let mut orientations: Vec<&'static str> = Vec::new();
    for one in present.into_iter().chain(listed) {
        if !orientations.contains(&one) {
            orientations.push(one);
        }
    }
    Some(orientations)
}

fn mounting<'a>(
    protocol: &'a Protocol,
    sample: &'a str,
    mounted: &str,
    angles: &[f64],
) -> Vec<(&'a str, &'a str, f64, u32)> {
    let is_mounted = |direction: &&String| orientation(direction) == Some(mounted);
    let mut touches = Vec::new();
    for direction in protocol.directions.iter().filter(is_mounted) {
        for &angle in angles {
            touches
                .extend((1..=protocol.repeats).map(|repeat| (sample, &**direction, angle, repeat)));
        }
    }
    touches
}

/// Sorts the touches of one mounting by tilt, from the end that is nearer to where the sample stands.
fn by_travel(touches: &mut [(&str, &str, f64, u32)], here_deg: f64) {
    touches.sort_by(|one, other| tilt(one).total_cmp(&tilt(other)));
    let way =
        |end: Option<&(&str, &str, f64, u32)>| end.map_or(0.0, |end| (tilt(end) - here_deg).abs());
    if way(touches.last()) < way(touches.first()) {
        // Repeats stay in their order.
        touches.sort_by(|one, other| tilt(other).total_cmp(&tilt(one)));
    }
}

/// Where the rotary stage stands in a touch, degrees.
fn tilt(&(_, direction, angle_deg, _): &(&str, &str, f64, u32)) -> f64 {
    // Minus zero would come before zero.
    tilt_deg(direction, angle_deg).unwrap_or_default() + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROTOCOL: &str = "samples = ['1', '5']\ndirections = ['front', 'left', 'back']\nangles_deg = [30, 0]\n\
        touch = { indentation_mm = 0.5 }\n\
        contact_sweep = { min_hz = 1, max_hz = 2 }\n\
        no_load_sweep = { min_hz = 1, max_hz = 2 }\n\
        approach = { give_up_below_mm = 1, coarse_step_mm = 0.1, contact_threshold = 0.1 }\n";

    fn protocol(order: &str) -> Protocol {
        toml::from_str(&format!("order = '{order}'\n{PROTOCOL}")).unwrap()
    }

    fn order(protocol: &Protocol) -> Vec<String> {
        let order = main_order(protocol).unwrap();
        order
            .iter()
            .map(|(sample, direction, angle, _)| format!("{sample} {direction} {angle}"))
            .collect()
    }

    #[test]
    fn the_sensor_is_turned_once_for_each_sample() {
        let listed = [
            "1 front 0",
            "1 front 30",
            "1 back 0",
            "1 back 30",
            "1 left 0",
            "1 left 30",
            "5 left 0",
            "5 left 30",
            "5 front 0",
            "5 front 30",
            "5 back 0",
            "5 back 30",
        ];
        assert_eq!(order(&protocol("listed")), listed);
        // Both ends are as far from level, and the next mounting begins where the stage stands.
        let by_travel = [
            "1 back 30",
            "1 front 0",
            "1 back 0",
            "1 front 30",
            "1 left 30",
            "1 left 0",
            "5 left 0",
            "5 left 30",
            "5 front 30",
            "5 front 0",
            "5 back 0",
            "5 back 30",
        ];
        assert_eq!(order(&protocol("by-travel")), by_travel);
        assert_eq!(main_order(&protocol("random")), None);
    }

    fn touches(poses: &[(&str, f64)]) -> Vec<Touch> {
        let touch = |(index, &(direction, angle_deg)): (usize, &(&str, f64))| Touch {
            step: index.to_string(),
            phase: "main".to_owned(),
            sample: "1".to_owned(),
            pose: Pose { direction: direction.to_owned(), angle_deg },
            repeat: 1,
        };
        poses.iter().enumerate().map(touch).collect()
    }

    #[test]
    fn references_are_measured_as_the_policy_says() {
        let touches = touches(&[("front", 0.0), ("front", 0.0), ("back", 30.0), ("left", 30.0)]);
        for (no_load, before) in [
            (NoLoad::EveryTouch, &["0", "1", "2", "3"][..]),
            (NoLoad::ByDrift, &["0", "1", "2", "3"]),
            (NoLoad::EveryPose, &["0", "2", "3"]),
            (NoLoad::EverySample, &["0", "3"]),
            (NoLoad::Once, &["0"]),
        ] {
            let steps = steps(&touches, no_load).unwrap();
            let found: Vec<_> =
                steps.iter().filter(|step| step.is_no_load()).map(|step| &*step.touch).collect();
            assert_eq!(found, before, "{no_load:?}");
            let prompts = ["0/place-sample", "0/turn-sensor", "3/turn-sensor"];
            let is_prompt = |step: &&Planned| matches!(step.action, Action::Prompt { .. });
            let found: Vec<_> = steps.iter().filter(is_prompt).map(|step| &*step.step).collect();
            assert_eq!(found, prompts, "{no_load:?}");
        }
    }
}
