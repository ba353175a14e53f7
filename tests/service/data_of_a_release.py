#!/usr/bin/env python3
"""Writes the data that a release leaves: a journal with a completed and an interrupted run, notes, tokens, a queue, an
outbox, the files of the configuration, and an archive. `cargo test -p rigd --test formats` reads all of it with the present
program, for each release since the first one (decision 128).

    tests/service/data_of_a_release.py target/release/rigd crates/rigd/tests/data/releases/0.1.0

Standard library only.
"""

import http.client
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RIGD, OUT = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
DATA, PATIENCE_S = OUT / "data", 60
PROTOCOL = """name = "release"
samples = ["1"]
directions = ["front", "left"]
angles_deg = [0, 45]
seed = 1
"""
SETTINGS = """[notifications]
[[notifications.targets]]
name = "nobody"
kind = "webhook"
url = "http://127.0.0.1:9/"
events = ["end"]
"""


def rigd(*arguments):
    done = subprocess.run([RIGD, *arguments], cwd=OUT, capture_output=True, text=True)
    assert done.returncode == 0, (arguments, done.stderr)
    return done.stdout.strip()


def until(what, get):
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if found := get():
            return found
        time.sleep(0.01)
    sys.exit(f"gave up waiting for {what}")


def main():
    OUT.mkdir(parents=True)
    smoke = (ROOT / "config/protocols/smoke.toml").read_text()
    (OUT / "protocol.toml").write_text(PROTOCOL + smoke[smoke.index("\n[touch]"):smoke.index("\n[blind]")])
    rig = (ROOT / "config/rigs/simulated.toml").read_text()
    (OUT / "rig.toml").write_text(rig.replace('"../scenes/paper.toml"', '"scene.toml"'))
    shutil.copy(ROOT / "config/scenes/paper.toml", OUT / "scene.toml")
    (OUT / "service.toml").write_text(SETTINGS)
    own = ["--data", "data"]
    tokens = {role: rigd("token", "new", role, "--role", role, *own) for role in ("view", "operate", "admin")}
    for _ in range(2):
        rigd("run", "protocol.toml", "--rig", "rig.toml", "--operator", "Ada", *own)
    # The tables and reports can be made again.
    shutil.rmtree(DATA / "runs")
    rigd("archive", "archive", "release-1", "--operator", "Ada", *own)

    with open(OUT / "log", "w+") as log:
        daemon = subprocess.Popen([RIGD, "serve", "protocol.toml", "--rig", "rig.toml", "--config", "service.toml",
                                   "--listen", "127.0.0.1:0", *own], cwd=OUT, stderr=log, stdout=subprocess.DEVNULL)
    found = until("the address", lambda: re.search(r"http://([0-9.:]+)/", (OUT / "log").read_text()))

    def ask(method, path, body=None, **headers):
        connection = http.client.HTTPConnection(found[1], timeout=PATIENCE_S)
        data = None if body is None else json.dumps(body)
        kind = {"Content-Type": "application/json"} if data else {}
        connection.request(method, path, data, {"Authorization": f"Bearer {tokens['operate']}", **kind, **headers})
        with connection.getresponse() as answer:
            return answer.status, answer.read()

    def rig():
        return json.loads(ask("GET", "/api/v1/rig")[1])

    until("the rig", lambda: ask("GET", "/readyz")[0] == 200)
    assert ask("PUT", "/api/v1/runs/release-2/note", {"note": "a note\nof 30°", "is_starred": True})[0] == 204
    deadline = {"deadline_unix_ms": 4_000_000_000_000, "note": "later"}
    for number, body in enumerate(({"note": "first"}, deadline)):
        answer = ask("POST", "/api/v1/queue", body, **{"Idempotency-Key": f"key-{number}"})
        assert answer[0] == 201, answer
    # A message about its end cannot be sent.
    assert ask("POST", "/api/v1/runs")[0] == 202
    until("a message that waits", lambda: (DATA / "outbox.json").exists()
          and json.loads((DATA / "outbox.json").read_text())["messages"])
    # One that is killed between two of its steps.
    interrupted = json.loads(ask("POST", "/api/v1/runs")[1])["id"]
    until("some steps", lambda: (rig().get("run") or {}).get("step", 0) > 2)
    assert ask("POST", f"/api/v1/runs/{interrupted}/pause")[0] == 202
    until("the pause", lambda: rig()["state"] == "paused")
    daemon.kill()
    daemon.wait()
    results = json.loads(rigd("show", "release-2", "--json", *own))
    touches = {touch["step"]: touch.get("resonance_hz") for touch in results["touch_results"]}
    expected = {"tokens": tokens, "interrupted": interrupted, "touches": touches,
                "archived": json.loads(rigd("runs", "--json", "--data", "archive"))[0]["run_id"]}
    (OUT / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")
    for name in ("daemon.json", "rigd.lock", "tokens.lock"):
        (DATA / name).unlink(missing_ok=True)
    shutil.rmtree(DATA / "runs", ignore_errors=True)
    (OUT / "log").unlink()
    (OUT / "archive/archive.lock").unlink(missing_ok=True)


main()
