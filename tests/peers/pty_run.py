#!/usr/bin/env python3
"""Replays a short protocol in real time through the serial layer of the operating system: rigd as for
a real bench, on the pseudo-terminals of rig-sim, with a person at the terminal who does what rigd
asks for. Compares the results with those of the same protocol in memory, within their
uncertainties.

Usage: pty_run.py RIGD RIG_SIM
"""

import json
import math
import re
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from bench import DEADLINE_S, Sim, check, commission, equal, rig_file

PROTOCOL = "tests/peers/short.toml"
# As many standard deviations may two results of one truth differ: the scene has the same seed, and
# only what depends on the time is not the same in both.
SIGMAS = 4


def person(run, sim):
    """Reads what rigd asks for, does it on the bench, and says so."""
    asked, said = [], []
    for line in run.stderr:
        said.append(line)
        if "Press Enter" not in line:
            continue
        asked.append(line.strip())
        sample = re.search(r"sample \"?(\w+)\"?", line, re.IGNORECASE)
        if "turn" in line.lower():
            sim.say("turn left" if "left" in line.lower() else "turn front/back")
        elif sample:
            sim.say(f"place {sample[1]}")
        run.stdin.write("\n")
        run.stdin.flush()
    return asked, "".join(said)


def by_ports(rigd, rig_sim, folder):
    with Sim(rig_sim, "analyzer", "bus") as sim:
        rig = rig_file(folder, sim.ports["analyzer"], sim.ports["bus"])
        data = Path(folder) / "ports"
        commission(rig, data)
        command = [rigd, "run", PROTOCOL, "--rig", rig, "--data", data, "--json"]
        pipes = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        with subprocess.Popen(command, **pipes) as run:
            watchdog = threading.Timer(10 * DEADLINE_S, run.kill)
            watchdog.start()
            asked, said = person(run, sim)
            results = run.stdout.read()
            watchdog.cancel()
        check(run.returncode == 0, f"the run on ports ended with {run.returncode}: {said}")
        equal(len(asked), 2, f"prompts: {asked}")
        equal(sim.say("violations"), "0", "what must never happen")
        equal(sim.truth()["contact"], "no", "the probe at the end")
    return json.loads(results)


def in_memory(rigd, folder):
    command = [rigd, "run", PROTOCOL, "--data", Path(folder) / "memory", "--json"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    check(ended.returncode == 0, f"the run in memory: {ended.stderr}")
    return json.loads(ended.stdout)


def main():
    rigd, rig_sim = sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="peer-") as folder:
        memory = in_memory(rigd, folder)
        ports = by_ports(rigd, rig_sim, folder)
    check(memory["shifts"], "a shift in memory")
    for key in ("status", "touches", "prompts"):
        equal(ports[key], memory[key], key)
    for one, other in zip(ports["shifts"], memory["shifts"], strict=True):
        where = {key: one[key] for key in ("sample", "direction", "angle_deg")}
        equal(where, {key: other[key] for key in where}, "the order of the shifts")
        off = one["shift_hz"] - other["shift_hz"]
        sigma = math.hypot(one["sigma_hz"], other["sigma_hz"])
        check(abs(off) < SIGMAS * sigma, f"{where}: {one} through ports, {other} in memory")
        print(f"{where}: {one['shift_hz']:.2f} Hz through ports, {other['shift_hz']:.2f} Hz in memory; "
              f"{ports['wall_seconds']:.0f} s on the wall, {memory['rig_seconds']:.0f} s on the rig's clock")


if __name__ == "__main__":
    main()
