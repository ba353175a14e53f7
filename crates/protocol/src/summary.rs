//! What a plan will cost, before it is run.

use rig_model::{Bench, Deg, Mm, Position, Span, SweepMethod, SweepRequest};

use crate::{Action, Plan, Pose, Touch, TouchSettings};

/// The extent of a plan on a bench.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Touches, of both phases.
    pub touches: usize,
    /// No-load measurements.
    pub no_loads: usize,
    /// How often a person is asked for something.
    pub prompts: usize,
    /// Expected time on the rig's clock, without the time that the person takes, in s.
    pub duration_s: f64,
    /// The lowest position that a touch may ask for, and the clear position.
    pub linear: Span<Mm>,
    /// The extreme positions of the rotary stage.
    pub rotary: Span<Deg>,
}

/// How good the resonance of a sensor is assumed to be, for the time it rings.
const ASSUMED_Q: f64 = 30.0;

/// The first reading of a touch waits for this many time constants of the ring.
const BASELINE_TIME_CONSTANTS: f64 = 8.0;

/// An adaptive sweep takes about this many points, each with its settling and its cycles.
const ADAPTIVE_POINTS: f64 = 10.0;

/// Each pass of the search for the surface is finer than the one before it by this factor.
const REFINEMENT: f64 = 5.0;

impl Plan {
    /// The extent of the plan on this bench.
    ///
    /// The duration of a touch is the sum of its moves at the speeds of the bench, of the readings
    /// of a search that finds the surface where it is expected, of the dwell, and of the sweep:
    ///
    /// ```text
    /// rotate    Δ°/rotary speed
    /// lower     (clear − start)/travel speed, and the same to retract
    /// search    (start above/coarse step + 1 + 3 readings for each finer pass)
    ///           · (settle + cycles/f), and the way at contact speed
    /// sweep     points · (settle + cycles/f) in the middle of its window
    /// ```
    ///
    /// What the instruments take besides, as for their buses and for accelerating, is not in it.
    pub fn summary(&self, bench: &Bench) -> Summary {
        let (mut touches, mut no_loads, mut prompts) = (0, 0, 0);
        let mut duration_s = 0.0;
        let mut linear = Span {
            min: bench.linear.rest_target().position(),
            max: bench.linear.rest_target().position(),
        };
        let level = bench.rotary.rest_target().position();
        let mut rotary = Span { min: level, max: level };
        let mut here = level;
        for step in &self.steps {
            match step.action {
                Action::Prompt(_) => prompts += 1,
                Action::NoLoad(pose) => {
                    no_loads += 1;
                    duration_s += rotation_s(bench, &mut here, pose) + sweep_s(&self.no_load_sweep);
                }
                Action::Touch(Touch { pose, .. }) => {
                    touches += 1;
                    duration_s += rotation_s(bench, &mut here, pose) + self.touch_s(bench, pose);
                    let floor = self.touch.floor(bench, pose);
                    linear.min = if floor < linear.min { floor } else { linear.min };
                }
            }
            rotary.min = if here < rotary.min { here } else { rotary.min };
            rotary.max = if here > rotary.max { here } else { rotary.max };
        }
        Summary { touches, no_loads, prompts, duration_s, linear, rotary }
    }

    fn touch_s(&self, bench: &Bench, pose: Pose) -> f64 {
        let speeds = &bench.limits;
        let approach = &self.touch.approach;
        let frequency_hz = middle_hz(&self.no_load_sweep);

        let start = self.touch.start(bench, pose);
        let clear = bench.linear.rest_target().position();
        let travel_s = 2.0 * (clear.value() - start.value()) / speeds.travel_speed_mm_per_s;

        let baseline_s =
            BASELINE_TIME_CONSTANTS * ASSUMED_Q / (std::f64::consts::PI * frequency_hz);
        let ratio = approach.coarse_step_mm / approach.fine_step_mm;
        let passes = (ratio.ln() / REFINEMENT.ln()).ceil();
        let readings = approach.start_above_mm / approach.coarse_step_mm
            + 1.0
            + passes * 0.5 * (REFINEMENT + 1.0);
        let reading_s = approach.settle_s + f64::from(approach.cycles) / frequency_hz;
        // Each finer pass begins a coarse step higher, to take up the backlash.
        let way_mm = approach.start_above_mm
            + passes * 2.0 * approach.coarse_step_mm
            + self.touch.indentation_mm;
        let search_s = readings * reading_s + way_mm / speeds.contact_speed_mm_per_s;

        travel_s + baseline_s + search_s + self.touch.dwell_s + sweep_s(&self.contact_sweep)
    }
}

impl TouchSettings {
    /// Where the search for the surface begins at a pose.
    pub(crate) fn start(&self, bench: &Bench, pose: Pose) -> Position<Mm> {
        let surface = bench.geometry.surface_at(pose.direction, pose.angle);
        surface.offset(self.approach.start_above_mm)
    }

    /// The lowest position that a touch at a pose may ask for.
    pub(crate) fn floor(&self, bench: &Bench, pose: Pose) -> Position<Mm> {
        let surface = bench.geometry.surface_at(pose.direction, pose.angle);
        surface.offset(-self.approach.give_up_below_mm - self.indentation_mm)
    }
}

fn rotation_s(bench: &Bench, here: &mut Position<Deg>, pose: Pose) -> f64 {
    let there = pose.direction.rotary_position(pose.angle);
    let way_deg = (there.value() - here.value()).abs();
    *here = there;
    way_deg / bench.limits.rotary_speed_deg_per_s
}

fn sweep_s(sweep: &SweepRequest) -> f64 {
    let points = match sweep.method {
        SweepMethod::Adaptive => ADAPTIVE_POINTS,
        SweepMethod::Uniform { points } => f64::from(points),
    };
    let planned_s = points * (sweep.settle_s + f64::from(sweep.cycles) / middle_hz(sweep));
    planned_s.min(sweep.time_limit_s)
}

fn middle_hz(sweep: &SweepRequest) -> f64 {
    0.5 * (sweep.window.min_hz + sweep.window.max_hz)
}
