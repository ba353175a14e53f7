"""Devices for the run engine of bluesky, without a need for ophyd.

    from bluesky import RunEngine
    from bluesky.plans import scan
    from rigd_client import Rig
    from rigd_client.bluesky import Axis, Resonance

    rig = Rig()
    RE = RunEngine()
    RE(scan([Resonance(rig, 120, 165)], Axis(rig, "rotary"), 0, 45, 4), print)

Protocols of bluesky: https://blueskyproject.io/bluesky/main/hardware.html
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from .client import Rig, Sweep

Reading = dict[str, dict[str, Any]]


class Status:
    """Work in a thread, which says when it is done."""

    def __init__(self, work: Callable[[], None], timeout: float | None = None) -> None:
        self.timeout = timeout
        self.done = False
        self.success = False
        self._failure: BaseException | None = None
        self._callbacks: list[Callable[[Status], None]] = []
        self._lock = threading.Lock()
        self._over = threading.Event()
        threading.Thread(target=self._run, args=(work,), daemon=True).start()

    def _run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as failure:
            self._failure = failure
        with self._lock:
            self.success = self._failure is None
            self.done = True
            callbacks, self._callbacks = self._callbacks, []
        self._over.set()
        for callback in callbacks:
            callback(self)

    def add_callback(self, callback: Callable[[Status], None]) -> None:
        with self._lock:
            if not self.done:
                self._callbacks.append(callback)
                return
        callback(self)

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        self._over.wait(timeout)
        return self._failure

    def wait(self, timeout: float | None = None) -> None:
        if not self._over.wait(timeout):
            raise TimeoutError(f"not done within {timeout} s")
        if self._failure:
            raise self._failure


class Device:
    """What every device has. Nothing has to be configured or staged."""

    parent = None

    def __init__(self, rig: Rig, name: str) -> None:
        self.rig = rig
        self.name = name

    def read_configuration(self) -> Reading:
        return {}

    def describe_configuration(self) -> Reading:
        return {}

    def _key(self, what: str, units: str) -> dict[str, Any]:
        return {"source": f"{self.rig.url}/api/v1/{what}", "dtype": "number", "shape": [], "units": units}


class Axis(Device):
    """An axis that can be set: `linear` in mm, or `rotary` in degrees. Only under what the rig admits: the
    sample turns with the probe clear."""

    UNITS = {"linear": "mm", "rotary": "deg"}

    def __init__(self, rig: Rig, axis: str, name: str | None = None) -> None:
        super().__init__(rig, name or axis)
        self.axis = axis
        self.key = f"{axis}_{self.UNITS[axis]}"
        self.hints = {"fields": [self.name]}
        self._moving: Status | None = None

    @property
    def position(self) -> float:
        """The last read-back."""
        return float(self.rig.state[self.key])

    def set(self, value: float) -> Status:
        self._moving = Status(lambda: self._move(value))
        return self._moving

    def _move(self, value: float) -> None:
        self.rig.move(self.axis, float(value))

    def stop(self, *, success: bool = False) -> None:
        """Stops both axes and retracts; the rig latches. The run engine also asks for it with `success`, at the end of
        a plan and when it pauses: then only a move that is under way is stopped."""
        is_moving = self._moving is not None and not self._moving.done
        if is_moving or not success:
            self.rig.stop()

    def read(self) -> Reading:
        return {self.name: {"value": self.position, "timestamp": time.time()}}

    def describe(self) -> Reading:
        return {self.name: self._key("rig", self.UNITS[self.axis])}


class Resonance(Device):
    """The resonance of the sensor. A trigger measures one sweep at the present pose; a refused sweep fails it,
    with the reason."""

    def __init__(self, rig: Rig, min_hz: float, max_hz: float, name: str = "resonance", **options: float) -> None:
        super().__init__(rig, name)
        self.window = (min_hz, max_hz)
        self.options = options
        self.hints = {"fields": [f"{name}_hz"]}
        self._sweep: Sweep | None = None
        self._at = 0.0

    def trigger(self) -> Status:
        return Status(self._measure)

    def _measure(self) -> None:
        sweep = self.rig.sweep(*self.window, **self.options)
        # Raises the reason of a refusal.
        _ = sweep.resonance_hz
        self._sweep, self._at = sweep, time.time()

    def read(self) -> Reading:
        if self._sweep is None:
            raise RuntimeError("nothing has been measured: trigger first")
        values = (self._sweep.resonance_hz, self._sweep.sigma_hz)
        return {key: {"value": value, "timestamp": self._at} for key, value in zip(self.describe(), values)}

    def describe(self) -> Reading:
        return {f"{self.name}_hz": self._key("sweeps", "Hz"), f"{self.name}_sigma_hz": self._key("sweeps", "Hz")}
