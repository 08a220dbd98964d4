"""How well a simulated network and its machines work: plain data, so that a case can be printed."""

from __future__ import annotations

from enum import StrEnum

import msgspec

Bounds = tuple[float, float]
"""Shortest and longest, in s."""


class Rules(StrEnum):
    """Whose rules nodes follow in what they number and report, and in what they can be asked.

    ``ZENOH``: a node numbers all that it reports, reports which messages it takes, answers how far it has
    reported, and is missed at once when it dies. Its stamps never go back. ``ROS2``: a node numbers what it
    publishes on each channel and nothing else, reports no message as taken, cannot be asked, and is missed
    after a lease. Its stamps are the time of day. Each client counts its calls for itself.
    """

    ZENOH = "zenoh"
    ROS2 = "ros2"


class Introspection(StrEnum):
    """What shows of calls at one end of a service, as rclpy's ``ServiceIntrospectionState`` has it."""

    OFF = "off"
    METADATA = "metadata"
    CONTENTS = "contents"


class Lost(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One message or observation that is lost.

    Attributes:
        source: the node that sent it.
        channel: on which; for what a node reports as taken, with ``/_message_taken`` after it.
        number: of those from this source on this channel, counted from 0: of the messages to ``node``, or of
            what a tap receives. Requests and responses of a service are messages on its channel.
        node: who misses the message; empty: every tap misses the observation of it.
    """

    source: str
    channel: str
    number: int
    node: str = ""


class Reordered(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One link that does not keep its order.

    Attributes:
        source, channel, node: as in ``Lost``; an empty ``node``: what taps receive.
        by_s: a message is this much longer under way at most, and is overtaken by those behind it.
        probability: of that, for each message.
    """

    source: str
    channel: str
    by_s: float
    node: str = ""
    probability: float = 0.5


class Pause(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A node that stands still: what comes for it waits, and of a timer's ticks only one does.

    Attributes:
        node: which; a monitor's connection is one, too.
        at_s: from when, counted from the world's begin.
        for_s: how long.
    """

    node: str
    at_s: float
    for_s: float


class Kill(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A node that dies without a word.

    Attributes:
        node: which.
        at_s: when, counted from the world's begin.
        down_s: how long until it is started again (``SimulatedWorld.starters``); None: it is not.
    """

    node: str
    at_s: float
    down_s: float | None = None


class Slowdown(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Nodes of a busy host: all that they send, to whomever, comes later for a while, and in its order.

    Attributes:
        nodes: which.
        at_s: from when, counted from the world's begin.
        for_s: how long.
        by_s: how much later.
    """

    nodes: tuple[str, ...]
    at_s: float
    for_s: float
    by_s: float


class HostClock(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The time of day on one host.

    Attributes:
        host: which; "" is where all nodes are that ``Conditions.hosts`` does not name.
        ahead_s: by how much it is ahead when the world begins (behind: less than 0).
        steps: when it is set, counted from the world's begin, and by how much (s).
    """

    host: str = ""
    ahead_s: float = 0.0
    steps: tuple[tuple[float, float], ...] = ()


class Cut(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A network that is cut between some hosts and all others, and healed.

    What is sent reliably meanwhile comes after that, if it is healed within ``Conditions.lease_s``. Else it
    is lost, and each side takes the other for gone in between. Best-effort messages are lost.

    Attributes:
        hosts: those on one side.
        at_s: from when, counted from the world's begin.
        for_s: how long.
    """

    hosts: tuple[str, ...]
    at_s: float
    for_s: float


class Conditions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How well the simulated network and its machines work.

    Attributes:
        delay_s: shortest and longest time a message is under way, drawn for each message. A link (a
            channel from one node to another) keeps its order; across links, order is lost.
        tap_delay_s: the same for what a tap receives.
        busy_s: shortest and longest time a node takes for one piece of work; others wait meanwhile.
        loss: probability that a message of a best-effort topic is lost on one link.
        tap_loss: probability that an observation is lost.
        unread: channels that taps cannot receive: their types are not there.
        duplication: probability that a message of a best-effort topic, or an observation, arrives
            twice.
        discovery_s: shortest and longest time that two ends which are there take to find each other: a
            publisher and a subscriber, a client and a server, a node and a tap on each channel, two nodes.
            Nothing goes from one to the other before; a call waits for its server.
        lost: single messages and observations that are lost.
        reordered: links that do not keep their order.
        pauses: nodes that stand still for a while.
        slowdowns: nodes of which everything comes later for a while.
        kills: nodes that die, and are started again.
        hosts: the host of each node that is not on host "".
        clocks: hosts whose time of day is not the world's.
        cuts: when hosts cannot reach each other.
        lease_s: how long nodes that cannot reach each other take each other for there; under
            ``Rules.ROS2`` also, how long a node that has died is not missed.
        rules: in what the nodes follow a certain middleware.
        plain: nodes of ROS 2's own client libraries, and what shows of calls at their ends of services.
            Such a node does not say that it is there, and reports no call that failed; of actions' calls
            nothing shows at its end. Under ``Rules.ROS2`` only.
    """

    delay_s: Bounds = (100e-6, 100e-6)
    tap_delay_s: Bounds = (100e-6, 100e-6)
    busy_s: Bounds = (0.0, 0.0)
    loss: float = 0.0
    tap_loss: float = 0.0
    unread: tuple[str, ...] = ()
    duplication: float = 0.0
    discovery_s: Bounds = (0.0, 0.0)
    lost: tuple[Lost, ...] = ()
    reordered: tuple[Reordered, ...] = ()
    pauses: tuple[Pause, ...] = ()
    slowdowns: tuple[Slowdown, ...] = ()
    kills: tuple[Kill, ...] = ()
    hosts: dict[str, str] = {}
    clocks: tuple[HostClock, ...] = ()
    cuts: tuple[Cut, ...] = ()
    lease_s: float = 10.0
    rules: Rules = Rules.ZENOH
    plain: dict[str, Introspection] = {}

    def __post_init__(self) -> None:
        for name in ("delay_s", "tap_delay_s", "busy_s", "discovery_s"):
            least, most = getattr(self, name)
            if not 0 <= least <= most:
                raise ValueError(f"{name} must be (shortest, longest) ≥ 0, not {(least, most)}")
        probabilities = [
            (name, getattr(self, name)) for name in ("loss", "tap_loss", "duplication")
        ]
        probabilities += [("probability", one.probability) for one in self.reordered]
        for name, value in probabilities:
            if not 0 <= value <= 1:
                raise ValueError(f"{name} is a probability, not {value}")
        durations = [
            ("lease_s", self.lease_s),
            *(("by_s", one.by_s) for one in self.reordered),
            *(("at_s", pause.at_s) for pause in self.pauses),
            *(("for_s", pause.for_s) for pause in self.pauses),
            *(("at_s", slow.at_s) for slow in self.slowdowns),
            *(("for_s", slow.for_s) for slow in self.slowdowns),
            *(("by_s", slow.by_s) for slow in self.slowdowns),
            *(("at_s", kill.at_s) for kill in self.kills),
            *(("down_s", kill.down_s or 0.0) for kill in self.kills),
            *(("at_s", cut.at_s) for cut in self.cuts),
            *(("for_s", cut.for_s) for cut in self.cuts),
        ]
        for name, value in durations:
            if not value >= 0:
                raise ValueError(f"{name} must be ≥ 0, not {value}")
        if self.plain and self.rules is not Rules.ROS2:
            raise ValueError("there are plain nodes under ROS 2's rules only")
        known = {"", *self.hosts.values()}
        named = [clock.host for clock in self.clocks] + [h for cut in self.cuts for h in cut.hosts]
        for host in named:
            if host not in known:
                raise ValueError(f"no node is on host {host!r} (there are: {sorted(known)})")

    def host_of(self, node: str) -> str:
        """Where ``node`` runs."""
        return self.hosts.get(node, "")

    def introspection_of(self, node: str, service: str) -> Introspection:
        """What shows of calls at the end of ``service`` that is ``node``'s."""
        if node not in self.plain:
            return Introspection.CONTENTS
        return Introspection.OFF if "/_action/" in service else self.plain[node]
