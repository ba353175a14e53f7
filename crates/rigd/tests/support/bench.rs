//! Simulated devices on ports of this computer, and the program on them.

#[path = "commissioned.rs"]
mod commissioned;

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use rig_model::DriveMake;
use rig_sim::{
    AxisWiring, LineTransport, PortId, SimHandle, SimRig, Wiring,
    faults::{Fault, FaultKind, FaultTrigger},
};
use serde_json::Value;
use tempfile::TempDir;
use tokio::{net::TcpListener, task::JoinSet};

pub(crate) fn shipped(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

/// Simulated devices on ports of this computer, with a rig file that names them.
pub(crate) struct Bench {
    pub(crate) sim: SimHandle,
    pub(crate) analyzer: String,
    pub(crate) bus: String,
    pub(crate) folder: TempDir,
    /// The servers of the ports; further ones may be added.
    pub(crate) listening: JoinSet<()>,
}

impl Bench {
    pub(crate) async fn start() -> Self {
        Self::with_linear_drive(DriveMake::OrientalAz, 0.001).await
    }

    /// With a linear drive of this make, of this many mm a step.
    pub(crate) async fn with_linear_drive(make: DriveMake, mm_per_step: f64) -> Self {
        let scene = shipped("scenes/paper.toml");
        let scene = rig_sim::scene::read("scene", &fs::read_to_string(scene).unwrap()).unwrap();
        let linear = AxisWiring::new(make, 1, mm_per_step);
        let wiring = Wiring { linear, ..Wiring::paper(LineTransport::Tcp) };
        let seed = scene.seed;
        let sim = SimRig::start(scene, &wiring, seed).unwrap().handle();
        let mut listening = JoinSet::new();
        let analyzer = listen(&mut listening, &sim, PortId::Analyzer).await;
        let bus = listen(&mut listening, &sim, PortId::Bus).await;
        Self { sim, analyzer, bus, folder: TempDir::new().unwrap(), listening }
    }

    pub(crate) fn disturb(&self, port: PortId, unit: Option<u8>, kind: FaultKind) {
        let fault = Fault { port, unit, kind, trigger: FaultTrigger::Rate(1.0) };
        self.sim.with(|_, rig| rig.add_fault(fault));
    }

    /// The program, with a rig file that has the devices at these addresses, and these lines changed.
    pub(crate) fn command(
        &self,
        analyzer: &str,
        bus: &str,
        changes: &[(&str, &str)],
        args: &[&str],
    ) -> Command {
        let (rig, data) = (self.folder.path().join("rig.toml"), self.folder.path().join("data"));
        let mut text = fs::read_to_string(shipped("rigs/bench.toml")).unwrap();
        for (name, address) in [("usb-HIOKI", analyzer), ("usb-FTDI", bus)] {
            let is_port = |line: &&str| line.starts_with("port =") && line.contains(name);
            let line = text.lines().find(is_port).unwrap().to_owned();
            text = text.replace(&line, &format!("port = {{ tcp = \"{address}\" }}"));
        }
        for (old, new) in changes {
            assert!(text.contains(old), "{old:?} is not in the file");
            text = text.replacen(old, new, 1);
        }
        commissioned::commission(&text, &data);
        fs::write(&rig, text).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        // Where `rigd safe` finds the calibrations without `--data`.
        command.env("CONFIGURATION_DIRECTORY", self.folder.path()).env("STATE_DIRECTORY", &data);
        command.args(args).arg("--rig").arg(rig);
        if !matches!(args[0], "identify" | "safe") {
            command.arg("--data").arg(data);
        }
        command
    }

    /// Runs the program to its end, as in [`Bench::command`].
    pub(crate) fn rigd_with(
        &self,
        analyzer: &str,
        bus: &str,
        changes: &[(&str, &str)],
        args: &[&str],
    ) -> Output {
        self.command(analyzer, bus, changes, args).output().unwrap()
    }

    pub(crate) fn rigd_at(&self, analyzer: &str, bus: &str, args: &[&str]) -> Output {
        self.rigd_with(analyzer, bus, &[], args)
    }

    pub(crate) fn rigd(&self, args: &[&str]) -> Output {
        self.rigd_at(&self.analyzer, &self.bus, args)
    }

    pub(crate) fn is_in_contact(&self) -> bool {
        self.sim.with(|now, rig| rig.world().truth(now).is_in_contact())
    }

    /// Where both axes are in truth.
    pub(crate) fn places(&self) -> (f64, f64) {
        let truth = self.sim.with(|now, rig| rig.world().truth(now));
        (truth.tip_mm, truth.tilt_deg)
    }
}

/// Serves a port of the simulated rig on one of this computer, and returns its address.
pub(crate) async fn listen(listening: &mut JoinSet<()>, sim: &SimHandle, port: PortId) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (address, sim) = (listener.local_addr().unwrap().to_string(), sim.clone());
    listening.spawn(async move {
        while let Ok((client, _)) = listener.accept().await {
            let (sim, connection) = (sim.clone(), sim.with(|_, rig| rig.connect(port)));
            tokio::spawn(async move { sim.serve(connection, client).await });
        }
    });
    address
}

pub(crate) fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(output)))
}

pub(crate) fn stderr(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).unwrap()
}
