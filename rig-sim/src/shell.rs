//! The simulated rig on tokio's clock, its ports served on any stream of bytes.

use std::{
    io,
    pin::Pin,
    sync::{Arc, Mutex, MutexGuard},
    task::{Context, Poll},
    time::Duration,
};

use rig_model::{Orientation, RigTime};
use tokio::{
    io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, DuplexStream, ReadBuf, duplex},
    sync::Notify,
    task::JoinSet,
    time::{Instant, sleep_until},
};

use crate::{
    person::Person,
    rig::{Connection, Rig},
    wiring::{PortId, Wiring},
    world::{NoSuchSample, Scene, SceneError, Truth, Violation},
};

/// Bytes that a pipe holds: more than the longest answer.
const PIPE_BYTES: usize = 64 * 1024;

/// A running simulated rig. It ends when it is dropped.
#[derive(Debug)]
pub struct SimRig {
    handle: SimHandle,
    ports: JoinSet<()>,
}

/// A handle of a running rig, with which its ports are served and faults are injected.
#[derive(Debug, Clone)]
pub struct SimHandle {
    rig: Arc<Mutex<Rig>>,
    /// Notified after each message of a client of the analyzer: it may change the wait of another.
    spoken: Arc<Notify>,
    opened: Instant,
}

impl SimHandle {
    /// Runs `act` on the rig at the present time.
    pub fn with<T>(&self, act: impl FnOnce(RigTime, &mut Rig) -> T) -> T {
        let now = self.now();
        act(now, &mut self.lock())
    }

    /// The technician at the bench.
    pub fn technician(&self) -> Technician {
        Technician(self.clone())
    }

    /// The person who says what is to be seen at the bench. The answers of one seed are always the same.
    pub fn person(&self, seed: u64) -> Person {
        Person::new(self.clone(), seed)
    }

    fn now(&self) -> RigTime {
        self.at(Instant::now())
    }

    fn at(&self, instant: Instant) -> RigTime {
        RigTime::ZERO + instant.saturating_duration_since(self.opened)
    }

    fn instant(&self, at: RigTime) -> Instant {
        self.opened + Duration::from_micros(at.as_micros())
    }

    fn lock(&self) -> MutexGuard<'_, Rig> {
        lock(&self.rig)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().expect("nothing panics while it holds the lock")
}

/// A client's end of a connection in memory. Its bytes arrive when they are written, however late a
/// loaded computer serves the port: an instrument has a processor of its own.
#[derive(Debug)]
pub struct SimPort {
    pipe: DuplexStream,
    /// Time of the last write.
    written: Arc<Mutex<Instant>>,
}

impl AsyncRead for SimPort {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_read(cx, buffer)
    }
}

impl AsyncWrite for SimPort {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        *lock(&self.written) = Instant::now();
        Pin::new(&mut self.pipe).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_shutdown(cx)
    }
}

impl SimRig {
    /// Switches a rig on. Its clock begins now, on the runtime on which this is called.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn start(scene: Scene, wiring: &Wiring, seed: u64) -> Result<Self, SceneError> {
        let rig = Arc::new(Mutex::new(Rig::new(scene, wiring, seed)?));
        let handle = SimHandle { rig, spoken: Arc::default(), opened: Instant::now() };
        Ok(Self { handle, ports: JoinSet::new() })
    }

    /// A new connection to the analyzer.
    pub fn analyzer_port(&mut self) -> SimPort {
        self.port(PortId::Analyzer)
    }

    /// A new connection to the line of the drives.
    pub fn bus_port(&mut self) -> SimPort {
        self.port(PortId::Bus)
    }

    fn port(&mut self, port: PortId) -> SimPort {
        let (serving, theirs) = self.handle.pipe(port);
        self.ports.spawn(serving);
        theirs
    }

    /// A handle, with which faults are injected and further ports are served.
    pub fn handle(&self) -> SimHandle {
        self.handle.clone()
    }

    /// The technician at the bench.
    pub fn technician(&self) -> Technician {
        self.handle.technician()
    }

    /// The true state of the bench now.
    pub fn truth(&self) -> Truth {
        let now = self.handle.now();
        self.handle.lock().world().truth(now)
    }

    /// The safety violations so far.
    pub fn violations(&self) -> Vec<Violation> {
        let now = self.handle.now();
        self.handle.lock().world().violations(now).to_vec()
    }
}

/// The manual work of a technician.
#[derive(Debug, Clone)]
pub struct Technician(SimHandle);

impl Technician {
    /// Puts a sample under the probe.
    ///
    /// # Errors
    /// [`NoSuchSample`].
    pub fn place_sample(&self, name: &str) -> Result<(), NoSuchSample> {
        let now = self.0.now();
        self.0.lock().world().place_sample(now, name)
    }

    /// Takes the sample away.
    pub fn take_sample_away(&self) {
        let now = self.0.now();
        self.0.lock().world().take_sample_away(now);
    }

    /// Lifts the probe out of reach of any sample by hand, with the drive off.
    pub fn lift_probe(&self) {
        let now = self.0.now();
        self.0.lock().world().lift_probe(now);
    }

    /// Turns the sensor about its own axis.
    pub fn turn_sensor(&self, orientation: Orientation) {
        let now = self.0.now();
        self.0.lock().world().turn_sensor(now, orientation);
    }
}

impl SimHandle {
    /// A new connection to a port; `None` while its cable is pulled. It is served until either side
    /// closes it.
    pub fn plug(&self, port: PortId) -> Option<SimPort> {
        if !self.with(|now, rig| rig.is_plugged(now, port)) {
            return None;
        }
        let (serving, theirs) = self.pipe(port);
        tokio::spawn(serving);
        Some(theirs)
    }

    /// A pipe to a port, and the task that serves it.
    fn pipe(&self, port: PortId) -> (impl Future<Output = ()> + use<>, SimPort) {
        let (ours, pipe) = duplex(PIPE_BYTES);
        let connection = self.lock().connect(port);
        let handle = self.clone();
        let written = Arc::new(Mutex::new(self.opened));
        let theirs = SimPort { pipe, written: Arc::clone(&written) };
        let arrived = move || *lock(&written);
        (async move { handle.serve_from(connection, ours, arrived).await }, theirs)
    }

    /// Carries bytes between a stream and a connection until either side closes.
    pub async fn serve(&self, connection: Connection, io: impl AsyncRead + AsyncWrite + Unpin) {
        self.serve_from(connection, io, Instant::now).await;
    }

    /// The same; `arrived` says when the bytes that were just read have arrived.
    async fn serve_from(
        &self,
        mut connection: Connection,
        mut io: impl AsyncRead + AsyncWrite + Unpin,
        arrived: impl Fn() -> Instant,
    ) {
        let mut buffer = [0; 1024];
        loop {
            let spoken = self.spoken.notified();
            let looked = Instant::now();
            let (said, deadline) = {
                let mut rig = self.lock();
                let Ok(said) = rig.poll(self.at(looked), &mut connection) else { return };
                (said, connection.deadline())
            };
            if !said.is_empty() && io.write_all(&said).await.is_err() {
                return;
            }
            let wake = async {
                match deadline {
                    Some(deadline) => sleep_until(self.instant(deadline)).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                // In this order, so that a run repeats.
                biased;
                read = io.read(&mut buffer) => match read {
                    Ok(0) | Err(_) => return,
                    Ok(n) => {
                        let at = self.at(arrived().max(looked));
                        if self.lock().push(at, &mut connection, &buffer[..n]).is_err() {
                            return;
                        }
                        if connection.waits_for_others() {
                            self.spoken.notify_waiters();
                        }
                    }
                },
                () = wake => {}
                () = spoken, if connection.waits_for_others() => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LineTransport, modbus::with_checksum, scene::matched};
    use rig_model::AnalyzerMake;

    fn start(seed: u64) -> SimRig {
        start_with(AnalyzerMake::HiokiIm3536, seed)
    }

    fn start_with(analyzer: AnalyzerMake, seed: u64) -> SimRig {
        let transport = LineTransport::Serial { baud: 115_200 };
        let wiring = Wiring { analyzer, ..Wiring::paper(transport) };
        SimRig::start(matched(), &wiring, seed).unwrap()
    }

    async fn line(io: &mut SimPort, request: &str) -> String {
        io.write_all(request.as_bytes()).await.unwrap();
        let mut said = Vec::new();
        while !said.ends_with(b"\n") {
            io.read_buf(&mut said).await.unwrap();
        }
        String::from_utf8(said).unwrap()
    }

    async fn ask(io: &mut SimPort, frame: &[u8]) -> Vec<u8> {
        io.write_all(&with_checksum(frame)).await.unwrap();
        let mut said = vec![0; 8 + 251];
        let n = io.read(&mut said).await.unwrap();
        said.truncate(n);
        said
    }

    /// Lowers the probe to `position` steps of 1 µm and waits until it is there.
    async fn lower(bus: &mut SimPort, position: i32) {
        let data = [0, 1, position, 50_000, 1_000_000, 1_000_000, 1000, 1];
        let mut frame = vec![1, 16, 0, 0x58, 0, 16, 32];
        frame.extend(data.iter().flat_map(|value: &i32| value.to_be_bytes()));
        ask(bus, &frame).await;
        while ask(bus, &[1, 3, 0, 0x7E, 0, 2]).await[5] & 0x20 != 0 {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    const SET_UP: &str = "*RST;:TRIGger EXTernal;:SPEEd FAST;:AVERaging 10;:PARameter1 RS;\
        :PARameter3 X;:MEASure:VALid 0;:TRIGger:DELay 0.5;:FREQuency 140;*TRG;:MEASure?\r\n";

    #[tokio::test(start_paused = true)]
    async fn a_touch_shows_on_the_wire_and_the_same_seed_says_the_same_bytes() {
        let mut told = Vec::new();
        for seed in [7, 7, 8] {
            let mut rig = start(seed);
            let (mut meter, mut bus) = (rig.analyzer_port(), rig.bus_port());
            rig.technician().place_sample("5").unwrap();
            let clear = line(&mut meter, SET_UP).await;
            assert!(!rig.truth().is_in_contact());
            lower(&mut bus, 9_500).await;
            let truth = rig.truth();
            assert!(truth.is_in_contact(), "{truth:?}");
            assert!(truth.resonance_hz > truth.no_load_hz + 40.0, "{truth:?}");
            let touching = line(&mut meter, "*TRG;:MEASure?\r\n").await;
            assert_ne!(clear, touching);
            lower(&mut bus, 40_000).await;
            assert!(!rig.truth().is_in_contact());
            assert_eq!(rig.violations(), []);
            told.push((clear, touching));
        }
        assert_eq!(told[0], told[1]);
        assert_ne!(told[0], told[2]);
    }

    #[tokio::test(start_paused = true)]
    async fn what_a_person_must_not_do_in_contact_is_kept() {
        use crate::world::ViolationKind::{PressedTooDeep, SampleChangedInContact};
        let mut rig = start(1);
        let mut bus = rig.bus_port();
        rig.technician().place_sample("1").unwrap();
        assert!(rig.technician().place_sample("6").is_err());
        lower(&mut bus, 8_000).await;
        rig.technician().take_sample_away();
        let kinds: Vec<_> = rig.violations().iter().map(|violation| violation.kind).collect();
        assert!(
            matches!(kinds[..], [PressedTooDeep { .. }, SampleChangedInContact { .. }]),
            "{kinds:?}"
        );
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_vanishes_leaves_the_rig_to_the_next_one() {
        let mut rig = start(1);
        let mut meter = rig.analyzer_port();
        meter.write_all(b"*TRG\r\n:MEAS").await.unwrap();
        drop(meter);
        tokio::task::yield_now().await;
        let mut meter = rig.analyzer_port();
        assert_eq!(line(&mut meter, "\r\n*IDN?\r\n").await, "HIOKI,IM3536,190512345,V1.21\r\n");
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_waits_for_another_ones_measurement_hears_when_that_is_ended() {
        let mut rig = start_with(AnalyzerMake::KeysightE4980a, 1);
        let (mut first, mut second) = (rig.analyzer_port(), rig.analyzer_port());
        first.write_all(b"TRIG:SOUR BUS;:TRIG:TDEL 999;*TRG\n").await.unwrap();
        tokio::task::yield_now().await;
        assert!(line(&mut second, "*IDN?\n").await.contains("E4980A"));
        let waits = async move { line(&mut second, "FREQ 200;:FREQ?\n").await };
        let waits = tokio::spawn(waits);
        tokio::task::yield_now().await;
        rig.analyzer_port().write_all(b"ABOR\n").await.unwrap();
        assert_eq!(waits.await.unwrap(), "+2.000000000E+02\n");
        assert!(rig.handle().now() < RigTime::ZERO + Duration::from_secs(1));
    }
}
