#!/usr/bin/env python3
"""Whether the unit of systemd allows every call that rigd makes of the system, while it serves a run with TLS, tokens, a
mail and an export, and ends.

    tests/service/syscalls.py target/release/rigd

`strace` and `systemd-analyze` must be installed. Standard library only.
"""

import json
import os
import re
import signal
import ssl
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

RIGD = Path(sys.argv[1]).resolve()
ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "config/service/rigd.service"
PATIENCE_S = 120
SETTINGS = """[[notifications.targets]]
name = "mail"
kind = "mail"
to = ["ada@lab.example"]
from = "rigd@bench.lab.example"
sendmail = "/bin/true"
events = ["end"]
"""


def group(name):
    """The calls of a group of systemd."""
    text = subprocess.run(["systemd-analyze", "syscall-filter", name], capture_output=True, text=True, check=True).stdout
    words = [line.strip() for line in text.splitlines()[1:]]
    calls = {word for word in words if re.fullmatch(r"\w+", word)}
    for word in words:
        if word.startswith("@"):
            calls |= group(word)
    return calls


def allowed():
    """The calls that the unit allows: its lines add and take away in their order."""
    calls = group("@default")
    for line in re.findall(r"^SystemCallFilter=(.*)$", UNIT.read_text(), re.M):
        named = set()
        for word in line.lstrip("~").split():
            named |= group(word) if word.startswith("@") else {word}
        calls = calls - named if line.startswith("~") else calls | named
    return calls


def made():
    """The calls of a daemon at work."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        data, trace, settings = folder / "data", folder / "trace", folder / "service.toml"
        settings.write_text(SETTINGS)
        token = subprocess.run([RIGD, "token", "new", "ada", "--role", "admin", "--data", data], capture_output=True, text=True,
                               check=True).stdout.strip()
        with open(folder / "log", "w+") as log:
            daemon = subprocess.Popen(["strace", "-f", "-qq", "-o", trace, RIGD, "serve", "config/protocols/smoke.toml", "--rig",
                                       "config/rigs/simulated.toml", "--config", settings, "--data", data, "--tls",
                                       "--listen", "127.0.0.1:0"], cwd=ROOT, stderr=log, stdout=subprocess.DEVNULL)
        end = time.monotonic() + PATIENCE_S

        def until(what, get):
            while time.monotonic() < end:
                try:
                    if found := get():
                        return found
                except OSError:
                    pass
                time.sleep(0.1)
            sys.exit(f"FAILED: gave up waiting for {what}: {Path(log.name).read_text()}")

        address = until("the address", lambda: re.search(r"https://[0-9.]+:\d+", Path(log.name).read_text()))[0]

        def ask(method, path):
            request = urllib.request.Request(address + path, method=method, headers={"Authorization": f"Bearer {token}"})
            trusted = ssl.create_default_context(cafile=data / "tls-certificate.pem")
            with urllib.request.urlopen(request, timeout=30, context=trusted) as answer:
                return answer.read()

        until("the rig", lambda: ask("GET", "/readyz"))
        run = json.loads(ask("POST", "/api/v1/runs"))["id"]
        until("the run", lambda: json.loads(ask("GET", f"/api/v1/runs/{run}"))["status"] != "running")
        for path in ("/metrics", f"/api/v1/runs/{run}/export?format=parquet&table=readings", f"/api/v1/runs/{run}/report"):
            ask("GET", path)
        subprocess.run([RIGD, "config", "reload", "--data", data], check=True, capture_output=True)
        subprocess.run([RIGD, "stop", "--data", data], capture_output=True)
        # strace itself does not end by a signal while it follows a program.
        for child in Path(f"/proc/{daemon.pid}/task/{daemon.pid}/children").read_text().split():
            os.kill(int(child), signal.SIGTERM)
        daemon.wait(timeout=PATIENCE_S)
        return set(re.findall(r"^\d+ +(\w+)\(", trace.read_text(errors="replace"), re.M))


def main():
    calls = made()
    if os.geteuid() == 0:
        # Only as root, SQLite gives its files to the owner of the database.
        calls.discard("fchown")
    refused = sorted(calls - allowed())
    if refused:
        sys.exit(f"FAILED: {UNIT.name} does not allow {', '.join(refused)}")
    print(f"{UNIT.name} allows all of the {len(calls)} calls that rigd makes")


main()
