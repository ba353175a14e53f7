//! The whole simulated rig without I/O: two ports, the devices on them, one world behind.

use std::time::Duration;

use rig_model::{AnalyzerMake, RigTime, random::Stream};

use crate::{
    device::{
        bus::{Bus, BusLine},
        cable::{Analyzer, Cable, Socket},
        drive::Drive,
        meter::{E4980a, E4990a, Hioki, Hp4284a, Lcr, Meter, Th2832},
    },
    faults::{DeviceContext, DeviceFault, Fault, FaultSchedule},
    wiring::{AxisWiring, HangUp, LineTransport, PortId, Wiring},
    world::{AxisId, Scene, SceneError, World},
};

/// Response delay of a drive, as set by its factory.
const TURNAROUND: Duration = Duration::from_millis(3);

/// The simulated rig without I/O.
#[derive(Debug)]
pub struct Rig {
    world: World,
    analyzer: Socket,
    bus: Bus,
    transport: LineTransport,
    faults: FaultSchedule,
    /// The outlets of the analyzer and of the bus.
    outlets: [Outlet; 2],
    /// Bytes sent to the ports, if they are recorded.
    overheard: Option<Vec<Overheard>>,
}

/// Bytes that arrived at a port together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Overheard {
    /// Time of arrival.
    pub at: RigTime,
    /// Port at which the bytes arrived.
    pub port: PortId,
    /// The bytes, in order of arrival.
    pub bytes: Vec<u8>,
}

/// The place where the cable of a port is plugged in.
#[derive(Debug, Clone, Copy, Default)]
struct Outlet {
    /// Number of times that the cable was pulled.
    pulls: u64,
    /// The outlet is empty until this time.
    empty_until: RigTime,
}

/// A client's connection to a port. Several may be open; each gets the answers to its own requests.
#[derive(Debug)]
pub struct Connection {
    end: End,
    /// Its port, and how often the cable of the port had been pulled when it was made.
    outlet: Option<(PortId, u64)>,
}

#[derive(Debug)]
enum End {
    Analyzer(Cable),
    Bus(BusLine),
}

impl Connection {
    /// When something will happen on it without further bytes.
    pub fn deadline(&self) -> Option<RigTime> {
        match &self.end {
            End::Analyzer(cable) => cable.deadline(),
            End::Bus(line) => line.deadline(),
        }
    }

    /// Whether what another client says may change when this one is answered.
    pub(crate) const fn waits_for_others(&self) -> bool {
        matches!(self.end, End::Analyzer(_))
    }
}

/// The name of the stream of chance for faults; those of the world are below it.
const FAULT_STREAM: u64 = 100;

impl Rig {
    /// A rig that was just switched on, with no sample in place.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn new(scene: Scene, wiring: &Wiring, seed: u64) -> Result<Self, SceneError> {
        let per_command = Duration::from_secs_f64(scene.nuisances.analyzer_command_s);
        let [linear, rotary] = [scene.linear.assembly, scene.rotary.assembly];
        let mut world = World::new(scene, seed)?;
        let analyzer: Box<dyn Analyzer> = match wiring.analyzer {
            AnalyzerMake::HiokiIm3536 => Box::new(Meter::<Hioki>::new(per_command, &mut world)),
            AnalyzerMake::KeysightE4980a => {
                Box::new(Meter::<Lcr<E4980a>>::new(per_command, &mut world))
            }
            AnalyzerMake::Hp4284a => Box::new(Meter::<Lcr<Hp4284a>>::new(per_command, &mut world)),
            AnalyzerMake::TonghuiTh283x => {
                Box::new(Meter::<Lcr<Th2832>>::new(per_command, &mut world))
            }
            AnalyzerMake::KeysightE4990a => Box::new(Meter::<E4990a>::new(per_command, &mut world)),
        };
        let drive = |axis, wiring: AxisWiring| (wiring.unit_id, Drive::new(axis, wiring, &world));
        let units = vec![
            drive(AxisId::Linear, linear.of(wiring.linear)),
            drive(AxisId::Rotary, rotary.of(wiring.rotary)),
        ];
        let bus = Bus::new(TURNAROUND, units);
        let faults = FaultSchedule::new(Stream::new(seed, FAULT_STREAM));
        let echoes = wiring.analyzer == AnalyzerMake::TonghuiTh283x;
        let analyzer = Socket::new(analyzer, echoes);
        let outlets = [Outlet::default(); 2];
        Ok(Self {
            world,
            analyzer,
            bus,
            transport: wiring.transport,
            faults,
            outlets,
            overheard: None,
        })
    }

    /// The world behind the devices.
    pub fn world(&mut self) -> &mut World {
        &mut self.world
    }

    /// A new connection to a port, as the rig is wired.
    pub fn connect(&mut self, port: PortId) -> Connection {
        let connection = match port {
            PortId::Analyzer => {
                Connection { end: End::Analyzer(self.analyzer.plug()), outlet: None }
            }
            PortId::Bus => Self::connect_bus(self.transport, Duration::ZERO),
        };
        Connection { outlet: Some((port, self.outlets[port as usize].pulls)), ..connection }
    }

    /// Pulls a cable, if a device says so: every connection to its port ends.
    fn pull_cable(&mut self, now: RigTime) {
        if let Some((port, absence)) = self.faults.take_pulled() {
            let outlet = &mut self.outlets[port as usize];
            outlet.pulls += 1;
            outlet.empty_until = now + absence;
        }
    }

    /// Whether the cable of a port is plugged in.
    pub fn is_plugged(&self, now: RigTime, port: PortId) -> bool {
        self.outlets[port as usize].empty_until <= now
    }

    fn hang_up_if_pulled(&self, connection: &Connection) -> Result<(), HangUp> {
        let is_pulled = |(port, pulls): (PortId, u64)| self.outlets[port as usize].pulls != pulls;
        if connection.outlet.is_some_and(is_pulled) { Err(HangUp) } else { Ok(()) }
    }

    /// A new connection to the line of the drives by any carrier. `patience` is how long the bytes
    /// of one frame may be torn apart on their way: an operating system has pauses of its own.
    pub(crate) fn connect_bus(transport: LineTransport, patience: Duration) -> Connection {
        Connection { end: End::Bus(BusLine::new(transport, patience)), outlet: None }
    }

    /// Accepts bytes that arrived over a connection at `now`.
    ///
    /// # Errors
    /// [`HangUp`] when the port closes the connection.
    pub fn push(
        &mut self,
        now: RigTime,
        connection: &mut Connection,
        bytes: &[u8],
    ) -> Result<(), HangUp> {
        self.hang_up_if_pulled(connection)?;
        if let Some(overheard) = &mut self.overheard {
            let port = match connection.end {
                End::Analyzer(_) => PortId::Analyzer,
                End::Bus(_) => PortId::Bus,
            };
            overheard.push(Overheard { at: now, port, bytes: bytes.to_vec() });
        }
        let Self { world, analyzer, bus, faults, .. } = self;
        let context = DeviceContext { world, faults };
        match &mut connection.end {
            End::Analyzer(cable) => analyzer.push(now, cable, bytes, context),
            End::Bus(line) => bus.push(now, line, bytes, context),
        }
        .inspect_err(|HangUp| self.pull_cable(now))
    }

    /// Takes the output of a connection up to `now`.
    ///
    /// # Errors
    /// [`HangUp`] when the port closes the connection.
    pub fn poll(&mut self, now: RigTime, connection: &mut Connection) -> Result<Vec<u8>, HangUp> {
        self.hang_up_if_pulled(connection)?;
        let Self { world, analyzer, bus, faults, .. } = self;
        let context = DeviceContext { world, faults };
        match &mut connection.end {
            End::Analyzer(cable) => analyzer.poll(now, cable, context),
            End::Bus(line) => bus.poll(now, line, context),
        }
        .inspect_err(|HangUp| self.pull_cable(now))
    }

    /// Makes the drives and their line answer without delay from now on, for measurements of the time
    /// that everything else takes.
    pub fn answer_at_once(&mut self) {
        self.bus.answer_at_once();
    }

    /// Records the bytes that arrive at the ports from now on. Earlier records are dropped.
    pub fn listen_in(&mut self) {
        self.overheard = Some(Vec::new());
    }

    /// The recorded bytes of the ports, in order.
    pub fn overheard(&self) -> &[Overheard] {
        self.overheard.as_deref().unwrap_or_default()
    }

    /// Schedules a fault for its frame.
    pub fn add_fault(&mut self, fault: Fault) {
        self.faults.add(fault);
    }

    /// Injects a fault into a device: the drive at `unit`, or all devices of the port.
    pub fn apply_fault(
        &mut self,
        now: RigTime,
        port: PortId,
        unit: Option<u8>,
        fault: DeviceFault,
    ) {
        match port {
            PortId::Analyzer => self.analyzer.apply_fault(now, fault, &mut self.world),
            PortId::Bus => self.bus.apply_fault(now, unit, fault, &mut self.world),
        }
    }

    /// A person has homed all drives with their own program, and has brought the axes back.
    pub(crate) fn homed_by_person(&mut self) {
        self.bus.homed_by_person();
    }

    /// Clears all faults: none is scheduled, nothing is jammed or stuck, and every cable is plugged in.
    /// Alarms and lost steps stay.
    pub(crate) fn clear_faults(&mut self, now: RigTime) {
        self.faults.clear();
        self.outlets.iter_mut().for_each(|outlet| outlet.empty_until = RigTime::ZERO);
        self.analyzer.clear_faults();
        self.world.clear_faults(now);
    }
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::{
        faults::{FaultKind, FaultTrigger, ReplyFault, RequestFault},
        modbus::with_checksum,
        scene::matched,
    };

    /// A rig and one exchange at a time with one of its ports.
    struct TestRig {
        rig: Rig,
        analyzer: Connection,
        bus: Connection,
        now: RigTime,
    }

    impl TestRig {
        fn new(transport: LineTransport) -> Self {
            let wiring = Wiring::paper(transport);
            let mut rig = Rig::new(matched(), &wiring, 1).unwrap();
            let (analyzer, bus) = (rig.connect(PortId::Analyzer), rig.connect(PortId::Bus));
            Self { rig, analyzer, bus, now: RigTime::ZERO }
        }

        fn serial() -> Self {
            Self::new(LineTransport::Serial { baud: 115_200 })
        }

        /// The complete answer, and the delay of its first byte.
        fn ask(&mut self, port: PortId, bytes: &[u8]) -> Result<(Vec<u8>, Duration), HangUp> {
            let connection = match port {
                PortId::Analyzer => &mut self.analyzer,
                PortId::Bus => &mut self.bus,
            };
            self.rig.push(self.now, connection, bytes)?;
            let (asked, mut first) = (self.now, None);
            let mut said = self.rig.poll(self.now, connection)?;
            while let Some(deadline) = connection.deadline() {
                self.now = deadline;
                said.extend(self.rig.poll(deadline, connection)?);
                if !said.is_empty() {
                    first.get_or_insert(self.now);
                }
            }
            Ok((said, first.unwrap_or(asked).since(asked)))
        }

        fn add(&mut self, port: PortId, kind: FaultKind) {
            self.rig.add_fault(Fault { port, unit: None, kind, trigger: FaultTrigger::Nth(1) });
        }
    }

    /// Reads the command position of unit 1.
    fn request() -> Vec<u8> {
        with_checksum(&[1, 3, 0, 0xC6, 0, 2])
    }

    #[track_caller]
    fn check(fault: ReplyFault, expected: impl Fn(&[u8], &[u8], &[u8]) -> bool) {
        for (port, request) in [(PortId::Bus, request()), (PortId::Analyzer, b"*IDN?\r\n".to_vec())]
        {
            let mut test = TestRig::serial();
            let (good, _) = test.ask(port, &request).unwrap();
            test.add(port, FaultKind::Reply(fault));
            let (bad, _) = test.ask(port, &request).unwrap();
            assert!(expected(&request, &good, &bad), "{port:?}: {good:02x?} became {bad:02x?}");
            assert_eq!(test.ask(port, &request).unwrap().0, good, "and then all is well");
        }
    }

    #[test]
    fn every_fault_of_a_reply_does_what_its_name_says() {
        let bits = |good: &[u8], bad: &[u8]| -> u32 {
            good.iter().zip(bad).map(|(a, b)| (a ^ b).count_ones()).sum()
        };
        check(ReplyFault::Drop, |_, _, bad| bad.is_empty());
        check(ReplyFault::Duplicate, |_, good, bad| bad == [good, good].concat());
        check(ReplyFault::Corrupt, |_, good, bad| good.len() == bad.len() && bits(good, bad) == 1);
        check(ReplyFault::Truncate, |_, good, bad| bad.len() < good.len() && good.starts_with(bad));
        check(ReplyFault::Noise(5), |_, good, bad| {
            bad.len() == 5 + good.len() && bad.ends_with(good)
        });
        check(ReplyFault::Echo, |request, good, bad| bad == [request, good].concat());
        check(ReplyFault::Delay(Duration::from_secs(1)), |_, good, bad| bad == good);
    }

    #[test]
    fn a_client_gets_no_answer_to_what_another_one_asked() {
        let mut test = TestRig::serial();
        let (identity, _) = test.ask(PortId::Analyzer, b"*IDN?\r\n").unwrap();
        for begun in [&b"*TRG;:MEAS?\r\n"[..], b":FREQ 'abc\r\n", b"*ID"] {
            // The first client closes in the middle of it.
            test.rig.push(test.now, &mut test.analyzer, begun).unwrap();
            test.analyzer = test.rig.connect(PortId::Analyzer);
            let (said, _) = test.ask(PortId::Analyzer, b"*IDN?\r\n").unwrap();
            assert_eq!(said, identity, "after {}", begun.escape_ascii());
        }
    }

    #[test]
    fn a_late_reply_is_late_and_a_reply_from_another_unit_has_its_checksum() {
        let mut test = TestRig::serial();
        let late = Duration::from_millis(300);
        let (good, usual) = test.ask(PortId::Bus, &request()).unwrap();
        test.add(PortId::Bus, FaultKind::Reply(ReplyFault::Delay(late)));
        test.add(PortId::Bus, FaultKind::Reply(ReplyFault::Unit(7)));
        let (bad, delayed) = test.ask(PortId::Bus, &request()).unwrap();
        assert_eq!(delayed, usual + late);
        let mut expected = good[..good.len() - 2].to_vec();
        expected[0] = 7;
        assert_eq!(bad, with_checksum(&expected));
    }

    #[test]
    fn every_fault_of_a_request_keeps_it_from_being_done() {
        // A move of unit 1 by one step of 1 mm.
        let data = [0, 2, 1000, 10_000, 1_000_000, 1_000_000, 1000, 1];
        let mut frame = vec![1, 16, 0, 0x58, 0, 16, 32];
        frame.extend(data.iter().flat_map(|value: &i32| value.to_be_bytes()));
        let frame = with_checksum(&frame);
        let rows = [
            (RequestFault::Drop, Ok(Vec::new())),
            (RequestFault::Exception(6), Ok(with_checksum(&[1, 0x90, 6]))),
            (RequestFault::Disconnect, Err(HangUp)),
        ];
        for (fault, expected) in rows {
            let mut test = TestRig::serial();
            test.add(PortId::Bus, FaultKind::Request(fault));
            assert_eq!(test.ask(PortId::Bus, &frame).map(|said| said.0), expected);
            let start = test.rig.world().truth(test.now).tip_mm;
            test.now = test.now + Duration::from_secs(1);
            assert_eq!(test.rig.world().truth(test.now).tip_mm, start);
            // A lost reply, on the other hand, belongs to a request that was carried out.
            test.add(PortId::Bus, FaultKind::Reply(ReplyFault::Drop));
            assert_eq!(test.ask(PortId::Bus, &frame).unwrap().0, b"");
            test.now = test.now + Duration::from_secs(1);
            let moved = test.rig.world().truth(test.now).tip_mm - start;
            assert!((moved - 1.0).abs() < 0.1, "{moved}");
        }
    }

    #[test]
    fn faults_of_a_drive_show_where_they_should() {
        let mut test = TestRig::serial();
        let apply_fault = |test: &mut TestRig, fault| {
            test.rig.apply_fault(test.now, PortId::Bus, Some(1), fault);
        };
        let alarm = |test: &mut TestRig| {
            test.ask(PortId::Bus, &with_checksum(&[1, 3, 0, 0x80, 0, 2])).unwrap().0[6]
        };
        apply_fault(&mut test, DeviceFault::Alarm(0x30));
        assert_eq!(alarm(&mut test), 0x30);
        apply_fault(&mut test, DeviceFault::LimitSwitch);
        assert_eq!(alarm(&mut test), 0x66);
        let before = test.rig.world().truth(test.now).tip_mm;
        let (counts, _) = test.ask(PortId::Bus, &request()).unwrap();
        apply_fault(&mut test, DeviceFault::LoseSteps(-0.5));
        let lost = before - test.rig.world().truth(test.now).tip_mm;
        assert!((lost - 0.5).abs() < 0.1, "{lost}");
        assert_eq!(test.ask(PortId::Bus, &request()).unwrap().0, counts);
        let before = test.rig.world().truth(test.now).tip_mm;
        apply_fault(&mut test, DeviceFault::Miscount(5.0));
        assert_eq!(before, test.rig.world().truth(test.now).tip_mm);
        assert_ne!(test.ask(PortId::Bus, &request()).unwrap().0, counts);
    }

    #[test]
    fn a_broken_contact_sense_lies_until_its_fault_is_cleared() {
        let mut test = TestRig::serial();
        let set_up = b":TRIG EXT;:FREQ 140;:TRIG:DEL 5;:SPEE FAST;:AVER 256;:PAR1 RS\r\n";
        test.ask(PortId::Analyzer, set_up).unwrap();
        let measure = |test: &mut TestRig| -> f64 {
            let (said, _) = test.ask(PortId::Analyzer, b"*TRG;:MEAS?\r\n").unwrap();
            String::from_utf8(said).unwrap().split(',').nth(1).unwrap().parse().unwrap()
        };
        let free = measure(&mut test);
        test.add(PortId::Analyzer, FaultKind::Device(DeviceFault::StuckContact));
        let stuck = measure(&mut test);
        assert!(stuck / free < 0.5, "{free} {stuck}");
        test.rig.clear_faults(test.now);
        let cleared = measure(&mut test);
        assert!((cleared / free - 1.0).abs() < 0.05, "{free} {cleared}");
    }

    #[test]
    fn modbus_tcp_is_answered_and_what_is_none_is_hung_up_on() {
        let mut test = TestRig::new(LineTransport::Tcp);
        let (said, _) = test.ask(PortId::Bus, &[0, 9, 0, 0, 0, 6, 1, 3, 0, 0x80, 0, 2]).unwrap();
        assert_eq!(said, [0, 9, 0, 0, 0, 7, 1, 3, 4, 0, 0, 0, 0]);
        assert_eq!(test.ask(PortId::Bus, b"GET / HTTP/1.1\r\n"), Err(HangUp));
        test.bus = test.rig.connect(PortId::Bus);
        assert!(test.ask(PortId::Bus, &[0, 1, 0, 0, 0, 6, 1, 3, 0, 0x80, 0, 2]).is_ok());
    }

    #[test]
    fn clients_do_not_get_each_others_answers() {
        let mut test = TestRig::serial();
        let mut second = Rig::connect_bus(LineTransport::Tcp, Duration::ZERO);
        test.rig.push(test.now, &mut test.bus, &request()).unwrap();
        test.rig.push(test.now, &mut second, &[0, 1, 0, 0, 0, 6, 1, 3, 0, 0x80, 0, 2]).unwrap();
        let later = test.now + Duration::from_secs(1);
        assert_eq!(test.rig.poll(later, &mut test.bus).unwrap().len(), 9);
        assert_eq!(test.rig.poll(later, &mut second).unwrap().len(), 13);
    }

    #[test]
    fn a_client_that_measures_for_long_keeps_no_other_from_identifying_the_analyzer() {
        const IDENTITY: &[u8] = b"HIOKI,IM3536,190512345,V1.21\r\n";
        let mut test = TestRig::serial();
        let mut second = test.rig.connect(PortId::Analyzer);
        let measure = b":TRIG EXT;:TRIG:DEL 9;:FREQ 100;*TRG;:MEAS?\n";
        test.rig.push(test.now, &mut test.analyzer, measure).unwrap();
        let long = test.analyzer.deadline().expect("it measures");
        assert!(long.since(test.now) > Duration::from_secs(8));
        let soon = test.now + Duration::from_millis(100);
        test.rig.push(soon, &mut second, b"*IDN?\n:FREQ 200;:FREQ?\n").unwrap();
        let answered = soon + Duration::from_millis(100);
        assert_eq!(test.rig.poll(answered, &mut second).unwrap(), IDENTITY);
        // The frequency waits, and the measurement is that of the first client.
        let done = long + Duration::from_secs(1);
        assert_eq!(test.rig.poll(done, &mut second).unwrap(), b"2.0000E+02\r\n");
        let said = test.rig.poll(done, &mut test.analyzer).unwrap();
        let fields = String::from_utf8(said).unwrap();
        assert_eq!(fields.split(',').count(), 3, "{fields}");
    }
}
