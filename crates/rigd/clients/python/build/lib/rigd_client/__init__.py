"""Client of rigd, without dependencies.

    from rigd_client import Rig

    rig = Rig()                                  # http://127.0.0.1:8137
    print(rig.sweep(min_hz=120, max_hz=165).resonance_hz)
    run = rig.run("smoke.toml").wait()
    print(run.touches())

`rigd_client.bluesky` has devices for the run engine of bluesky.
"""

from .client import Problem, Rig, Run, Sweep, TimedOut

__all__ = ["Problem", "Rig", "Run", "Sweep", "TimedOut"]
