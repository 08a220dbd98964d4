"""Under what a system is run: conditions of the world, when the monitor comes, a fault in one node. All plain data.

Most of them are drawn around something that happens: a node is killed just after it sent a goal, an observation is
lost that there is. So the system is run once without any of them first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from random import Random

import msgspec

from moon.oracle.bounds import HOSTS_DIFFER_NS
from tests.campaign.bags import Bag, simpler
from transports.interface import Observation, ObservationKind
from transports.service_events import TAKEN_SUFFIX
from transports.simulated import (
    Conditions,
    Cut,
    HostClock,
    Introspection,
    Kill,
    Lost,
    Pause,
    Reordered,
    Rules,
    Slowdown,
)
from transports.simulated.world import START_NS

NS = 10**9
MONITOR = "monitor"
SECONDS = 14.0
"""So long is a run; a monitor takes some seconds to be sure of what it found in the middle of it."""
LATE_SECONDS = 20.0
"""So long is a run in which a monitor that comes late is to find a mutant that goes on showing."""
LATEST_S = 4.0
"""It comes by then."""
UNTIL_S = 7.0
"""Nothing happens to a run later than this: what it did to the monitor is over by the end."""
DEADLINE_S = 1.0
"""Whoever does nothing for longer is unresponsive: what the models say, as it is by default."""
_READING_S = 1e-6
"""Clocks that differ by less are the same."""
_NEAR_S = (0.0, 0.0002, 0.002, 0.05, 0.2)


class Faulty(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A mutant runs in one node's place: which of ``tests.mutation.operators.mutants`` of its machine."""

    node: str
    mutant: int


class Circumstances(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a system is run under.

    Attributes:
        conditions: of the world.
        seconds: how long it is run.
        joins_s: when the monitor comes; 0: before the nodes.
        latency_s: the monitor's latency bound.
        faulty: a node with a fault.
        meddled: whether somebody else's client uses the actions, too.
        recorded_s: how long a recorder of its own records the run, before it is killed; 0: there is none.
        bag: what somebody else's recorder makes of the run.
    """

    conditions: Conditions = Conditions()
    seconds: float = SECONDS
    joins_s: float = 0.0
    latency_s: float = 0.2
    faulty: Faulty | None = None
    meddled: bool = False
    recorded_s: float = 0.0
    bag: Bag | None = None

    @property
    def is_whole(self) -> bool:
        """Whether a monitor that is right knows everything: it is there first, and nothing disturbs it."""
        return self.is_undisturbed and not self.joins_s

    @property
    def is_undisturbed(self) -> bool:
        """Whether nothing is lost, late, cut, stopped or set, whenever the monitor comes."""
        nothing = Conditions()
        usual = msgspec.structs.replace(
            self.conditions, delay_s=nothing.delay_s, tap_delay_s=nothing.tap_delay_s
        )
        reach_s = self.conditions.delay_s[1] + self.conditions.tap_delay_s[1]
        return usual == nothing and reach_s < self.latency_s / 2

    @property
    def has_true_time(self) -> bool:
        """Whether stamps tell how long things took: no clock is wrong."""
        return not self.conditions.clocks

    @property
    def has_close_clocks(self) -> bool:
        """Whether no clock is ever wrong by more than clocks may be, of one host or of two."""
        clocks = self.conditions.clocks
        moved_s = (
            abs(clock.ahead_s) + sum(abs(by_s) for _, by_s in clock.steps) for clock in clocks
        )
        return round(sum(moved_s) * NS) <= HOSTS_DIFFER_NS

    @property
    def has_one_clock(self) -> bool:
        """Whether all stamps are of one clock, which may be set: what is violated all the same is so in truth."""
        clocks = self.conditions.clocks
        return not self.conditions.hosts and not any(clock.ahead_s for clock in clocks)

    def may_be_silent(self, node: str) -> bool:
        """Whether ``node`` stands still for so long that a monitor may say that it does."""
        return any(
            pause.node == node and pause.for_s > DEADLINE_S for pause in self.conditions.pauses
        )

    @property
    def over_s(self) -> float:
        """When the last of what happens once has happened; the run's length where something goes on."""
        conditions = self.conditions
        if conditions.tap_loss or conditions.loss or conditions.reordered:
            return self.seconds
        if conditions.unread or conditions.plain:
            return self.seconds
        if conditions.duplication or conditions.delay_s[1] + conditions.tap_delay_s[1] > 0.15:
            return self.seconds
        found = [self.joins_s, conditions.discovery_s[1]]
        found += [pause.at_s + pause.for_s for pause in conditions.pauses]
        found += [slow.at_s + slow.for_s + slow.by_s for slow in conditions.slowdowns]
        for kill in conditions.kills:
            lease_s = 5.0 + conditions.lease_s if conditions.rules is Rules.ROS2 else 0.0
            found.append(kill.at_s + (kill.down_s or 0.0) + lease_s)
        found += [cut.at_s + cut.for_s for cut in conditions.cuts]
        found += [at_s for clock in conditions.clocks for at_s, _ in clock.steps]
        if conditions.lost or (conditions.hosts and self._do_clocks_differ()):
            return self.seconds
        return max(found)

    def _do_clocks_differ(self) -> bool:
        """Whether those of the two hosts differ in the end: for good."""
        ahead_s = {"": 0.0, "robot": 0.0}
        for clock in self.conditions.clocks:
            ahead_s[clock.host] += clock.ahead_s + sum(by_s for _, by_s in clock.steps)
        return abs(ahead_s[""] - ahead_s["robot"]) > _READING_S


class Kind(StrEnum):
    """What may be wrong."""

    SLOW = "slow links"
    SLOW_TAP = "a slow tap"
    LOSSES = "losses at the tap"
    LOST = "a lost observation"
    LOST_MESSAGE = "a lost message"
    LOSSY = "best-effort losses"
    DOUBLES = "duplicates"
    REORDERED = "a reordered link"
    REORDERED_TAP = "a channel reordered at the tap"
    LATE = "a late monitor"
    BIT_BY_BIT = "subscribed bit by bit"
    PAUSE = "the monitor stands still"
    NODE_PAUSE = "a node stands still"
    SLOWDOWN = "a busy host"
    KILL = "a node is killed and started again"
    STEP = "a clock is set"
    SKEW = "clocks differ"
    CUT = "a cut network"
    ROS2 = "ROS 2's rules"
    MEDDLED = "a client of somebody else's"
    RECORDED = "a recorder that is killed"
    UNREAD = "a type that the monitor does not have"
    PLAIN = "plain nodes of ROS 2"


WEIGHTS = {
    Kind.SLOW: 2,
    Kind.SLOW_TAP: 2,
    Kind.LOSSES: 2,
    Kind.LOST: 6,
    Kind.LOST_MESSAGE: 1,
    Kind.LOSSY: 2,
    Kind.DOUBLES: 2,
    Kind.REORDERED: 1,
    Kind.REORDERED_TAP: 3,
    Kind.LATE: 4,
    Kind.BIT_BY_BIT: 3,
    Kind.PAUSE: 2,
    Kind.NODE_PAUSE: 4,
    Kind.SLOWDOWN: 3,
    Kind.KILL: 6,
    Kind.STEP: 6,
    Kind.SKEW: 2,
    Kind.CUT: 4,
    Kind.ROS2: 4,
    Kind.MEDDLED: 3,
    Kind.RECORDED: 3,
    Kind.UNREAD: 1,
    Kind.PLAIN: 1,
}
"""How often each is drawn."""


class Happened(msgspec.Struct, frozen=True):
    """What a run did in which nothing is wrong.

    Attributes:
        nodes: the names of all, the policy's included.
        seen: everything, in order.
        broken: when each property is broken first that is (ns).
    """

    nodes: tuple[str, ...]
    seen: tuple[Observation, ...]
    broken: tuple[int, ...] = ()


def draw(random: Random, happened: Happened) -> Circumstances:
    """One to three things that are wrong at once.

    Args:
        random: where all chance comes from.
        happened: what the same system did without.
    """
    count = random.choice((1, 1, 2, 2, 3))
    kinds: list[Kind] = []
    while len(kinds) < count:
        kind = random.choices(list(WEIGHTS), list(WEIGHTS.values()))[0]
        if kind not in kinds:
            kinds.append(kind)
    delay_s = random.choice((0.0001, 0.002, 0.02, 0.045))
    made = Circumstances(Conditions(delay_s=(0.0, delay_s), tap_delay_s=(0.0, delay_s)))
    if Kind.PLAIN in kinds and Kind.ROS2 not in kinds:
        kinds.append(Kind.ROS2)
    drawn = _Drawn(random, happened, Kind.ROS2 in kinds)
    kinds.sort(key=lambda kind: (kind is Kind.LATE, kind is Kind.PLAIN))
    for kind in kinds:
        made = drawn.with_one(made, kind)
    slowest_s = max((slow.by_s for slow in made.conditions.slowdowns), default=0.0)
    longest_s = made.conditions.delay_s[1] + slowest_s
    if Kind.ROS2 in kinds and longest_s + 0.05 > made.latency_s / 2:
        # without reports of what is taken, the bound is all that a monitor knows of the network
        made = msgspec.structs.replace(made, latency_s=2.5 * longest_s)
    return made


def nominal(random: Random) -> Circumstances:
    """Nothing is wrong; messages and observations take their time within the latency bound."""
    delay_s = random.choice((0.0001, 0.002, 0.02, 0.045))
    return Circumstances(
        Conditions(delay_s=(0.0, delay_s), tap_delay_s=(0.0, delay_s)),
        seconds=10.0,
        meddled=random.random() < 0.3,
        recorded_s=round(random.uniform(3.0, 9.0), 3) if random.random() < 0.5 else 0.0,
    )


def later(random: Random, made: Circumstances) -> Circumstances:
    """``made``, and the monitor comes while the system runs; the run is so long that it finds what goes on."""
    joins_s = round(random.uniform(0.5, LATEST_S), 4)
    return msgspec.structs.replace(made, seconds=LATE_SECONDS, joins_s=joins_s)


class _Drawn:
    def __init__(self, random: Random, happened: Happened, is_ros: bool) -> None:
        self._random = random
        self._happened = happened
        self._is_ros = is_ros
        self._seen = [
            seen for seen in happened.seen if seen.stamp_ns < START_NS + round(UNTIL_S * NS)
        ]

    def with_one(self, made: Circumstances, kind: Kind) -> Circumstances:
        """``made``, and this is wrong, too."""
        if kind is Kind.LATE:
            return msgspec.structs.replace(made, joins_s=self._joins_s(made.conditions.pauses))
        if kind is Kind.MEDDLED:
            return msgspec.structs.replace(made, meddled=True)
        if kind is Kind.RECORDED:
            return msgspec.structs.replace(made, recorded_s=self._end_s())
        change: Callable[[Conditions], Conditions] = getattr(self, f"_{kind.name.lower()}")
        return msgspec.structs.replace(made, conditions=change(made.conditions))

    def _instant_s(self, seen: Observation | None = None) -> float:
        """Close to something that happens."""
        random = self._random
        if not self._seen:
            return round(random.uniform(0.5, UNTIL_S), 4)
        stamp_ns = (seen or random.choice(self._seen)).stamp_ns
        at_s = (stamp_ns - START_NS) / NS + random.choice(_NEAR_S) * random.uniform(-0.3, 1.0)
        return round(max(at_s, 0.02), 6)

    def _joins_s(self, pauses: tuple[Pause, ...]) -> float:
        """When a monitor joins: about where a node stands still, if one does."""
        still = [pause for pause in pauses if pause.node != MONITOR]
        if not still:
            return self._instant_s()
        at_s = still[0].at_s + self._random.uniform(-0.4, still[0].for_s + 0.1)
        return round(max(at_s, 0.02), 4)

    def _end_s(self) -> float:
        """When a recorder is killed: mostly just after something that breaks a property."""
        broken = [stamp_ns for stamp_ns in self._happened.broken if stamp_ns > START_NS]
        if not broken or self._random.random() < 0.3:
            return self._instant_s()
        at_s = (self._random.choice(broken) - START_NS) / NS
        return round(at_s + self._random.choice((0.01, 0.05, 0.15)), 4)

    def _node(self) -> str:
        return self._random.choice(self._happened.nodes)

    # --- the network -------------------------------------------------------------------------------

    def _slow(self, conditions: Conditions) -> Conditions:
        longest = self._random.choice((0.1, 0.19, 0.3, 0.5))
        return msgspec.structs.replace(conditions, delay_s=(0.0, longest))

    def _slow_tap(self, conditions: Conditions) -> Conditions:
        longest = self._random.choice((0.1, 0.19, 0.3, 0.5))
        return msgspec.structs.replace(conditions, tap_delay_s=(0.0, longest))

    def _losses(self, conditions: Conditions) -> Conditions:
        return msgspec.structs.replace(conditions, tap_loss=self._random.choice((0.002, 0.02, 0.2)))

    def _lossy(self, conditions: Conditions) -> Conditions:
        return msgspec.structs.replace(conditions, loss=self._random.choice((0.02, 0.2)))

    def _doubles(self, conditions: Conditions) -> Conditions:
        return msgspec.structs.replace(conditions, duplication=self._random.choice((0.02, 0.3)))

    def _lost(self, conditions: Conditions) -> Conditions:
        found = [self._loss() for _ in range(self._random.choice((1, 1, 1, 2)))]
        lost = tuple(one for one in found if one is not None)
        return msgspec.structs.replace(conditions, lost=(*conditions.lost, *lost))

    def _loss(self) -> Lost | None:
        """Of one kind of observation after another: what is rare is lost as often.

        On ROS 2 what a client reports of failed calls has no number. It is sent reliably, the last hundred of
        a node again to who comes late: none of it is lost alone.
        """
        may_be_lost = [one for one in self._seen if not (self._is_ros and one.error)]
        if not may_be_lost:
            return None
        seen = self._random.choice(may_be_lost)
        if self._random.random() < 0.7:
            places = sorted({(one.source, one.channel, one.kind) for one in may_be_lost})
            place = self._random.choice(places)
            seen = self._random.choice(
                [one for one in may_be_lost if (one.source, one.channel, one.kind) == place]
            )
        return Lost(seen.source, _where(seen), self._number(seen, _where))

    def _number(self, seen: Observation, where: Callable[[Observation], str]) -> int:
        same = [
            one
            for one in self._happened.seen
            if (one.source, where(one)) == (seen.source, where(seen))
        ]
        return same.index(seen)

    def _lost_message(self, conditions: Conditions) -> Conditions:
        taken = [seen for seen in self._seen if seen.kind is ObservationKind.MESSAGE_TAKEN]
        if not taken:
            return conditions
        seen = self._random.choice(taken)
        lost = Lost(seen.client, seen.channel, seen.call, seen.source)
        return msgspec.structs.replace(conditions, lost=(*conditions.lost, lost))

    def _reordered(self, conditions: Conditions) -> Conditions:
        taken = [seen for seen in self._seen if seen.kind is ObservationKind.MESSAGE_TAKEN]
        if not taken:
            return conditions
        seen = self._random.choice(taken)
        one = Reordered(seen.client, seen.channel, self._by_s(), seen.source, self._share())
        return msgspec.structs.replace(conditions, reordered=(*conditions.reordered, one))

    def _reordered_tap(self, conditions: Conditions) -> Conditions:
        if not self._seen:
            return conditions
        seen = self._random.choice(self._seen)
        one = Reordered(seen.source, _where(seen), self._by_s(), probability=self._share())
        return msgspec.structs.replace(conditions, reordered=(*conditions.reordered, one))

    def _by_s(self) -> float:
        return self._random.choice((0.01, 0.05, 0.15, 0.3))

    def _share(self) -> float:
        return self._random.choice((0.05, 0.3))

    def _cut(self, conditions: Conditions) -> Conditions:
        conditions = self._on_hosts(conditions)
        for_s = self._random.choice((0.1, 0.3, 1.0, 3.0, 7.0))
        cut = Cut(("robot",), self._instant_s(), for_s)
        lease_s = self._random.choice((10.0, 10.0, 2.0)) if for_s < 7.0 else 10.0
        return msgspec.structs.replace(conditions, cuts=(cut,), lease_s=lease_s)

    def _on_hosts(self, conditions: Conditions) -> Conditions:
        """Some nodes are on another host."""
        if conditions.hosts:
            return conditions
        nodes = (*self._happened.nodes, MONITOR)
        there = self._random.sample(nodes, self._random.randint(1, len(nodes) - 1))
        return msgspec.structs.replace(conditions, hosts=dict.fromkeys(sorted(there), "robot"))

    # --- who listens -------------------------------------------------------------------------------

    def _bit_by_bit(self, conditions: Conditions) -> Conditions:
        longest = self._random.choice((0.05, 0.5, 2.0))
        return msgspec.structs.replace(conditions, discovery_s=(0.0, longest))

    def _unread(self, conditions: Conditions) -> Conditions:
        channels = sorted({seen.channel for seen in self._seen})
        some = self._random.sample(channels, min(len(channels), self._random.choice((1, 1, 3))))
        return msgspec.structs.replace(conditions, unread=tuple(some))

    def _pause(self, conditions: Conditions) -> Conditions:
        for_s = self._random.choice((0.06, 0.15, 0.3, 0.6, 2.0))
        pause = Pause(MONITOR, self._instant_s(), for_s)
        return msgspec.structs.replace(conditions, pauses=(*conditions.pauses, pause))

    # --- nodes -------------------------------------------------------------------------------------

    def _node_pause(self, conditions: Conditions) -> Conditions:
        for_s = self._random.choice((0.05, 0.3, 0.3, 0.8, 1.3, 2.5))
        pause = Pause(self._node(), self._instant_s(), for_s)
        return msgspec.structs.replace(conditions, pauses=(*conditions.pauses, pause))

    def _slowdown(self, conditions: Conditions) -> Conditions:
        random, nodes = self._random, self._happened.nodes
        there = random.sample(nodes, random.randint(1, len(nodes)))
        for_s, by_s = random.choice((0.1, 0.5, 3.0)), random.choice((0.03, 0.1, 0.15, 0.3))
        slow = Slowdown(tuple(sorted(there)), self._instant_s(), for_s, by_s)
        return msgspec.structs.replace(conditions, slowdowns=(*conditions.slowdowns, slow))

    def _kill(self, conditions: Conditions) -> Conditions:
        kills = tuple(self._one_kill() for _ in range(self._random.choice((1, 1, 2, 3))))
        return msgspec.structs.replace(
            conditions, kills=kills, lease_s=self._random.choice((10.0, 2.0))
        )

    def _one_kill(self) -> Kill:
        """While something is under way, if there is something."""
        under_way = [
            seen
            for seen in self._seen
            if "/_action/" in seen.channel or seen.kind is not ObservationKind.MESSAGE
        ]
        of_actions = [seen for seen in under_way if "/_action/" in seen.channel]
        seen = None
        node = self._node()
        if of_actions and self._random.random() < 0.5:
            under_way = of_actions
        if under_way and self._random.random() < 0.7:
            seen = self._random.choice(under_way)
            there = [name for name in (seen.source, seen.client) if name in self._happened.nodes]
            node = self._random.choice(there or [node])
        down_s = self._random.choice((0.0, 0.02, 0.3, 1.5, None))
        return Kill(node, self._instant_s(seen), down_s)

    # --- clocks ------------------------------------------------------------------------------------

    def _step(self, conditions: Conditions) -> Conditions:
        random = self._random
        by_s = random.choice(
            (
                random.uniform(-0.19, -0.005),
                random.uniform(0.005, 0.4),
                random.uniform(-0.01, 0.01),
                random.choice((-3600.0, -5.0, -0.3, 0.3, 0.4, 5.0, 3600.0)),
            )
        )
        host = ""
        if random.random() < 0.4:
            conditions, host = self._on_hosts(conditions), "robot"
        steps = [(self._instant_s(), round(by_s, 4))]
        if random.random() < 0.2:
            steps.append((steps[0][0] + 1.0, round(-by_s, 4)))
        clocks = (*conditions.clocks, HostClock(host, steps=tuple(steps)))
        return msgspec.structs.replace(conditions, clocks=clocks)

    def _skew(self, conditions: Conditions) -> Conditions:
        conditions = self._on_hosts(conditions)
        near_s = round(self._random.uniform(-0.01, 0.01), 4)
        ahead_s = self._random.choice((-3600.0, -0.3, -0.05, near_s, near_s, 0.05, 0.3, 3600.0))
        clocks = (*conditions.clocks, HostClock("robot", ahead_s))
        return msgspec.structs.replace(conditions, clocks=clocks)

    def _ros2(self, conditions: Conditions) -> Conditions:
        longest = self._random.choice((0.0, 0.05, 0.5, 1.5))
        return msgspec.structs.replace(
            conditions,
            rules=Rules.ROS2,
            discovery_s=max(conditions.discovery_s, (0.0, longest)),
            lease_s=self._random.choice((10.0, 2.0)),
        )

    def _plain(self, conditions: Conditions) -> Conditions:
        nodes = self._happened.nodes
        some = self._random.sample(nodes, min(len(nodes), self._random.choice((1, 1, 2, 4))))
        plain = {node: self._random.choice(list(Introspection)) for node in sorted(some)}
        return msgspec.structs.replace(conditions, plain=plain)


def _where(seen: Observation) -> str:
    """The channel as ``Lost`` and ``Reordered`` name it."""
    is_taken = seen.kind is ObservationKind.MESSAGE_TAKEN
    return seen.channel + (TAKEN_SUFFIX if is_taken else "")


def fewer(made: Circumstances) -> Sequence[Circumstances]:
    """The same with less wrong, for a shrinker: one thing less, or as usual."""
    conditions = made.conditions
    nothing = Conditions()
    found: list[Circumstances] = []

    def with_(conditions: Conditions) -> None:
        try:
            found.append(msgspec.structs.replace(made, conditions=conditions))
        except ValueError:  # a cut without hosts
            return

    replace = msgspec.structs.replace
    for name in ("lost", "reordered", "unread", "pauses", "slowdowns", "kills", "clocks", "cuts"):
        several = getattr(conditions, name)
        if several:
            with_(replace(conditions, **{name: ()}))
        if len(several) > 1:
            for number in range(len(several)):
                with_(replace(conditions, **{name: several[:number] + several[number + 1 :]}))
    if conditions.hosts and not conditions.clocks and not conditions.cuts:
        with_(replace(conditions, hosts={}))
    for node in conditions.plain:
        with_(replace(conditions, plain={n: w for n, w in conditions.plain.items() if n != node}))
    if len(conditions.hosts) > 1:
        for node in conditions.hosts:
            with_(
                replace(conditions, hosts={n: h for n, h in conditions.hosts.items() if n != node})
            )
    for clock in conditions.clocks:
        for number in range(len(clock.steps) if len(clock.steps) > 1 else 0):
            steps = clock.steps[:number] + clock.steps[number + 1 :]
            others = tuple(other for other in conditions.clocks if other is not clock)
            with_(replace(conditions, clocks=(*others, replace(clock, steps=steps))))
    if conditions.rules is not nothing.rules:
        with_(replace(conditions, rules=nothing.rules, plain={}))
    for name in ("loss", "tap_loss", "duplication", "discovery_s", "lease_s", "busy_s"):
        if getattr(conditions, name) != getattr(nothing, name):
            with_(replace(conditions, **{name: getattr(nothing, name)}))
    for name in ("delay_s", "tap_delay_s"):
        if getattr(conditions, name) != getattr(nothing, name):
            with_(replace(conditions, **{name: getattr(nothing, name)}))
    if made.joins_s:
        found.append(replace(made, joins_s=0.0))
    if made.bag is not None:
        found += [replace(made, bag=bag) for bag in (None, *simpler(made.bag))]
    if made.meddled:
        found.append(replace(made, meddled=False))
    if made.recorded_s:
        found.append(replace(made, recorded_s=0.0))
    if made.latency_s != Circumstances().latency_s:
        found.append(replace(made, latency_s=Circumstances().latency_s))
    return found
