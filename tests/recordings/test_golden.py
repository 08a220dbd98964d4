"""The golden recordings: real runs on Zenoh and on ROS 2, whose verdicts are known (``make.py``)."""

from __future__ import annotations

import os
import re
from typing import Any

import pytest

from moon.monitor.subject import Monitored, Subject, read_subject
from moon.offline.engine import check_recording
from moon.offline.result import CheckResult
from moon.oracle.bounds import Bounds
from moon.recording.entries import ReportedVerdict
from moon.recording.reader import open_recording
from moon.verdict import Cause
from tests.recordings.make import (
    CASES,
    HERE,
    MAX_BYTES,
    SYSTEM,
    essence,
    is_paced,
    load,
    violations,
)

ROOT = HERE.parents[1]
KNOWN = load()
PACED = [name for name, known in sorted(KNOWN.items()) if is_paced(known.transport, known.fault)]
"""Those that were recorded by a monitor."""
TRANSPORTS = ("zenoh", "ros2")
NEXT_REPORT_NS = 20_000_000
"""The nodes of the tour report so soon after their client gave up."""


@pytest.fixture(scope="module")
def subject() -> tuple[Subject, Monitored]:
    """The tour's models, by the name that they had when the runs were recorded."""
    os.chdir(ROOT)
    found = Subject((SYSTEM,), (), (), (), (), Bounds())
    return found, read_subject(found)


@pytest.fixture(autouse=True)
def _at_the_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def checked(name: str, subject: tuple[Subject, Monitored]) -> CheckResult:
    return check_recording(HERE / name, *subject)


def test_every_fault_of_the_paper_was_recorded_on_every_transport():
    assert sorted(KNOWN) == sorted(
        f"{transport}-{case}.mcap" for transport in TRANSPORTS for case in CASES
    )
    for name, known in KNOWN.items():
        path = HERE / name
        assert path.stat().st_size <= MAX_BYTES
        assert name == f"{known.transport}-{known.fault or 'nominal'}.mcap"


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_the_verdicts_of_a_recorded_run_are_those_that_are_known(
    name: str, subject: tuple[Subject, Monitored]
):
    known = KNOWN[name]
    result = checked(name, subject)
    assert result.recording.faults == ()
    assert result.recording.complete
    assert result.recording.observations == known.observations
    violated = {item.machine for item in result.machines if item.violations}
    assert violated == set(known.violated)
    assert violations(result) == known.violations


@pytest.mark.parametrize("name", PACED)
def test_the_check_says_at_each_moment_what_the_monitor_said_then(
    name: str, subject: tuple[Subject, Monitored]
):
    live = [
        entry
        for entry in open_recording(HERE / name).entries()
        if isinstance(entry, ReportedVerdict)
    ]
    again = checked(name, subject).verdicts
    assert live
    assert [essence(said.verdict) for said in again] == [
        reworded(essence(said.verdict)) for said in live
    ]
    for said, before in zip(again, live, strict=True):
        # a silence was certain when its client gave up, and is now once its node reports next (decision 41)
        most_ns = NEXT_REPORT_NS if said.verdict.cause is Cause.UNRESPONSIVE else 0
        assert 0 <= said.received_ns - before.received_ns <= most_ns


def reworded(said: Any) -> Any:
    """What was said when the runs were recorded, with values as they are worded today."""
    if isinstance(said, tuple):
        return tuple(reworded(part) for part in said)
    said = said.replace("is_ok: True", "is_ok: true").replace("is_ok: False", "is_ok: false")
    return re.sub(
        r"status: ([012])\b", lambda found: f"status: {NAMES[int(found[1])]} ({found[1]})", said
    )


NAMES = ("SUCCESS", "FAILURE", "RUNNING")


def test_a_known_fault_is_in_the_node_that_the_catalogue_has_it_in():
    from catalogue import FAULTS  # make.py has put it on the path

    for known in KNOWN.values():
        nodes = [item.node for item in FAULTS if item.id == known.fault]
        assert list(known.violated) == nodes
