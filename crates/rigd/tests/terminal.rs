//! The screen of a terminal of a given width, through a pseudo-terminal.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

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

use rig_model::Orientation;
use rig_sim::{
    LineTransport, SimRig, Technician, Wiring,
    serve::{Role, Server},
};
use rustix::{
    process::{Pid, Signal, kill_process},
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{Winsize, tcsetwinsize},
};
use tempfile::TempDir;

/// Nothing here takes longer.
const PATIENCE: Duration = Duration::from_secs(180);
const ROWS: u16 = 24;
/// Rows above the visible screen count too.
const SCROLLBACK: usize = 500;

/// Two samples, so that a prompt comes after a run has been drawn. The clock is real.
const PROTOCOL: &str = r#"
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
settle_s = 0.5
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
time_limit_s = 30
cycles = 20
level_v = 5
"#;

fn shipped(path: &str) -> String {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    fs::read_to_string(config.join(path)).unwrap()
}

/// A simulated rig behind TCP ports, for which rigd asks a person as on a real one.
struct Bench {
    person: Technician,
    rig: PathBuf,
    protocol: PathBuf,
    _sim: SimRig,
    _server: Server,
}

impl Bench {
    async fn start(folder: &Path) -> Self {
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
        fs::write(&rig, text).unwrap();
        fs::write(&protocol, PROTOCOL).unwrap();
        Self { person: sim.technician(), rig, protocol, _sim: sim, _server: server }
    }
}

/// The program at a terminal.
struct Terminal {
    child: Child,
    master: fs::File,
    output: Receiver<Vec<u8>>,
    screen: vt100::Parser,
}

impl Terminal {
    fn start(bench: &Bench, folder: &Path, columns: u16) -> Self {
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
            .arg("run")
            .arg(&bench.protocol)
            .arg("--rig")
            .arg(&bench.rig)
            .arg("--data")
            .arg(folder.join("data"))
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
    fn text(&mut self) -> String {
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
    fn wait_for(&mut self, what: &str, is_there: impl Fn(&str) -> bool) {
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
    fn wait_for_text(&mut self, text: &str) {
        self.wait_for(text, |all| all.contains(text));
    }

    fn press_enter(&mut self) {
        self.master.write_all(b"\n").unwrap();
    }

    fn resize(&mut self, columns: u16) {
        tcsetwinsize(&self.master, size(columns)).unwrap();
        self.screen.screen_mut().set_size(ROWS, columns);
        // The system tells only those to whom the terminal belongs.
        self.signal(Signal::WINCH);
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Shows the rest, and gives the exit code.
    fn end(&mut self) -> Option<i32> {
        while let Ok(bytes) = self.output.recv_timeout(PATIENCE) {
            self.screen.process(&bytes);
        }
        self.child.wait().unwrap().code()
    }
}

fn size(columns: u16) -> Winsize {
    Winsize { ws_row: ROWS, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
}

const TURN: &str =
    "Turn the sensor a quarter to the left about its own axis. Press Enter when that is done.";
const FIRST: &str = "Put sample 1 under the probe. Press Enter when that is done.";
const SECOND: &str = "Put sample 2 under the probe. Press Enter when that is done.";
const ADVICE: &str = "retracting the probe; interrupt again to stop everything";

/// A person at a terminal who changes its width while rigd waits for the second sample, and
/// interrupts the run at last.
fn check(bench: &Bench, folder: &Path, columns: u16, changed: u16) {
    let mut terminal = Terminal::start(bench, folder, columns);
    terminal.wait_for_text(FIRST);
    bench.person.place_sample("1").unwrap();
    terminal.press_enter();
    terminal.wait_for_text(TURN);
    bench.person.turn_sensor(Orientation::Left);
    terminal.press_enter();
    terminal.wait_for_text("sample 1 of 2");
    // An Enter before the prompt is no answer.
    terminal.press_enter();
    terminal.press_enter();
    terminal.wait_for_text(SECOND);
    let all = terminal.text();
    assert!(all.contains(TURN) && all.contains(FIRST), "{columns}: {all}");

    terminal.resize(changed);
    let count = |all: &str| all.matches("Press Enter when that is done.").count();
    let before = count(&terminal.text());
    terminal.wait_for("the prompt again", |all| all.ends_with(SECOND) && count(all) > before);
    bench.person.place_sample("2").unwrap();
    terminal.press_enter();
    terminal.wait_for_text("sample 2 of 2");
    terminal.signal(Signal::INT);
    terminal.wait_for_text(ADVICE);
    assert_eq!(terminal.end(), Some(5), "{}", terminal.text());
    let all = terminal.text();
    assert!(all.contains(SECOND) && all.contains(ADVICE), "{columns} to {changed}: {all}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_prompt_is_not_lost_whatever_the_width_of_the_terminal() {
    let widths = [40, 60, 80, 90, 120, 300];
    let folders = widths.map(|_| TempDir::new().unwrap());
    let mut people = Vec::new();
    for ((folder, columns), changed) in folders.iter().zip(widths).zip(widths.into_iter().rev()) {
        let (bench, path) = (Bench::start(folder.path()).await, folder.path().to_owned());
        people.push(tokio::task::spawn_blocking(move || check(&bench, &path, columns, changed)));
    }
    for person in people {
        person.await.unwrap();
    }
}
