"""The rig, its runs and its sweeps over HTTP."""

from __future__ import annotations

import csv
import io
import json
import re
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Json = dict[str, Any]

POLL_S = 0.05
"""Time between two questions while something is waited for."""

ENDED = frozenset({"completed", "completed_with_refusals", "aborted", "faulted", "interrupted"})


class Problem(Exception):
    """An answer of 400 or more: what is wrong, and often what to do."""

    def __init__(self, status: int, document: Json) -> None:
        self.status = status
        self.document = document
        hint = document.get("hint")
        text = f"{status}: {document.get('detail', '')}"
        super().__init__(f"{text} ({hint})" if hint else text)


class TimedOut(Exception):
    """Something did not happen in time."""


@dataclass(frozen=True)
class Sweep:
    """A single sweep that has ended."""

    id: str
    document: Json

    @property
    def is_accepted(self) -> bool:
        return bool(self.document["status"] == "accepted")

    @property
    def resonance_hz(self) -> float:
        """Series resonance, Hz. Raises ValueError with the reason if the sweep gave none."""
        return self._outcome("resonance_hz")

    @property
    def sigma_hz(self) -> float:
        """Its standard deviation, Hz."""
        return self._outcome("sigma_hz")

    def _outcome(self, key: str) -> float:
        outcome = self.document.get("outcome", {})
        if not self.is_accepted:
            raise ValueError(f"sweep {self.id} {self.document['status']}: {outcome.get('reason', 'no reason')}")
        return float(outcome[key])


class Rig:
    """A running daemon. Every method raises Problem if the daemon refuses the request."""

    def __init__(self, url: str = "http://127.0.0.1:8137", token: str | None = None,
                 operator: str | None = None, timeout_s: float = 60.0) -> None:
        self.url = url.rstrip("/")
        self.timeout_s = timeout_s
        self._headers: dict[str, str] = {}
        if token:
            self._headers["Authorization"] = f"Bearer {token}"
        if operator:
            self._headers["X-Operator"] = operator

    def request(self, method: str, path: str, body: Json | str | None = None,
                headers: dict[str, str] | None = None) -> bytes:
        """One request below `/api/v1`; a body of text is a protocol in TOML."""
        return self._request(method, path, body, headers)[0]

    def _request(self, method: str, path: str, body: Json | str | None = None,
                 headers: dict[str, str] | None = None) -> tuple[bytes, str]:
        """The answer, and its header `Link`."""
        sent = {**self._headers, **(headers or {})}
        data = None
        if isinstance(body, str):
            data, sent["Content-Type"] = body.encode(), "application/toml"
        elif body is not None:
            data, sent["Content-Type"] = json.dumps(body).encode(), "application/json"
        order = urllib.request.Request(f"{self.url}/api/v1{path}", data, sent, method=method)
        try:
            with urllib.request.urlopen(order, timeout=self.timeout_s) as answer:
                return bytes(answer.read()), str(answer.headers.get("Link", ""))
        except urllib.error.HTTPError as error:
            text = error.read()
            try:
                document = json.loads(text)
            except ValueError:
                document = {"detail": text.decode(errors="replace")}
            raise Problem(error.code, document) from None

    def get(self, path: str) -> Any:
        """The JSON of an answer."""
        return json.loads(self.request("GET", path))

    @property
    def state(self) -> Json:
        """The rig as it is now: state, probe, positions, run, prompt and fault."""
        document: Json = self.get("/rig")
        return document

    def wait(self, is_done: Callable[[Json], bool], timeout_s: float = 3600.0) -> Json:
        """Waits until the state fulfils a condition, and returns it."""
        end = time.monotonic() + timeout_s
        while not is_done(state := self.state):
            if time.monotonic() > end:
                raise TimedOut(f"the rig is {state['state']} after {timeout_s} s")
            time.sleep(POLL_S)
        return state

    def wait_until_idle(self, timeout_s: float = 600.0) -> Json:
        """Waits until nothing is under way. Raises RuntimeError if the rig latches."""
        state = self.wait(lambda state: state["state"] in ("idle", "latched"), timeout_s)
        if state["state"] == "latched":
            raise RuntimeError(f"the rig is latched: {state.get('fault', {}).get('cause', 'no cause')}")
        return state

    def move(self, axis: str, to: float) -> Json:
        """Moves `linear` to a height in mm or `rotary` to an angle in degrees, and waits."""
        self.request("POST", "/moves", {"axis": axis, "to": to})
        return self.wait_until_idle()

    def sweep(self, min_hz: float, max_hz: float, **options: float) -> Sweep:
        """One sweep at the present pose. Options are those of POST /api/v1/sweeps."""
        begun = json.loads(self.request("POST", "/sweeps", {"min_hz": min_hz, "max_hz": max_hz, **options}))
        end = time.monotonic() + 600.0
        while (document := self.get(f"/sweeps/{begun['id']}"))["status"] == "running":
            if time.monotonic() > end:
                raise TimedOut(f"sweep {begun['id']} still runs")
            time.sleep(POLL_S)
        return Sweep(begun["id"], document)

    def check(self, protocol: str | Path) -> Json:
        """The plan of a protocol: a path, or its text. Nothing moves."""
        plan: Json = json.loads(self.request("POST", "/protocols/check", _text(protocol)))
        return plan

    def run(self, protocol: str | Path | None = None, key: str | None = None) -> Run:
        """Begins a run: of a protocol, or of the one that the daemon has loaded. A repeated call with the
        same key begins no second run."""
        headers = {"Idempotency-Key": key} if key else None
        body = None if protocol is None else _text(protocol)
        return Run(self, json.loads(self.request("POST", "/runs", body, headers))["id"])

    @property
    def queue(self) -> Json:
        """The protocols that wait, in order, with what each asks of a person, and why the queue is held."""
        document: Json = self.get("/queue")
        return document

    def add_to_queue(self, protocol: str | Path | None = None, note: str = "",
                     deadline_unix_ms: int | None = None, key: str | None = None) -> Json:
        """Adds a protocol at the end of the queue, and returns the queue. Its run does not begin if it cannot
        end by the deadline. A repeated call with the same key adds no second entry."""
        form: Json = {"note": note, "deadline_unix_ms": deadline_unix_ms,
                      "protocol_toml": None if protocol is None else _text(protocol)}
        headers = {"Idempotency-Key": key} if key else None
        return self._change_queue("POST", "", form, headers)

    def move_in_queue(self, number: int, place: int) -> Json:
        """Moves an entry to another place, counted from 1."""
        return self._change_queue("POST", f"/{number}/move", {"place": place})

    def cancel_in_queue(self, number: int) -> Json:
        """Takes an entry out."""
        return self._change_queue("DELETE", f"/{number}")

    def hold_queue(self) -> Json:
        """Lets no entry begin until the queue is released."""
        return self._change_queue("POST", "/hold")

    def release_queue(self) -> Json:
        """Lets the entries begin, one after the other."""
        return self._change_queue("POST", "/release")

    def _change_queue(self, method: str, path: str, form: Json | None = None,
                      headers: dict[str, str] | None = None) -> Json:
        document: Json = json.loads(self.request(method, f"/queue{path}", form, headers))
        return document

    def find(self, name: str = "latest") -> Run:
        """A run by its id, its short name such as `smoke-7`, or `latest`."""
        return Run(self, self.get(f"/runs/{urllib.parse.quote(name, safe='')}")["id"])

    def runs(self, page: int = 1000) -> Iterator[Json]:
        """The runs, the latest first. They are fetched in pages of this many."""
        path = f"/runs?limit={page}"
        while path:
            text, link = self._request("GET", path)
            yield from json.loads(text)
            following = re.match(r'</api/v1([^>]*)>; rel="next"', link)
            path = following.group(1) if following else ""

    def stop(self) -> Json:
        """Stops both axes, retracts, and latches."""
        state: Json = json.loads(self.request("POST", "/stop"))
        return state

    def acknowledge(self) -> Json:
        """Leaves the latch: the rig is prepared again, retracting first."""
        self.request("POST", "/acknowledge")
        return self.wait_until_idle()


@dataclass(frozen=True)
class Run:
    """A run, under way or ended."""

    rig: Rig
    id: str

    @property
    def document(self) -> Json:
        """The run with its results so far."""
        document: Json = self.rig.get(f"/runs/{self.id}")
        return document

    @property
    def status(self) -> str:
        return str(self.document["status"])

    def wait(self, on_prompt: Callable[[Json], bool] | None = None, timeout_s: float = 24 * 3600.0) -> Run:
        """Waits until the run has ended. `on_prompt` gets the open prompt, does or asks for what it wants, and
        returns whether that is done; without it, somebody else must answer."""
        end = time.monotonic() + timeout_s
        while True:
            state = self.rig.state
            run = state.get("run")
            if not (run and run["id"] == self.id) and self.status in ENDED:
                return self
            if time.monotonic() > end:
                raise TimedOut(f"run {self.id} still runs after {timeout_s} s")
            asked = state.get("asked")
            if asked and on_prompt and on_prompt(asked):
                self.answer(asked["step"])
            time.sleep(POLL_S)

    def answer(self, step: str, refused: str | None = None) -> None:
        """Says that what a prompt asks for is done. After a refused touch: `widen`, `repeat`, `skip`, `abort`."""
        options = {"step": step, **({"refused": refused} if refused else {})}
        self.rig.request("POST", f"/runs/{self.id}/answer?{urllib.parse.urlencode(options)}")

    def pause(self) -> None:
        self.rig.request("POST", f"/runs/{self.id}/pause")

    def resume(self) -> None:
        self.rig.request("POST", f"/runs/{self.id}/resume")

    def abort(self) -> None:
        self.rig.request("POST", f"/runs/{self.id}/abort")

    def export(self, format: str = "parquet", table: str = "touches") -> bytes:
        """A table (`touches`, `sweeps`, `readings`, `searches`) as `csv` or `parquet`, or `documents`, `jsonl`."""
        return self.rig.request("GET", f"/runs/{self.id}/export?format={format}&table={table}")

    def touches(self) -> list[dict[str, str]]:
        """The table of touches; every value is text."""
        return list(csv.DictReader(io.StringIO(self.export("csv").decode())))


def _text(protocol: str | Path) -> str:
    """The text of a protocol: that of a file, or the text itself, which has more than one line."""
    if isinstance(protocol, Path) or "\n" not in protocol:
        return Path(protocol).read_text(encoding="utf-8")
    return protocol
