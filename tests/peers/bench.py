"""What the scripts beside this one share: programs that are started and stopped, conditions that are
waited for with a deadline, and checks that say what they found."""

import hashlib
import socket
import subprocess
import tempfile
import time
import tomllib
from pathlib import Path

DEADLINE_S = 60
SCENE = "config/scenes/paper.toml"


def wait_for(what, condition, deadline_s=DEADLINE_S):
    """The first value of the condition that is true in the sense of Python."""
    end = time.monotonic() + deadline_s
    while True:
        value = condition()
        if value:
            return value
        if end < time.monotonic():
            raise SystemExit(f"FAILED: gave up waiting for {what}")
        time.sleep(0.01)


def check(condition, what):
    if not condition:
        raise SystemExit(f"FAILED: {what}")


def equal(found, expected, what):
    check(found == expected, f"{what}: found {found!r}, expected {expected!r}")


class Program:
    """A program that runs as long as the block does. Its output is kept for those who ask."""

    def __init__(self, *command):
        self.command = [str(word) for word in command]

    def __enter__(self):
        self.log = tempfile.NamedTemporaryFile(prefix="peer-")
        self.process = subprocess.Popen(
            self.command, stdin=subprocess.DEVNULL, stdout=self.log, stderr=subprocess.STDOUT)
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.terminate()
        try:
            self.process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise SystemExit(f"FAILED: {self.command[0]} does not end when it is told to") from None

    def output(self):
        return Path(self.log.name).read_text()

    def wait_for(self, what, condition):
        """Waits for a condition of the output."""

        def look():
            value = condition(self.output())
            if not value and self.process.poll() is not None:
                raise SystemExit(f"FAILED: {' '.join(self.command)} ended:\n{self.output()}")
            return value

        return wait_for(what, look)


class Sim(Program):
    """`rig-sim serve` with ports of the given names: `tcp` in a name asks for TCP, others for a
    pseudo-terminal. `ports` holds where each is."""

    def __init__(self, program, *ports, options=(), sample=None):
        self.links = tempfile.TemporaryDirectory(prefix="peer-")
        self.names = [*ports, "control"]
        self.ports = {}
        command = [program, "serve", SCENE, *options, "--control", "127.0.0.1:0"]
        if sample:
            command += ["--sample", sample]
        for name in ports:
            if "tcp" in name:
                command += [f"--{name}", "127.0.0.1:0"]
            else:
                command += [f"--{name}-pty", Path(self.links.name) / name]
        super().__init__(*command)

    def __enter__(self):
        super().__enter__()
        lines = self.wait_for("the ports of the simulator", self.announced)
        for name, *places in lines:
            self.ports[name] = places[-1]
        host, port = self.address("control")
        self.control = socket.create_connection((host, port), DEADLINE_S)
        self.answers = self.control.makefile("r")
        return self

    def __exit__(self, *reason):
        self.answers.close()
        self.control.close()
        super().__exit__(*reason)
        self.links.cleanup()

    def announced(self, output):
        lines = [line.split() for line in output.split("\n")[:-1]]
        lines = [line for line in lines if line and line[0] in self.names]
        return len(lines) == len(self.names) and lines

    def address(self, name):
        host, port = self.ports[name].rsplit(":", 1)
        return host, int(port)

    def say(self, line):
        """Says a line to the control connection; for those with an answer of one line."""
        self.control.sendall(f"{line}\n".encode())
        answer = self.answers.readline().strip()
        check(answer and not answer.startswith("error"), f"control: {line}: {answer}")
        return answer

    def truth(self):
        return dict(word.split("=", 1) for word in self.say("truth").split())


def rig_file(folder, analyzer, bus):
    """The shipped rig with its devices on these ports: each a path, or `host:port`. A
    pseudo-terminal knows no parity, so that there is none."""

    def port(place, rest):
        text = f'serial = "{place}", {rest}' if place.startswith("/") else f'tcp = "{place}"'
        return f"port = {{ {text} }}"

    text = Path("config/rigs/simulated.toml").read_text()
    changes = [
        ('connection = "simulated"', 'connection = "ports"'),
        ('port = { serial = "/dev/serial/by-id/analyzer", baud = 38400 }', port(analyzer, "baud = 38400")),
        ('port = { serial = "/dev/serial/by-id/drives", baud = 115200 }',
         port(bus, 'baud = 115200, parity = "none"')),
    ]
    for old, new in changes:
        check(text.count(old) == 1, f"{old} stands once in the shipped rig file")
        text = text.replace(old, new)
    scene = tomllib.loads(Path(SCENE).read_text())
    for sample in scene["samples"]:
        text += f'\n[[samples]]\nname = "{sample["name"]}"\nstiffness_mpa = {sample["stiffness_mpa"]}\n'
    path = Path(folder) / "rig.toml"
    path.write_text(text)
    return path


def commission(rig, data):
    """Writes the records of a rig that is commissioned, as docs/commission.md describes them."""
    keys = tomllib.loads(Path(rig).read_text())
    values = []
    for axis, unit in (("linear", "mm"), ("rotary", "deg")):
        table = keys[axis]
        values += [
            (f"{axis}.step", table[f"{unit}_per_step"]),
            (f"{axis}.zero", table.get(f"zero_{unit}", 0)),
            (f"{axis}.steps_per_revolution", table.get("steps_per_revolution", 1000)),
            (f"{axis}.travel_min", table[f"travel_{unit}"][0]),
            (f"{axis}.travel_max", table[f"travel_{unit}"][1]),
            (f"{axis}.homes_up", table.get("homes") == "up"),
        ]
    limits = [
        (f"{axis}.soft_{end}", keys[axis][f"soft_limits_{unit}"][index])
        for axis, unit in (("linear", "mm"), ("rotary", "deg"))
        for index, end in enumerate(("min", "max"))
    ]
    names = ("surface_mm", "surface_above_pivot_mm", "probe_beside_pivot_mm", "probe_radius_mm")
    geometry = [(f"geometry.{name}", keys["geometry"][name]) for name in names]

    def digest(pairs):
        sha256 = hashlib.sha256()
        for word in (word for key, value in pairs for word in (key, repr(float(value)))):
            sha256.update(len(word).to_bytes(8, "big") + word.encode())
        return sha256.hexdigest()

    port = keys["bus"]["port"]
    place = port.get("serial") or port["tcp"]
    drives = [f"{keys[axis]['register_map']} at unit {keys[axis]['unit_id']}, {place}" for axis in ("linear", "rotary")]
    folder = Path(data) / "calibrations"
    folder.mkdir(parents=True)
    now = int(time.time())
    rest = {"geometry": geometry, "limits": limits}
    for step in ("stop", "signs", "geometry", "scale", "limits", "homing"):
        sha256 = digest(values + rest.get(step, []))
        text = [
            "format = 1", f'kind = "{step}"', 'verdict = "accepted"', 'made = "now"', f"made_unix_s = {now}",
            f"expires_unix_s = {now + 3600}", 'person = "a test"', 'software = "a test"', 'journal = []',
            f"drives = {drives!r}", f'keys_sha256 = "{sha256}"']
        (folder / f"{step}-1.toml").write_text("\n".join(text))
