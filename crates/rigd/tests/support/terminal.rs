//! rigd at a terminal of a given width, on a bench whose prompts a person answers.

#[path = "commissioned.rs"]
mod commissioned;

use std::{
    fs,
    io::{Read, Write},
    net::SocketAddr,
    path::{Path, PathBuf},
    process::{Child, Command},
    sync::mpsc::{Receiver, RecvTimeoutError, channel},
    thread,
    time::{Duration, Instant},
};

use rig_sim::{
    LineTransport, SimRig, Technician, Wiring,
    serve::{Role, Server},
};
use rustix::{
    process::{Pid, Signal, kill_process},
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{Winsize, tcsetwinsize},
};

/// Nothing here takes longer.
const PATIENCE: Duration = Duration::from_secs(180);
const ROWS: u16 = 24;
/// Rows above the visible screen count too.
const SCROLLBACK: usize = 500;

/// Two samples, so that a prompt comes after a run has been drawn. The clock is real.
pub(crate) const PROTOCOL: &str = r#"
name = "two samples"
samples = ["1", "2"]
directions = ["left"]
angles_deg = [0]
seed = 1
[touch]
indentation_mm = 0.5
[approach]
start_above_mm = 0.8
give_up_below_mm = 0.8
coarse_step_mm = 0.1
fine_step_mm = 0.01
contact_threshold = 0.10
settle_s = 0.1
cycles = 10
[no_load_sweep]
min_hz = 125
max_hz = 160
target_sigma_hz = 0.05
time_limit_s = 30
cycles = 20
level_v = 5
[contact_sweep]
min_hz = 130
max_hz = 260
target_sigma_hz = 1
time_limit_s = 5
cycles = 20
level_v = 5
"#;

/// The window of the sweep in contact ends below the resonance of each sample.
pub(crate) fn narrow() -> String {
    let narrow = PROTOCOL.replace("max_hz = 260", "max_hz = 145");
    let ask = narrow.replace("[touch]\n", "[touch]\non_refusal = \"ask\"\n");
    assert!(narrow != PROTOCOL && ask != narrow);
    ask
}

fn shipped(path: &str) -> String {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    fs::read_to_string(config.join(path)).unwrap()
}

/// A simulated rig behind TCP ports, for which rigd asks a person as on a real one.
pub(crate) struct Bench {
    pub(crate) person: Technician,
    pub(crate) rig: PathBuf,
    pub(crate) protocol: PathBuf,
    _sim: SimRig,
    _server: Server,
}

impl Bench {
    /// With this protocol, written to `folder`.
    pub(crate) async fn start(folder: &Path, protocol_toml: &str) -> Self {
        let scene = rig_sim::scene::read("scene", &shipped("scenes/paper.toml")).unwrap();
        let sim = SimRig::start(scene, &Wiring::paper(LineTransport::Tcp), 1).unwrap();
        let mut server = Server::new(sim.handle());
        let any = SocketAddr::from(([127, 0, 0, 1], 0));
        let analyzer = server.listen(Role::Analyzer, any).await.unwrap();
        let bus = server.listen(Role::Bus(LineTransport::Tcp), any).await.unwrap();
        let mut text = shipped("rigs/simulated.toml");
        let changes = [
            ("connection = \"simulated\"", "connection = \"ports\"".to_owned()),
            (
                "{ serial = \"/dev/serial/by-id/analyzer\", baud = 38400 }",
                format!("{{ tcp = \"{analyzer}\" }}"),
            ),
            (
                "{ serial = \"/dev/serial/by-id/drives\", baud = 115200 }",
                format!("{{ tcp = \"{bus}\" }}"),
            ),
        ];
        for (from, to) in changes {
            assert_eq!(text.matches(from).count(), 1, "{from}");
            text = text.replace(from, &to);
        }
        let (rig, protocol) = (folder.join("rig.toml"), folder.join("protocol.toml"));
        commissioned::commission(&text, &folder.join("data"));
        fs::write(&rig, text).unwrap();
        fs::write(&protocol, protocol_toml).unwrap();
        Self { person: sim.technician(), rig, protocol, _sim: sim, _server: server }
    }
}

/// The program at a terminal.
pub(crate) struct Terminal {
    child: Child,
    master: fs::File,
    output: Receiver<Vec<u8>>,
    screen: vt100::Parser,
}

impl Terminal {
    /// A run of the protocol of the bench.
    pub(crate) fn start(bench: &Bench, folder: &Path, columns: u16) -> Self {
        let data = folder.join("data");
        let args = ["run".as_ref(), &*bench.protocol, "--rig".as_ref(), &bench.rig];
        Self::open(&[&args[..], &["--data".as_ref(), &data]].concat(), columns)
    }

    /// The program with these arguments.
    pub(crate) fn open(args: &[&Path], columns: u16) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        tcsetwinsize(&master, size(columns)).unwrap();
        let open = || {
            let mut options = fs::File::options();
            options.read(true).write(true).open(name.to_str().unwrap()).unwrap()
        };
        let child = Command::new(env!("CARGO_BIN_EXE_rigd"))
            .args(args)
            .stdin(open())
            .stdout(open())
            .stderr(open())
            .spawn()
            .unwrap();
        let master = fs::File::from(master);
        let (mut reading, (sender, output)) = (master.try_clone().unwrap(), channel());
        thread::spawn(move || {
            let mut bytes = [0; 4096];
            // Reading fails after the last user of the terminal has closed it.
            while let Ok(count @ 1..) = reading.read(&mut bytes) {
                if sender.send(bytes[..count].to_vec()).is_err() {
                    return;
                }
            }
        });
        let screen = vt100::Parser::new(ROWS, columns, SCROLLBACK);
        Self { child, master, output, screen }
    }

    /// The text of the screen and of the scrollback, without line ends.
    pub(crate) fn text(&mut self) -> String {
        let mut text = String::new();
        self.screen.screen_mut().set_scrollback(usize::MAX);
        let hidden = self.screen.screen().scrollback();
        for above in (0..=hidden).rev() {
            self.screen.screen_mut().set_scrollback(above);
            let contents = self.screen.screen().contents();
            if above == 0 {
                text.push_str(&contents);
            } else {
                text.push_str(contents.lines().next().unwrap_or_default());
            }
            text.push('\n');
        }
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Shows the output of the program until a condition holds.
    #[track_caller]
    pub(crate) fn wait_for(&mut self, what: &str, is_there: impl Fn(&str) -> bool) {
        let end = Instant::now() + PATIENCE;
        loop {
            let text = self.text();
            if is_there(&text) {
                return;
            }
            match self.output.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(bytes) => self.screen.process(&bytes),
                Err(RecvTimeoutError::Timeout) => panic!("gave up waiting for {what}: {text}"),
                Err(RecvTimeoutError::Disconnected) => panic!("ended before {what}: {text}"),
            }
        }
    }

    #[track_caller]
    pub(crate) fn wait_for_text(&mut self, text: &str) {
        self.wait_for(text, |all| all.contains(text));
    }

    pub(crate) fn press_enter(&mut self) {
        self.enter("");
    }

    /// Types a line.
    pub(crate) fn enter(&mut self, line: &str) {
        self.enter_bytes(line.as_bytes());
    }

    /// Types a line of any bytes.
    pub(crate) fn enter_bytes(&mut self, line: &[u8]) {
        self.master.write_all(&[line, b"\n"].concat()).unwrap();
    }

    pub(crate) fn resize(&mut self, columns: u16) {
        tcsetwinsize(&self.master, size(columns)).unwrap();
        self.screen.screen_mut().set_size(ROWS, columns);
        // The system tells only those to whom the terminal belongs.
        self.signal(Signal::WINCH);
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Shows the rest, and gives the exit code.
    pub(crate) fn end(&mut self) -> Option<i32> {
        while let Ok(bytes) = self.output.recv_timeout(PATIENCE) {
            self.screen.process(&bytes);
        }
        self.child.wait().unwrap().code()
    }
}

fn size(columns: u16) -> Winsize {
    Winsize { ws_row: ROWS, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
}
