#!/usr/bin/env python3
"""What clients cost the rig: how late readings are in real time, and the round trip of `GET /rig`, without clients, with
64 that poll, and with 64 that poll, 1000 event streams and an export of 2 GB; then a stop among clients that connect.

    cargo build --release --locked -p rigd && cargo build --release --locked -p rig-store --example long_run
    tests/service/load.py target/release/rigd [--seconds 60] [--export-mb 2000] [--streams 1000]

Standard library only. The clients run on the same computer. Those of the streams and of the export have a lower priority
than the daemon: elsewhere they would not take its processors at all.
"""

import argparse
import http.client
import json
import multiprocessing
import os
import re
import selectors
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser()
parser.add_argument("rigd", type=Path)
parser.add_argument("--seconds", type=float, default=60, help="of each part")
parser.add_argument("--export-mb", type=int, default=2000)
parser.add_argument("--streams", type=int, default=1000)
parser.add_argument("--nice", type=int, default=0, help="nice value of the daemon; below 0 only as root; the unit has -5")
parser.add_argument("--connecting", type=int, default=2000, help="clients that connect when a stop is asked for")
options = parser.parse_args()
RIGD = options.rigd.resolve()
POLLERS, POLL_S = 64, 0.5
CLIENT_NICE = 10
# A sweep at one reading after the other, as fast as the bench gives them.
SWEEP = {"min_hz": 130.0, "max_hz": 150.0, "points": 800, "cycles": 1, "settle_s": 0.0, "time_limit_s": 600.0}


def ask(port, method, path, body=None):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    data = None if body is None else json.dumps(body)
    connection.request(method, path, data, {"Content-Type": "application/json"} if data else {})
    answer = connection.getresponse()
    return answer.status, answer.read()


def sweeps(port, seconds):
    """How late each reading begins, s: its time less the end of the one before."""
    late, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        status, text = ask(port, "POST", "/api/v1/sweeps", SWEEP)
        assert status == 202, text
        path = f"/api/v1/sweeps/{json.loads(text)['id']}"
        while True:
            time.sleep(1)
            sweep = json.loads(ask(port, "GET", path)[1])
            if sweep["status"] != "running":
                break
        assert sweep["status"] in ("accepted", "refused"), sweep["status"]
        readings = sweep["readings"]
        for before, after in zip(readings, readings[1:]):
            due = before["started_s"] + before["integration_s"] + after["settle_s"]
            late.append(after["started_s"] - due)
    return late


def at(values, part):
    return sorted(values)[min(int(part * len(values)), len(values) - 1)]


def poll(port, ended, found):
    """64 clients, each with a connection of its own and a request every half second; the times from sending to the end of
    the answer. One thread serves them, so that it adds little to the times."""
    clients, began = [], time.perf_counter()
    for index in range(POLLERS):
        client = socket.create_connection(("127.0.0.1", port))
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        clients.append([client, began + POLL_S * index / POLLERS, None])
    selector = selectors.DefaultSelector()
    for client in clients:
        selector.register(client[0], selectors.EVENT_READ, client)
    request, times = b"GET /api/v1/rig HTTP/1.1\r\nhost: localhost\r\n\r\n", []
    while not ended.is_set():
        now = time.perf_counter()
        for client in clients:
            if client[2] is None and client[1] <= now:
                client[2] = time.perf_counter()
                client[0].sendall(request)
        due = min((client[1] for client in clients if client[2] is None), default=now + 0.05)
        for key, _ in selector.select(max(0.0, min(due - time.perf_counter(), 0.05))):
            client = key.data
            answer = client[0].recv(1 << 20)
            assert answer.startswith(b"HTTP/1.1 200") and answer.endswith(b"}"), answer[:80]
            times.append(time.perf_counter() - client[2])
            client[1], client[2] = client[1] + POLL_S, None
    found.put(times)


def stream(port, ended, found):
    """Event streams with the live rig, all read by one process."""
    selector, received, answered = selectors.DefaultSelector(), 0, {}
    for _ in range(options.streams):
        client = socket.create_connection(("127.0.0.1", port))
        client.sendall(b"GET /api/v1/events?live=true HTTP/1.1\r\nhost: localhost\r\n\r\n")
        client.setblocking(False)
        selector.register(client, selectors.EVENT_READ, [])
    while not ended.is_set():
        for key, _ in selector.select(0.2):
            try:
                part = key.fileobj.recv(1 << 18)
            except OSError:
                part = b""
            received += len(part)
            if not key.data:
                key.data.append(part[9:12].decode())
            if not part:
                selector.unregister(key.fileobj)
                key.data.append("ended")
    for key in selector.get_map().values():
        word = " ".join(key.data) or "silent"
        answered[word] = answered.get(word, 0) + 1
    found.put((answered, received))


def export(port, run, ended, found):
    """Exports of the readings as CSV, one after the other, whose bytes are counted and dropped."""
    took, exports, now = 0, 0, 0
    began = time.monotonic()
    while not ended.is_set():
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
        connection.request("GET", f"/api/v1/runs/{run}/export?format=readings")
        answer = connection.getresponse()
        assert answer.status == 200, answer.read()
        while not ended.is_set() and (part := answer.read(1 << 18)):
            took += len(part)
        exports += answer.isclosed()
        connection.close()
    found.put((took, exports, time.monotonic() - began))


def memory_mb(pid, name="VmRSS"):
    return int(re.search(rf"^{name}:\s+(\d+)", Path(f"/proc/{pid}/status").read_text(), re.M)[1]) / 1024


def turns(pid):
    """Of the rig thread: the time that it ran, and that it waited for a processor, s, and the number of its turns."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        if (task / "comm").read_text().strip() == "rig":
            run_ns, waited_ns, count = map(int, (task / "schedstat").read_text().split())
            return run_ns / 1e9, waited_ns / 1e9, count


class Client:
    def __init__(self, work, *arguments, nice=CLIENT_NICE):
        self.ended, self.found = multiprocessing.Event(), multiprocessing.Queue()
        self.process = multiprocessing.Process(target=self.run, args=(work, arguments, nice))
        self.process.start()

    def run(self, work, arguments, nice):
        os.nice(nice)
        work(*arguments, self.ended, self.found)

    def end(self):
        self.ended.set()
        found = self.found.get(timeout=60)
        self.process.join()
        return found


def measured(name, port, pid, clients):
    time.sleep(2 if clients else 0)
    before = turns(pid)
    late = sweeps(port, options.seconds)
    run_s, waited_s, count = (now - then for now, then in zip(turns(pid), before))
    found = [client.end() for client in clients]
    middle = at(late, 0.5)
    ms = lambda part: (at(late, part) - middle) * 1e3
    print(f"{name}: of {len(late)} readings 99 % are later than the median by at most {ms(.99):.2f} ms, "
          f"99.9 % by {ms(.999):.2f} ms, all by {ms(1):.2f} ms; the daemon has {memory_mb(pid):.0f} MB")
    print(f"  the rig thread ran for {run_s * 1e3:.0f} ms in {count} turns, and waited for a processor {waited_s / count * 1e3:.2f} ms "
          "before each in the mean")
    if found:
        times = found[0]
        print(f"  {len(times)} requests of {POLLERS} pollers: median {at(times, .5) * 1e3:.2f} ms, "
              f"99 % {at(times, .99) * 1e3:.2f} ms, all {max(times) * 1e3:.1f} ms")
    if len(found) > 1:
        (answered, received), (took, exports, export_s) = found[1:]
        words = ", ".join(f"{count} {word}" for word, count in sorted(answered.items()))
        print(f"  streams: {words}, {received / 1e6:.0f} MB; exports: {took / 1e6:.0f} MB in {export_s:.0f} s, "
              f"{exports} whole")
    return at(late, 0.999) - middle


def stop_among(port, crowd):
    """This many clients connect at once and ask for streams; how long a stop takes that is asked for behind them."""
    selector = selectors.DefaultSelector()
    for _ in range(crowd):
        client = socket.socket()
        client.setblocking(False)
        client.connect_ex(("127.0.0.1", port))
        selector.register(client, selectors.EVENT_WRITE)
    stop = socket.socket()
    began = time.perf_counter()
    stop.setblocking(False)
    stop.connect_ex(("127.0.0.1", port))
    selector.register(stop, selectors.EVENT_WRITE)
    is_over, answer, connected_s, answered = False, b"", 0.0, {}
    while not is_over:
        for key, events in selector.select(0.2):
            client = key.fileobj
            try:
                if events & selectors.EVENT_WRITE:
                    if client is stop:
                        connected_s = time.perf_counter() - began
                        client.send(b"POST /api/v1/stop HTTP/1.1\r\nhost: localhost\r\ncontent-length: 0\r\n\r\n")
                    else:
                        client.send(b"GET /api/v1/events?live=true HTTP/1.1\r\nhost: localhost\r\n\r\n")
                    selector.modify(client, selectors.EVENT_READ)
                    continue
                part = client.recv(65536)
            except OSError:
                part = b""
            if client is stop:
                is_over, answer = True, part
                break
            status = part[9:12].decode() or "closed"
            answered[status] = answered.get(status, 0) + 1
            selector.unregister(client)
    took_s = time.perf_counter() - began
    assert answer.startswith(b"HTTP/1.1 200"), answer[:200]
    print(f"a stop behind {crowd} clients that connect at once: connected after {connected_s * 1e3:.0f} ms, answered "
          f"after {took_s * 1e3:.0f} ms, when the others had {dict(sorted(answered.items()))}")
    for key in list(selector.get_map().values()):
        key.fileobj.close()


def main():
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        data, rig = folder / "data", folder / "rig.toml"
        made = subprocess.run([RIGD, "run", "config/protocols/smoke.toml", "--data", data, "--json"], cwd=ROOT,
                              capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        # A reading has more bytes in CSV than in the journal.
        long_run = RIGD.parent / "examples/long_run"
        run = subprocess.run([long_run, data, "latest", str(int(options.export_mb * 0.6))], capture_output=True,
                             text=True, check=True).stdout.strip()
        text = (ROOT / "config/rigs/simulated.toml").read_text()
        scenes = (ROOT / "config/scenes").as_posix()
        rig.write_text(text.replace('"../scenes/', f'"{scenes}/').replace('pace = "virtual"', 'pace = "real"'))
        with open(folder / "log", "w+") as log:
            daemon = subprocess.Popen(["nice", "-n", str(options.nice), RIGD, "serve", "--rig", rig, "--data", data, "--listen", "127.0.0.1:0",
                                       "config/protocols/smoke.toml"], cwd=ROOT, stderr=log,
                                      stdout=subprocess.DEVNULL)
        try:
            while not (found := re.search(r"http://[0-9.]+:(\d+)/", Path(log.name).read_text())):
                assert daemon.poll() is None, Path(log.name).read_text()
                time.sleep(0.05)
            port = int(found[1])
            while ask(port, "GET", "/readyz")[0] != 200:
                assert daemon.poll() is None, Path(log.name).read_text()
                time.sleep(0.05)
            print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} at the start")
            alone = measured("no clients", port, daemon.pid, [])
            measured("64 pollers", port, daemon.pid, [Client(poll, port, nice=0)])
            loaded = measured(f"64 pollers, {options.streams} streams, an export", port, daemon.pid,
                              [Client(poll, port, nice=0), Client(stream, port), Client(export, port, run)])
            print(f"99.9 % of the readings: {(loaded - alone) * 1e3:+.2f} ms by all clients; "
                  f"at most {memory_mb(daemon.pid, 'VmHWM'):.0f} MB")
            for crowd in (1, 1000, options.connecting):
                stop_among(port, crowd)
        finally:
            daemon.terminate()
            daemon.wait(timeout=60)
            sys.stdout.flush()


main()
