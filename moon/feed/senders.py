"""Whose word an observation is: by their models, which nodes send what, and in whose name it came.

An observation says itself whose it is. What comes in the name of a node that by its model does not send it,
where another one does, is not that node's doing. It says something of who may send where, and nothing of the
machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec

from m2c.model.machine import Machine
from m2c.printable import printable
from moon.feed.places import nodes_at
from transports.interface import Observation, ObservationKind

ALLEGED = "?"
"""Before the name of who is said to have published a message, and did not: a publisher that nobody knows."""
MOST_FINDINGS = 256
"""Names and channels that are told apart: names come from the wire, and never end."""

_MESSAGE, _TAKEN = ObservationKind.MESSAGE, ObservationKind.MESSAGE_TAKEN


class Senders:
    """Attributes observations to nodes.

    Args:
        machines: the models of all nodes.
        plugins: what the policy runs: it sends in the policy's name, which is not looked at here.
    """

    def __init__(self, machines: Iterable[Machine], plugins: Iterable[Machine] = ()) -> None:
        machines = tuple(machines)
        self._of = nodes_at(machines, plugins)
        self._nodes = {machine.name for machine in machines}
        self._findings: dict[tuple[str, str], int] = {}

    def attributed(self, seen: Observation) -> Observation | None:
        """``seen``, by who may have sent it; None if it is a report that the node it names does not make.

        A message stays a message: who takes it has taken it, whoever published it.
        """
        source, kind, channel = seen.source, seen.kind, seen.channel
        if source in self._nodes:
            senders = self._of.get((channel, kind))
            if senders is not None and source not in senders:
                self._note(source, channel)
                if kind is not _MESSAGE:
                    return None
                return msgspec.structs.replace(seen, source=ALLEGED + source, order=-1)
        if kind is _TAKEN and seen.client in self._nodes:
            senders = self._of.get((channel, _MESSAGE))
            if senders is not None and seen.client not in senders:
                return msgspec.structs.replace(seen, client=ALLEGED + seen.client)
        return seen

    def _note(self, name: str, channel: str) -> None:
        place, findings = (name, channel), self._findings
        if place in findings or len(findings) < MOST_FINDINGS:
            findings[place] = findings.get(place, 0) + 1

    def sentences(self) -> Iterator[str]:
        """What came in a name that it cannot be of, one sentence each."""
        for (name, channel), count in self._findings.items():
            yield (
                f"received {count} message{'s' * (count != 1)} on {printable(channel)} in the name of "
                f"{name}, which by its model does not send there: another's, and no evidence about it"
            )
