"""What a tap does not receive, and what is not known of nodes, as it is recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from moon.recording.entries import Missed
from moon.tap.notices import Standing
from transports.interface import Tap

Unsure = Mapping[tuple[str, str], str]
"""Why something is not known: of a channel, what comes there; of a channel and a node, what the node takes of
it; of a node (any, if none is given) without a channel, how much time passes for it."""


def unsure_of(tap: Tap) -> Unsure:
    """What ``tap`` does not receive, what nodes may not take, and whose time is another."""
    unread = {(channel, ""): why for channel, why in tap.not_received().items()}
    timed = {("", node): why for node, why in tap.on_other_time().items()}
    return unread | dict(tap.may_not_take()) | timed


def not_received(unsure: Unsure) -> dict[str, str]:
    """``Tap.not_received``, of ``unsure``."""
    return {channel: why for (channel, node), why in unsure.items() if channel and not node}


def may_not_take(unsure: Unsure) -> dict[tuple[str, str], str]:
    """``Tap.may_not_take``, of ``unsure``."""
    return {(channel, node): why for (channel, node), why in unsure.items() if channel and node}


def on_other_time(unsure: Unsure) -> dict[str, str]:
    """``Tap.on_other_time``, of ``unsure``."""
    return {node: why for (channel, node), why in unsure.items() if not channel}


class Misses:
    """Records what a tap says of itself, each sentence once.

    Args:
        record: takes the entries.

    Attributes:
        unsure: what was not known at the last look.
    """

    def __init__(self, record: Callable[[Missed], None]) -> None:
        self._record = record
        self.unsure: Unsure = {}
        self._standing = Standing()
        self._noted: frozenset[str] = frozenset()

    def look_at_channels(self, unsure: Unsure, now_ns: int) -> None:
        """``unsure`` is so at ``now_ns``."""
        before, self.unsure = self.unsure, unsure
        for place in sorted({*before, *unsure}):
            if before.get(place) != (why := unsure.get(place, "")):
                self._record(Missed(now_ns, why, *place))

    def look_at_problems(self, problems: Sequence[str], now_ns: int) -> None:
        """``problems`` is what ``Tap.problems`` says at ``now_ns``; it has what is not received, too."""
        standing = self._standing.look(problems)
        for text in standing:
            if text not in self._noted and text not in self.unsure.values():
                self._record(Missed(now_ns, text))
        self._noted = frozenset(standing)
