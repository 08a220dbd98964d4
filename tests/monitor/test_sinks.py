"""Where verdicts go."""

from __future__ import annotations

import errno

import msgspec
import pytest

from moon.sinks.file import VerdictFile
from moon.sinks.topic import VERDICTS, VerdictMessage, VerdictTopic, message_of
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from transports.simulated.world import SimulatedTransport, SimulatedWorld

WHY = Explanation(("A", "B"), "C", ("idle",), (Evidence(7, "a message"),), ("m.scxml:1:2",))
WRONG = Verdict("Level", "Level", Outcome.VIOLATED, 9, "expected A or B, observed C", WHY)
RIGHT = Verdict("Level", "Level", Outcome.CONFORMING, 10)


def test_each_verdict_is_a_line_that_reads_back(tmp_path) -> None:
    path = tmp_path / "log.jsonl"
    file = VerdictFile(path)
    file.take(WRONG)
    file.take(RIGHT)
    lines = path.read_bytes().splitlines()  # before it is closed: as after a kill
    assert [msgspec.json.decode(line, type=Verdict) for line in lines] == [WRONG, RIGHT]
    file.close()
    file.close()


def test_an_existing_log_is_appended_to_after_a_line_that_was_cut_off(tmp_path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_bytes(b'{"machine":"Le')
    file = VerdictFile(path)
    file.take(RIGHT)
    file.close()
    assert path.read_bytes().split(b"\n")[0] == b'{"machine":"Le'
    assert msgspec.json.decode(path.read_bytes().split(b"\n")[1], type=Verdict) == RIGHT


def test_a_full_disk_is_an_error() -> None:
    from pathlib import Path

    file = VerdictFile(Path("/dev/full"))
    with pytest.raises(OSError, match="space") as error:
        file.take(RIGHT)
    assert error.value.errno == errno.ENOSPC
    file.close()


def test_the_message_says_all_that_the_verdict_says() -> None:
    message = message_of(WRONG)
    assert message.machine == message.node == "Level"
    assert message.outcome == "violated"
    assert (message.stamp_ns, message.reason) == (9, WRONG.reason)
    assert (message.expected, message.observed) == (["A", "B"], "C")
    assert (message.states, message.places) == (["idle"], ["m.scxml:1:2"])
    assert [(item.stamp_ns, item.text) for item in message.evidence] == [(7, "a message")]
    assert message_of(RIGHT) == VerdictMessage("Level", "Level", "conforming", 10)


def test_a_component_can_subscribe_to_verdicts() -> None:
    world = SimulatedWorld(seed=1)
    monitor, component = SimulatedTransport(world, "monitor"), SimulatedTransport(world, "reactor")
    told: list[VerdictMessage] = []
    component.subscribe(VERDICTS, told.append)
    VerdictTopic(monitor).take(WRONG)
    world.run_until(lambda: bool(told), 5.0)
    assert told == [message_of(WRONG)]
