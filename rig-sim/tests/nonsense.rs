//! No message of a client may crash a simulated instrument.
//!
//! The messages are half valid: requests with right checksums at existing addresses, and words that
//! the instruments know. Pure noise would be refused too early.

#![expect(clippy::unwrap_used, reason = "a test may fail, also in what its tests share")]

use std::time::Duration;

use rig_model::{AnalyzerMake, DriveMake, RigTime, random::Stream};
use rig_sim::{AxisWiring, Connection, LineTransport, PortId, Rig, Wiring, scene};

const SEED: u64 = 2020;

struct Chance(Stream);

impl Chance {
    fn below(&mut self, bound: u64) -> u64 {
        self.0.below(usize::try_from(bound).unwrap()) as u64
    }

    fn pick<T: Copy>(&mut self, among: &[T]) -> T {
        among[usize::try_from(self.below(among.len() as u64)).unwrap()]
    }

    /// A number as devices meet them: small, at a border, or anything.
    fn word(&mut self) -> u16 {
        let any = u16::try_from(self.below(1 << 16)).unwrap();
        self.pick(&[0, 1, 2, 0x10, 0x20, 0x7FFF, 0x8000, 0xFFFF, any, any])
    }
}

fn rig(analyzer: AnalyzerMake, drive: DriveMake) -> Rig {
    let axis = |unit_id| AxisWiring::new(drive, unit_id, 0.01);
    let transport = LineTransport::Serial { baud: 115_200 };
    let wiring = Wiring { analyzer, linear: axis(1), rotary: axis(2), transport };
    let mut rig = Rig::new(scene::matched(), &wiring, SEED).unwrap();
    rig.world().place_sample(RigTime::ZERO, "3").unwrap();
    rig
}

/// Lets time pass until nothing more is due, or a while.
fn settle(rig: &mut Rig, connection: &mut Connection, now: &mut RigTime) -> Vec<u8> {
    let mut said = rig.poll(*now, connection).unwrap();
    for _ in 0..100 {
        let Some(deadline) = connection.deadline() else { break };
        *now = (*now).max(deadline);
        said.extend(rig.poll(*now, connection).unwrap());
    }
    said
}

fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |sum, byte| {
        (0..8).fold(
            sum ^ u16::from(*byte),
            |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0xA001 } else { sum >> 1 },
        )
    })
}

/// A request with a valid frame and any content.
fn request(chance: &mut Chance, addresses: &[u16]) -> Vec<u8> {
    let address = chance.pick(addresses).wrapping_add(u16::try_from(chance.below(12)).unwrap());
    let mut frame = vec![
        chance.pick(&[0, 1, 1, 1, 2, 9]),
        chance.pick(&[1, 2, 3, 3, 4, 5, 6, 8, 15, 16, 16, 16, 22, 23, 0x2B]),
    ];
    frame.extend(address.to_be_bytes());
    match frame[1] {
        5 => frame.extend(chance.pick(&[0xFF00_u16, 0, 1]).to_be_bytes()),
        16 => {
            let count = u8::try_from(1 + chance.below(16)).unwrap();
            frame.extend([0, count, 2 * count]);
            for _ in 0..count {
                frame.extend(chance.word().to_be_bytes());
            }
        }
        23 => frame.extend([0, 2, frame[2], frame[3], 0, 1, 2, 0, 1]),
        22 => frame.extend([0, 0, 0, 1]),
        15 => frame.extend([0, 3, 1, 5]),
        0x2B => frame.extend([0]),
        6 | 8 => frame.extend(chance.word().to_be_bytes()),
        _ => frame.extend(chance.pick(&[0_u16, 1, 2, 10, 125, 126, 0xFFFF]).to_be_bytes()),
    }
    let sum = checksum(&frame);
    frame.extend(sum.to_le_bytes());
    frame
}

#[test]
fn no_request_brings_a_drive_down_and_every_answer_has_its_checksum() {
    let maps: [(DriveMake, &[u16]); 3] = [
        (
            DriveMake::OrientalAz,
            &[0x0058, 0x0078, 0x007C, 0x0080, 0x00C6, 0x0120, 0x0178, 0x0386, 0xFFF8],
        ),
        (DriveMake::IaiRc, &[0x0100, 0x0400, 0x0420, 0x0500, 0x9000, 0x9900, 0xFFF8]),
        (
            DriveMake::LeadshinePr,
            &[0x0001, 0x000F, 0x1003, 0x1046, 0x1801, 0x2203, 0x6000, 0x602C, 0x6200],
        ),
    ];
    for (model, addresses) in maps {
        let mut chance = Chance(Stream::new(SEED, 1));
        let mut rig = rig(AnalyzerMake::HiokiIm3536, model);
        let mut bus = rig.connect(PortId::Bus);
        let (mut now, mut answers) = (RigTime::ZERO, 0);
        for round in 0..20_000 {
            let mut bytes = request(&mut chance, addresses);
            if chance.below(20) == 0 {
                let at = usize::try_from(chance.below(bytes.len() as u64)).unwrap();
                bytes[at] ^= 1 << chance.below(8);
            }
            rig.push(now, &mut bus, &bytes).unwrap();
            let said = settle(&mut rig, &mut bus, &mut now);
            if !said.is_empty() {
                answers += 1;
                assert_eq!(checksum(&said), 0, "{model:?} round {round}: {bytes:02x?} {said:02x?}");
            }
            now = now + Duration::from_millis(chance.below(500));
        }
        assert!(answers > 10_000, "{model:?}: {answers} answers");
        assert!(rig.world().truth(now).tip_mm.is_finite());
    }
}

/// Headers of one make or another.
const WORDS: &[&str] = &[
    "*RST",
    "*TRG",
    "*OPC",
    "*OPC?",
    "*WAI",
    "*ESR?",
    "*CLS",
    "*IDN?",
    ":FREQ",
    ":FREQuency",
    ":FREQ?",
    ":VOLT",
    ":LEV:VOLT",
    ":AVER",
    ":SPEE",
    ":APER",
    ":TRIG",
    ":TRIG:DEL",
    ":TRIG:SOUR",
    ":TRIG:SING",
    ":MEAS?",
    ":MEAS:VAL",
    ":FETC?",
    ":INIT",
    ":INIT1:CONT",
    ":SENS1:FREQ:STAR",
    ":SENS1:FREQ:SPAN",
    ":SENS1:SWE:POIN",
    ":CALC1:DATA:FDAT?",
    ":CALC1:PAR1:DEF",
    ":PAR1",
    ":PAR1?",
    ":DISP:PAGE",
    ":LIST:FREQ",
    ":FUNC:IMP",
    ":FORM:ASC:LONG",
    ":HEAD",
    ":ABOR",
    ":SYST:ERR?",
    ":SYST:PRES",
    "STAR",
    "STOP",
];

/// Their possible arguments.
const DATA: &[&str] = &[
    "", "0", "1", "-1", "1E400", "140", "1e-9", "9.99e99", "20,30,40", "ON", "OFF", "MAX", "MIN",
    "BUS", "EXT", "INT", "FAST", "SLOW2", "SHOR,4", "RX", "Z", "LIST", "MEAS", "\"text\"", "#15ab",
    "100HZ", "5MV", "(@1)", "#H1F",
];

#[test]
fn no_message_brings_an_analyzer_down_and_it_still_knows_its_name() {
    let models = [
        AnalyzerMake::HiokiIm3536,
        AnalyzerMake::KeysightE4980a,
        AnalyzerMake::Hp4284a,
        AnalyzerMake::TonghuiTh283x,
        AnalyzerMake::KeysightE4990a,
    ];
    for model in models {
        let mut chance = Chance(Stream::new(SEED, 2));
        let mut rig = rig(model, DriveMake::OrientalAz);
        let mut analyzer = rig.connect(PortId::Analyzer);
        let (mut now, mut spoke) = (RigTime::ZERO, 0);
        for _ in 0..10_000 {
            let mut line = String::new();
            for _ in 0..=chance.below(2) {
                line += chance.pick(WORDS);
                line += chance.pick(&[" ", " ", "", "\t"]);
                let data = chance.pick(DATA);
                line += chance.pick(&["", data]);
                line += chance.pick(&[";", ";", ",", "", ":"]);
            }
            line += chance.pick(&["\n", "\r\n", "\n", ""]);
            rig.push(now, &mut analyzer, line.as_bytes()).unwrap();
            spoke += u32::from(!settle(&mut rig, &mut analyzer, &mut now).is_empty());
            now = now + Duration::from_millis(chance.below(2000));
        }
        assert!(spoke > 50, "{model:?} spoke {spoke} times");
        // Every operation has ended.
        rig.push(now, &mut analyzer, b"\n*RST\n").unwrap();
        for _ in 0..100 {
            settle(&mut rig, &mut analyzer, &mut now);
        }
        rig.push(now, &mut analyzer, b"*CLS\n*IDN?\n").unwrap();
        let said = String::from_utf8(settle(&mut rig, &mut analyzer, &mut now)).unwrap();
        assert!(said.matches(',').count() >= 3, "{model:?}: {said:?}");
    }
}
