//! Steps with answers that a person gives in another order than the simulated one.

use std::{
    collections::VecDeque,
    convert::Infallible,
    pin::pin,
    task::{Context, Poll, Waker},
};

use super::*;
use crate::Verdict;

/// A bench whose axes go where they are told, up to an end, and whose answers are given.
struct Scripted {
    answers: VecDeque<(Asked, Choice)>,
    /// What is read whenever it is asked for.
    readings: Vec<(Asked, f64)>,
    at: [f64; 2],
    /// Whether the drives find their zero again after their power was off.
    is_forgetting: bool,
    is_homed: [bool; 2],
    /// Below this no step down is admitted.
    lowest: Option<f64>,
    /// Soft limits that the drives have.
    soft: [Option<[f64; 2]>; 2],
    /// The last way of the linear stage, and what a dial gauge says of it, with the number of its reading from 0.
    moved: f64,
    dial: fn(usize, f64) -> f64,
    dials: usize,
    /// Whether the table turns as its drive says; otherwise it stands still.
    is_tilting: bool,
    /// What was said, and each motion.
    said: Vec<String>,
}

/// Where each axis is stopped.
const ENDS: [f64; 2] = [50.0, 60.0];

impl Bench for Scripted {
    type Trouble = Infallible;

    async fn ask(&mut self, asked: Asked) -> Result<Answer, Infallible> {
        let is_next = self.answers.front().is_some_and(|(next, _)| *next == asked);
        let next = if is_next { self.answers.pop_front() } else { None };
        self.said.push(format!("{asked:?}"));
        if asked == Asked::PowerCycle && self.is_forgetting {
            self.is_homed = [false; 2];
        }
        if asked == Asked::FindZero && is_next {
            self.is_homed = [true; 2];
        }
        let gauge = match asked {
            Asked::Dial => Some((self.dial)(self.dials, self.moved)),
            Asked::Gauge => Some(if self.is_tilting { self.at[1] } else { 0.0 }),
            _ => None,
        };
        self.dials += usize::from(asked == Asked::Dial);
        if let Some(reading) = gauge {
            return Ok(Answer::Reading(reading));
        }
        if let Some((_, reading)) = self.readings.iter().find(|(of, _)| *of == asked) {
            return Ok(Answer::Reading(*reading));
        }
        Ok(Answer::Choice(next.map_or(Choice::No, |(_, choice)| choice)))
    }

    async fn drive(&mut self, order: Order) -> Result<Result<Jogged, NotDone>, Infallible> {
        let axis = usize::from(order.axis() == JogAxis::Rotary);
        let (from, is_homed, soft) = (self.at[axis], self.is_homed[axis], self.soft[axis]);
        let Order::Step(jog) = order else {
            if order.is_homing() {
                self.said.push(format!("{order:?}"));
                self.is_homed[axis] = true;
            }
            return Ok(Ok(Jogged { from, at: from, is_homed, soft }));
        };
        let to = from + jog.by;
        if self.lowest.is_some_and(|lowest| axis == 0 && jog.by < 0.0 && to < lowest) {
            return Ok(Err(NotDone::Refused(format!("it would lead down to {to:.3} mm"))));
        }
        self.at[axis] = (from + jog.by).clamp(-ENDS[axis], ENDS[axis]);
        if jog.by != 0.0 {
            self.said.push(format!("{} moves {}", jog.axis.name(), jog.by));
            if jog.axis == JogAxis::Linear {
                self.moved = self.at[axis] - from;
            }
        }
        let at = self.at[axis];
        let is_stopped = (at - from - jog.by).abs() > 1e-9;
        let made = Jogged { from, at, is_homed, soft };
        Ok(if is_stopped { Err(NotDone::Failed("stopped".to_owned())) } else { Ok(made) })
    }

    async fn seen(&mut self, _: JogAxis) -> Result<(), Infallible> {
        Ok(())
    }

    async fn homing_begins(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn remark(&mut self, text: &str) {
        self.said.push(text.to_owned());
    }
}

const RIG: &str = include_str!("../../../../config/rigs/simulated.toml");

fn scripted(answers: &[(Asked, Choice)]) -> Scripted {
    Scripted {
        answers: answers.iter().copied().collect(),
        readings: Vec::new(),
        at: [25.0, 0.0],
        is_forgetting: false,
        is_homed: [true; 2],
        lowest: None,
        soft: [None; 2],
        moved: 0.0,
        dial: |_, way| way,
        dials: 0,
        is_tilting: true,
        said: Vec::new(),
    }
}

/// Makes a step with these answers, a no where they do not fit, and returns what was said and moved.
fn play(step: Step, answers: &[(Asked, Choice)]) -> (Finding, Vec<String>) {
    play_on(step, RIG, scripted(answers))
}

fn play_on(step: Step, rig: &str, mut bench: Scripted) -> (Finding, Vec<String>) {
    let rig = RigFile::read("rig.toml", rig).unwrap();
    let found = {
        let mut step = pin!(carry_out(step, &rig, &mut bench));
        let Poll::Ready(Ok(found)) = step.as_mut().poll(&mut Context::from_waker(Waker::noop()))
        else {
            panic!("a scripted bench has nothing to wait for")
        };
        found
    };
    (found, bench.said)
}

#[test]
fn an_axis_that_something_else_stopped_moves_again_only_when_the_way_is_free() {
    let begin = [(Asked::NoSample, Choice::Yes), (Asked::AtLimit, Choice::No)];
    let (found, said) = play(Step::Limits, &begin);
    assert!(matches!(found.verdict, Verdict::Failed(_)), "{found:?}");
    // The way was not free: nothing moves after the question.
    assert_eq!(said.last().unwrap(), "ClearWay", "{said:#?}");
    let (_, said) = play(Step::Limits, &[&begin[..], &[(Asked::ClearWay, Choice::Yes)]].concat());
    let cleared = said.iter().position(|one| one == "ClearWay").unwrap();
    assert!(said[cleared + 1].starts_with("linear stage moves"));
    assert!(!said.iter().any(|one| one.contains("contradicts")), "{said:#?}");
}

/// The ends are where the rig file says, and the lower switch is pressed by a hand.
#[test]
fn a_drive_that_reports_a_step_beside_a_pressed_switch_is_not_believed_to_have_been_stopped() {
    let ends = [Asked::AtLimit; 12].map(|asked| (asked, Choice::Yes));
    let begin = [&[(Asked::NoSample, Choice::Yes)][..], &ends[..3]].concat();
    let switch = [(Asked::HoldSwitch, Choice::Yes)];
    let nothing = [(Asked::ProbeWent, Choice::Nowhere); 2];
    let (found, said) = play(Step::Limits, &[&begin[..], &switch, &nothing].concat());
    let Verdict::Failed(why) = &found.verdict else { panic!("{found:?} {said:#?}") };
    let told = "the drive reported a step downwards, and none was seen, while the lower limit";
    assert!(why.starts_with(told), "{why} {said:#?}");
}

/// The axes have been brought below their soft limit by hand, or it was set higher since.
#[test]
fn a_step_that_was_refused_is_not_taken_for_one_that_the_pressed_switch_stopped() {
    let ends = [Asked::AtLimit; 3].map(|asked| (asked, Choice::Yes));
    let begin = [&[(Asked::NoSample, Choice::Yes)][..], &ends].concat();
    let switch = [(Asked::HoldSwitch, Choice::Yes)];
    let nothing = [(Asked::ProbeWent, Choice::Nowhere); 2];
    let bench = Scripted {
        at: [24.0, 0.0],
        lowest: Some(26.4),
        ..scripted(&[&begin[..], &switch, &nothing].concat())
    };
    let (found, said) = play_on(Step::Limits, RIG, bench);
    let Verdict::Failed(why) = &found.verdict else { panic!("{found:?} {said:#?}") };
    assert!(why.starts_with("linear stage: it would lead down to 26."), "{why} {said:#?}");
    assert!(!said.iter().any(|one| one == "ProbeWent"), "{said:#?}");
}

#[test]
fn a_step_that_was_refused_is_not_taken_for_an_axis_that_the_stop_kept_still() {
    let answers = [
        (Asked::NoSample, Choice::Yes),
        (Asked::PressStop, Choice::Yes),
        (Asked::ProbeWent, Choice::Nowhere),
        (Asked::ProbeWent, Choice::Nowhere),
    ];
    let bench = Scripted { lowest: Some(25.1), ..scripted(&answers) };
    let (found, said) = play_on(Step::Stop, RIG, bench);
    let Verdict::Failed(why) = &found.verdict else { panic!("{found:?} {said:#?}") };
    assert!(why.starts_with("linear stage: it would lead down to"), "{why} {said:#?}");
}

/// The middle of the travel may be below the lower one of them.
#[test]
fn an_axis_is_freed_towards_the_middle_of_its_soft_limits() {
    let bench = Scripted { at: [26.0, 0.0], ..scripted(&[(Asked::NoSample, Choice::Yes)]) };
    let (_, said) = play_on(Step::Limits, RIG, bench);
    assert_eq!(said[1], "linear stage moves 0.5", "{said:#?}");
}

#[test]
fn a_stop_that_is_not_pressed_yet_is_asked_for_again_and_nothing_moves() {
    let begin = [(Asked::NoSample, Choice::Yes), (Asked::PressStop, Choice::No)];
    let (_, said) = play(Step::Stop, &[&begin[..], &[(Asked::PressStop, Choice::Yes)]].concat());
    let asked = "PressStop";
    assert_eq!(said[..4], ["NoSample", asked, "Nothing moves before it is done.", asked]);
    assert!(said[4].starts_with("linear stage moves"));
    let (found, said) = play(Step::Stop, &begin);
    assert!(matches!(found.verdict, Verdict::Failed(_)), "{found:?}");
    assert_eq!(said.iter().filter(|one| *one == asked).count(), TIMES);
}

/// Plays a homing of drives that forget their places.
fn play_homing(rig: &str) -> Vec<String> {
    let cycles = [(Asked::PowerCycle, Choice::Yes); 3];
    let begin = [(Asked::NoSample, Choice::Yes), (Asked::SetIndicators, Choice::Yes)];
    let away = [(Asked::TableAway, Choice::Yes)];
    let answers = if rig == RIG {
        [&begin[..], &cycles, &away, &cycles[..2]].concat()
    } else {
        [&begin[..], &cycles].concat()
    };
    let bench = Scripted { is_forgetting: true, ..scripted(&answers) };
    let (found, said) = play_on(Step::Homing, rig, bench);
    assert_eq!(found.verdict, Verdict::Accepted, "{said:#?}");
    said
}

#[test]
fn a_stage_that_homes_downwards_homes_with_the_table_away_and_stands_still_before() {
    let said = play_homing(RIG);
    let index = |what: &str| said.iter().position(|one| one == what).unwrap();
    let (set, away) = (index("SetIndicators"), index("TableAway"));
    let (before, after) = (&said[set..away], &said[away..]);
    let count = |said: &[String], what: &str| {
        said.iter().filter(|one| one.split(" moves").next() == Some(what)).count()
    };
    for of_linear in ["linear stage", "HomeDown", "Home(Linear)", "Indicator"] {
        assert_eq!(count(before, of_linear), 0, "{of_linear}");
    }
    for of_rotary in ["rotary stage", "Home(Rotary)", "EdgeIndicator"] {
        assert_eq!(count(after, of_rotary), 0, "{of_rotary}");
    }
    assert_eq!((count(before, "Home(Rotary)"), count(after, "HomeDown")), (10, 10));
    assert_eq!((count(before, "EdgeIndicator"), count(after, "Indicator")), (10, 10));
}

#[test]
fn a_stage_with_an_absolute_encoder_leaves_the_table_with_its_indicator() {
    let cycles = [(Asked::PowerCycle, Choice::Yes); 5];
    let begin = [(Asked::NoSample, Choice::Yes), (Asked::SetIndicators, Choice::Yes)];
    let (found, said) = play(Step::Homing, &[&begin[..], &cycles].concat());
    assert_eq!(found.verdict, Verdict::Accepted, "{said:#?}");
    assert!(!said.iter().any(|one| one == "TableAway" || one.contains("Home")), "{said:#?}");
}

#[test]
fn a_stage_that_homes_upwards_leaves_the_table_with_its_indicator() {
    let upwards = RIG.replacen("# homes = \"up\"", "homes = \"up\"", 1);
    assert_ne!(upwards, RIG);
    let said = play_homing(&upwards);
    let count = |what: &str| said.iter().filter(|one| *one == what).count();
    assert_eq!((count("TableAway"), count("HomeDown")), (0, 0));
    assert_eq!((count("Home(Linear)"), count("Home(Rotary)")), (10, 10));
    let told = Order::Home(JogAxis::Linear).to_string();
    assert!(told.contains("upwards") && !told.contains("Table"), "{told}");
}

/// Heights of the probe at which a step has stood, from where it began.
fn heights(said: &[String], begin: f64) -> Vec<f64> {
    let mut at = begin;
    let moved = said.iter().filter_map(|one| one.strip_prefix("linear stage moves "));
    moved
        .map(|by| {
            at += by.parse::<f64>().unwrap();
            at
        })
        .collect()
}

#[test]
fn a_scale_goes_up_where_there_is_room_and_never_below_surface_and_soft_limit() {
    let low = RIG.replacen("soft_limits_mm = [8, 45]", "soft_limits_mm = [8, 34]", 1);
    for (rig, begin, range) in
        [(RIG, 24.0, Some(23.0..=45.0)), (RIG, 40.0, Some(10.0..=41.0)), (&low, 24.0, None)]
    {
        let bench = Scripted { at: [begin, 0.0], dial: |_, way| way, ..scripted(&GAUGED) };
        let (found, said) = play_on(Step::Scale, rig, bench);
        let heights = heights(&said, begin);
        if let Some(range) = range {
            assert_eq!(found.verdict, Verdict::Accepted, "{begin}");
            assert!(heights.iter().all(|at| range.contains(at)), "{begin}: {heights:?}");
        } else {
            let Verdict::Failed(why) = found.verdict else { panic!("{found:?}") };
            assert!(why.starts_with("the linear stage stands at") && heights.is_empty(), "{why}");
        }
    }
}

/// Lengths that a person measures with the probe at 25 mm, where the rig file has a gap of 15 mm, 4 mm and 0.3 mm.
fn measured(gap: f64, above: f64, beside: f64) -> Finding {
    let readings =
        vec![(Asked::Gap, gap), (Asked::AbovePivot, above), (Asked::BesidePivot, beside)];
    play_on(Step::Geometry, RIG, Scripted { readings, ..scripted(&[]) }).0
}

#[test]
fn errors_of_the_geometry_that_add_up_at_a_tilt_are_not_accepted() {
    let keys = |finding: Finding| match finding.verdict {
        Verdict::RigFile(changes) => changes.iter().map(|change| change.key).collect(),
        Verdict::Accepted => Vec::new(),
        Verdict::Failed(why) => panic!("{why}"),
    };
    let (above, beside) = ("geometry.surface_above_pivot_mm", "geometry.probe_beside_pivot_mm");
    assert_eq!(keys(measured(15.0, 4.0, 0.3)), Vec::<&str>::new());
    assert_eq!(keys(measured(15.1, 4.1, 0.2)), Vec::<&str>::new());
    // Each is below 0.5 mm. At 50° the height moves the surface by 0.22 mm, and the distance by 0.48 mm.
    assert_eq!(keys(measured(15.0, 4.0, 0.7)), [beside]);
    assert_eq!(keys(measured(14.9, 4.4, -0.1)), [above, beside]);
    assert_eq!(keys(measured(15.4, 4.0, 0.3)), ["linear.zero_mm"]);
}

/// A person who sets the gauge to zero whenever it is asked for.
const GAUGED: [(Asked, Choice); 41] = {
    let mut answers = [(Asked::DialZero, Choice::Yes); 41];
    answers[0].0 = Asked::NoSample;
    answers
};

#[test]
fn one_slip_with_the_gauge_is_no_scale_and_the_same_result_twice_is_one() {
    type Dial = fn(usize, f64) -> f64;
    // The gauge does not touch in the first three steps.
    let slips: Dial = |index, way| if index < 3 { 0.01 } else { way };
    let triple: Dial = |_, way| 3.0 * way;
    for (dial, expected) in [(slips, None), (triple, Some(0.003))] {
        let bench = Scripted { dial, ..scripted(&GAUGED) };
        let (found, said) = play_on(Step::Scale, RIG, bench);
        let count = |what: &str| said.iter().filter(|one| *one == what).count();
        // A question before each step, and a step for each reading.
        assert_eq!((count("DialZero"), count("Dial")), (6, 6), "{said:#?}");
        let change = match &found.verdict {
            Verdict::RigFile(changes) => Some(changes[0].to),
            Verdict::Failed(why) => {
                assert!(why.contains("0.05 times") && why.contains("1.00 times"), "{why}");
                None
            }
            Verdict::Accepted => panic!("{said:#?}"),
        };
        assert_eq!(change, expected);
    }
}

#[test]
fn no_step_is_made_before_the_gauge_reads_zero() {
    let (found, said) = play(Step::Scale, &GAUGED[..1]);
    assert!(matches!(found.verdict, Verdict::Failed(_)), "{found:?}");
    assert!(!said.iter().any(|one| one == "Dial"), "{said:#?}");
}

#[test]
fn a_rotary_stage_without_a_scale_leaves_the_change_of_the_linear_one() {
    let bench = Scripted { dial: |_, way| 1.02 * way, is_tilting: false, ..scripted(&GAUGED) };
    let (found, said) = play_on(Step::Scale, RIG, bench);
    let Verdict::RigFile(changes) = &found.verdict else { panic!("{found:?}") };
    assert_eq!((changes[0].key, changes[0].to), ("linear.mm_per_step", 0.00102));
    assert!(said.iter().any(|one| one.starts_with("the drive of the rotary stage")), "{said:#?}");
}

#[test]
fn limits_are_not_sought_with_soft_limits_that_a_drive_has_inside_the_travel() {
    let (wide, far) = ([-1.0, 51.0], [-65.0, 65.0]);
    for (soft, told) in [
        ([Some([8.0, 45.0]), None], Some("linear stage has soft limits at 8.000 mm and 45.000 mm")),
        (
            [Some(wide), Some([-50.0, 65.0])],
            Some("rotary stage has soft limits at -50.000 ° and 65.000 °"),
        ),
        ([Some([8.0, 51.0]), Some(far)], None),
        ([None, None], None),
    ] {
        let bench = Scripted { soft, ..scripted(&[(Asked::NoSample, Choice::Yes)]) };
        let (found, said) = play_on(Step::Limits, RIG, bench);
        let Verdict::Failed(why) = &found.verdict else { panic!("{found:?}") };
        let is_refused = !said.iter().any(|one| one.contains("moves"));
        assert_eq!(is_refused, told.is_some(), "{why}");
        assert!(told.is_none_or(|told| why.contains(told)), "{why}");
    }
}

#[test]
fn no_step_that_rests_on_positions_believes_a_drive_that_has_lost_its_zero() {
    for (step, is_homed) in [Step::Scale, Step::Limits, Step::Homing]
        .into_iter()
        .flat_map(|step| [[false, true], [true, false]].map(|is_homed| (step, is_homed)))
    {
        let bench = Scripted { is_homed, ..scripted(&GAUGED) };
        let (found, said) = play_on(step, RIG, bench);
        let Verdict::Failed(why) = &found.verdict else { panic!("{step:?} {is_homed:?}") };
        let axis = if is_homed[0] { "rotary stage" } else { "linear stage" };
        assert!(why.starts_with(&format!("{axis}: its drive says that it does not know")), "{why}");
        let moved = format!("{axis} moves");
        assert!(!said.iter().any(|one| one.starts_with(&moved)), "{said:#?}");
    }
    let readings = vec![(Asked::Gap, 15.0), (Asked::AbovePivot, 4.0), (Asked::BesidePivot, 0.3)];
    for (answers, is_accepted) in [(&[(Asked::FindZero, Choice::Yes)][..], true), (&[], false)] {
        let readings = readings.clone();
        let bench = Scripted { readings, is_homed: [true, false], ..scripted(answers) };
        let (found, said) = play_on(Step::Geometry, RIG, bench);
        assert_eq!(found.verdict == Verdict::Accepted, is_accepted, "{said:#?}");
    }
}
