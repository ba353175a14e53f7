#!/usr/bin/env python3
"""Runs a protocol on a daemon over HTTP and prints the touches, with Python's standard library alone.

Usage: client.py [URL]

Start the daemon first: rigd serve config/protocols/smoke.toml
"""

import csv
import io
import json
import sys
import time
import urllib.request

API = (sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8137").rstrip("/") + "/api/v1"


def request(method, path, body=None):
    """The text of the answer. An answer of 400 or more raises urllib.error.HTTPError."""
    headers = {} if body is None else {"Content-Type": "application/json"}
    data = None if body is None else json.dumps(body).encode()
    order = urllib.request.Request(API + path, data, headers, method=method)
    with urllib.request.urlopen(order, timeout=60) as answer:
        return answer.read().decode()


def wait_while(path, key, value, limit_s=600):
    """Polls until the key has another value, and returns the whole answer."""
    end = time.monotonic() + limit_s
    while (state := json.loads(request("GET", path)))[key] == value:
        if time.monotonic() > end:
            sys.exit(f"{path}: {key} is still {value} after {limit_s} s")
        time.sleep(0.1)
    return state


rig = wait_while("/rig", "state", "preparing")
print(f"the rig is {rig['state']}, the probe is {rig['probe']}")

sweep = json.loads(request("POST", "/sweeps", {"min_hz": 120, "max_hz": 165}))
found = wait_while(f"/sweeps/{sweep['id']}", "status", "running")["outcome"]
print(f"no-load resonance: {found['resonance_hz']:.3f} Hz ± {found['sigma_hz']:.3f} Hz")

run = json.loads(request("POST", "/runs"))["id"]
print("run:", wait_while(f"/runs/{run}", "status", "running")["status"])
for touch in csv.DictReader(io.StringIO(request("GET", f"/runs/{run}/export?format=csv"))):
    print(f"{touch['sample']} {touch['direction']} {touch['angle_deg']}°: {float(touch['shift_hz']):.2f} Hz")
