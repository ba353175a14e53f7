#!/usr/bin/env python3
"""Uses the daemon as a script would, over HTTP with Python's own library.

Usage: http_client.py SERVE.log   (the stderr of `rigd serve --listen 127.0.0.1:0`)
"""

import http.client
import json
import re
import sys
import time
from pathlib import Path

DEADLINE_S = 60


def wait_for(what, condition):
    end = time.monotonic() + DEADLINE_S
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.05)
    raise SystemExit(f"gave up waiting for {what}")


def address(log):
    found = re.search(r"http://([0-9.]+):([0-9]+)/", Path(log).read_text())
    return found and (found[1], int(found[2]))


def main():
    host, port = wait_for("the address", lambda: address(sys.argv[1]))

    def ask(method, path, body=None, headers=None):
        connection = http.client.HTTPConnection(host, port, timeout=DEADLINE_S)
        connection.request(method, f"/api/v1{path}", body, headers or {})
        answer = connection.getresponse()
        text = answer.read().decode()
        is_json = "json" in answer.headers.get("content-type", "")
        connection.close()
        return answer.status, json.loads(text) if is_json and text else text, answer.headers

    def check(condition, what):
        if not condition:
            raise SystemExit(f"FAILED: {what}")

    wait_for("the rig", lambda: ask("GET", "/rig")[1]["state"] == "idle")
    _, rig, _ = ask("GET", "/rig")
    check(rig["probe"] == "clear", rig)

    order = json.dumps({"min_hz": 120, "max_hz": 165})
    status, sweep, headers = ask("POST", "/sweeps", order, {"content-type": "application/json"})
    check(status == 202, (status, sweep))
    location = headers["location"].removeprefix("/api/v1")
    done = wait_for("the sweep", lambda: (s := ask("GET", location)[1])["status"] != "running" and s)
    check(done["status"] == "accepted", done)

    status, problem, headers = ask("POST", "/sweeps", '{"min_hz": 200, "max_hz": 100}',
                                   {"content-type": "application/json"})
    check(status == 422 and "problem+json" in headers["content-type"], (status, problem))

    key = {"idempotency-key": "one"}
    status, first, _ = ask("POST", "/runs", headers=key)
    check(status == 202, (status, first))
    status, second, _ = ask("POST", "/runs", headers=key)
    check(status == 202 and first == second, "one key, two runs")
    run = first["id"]
    detail = wait_for("the run", lambda: (r := ask("GET", f"/runs/{run}")[1])["status"] != "running" and r)
    check(detail["status"] == "completed", detail)
    status, _, _ = ask("POST", f"/runs/{run}/pause")
    check(status == 409, "a finished run was paused")
    status, report, _ = ask("GET", f"/runs/{run}/report")
    check(status == 200 and "<svg" in report, "no report")
    status, touches, _ = ask("GET", f"/runs/{run}/export?format=csv")
    check(status == 200 and touches.startswith("step,"), touches[:80])

    connection = http.client.HTTPConnection(host, port, timeout=DEADLINE_S)
    connection.request("GET", "/api/v1/events", headers={"last-event-id": "0"})
    stream = connection.getresponse()
    ids = []
    while len(ids) < 100:
        line = stream.readline().decode()
        if line.startswith("id:"):
            ids.append(int(line[3:]))
    check(ids == sorted(set(ids)), "event ids do not rise")
    connection.close()

    status, rig, _ = ask("POST", "/stop")
    check(status == 200, (status, rig))
    wait_for("the latch", lambda: ask("GET", "/rig")[1]["state"] == "latched")
    status, problem, _ = ask("POST", "/runs")
    check(status == 409 and problem["hint"], (status, problem))
    ask("POST", "/acknowledge")
    wait_for("service", lambda: ask("GET", "/rig")[1]["state"] == "idle")
    status, _, headers = ask("GET", "/nothing")
    check(status == 404 and "problem+json" in headers["content-type"], "no problem for a 404")
    print("sweep, run, report, export, events, stop and acknowledge: all as they should be")


if __name__ == "__main__":
    main()
