//! A line with Modbus units on it.

use std::time::Duration;

use rig_model::RigTime;

use super::{
    drive::Drive,
    outbox::Outbox,
    spoil::{self, Reply},
};
use crate::{
    faults::{DeviceFault, Fate, RequestFault},
    modbus::{Frame, RtuDecoder, TcpDecoder},
    wiring::{Carrier, HangUp, PortId},
    world::World,
};

#[derive(Debug)]
enum Decoder {
    Rtu(RtuDecoder),
    Tcp(TcpDecoder),
}

impl Decoder {
    fn new(carrier: Carrier, patience: Duration) -> Self {
        match carrier {
            Carrier::Serial { .. } => Self::Rtu(RtuDecoder::new(carrier.silence().max(patience))),
            Carrier::Tcp => Self::Tcp(TcpDecoder::default()),
        }
    }
}

/// The drives of a line.
#[derive(Debug)]
pub(crate) struct Bus {
    /// How long a drive thinks before it answers.
    turnaround: Duration,
    /// Neither the drives nor the line take any time.
    is_instant: bool,
    units: Vec<(u8, Drive)>,
}

/// A client's connection to the line.
#[derive(Debug)]
pub(crate) struct BusLine {
    carrier: Carrier,
    decoder: Decoder,
    outbox: Outbox,
}

impl BusLine {
    /// A connection on which nothing was said. `patience` is how long the bytes of one frame may be
    /// torn apart on their way.
    pub(crate) fn new(carrier: Carrier, patience: Duration) -> Self {
        Self { carrier, decoder: Decoder::new(carrier, patience), outbox: Outbox::default() }
    }

    /// When something will happen without further bytes.
    pub(crate) fn deadline(&self) -> Option<RigTime> {
        let silence = match &self.decoder {
            Decoder::Rtu(decoder) => decoder.deadline(),
            Decoder::Tcp(_) => None,
        };
        [silence, self.outbox.deadline()].into_iter().flatten().min()
    }
}

impl Bus {
    /// A line with drives at these unit ids.
    pub(crate) fn new(turnaround: Duration, units: Vec<(u8, Drive)>) -> Self {
        Self { turnaround, is_instant: false, units }
    }

    /// From now on answers are there at once.
    pub(crate) fn answer_at_once(&mut self) {
        self.is_instant = true;
    }

    /// Takes bytes that came at `now`.
    pub(crate) fn push(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        bytes: &[u8],
        fate: Fate<'_>,
    ) -> Result<(), HangUp> {
        match &mut line.decoder {
            Decoder::Rtu(decoder) => decoder.push(now, bytes),
            Decoder::Tcp(decoder) => decoder.push(bytes),
        }
        self.advance(now, line, fate)
    }

    /// What has been said by `now`.
    pub(crate) fn poll(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        fate: Fate<'_>,
    ) -> Result<Vec<u8>, HangUp> {
        self.advance(now, line, fate)?;
        Ok(line.outbox.poll(now))
    }

    /// Lets a fault befall the drive at `unit`, or all of them, now.
    pub(crate) fn suffer(
        &mut self,
        now: RigTime,
        unit: Option<u8>,
        fault: DeviceFault,
        world: &mut World,
    ) {
        for (known, drive) in &mut self.units {
            if unit.is_none_or(|unit| unit == *known) {
                drive.suffer(now, fault, world);
            }
        }
    }

    fn advance(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        mut fate: Fate<'_>,
    ) -> Result<(), HangUp> {
        loop {
            let frame = match &mut line.decoder {
                Decoder::Rtu(decoder) => decoder.poll(now),
                Decoder::Tcp(decoder) => decoder.poll()?,
            };
            let Some(frame) = frame else { return Ok(()) };
            self.handle(now, line, &frame, &mut fate)?;
        }
    }

    fn handle(
        &mut self,
        now: RigTime,
        line: &mut BusLine,
        frame: &Frame,
        fate: &mut Fate<'_>,
    ) -> Result<(), HangUp> {
        let is_broadcast = frame.unit == 0 && matches!(line.carrier, Carrier::Serial { .. });
        for (unit, drive) in &mut self.units {
            if !(is_broadcast || *unit == frame.unit) {
                continue;
            }
            let bytes = match ask(now, (*unit, drive), frame, fate)? {
                // Nobody answers a broadcast, not even to refuse it.
                Some(_) if is_broadcast => continue,
                Some(bytes) => bytes,
                None => continue,
            };
            let on_the_wire = line.carrier.duration_of(frame.bytes().len() + bytes.len());
            let struck = fate.faults.on_reply(PortId::Bus, Some(*unit));
            let due = if self.is_instant { now } else { now + on_the_wire + self.turnaround };
            let reply = Reply { due, request: frame.bytes(), bytes: bytes.clone() };
            let readdress = |unit| Some(frame.readdressed(&bytes, unit));
            spoil::send(reply, &struck, readdress, fate.faults, &mut line.outbox)?;
        }
        Ok(())
    }
}

/// What a drive answers, in bytes, under the faults of the moment.
fn ask(
    now: RigTime,
    (unit, drive): (u8, &mut Drive),
    frame: &Frame,
    Fate { world, faults }: &mut Fate<'_>,
) -> Result<Option<Vec<u8>>, HangUp> {
    for fault in faults.on_device(PortId::Bus, Some(unit)) {
        drive.suffer(now, fault, world);
    }
    match faults.on_request(PortId::Bus, Some(unit)).first() {
        Some(RequestFault::Drop) => return Ok(None),
        Some(RequestFault::Disconnect) => return Err(HangUp),
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
        device::drive::az::alarm, faults::Faults, scene::paper, wiring::AxisWiring, world::AxisId,
    };

    /// Two drives on one line, 0.001 mm and 0.01° a step, with the master's side of the protocol.
    struct Bench {
        bus: Bus,
        line: BusLine,
        world: World,
        faults: Faults,
        now: RigTime,
    }

    const MM: f64 = 0.001;

    fn wiring(unit_id: u8, units_per_step: f64) -> AxisWiring {
        AxisWiring { make: DriveMake::OrientalAz, unit_id, units_per_step, zero: 0.0 }
    }

    impl Bench {
        fn new() -> Self {
            let mut world = World::new(paper(), 1).unwrap();
            world.place_sample(RigTime::ZERO, "3").unwrap();
            let units = vec![
                (1, Drive::new(AxisId::Linear, wiring(1, MM), &world)),
                (2, Drive::new(AxisId::Rotary, wiring(2, 0.01), &world)),
            ];
            let line = BusLine::new(Carrier::Serial { baud: 115_200 }, Duration::ZERO);
            let bus = Bus::new(Duration::from_millis(2), units);
            let faults = Faults::new(Stream::new(1, 1));
            Self { bus, line, world, faults, now: RigTime::ZERO }
        }

        fn push(&mut self, bytes: &[u8]) {
            let fate = Fate { world: &mut self.world, faults: &mut self.faults };
            self.bus.push(self.now, &mut self.line, bytes, fate).unwrap();
        }

        fn poll(&mut self) -> Vec<u8> {
            let fate = Fate { world: &mut self.world, faults: &mut self.faults };
            self.bus.poll(self.now, &mut self.line, fate).unwrap()
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
        let mut bench = Bench::new();
        let start = bench.read(1, 0x00CC);
        bench.go(1, start + 5000, 10_000);
        assert_eq!(bench.read(1, 0x007E) & (READY | MOVE | IN_POSITION), MOVE);
        bench.wait(0.25);
        let half = bench.read(1, 0x00CC) - start;
        assert!((2000..3500).contains(&half), "{half}");
        bench.wait(0.3);
        assert_eq!(bench.read(1, 0x007E) & (READY | MOVE | IN_POSITION), READY | IN_POSITION);
        assert!((bench.read(1, 0x00CC) - start - 5000).abs() <= 3);
        assert_eq!(bench.read(1, 0x00C6), start + 5000);
        // The other drive on the line did not take part.
        assert_eq!(bench.read(2, 0x00C6), 0);
    }

    #[test]
    fn a_broadcast_is_obeyed_and_nobody_answers() {
        let mut bench = Bench::new();
        bench.go(1, 30_000, 1000);
        bench.wait(0.5);
        // STOP to all.
        assert_eq!(bench.ask(&[0, 6, 0, 0x7D, 0, 0x20]), None);
        bench.wait(0.1);
        assert_eq!(bench.read(1, 0x007E) & (READY | MOVE), 0);
        // While STOP is on, a move is refused without a word.
        let before = bench.read(2, 0x00C6);
        bench.go(2, 1000, 1000);
        bench.wait(2.0);
        assert_eq!((bench.read(2, 0x00C6), bench.read(2, 0x0080)), (before, 0));
    }

    #[test]
    fn foreign_units_and_damaged_frames_are_met_with_silence() {
        let mut bench = Bench::new();
        assert_eq!(bench.ask(&[9, 3, 0, 0xCC, 0, 2]), None);
        bench.push(&[1, 3, 0, 0xCC, 0, 2, 0, 0]);
        bench.now = bench.line.deadline().unwrap();
        assert!(bench.poll().is_empty());
        assert_eq!(bench.line.deadline(), None);
    }

    #[test]
    fn what_the_map_does_not_have_is_an_exception() {
        let mut bench = Bench::new();
        assert_eq!(bench.ask(&[1, 3, 0x70, 0, 0, 2]), Some(vec![0x83, 2]));
        assert_eq!(
            bench.ask(&[1, 6, 0, 0x80, 0, 0]),
            Some(vec![0x86, 2]),
            "the alarm is read only"
        );
        assert_eq!(bench.ask(&[1, 4, 0, 0xCC, 0, 2]), Some(vec![0x84, 1]));
        assert_eq!(bench.write(1, 0x0060, &[0]), [0x90, 3], "no acceleration of zero");
        assert_eq!(bench.ask(&[1, 8, 0, 0, 0x12, 0x34]), Some(vec![8, 0, 0, 0x12, 0x34]));
    }

    #[test]
    fn a_software_limit_stops_the_move_and_raises_the_alarm_until_it_is_reset() {
        let mut bench = Bench::new();
        let start = bench.read(1, 0x00C6);
        assert_eq!(bench.write(1, 0x0386, &[3, start + 1000, start - 1000]), [16, 3, 0x86, 0, 6]);
        bench.go(1, start + 2000, 10_000);
        bench.wait(1.0);
        assert_eq!(bench.read(1, 0x00C6), start + 1000);
        assert_eq!(bench.read(1, 0x0080), i32::from(alarm::SOFTWARE_OVERTRAVEL));
        assert_eq!(bench.read(1, 0x007E) & (READY | ALARM), ALARM);
        // An alarm refuses moves without a word.
        bench.go(1, start, 10_000);
        bench.wait(1.0);
        assert_eq!(bench.read(1, 0x00C6), start + 1000);
        bench.write(1, 0x0180, &[1]);
        bench.write(1, 0x0180, &[0]);
        bench.go(1, start, 10_000);
        bench.wait(1.0);
        assert_eq!((bench.read(1, 0x00C6), bench.read(1, 0x0080)), (start, 0));
        assert_eq!(bench.read(1, 0x0082), i32::from(alarm::SOFTWARE_OVERTRAVEL), "in the history");
    }

    #[test]
    fn software_limits_outside_the_travel_do_not_lead_out_of_it() {
        for (limits, side) in [([80_000, 60_000], 1.0), ([-8_000, -20_000], -1.0)] {
            let mut bench = Bench::new();
            bench.write(1, 0x0386, &[3, limits[0], limits[1]]);
            bench.go(1, 30_000, 50_000);
            bench.wait(10.0);
            let (low, high) = bench.world.travel(AxisId::Linear);
            let end = if side > 0.0 { high } else { low };
            assert_eq!(f64::from(bench.read(1, 0x00C6)) * MM, end);
            assert_eq!(bench.read(1, 0x0080), i32::from(alarm::HARDWARE_OVERTRAVEL));
        }
    }

    #[test]
    fn the_limit_switch_is_an_alarm_of_the_hardware() {
        let mut bench = Bench::new();
        bench.go(1, 10_000_000, 50_000);
        bench.wait(10.0);
        assert_eq!(bench.read(1, 0x0080), i32::from(alarm::HARDWARE_OVERTRAVEL));
        let travel = bench.world.travel(AxisId::Linear).1;
        assert_eq!(f64::from(bench.read(1, 0x00C6)) * MM, travel);
    }

    #[test]
    fn relative_moves_triggers_and_home() {
        let mut bench = Bench::new();
        let start = bench.read(1, 0x00C6);
        // Incremental from the command position, triggered by the position item alone.
        bench.write(1, 0x0058, &[0, 2, 0, 10_000, 1_000_000, 1_000_000, 1000, -5]);
        bench.wait(0.1);
        for _ in 0..2 {
            bench.write(1, 0x005C, &[500]);
            bench.wait(0.5);
        }
        // Once by the first request, whose position is zero, and twice by 500.
        assert_eq!(bench.read(1, 0x00C6), start + 1000);
        bench.ask(&[1, 6, 0, 0x7D, 0, 0x10]).unwrap();
        assert_eq!(bench.read(1, 0x00D4), 0, "home is lost until it is found");
        bench.wait(20.0);
        assert_eq!((bench.read(1, 0x00C6), bench.read(1, 0x00D4)), (0, 1 << 16));
    }

    #[test]
    fn a_restart_forgets_settings_and_keeps_the_place() {
        let mut bench = Bench::new();
        bench.go(1, 21_000, 10_000);
        bench.wait(0.2);
        bench.bus.suffer(bench.now, Some(1), DeviceFault::Reboot, &mut bench.world);
        assert_eq!(bench.ask(&[1, 3, 0, 0xCC, 0, 2]), None, "it boots");
        bench.wait(5.0);
        let place = bench.read(1, 0x00C6);
        assert!((bench.read(1, 0x00CC) - place).abs() <= 3);
        assert_eq!(bench.read(1, 0x005E), 1000, "the speed is the one of the factory");
    }
}
