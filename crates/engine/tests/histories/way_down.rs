//! Benches whose surface lies higher than the rig file says, and whose probe comes down for the first time.

use rig_engine::{Event, Fault, RunStatus};
use rig_model::Clearance;

use crate::world::{SURFACE_MM, World, plan};

/// The largest indentation of this bench, mm.
const MAX_INDENTATION_MM: f64 = 0.6;

#[test]
fn a_surface_above_the_beginning_of_the_search_is_pressed_by_half_of_the_largest_indentation_at_most()
 {
    for descent_mm_per_s in [None, Some(0.5)] {
        for tenth_of_mm in 5..40 {
            let higher_mm = 0.1 * f64::from(tenth_of_mm) + 0.013;
            let mut world = World::new(None);
            world.slip_mm = -higher_mm;
            let mut plan = plan();
            plan.touch.approach.descent_mm_per_s = descent_mm_per_s;
            world.play_plan(&plan);
            assert_eq!(world.endings(), [RunStatus::Faulted], "{higher_mm} mm higher");
            assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
            let at = world.events.iter().find_map(|event| match event {
                Event::Faulted { fault: Fault::ContactTooEarly { at, .. }, .. } => Some(at.value()),
                _ => None,
            });
            let pressed_mm = SURFACE_MM + higher_mm - at.unwrap();
            assert!(
                (-1e-9..0.5 * MAX_INDENTATION_MM + 1e-9).contains(&pressed_mm),
                "{higher_mm} mm higher: pressed by {pressed_mm} mm"
            );
        }
    }
}
