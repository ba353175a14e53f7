#!/usr/bin/env python3
"""Uses the installed Python client on a running simulated daemon: a sweep, a run, a refusal, and a scan by the
run engine of bluesky.

Usage: client.py URL   (the daemon has a protocol loaded and is idle)
"""

import sys
from pathlib import Path

from bluesky import RunEngine
from bluesky.plans import scan
from rigd_client import Problem, Rig
from rigd_client.bluesky import Axis, Resonance

from bench import check, equal

SMOKE = Path("config/protocols/smoke.toml")


def refused(work):
    try:
        work()
    except Problem as problem:
        return problem.status, str(problem)
    raise SystemExit("FAILED: not refused")


def main():
    rig = Rig(sys.argv[1], operator="Ada Lovelace")
    rig.wait_until_idle()
    sweep = rig.sweep(120, 165)
    check(120 < sweep.resonance_hz < 165 and 0 < sweep.sigma_hz < 1, f"sweep: {sweep}")

    equal(rig.check(SMOKE)["touches"], 18, "touches of the plan")
    status, text = refused(lambda: rig.check("name = 1\n"))
    equal(status, 422, "status of a protocol with faults")
    status, text = refused(lambda: rig.move("rotary", 80))
    check(status == 422 and "soft limits" in text, f"a move beyond the limits: {status} {text}")
    equal(refused(lambda: rig.find("no-such-run"))[0], 404, "status of a run that does not exist")

    run = rig.run(SMOKE, key="python client").wait()
    equal(rig.run(SMOKE, key="python client").id, run.id, "run of a repeated request")
    equal((run.status, rig.find().id), ("completed", run.id), "run")
    touches = run.touches()
    equal(len(touches), 18, "touches")
    check(all(float(touch["stiffness_mpa"]) > 0 for touch in touches), "a touch without a stiffness")
    # In pages of one, and all at once.
    rig.run(SMOKE).wait()
    names = [one["name"] for one in rig.runs(page=1)]
    check(names == [one["name"] for one in rig.runs()] and len(names) > 1, f"the list of runs: {names}")
    equal(run.export()[:4], b"PAR1", "first bytes of the Parquet file")

    documents = []
    axis, resonance = Axis(rig, "rotary"), Resonance(rig, 120, 165)
    RunEngine()(scan([resonance], axis, 0, 30, 3), lambda name, doc: documents.append((name, doc)))
    events = [doc["data"] for name, doc in documents if name == "event"]
    equal([round(event["rotary"], 1) for event in events], [0, 15, 30], "angles")
    check(all(120 < event["resonance_hz"] < 165 for event in events), f"resonances: {events}")
    equal(documents[-1][1]["exit_status"], "success", "exit status")
    rig.move("rotary", 0)
    # A pause of the run engine stops a move that is under way, and no other.
    axis.stop(success=True)
    equal(rig.state["state"], "idle", "state after the stop of a move that has ended")
    under_way = axis.set(45)
    axis.stop(success=True)
    stopped = under_way.exception(timeout=60)
    check(stopped is not None and rig.wait(lambda state: state["state"] == "latched", 60), f"a move after a stop: {stopped}")
    rig.acknowledge()
    failed = axis.set(80)
    check(isinstance(failed.exception(timeout=60), Problem), "a target beyond the limits is no failure")
    print(f"the Python client: {len(touches)} touches, and {len(events)} events of bluesky")


main()
