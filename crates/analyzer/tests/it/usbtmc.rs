//! The simulated E4980A on USB: behind a socket that keeps the bounds of messages, in real time.

use std::{path::PathBuf, time::Duration};

use rig_analyzer::{Analyzer, AnalyzerError, Dialect, TransportSettings};
use rig_files::instrument::{KEYSIGHT_E4980A, TONGHUI_TH283X};
use rig_link::{Clock, Endpoint, LineError, Port, StopSignal};
use rig_model::{AnalyzerMake, DriveLevel, Reading, SweepPoint};
use rig_sim::{
    LineTransport, SimRig, Wiring, control,
    scene::matched,
    serve::Server,
    world::{Nuisances, Scene},
};

/// Longer than any answer takes, on a computer that is busy with other things.
const PATIENCE: Duration = Duration::from_secs(20);

/// Tries of what a busy computer may hold up.
const TRIES: usize = 20;

/// A served bench without nuisances. Its socket is removed with it.
struct Bench {
    rig: SimRig,
    _server: Server,
    directory: PathBuf,
}

impl Bench {
    fn new(name: &str, model: AnalyzerMake) -> Self {
        let name = format!("rig-analyzer-usbtmc-{}-{name}", std::process::id());
        let directory = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&directory).unwrap();
        let transport = LineTransport::Serial { baud: 115_200 };
        let wiring = Wiring { analyzer: model, ..Wiring::paper(transport) };
        let scene = Scene { nuisances: Nuisances::NONE, ..matched() };
        let rig = SimRig::start(scene, &wiring, 1).unwrap();
        let mut server = Server::new(rig.handle());
        server.open_usbtmc(&directory.join("usbtmc0")).unwrap();
        Self { rig, _server: server, directory }
    }

    async fn analyzer(&self, dialect: &'static Dialect) -> Analyzer {
        self.analyzer_within(dialect, PATIENCE).await
    }

    async fn analyzer_within(&self, dialect: &'static Dialect, reply_within: Duration) -> Analyzer {
        let path = self.directory.join("usbtmc0").to_str().unwrap().to_owned();
        let port = Port::open(Endpoint::Usbtmc { path }, Clock::start()).await.unwrap();
        let settings = TransportSettings { reply_within, ..TransportSettings::default() };
        Analyzer::open_with(port, dialect, settings)
    }

    fn fault(&self, what: &str) {
        self.rig.handle().with(|now, rig| {
            control::execute(now, rig, &format!("fault analyzer {what}")).unwrap();
        });
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        _ = std::fs::remove_dir_all(&self.directory);
    }
}

fn sweep() -> Vec<SweepPoint> {
    let points = [130.0, 135.0, 138.0, 140.0, 141.3, 143.0, 150.0];
    points.map(|frequency_hz| SweepPoint { frequency_hz, settle_s: 0.02, cycles: 2 }).to_vec()
}

/// Sets an analyzer up and measures; again if the computer was held up, of which the driver tells.
async fn sweep_of(analyzer: &mut Analyzer) -> Result<Vec<Reading>, AnalyzerError> {
    for _ in 1..TRIES {
        match try_sweep(analyzer).await {
            Err(AnalyzerError::HeldUp { .. }) => {}
            done => return done,
        }
    }
    try_sweep(analyzer).await
}

async fn try_sweep(analyzer: &mut Analyzer) -> Result<Vec<Reading>, AnalyzerError> {
    analyzer.configure(DriveLevel { volt: 1.0 }).await?;
    analyzer.measure(&sweep(), &StopSignal::new()).await
}

#[tokio::test]
async fn an_e4980a_is_identified_and_sweeps_over_usb() {
    let bench = Bench::new("sweep", AnalyzerMake::KeysightE4980a);
    let mut analyzer = bench.analyzer(&KEYSIGHT_E4980A).await;
    let readings = sweep_of(&mut analyzer).await.unwrap();
    let frames = analyzer.transcript().frames();
    assert!(frames.iter().any(|frame| frame.bytes.starts_with(b"Keysight Technologies,E4980A,")));
    let found: Vec<f64> = readings.iter().map(|reading| reading.frequency_hz).collect();
    let asked: Vec<f64> = sweep().iter().map(|point| point.frequency_hz).collect();
    assert_eq!(found, asked);
    for reading in &readings {
        // The sensor is a capacitor of some ten nanofarads, but for its resonance.
        let reactance_ohm = reading.impedance().unwrap().reactance_ohm;
        assert!((-1e6..-1e4).contains(&reactance_ohm), "{reading:?}");
    }
}

#[tokio::test]
async fn a_lost_answer_is_asked_for_again_after_a_device_clear() {
    for fault in ["drop-reply nth=2", "truncate nth=2"] {
        let bench = Bench::new(&fault[..4], AnalyzerMake::KeysightE4980a);
        let within = Duration::from_secs(1);
        let mut analyzer = bench.analyzer_within(&KEYSIGHT_E4980A, within).await;
        sweep_of(&mut analyzer).await.unwrap();
        let before = analyzer.health().read();
        bench.fault(fault);
        let readings = sweep_of(&mut analyzer).await.unwrap();
        assert_eq!(readings.len(), sweep().len());
        let after = analyzer.health().read();
        // A computer that is busy with other things may repeat more.
        assert!(before.retries < after.retries, "{fault}: {before:?} {after:?}");
        assert!(before.late + before.corrupt < after.late + after.corrupt, "{fault}");
    }
}

#[tokio::test]
async fn an_unplugged_instrument_is_found_again_and_identified() {
    let bench = Bench::new("unplug", AnalyzerMake::KeysightE4980a);
    let mut analyzer = bench.analyzer(&KEYSIGHT_E4980A).await;
    sweep_of(&mut analyzer).await.unwrap();
    bench.fault("disconnect");
    let error = sweep_of(&mut analyzer).await.unwrap_err();
    let is_lost = matches!(&error, AnalyzerError::Line { source: LineError::Lost { .. }, .. });
    assert!(is_lost, "{error:?}");
    let readings = sweep_of(&mut analyzer).await.unwrap();
    assert_eq!(readings.len(), sweep().len());
}

/// The instrument of this dialect echoes on its serial interface. On USB a character would be a message.
#[tokio::test]
async fn a_message_goes_whole_to_an_instrument_that_echoes_on_a_line() {
    let bench = Bench::new("echo", AnalyzerMake::TonghuiTh283x);
    let mut analyzer = bench.analyzer(&TONGHUI_TH283X).await;
    // The simulated instrument echoes here too, which is no answer.
    analyzer.identify().await.unwrap_err();
    let sent: Vec<String> =
        analyzer.transcript().frames().iter().map(ToString::to_string).collect();
    assert!(sent[0].ends_with("-> *CLS;*IDN?\\n"), "{sent:#?}");
}
