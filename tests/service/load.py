#!/usr/bin/env python3
"""What clients cost the rig: round trips of `GET /rig` at 64 clients, and how late the rig loop wakes, also while 1000
clients ask for event streams.

    tests/service/load.py target/release/rigd [SECONDS]

Standard library only. The clients run on the same computer, so that they take its processors too.
"""

import http.client
import re
import selectors
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

RIGD = Path(sys.argv[1]).resolve()
SECONDS = float(sys.argv[2]) if len(sys.argv) > 2 else 10
ROOT = Path(__file__).resolve().parents[2]


def late(port, connection=None):
    connection = connection or http.client.HTTPConnection("127.0.0.1", port)
    connection.request("GET", "/metrics")
    text = connection.getresponse().read().decode()
    bins = re.findall(r'rigd_loop_late_seconds_bucket\{le="([^"]+)"\} (\d+)', text)
    return [(float(bound.replace("+Inf", "inf")), int(count)) for bound, count in bins]


def quantile(before, after, part):
    counts = [(bound, new - old) for (bound, new), (_, old) in zip(after, before)]
    total = counts[-1][1]
    return next(bound for bound, count in counts if count >= part * total), total


def client(port, pause, times, ended):
    connection = http.client.HTTPConnection("127.0.0.1", port)
    while not ended.is_set():
        began = time.perf_counter()
        connection.request("GET", "/api/v1/rig")
        connection.getresponse().read()
        times.append(time.perf_counter() - began)
        time.sleep(pause)


def load(port, clients, pause):
    times, ended = [], threading.Event()
    before = late(port)
    threads = [threading.Thread(target=client, args=(port, pause, times, ended)) for _ in range(clients)]
    for thread in threads:
        thread.start()
    time.sleep(SECONDS)
    ended.set()
    for thread in threads:
        thread.join()
    bound, wakes = quantile(before, late(port), 0.999)
    times.sort()
    at = lambda part: times[int(part * (len(times) - 1))] * 1e3 if times else 0
    print(f"{clients:3} clients every {pause * 1e3:4.0f} ms: {len(times) / SECONDS:6.0f} requests/s, "
          f"p50 {at(.5):5.2f} ms, p99 {at(.99):6.2f} ms; loop late at most {bound * 1e3:g} ms in 99.9 % of {wakes} wakes")


def streams(port, wanted):
    """So many clients ask for event streams at once, while a run is under way, and each asks again when it is refused."""
    connection = http.client.HTTPConnection("127.0.0.1", port)
    connection.request("POST", "/api/v1/runs")
    begun = connection.getresponse()
    assert begun.status == 202, begun.read()
    begun.read()
    # The daemon keeps this connection while it is used: a new one would wait behind the crowd.
    before, ended = late(port, connection), time.monotonic() + SECONDS
    request = b"GET /api/v1/events?live=true HTTP/1.1\r\nhost: localhost\r\n\r\n"
    selector, answered, asked_at = selectors.DefaultSelector(), {}, time.monotonic()

    def ask():
        client = socket.socket()
        client.setblocking(False)
        client.connect_ex(("127.0.0.1", port))
        selector.register(client, selectors.EVENT_WRITE)

    for _ in range(wanted):
        ask()
    streaming, received = set(), 0
    while time.monotonic() < ended:
        if time.monotonic() > asked_at + 1:
            asked_at, after = time.monotonic(), late(port, connection)
        for key, events in selector.select(timeout=0.2):
            client = key.fileobj
            try:
                if events & selectors.EVENT_WRITE:
                    client.send(request)
                    selector.modify(client, selectors.EVENT_READ)
                    continue
                part = client.recv(65536)
            except OSError:
                part = b""
            received += len(part)
            if client not in streaming and part.startswith(b"HTTP/1.1 "):
                status = part[9:12].decode()
                answered[status] = answered.get(status, 0) + 1
                if status == "200":
                    streaming.add(client)
            if not part:
                selector.unregister(client)
                client.close()
                streaming.discard(client)
                ask()
    bound, wakes = quantile(before, after, 0.999)
    stop, began = http.client.HTTPConnection("127.0.0.1", port, timeout=60), time.perf_counter()
    stop.request("POST", "/api/v1/stop")
    assert stop.getresponse().status == 200
    took_s = time.perf_counter() - began
    for key in list(selector.get_map().values()):
        key.fileobj.close()
    words = ", ".join(f"{count} times {status}" for status, count in sorted(answered.items()))
    print(f"{wanted} clients ask for event streams during a run: {len(streaming)} open, answers {words}, "
          f"{received / SECONDS / 1e3:.0f} kB/s; loop late at most {bound * 1e3:g} ms in 99.9 % of {wakes} wakes; "
          f"a stop among them is answered after {took_s * 1e3:.0f} ms")


with tempfile.TemporaryDirectory() as data:
    rig = Path(data) / "rig.toml"
    text = (ROOT / "config/rigs/simulated.toml").read_text()
    scenes = (ROOT / "config/scenes").as_posix()
    rig.write_text(text.replace('"../scenes/', f'"{scenes}/').replace('pace = "virtual"', 'pace = "real"'))
    log = open(Path(data) / "log", "w+")
    daemon = subprocess.Popen([RIGD, "serve", "--rig", rig, "--data", data, "--listen", "127.0.0.1:0",
                               "config/protocols/smoke.toml"],
                              cwd=ROOT, stderr=log, stdout=subprocess.DEVNULL)
    try:
        while not (found := re.search(r"http://[0-9.]+:(\d+)/", Path(log.name).read_text())):
            assert daemon.poll() is None, Path(log.name).read_text()
            time.sleep(0.05)
        port = int(found[1])
        while True:
            connection = http.client.HTTPConnection("127.0.0.1", port)
            connection.request("GET", "/readyz")
            if connection.getresponse().status == 200:
                break
            assert daemon.poll() is None, Path(log.name).read_text()
        for clients, pause in ((0, 1), (1, 0.01), (64, 0.5), (64, 0.1)):
            load(port, clients, pause)
        streams(port, 1000)
    finally:
        daemon.terminate()
        daemon.wait(timeout=60)
