//! An analyzer that the project does not know, by its file alone.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex},
    time::Duration,
};

use rig_analyzer::{Analyzer, AnalyzerError, Dialect};
use rig_link::{Clock, Port, StopSignal};
use rig_model::{DriveLevel, ReadingFlag, SweepPoint};
use tokio::{io::duplex, time::Instant};

use crate::peer::{Instrument, Reaction, serve_ending_in};

const BRIDGE: &str = include_str!("../../../files/src/instrument/tests/bridge.toml");

/// A bridge with 5 Ω at −53.13°, which is 3 − 4i Ω.
#[derive(Debug, Clone)]
struct Bridge {
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
struct State {
    frequency: String,
    level: String,
    /// When the measurement is over; never, for one that hangs.
    over_at: Option<Instant>,
    hangs: bool,
    status: u8,
    seen: Vec<String>,
}

impl Bridge {
    fn new() -> Self {
        let state = State {
            frequency: "1000".to_owned(),
            level: "1".to_owned(),
            over_at: None,
            hangs: false,
            status: 0,
            seen: Vec::new(),
        };
        Self { state: Arc::new(Mutex::new(state)) }
    }

    fn seen(&self) -> Vec<String> {
        std::mem::take(&mut self.state.lock().unwrap().seen)
    }
}

impl State {
    /// The answer to a unit, if it is a question.
    fn unit(&mut self, unit: &str) -> Option<String> {
        let unit = unit.trim_start_matches(':');
        let (head, data) = unit.split_once(' ').unwrap_or((unit, ""));
        match head {
            "FREQ" => data.trim_end_matches("HZ").clone_into(&mut self.frequency),
            "VOLT" => data.clone_into(&mut self.level),
            "TRIG" => {
                let over_at = Instant::now() + Duration::from_millis(300);
                self.over_at = (!self.hangs).then_some(over_at);
            }
            "*IDN?" => return Some("Example Instruments,LB-1,7,1.0".to_owned()),
            "*ESR?" => return Some("0".to_owned()),
            "FREQ?" => return Some(self.frequency.clone()),
            "VOLT?" => return Some(self.level.clone()),
            "STAT:OPER?" => {
                let is_over = self.over_at.is_some_and(|over_at| over_at <= Instant::now());
                return Some(if is_over { "+48" } else { "+32" }.to_owned());
            }
            "FETC?" => return Some(format!("5.00000E+00,-5.3130102E+01,{}", self.status)),
            _ => {}
        }
        None
    }
}

impl Instrument for Bridge {
    fn message(&mut self, message: &str) -> Reaction {
        let mut state = self.state.lock().unwrap();
        state.seen.push(message.to_owned());
        let answers: Vec<_> = message.split(';').filter_map(|unit| state.unit(unit)).collect();
        let answer = (!answers.is_empty()).then(|| answers.join(";"));
        Reaction { answer, ..Reaction::default() }
    }

    fn restart(&mut self) {}
}

fn open(bridge: &Bridge) -> Analyzer {
    let (host, device) = duplex(4096);
    tokio::spawn(serve_ending_in(b"\n", device, bridge.clone(), BTreeMap::new()));
    let dialect = Dialect::read_and_keep("bridge.toml", BRIDGE).unwrap();
    Analyzer::open(Port::new("bridge", host, None, Clock::start()), dialect)
}

const POINT: SweepPoint = SweepPoint { frequency_hz: 140.0, settle_s: 0.25, cycles: 10 };

#[tokio::test(start_paused = true)]
async fn an_analyzer_measures_by_its_file_alone() {
    let bridge = Bridge::new();
    let mut analyzer = open(&bridge);
    assert_eq!(analyzer.identify().await.unwrap().model, "LB-1");
    analyzer.configure(DriveLevel { volt: 2.5 }).await.unwrap();
    let setup = bridge.seen();
    assert_eq!(
        setup[setup.len() - 3..],
        ["FUNC ZTD;:RANG:AUTO ON;*ESR?", "VOLT 2.500;*ESR?", "VOLT?;*ESR?"]
    );
    let readings = analyzer.measure(&[POINT], &StopSignal::new()).await.unwrap();
    let value = readings[0].impedance().unwrap();
    assert!((value.resistance_ohm - 3.0).abs() < 1e-6, "{value:?}");
    assert!((value.reactance_ohm + 4.0).abs() < 1e-6, "{value:?}");
    let seen = bridge.seen();
    assert_eq!(seen[0], "FREQ 140HZ;:AVER 10;:TRIG:DEL 0.2500;:TRIG;*ESR?");
    assert_eq!(seen.last().unwrap(), "FETC?;:FREQ?;*ESR?");
    // 0.25 s of delay and 71 ms of cycles are over before the first question, 300 ms after the trigger.
    assert_eq!(&seen[1..seen.len() - 1], ["STAT:OPER?"]);
}

#[tokio::test(start_paused = true)]
async fn its_status_is_read_as_the_file_says() {
    let rows = [(0, None), (2, Some(ReadingFlag::LowSignal)), (9, Some(ReadingFlag::Overload))];
    for (status, flag) in rows {
        let bridge = Bridge::new();
        bridge.state.lock().unwrap().status = status;
        let mut analyzer = open(&bridge);
        analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
        let readings = analyzer.measure(&[POINT], &StopSignal::new()).await.unwrap();
        assert_eq!(readings.last().unwrap().flag(), flag, "{status}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_measurement_that_never_ends_is_an_error_after_the_time_of_the_file() {
    let bridge = Bridge::new();
    bridge.state.lock().unwrap().hangs = true;
    let mut analyzer = open(&bridge);
    analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
    let begun = Instant::now();
    let error = analyzer.measure(&[POINT], &StopSignal::new()).await.unwrap_err();
    assert!(matches!(error, AnalyzerError::Answer { .. }), "{error}");
    // Three attempts.
    let seconds = begun.elapsed().as_secs_f64();
    assert!((90.0..110.0).contains(&seconds), "{seconds} s");
}
