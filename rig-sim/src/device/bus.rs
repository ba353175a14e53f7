//! A line with Modbus units on it.

use std::time::Duration;

use rig_model::RigTime;

use super::{
    corruption::{self, Reply},
    drive::Drive,
    output_queue::OutputQueue,
};
use crate::{
    faults::{DeviceContext, DeviceFault, RequestFault},
    modbus::{Frame, RtuDecoder, TcpDecoder},
    wiring::{HangUp, LineTransport, PortId},
    world::World,
};

#[derive(Debug)]
enum Decoder {
    Rtu(RtuDecoder),
    Tcp(TcpDecoder),
}

impl Decoder {
    fn new(transport: LineTransport, patience: Duration) -> Self {
        match transport {
            LineTransport::Serial { .. } => {
                Self::Rtu(RtuDecoder::new(transport.silence().max(patience)))
            }
            LineTransport::Tcp => Self::Tcp(TcpDecoder::default()),
        }
    }
}

/// The drives of a line.
#[derive(Debug)]
pub(crate) struct Bus {
    /// Response delay of a drive.
    turnaround: Duration,
    /// The drives and the line take no time.
    is_instant: bool,
    units: Vec<(u8, Drive)>,
}

/// A client's connection to the line.
#[derive(Debug)]
pub(crate) struct BusLine {
    transport: LineTransport,
    decoder: Decoder,
    output: OutputQueue,
}

impl BusLine {
    /// A connection on which nothing was said. `patience` is how long the bytes of one frame may be
    /// torn apart on their way.
    pub(crate) fn new(transport: LineTransport, patience: Duration) -> Self {
        Self {
            transport,
            decoder: Decoder::new(transport, patience),
            output: OutputQueue::default(),
        }
    }

    /// When something will happen without further bytes.
    pub(crate) fn deadline(&self) -> Option<RigTime> {
        let silence = match &self.decoder {
            Decoder::Rtu(decoder) => decoder.deadline(),
            Decoder::Tcp(_) => None,
        };
        [silence, self.output.deadline()].into_iter().flatten().min()
    }
}

impl Bus {
    /// A line with drives at these unit ids.
    pub(crate) fn new(turnaround: Duration, units: Vec<(u8, Drive)>) -> Self {
        Self { turnaround, is_instant: false, units }
    }

    /// From now on answers come at once.
    pub(crate) fn answer_at_once(&mut self) {
        self.is_instant = true;
    }

    /// Accepts bytes that arrived at `now`.
    pub(crate) fn push(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        bytes: &[u8],
        context: DeviceContext<'_>,
    ) -> Result<(), HangUp> {
        match &mut line.decoder {
            Decoder::Rtu(decoder) => decoder.push(now, bytes),
            Decoder::Tcp(decoder) => decoder.push(bytes),
        }
        self.advance(now, line, context)
    }

    /// Takes the output up to `now`.
    pub(crate) fn poll(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        context: DeviceContext<'_>,
    ) -> Result<Vec<u8>, HangUp> {
        self.advance(now, line, context)?;
        Ok(line.output.poll(now))
    }

    /// A person has homed all drives with their own program, and has brought the axes back.
    pub(crate) fn homed_by_person(&mut self) {
        for (_, drive) in &mut self.units {
            drive.homed_by_person();
        }
    }

    /// Injects a fault into the drive at `unit`, or into all drives.
    pub(crate) fn apply_fault(
        &mut self,
        now: RigTime,
        unit: Option<u8>,
        fault: DeviceFault,
        world: &mut World,
    ) {
        for (known, drive) in &mut self.units {
            if unit.is_none_or(|unit| unit == *known) {
                drive.apply_fault(now, fault, world);
            }
        }
    }

    fn advance(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        mut context: DeviceContext<'_>,
    ) -> Result<(), HangUp> {
        loop {
            let frame = match &mut line.decoder {
                Decoder::Rtu(decoder) => decoder.poll(now),
                Decoder::Tcp(decoder) => decoder.poll()?,
            };
            let Some(frame) = frame else { return Ok(()) };
            self.handle(now, line, &frame, &mut context)?;
        }
    }

    fn handle(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        frame: &Frame,
        context: &mut DeviceContext<'_>,
    ) -> Result<(), HangUp> {
        let is_broadcast =
            frame.unit == 0 && matches!(line.transport, LineTransport::Serial { .. });
        for (unit, drive) in &mut self.units {
            if !(is_broadcast || *unit == frame.unit) {
                continue;
            }
            let bytes = match ask(now, (*unit, drive), frame, context)? {
                // No unit answers a broadcast, not even with a refusal.
                Some(_) if is_broadcast => continue,
                Some(bytes) => bytes,
                None => continue,
            };
            let on_the_wire = line.transport.duration_of(frame.bytes().len() + bytes.len());
            let applied = context.faults.on_reply(PortId::Bus, Some(*unit));
            let due = if self.is_instant { now } else { now + on_the_wire + self.turnaround };
            let reply = Reply { due, request: frame.bytes(), bytes: bytes.clone() };
            let readdress = |unit| Some(frame.readdressed(&bytes, unit));
            corruption::send(reply, &applied, readdress, context.faults, &mut line.output)?;
        }
        Ok(())
    }
}

/// The answer of a drive in bytes, with the faults that are due.
fn ask(
    now: RigTime,
    (unit, drive): (u8, &mut Drive),
    frame: &Frame,
    DeviceContext { world, faults }: &mut DeviceContext<'_>,
) -> Result<Option<Vec<u8>>, HangUp> {
    for fault in faults.on_device(PortId::Bus, Some(unit)) {
        drive.apply_fault(now, fault, world);
    }
    match faults.on_request(PortId::Bus, Some(unit)).first() {
        Some(RequestFault::Drop) => return Ok(None),
        Some(RequestFault::Disconnect) => return Err(HangUp),
        Some(RequestFault::Unplug(absence)) => {
            faults.pull(PortId::Bus, *absence);
            return Err(HangUp);
        }
        Some(RequestFault::Exception(code)) => return Ok(Some(frame.exception(unit, *code))),
        None => {}
    }
    let answer = match &frame.request {
        Ok(request) => drive.handle(now, request, world),
        Err(exception) => Some(Err(*exception)),
    };
    Ok(answer.map(|answer| frame.answer(unit, &answer)))
}

#[cfg(test)]
mod tests {
    use rig_model::{DriveMake, random::Stream};

    use super::*;
    use crate::{
        device::drive::az::alarm, faults::FaultSchedule, scene::matched, wiring::AxisWiring,
        world::AxisId,
    };

    /// Two drives on one line, 0.001 mm and 0.01° a step, with the master's side of the protocol.
    struct TestLine {
        bus: Bus,
        line: BusLine,
        world: World,
        faults: FaultSchedule,
        now: RigTime,
    }

    const MM: f64 = 0.001;

    fn wiring(unit_id: u8, units_per_step: f64) -> AxisWiring {
        AxisWiring::new(DriveMake::OrientalAz, unit_id, units_per_step)
    }

    impl TestLine {
        fn new() -> Self {
            let mut world = World::new(matched(), 1).unwrap();
            world.place_sample(RigTime::ZERO, "3").unwrap();
            let units = vec![
                (1, Drive::new(AxisId::Linear, wiring(1, MM), &world)),
                (2, Drive::new(AxisId::Rotary, wiring(2, 0.01), &world)),
            ];
            let line = BusLine::new(LineTransport::Serial { baud: 115_200 }, Duration::ZERO);
            let bus = Bus::new(Duration::from_millis(2), units);
            let faults = FaultSchedule::new(Stream::new(1, 1));
            Self { bus, line, world, faults, now: RigTime::ZERO }
        }

        fn push(&mut self, bytes: &[u8]) {
            let context = DeviceContext { world: &mut self.world, faults: &mut self.faults };
            self.bus.push(self.now, &mut self.line, bytes, context).unwrap();
        }

        fn poll(&mut self) -> Vec<u8> {
            let context = DeviceContext { world: &mut self.world, faults: &mut self.faults };
            self.bus.poll(self.now, &mut self.line, context).unwrap()
        }

        /// Sends a request without its checksum; the answer comes back without unit and checksum.
        fn ask(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
            self.push(&crate::modbus::with_checksum(frame));
            let due = self.line.deadline()?;
            assert!(self.poll().is_empty());
            self.now = due;
            let answer = self.poll();
            assert_eq!(self.line.deadline(), None);
            assert_eq!(answer[0], frame[0]);
            Some(answer[1..answer.len() - 2].to_vec())
        }

        fn read(&mut self, unit: u8, address: u16) -> i32 {
            let [high, low] = address.to_be_bytes();
            let answer = self.ask(&[unit, 3, high, low, 0, 2]).unwrap();
            assert_eq!(answer[..2], [3, 4], "{address:#06x}");
            i32::from_be_bytes(answer[2..].try_into().unwrap())
        }

        fn write(&mut self, unit: u8, address: u16, values: &[i32]) -> Vec<u8> {
            let count = u8::try_from(2 * values.len()).unwrap();
            let [high, low] = address.to_be_bytes();
            let mut frame = vec![unit, 16, high, low, 0, count, 2 * count];
            frame.extend(values.iter().flat_map(|value| value.to_be_bytes()));
            self.ask(&frame).unwrap()
        }

        /// An absolute move by direct data operation.
        fn go(&mut self, unit: u8, position: i32, speed: i32) {
            let data = [0, 1, position, speed, 1_000_000, 1_000_000, 1000, 1];
            assert_eq!(self.write(unit, 0x0058, &data), [16, 0, 0x58, 0, 16]);
        }

        fn wait(&mut self, seconds: f64) {
            self.now = self.now + Duration::from_secs_f64(seconds);
        }
    }

    const READY: i32 = 1 << 5;
    const ALARM: i32 = 1 << 7;
    const MOVE: i32 = 1 << 13;
    const IN_POSITION: i32 = 1 << 14;

    #[test]
    fn a_move_takes_its_time_and_ends_where_it_was_sent() {
        let mut line = TestLine::new();
        let start = line.read(1, 0x00CC);
        line.go(1, start + 5000, 10_000);
        assert_eq!(line.read(1, 0x007E) & (READY | MOVE | IN_POSITION), MOVE);
        line.wait(0.25);
        let half = line.read(1, 0x00CC) - start;
        assert!((2000..3500).contains(&half), "{half}");
        line.wait(0.3);
        assert_eq!(line.read(1, 0x007E) & (READY | MOVE | IN_POSITION), READY | IN_POSITION);
        assert!((line.read(1, 0x00CC) - start - 5000).abs() <= 3);
        assert_eq!(line.read(1, 0x00C6), start + 5000);
        // The other drive on the line did not take part.
        assert_eq!(line.read(2, 0x00C6), 0);
    }

    #[test]
    fn a_broadcast_is_obeyed_and_nobody_answers() {
        let mut line = TestLine::new();
        line.go(1, 30_000, 1000);
        line.wait(0.5);
        // STOP to all.
        assert_eq!(line.ask(&[0, 6, 0, 0x7D, 0, 0x20]), None);
        line.wait(0.1);
        assert_eq!(line.read(1, 0x007E) & (READY | MOVE), 0);
        // While STOP is on, the drive ignores a move.
        let before = line.read(2, 0x00C6);
        line.go(2, 1000, 1000);
        line.wait(2.0);
        assert_eq!((line.read(2, 0x00C6), line.read(2, 0x0080)), (before, 0));
    }

    #[test]
    fn foreign_units_and_damaged_frames_are_met_with_silence() {
        let mut line = TestLine::new();
        assert_eq!(line.ask(&[9, 3, 0, 0xCC, 0, 2]), None);
        line.push(&[1, 3, 0, 0xCC, 0, 2, 0, 0]);
        line.now = line.line.deadline().unwrap();
        assert!(line.poll().is_empty());
        assert_eq!(line.line.deadline(), None);
    }

    #[test]
    fn what_the_map_does_not_have_is_an_exception() {
        let mut line = TestLine::new();
        assert_eq!(line.ask(&[1, 3, 0x70, 0, 0, 2]), Some(vec![0x83, 2]));
        assert_eq!(line.ask(&[1, 6, 0, 0x80, 0, 0]), Some(vec![0x86, 2]), "the alarm is read only");
        assert_eq!(line.ask(&[1, 4, 0, 0xCC, 0, 2]), Some(vec![0x84, 1]));
        assert_eq!(line.write(1, 0x0060, &[0]), [0x90, 3], "no acceleration of zero");
        assert_eq!(line.ask(&[1, 8, 0, 0, 0x12, 0x34]), Some(vec![8, 0, 0, 0x12, 0x34]));
    }

    #[test]
    fn a_software_limit_stops_the_move_and_raises_the_alarm_until_it_is_reset() {
        let mut line = TestLine::new();
        let start = line.read(1, 0x00C6);
        assert_eq!(line.write(1, 0x0386, &[3, start + 1000, start - 1000]), [16, 3, 0x86, 0, 6]);
        line.go(1, start + 2000, 10_000);
        line.wait(1.0);
        assert_eq!(line.read(1, 0x00C6), start + 1000);
        assert_eq!(line.read(1, 0x0080), i32::from(alarm::SOFTWARE_OVERTRAVEL));
        assert_eq!(line.read(1, 0x007E) & (READY | ALARM), ALARM);
        // A drive with an alarm ignores moves.
        line.go(1, start, 10_000);
        line.wait(1.0);
        assert_eq!(line.read(1, 0x00C6), start + 1000);
        line.write(1, 0x0180, &[1]);
        line.write(1, 0x0180, &[0]);
        line.go(1, start, 10_000);
        line.wait(1.0);
        assert_eq!((line.read(1, 0x00C6), line.read(1, 0x0080)), (start, 0));
        assert_eq!(line.read(1, 0x0082), i32::from(alarm::SOFTWARE_OVERTRAVEL), "in the history");
    }

    #[test]
    fn software_limits_outside_the_travel_do_not_lead_out_of_it() {
        for (limits, side) in [([80_000, 60_000], 1.0), ([-8_000, -20_000], -1.0)] {
            let mut line = TestLine::new();
            line.write(1, 0x0386, &[3, limits[0], limits[1]]);
            line.go(1, 30_000, 50_000);
            line.wait(10.0);
            let (low, high) = line.world.travel(AxisId::Linear);
            let end = if side > 0.0 { high } else { low };
            assert_eq!(f64::from(line.read(1, 0x00C6)) * MM, end);
            assert_eq!(line.read(1, 0x0080), i32::from(alarm::HARDWARE_OVERTRAVEL));
        }
    }

    #[test]
    fn the_limit_switch_is_an_alarm_of_the_hardware() {
        let mut line = TestLine::new();
        line.go(1, 10_000_000, 50_000);
        line.wait(10.0);
        assert_eq!(line.read(1, 0x0080), i32::from(alarm::HARDWARE_OVERTRAVEL));
        let travel = line.world.travel(AxisId::Linear).1;
        assert_eq!(f64::from(line.read(1, 0x00C6)) * MM, travel);
    }

    #[test]
    fn relative_moves_triggers_and_home() {
        let mut line = TestLine::new();
        let start = line.read(1, 0x00C6);
        // Incremental from the command position, triggered by the position item alone.
        line.write(1, 0x0058, &[0, 2, 0, 10_000, 1_000_000, 1_000_000, 1000, -5]);
        line.wait(0.1);
        for _ in 0..2 {
            line.write(1, 0x005C, &[500]);
            line.wait(0.5);
        }
        // Once by the first request, whose position is zero, and twice by 500.
        assert_eq!(line.read(1, 0x00C6), start + 1000);
        line.ask(&[1, 6, 0, 0x7D, 0, 0x10]).unwrap();
        assert_eq!(line.read(1, 0x00D4), 0, "home is lost until it is found");
        line.wait(20.0);
        assert_eq!((line.read(1, 0x00C6), line.read(1, 0x00D4)), (0, 1 << 16));
    }

    #[test]
    fn a_restart_forgets_settings_and_keeps_the_place() {
        let mut line = TestLine::new();
        line.go(1, 21_000, 10_000);
        line.wait(0.2);
        line.bus.apply_fault(line.now, Some(1), DeviceFault::Reboot, &mut line.world);
        assert_eq!(line.ask(&[1, 3, 0, 0xCC, 0, 2]), None, "it boots");
        line.wait(5.0);
        let place = line.read(1, 0x00C6);
        assert!((line.read(1, 0x00CC) - place).abs() <= 3);
        assert_eq!(line.read(1, 0x005E), 1000, "the speed is the one of the factory");
    }
}
