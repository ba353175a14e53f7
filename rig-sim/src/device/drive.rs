//! Drives of any make, each a Modbus unit with a motor.

pub(super) mod az;
mod iai;
mod leadshine;
mod motor;

use rig_model::{DriveMake, RigTime};

use self::{az::Az, iai::Iai, leadshine::Leadshine, motor::Motor};
use crate::{
    faults::DeviceFault,
    modbus::{Answer, Request},
    wiring::AxisWiring,
    world::{AxisId, World},
};

/// A drive of any make.
#[derive(Debug)]
pub(crate) enum Drive {
    Az(Az),
    Iai(Iai),
    Leadshine(Leadshine),
}

impl Drive {
    /// A drive that was just switched on, at this axis.
    pub(crate) fn new(axis: AxisId, wiring: AxisWiring, world: &World) -> Self {
        let motor = Motor::new(axis, wiring.units_per_step, wiring.zero, world);
        match wiring.make {
            DriveMake::OrientalAz => Self::Az(Az::new(motor)),
            DriveMake::IaiRc => Self::Iai(Iai::new(motor)),
            DriveMake::LeadshinePr => Self::Leadshine(Leadshine::new(motor)),
        }
    }

    /// Carries out a request.
    pub(crate) fn handle(&mut self, now: RigTime, request: &Request, world: &mut World) -> Answer {
        match self {
            Self::Az(drive) => drive.handle(now, request, world),
            Self::Iai(drive) => drive.handle(now, request, world),
            Self::Leadshine(drive) => drive.handle(now, request, world),
        }
    }

    /// Injects a fault into the drive.
    pub(crate) fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        match self {
            Self::Az(drive) => drive.apply_fault(now, fault, world),
            Self::Iai(drive) => drive.apply_fault(now, fault, world),
            Self::Leadshine(drive) => drive.apply_fault(now, fault, world),
        }
    }
}

#[cfg(test)]
mod test_drive {
    //! A drive at the linear axis of a bench without nuisances, 0.01 mm a count.

    use std::time::Duration;

    use super::*;
    use crate::{
        modbus::{Block, Exception, Reply},
        scene::paper,
        world::{Nuisances, Scene},
    };

    #[derive(Debug)]
    pub(super) struct TestDrive {
        pub(super) drive: Drive,
        pub(super) world: World,
        pub(super) now: RigTime,
    }

    impl TestDrive {
        pub(super) fn new(make: DriveMake) -> Self {
            let scene = Scene { nuisances: Nuisances::NONE, ..paper() };
            let world = World::new(scene, 1).unwrap();
            let wiring = AxisWiring { make, unit_id: 1, units_per_step: 0.01, zero: 0.0 };
            let drive = Drive::new(AxisId::Linear, wiring, &world);
            Self { drive, world, now: RigTime::ZERO }
        }

        pub(super) fn ask(&mut self, request: &Request) -> Answer {
            self.drive.handle(self.now, request, &mut self.world)
        }

        pub(super) fn wait(&mut self, seconds: f64) {
            self.now = self.now + Duration::from_secs_f64(seconds);
        }

        pub(super) fn read(&mut self, address: u16, count: u16) -> Vec<u16> {
            let block = Block { address, count };
            match self.ask(&Request::ReadHoldingRegisters(block)) {
                Some(Ok(Reply::Registers(registers))) => registers,
                other => panic!("{address:#06x}: {other:?}"),
            }
        }

        pub(super) fn read_long(&mut self, address: u16) -> i32 {
            let words = self.read(address, 2);
            (i32::from(words[0].cast_signed()) << 16) | i32::from(words[1])
        }

        pub(super) fn write(&mut self, address: u16, values: &[u16]) {
            let request = Request::WriteRegisters { address, values: values.to_vec() };
            assert_eq!(self.ask(&request), Some(Ok(Reply::Done)), "{address:#06x}");
        }

        pub(super) fn set(&mut self, address: u16, value: u16) {
            let request = Request::WriteRegister { address, value };
            assert_eq!(self.ask(&request), Some(Ok(Reply::Done)), "{address:#06x}");
        }

        pub(super) fn coil(&mut self, address: u16, value: bool) {
            let request = Request::WriteCoil { address, value };
            assert_eq!(self.ask(&request), Some(Ok(Reply::Done)), "{address:#06x}");
        }

        #[track_caller]
        pub(super) fn refused(&mut self, request: &Request, exception: Exception) {
            assert_eq!(self.ask(request), Some(Err(exception)), "{request:?}");
        }
    }
}
