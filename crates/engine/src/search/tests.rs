use rig_model::RigTime;

use super::*;

const APPROACH: Approach = Approach {
    start_above_mm: 0.4,
    give_up_below_mm: 0.6,
    coarse_step_mm: 0.1,
    fine_step_mm: 0.005,
    contact_threshold: 0.1,
    settle_s: 0.1,
    cycles: 10,
    slip_mm: 0.05,
    descent_mm_per_s: None,
    slow_descent_mm_per_s: None,
};

fn impedance(resistance_ohm: f64) -> Impedance {
    Impedance { resistance_ohm, reactance_ohm: -1000.0 }
}

fn reading(resistance_ohm: f64) -> Reading {
    Reading {
        frequency_hz: 140.0,
        measured: PointResult::Value(impedance(resistance_ohm)),
        started: RigTime::ZERO,
        settle_s: 0.1,
        integration_s: 0.07,
    }
}

/// Plays a search against a surface; the stage stops `backlash_mm` short when it comes down
/// directly after going up.
fn search(surface_mm: f64, backlash_mm: f64) -> (SearchStep, usize) {
    let begun = Search::begin(APPROACH, Position::new(20.0), impedance(1000.0));
    play(begun, surface_mm, backlash_mm)
}

/// The same, begun this far above where the surface is expected from the touches before.
fn search_near(surface_mm: f64, way_mm: f64, expected_mm: f64) -> (SearchStep, usize) {
    let near = near(expected_mm, way_mm);
    let begun = Search::begin_near(APPROACH, Position::new(20.0), impedance(1000.0), near);
    play(begun, surface_mm, 0.02)
}

fn near(expected_mm: f64, way_mm: f64) -> Near {
    let surface = Position::new(expected_mm);
    let sigma_mm = 0.25 * way_mm;
    Near { start: surface.offset(way_mm), surface, sigma_mm, highest: Position::new(20.4) }
}

fn play(
    (mut search, mut step): (Search, SearchStep),
    surface_mm: f64,
    backlash_mm: f64,
) -> (SearchStep, usize) {
    let (mut there, mut slack) = (f64::MAX, 0.0);
    for _ in 0..200 {
        step = match step {
            SearchStep::MoveTo(target) => {
                assert!(Search::floor(&search.approach, search.expected) <= target, "{target}");
                slack = if target.value() > there { backlash_mm } else { slack };
                let moved_down = (there - target.value()).max(0.0);
                slack = f64::max(0.0, slack - moved_down);
                there = target.value();
                search.arrived(target)
            }
            SearchStep::Read { .. } => {
                let is_touching = there + slack <= surface_mm;
                search.read(reading(if is_touching { 1500.0 } else { 1010.0 }))
            }
            end => return (end, search.trail.len()),
        };
    }
    panic!("the search did not end");
}

#[test]
fn the_surface_is_bracketed_to_the_finest_step_wherever_it_is() {
    for tenth_of_micron in (-5900..3900).step_by(37) {
        let surface = 20.0 + f64::from(tenth_of_micron) * 1e-4;
        let (end, readings) = search(surface, 0.02);
        let SearchStep::Found(found) = end else { panic!("{surface}: {end:?}") };
        let error = found.position.value() - surface;
        assert!(error.abs() <= 0.0025 + 1e-9, "{surface}: {error}");
        assert!((found.sigma_mm - 0.005 / 12.0_f64.sqrt()).abs() < 1e-9);
        assert!(readings <= 32, "{surface}: {readings} readings");
    }
}

/// The floor is no multiple of the steps.
#[test]
fn a_surface_just_above_the_floor_is_found_and_nothing_goes_below() {
    let approach = Approach { give_up_below_mm: 0.6034, ..APPROACH };
    for tenth_of_micron in (-6033..-5900).step_by(3) {
        let surface = 20.0 + f64::from(tenth_of_micron) * 1e-4;
        let begun = Search::begin(approach, Position::new(20.0), impedance(1000.0));
        let (end, _) = play(begun, surface, 0.02);
        let SearchStep::Found(found) = end else { panic!("{surface}: {end:?}") };
        let error = found.position.value() - surface;
        assert!(error.abs() <= 0.0025 + 1e-9, "{surface}: {error}");
    }
}

#[test]
fn a_search_close_above_the_surface_finds_it_wherever_it_is() {
    for (way_mm, most) in [(0.05, 14), (0.3, 26)] {
        for tenth_of_micron in (-5800..3900).step_by(37) {
            let surface = 20.0 + f64::from(tenth_of_micron) * 1e-4;
            for expected in [surface, 20.0] {
                let (end, readings) = search_near(surface, way_mm, expected);
                let SearchStep::Found(found) = end else { panic!("{surface}: {end:?}") };
                let error = found.position.value() - surface;
                assert!(error.abs() <= 0.0025 + 1e-9, "{surface}, {expected}: {error}");
                let most = if expected == surface { most } else { 60 };
                assert!(readings <= most, "{surface}, {expected}: {readings} readings");
            }
        }
    }
}

#[test]
fn a_change_that_comes_over_several_steps_is_doubted_once() {
    for (step_ohm, has_crept) in [(21.0, true), (120.0, false)] {
        let (mut search, _) = Search::begin(APPROACH, Position::new(20.0), impedance(1000.0));
        let mut next = Position::new(20.4);
        for step in 0..10 {
            search.arrived(next);
            let now = reading(1000.0 + step_ohm * f64::from(step));
            if search.seems_to_touch(&[now]) {
                assert_eq!(search.has_crept(&[now]), has_crept, "{step_ohm} ohm a step");
                search.doubt();
            }
            let SearchStep::MoveTo(to) = search.read(now) else { panic!("{step_ohm}") };
            if search.is_anew() {
                assert!(search.here < to, "{to}");
                search.arrived(to);
                search.read(now);
                assert!(!search.has_crept(&[now]), "a second time");
                break;
            }
            next = to;
        }
        assert!(search.again.left < ANEW_MAX, "{step_ohm} ohm a step: no doubt");
    }
}

#[test]
fn a_search_that_begins_in_contact_goes_up_at_once_and_begins_where_no_surface_can_be() {
    let near = near(19.9, 0.05);
    let (mut search, step) =
        Search::begin_near(APPROACH, Position::new(20.0), impedance(1000.0), near);
    assert_eq!(step, SearchStep::MoveTo(near.highest));
    assert_eq!(search.arrived(near.highest), SearchStep::MoveTo(near.start));
    assert_eq!(search.arrived(near.start), SearchStep::Read { is_after_contact: false });
    let up = Position::new(20.4);
    assert_eq!(search.read(reading(1500.0)), SearchStep::MoveTo(up));
    assert_eq!(search.arrived(up), SearchStep::Read { is_after_contact: true });
    // A contact there too does not show a surface.
    let end = search.read(reading(1500.0));
    assert!(matches!(end, SearchStep::Fault(Fault::ContactTooEarly { .. })), "{end:?}");
}

#[test]
fn a_reading_that_is_flagged_or_cannot_be_compared_never_lets_the_probe_go_on() {
    let begin = |baseline| {
        let (mut search, _) = Search::begin(APPROACH, Position::new(20.0), baseline);
        search.arrived(Position::new(20.4));
        search
    };
    let mut search = begin(impedance(1000.0));
    for measured in [PointResult::Overload, PointResult::LowSignal(impedance(1000.0))] {
        let flagged = Reading { measured, ..reading(1000.0) };
        assert_eq!(search.read(flagged), SearchStep::Flagged);
    }
    assert!(matches!(search.read(reading(1000.0)), SearchStep::MoveTo(_)));
    assert_eq!(search.trail().len(), 3);
    let nothing = Impedance { resistance_ohm: 0.0, reactance_ohm: 0.0 };
    let shorted = Reading { measured: PointResult::Value(nothing), ..reading(1000.0) };
    let step = begin(nothing).read(shorted);
    assert!(matches!(step, SearchStep::Fault(Fault::ContactTooEarly { .. })), "{step:?}");
}

/// Its steps are as short as its accuracy, so that its drive says each time that it has arrived.
#[test]
fn a_stage_that_goes_no_lower_ends_the_search() {
    let (mut search, mut step) = Search::begin(APPROACH, Position::new(20.0), impedance(1000.0));
    for _ in 0..5 {
        assert!(matches!(step, SearchStep::MoveTo(_)), "{step:?}");
        search.arrived(Position::new(20.4));
        step = search.read(reading(1010.0));
    }
    let SearchStep::Fault(fault) = step else { panic!("{step:?}") };
    assert_eq!(
        fault.to_string(),
        "linear stage: it was asked 4 times in a row to go down by 0.1 mm and stays at 20.400 mm"
    );
}

#[test]
fn a_surface_beyond_the_range_is_a_fault_and_the_depth_stays_limited() {
    let (end, _) = search(20.41, 0.0);
    assert!(matches!(end, SearchStep::Fault(Fault::ContactTooEarly { .. })), "{end:?}");
    let (end, _) = search(19.39, 0.0);
    let SearchStep::Fault(fault) = end else { panic!("{end:?}") };
    assert_eq!(
        fault.to_string(),
        "no contact down to 19.400 mm; the surface was expected at 20.000 mm"
    );
}
