//! Runs whose surfaces are found by descents, with every trouble in every operation and within the stream.

use rig_engine::{DescentEnd, Event, RigState, RunStatus};
use rig_model::Clearance;
use rig_protocol::Plan;

use crate::{
    streams::StreamTrouble,
    world::{OF_ONE_OPERATION, SURFACE_MM, Trouble, World, plan},
};

const IN_STREAM: [StreamTrouble; 9] = [
    StreamTrouble::Stop,
    StreamTrouble::Abort,
    StreamTrouble::Silent,
    StreamTrouble::BreaksOff,
    StreamTrouble::HeldUp,
    StreamTrouble::Flagged,
    StreamTrouble::Stuck,
    StreamTrouble::Blind,
    StreamTrouble::Ghost,
];

impl World {
    fn descents(&self) -> impl Iterator<Item = DescentEnd> {
        self.events.iter().filter_map(|event| match event {
            Event::Descended(descended) => Some(descended.end),
            _ => None,
        })
    }
}

fn descending() -> Plan {
    let mut plan = plan();
    plan.touch.approach.descent_mm_per_s = Some(0.5);
    // One touch has all operations of a descent.
    plan.steps.truncate(3);
    plan
}

/// Clear at the end, or latched; an end of the run once, as soon as it had begun.
fn judge(world: &World, what: &str) {
    let snapshot = world.engine.snapshot();
    let is_out = snapshot.clearance == Clearance::Clear || snapshot.state == RigState::Latched;
    assert!(is_out, "{what}: {snapshot:?}");
    assert!(world.endings().len() <= 1, "{what}: {:?}", world.endings());
    // Never deeper than the search in steps may go.
    for event in &world.events {
        if let Event::Descended(descended) = event {
            assert!(SURFACE_MM - 0.71 < descended.read_back.value(), "{what}: {descended:?}");
        }
    }
}

/// The contact of this world does not ring, so that no onset fits it: the search in steps follows, and its
/// surface is that of a run without descents.
#[test]
fn a_descent_stops_at_the_contact_and_the_search_in_steps_takes_over_where_no_onset_fits() {
    let mut world = World::new(None);
    world.play_plan(&descending());
    assert_eq!(world.endings(), [RunStatus::Completed], "{:#?}", world.events);
    let ends: Vec<DescentEnd> = world.descents().collect();
    assert_eq!(ends, [DescentEnd::Contact]);
    let depth_mm = |event: &Event| match event {
        Event::Descended(descended) => Some(SURFACE_MM - descended.read_back.value()),
        _ => None,
    };
    let deepest_mm = world.events.iter().filter_map(depth_mm).fold(f64::MIN, f64::max);
    assert!((0.0..0.03).contains(&deepest_mm), "{deepest_mm} mm");
    let found = world.events.iter().filter(|event| matches!(event, Event::SurfaceFound { .. }));
    assert_eq!(found.count(), 1);
}

#[test]
fn a_descent_with_trouble_in_any_operation_ends_clear_or_latched() {
    let mut undisturbed = World::new(None);
    undisturbed.play_plan(&descending());
    let mut latched = 0;
    for at in 0..undisturbed.operations {
        for trouble in OF_ONE_OPERATION.into_iter().chain([Trouble::Freezes, Trouble::HoldUp(0)]) {
            let mut world = World::new(Some((at, trouble)));
            world.play_plan(&descending());
            judge(&world, &format!("{trouble:?} in operation {at}"));
            latched += usize::from(world.engine.snapshot().state == RigState::Latched);
        }
    }
    assert!(latched > 50, "{latched}");
}

#[test]
fn a_stream_with_trouble_at_any_reading_ends_the_descent() {
    let mut ends = std::collections::BTreeMap::new();
    for trouble in IN_STREAM {
        for at in 0..28 {
            let mut world = World::new(None);
            world.streams.trouble = Some((at, trouble));
            world.play_plan(&descending());
            let what = format!("{trouble:?} at reading {at}");
            judge(&world, &what);
            let first = world.descents().next();
            *ends.entry((format!("{trouble:?}"), first.map(DescentEnd::name))).or_insert(0) += 1;
            let is_stopped = world.endings() != [RunStatus::Completed];
            let should_stop = match trouble {
                StreamTrouble::Stop | StreamTrouble::Abort => Some(first.is_none()),
                // The contact comes before the last readings.
                StreamTrouble::Stuck | StreamTrouble::Blind => None,
                _ => Some(false),
            };
            assert!(
                should_stop.is_none_or(|should| should == is_stopped),
                "{what}: {:#?}",
                world.endings()
            );
        }
    }
    for (trouble, end) in [
        ("Silent", "late"),
        ("HeldUp", "held_up"),
        ("BreaksOff", "broken_off"),
        ("Flagged", "flagged"),
        ("Stuck", "frozen"),
        ("Ghost", "contact"),
        ("Blind", "target"),
    ] {
        assert!(ends.contains_key(&(trouble.to_owned(), Some(end))), "{trouble}: {ends:?}");
    }
}
