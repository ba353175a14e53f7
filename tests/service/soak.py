#!/usr/bin/env python3
"""A soak: runs in virtual time, one after the other, under clients that come and go. Memory, handles and threads of the
daemon must stay flat.

    tests/service/soak.py target/release/rigd --seconds 90      # the short form
    tests/service/soak.py target/release/rigd --days 7          # a week on the rig's clock

After the warm-up, a line is fitted to what the daemon has after each run. Its slope, with twice its standard error, times
the runs that were measured, must stay below the bounds. Standard library only.
"""

import argparse
import http.client
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# The runs before these are the warm-up: caches of pages, statements, results and threads fill in them.
WARM_UP_RUNS = 12
WARM_UP_PART = 0.25
# Growth over the whole measured part. The heap of a program moves by some MB as clients come and go.
GROWTH_MAX = {"memory, MB": 10.0, "handles": 6.0, "threads": 2.0}
# Nothing in here takes longer than this, s.
PATIENCE_S = 120
# Pause between two looks at the rig, s: without one, half of the work would be that of looking.
POLL_S = 0.02
# Pause of a client of the crowd after each of its rounds, s. A second here is some minutes on the rig's clock.
PAUSE_S = 0.3
# A person stops the rig, and the configuration is reloaded, after this many runs.
STOP_EVERY, RELOAD_EVERY = 9, 7

parser = argparse.ArgumentParser()
parser.add_argument("rigd", type=Path)
length = parser.add_mutually_exclusive_group(required=True)
length.add_argument("--seconds", type=float, help="until so much time has passed here")
length.add_argument("--days", type=float, help="until so much time has passed on the rig's clock")
parser.add_argument("--alone", action="store_true", help="without the clients beside the one that begins the runs")
parser.add_argument("--csv", type=Path, help="write what was measured after each run to this file")
options = parser.parse_args()


class Client:
    """One connection that is kept, as that of a browser."""

    def __init__(self, port):
        self.port, self.connection = port, None

    def ask(self, method, path, body=None, headers=None):
        """The status and the body of an answer; the connection is made again once if the server has closed it."""
        data = None if body is None else json.dumps(body).encode()
        headers = {**({} if data is None else {"Content-Type": "application/json"}), **(headers or {})}
        for attempt in (1, 2):
            if self.connection is None:
                self.connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
            try:
                self.connection.request(method, path, data, headers)
                answer = self.connection.getresponse()
                return answer.status, answer.read()
            except (http.client.HTTPException, OSError):
                self.connection.close()
                self.connection = None
                if attempt == 2:
                    raise

    def json(self, path):
        status, text = self.ask("GET", path)
        assert status == 200, (path, status, text)
        return json.loads(text)

    def do(self, method, path, allowed, body=None, headers=None):
        status, text = self.ask(method, path, body, headers)
        assert status in allowed, (method, path, status, text)
        return text

    def wait_for(self, what, is_wanted):
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            if is_wanted(rig := self.json("/api/v1/rig")):
                return rig
            time.sleep(POLL_S)
        raise AssertionError(f"gave up waiting for {what}: {self.json('/api/v1/rig')}")


class Crowd:
    """Clients on threads of their own, until they are ended. What one of them did not expect is kept."""

    def __init__(self, port):
        self.port, self.ended, self.faults, self.counts = port, threading.Event(), [], {}
        works = [self.poll, self.poll, self.follow, self.follow, self.follow, self.read, self.leave]
        works = [] if options.alone else works
        self.threads = [threading.Thread(target=self.guard, args=(work,), daemon=True) for work in works]
        for thread in self.threads:
            thread.start()

    def guard(self, work):
        while not self.ended.is_set():
            try:
                work()
                self.counts[work.__name__] = self.counts.get(work.__name__, 0) + 1
            except Exception as error:  # whatever it is, it is a fault of the soak
                self.faults.append(f"{work.__name__}: {error!r}")
                return

    def poll(self):
        client = Client(self.port)
        for path in ("/api/v1/rig", "/api/v1/runs?limit=20", "/api/v1/queue", "/api/v1/rig"):
            client.json(path)
        for path in ("/metrics", "/healthz", "/", "/page.js", "/openapi.json"):
            client.do("GET", path, (200,))
        client.connection.close()
        self.ended.wait(PAUSE_S)

    def follow(self):
        """An event stream that is closed in the middle."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        connection.request("GET", "/api/v1/events?live=true&back=50")
        answer = connection.getresponse()
        assert answer.status == 200, answer.status
        for _ in range(200):
            if self.ended.is_set() or not answer.readline():
                break
        connection.close()
        self.ended.wait(PAUSE_S)

    def read(self):
        """The results of the last run, in every form. Without a run there is none; one may be under way."""
        client = Client(self.port)
        for path in ("", "/report", "/export?format=csv&table=touches", "/export?format=parquet&table=readings",
                     "/export?format=hdf5", "/export?format=documents", "/sweeps"):
            client.do("GET", f"/api/v1/runs/latest{path}", (200, 404))
        client.connection.close()
        self.ended.wait(PAUSE_S)

    def leave(self):
        """A client that asks and does not wait, and one that is wrong."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        connection.request("GET", "/api/v1/runs/latest/export?format=hdf5")
        connection.close()
        client = Client(self.port)
        client.do("GET", "/api/v1/nothing", (404,))
        client.do("POST", "/api/v1/protocols/check", (422,), {"protocol_toml": "name = 1"})
        client.connection.close()
        self.ended.wait(PAUSE_S)

    def end(self):
        self.ended.set()
        for thread in self.threads:
            thread.join(PATIENCE_S)
            assert not thread.is_alive(), "a client does not end"
        assert not self.faults, self.faults
        return self.counts


def measure(pid):
    status = Path(f"/proc/{pid}/status").read_text()
    number = lambda name: int(re.search(rf"^{name}:\s+(\d+)", status, re.M)[1])
    return {"memory, MB": number("VmRSS") / 1024, "handles": len(os.listdir(f"/proc/{pid}/fd")),
            "threads": number("Threads")}


def growth(values):
    """What a line through the values grows over all of them, and twice the standard error of that."""
    count = len(values)
    middle, mean = (count - 1) / 2, sum(values) / count
    spread = sum((at - middle) ** 2 for at in range(count))
    slope = sum((at - middle) * (value - mean) for at, value in enumerate(values)) / spread
    rest = sum((value - mean - slope * (at - middle)) ** 2 for at, value in enumerate(values))
    return slope * (count - 1), 2 * math.sqrt(rest / (count - 2) / spread) * (count - 1)


def one_run(client, number):
    """A run, in turn begun by a request with a key and by the queue; its id."""
    key = {"Idempotency-Key": f"soak-{number}"}
    before = client.json("/api/v1/rig").get("last_run", {}).get("id")
    if number % 2:
        for _ in range(2):
            begun = json.loads(client.do("POST", "/api/v1/runs", (202,), headers=key))["id"]
    else:
        begun = None
        for _ in range(2):
            client.do("POST", "/api/v1/queue", (200, 201), {"note": f"run {number}"}, key)
        client.do("POST", "/api/v1/queue/release", (200,))
    has_ended = lambda rig: (rig["state"] == "idle" and rig["last_run"] is not None
                             and rig["last_run"]["id"] != before)
    rig = client.wait_for(f"run {number}", lambda rig: rig.get("last_run") and has_ended(rig))
    run = rig["last_run"]
    assert begun in (None, run["id"]), (begun, run)
    assert run["status"].startswith("completed"), run
    client.do("PUT", f"/api/v1/runs/{run['id']}/note", (204,), {"note": f"soak {number}", "is_starred": False})
    return rig["rig_time_s"]


def soak(data):
    log = open(data / "log", "w+")
    command = [options.rigd.resolve(), "serve", "config/protocols/smoke.toml", "--data", data / "data",
               "--rig", "config/rigs/simulated.toml", "--config", data / "service.toml"]
    (data / "service.toml").write_text('listen = "127.0.0.1:0"\n')
    daemon = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log)
    try:
        end = time.monotonic() + PATIENCE_S
        while not (found := re.search(r"(http://[0-9.]+:\d+)/", Path(log.name).read_text())):
            assert daemon.poll() is None and time.monotonic() < end, Path(log.name).read_text()
            time.sleep(0.05)
        port = urllib.parse.urlsplit(found[1]).port
        client, samples, began = Client(port), [], time.monotonic()
        client.wait_for("an idle rig", lambda rig: rig["state"] == "idle")
        crowd, rig_s = Crowd(port), 0.0
        is_over = lambda: (time.monotonic() - began >= options.seconds if options.seconds
                           else rig_s >= options.days * 86400)
        while not is_over():
            number = len(samples) + 1
            rig_s = one_run(client, number)
            if number % RELOAD_EVERY == 0:
                name = f"lab-{number}.example"
                (data / "service.toml").write_text(f'listen = "127.0.0.1:0"\nallow_hosts = ["{name}"]\n')
                client.do("POST", "/api/v1/config/reload", (200,))
            if number % STOP_EVERY == 0:
                client.do("POST", "/api/v1/stop", (200,))
                client.wait_for("a latched rig", lambda rig: rig["state"] == "latched")
                client.do("POST", "/api/v1/acknowledge", (200,))
                client.wait_for("an idle rig", lambda rig: rig["state"] == "idle")
            samples.append({"rig_s": rig_s, "wall_s": time.monotonic() - began, **measure(daemon.pid)})
            assert daemon.poll() is None and not crowd.faults, crowd.faults
        counts = crowd.end()
        client.connection.close()
    finally:
        daemon.terminate()
        code = daemon.wait(timeout=PATIENCE_S)
    assert code == 0, (code, Path(log.name).read_text())
    verified = subprocess.run([options.rigd.resolve(), "verify", "latest", "--data", data / "data"], cwd=ROOT,
                              capture_output=True, text=True)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    return samples, counts


def main():
    with tempfile.TemporaryDirectory() as data:
        samples, counts = soak(Path(data))
    if options.csv:
        head = list(samples[0])
        rows = [",".join(f"{sample[name]:g}" for name in head) for sample in samples]
        options.csv.write_text("\n".join([",".join(f'"{name}"' for name in head), *rows]) + "\n")
    warm_up = max(WARM_UP_RUNS, int(WARM_UP_PART * len(samples)))
    measured = samples[warm_up:]
    assert len(measured) >= 10, f"{len(samples)} runs are too few to say anything"
    last = samples[-1]
    print(f"{len(samples)} runs, {last['rig_s'] / 3600:.1f} h on the rig's clock, {last['wall_s']:.0f} s here; "
          f"rounds of clients: {dict(sorted(counts.items()))}")
    is_flat = True
    for name, most in GROWTH_MAX.items():
        values = [sample[name] for sample in measured]
        grown, error = growth(values)
        is_flat &= grown + error <= most
        print(f"{name}: {values[0]:.1f} to {values[-1]:.1f} in {len(measured)} runs after {warm_up} of warm-up; "
              f"growth {grown:+.1f} ± {error:.1f}, at most {most:g} is allowed")
    if not is_flat:
        sys.exit("the daemon grows")


main()
