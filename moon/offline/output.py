"""What ``moon check`` prints of a result: the lines of ``moon monitor``, and what recordings add."""

from __future__ import annotations

import time

import msgspec

from m2c.json_lines import versioned_line
from m2c.printable import printable
from moon.monitor.report import closing, table, verdict_lines
from moon.monitor.status import Summary
from moon.offline.result import CheckResult


def lines_of(result: CheckResult, colour: bool = False) -> list[str]:
    """What a person reads."""
    recording = result.recording
    began = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(recording.first_ns // 10**9))
    lines = [f"{printable(recording.path)}: {recording.form}, {began}, {recording.seconds:.1f} s"]
    for reported in result.verdicts:
        lines += verdict_lines(reported.verdict, colour)
    lines += table(result.machines)
    lines += closing(_summary(result))
    if not recording.complete:
        lines.append(
            "not all of the recording could be read; this is what the readable part shows:"
        )
        lines += [f"  {printable(fault)}" for fault in recording.faults]
    if recording.time:
        lines.append(f"time: {printable(recording.time)}")
    lines += [f"limit: {printable(limit)}" for limit in recording.limits]
    lines += [f"warning: {printable(problem)}" for problem in result.problems]
    speed = times(recording.seconds / max(result.seconds, 1e-3))
    lines.append(f"checked in {result.seconds:.1f} s, {speed} times as fast as it happened")
    return lines


def times(ratio: float) -> str:
    """``ratio`` with a digit behind the point where it would not be told from 0 or 1 without."""
    return f"{ratio:,.0f}" if ratio >= 9.95 else f"{ratio:.1f}"


def _summary(result: CheckResult) -> Summary:
    return Summary(
        result.recording.seconds,
        result.machines,
        result.counts,
        result.problems,
        result.unmonitored,
    )


def json_lines(result: CheckResult) -> list[bytes]:
    """An object a line: ``recording``, each ``verdict`` as ``moon monitor --json`` has it, ``summary``."""
    recording = result.recording
    events = [
        ("recording", recording),
        *(("verdict", reported.verdict) for reported in result.verdicts),
        ("summary", _summary(result)),
    ]
    return [versioned_line({"event": name, **_fields(item)}) for name, item in events]


def _fields(item: object) -> dict[str, object]:
    found: dict[str, object] = msgspec.to_builtins(item)
    return found
