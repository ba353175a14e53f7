#!/usr/bin/env python3
"""Lets rigd drive the two AZ drives of az_server.py, over TCP and over a serial line, and looks at
what it asked of them and what it made of their answers.

Usage: az_peers.py RIGD RIG_SIM   (the simulator plays the analyzer only)
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from bench import DEADLINE_S, Program, Sim, check, commission, equal, rig_file

LATCHED = 4
HERE = Path(__file__).parent


def rigd(program, *arguments):
    command = [program, *map(str, arguments), "--json"]
    return subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)


def drive(program, analyzer, server, bus):
    """Moves both axes, and into what these drives do when they cannot."""
    with tempfile.TemporaryDirectory(prefix="peer-") as folder:
        rig = rig_file(folder, analyzer, bus)
        ended = rigd(program, "identify", "--rig", rig)
        check(ended.returncode == 0, f"rigd identifies the devices: {ended.stdout}{ended.stderr}")
        found = {device["role"]: device["identity"] for device in json.loads(ended.stdout)}
        equal(found["linear stage"], "oriental-az at unit 1", "the drive of the linear stage")
        ended = rigd(program, "doctor", "--rig", rig, "--data", folder)
        check(ended.returncode == 0, f"rigd finds nothing wrong: {ended.stdout}{ended.stderr}")
        findings = {(one["part"], one["check"]): one["text"] for one in json.loads(ended.stdout)["findings"]}
        equal(findings["linear stage", "position"], "40.000 mm, within its soft limits", "what it finds")

        def move(axis, to):
            heard = len(server.output())
            # Each in a journal of its own: what one has found out is not told to the next.
            data = tempfile.mkdtemp(dir=folder)
            commission(rig, data)
            ended = rigd(program, "move", axis, to, "--rig", rig, "--data", data)
            return ended, server.output()[heard:].splitlines()

        for axis, key, to, unit, steps in [
            ("linear", "linear_mm", 35.5, 1, 35_500),
            ("rotary", "rotary_deg", -12.34, 2, -1234),
        ]:
            ended, heard = move(axis, to)
            check(ended.returncode == 0, f"rigd moves {axis}: {ended.stderr}")
            equal(json.loads(ended.stdout)[key], to, "where it says the axis is")
            moves = [line for line in heard if line.startswith(f"unit {unit}: move ")]
            # It may have been said twice when the answer was late.
            check(moves and moves[-1].startswith(f"unit {unit}: move 1 {steps} "), f"{steps} in {heard}")
        for axis, to, word in [("linear", 44, "overload"), ("rotary", 48, "did not move")]:
            ended, heard = move(axis, to)
            equal(ended.returncode, LATCHED, f"the exit code of a move that fails: {ended.stderr}")
            check(word in ended.stderr, f"the reason: {ended.stderr}")
        for limits in ("unit 1: limits 8000 45000", "unit 2: limits -5000 5000"):
            check(limits in server.output(), f"the drive is told {limits}: {server.output()}")


def main():
    program, rig_sim = sys.argv[1:]
    az = [sys.executable, HERE / "az_server.py"]

    def listening(output):
        lines = output.split("\n")[:-1]
        return lines and lines[0].removeprefix("listening ")

    with Sim(rig_sim, "analyzer-tcp") as sim:
        analyzer = sim.ports["analyzer-tcp"]
        with Program(*az, "tcp") as server:
            drive(program, analyzer, server, server.wait_for("the server", listening))
        print("rigd on pymodbus's drives over TCP: identity, moves, an alarm, a refusal")
        with tempfile.TemporaryDirectory(prefix="peer-") as folder:
            ours, theirs = Path(folder) / "rigd", Path(folder) / "drives"
            cable = [f"pty,raw,echo=0,link={end}" for end in (ours, theirs)]
            with Program("socat", *cable) as wire:
                wire.wait_for("the cable", lambda _: ours.exists() and theirs.exists())
                with Program(*az, "serial", theirs) as server:
                    server.wait_for("the server", listening)
                    drive(program, analyzer, server, str(ours))
        print("rigd on pymodbus's drives over a serial line: identity, moves, an alarm, a refusal")


if __name__ == "__main__":
    main()
