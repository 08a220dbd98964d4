"""Logs of MOON and ROSMonitoring: a JSON object a line.

``{"topic": "level", "time": 12.0, "data": 30}`` is a message: what is not ``topic``, ``time`` or the
oracle's is its fields. ``{"service": "add", "time": 12.0, "request": {…}}`` and the same with
``response`` are the halves of a call. Names may lack their first ``/``; MOON's are whole seconds
(generator.py, ``float(now().to_msg().sec)``), so the order of the lines is the order of events. A line
may say of which version its format is (``format_version``); one without is of the first.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import IO, Any

import msgspec

from m2c.json_format import VERSION, VERSION_KEY
from moon.recording.stored import plural
from transports.interface import Observation, ObservationKind

MAX_LINE = 16 * 1024 * 1024
MAX_NAMED = 20
"""Lines that cannot be read are named one by one, up to so many."""

_ORACLES = ("topic", "time", "t", "verdict", "spec", VERSION_KEY)
"""Keys of a message's line that are no fields of it."""
_HALVES = {
    "request": ObservationKind.REQUEST_RECEIVED,
    "response": ObservationKind.RESPONSE_SENT,
}
_MAX_S = 2**63 / 1e9

_decode = msgspec.json.Decoder().decode


class _LineError(ValueError):
    """A line that says nothing that can be observed; the text says why."""


class JsonLines:
    """One log.

    Args:
        opened: the file, at its beginning.
        name: how it is called where something is wrong with it.
    """

    def __init__(self, opened: IO[bytes], name: str) -> None:
        self.faults: list[str] = []
        self.unreadable = 0
        self._file = opened
        self._name = name

    def observations(self) -> Iterator[Observation]:
        """What the lines say, in their order; lines that cannot be read are reported in ``faults``."""
        number = 0
        while line := self._file.readline(MAX_LINE + 1):
            number += 1
            try:
                if len(line) > MAX_LINE:
                    while not line.endswith(b"\n") and line:
                        line = self._file.readline(MAX_LINE)
                    raise _LineError(f"it has more than {MAX_LINE} bytes")
                if line.strip():
                    yield _observation(line)
            except _LineError as error:
                self._fault(number, str(error))
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                what = str(error) if line.endswith(b"\n") else f"the last line is cut off: {error}"
                self._fault(number, what)

    def finish(self, fault: str = "") -> None:
        """Say what ended the file too early (``fault``), and how many more lines were unreadable."""
        if fault:
            self.faults.append(f"{self._name}: {fault}: what comes before was read")
        more = self.unreadable - MAX_NAMED
        if more > 0:
            self.faults.append(f"{self._name}: {plural(more, 'more line')} cannot be read")

    def _fault(self, number: int, what: str) -> None:
        self.unreadable += 1
        if self.unreadable <= MAX_NAMED:
            self.faults.append(f"{self._name}:{number}: {what}")


def _observation(line: bytes) -> Observation:
    try:
        found = _decode(line)
    except msgspec.DecodeError as error:
        try:
            found = json.loads(line)  # Python's own writer writes NaN and Infinity
        except ValueError:  # no JSON, or an integer of more digits than Python reads
            raise error from None
    if not isinstance(found, dict):
        raise _LineError(f"expected an object with `topic` or `service`, got `{_shown(found)}`")
    version = found.get(VERSION_KEY, VERSION)
    if version != VERSION:
        raise _LineError(
            f"{VERSION_KEY} is {_shown(version)}; this moon reads lines of version {VERSION}, and without one"
        )
    stamp_ns = _stamp_ns(found)
    topic, service = found.get("topic"), found.get("service")
    if isinstance(topic, str) and topic:
        data = {name: value for name, value in found.items() if name not in _ORACLES}
        return _made(topic, ObservationKind.MESSAGE, stamp_ns, data)
    if not isinstance(service, str) or not service:
        raise _LineError("expected `topic` or `service` with a name")
    for half, kind in _HALVES.items():
        if half in found:
            return _made(service, kind, stamp_ns, found[half])
    raise _LineError("a line of a service has `request` or `response`")


def _made(name: str, kind: ObservationKind, stamp_ns: int, data: Any) -> Observation:
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel=name if name.startswith("/") else f"/{name}",
        kind=kind,
        type_name="",
        data=data,
        source="",
    )


def _stamp_ns(found: dict[str, Any]) -> int:
    time = found.get("time", found.get("t"))
    if isinstance(time, bool) or not isinstance(time, int | float):
        raise _LineError("expected `time` in seconds")
    if not 0 <= time < _MAX_S:
        raise _LineError(f"a time of {_shown(time)} s")
    return round(time * 1e9)


def _shown(value: Any) -> str:
    return json.dumps(value)[:40]
