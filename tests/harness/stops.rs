//! How long a stop takes from the client to the port of the drives, at real time: from the moment at
//! which it is sent over HTTP to the frame that arrives at each simulated drive.

use std::{net::Ipv4Addr, time::Duration};

use rig_engine::{Command, RigState};
use rig_model::RigTime;
use rig_sim::PortId;
use rigd::http::{Shared, access::Access, router, serve};
use tempfile::TempDir;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    task::JoinSet,
    time::sleep,
};
use tokio_util::sync::CancellationToken;

use crate::{TestRig, text};

/// The activity of the rig when the stop comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum During {
    /// Nothing.
    Idle,
    /// A reading of a thousand cycles.
    LongReading,
    /// A sweep whose points are planned from its readings.
    PlannedSweep,
    /// A sweep with an analyzer that does not answer.
    SilentAnalyzer,
    /// A move of the probe.
    Move,
    /// A move of the rotary stage, whose drive does not answer.
    SilentRotaryStage,
    /// A move of the probe on a line with noise before each reply.
    NoisyLine,
    /// The drives are found after an acknowledgement.
    Preparing,
    /// A run waits for a person at the bench.
    WaitingForPerson,
    /// A run is paused.
    Paused,
    /// The rig is latched by a stop before.
    Latched,
}

impl During {
    /// All activities.
    pub const ALL: [Self; 11] = [
        Self::Idle,
        Self::LongReading,
        Self::PlannedSweep,
        Self::SilentAnalyzer,
        Self::Move,
        Self::SilentRotaryStage,
        Self::NoisyLine,
        Self::Preparing,
        Self::WaitingForPerson,
        Self::Paused,
        Self::Latched,
    ];

    /// The activity in words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::LongReading => "a reading of 1000 cycles",
            Self::PlannedSweep => "a planned sweep",
            Self::SilentAnalyzer => "a silent analyzer",
            Self::Move => "a move of the probe",
            Self::SilentRotaryStage => "a silent rotary drive",
            Self::NoisyLine => "noise on the line of the drives",
            Self::Preparing => "preparing",
            Self::WaitingForPerson => "waiting for a person",
            Self::Paused => "paused",
            Self::Latched => "latched",
        }
    }

    const fn fault(self) -> Option<&'static str> {
        match self {
            Self::SilentAnalyzer => Some("fault analyzer drop-request rate=1"),
            Self::SilentRotaryStage => Some("fault bus drop-request unit=2 rate=1"),
            Self::NoisyLine => Some("fault bus noise bytes=20 rate=1"),
            _ => None,
        }
    }

    /// The request that begins it.
    const fn request(self) -> Option<(&'static str, &'static str)> {
        let sweep =
            r#"{"min_hz": 130, "max_hz": 150, "points": 7, "cycles": 1000, "settle_s": 0.1}"#;
        let planned =
            r#"{"min_hz": 125, "max_hz": 160, "target_sigma_hz": 0.001, "time_limit_s": 30}"#;
        match self {
            Self::LongReading | Self::SilentAnalyzer => Some(("sweeps", sweep)),
            Self::PlannedSweep => Some(("sweeps", planned)),
            Self::Move | Self::NoisyLine => Some(("moves", r#"{"axis": "linear", "to": 15}"#)),
            Self::SilentRotaryStage => Some(("moves", r#"{"axis": "rotary", "to": 30}"#)),
            _ => None,
        }
    }

    /// The port at which something is said while it goes on.
    const fn port(self) -> PortId {
        match self {
            Self::LongReading | Self::PlannedSweep | Self::SilentAnalyzer => PortId::Analyzer,
            _ => PortId::Bus,
        }
    }
}

/// The STOP input of the driver of unit `unit`, as the AZ series has it in its manual.
const fn stop_frame(unit: u8) -> [u8; 6] {
    [unit, 6, 0x00, 0x7D, 0x00, 0x20]
}

/// The person at the bench.
const OPERATOR: &str = "the lab";

/// Longest time for which anything is waited for.
const PATIENCE: Duration = Duration::from_secs(30);

/// The rig at real pace behind a listener, with clients that poll it.
#[derive(Debug)]
pub struct StopBench {
    rig: TestRig,
    address: String,
    _clients: JoinSet<Option<()>>,
    closing: CancellationToken,
    _data: TempDir,
}

impl StopBench {
    /// Opens the shipped simulated rig at real pace, with as many clients.
    ///
    /// # Panics
    /// When there is no port for the listener.
    pub async fn open(clients: usize) -> Self {
        let changes = [("pace = \"virtual\"", "pace = \"real\""), ("\"answers\"\n", "\"waits\"\n")];
        let rig = TestRig::open_changed(&changes).await;
        let (data, closing) = (TempDir::new().expect("a directory"), CancellationToken::new());
        let operator = "the lab".parse().expect("a name");
        let access = Access::new(Ipv4Addr::LOCALHOST.into(), [], None, operator);
        let (handle, facts) = (rig.handle.clone(), rig.facts.clone());
        let directory = data.path().to_owned();
        let shared = Shared::new(
            handle,
            facts,
            None,
            directory,
            access,
            tokio::runtime::Handle::current(),
            closing.clone(),
        );
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("it is bound").to_string();
        tokio::spawn(serve(listener, None, router(shared), closing.clone()));
        let mut polling = JoinSet::new();
        for _ in 0..clients {
            let address = address.clone();
            let closing = closing.clone();
            polling.spawn(closing.run_until_cancelled_owned(async move {
                while ask(&address, "GET", "rig", "").await.is_ok() {
                    sleep(Duration::from_millis(50)).await;
                }
            }));
        }
        Self { rig, address, _clients: polling, closing, _data: data }
    }

    /// Begins an activity, stops it after `delay`, and returns when the stop arrived at the linear and
    /// at the rotary drive. The rig is ready again afterwards.
    ///
    /// # Panics
    /// When something that is waited for does not happen.
    pub async fn stop(&self, during: During, delay: Duration) -> [Duration; 2] {
        let simulation = self.rig.handle.simulation().expect("the rig is simulated");
        if let Some(fault) = during.fault() {
            self.rig.fault(fault);
        }
        simulation.with(|_, rig| rig.listen_in());
        self.reach(during).await;
        if let Some((path, body)) = during.request() {
            ask(&self.address, "POST", path, body).await.expect("the daemon listens");
            self.until("it has begun", |rig| {
                rig.overheard().iter().any(|heard| heard.port == during.port())
            })
            .await;
        }
        sleep(delay).await;
        let asked = simulation.with(|now, _| now);
        ask(&self.address, "POST", "stop", "").await.expect("the daemon listens");
        let arrived = [1, 2].map(|unit| {
            let heard = move |rig: &rig_sim::Rig| arrival(rig, unit, asked);
            (unit, heard)
        });
        let mut latencies = [Duration::ZERO; 2];
        for (latency, (unit, heard)) in latencies.iter_mut().zip(arrived) {
            self.until(&format!("{}: the stop of unit {unit}", during.name()), |rig| {
                heard(rig).is_some()
            })
            .await;
            let at = simulation.with(|_, rig| heard(rig)).expect("it was waited for");
            *latency = at.since(asked);
        }
        self.rig.fault("clear");
        self.rig.wait_for("the latch", |status| status.snapshot.state == RigState::Latched).await;
        ask(&self.address, "POST", "acknowledge", "").await.expect("the daemon listens");
        self.rig.wait_for("service", |status| status.snapshot.state == RigState::Idle).await;
        latencies
    }

    /// Brings the rig into the state of this activity, if it is one of the engine.
    async fn reach(&self, during: During) {
        let to = |state| self.rig.wait_for("a state", move |at| at.snapshot.state == state);
        let post =
            async |path, body| ask(&self.address, "POST", path, body).await.expect("an answer");
        let give = async |command, run| {
            self.rig.handle.command(command, run, OPERATOR).await.expect("the state allows it");
        };
        match during {
            During::Preparing | During::Latched => {
                post("stop", "").await;
                to(RigState::Latched).await;
                if during == During::Preparing {
                    give(Command::Acknowledge, None).await;
                    to(RigState::Preparing).await;
                }
            }
            During::WaitingForPerson | During::Paused => {
                let protocol = self.rig.protocol(&text("config/protocols/smoke.toml"));
                let run = self.rig.handle.run(protocol, OPERATOR).await.expect("an idle rig");
                to(RigState::WaitingForPerson).await;
                if during == During::Paused {
                    give(Command::Pause, Some(run)).await;
                    give(Command::Answer, Some(run)).await;
                    to(RigState::Paused).await;
                }
            }
            _ => {}
        }
    }

    /// Closes the rig.
    pub async fn close(self) {
        self.closing.cancel();
        self.rig.close().await;
    }

    async fn until(&self, what: &str, is_so: impl Fn(&rig_sim::Rig) -> bool) {
        let simulation = self.rig.handle.simulation().expect("the rig is simulated");
        let looks = PATIENCE.as_millis();
        for _ in 0..looks {
            if simulation.with(|_, rig| is_so(rig)) {
                return;
            }
            sleep(Duration::from_millis(1)).await;
        }
        panic!("{what}: not within {} s", PATIENCE.as_secs());
    }
}

/// When a stop arrived at a drive, after it was asked for.
fn arrival(rig: &rig_sim::Rig, unit: u8, asked: RigTime) -> Option<RigTime> {
    arrivals(rig, unit).find(|at| asked <= *at)
}

/// When stops arrived at a drive since the simulated rig listens in.
pub fn arrivals(rig: &rig_sim::Rig, unit: u8) -> impl Iterator<Item = RigTime> {
    let frame = stop_frame(unit);
    let is_stop = move |bytes: &[u8]| bytes.windows(frame.len()).any(|window| window == frame);
    rig.overheard().iter().filter(move |heard| is_stop(&heard.bytes)).map(|heard| heard.at)
}

/// One request on a connection of its own; returns when it is answered.
async fn ask(address: &str, method: &str, path: &str, body: &str) -> std::io::Result<()> {
    let mut stream = TcpStream::connect(address).await?;
    let request = format!(
        "{method} /api/v1/{path} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\
         content-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(request.as_bytes()).await?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await?;
    let is_taken = answer.starts_with(b"HTTP/1.1 2");
    assert!(is_taken, "{method} {path}: {}", String::from_utf8_lossy(&answer));
    Ok(())
}
