//! Drives of any make, each a Modbus unit with a motor.

pub(super) mod az;
mod iai;
mod leadshine;
mod motor;

use std::{fmt, iter::Sum, ops::Range, slice, time::Duration};

use rig_model::{DriveMake, RigTime};

use self::{az::Az, iai::Iai, leadshine::Leadshine, motor::Motor};
use crate::{
    faults::DeviceFault,
    modbus::{Answer, Block, Exception, Reply, Request},
    wiring::AxisWiring,
    world::{AxisId, World},
};

/// Boot time of every drive.
const BOOT: Duration = Duration::from_secs(1);

/// A drive of any make.
#[derive(Debug)]
pub(crate) struct Drive {
    unit: Box<dyn Unit>,
    /// A drive that boots does not answer.
    boots_until: RigTime,
}

/// A drive of one make after its boot.
trait Unit: fmt::Debug + Send {
    /// Takes note of the end of the last move, if it is over.
    fn notice_end(&mut self, now: RigTime, world: &World);

    /// Carries out a request.
    fn answer(
        &mut self,
        now: RigTime,
        request: &Request,
        world: &mut World,
    ) -> Result<Reply, Exception>;

    /// Injects a fault other than a reboot.
    fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World);

    /// Switches the drive off and on again.
    fn power_cycle(&mut self, now: RigTime, world: &mut World);

    /// Takes note that a person has homed the drive with its own program, and has brought the axis back.
    fn homed_by_person(&mut self);
}

impl Drive {
    /// A drive that was just switched on, at this axis.
    pub(crate) fn new(axis: AxisId, wiring: AxisWiring, world: &World) -> Self {
        let motor = Motor::new(axis, &wiring, world);
        let unit: Box<dyn Unit> = match wiring.make {
            DriveMake::OrientalAz => Box::new(Az::new(motor)),
            DriveMake::IaiRc => Box::new(Iai::new(motor)),
            DriveMake::LeadshinePr => Box::new(Leadshine::new(motor)),
        };
        Self { unit, boots_until: RigTime::ZERO }
    }

    /// Carries out a request.
    pub(crate) fn handle(&mut self, now: RigTime, request: &Request, world: &mut World) -> Answer {
        if now < self.boots_until {
            return None;
        }
        self.unit.notice_end(now, world);
        Some(self.unit.answer(now, request, world))
    }

    /// A person has homed the drive with its own program, and has brought the axis back.
    pub(crate) fn homed_by_person(&mut self) {
        self.unit.homed_by_person();
    }

    /// Injects a fault into the drive.
    pub(crate) fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        self.unit.notice_end(now, world);
        if fault == DeviceFault::Reboot {
            self.unit.power_cycle(now, world);
            self.boots_until = now + BOOT;
        } else {
            self.unit.apply_fault(now, fault, world);
        }
    }
}

/// The bits of a status that are on.
fn bits<T: Sum>(all: impl IntoIterator<Item = (T, bool)>) -> T {
    all.into_iter().filter_map(|(bit, is_on)| is_on.then_some(bit)).sum()
}

/// The addresses of registers written from `first` on.
fn addresses(first: u16, values: &[u16]) -> Result<Range<u16>, Exception> {
    let count = u16::try_from(values.len()).map_err(|_| Exception::Value)?;
    Ok(first..first.checked_add(count).ok_or(Exception::Address)?)
}

/// The first address and the registers of a request that writes registers.
fn written(request: &Request) -> Option<(u16, &[u16])> {
    match request {
        Request::WriteRegister { address, value } => Some((*address, slice::from_ref(value))),
        Request::WriteRegisters { address, values } => Some((*address, values)),
        _ => None,
    }
}

/// The value at each address of a block; all of them must exist.
fn read_each<T>(block: Block, value: impl Fn(u16) -> Option<T>) -> Result<Vec<T>, Exception> {
    let values = (0..block.count).map(|offset| block.address.checked_add(offset).and_then(&value));
    values.collect::<Option<_>>().ok_or(Exception::Address)
}

/// The value of two registers, the upper word first.
fn long([upper, lower]: [u16; 2]) -> i32 {
    (i32::from(upper.cast_signed()) << 16) | i32::from(lower)
}

#[cfg(test)]
mod test_drive {
    //! A drive at the linear axis of a bench without nuisances, 0.01 mm a count.

    use super::*;
    use crate::{
        scene::matched,
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
            Self::on(make, Nuisances::NONE)
        }

        /// A drive on a bench with these nuisances.
        pub(super) fn on(make: DriveMake, nuisances: Nuisances) -> Self {
            let world = World::new(Scene { nuisances, ..matched() }, 1).unwrap();
            let wiring = AxisWiring::new(make, 1, 0.01);
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
            long([words[0], words[1]])
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
