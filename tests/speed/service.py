#!/usr/bin/env python3
"""rigd as a service beside the queueserver and the HTTP server of bluesky, on one computer in one run: the round trip of a
status, the time from the start until ready, memory, and the processor time of a durable event.

    tests/speed/service.py target/release/rigd PYTHON [--port 20710]

PYTHON is that of an environment with bluesky, bluesky-queueserver, bluesky-httpserver, ophyd and pandas, which the HTTP
server needs and does not ask for. `redis-server` must be installed, because the queueserver keeps its queue in it. The environment of the queueserver is opened before its memory is
read, as it must be before a plan can run.

A durable event is, of bluesky, a document of `count([det])` that a callback writes as JSON and gives to the disk
(`fdatasync`) before the next; `ophyd.sim` plays the detector. Of rigd it is a record of the journal, which it gives to the
disk in the same way, in a whole run on simulated instruments with all of its fits. `cargo bench -p rig-store` has the
journal alone.
"""

import argparse
import http.client
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser()
parser.add_argument("rigd", type=Path)
parser.add_argument("python", type=Path)
parser.add_argument("--port", type=int, default=20710, help="the first of four")
options = parser.parse_args()
ROUND_TRIPS, STARTS, PATIENCE_S = 500, 5, 120
KEY = "a" * 32

DOCUMENTS = """
import json, os, sys, time
from bluesky import RunEngine
from bluesky.plans import count
from ophyd.sim import det
engine, out, documents = RunEngine({}), open(sys.argv[1], "w"), 0
def keep(name, doc):
    global documents
    out.write(json.dumps([name, doc], default=str) + "\\n")
    out.flush()
    os.fdatasync(out.fileno())
    documents += 1
engine.subscribe(keep)
engine(count([det], num=20))
documents, began = 0, time.process_time()
engine(count([det], num=500))
print(json.dumps([documents, time.process_time() - began]))
"""


def get(connection, path, headers={}):
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read()


def until_ready(port, path, is_ready, headers={}, programs=()):
    """The seconds until the service says that it is ready."""
    began = time.perf_counter()
    while time.perf_counter() - began < PATIENCE_S:
        for program in programs:
            assert program.poll() is None, f"{program.args[0]} has ended"
        try:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
            if is_ready(*get(connection, path, headers)):
                return time.perf_counter() - began
        except OSError:
            pass
        time.sleep(0.002)
    raise AssertionError(f"{path} of port {port} is not ready")


def round_trips(port, path, headers={}):
    """Median and 99 % of the round trips on one connection, ms."""
    connection, times = http.client.HTTPConnection("127.0.0.1", port, timeout=10), []
    for _ in range(ROUND_TRIPS):
        began = time.perf_counter()
        status, text = get(connection, path, headers)
        times.append((time.perf_counter() - began) * 1e3)
        assert status == 200, (status, text)
    times.sort()
    return times[ROUND_TRIPS // 2], times[int(ROUND_TRIPS * 0.99)]


def family(pid):
    """A process and all that it started."""
    found = [pid]
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int(re.search(r"^PPid:\s+(\d+)", (folder / "status").read_text(), re.M)[1])
        except (OSError, TypeError):
            continue
        if parent == pid:
            found += family(int(folder.name))
    return found


def memory_mb(pids):
    """Resident memory; what processes share is counted once for all of them (Pss)."""
    kib = lambda pid: int(re.search(r"^Pss:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M)[1])
    return sum(kib(pid) for pid in pids) / 1024


def processor_s(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def end(process):
    process.terminate()
    process.wait(timeout=PATIENCE_S)


def rigd(folder):
    def start(data):
        began = time.perf_counter()
        log = open(folder / "rigd.log", "w+")
        daemon = subprocess.Popen([options.rigd.resolve(), "serve", "config/protocols/three-direction.toml", "--data", data,
                                   "--listen", f"127.0.0.1:{options.port}"], cwd=ROOT, stdout=log, stderr=log)
        until_ready(options.port, "/readyz", lambda status, _: status == 200)
        return daemon, time.perf_counter() - began

    starts = []
    for number in range(STARTS):
        daemon, took = start(folder / "data")
        starts.append(took)
        if number < STARTS - 1:
            end(daemon)
    try:
        trip = round_trips(options.port, "/api/v1/rig")
        memory = memory_mb(family(daemon.pid))
        connection = http.client.HTTPConnection("127.0.0.1", options.port, timeout=PATIENCE_S)
        before = processor_s(daemon.pid)
        connection.request("POST", "/api/v1/runs")
        run = json.loads(connection.getresponse().read())["id"]
        after, deadline = before, time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            rig = json.loads(get(connection, "/api/v1/rig")[1])
            if (rig.get("last_run") or {}).get("id") == run:
                break
            after = processor_s(daemon.pid)
            time.sleep(0.05)
        records = json.loads(get(connection, f"/api/v1/runs/{run}")[1])["records"]
    finally:
        end(daemon)
    return sorted(starts)[STARTS // 2], trip, memory, (after - before) / records * 1e3, records


def bluesky(folder):
    control, info, redis_port, port = (options.port + number for number in range(4))
    tools = options.python.parent
    environment = {**os.environ, "QSERVER_ZMQ_CONTROL_ADDRESS": f"tcp://localhost:{control}",
                   "QSERVER_ZMQ_INFO_ADDRESS": f"tcp://localhost:{info}",
                   "QSERVER_HTTP_SERVER_SINGLE_USER_API_KEY": KEY}
    profile = folder / "profile"
    profile.mkdir()
    (profile / "00-det.py").write_text("from ophyd.sim import det\nfrom bluesky.plans import count\n")
    redis = subprocess.Popen(["redis-server", "--port", str(redis_port), "--save", "", "--dir", folder],
                             stdout=subprocess.DEVNULL)
    headers = {"Authorization": f"ApiKey {KEY}"}
    is_idle = lambda status, text: status == 200 and json.loads(text)["manager_state"] == "idle"

    def start():
        began = time.perf_counter()
        log = open(folder / "bluesky.log", "a")
        manager = subprocess.Popen([tools / "start-re-manager", f"--zmq-control-addr=tcp://*:{control}",
                                    f"--zmq-info-addr=tcp://*:{info}", f"--redis-addr=localhost:{redis_port}",
                                    f"--startup-dir={profile}", "--keep-re"], env=environment, stdout=log, stderr=log)
        server = subprocess.Popen([tools / "uvicorn", "--host", "127.0.0.1", "--port", str(port),
                                   "bluesky_httpserver.server:app"], env=environment, stdout=log, stderr=log)
        try:
            until_ready(port, "/api/status", is_idle, headers, (manager, server))
        except AssertionError:
            end(server), end(manager)
            raise
        return manager, server, time.perf_counter() - began

    starts = []
    try:
        for number in range(STARTS):
            manager, server, took = start()
            starts.append(took)
            if number < STARTS - 1:
                end(server), end(manager)
        trip = round_trips(port, "/api/status", headers)
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        connection.request("POST", "/api/environment/open", headers=headers)
        opened = json.loads(connection.getresponse().read())
        assert opened["success"], opened
        has_worker = lambda _, text: json.loads(text)["worker_environment_exists"]
        until_ready(port, "/api/status", has_worker, headers)
        memory = memory_mb([pid for root in (manager, server, redis) for pid in family(root.pid)])
        end(server), end(manager)
    finally:
        end(redis)
    made = subprocess.run([options.python, "-c", DOCUMENTS, folder / "documents.jsonl"], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    documents, used_s = json.loads(made.stdout)
    return sorted(starts)[STARTS // 2], trip, memory, used_s / documents * 1e3, documents


def main():
    if not shutil.which("redis-server"):
        sys.exit("redis-server is not installed: apt-get install redis-server")
    found = {}
    for name, measure in (("rigd", rigd), ("bluesky", bluesky)):
        with tempfile.TemporaryDirectory() as folder:
            found[name] = measure(Path(folder))
    versions = subprocess.run([options.python, "-c", "import bluesky, bluesky_queueserver, bluesky_httpserver;"
                               "print(bluesky.__version__, bluesky_queueserver.__version__, bluesky_httpserver.__version__)"],
                              capture_output=True, text=True).stdout.strip()
    print(f"bluesky, queueserver, httpserver: {versions}; {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
    print("| | rigd | bluesky | bluesky : rigd |\n|---|---|---|---|")
    ours, theirs = found["rigd"], found["bluesky"]

    def line(what, word, of):
        print(f"| {what} | {word(ours)} | {word(theirs)} | {of(theirs) / of(ours):.0f} |")

    line("round trip of the status, median and 99 %, ms", lambda one: f"{one[1][0]:.2f}, {one[1][1]:.2f}", lambda one: one[1][0])
    line(f"start to ready, median of {STARTS}, s", lambda one: f"{one[0]:.3f}", lambda one: one[0])
    line("memory, MB", lambda one: f"{one[2]:.0f}", lambda one: one[2])
    line("processor time of a durable event, ms", lambda one: f"{one[3]:.2f} ({one[4]} events)", lambda one: one[3])

main()
