"""Violations that wait until something that came later shows that no observation is missing (decision 26).

A tap can lose whatever it likes, and says nothing when it does: what is missing shows in the numbers of
what comes after it. So a verdict is said as *violated* only when, for everything that could explain it
had it been lost, a number that follows has come.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from moon.ordering.numbers import Place
from moon.verdict import Verdict
from transports.interface import NAMELESS

KEPT_VIOLATIONS = 16
"""More of them do not wait; the oldest go."""
KEPT_EVENTS = 1024
"""Events of calls of which only one end was heard yet."""

UNCONFIRMED = "if no observation is missing here: "
"""How the reason of a verdict begins that is not certain yet."""
NOT_NEEDED = 0
CallEvent = tuple[str, str, str, int]
"""Kind, channel, client and number of one end of one call."""


class Losses:
    """What the oracles of one tap know of it.

    Attributes:
        happen: observations have been lost.
        possible: they can be. They cannot where the observations are a whole trace, as of a simulation:
            then nothing needs to be confirmed.
    """

    def __init__(self, happen: bool = False, possible: bool = True) -> None:
        self.happen = happen
        self.possible = possible


class Violation:
    """What a machine cannot have done, if nothing is missing.

    Attributes:
        verdict: says so.
        since_ns: since when it is known what the machine does: what was lost before does not matter.
        until_ns: all that happened until then may explain it.
        is_silence: whether it is that something did not come. Then only what comes later shows that.
        expected: where what was expected would have come.
        is_certain: whether no observation that is missing can be the reason.
        call: (client, number) of the request whose answer was all that was expected; None: it was not.
        asked_ns: when that was to be answered at the earliest.
    """

    __slots__ = (
        "asked_ns",
        "call",
        "expected",
        "is_certain",
        "is_silence",
        "since_ns",
        "until_ns",
        "verdict",
    )

    def __init__(
        self,
        verdict: Verdict,
        since_ns: int,
        until_ns: int,
        is_silence: bool,
        expected: list[Place],
    ) -> None:
        self.verdict = verdict
        self.since_ns = since_ns
        self.until_ns = until_ns
        self.is_silence = is_silence
        self.expected = expected
        self.is_certain = False
        self.call: tuple[str, int] | None = None
        self.asked_ns = 0


class Waiting:
    """What has to be heard before a violation is certain.

    Attributes:
        verdict: the violation.
        places: the number that has to come next at each place, after the violation.
        reported_ns: all that the node did until then has to be heard, by the order of its reports;
            ``NOT_NEEDED`` where it is, or where the node counts per channel only.
        since_ns: since when it was known what the machine does.
        call: (client, number) of the request that was not answered; its client's giving up shows the
            silence as well as the node's own next report does.
        answer: the place at which the answer would have come.
    """

    __slots__ = ("answer", "call", "places", "reported_ns", "since_ns", "verdict")

    def __init__(
        self,
        verdict: Verdict,
        places: dict[Place, int] | None = None,
        reported_ns: int = NOT_NEEDED,
        since_ns: int = 0,
    ) -> None:
        self.verdict = verdict
        self.places = {} if places is None else places
        self.reported_ns = reported_ns
        self.since_ns = since_ns
        self.call: tuple[str, int] | None = None
        self.answer: Place | None = None

    @property
    def is_over(self) -> bool:
        """Whether nothing is left to wait for."""
        return not self.places and self.reported_ns == NOT_NEEDED


class Unconfirmed:
    """The violations of one machine that are not certain yet."""

    def __init__(self) -> None:
        self.kept: list[Waiting] = []

    def add(self, waiting: Waiting) -> None:
        """``waiting`` is certain once what it waits for has come."""
        self.kept.append(waiting)
        del self.kept[:-KEPT_VIOLATIONS]

    def hear(self, place: Place, number: int, stamp: int) -> list[Verdict]:
        """An observation's number shows whether something was lost at its place before it.

        Args:
            place: where it came.
            number: its number there.
            stamp: when it happened (ns). What happened before a violation and comes only now was
                missing when it was judged: it was no violation.

        Returns:
            The verdicts that are certain by now.
        """
        for waiting in tuple(self.kept):
            wanted = waiting.places.get(place)
            if wanted is None:
                continue
            if number != wanted or stamp <= waiting.verdict.stamp_ns:
                self.kept.remove(waiting)
            else:
                del waiting.places[place]
        return self._certain()

    def reported(self, until_ns: int, gap_ns: int) -> list[Verdict]:
        """All that the node did until ``until_ns`` has been heard but what happened before ``gap_ns``."""
        for waiting in tuple(self.kept):
            if waiting.reported_ns == NOT_NEEDED:
                continue
            if gap_ns > waiting.since_ns:
                self.kept.remove(waiting)
            elif until_ns >= waiting.reported_ns:
                waiting.reported_ns = NOT_NEEDED
        return self._certain()

    def counts_per_channel(self) -> list[Verdict]:
        """The node, now heard for the first time, does not number all that it reports."""
        for waiting in self.kept:
            waiting.reported_ns = NOT_NEEDED
        return self._certain()

    def gave_up(self, call: tuple[str, int], stamp: int) -> list[Verdict]:
        """The client of ``call`` had no answer when it gave up at ``stamp`` (ns)."""
        for waiting in self.kept:
            if waiting.call == call and stamp > waiting.verdict.stamp_ns:
                waiting.reported_ns, waiting.call = NOT_NEEDED, None
                if waiting.answer is not None:
                    waiting.places.pop(waiting.answer, None)
        return self._certain()

    def restart(self) -> None:
        """The node counts anew: the end of what it reported before is not known."""
        self.kept = [waiting for waiting in self.kept if waiting.reported_ns == NOT_NEEDED]

    def _certain(self) -> list[Verdict]:
        found = [waiting.verdict for waiting in self.kept if waiting.is_over]
        if found:
            self.kept = [waiting for waiting in self.kept if not waiting.is_over]
        return found


class OtherEnds:
    """What the other ends of a node's calls show that it did, and it was not heard to do.

    For nodes that number their reports per channel only. One report of two on the same event is enough.
    """

    def __init__(self) -> None:
        self._reported: dict[CallEvent, None] = {}
        self._implied: dict[CallEvent, int] = {}
        self._dropped_ns = 0
        """Of what is not remembered, the newest is from then."""

    def report(self, event: CallEvent) -> None:
        """The node itself was heard: ``event``."""
        kind, channel, client, call = event
        if client.startswith(NAMELESS):  # the other end may know its name
            event = (kind, channel, "", call)
            for other in [e for e in self._implied if (e[0], e[1], "", e[3]) == event]:
                del self._implied[other]
        elif self._implied.pop(event, None) is not None:
            return
        self._reported[event] = None
        if len(self._reported) > KEPT_EVENTS:
            del self._reported[next(iter(self._reported))]

    def imply(self, event: CallEvent, stamp: int) -> None:
        """By the other end, ``event`` happened, about ``stamp`` (ns)."""
        kind, channel, _, call = event
        if event in self._reported or (kind, channel, "", call) in self._reported:
            return
        self._implied[event] = stamp
        if len(self._implied) > KEPT_EVENTS:
            dropped = next(iter(self._implied))
            self._dropped_ns = max(self._dropped_ns, self._implied.pop(dropped))

    def are_missing(self, since_ns: int, until_ns: int) -> bool:
        """Whether something that the node did after ``since_ns``, and by ``until_ns``, was not heard from it.

        Of what it does now, the other end may be heard first.
        """
        if self._dropped_ns > since_ns:
            return True
        return any(since_ns < stamp <= until_ns for stamp in self._implied.values())

    def clear(self) -> None:
        """The node has started anew."""
        self._reported.clear()
        self._implied.clear()


class Publishers:
    """Who may publish on a topic although it was not heard yet: nodes that are up, by the models.

    Args:
        of_channel: names of the nodes whose models publish on each channel.
        callers: nodes whose word is taken for it that they sent a request; None: everybody's. A stranger can
            say so of a request that nobody sent.
    """

    def __init__(
        self,
        of_channel: Mapping[str, Iterable[str]] | None = None,
        callers: Iterable[str] | None = None,
    ) -> None:
        self._callers = None if callers is None else frozenset(callers)
        self._of_channel = {name: frozenset(nodes) for name, nodes in (of_channel or {}).items()}
        self._up: set[str] = set()

    def came_up(self, node: str) -> None:
        """``node`` is or was there."""
        self._up.add(node)

    def is_caller(self, node: str) -> bool:
        """Whether ``node`` is known, and its word taken."""
        return self._callers is None or node in self._callers

    def on(self, channel: str) -> list[str]:
        """Nodes that may have published on ``channel``."""
        return sorted(self._of_channel.get(channel, frozenset()) & self._up)
