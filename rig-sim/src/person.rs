//! The person at the bench, who says what is to be seen there, and sometimes says what is not so.
//!
//! The person looks with the eyes, with a dial gauge at the probe, with an angle gauge on the table and
//! with a rule: none of them knows a drive or a rig file.

use rig_model::random::Stream;

use crate::{
    faults::DeviceFault,
    shell::SimHandle,
    wiring::PortId,
    world::{AxisId, PersonScene},
};

/// The name of the stream of chance; those of the world and of the faults are below it.
const ANSWERS: u64 = 200;

/// The smallest motion that a person sees beside the probe, mm, and at the edge of the table, degrees.
const SEEN_MM: f64 = 0.005;
const SEEN_DEG: f64 = 0.05;

/// Steps of the scales that are read: a dial gauge and a rule, mm; an angle gauge, degrees.
const DIAL_MM: f64 = 0.01;
const RULE_MM: f64 = 0.1;
const GAUGE_DEG: f64 = 0.1;

/// A test indicator: its division, the end of its scale, and one turn of it, by which it is misread, mm.
const INDICATOR_MM: f64 = 0.001;
const INDICATOR_END_MM: f64 = 0.4;
const INDICATOR_TURN_MM: f64 = 0.2;

/// Where a test indicator stands at the table, mm from its axis.
const EDGE_MM: f64 = 20.0;

/// An axis this close to an end of its travel is seen to be stopped there, mm and degrees.
const AT_END: f64 = 0.3;

/// A misread scale is wrong by this: one turn of the dial, mm; a line of the angle gauge, degrees.
const MISREAD_MM: f64 = 1.0;
const MISREAD_DEG: f64 = 5.0;

/// What the probe did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProbeWent {
    /// Away from the table.
    Up,
    /// Towards the table.
    Down,
    /// Nowhere that the eye can see.
    Nowhere,
}

/// The edge of the table that sank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeSank {
    /// The edge on the side of the tip of the bimorph, which sinks at positive angles.
    Tip,
    /// The edge on the side of its clamp.
    Clamp,
    /// Neither that the eye can see.
    Neither,
}

/// The person, with the positions at the last look.
#[derive(Debug)]
pub struct Person {
    rig: SimHandle,
    scene: PersonScene,
    chance: Stream,
    tip_mm: f64,
    tilt_deg: f64,
    /// Height and tilt at which the test indicators were set to zero.
    indicators: (f64, f64),
}

impl Person {
    pub(crate) fn new(rig: SimHandle, seed: u64) -> Self {
        let scene = rig.with(|_, rig| rig.world().scene().person);
        let (tip_mm, tilt_deg) = places(&rig);
        Self {
            rig,
            scene,
            chance: Stream::new(seed, ANSWERS),
            tip_mm,
            tilt_deg,
            indicators: (tip_mm, tilt_deg),
        }
    }

    /// Looks at the bench and sets the dial gauge to zero; the answers are about the motion since then.
    pub fn look(&mut self) {
        (self.tip_mm, self.tilt_deg) = places(&self.rig);
    }

    /// What the probe did.
    pub fn probe_went(&mut self) -> ProbeWent {
        use ProbeWent::{Down, Nowhere, Up};
        let seen = sense(self.moved_mm(), SEEN_MM, [Down, Nowhere, Up]);
        self.or_another(seen, &[Up, Down, Nowhere])
    }

    /// The edge of the table that sank.
    pub fn edge_sank(&mut self) -> EdgeSank {
        use EdgeSank::{Clamp, Neither, Tip};
        let turned_deg = places(&self.rig).1 - self.tilt_deg;
        let seen = sense(turned_deg, SEEN_DEG, [Clamp, Neither, Tip]);
        self.or_another(seen, &[Tip, Clamp, Neither])
    }

    /// The reading of the dial gauge: how far the probe rose, mm.
    pub fn dial_mm(&mut self) -> f64 {
        let moved_mm = self.moved_mm();
        self.read(moved_mm, DIAL_MM, MISREAD_MM)
    }

    /// The reading of the angle gauge on the table: its tilt against the horizontal, degrees.
    pub fn gauge_deg(&mut self) -> f64 {
        let tilt_deg = places(&self.rig).1;
        self.read(tilt_deg, GAUGE_DEG, MISREAD_DEG)
    }

    /// The gap between the tip and the surface of a level sample of the usual thickness, by a rule, mm.
    pub fn gap_mm(&mut self) -> f64 {
        let surface_mm = self.rig.with(|_, rig| rig.world().scene().place.surface_mm);
        let gap_mm = places(&self.rig).0 - surface_mm;
        self.read(gap_mm, RULE_MM, MISREAD_MM)
    }

    /// The height of that surface above the rotary axis, by a rule, mm.
    pub fn surface_above_pivot_mm(&mut self) -> f64 {
        let place = self.rig.with(|_, rig| rig.world().scene().place);
        self.read(place.surface_above_pivot_mm, RULE_MM, MISREAD_MM)
    }

    /// The distance of the probe from the rotary axis towards the tip of the bimorph, by a rule, mm.
    pub fn probe_beside_pivot_mm(&mut self) -> f64 {
        let place = self.rig.with(|_, rig| rig.world().scene().place);
        self.read(place.probe_beside_pivot_mm, RULE_MM, MISREAD_MM)
    }

    /// Sets test indicators to zero, one at the carriage and one at the edge of the table.
    pub fn set_indicators(&mut self) {
        self.indicators = places(&self.rig);
    }

    /// The reading of the test indicator at the carriage, mm: how much higher it is than at zero.
    pub fn indicator_mm(&mut self) -> f64 {
        let moved_mm = places(&self.rig).0 - self.indicators.0;
        self.read_indicator(moved_mm)
    }

    /// The reading of the test indicator at the edge of the table, mm: how much lower it is than at zero.
    pub fn edge_indicator_mm(&mut self) -> f64 {
        let turned_deg = places(&self.rig).1 - self.indicators.1;
        self.read_indicator(EDGE_MM * turned_deg.to_radians())
    }

    /// Whether an axis stands at an end of its travel.
    pub fn is_at_limit(&mut self) -> bool {
        let is_at_end = self.rig.with(|now, rig| {
            let world = rig.world();
            [AxisId::Linear, AxisId::Rotary].into_iter().any(|axis| {
                let (at, (low, high)) = (world.stage(axis).load(now), world.travel(axis));
                (at - low).min(high - at) < AT_END
            })
        });
        is_at_end != self.is_wrong()
    }

    /// How far the carriage can go down, by a rule, mm.
    pub fn way_down_mm(&mut self) -> f64 {
        let low_mm = self.rig.with(|_, rig| rig.world().scene().linear.travel.0);
        let way_mm = places(&self.rig).0 - low_mm;
        self.read(way_mm, RULE_MM, MISREAD_MM)
    }

    /// Holds the lower limit switch of the linear stage pressed, or lets go of it.
    pub fn hold_lower_switch(&self, is_held: bool) {
        self.rig.with(|now, rig| rig.world().hold_lower_switch(now, is_held));
    }

    /// Takes the power from both drives, and gives it back.
    pub fn power_cycle_drives(&self) {
        self.rig.with(|now, rig| rig.apply_fault(now, PortId::Bus, None, DeviceFault::Reboot));
    }

    /// Homes both drives with their own program, and brings the axes back.
    pub fn home_drives(&self) {
        self.rig.with(|_, rig| rig.homed_by_person());
    }

    /// Presses the emergency stop, or releases it.
    pub fn press_stop(&self, is_pressed: bool) {
        self.rig.with(|now, rig| rig.world().press_stop(now, is_pressed));
    }

    fn moved_mm(&self) -> f64 {
        places(&self.rig).0 - self.tip_mm
    }

    fn is_wrong(&mut self) -> bool {
        self.chance.uniform() < self.scene.wrong_answers
    }

    fn or_another<T: Copy + PartialEq>(&mut self, seen: T, all: &[T]) -> T {
        if !self.is_wrong() {
            return seen;
        }
        let is_first = self.chance.uniform() < 0.5;
        let mut others = all.iter().copied().filter(|other| *other != seen);
        let first = others.next().unwrap_or(seen);
        if is_first { first } else { others.next().unwrap_or(first) }
    }

    fn read_indicator(&mut self, truth_mm: f64) -> f64 {
        let shown_mm = truth_mm.clamp(-INDICATOR_END_MM, INDICATOR_END_MM);
        self.read(shown_mm, INDICATOR_MM, INDICATOR_TURN_MM)
    }

    fn read(&mut self, truth: f64, step: f64, misread: f64) -> f64 {
        let wrong = if self.is_wrong() { misread } else { 0.0 };
        ((truth + wrong) / step).round() * step
    }
}

/// The true height of the tip, mm, and the true tilt, degrees.
fn places(rig: &SimHandle) -> (f64, f64) {
    rig.with(|now, rig| {
        let world = rig.world();
        (world.stage(AxisId::Linear).load(now), world.stage(AxisId::Rotary).load(now))
    })
}

fn sense<T: Copy>(moved: f64, seen: f64, [down, nowhere, up]: [T; 3]) -> T {
    if moved.abs() < seen {
        nowhere
    } else if moved < 0.0 {
        down
    } else {
        up
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::{
        LineTransport, PortId, SimRig, Wiring,
        scene::matched,
        world::{Assembly, Nuisances, Scene},
    };

    struct Bench {
        sim: SimHandle,
        person: Person,
        _rig: SimRig,
    }

    impl Bench {
        fn new(change: impl FnOnce(&mut Scene)) -> Self {
            let mut scene = Scene { nuisances: Nuisances::NONE, ..matched() };
            change(&mut scene);
            let rig = SimRig::start(scene, &Wiring::paper(LineTransport::Tcp), 1).unwrap();
            let sim = rig.handle();
            Self { person: sim.person(1), sim, _rig: rig }
        }

        /// Looks, and then has the drive of a unit go by this many counts.
        async fn turn(&mut self, unit: u8, counts: i32) {
            self.person.look();
            let data = [0, 2, counts, 10_000, 1_000_000, 1_000_000, 1000, 1];
            let mut frame = vec![unit, 16, 0, 0x58, 0, 16, 32];
            frame.extend(data.iter().flat_map(|value: &i32| value.to_be_bytes()));
            let length = u8::try_from(frame.len()).unwrap();
            let frame = [&[0, 1, 0, 0, 0, length], &*frame].concat();
            self.sim.with(|now, rig| {
                let mut port = rig.connect(PortId::Bus);
                rig.push(now, &mut port, &frame).unwrap();
            });
            tokio::time::advance(Duration::from_secs(5)).await;
        }
    }

    #[tokio::test(start_paused = true)]
    async fn the_person_sees_the_sense_of_each_axis_as_it_is() {
        for is_reversed in [false, true] {
            let mut bench = Bench::new(|scene| {
                let sense = if is_reversed { -1.0 } else { 1.0 };
                scene.linear.assembly.units_per_step = Some(sense * 0.001);
                scene.linear.assembly.zero = Some(40.0 * (1.0 - sense));
                scene.rotary.assembly.units_per_step = Some(sense * 0.01);
            });
            let (up, tip) = if is_reversed {
                (ProbeWent::Down, EdgeSank::Clamp)
            } else {
                (ProbeWent::Up, EdgeSank::Tip)
            };
            assert_eq!(bench.person.probe_went(), ProbeWent::Nowhere);
            bench.turn(1, 200).await;
            assert_eq!(
                (bench.person.probe_went(), bench.person.edge_sank()),
                (up, EdgeSank::Neither)
            );
            bench.turn(2, 100).await;
            assert_eq!(
                (bench.person.probe_went(), bench.person.edge_sank()),
                (ProbeWent::Nowhere, tip)
            );
        }
    }

    #[tokio::test(start_paused = true)]
    async fn gauges_read_the_true_way_and_the_true_tilt() {
        let mut bench = Bench::new(|scene| {
            scene.linear.assembly.units_per_step = Some(0.0011);
            scene.rotary.assembly = Assembly { units_per_step: Some(-0.005), zero: Some(0.8) };
            scene.rotary.start = 0.8;
            scene.place.surface_mm = 12.0;
            scene.place.surface_above_pivot_mm = 7.04;
            scene.place.probe_beside_pivot_mm = -1.26;
        });
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-9, "{found}");
        near(bench.person.gap_mm(), 28.0);
        near(bench.person.gauge_deg(), 0.8);
        near(bench.person.surface_above_pivot_mm(), 7.0);
        near(bench.person.probe_beside_pivot_mm(), -1.3);
        bench.turn(1, -2000).await;
        near(bench.person.dial_mm(), -2.2);
        near(bench.person.gap_mm(), 25.8);
        // From the true zero of the drive: 10° of its counts are 5° the other way.
        bench.turn(2, 1000).await;
        near(bench.person.gauge_deg(), -4.2);
    }

    #[tokio::test(start_paused = true)]
    async fn nothing_turns_while_the_stop_is_pressed() {
        let mut bench = Bench::new(|_| {});
        bench.person.press_stop(true);
        bench.turn(1, 200).await;
        bench.turn(2, 100).await;
        assert_eq!(places(&bench.sim), (40.0, 0.0));
        bench.person.press_stop(false);
        bench.turn(1, 200).await;
        assert_eq!(bench.person.probe_went(), ProbeWent::Up);
    }

    #[tokio::test(start_paused = true)]
    async fn a_share_of_the_answers_is_wrong_and_each_seed_has_its_own() {
        let bench = Bench::new(|scene| scene.person.wrong_answers = 0.2);
        let answers = |seed: u64| -> Vec<ProbeWent> {
            let mut person = bench.sim.person(seed);
            (0..500).map(|_| person.probe_went()).collect()
        };
        let wrong = answers(1).iter().filter(|went| **went != ProbeWent::Nowhere).count();
        assert!((70..130).contains(&wrong), "{wrong}");
        assert_eq!(answers(1), answers(1));
        assert_ne!(answers(1), answers(2));
        assert!(answers(1).contains(&ProbeWent::Up) && answers(1).contains(&ProbeWent::Down));
        let mut person = bench.sim.person(1);
        assert!((0..100).any(|_| person.gap_mm() > 30.5), "a rule is misread too");
    }
}
