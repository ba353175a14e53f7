#!/usr/bin/env python3
"""The alert rules and the dashboard in a real Prometheus that scrapes a daemon without tokens: every rule is healthy,
every query of the dashboard is answered, and what a daemon always has is not empty.

    tests/service/prometheus.py http://127.0.0.1:8137

`prometheus` must be installed. Standard library only.
"""

import json
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

SERVICE = Path(__file__).resolve().parents[2] / "config/service"
TARGET = urllib.parse.urlsplit(sys.argv[1]).netloc
PATIENCE_S = 60
# What a daemon has only after a run, a fit or a refusal.
LATER = ("reason", "verdict", "no_load", "resonance")


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def ask(port, path, **query):
    url = f"http://127.0.0.1:{port}/api/v1/{path}?{urllib.parse.urlencode(query)}"
    try:
        with urllib.request.urlopen(url, timeout=10) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        # While it starts it answers in words.
        if error.headers.get_content_type() != "application/json":
            raise
        return json.load(error)


def until(what, is_so):
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            if is_so():
                return
        except OSError:
            pass
        time.sleep(0.1)
    sys.exit(f"FAILED: gave up waiting for {what}")


def main():
    dashboard = json.loads((SERVICE / "grafana.json").read_text())
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", [])]
    port, failures = free_port(), []
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "prometheus.yml"
        # JSON is YAML.
        settings.write_text(json.dumps({
            "global": {"scrape_interval": "1s", "evaluation_interval": "1s"},
            "rule_files": [str(SERVICE / "alerts.yml")],
            "scrape_configs": [{"job_name": "rigd", "static_configs": [{"targets": [TARGET]}]}],
        }))
        with open(Path(folder) / "log", "w+") as log:
            server = subprocess.Popen(["prometheus", f"--config.file={settings}", f"--storage.tsdb.path={folder}/data",
                                       f"--web.listen-address=127.0.0.1:{port}"], stdout=log, stderr=log)
            try:
                scraped = lambda: ask(port, "query", query='count_over_time(up{job="rigd"}[1m]) >= 3')["data"]["result"]
                until("three scrapes", scraped)
                up = ask(port, "query", query='up{job="rigd"}')["data"]["result"]
                if up[0]["value"][1] != "1":
                    targets = ask(port, "targets")["data"]["activeTargets"]
                    sys.exit(f"FAILED: the figures cannot be read: {targets[0]['lastError']}")
                rules = lambda: [rule for group in ask(port, "rules")["data"]["groups"] for rule in group["rules"]]
                until("the rules", lambda: rules() and all(rule["health"] != "unknown" for rule in rules()))
                for rule in rules():
                    if rule["health"] != "ok":
                        failures.append(f"the rule {rule['name']}: {rule['lastError']}")
                checked, empty = len(rules()), 0
                for query in queries:
                    answer = ask(port, "query", query=query.replace("$instance", ".*"))
                    if answer["status"] != "success":
                        failures.append(f"{query}: {answer['error']}")
                    elif not answer["data"]["result"]:
                        empty += 1
                        if not any(word in query for word in LATER):
                            failures.append(f"{query} has no value")
            finally:
                server.terminate()
                server.wait(timeout=PATIENCE_S)
                sys.stdout.flush()
    for failure in failures:
        print("FAILED:", failure)
    if not failures:
        print(f"{checked} rules and {len(queries)} queries are in order; {empty} have no value before a run")
    sys.exit(bool(failures))


main()
