//! The whole simulated rig without I/O: two ports, the devices on them, one world behind.

use std::time::Duration;

use rig_model::RigTime;

use crate::{
    device::{
        az::Az,
        bus::{Bus, Carrier, Drive},
        hioki::Hioki,
    },
    modbus::NotModbus,
    world::{AxisId, Scene, SceneError, World},
};

/// What stands on the bench and how it is connected.
#[derive(Debug, Clone, PartialEq)]
pub struct Wiring {
    /// The impedance analyzer.
    pub analyzer: AnalyzerModel,
    /// The drive of the linear stage.
    pub linear: AxisWiring,
    /// The drive of the rotary stage.
    pub rotary: AxisWiring,
    /// How the drives' line carries its frames.
    pub carrier: Carrier,
}

/// A make of impedance analyzer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnalyzerModel {
    /// HIOKI IM3536.
    HiokiIm3536,
}

/// A make of drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisModel {
    /// Oriental Motor AZ.
    OrientalAz,
}

/// How a stage is driven.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisWiring {
    /// The make of its drive.
    pub model: AxisModel,
    /// The drive's unit id on the line.
    pub unit_id: u8,
    /// Millimetres or degrees a step of the drive; negative when the motor counts the other way.
    pub units_per_step: f64,
    /// Where the axis is when the drive counts zero, mm or degrees.
    pub zero: f64,
}

/// One of the rig's ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PortId {
    /// The analyzer's.
    Analyzer,
    /// The line of the drives.
    Bus,
}

/// The port closes the connection: what came over it cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the port hangs up")]
pub struct HangUp;

impl From<NotModbus> for HangUp {
    fn from(_: NotModbus) -> Self {
        Self
    }
}

/// How long a drive thinks before it answers, as its factory sets it.
const TURNAROUND: Duration = Duration::from_millis(3);

/// The rig.
#[derive(Debug)]
pub struct Rig {
    world: World,
    analyzer: Hioki,
    bus: Bus,
}

impl Rig {
    /// A rig that was just switched on, with no sample in place.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn new(scene: Scene, wiring: &Wiring, seed: u64) -> Result<Self, SceneError> {
        let per_command = Duration::from_secs_f64(scene.nuisances.analyzer_command_s);
        let world = World::new(scene, seed)?;
        let AnalyzerModel::HiokiIm3536 = wiring.analyzer;
        let analyzer = Hioki::new("HIOKI,IM3536,190512345,V1.21", per_command);
        let drive = |axis, wiring: AxisWiring| {
            let AxisModel::OrientalAz = wiring.model;
            (wiring.unit_id, Drive::Az(Az::new(axis, wiring.units_per_step, wiring.zero, &world)))
        };
        let units =
            vec![drive(AxisId::Linear, wiring.linear), drive(AxisId::Rotary, wiring.rotary)];
        let bus = Bus::new(wiring.carrier, TURNAROUND, units);
        Ok(Self { world, analyzer, bus })
    }

    /// The world behind the devices.
    pub fn world(&mut self) -> &mut World {
        &mut self.world
    }

    /// Takes bytes that came to a port at `now`.
    ///
    /// # Errors
    /// [`HangUp`] when the port closes the connection.
    pub fn push(&mut self, now: RigTime, port: PortId, bytes: &[u8]) -> Result<(), HangUp> {
        match port {
            PortId::Analyzer => self.analyzer.push(now, bytes, &mut self.world),
            PortId::Bus => self.bus.push(now, bytes, &mut self.world)?,
        }
        Ok(())
    }

    /// What a port says by `now`.
    ///
    /// # Errors
    /// [`HangUp`] when the port closes the connection.
    pub fn poll(&mut self, now: RigTime, port: PortId) -> Result<Vec<u8>, HangUp> {
        Ok(match port {
            PortId::Analyzer => self.analyzer.poll(now, &mut self.world),
            PortId::Bus => self.bus.poll(now, &mut self.world)?,
        })
    }

    /// When something will happen on a port without further bytes.
    pub fn deadline(&self, port: PortId) -> Option<RigTime> {
        match port {
            PortId::Analyzer => self.analyzer.deadline(),
            PortId::Bus => self.bus.deadline(),
        }
    }
}
