//! The relatives of the E4980A: the extra commands of each.

use std::{
    sync::{Arc, Mutex},
    time::Duration,
};

use rig_analyzer::{Analyzer, AnalyzerError, Dialect};
use rig_files::instrument::{HP_4284A, TONGHUI_TH283X};
use rig_link::{Clock, Endpoint, Port, StopSignal, Transport};
use rig_model::{DriveLevel, LineSettings, Parity, Reading, ReadingFlag, StopBits, SweepPoint};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex},
    sync::mpsc::unbounded_channel,
    time::sleep,
};

/// What distinguishes a meter of the family.
#[derive(Debug, Clone, Copy)]
struct Make {
    identity: &'static str,
    options: &'static str,
    /// Echoes each character, and drops characters that arrive before the echo.
    echoes: bool,
    /// How often a measurement is not ready yet when it is asked for.
    not_ready: usize,
    /// The frequencies that it has.
    spots_hz: Option<[f64; 3]>,
    status: i32,
    /// Number of the message before which it is switched off and on again.
    restarts_at: Option<usize>,
}

const TH2832: Make = Make {
    identity: "Tonghui,TH2832,W1234567,V1.0.3",
    options: "0",
    echoes: true,
    not_ready: 2,
    spots_hz: None,
    status: 0,
    restarts_at: None,
};

const HP4284A: Make = Make {
    identity: "HEWLETT-PACKARD,4284A,2940J12345,REV01.20",
    options: "001,002",
    echoes: false,
    not_ready: 0,
    spots_hz: Some([139.5, 140.2, 141.0]),
    status: 0,
    restarts_at: None,
};

/// A meter as these tests understand its manual: it takes every setting, and answers questions.
struct Meter {
    make: Make,
    frequency_hz: f64,
    level_v: f64,
    not_ready: usize,
    has_restarted: bool,
    messages: Arc<Mutex<Vec<String>>>,
}

impl Meter {
    fn message(&mut self, message: &str) -> Option<String> {
        let mut messages = self.messages.lock().unwrap();
        if self.make.restarts_at == Some(messages.len()) {
            (self.level_v, self.has_restarted) = (1.0, true);
        }
        messages.push(message.to_owned());
        drop(messages);
        let answers: Vec<String> = message.split(';').filter_map(|unit| self.unit(unit)).collect();
        (!answers.is_empty()).then(|| answers.join(";"))
    }

    fn unit(&mut self, unit: &str) -> Option<String> {
        let (header, data) = unit.split_once(' ').unwrap_or((unit, ""));
        match header {
            ":FREQuency" | ":FREQ" => {
                let asked_hz: f64 = data.parse().unwrap();
                let off = |hz: &f64| (hz - asked_hz).abs();
                let nearest = |spots: [f64; 3]| {
                    spots.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
                };
                self.frequency_hz = self.make.spots_hz.map_or(asked_hz, nearest);
            }
            ":VOLTage" | ":VOLT" => self.level_v = data.parse().unwrap(),
            ":TRIGger" | ":TRIG" => self.not_ready = self.make.not_ready,
            "*IDN?" => return Some(self.make.identity.to_owned()),
            "*OPT?" => return Some(self.make.options.to_owned()),
            "*ESR?" => {
                let has_restarted = std::mem::take(&mut self.has_restarted);
                return Some(if has_restarted { "128" } else { "0" }.to_owned());
            }
            ":FREQuency?" | ":FREQ?" => return Some(format!("{:+.5E}", self.frequency_hz)),
            ":VOLTage?" | ":VOLT?" => return Some(format!("{:+.5E}", self.level_v)),
            ":FETCh?" | ":FETC?" if 0 < self.not_ready => {
                self.not_ready -= 1;
                return Some("+9.90000E+37,+9.90000E+37,-1".to_owned());
            }
            ":FETCh?" | ":FETC?" => {
                let (frequency_hz, status) = (self.frequency_hz, self.make.status);
                return Some(format!("{frequency_hz:+.5E},{:+.5E},{status:+}", -frequency_hz));
            }
            _ => {}
        }
        None
    }

    async fn serve(mut self, mut io: DuplexStream) {
        let mut line = Vec::new();
        while let Ok(byte) = io.read_u8().await {
            if self.make.echoes {
                let mut early = [0; 64];
                sleep(Duration::from_micros(200)).await;
                // Characters that arrived before the echo are lost.
                _ = tokio::time::timeout(Duration::ZERO, io.read(&mut early)).await;
                if io.write_u8(byte).await.is_err() {
                    return;
                }
            }
            line.push(byte);
            if byte == b'\n' {
                let message = String::from_utf8(std::mem::take(&mut line)).unwrap();
                if let Some(answer) = self.message(message.trim_end())
                    && io.write_all(format!("{answer}\n").as_bytes()).await.is_err()
                {
                    return;
                }
            }
        }
    }
}

type Messages = Arc<Mutex<Vec<String>>>;

/// An analyzer whose cable can be pulled and plugged into the next of these meters.
async fn analyzer_on(makes: Vec<Make>, dialect: &'static Dialect) -> (Analyzer, Messages, Pull) {
    let messages = Messages::default();
    let (sockets, mut plugged) = unbounded_channel();
    let (pull, mut pulled) = unbounded_channel::<()>();
    let meters_heard = messages.clone();
    tokio::spawn(async move {
        for make in makes {
            let messages = meters_heard.clone();
            let meter = Meter {
                make,
                frequency_hz: 1e3,
                level_v: 1.0,
                not_ready: 0,
                has_restarted: false,
                messages,
            };
            let Some(io) = plugged.recv().await else { return };
            tokio::select! {
                () = meter.serve(io) => return,
                Some(()) = pulled.recv() => {}
            }
        }
    });
    let plug = Box::new(move || {
        let (host, device) = duplex(1024);
        sockets.send(device).ok()?;
        Some(Box::new(host) as Box<dyn Transport>)
    });
    let line = Some(LineSettings { baud: 9600, parity: Parity::None, stop_bits: StopBits::One });
    let endpoint = Endpoint::Memory { name: "line 2".into(), line, plug };
    let port = Port::open(endpoint, Clock::start()).await.unwrap();
    (Analyzer::open(port, dialect), messages, pull)
}

type Pull = tokio::sync::mpsc::UnboundedSender<()>;

#[track_caller]
fn resistance_ohm(reading: &Reading) -> f64 {
    reading.impedance().unwrap().resistance_ohm
}

#[track_caller]
fn reactance_ohm(reading: &Reading) -> f64 {
    reading.impedance().unwrap().reactance_ohm
}

fn point(frequency_hz: f64) -> SweepPoint {
    SweepPoint { frequency_hz, settle_s: 0.1, cycles: 20 }
}

#[tokio::test(start_paused = true)]
async fn a_tonghui_gets_short_words_one_character_at_a_time_and_is_asked_until_it_is_ready() {
    let (mut analyzer, messages, _pull) = analyzer_on(vec![TH2832], &TONGHUI_TH283X).await;
    analyzer.identify().await.unwrap();
    analyzer.configure(DriveLevel { volt: 1.5 }).await.unwrap();
    let stop = StopSignal::new();
    let readings = analyzer.measure(&[point(140.0), point(141.5)], &stop).await.unwrap();
    let found: Vec<(f64, f64)> =
        readings.iter().map(|one| (resistance_ohm(one), reactance_ohm(one))).collect();
    assert_eq!(found, [(140.0, -140.0), (141.5, -141.5)]);
    assert_eq!(readings[1].flag(), None);
    let messages = messages.lock().unwrap();
    let tail: Vec<&str> = messages[messages.len() - 3..].iter().map(String::as_str).collect();
    let trigger = ":FREQ 141.5;:TRIG;:FETC?;:FREQ?;*ESR?";
    assert_eq!(tail, [trigger, ":FETC?", ":FETC?"]);
}

#[tokio::test(start_paused = true)]
async fn an_old_hp_measures_at_its_own_frequencies_and_drives_more_with_its_option() {
    let (mut analyzer, messages, _pull) = analyzer_on(vec![HP4284A], &HP_4284A).await;
    analyzer.identify().await.unwrap();
    analyzer.configure(DriveLevel { volt: 5.0 }).await.unwrap();
    assert!(messages.lock().unwrap().iter().any(|said| said.contains(":OUTPut:HPOWer ON")));
    let stop = StopSignal::new();
    let readings = analyzer.measure(&[point(140.0)], &stop).await.unwrap();
    assert_eq!((readings[0].frequency_hz, resistance_ohm(&readings[0])), (140.2, 140.2));
    let error = analyzer.measure(&[point(150.0)], &stop).await.unwrap_err();
    assert_eq!(error.to_string(), "line 2: frequency in Hz: asked for 150, found 141");

    let plain = Make { options: "002", ..HP4284A };
    let (mut analyzer, ..) = analyzer_on(vec![plain], &HP_4284A).await;
    let error = analyzer.configure(DriveLevel { volt: 5.0 }).await.unwrap_err();
    assert_eq!(error.to_string(), "hp-4284a: level in V 5 is outside [0.005, 2]");
}

#[tokio::test(start_paused = true)]
async fn what_the_status_says_is_carried_on() {
    for (status, flag) in [(1, ReadingFlag::Overload), (3, ReadingFlag::LowSignal)] {
        let (mut analyzer, ..) = analyzer_on(vec![Make { status, ..HP4284A }], &HP_4284A).await;
        analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
        let readings = analyzer.measure(&[point(140.2)], &StopSignal::new()).await.unwrap();
        assert_eq!(readings.len(), 3, "{readings:?}");
        for reading in readings {
            assert_eq!(reading.flag(), Some(flag));
            assert_eq!(reading.impedance().is_none(), flag == ReadingFlag::Overload);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_analyzer_that_was_unplugged_is_identified_before_it_is_used_again() {
    let other = Make { identity: "HEWLETT-PACKARD,4284A,2940J99999,REV01.20", ..HP4284A };
    let makes = vec![HP4284A, HP4284A, other];
    let (mut analyzer, messages, pull) = analyzer_on(makes, &HP_4284A).await;
    analyzer.identify().await.unwrap();
    analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
    let stop = StopSignal::new();
    analyzer.measure(&[point(140.2)], &stop).await.unwrap();

    pull.send(()).unwrap();
    tokio::task::yield_now().await;
    let error = analyzer.measure(&[point(141.0)], &stop).await.unwrap_err();
    assert!(matches!(error, AnalyzerError::Line { .. }), "{error:?}");
    let before = messages.lock().unwrap().len();
    let readings = analyzer.measure(&[point(141.0)], &stop).await.unwrap();
    assert_eq!(resistance_ohm(&readings[0]), 141.0);
    // Who it is, then its settings, then the measurement.
    let said: Vec<String> = messages.lock().unwrap()[before..].to_vec();
    assert_eq!(said[0], "*CLS;*IDN?");
    assert!(said.iter().any(|said| said.contains(":VOLTage 1")), "{said:?}");

    pull.send(()).unwrap();
    tokio::task::yield_now().await;
    assert!(analyzer.measure(&[point(141.0)], &stop).await.is_err());
    let error = analyzer.measure(&[point(141.0)], &stop).await.unwrap_err();
    assert!(matches!(error, AnalyzerError::Swapped { .. }), "{error:?}");
}

/// Its power-on level is another one, and the reading of its status has forgotten that it was switched on.
#[tokio::test(start_paused = true)]
async fn a_meter_that_restarts_in_a_stream_is_set_up_again() {
    let level = DriveLevel { volt: 2.0 };
    let ready = async |make: Make| {
        let (mut analyzer, messages, pull) = analyzer_on(vec![make], &HP_4284A).await;
        analyzer.identify().await.unwrap();
        analyzer.configure(level).await.unwrap();
        (analyzer, messages, pull)
    };
    let before = ready(HP4284A).await.1.lock().unwrap().len();
    let (mut analyzer, messages, _pull) =
        ready(Make { restarts_at: Some(before), ..HP4284A }).await;
    let (point, stop) =
        (SweepPoint { frequency_hz: 140.2, settle_s: 0.0, cycles: 2 }, StopSignal::new());
    let streamed = analyzer.stream(&point, &stop, |_| ()).await;
    assert!(matches!(streamed, Err(AnalyzerError::Restarted { .. })), "{streamed:?}");
    analyzer.configure(level).await.unwrap();
    analyzer.measure(&[point], &stop).await.unwrap();
    let messages = messages.lock().unwrap();
    let sets_level = |message: &String| message.contains(":VOLT") && !message.contains(":VOLTage?");
    assert!(messages[..before].iter().any(sets_level), "{messages:?}");
    assert!(messages[before..].iter().any(sets_level), "{messages:?}");
}
