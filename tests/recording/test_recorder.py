"""What a recorder writes besides what it hears."""

from __future__ import annotations

import itertools
from typing import Any

from moon.recording.entries import Entry, Missed, Pulse, set_by_ns
from moon.recording.recorder import Recorder
from transports.interface import (
    BlindSpot,
    BlindSpotKind,
    Observation,
    ObservationKind,
)

NS = 10**9


class ByHand:
    """A connection, its tap and a writer; time passes when the test says so."""

    node, repair_s, is_complete = "recorder", 0.0, True

    def __init__(self) -> None:
        self.time_ns = 1_000 * NS
        self.set_ns = 0
        self.entries: list[Entry] = []
        self.hear: Any = None
        self.said: list[str] = []
        self.unread: dict[str, str] = {}
        self.made: Recorder | None = None

    def now_ns(self) -> int:
        return self.time_ns + self.set_ns

    def monotonic_ns(self) -> int:
        return self.time_ns

    def tap(self, _: object, hear: Any) -> ByHand:
        self.hear = hear
        return self

    def watch_nodes(self, _: object) -> None:
        pass

    def add(self, entry: Entry) -> None:
        self.entries.append(entry)

    def problems(self) -> list[str]:
        return self.said

    def blind_spots(self) -> dict[BlindSpot, str]:
        return {
            BlindSpot(BlindSpotKind.NOT_RECEIVED, name): why for name, why in self.unread.items()
        }

    def flush(self) -> None:
        pass

    def receive(self, late_s: float) -> None:
        """An observation that waited for ``late_s`` until the recorder's thread took it."""
        received_ns = self.now_ns() - round(late_s * NS)
        kind = ObservationKind.MESSAGE
        self.hear(
            Observation(
                stamp_ns=received_ns,
                received_ns=received_ns,
                channel="/c",
                kind=kind,
                type_name="std_msgs/msg/Int32",
                data={},
                source="node",
            )
        )

    def steps_s(self) -> list[float]:
        """By how much the clock was set, as the recording has it."""
        pulses = [entry for entry in self.entries if type(entry) is Pulse]
        pairs = itertools.pairwise(pulses)
        return [set_by_ns(before, after) / NS for before, after in pairs]


def recorder() -> ByHand:
    hand = ByHand()
    connection: Any = hand
    hand.made = Recorder(connection, "zenoh", connection, (), print, hand.monotonic_ns)
    hand.made.start()
    return hand


def test_a_recorder_that_was_held_up_does_not_take_the_clock_for_set() -> None:
    hand = recorder()
    hand.time_ns += NS
    for late_s in (0.9, 0.5, 0.3, 0.29, 0.28):
        hand.receive(late_s)
    hand.time_ns += NS // 10
    hand.receive(0.0)
    assert set(hand.steps_s()) == {0.0}
    assert len(hand.steps_s()) <= 4


def test_a_clock_that_was_set_is_looked_at_with_the_next_message() -> None:
    hand = recorder()
    hand.receive(0.0)
    hand.set_ns = -NS
    hand.receive(0.0)
    hand.receive(0.0)
    assert hand.steps_s() == [-1.0]


def test_a_link_that_comes_up_a_moment_later_is_no_problem_of_the_recording() -> None:
    hand = recorder()
    made: Any = hand.made
    unlinked, lost = (
        "A is up, but not linked to this tap: its messages are not received",
        "lost 3 messages of A",
    )
    for problems in ([unlinked], [lost], [lost], [unlinked], [unlinked]):
        hand.said = problems
        made.look_around()
    assert [entry.text for entry in hand.entries if type(entry) is Missed] == [lost, unlinked]


def test_that_a_channel_is_not_received_is_recorded_once_with_its_channel() -> None:
    hand = recorder()
    made: Any = hand.made
    why = "/c is not received: its type cannot be loaded"
    for unread in ({"/c": why}, {"/c": why}, {"/c": why}, {}):
        hand.unread, hand.said = unread, [*unread.values()]
        made.look_around()
    missed = [(entry.text, entry.channel) for entry in hand.entries if type(entry) is Missed]
    assert missed == [(why, "/c"), ("", "/c")]
