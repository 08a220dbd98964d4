"""A replay at work: who is played, what happens when, and what came of it."""

from __future__ import annotations

import functools
import heapq
from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter

from moon.recording.contents import named
from moon.recording.definitions import UnknownTypeError
from moon.recording.reader import Recording
from moon.recording.stored import plural
from moon.replay.calls import RecordedCall
from moon.replay.replayed_node import NS, Counts, ReplayedNode
from moon.replay.script import UNNAMED, Script
from transports.interface import Connection, Observation, ObservationKind, TransportError

_LATE_NS = NS
"""A timer that ends so far from when it should was not held up: the clock was set."""
_BATCH = 256
"""So many things happen in one turn of the executor, at most."""

_Moment = tuple[int, ReplayedNode, Callable[[], None]]
"""(when it happened, who did it, what is done again)."""


class Replay:
    """Replays one recording.

    Args:
        script: what was recorded.
        conductor: the replay's own connection, on whose executor time passes; who was not named in
            the recording is played on it.
        connect: a connection for a node of that name.
        is_played: whether a node is played; the others are there themselves.
        rate: how many recorded seconds pass in one.
        say: called with what a person should know, one sentence each.

    Attributes:
        counts: what happened so far.
        finished: whether all of the recording has been replayed.
        behind_s: how late things happened at worst.
    """

    def __init__(
        self,
        script: Script,
        conductor: Connection,
        connect: Callable[[str], Connection],
        is_played: Callable[[str], bool],
        rate: float,
        say: Callable[[str], None],
    ) -> None:
        self.counts = Counts()
        self.finished = False
        self.behind_s = 0.0
        self._script = script
        self._conductor = conductor
        self._connect = connect
        self._is_played = is_played
        self._rate = rate
        self._say = say
        self._replayed: dict[str, ReplayedNode] = {}
        self._publishing: set[tuple[str, str]] = set()
        self._asks: list[_Moment] = []
        self._moments: Iterator[_Moment] = iter(())
        self._next: _Moment | None = None
        self._start_ns = 0
        self._expected_ns = 0
        """What the clock shows when the timer that runs now is over; 0: none does."""

    @property
    def transports(self) -> list[Connection]:
        """The connections of the nodes that are played, the conductor's own not among them."""
        own = self._conductor
        return [p.transport for p in self._replayed.values() if p.transport is not own]

    @property
    def played(self) -> list[str]:
        """Names of the nodes that are played."""
        return sorted(name for name in self._replayed if name != UNNAMED)

    def prepare(self) -> None:
        """Declare all that will be published, served and asked; what cannot be is reported."""
        script = self._script
        for channel, type_name in script.topics.items():
            for node in sorted(script.publishers[channel]):
                declare = functools.partial(
                    ReplayedNode.publish_on, channel=channel, type_name=type_name
                )
                if self._is_played(node) and self._declared(channel, declare, node):
                    self._publishing.add((channel, node))
        for channel, calls in script.calls.items():
            self._prepare_service(channel, calls)
        for action in script.goals:
            self._prepare_action(action)
        self._asks.sort(key=itemgetter(0))
        for transport in self.transports:
            transport.announce()
        self._conductor.announce()

    def _prepare_service(self, channel: str, calls: list[RecordedCall]) -> None:
        server = _server(call.server for call in calls)
        if self._is_played(server):
            if any(call.is_served for call in calls):
                self._declared(channel, lambda replayed: replayed.serve(channel, calls), server)
            return
        for client in sorted({call.client for call in calls}):
            if not self._is_played(client):
                continue
            if not self._declared(channel, lambda replayed: replayed.call_on(channel), client):
                continue
            replayed = self._replayed[client]
            self._asks += [
                (call.asked_ns, replayed, functools.partial(replayed.ask, call))
                for call in calls
                if call.client == client
            ]

    def _prepare_action(self, action: str) -> None:
        goals = self._script.goals[action]
        if not goals:
            self._say(f"{action}: its goals were not recorded; it is not replayed")
            return
        server = _server(goal.server for goal in goals)
        if self._is_played(server):
            self._declared(action, lambda replayed: replayed.serve_action(action, goals), server)
            return
        for client in sorted({goal.call.client for goal in goals}):
            if not self._is_played(client):
                continue
            if not self._declared(action, lambda replayed: replayed.drive_on(action), client):
                continue
            replayed = self._replayed[client]
            for goal in goals:
                if goal.call.client != client:
                    continue
                sent_ns = goal.call.asked_ns
                self._asks.append(
                    (sent_ns, replayed, functools.partial(replayed.drive, action, goal))
                )
                if goal.canceled_ns is not None:
                    at_ns = goal.call.answered_ns + goal.canceled_ns
                    cancel = functools.partial(replayed.cancel, action, goal)
                    self._asks.append((at_ns, replayed, cancel))

    def _declared(self, channel: str, declare: Callable[[ReplayedNode], None], node: str) -> bool:
        """Declare something of ``node``; False, and reported, if that cannot be."""
        replayed = self._replayed.get(node)
        try:
            if replayed is None:
                transport = self._conductor if node == UNNAMED else self._connect(node)
                replayed = self._replayed[node] = ReplayedNode(
                    transport, self._script.recording, self._rate, self._say, self.counts
                )
            declare(replayed)
        except (UnknownTypeError, TransportError) as error:
            self._say(f"{channel} is not replayed: {error}")
            return False
        return True

    def begin(self, recording: Recording) -> None:
        """Let the recorded time begin now; ``recording`` is the same one, opened again."""
        topics = {channel for channel, _ in self._publishing}
        messages = self._messages(recording, topics) if topics else iter(())
        self._moments = heapq.merge(messages, self._asks, key=itemgetter(0))
        self._start_ns = self._conductor.now_ns()
        self._next = next(self._moments, None)
        self._go_on()

    def _messages(self, recording: Recording, topics: set[str]) -> Iterator[_Moment]:
        last_ns = 0
        for seen in recording.entries(topics.__contains__):
            if not isinstance(seen, Observation) or seen.kind is not ObservationKind.MESSAGE:
                continue
            if (seen.channel, seen.source) in self._publishing:
                last_ns = max(last_ns, seen.stamp_ns)
                replayed = self._replayed[seen.source]
                act = functools.partial(replayed.publish, seen.channel, seen.data)
                yield last_ns, replayed, act

    def _go_on(self) -> None:
        """Do what is due; come again for what is not."""
        now_ns = self._conductor.now_ns()
        if self._expected_ns and abs(now_ns - self._expected_ns) > _LATE_NS:
            self._start_ns += now_ns - self._expected_ns
        self._expected_ns = 0
        for _ in range(_BATCH):
            if self._next is None:
                self._end(now_ns)
                return
            at_ns, replayed, act = self._next
            wait_ns = self._due_ns(at_ns) - now_ns
            if wait_ns > 0:
                self._expected_ns = now_ns + wait_ns
                self._conductor.after(wait_ns / NS, self._go_on)
                return
            self.behind_s = max(self.behind_s, -wait_ns / NS)
            replayed.transport.post(act)
            self._next = next(self._moments, None)
        self._conductor.post(self._go_on)

    def _due_ns(self, at_ns: int) -> int:
        return self._start_ns + round((at_ns - self._script.first_ns) / self._rate)

    def _end(self, now_ns: int) -> None:
        """The recording goes on until its last observation, be it of somebody who is not played."""
        wait_ns = self._due_ns(self._script.last_ns) - now_ns
        if wait_ns > 0:
            self._conductor.after(wait_ns / NS, self._end_now)
        else:
            self._end_now()

    def _end_now(self) -> None:
        self.finished = True

    def summary(self) -> str:
        """What came of it, in one line."""
        counts = self.counts
        parts = [
            f"published {plural(counts.published, 'message')}",
            f"answered {plural(counts.equal + counts.other, 'request')}",
        ]
        if counts.other:
            parts[-1] += f" ({counts.other} that were not recorded)"
        if counts.unanswered:
            parts.append(f"left {counts.unanswered} without a response, as recorded")
        if counts.without:
            parts.append(f"had no recorded response for {counts.without}")
        if counts.asked:
            parts.append(
                f"sent {plural(counts.asked, 'request')}, "
                f"{counts.differently} with another response than recorded"
            )
        return ", ".join(parts)

    def overview(self) -> list[str]:
        """What is going to be done, one sentence each."""
        script = self._script
        parts = [f"played: {', '.join(self.played) or 'no node by name'}"]
        if UNNAMED in self._replayed:
            of_nobody = [c for c, node in self._publishing if node == UNNAMED]
            of_nobody += [
                c for c, calls in script.calls.items() if not _server(x.server for x in calls)
            ]
            parts.append(f"of unnamed nodes: {named(set(of_nobody))}")
        return parts


def _server(names: Iterable[str]) -> str:
    """Who serves a channel: the one who is named."""
    return next((name for name in names if name), UNNAMED)
