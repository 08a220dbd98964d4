"""``moon replay`` and one generated skill, each a process of its own, on real Zenoh over loopback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from moon.recording.definitions import Definitions
from moon.recording.reader import Recording
from moon.recording.writer import RecordingWriter
from moon.replay import types
from moon.replay.calls import RecordedCall
from moon.replay.replayed_node import Counts, ReplayedNode
from moon.replay.script import Selected, script_of
from tests.monitor.processes import WAIT_S, Process, free_endpoint, router
from tests.replay.worlds import LAB_TOUR, Received, lab_tour, of, tour
from transports.interface import CallOutcome, Observation
from transports.networks import spinning
from transports.zenoh import connect

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]

SECONDS = 5.0


def recorded(path: Path) -> Received:
    """Yesterday: a nominal tour, in a file."""
    received = tour(SECONDS)
    writer = RecordingWriter(path, Definitions(lab_tour()[0].library))
    for seen in received.observations:
        writer.add(seen)
    writer.close()
    return received


def test_a_request_that_had_no_answer_then_is_not_answered_or_ended_now() -> None:
    received, channel = tour(SECONDS), "/SchedulerComponent/SetPoi"
    recording = cast(Recording, received)
    then = script_of(recording, Selected((channel,))).calls[channel][0]
    unanswered = RecordedCall(channel, then.client, then.request, then.asked_ns, then.server)
    endpoint = free_endpoint()
    server = connect("server", {"listen": endpoint})
    client = connect("client", {"endpoint": endpoint})
    counts = Counts()
    player = ReplayedNode(server, recording, 1.0, lambda sentence: None, counts)
    player.serve(channel, [unanswered])
    service = types.service(recording, channel)
    asking = client.client(service)
    with spinning(server, client):
        server.announce()
        client.announce()
        request = msgspec.convert(then.request, service.request)
        result = asking.call_and_wait(request, 1.0)
        while result.outcome is CallOutcome.UNAVAILABLE:  # not linked yet
            result = asking.call_and_wait(request, 1.0)
        assert result.outcome is CallOutcome.TIMEOUT
        assert counts.unanswered == 1


class Skill(Process):
    """A generated node."""

    def __init__(self, folder: Path, package: str, endpoint: str) -> None:
        found = os.environ.get("PYTHONPATH")
        os.environ["PYTHONPATH"] = str(folder)
        try:
            super().__init__(Path(sys.executable).name, "-m", package, "--endpoint", endpoint)
        finally:
            if found is None:
                del os.environ["PYTHONPATH"]
            else:
                os.environ["PYTHONPATH"] = found


class Tap:
    """What is received on a network, while a test runs."""

    def __init__(self, endpoint: str) -> None:
        self.received: list[Observation] = []
        self.transport = connect("a_tap", {"endpoint": endpoint})
        self._more = threading.Condition()
        self.transport.tap([], self._hear)
        self._thread = threading.Thread(target=self.transport.spin)
        self._thread.start()

    def _hear(self, seen: Observation) -> None:
        with self._more:
            self.received.append(seen)
            self._more.notify_all()

    def wait(self, holds: Any) -> None:
        """Until something holds, or for long enough: what is there then shows what is missing."""
        with self._more:
            self._more.wait_for(holds, WAIT_S)

    def close(self) -> None:
        self.transport.close()
        self._thread.join(WAIT_S)


def test_a_skill_gets_yesterdays_answers_and_gives_yesterdays(tmp_path: Path) -> None:
    name = "SetPoi1Skill"
    received = recorded(tmp_path / "run.mcap")
    generated = tmp_path / "generated"
    command = ["m2c", "generate", "--transport", "zenoh", str(LAB_TOUR), "-o", str(generated)]
    subprocess.run(
        [sys.executable, "-m", "m2c.cli", *command[1:]],
        check=True,
        capture_output=True,
        timeout=WAIT_S,
    )
    with router(tmp_path) as (endpoint, _):
        tap = Tap(endpoint)
        skill = Skill(generated / "set_poi1_skill", "set_poi1_skill", endpoint)
        try:
            assert list(tap.transport.wait_for_nodes([name], WAIT_S)) == []
            replay = Process(
                *("moon", "replay", tmp_path / "run.mcap", "--without", name, "--rate", 2),
                *("--endpoint", endpoint),
            )
            try:
                assert replay.end() == 0, replay.said
                then = of(received.observations, name)
                tap.wait(lambda: len(of(tap.received, name)) >= len(then))
            finally:
                replay.close()
            assert skill.end(signal.SIGTERM) == 0, skill.said
        finally:
            skill.close()
            tap.close()
    assert len(then) > 50
    assert sorted(of(tap.received, name), key=str) == sorted(then, key=str)
    (summary,) = [line for line in replay.err if line.startswith("published")]
    calls = sum(seen[0].endswith("/tick") for seen in then) // 2
    assert (
        f"answered {calls} requests, sent {calls} requests, 0 with another response than recorded"
        in summary
    )
    assert f"{name} is up already: it is not played" in replay.err
    answers = {
        str(seen.data) for seen in tap.received if seen.source == "SchedulerComponent" and seen.data
    }
    assert "{'is_ok': True}" in answers
