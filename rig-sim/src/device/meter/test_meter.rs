//! A meter on a bench without nuisances.

use num_complex::Complex64;

use super::*;
use crate::{
    scene::matched,
    world::{Nuisances, Scene},
};

#[derive(Debug)]
pub(crate) struct TestMeter<M: Model> {
    pub(crate) meter: Meter<M>,
    pub(crate) world: World,
    pub(crate) now: RigTime,
}

impl<M: Model> TestMeter<M> {
    pub(crate) fn new() -> Self {
        Self::on(Nuisances::NONE)
    }

    /// A meter on a bench with these nuisances.
    pub(crate) fn on(nuisances: Nuisances) -> Self {
        let mut world = World::new(Scene { nuisances, ..matched() }, 1).unwrap();
        let meter = Meter::new(Duration::ZERO, &mut world);
        Self { meter, world, now: RigTime::ZERO }
    }

    /// Sends a line and waits until nothing more will happen.
    pub(crate) fn say(&mut self, line: &str) -> String {
        self.send(line);
        while let Some(deadline) = self.meter.deadline() {
            self.now = self.now.max(deadline);
            self.meter.advance(self.now, &mut self.world);
        }
        self.heard()
    }

    /// Sends a line.
    pub(crate) fn send(&mut self, line: &str) {
        self.send_as(0, line);
    }

    /// The output up to now.
    pub(crate) fn heard(&mut self) -> String {
        self.heard_by(0)
    }

    /// Sends a line as one of several clients.
    pub(crate) fn send_as(&mut self, client: ClientId, line: &str) {
        self.meter.push(self.now, client, format!("{line}\r\n").as_bytes(), &mut self.world);
    }

    /// The output up to now for one of several clients.
    pub(crate) fn heard_by(&mut self, client: ClientId) -> String {
        let said = self.meter.take_said(client);
        said.into_iter().map(|(_, bytes)| String::from_utf8(bytes).unwrap()).collect()
    }

    /// The impedance of a settled measurement at this frequency.
    pub(crate) fn settled_ohm(&self, frequency_hz: f64) -> Complex64 {
        let mut world = World::new(self.world.scene().clone(), 1).unwrap();
        world.set_frequency(RigTime::ZERO, frequency_hz);
        world.measure(RigTime::from_micros(10_000_000), 1).0
    }
}
