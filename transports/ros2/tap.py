"""The tap: an ordinary subscriber of whatever the graph shows, in the QoS with which it receives it.

A subscription that cannot keep up loses its oldest messages at its own end (it keeps the last few
thousand); DDS numbers what a publisher sends, so the gaps show how many were missed.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter
from typing import Any

import msgspec

from transports import ros_forms
from transports.cdr import CdrError
from transports.channel_filter import matches
from transports.fields_read import FieldsRead
from transports.interface import (
    CLOCK_TYPE,
    Answer,
    BlindSpot,
    BlindSpotKind,
    Closes,
    Observation,
    TransportError,
)
from transports.ros2 import native, qos
from transports.ros2.announcements import Announcements
from transports.ros2.executor import Executor
from transports.ros2.graph import UNKNOWN, request_topic
from transports.ros2.interfaces import ros_class
from transports.ros2.observing import Errors, Events, Messages, Notes, Observing
from transports.ros2.presence import TOPIC as NODES_TOPIC
from transports.ros2.raw_subscription import RawSubscription
from transports.ros2.shared import Shared
from transports.ros2.subscribing import Subscriber
from transports.ros2.takers import Takers
from transports.service_events import EVENT_SUFFIX, TYPE_SUFFIX
from transports.timers import Timer

_QUIET = ("/rosout", "/parameter_events", "/clock")
"""Topics of ROS 2 itself, which every node has: received only when a glob is their name."""
_QUIET_PACKAGES = ("rcl_interfaces/", "type_description_interfaces/", "composition_interfaces/")
"""Types of the services that every node serves; nobody asks why they have no introspection."""
_NAMELESS_S = 0.05
"""How long a message waits for the name of its publisher; what came after it waits, too. A monitor's time
passes meanwhile, so it must be less than observations may be late."""
_NEVER_NAMED_S = 1.0
"""A publisher without a name so long after its first message has none: its messages wait no more."""
_RETRY_S = 0.02
_QUIET_S = 0.05
"""The least time from one look at the graph to the next."""
_CLOSELY_S = 0.3
"""How long after the last look at the graph a close one follows, at each publisher's QoS and type. The others
only count publishers: that is faster, but does not notice that one was replaced."""
_TURN_S = 0.01
"""How long the tap subscribes before what else is to be done has its turn."""
_LEFT_S = 1.0
"""So long it is said that a client left: whoever judges calls looks several times meanwhile."""
_SILENT_S = 1.0
"""A service whose events nobody publishes for so long has none; not at once, as endpoints come one by one."""
MOST_TURN_BYTES = 16 * 1024 * 1024
"""What is taken in one turn at most before it is handed on; as plain values it is up to ten times as much."""
MOST_KEPT_BYTES = 64 * 1024 * 1024
"""What DDS keeps of one topic until it is taken. It bounds the number of messages only, so a subscription
keeps fewer of a topic where large ones come."""
_LEAST_DEPTH = 4
_UNKNOWN = -1
_ALONE_S = 1.0
"""All participants that are there are known by then: DDS announces each five times in half a second."""
_DISCOVERY_S = 3.5
"""What others publish is known by then: what was lost of that is sent again at heartbeats, each 3 s."""
_MATCHED_S = 0.5
"""So long after it was made a subscription is matched with the publishers that were there."""
_HOW = (
    "switch it on at both ends: configure_introspection(clock, qos, "
    "ServiceIntrospectionState.CONTENTS) on the service and on the client"
)


class _Tapped(msgspec.Struct, eq=False):
    """One topic that is subscribed to, or about to be: then there is no subscription yet."""

    topic: str
    type_name: str
    profile: Any
    publishers: int
    is_own: bool
    """Whether nobody but the tap's node published it then: what it sends, it has not sent before."""
    subscription: RawSubscription | None = None
    observing: Observing | None = None
    numbers: dict[bytes, int] = msgspec.field(default_factory=dict)
    """The last of each publisher; known to the next subscription, which transient local messages reach
        again."""


class _Waiting(msgspec.Struct):
    """What was taken, and when (monotonic, s)."""

    stamp_ns: int
    observing: Observing
    taken: native.Taken
    data: Any
    since_s: float


_STAMP = attrgetter("stamp_ns")


class Tap(Closes):
    """A passive listener; see ``transports.interface.Tap``."""

    def __init__(
        self,
        node: Any,
        executor: Executor,
        subscriber: Subscriber,
        shared: Shared,
        announcements: Announcements,
        globs: Sequence[str],
        handler: Callable[[Observation], None],
    ) -> None:
        self._node = node
        self._executor = executor
        self._subscriber = subscriber
        self._shared = shared
        self._graph = shared.graph
        self._roster = shared.roster
        self._announcements = announcements
        self._prefix = prefix = shared.prefix
        self._globs = [prefix + glob for glob in globs] or [f"{prefix}/*"]
        self._handler = handler
        self._taker = native.Taker()
        self._fields_read: FieldsRead = lambda channel: None
        self._notes = Notes(shared.graph, shared.roster, prefix)
        self._tapped: dict[str, _Tapped] = {}
        self._takers = Takers(node, shared.graph)
        self._simulated: Mapping[str, str] = {}
        """Nodes with the time of a simulation, and why that is known; replaced whole."""
        self._looking = False
        self._quiet_until = 0.0
        self._close_look: Timer | None = None
        self._to_tap: deque[tuple[str, Sequence[str]]] = deque()
        """What the graph showed when it was last looked at, and has not been subscribed to yet."""
        self._making = 0
        """Subscriptions that are on their way."""
        self._not_received: dict[str, str] = {}
        self._taken: list[_Waiting] = []
        """In the present turn, topic by topic: all that had come when it began."""
        self._newest: dict[bytes, int] = {}
        """Of these, the latest stamp of each publisher."""
        self._waiting: deque[_Waiting] = deque()
        self._retrying = False
        self._turn_bytes = 0
        self._nameless: dict[bytes, float] = {}
        """When something was first received from each that had no name."""
        self._silent_since: dict[tuple[str, str], float] = {}
        """Of services that have no events."""
        self._called: frozenset[str] = frozenset()
        """Those of them that have clients."""
        self._left: dict[str, float] = {}
        """Services of which a client left that had no answer yet, each with when that was noticed."""
        self._closed = False
        self._began_s = time.monotonic()
        self._complete_at_s = self._began_s + _ALONE_S
        announcements.own.taps += self._globs
        announcements.say()
        executor.after_taking(self._pass_on)
        executor.post(self.refresh)

    @property
    def is_complete(self) -> bool:
        """Whether the graph was discovered, and of late nothing was new in it, or waited for a name."""
        is_busy = self._to_tap or self._looking or self._making
        return not is_busy and time.monotonic() >= self._complete_at_s

    def _not_complete_before(self, instant_s: float) -> None:
        self._complete_at_s = max(self._complete_at_s, instant_s)

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        """Nodes cannot be asked: None at once."""
        self._executor.post(lambda: answered(None))

    def is_contested(self, name: str) -> bool:
        """See ``transports.interface.Tap``."""
        return self._roster.is_contested(name)

    def take_dropped(self) -> Sequence[tuple[str, str]]:
        """See ``transports.interface.Tap``."""
        return ()

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        """See ``transports.interface.Tap``; who subscribes to a clock follows it, as rcl does with
        ``use_sim_time``.
        """
        prefix, received = self._prefix, BlindSpotKind.NOT_RECEIVED
        found = {
            BlindSpot(received, topic.removesuffix(EVENT_SUFFIX)): why
            for topic, why in self._not_received.copy().items()
        }
        found |= {
            BlindSpot(received, service, node): _unseen(service)
            for service, node in self._silent_since.copy()
            if service in self._called
        }
        found |= {
            BlindSpot(received, name): why for name, why in self._notes.other_clock.copy().items()
        }
        left_s = time.monotonic() - _LEFT_S
        found |= {
            BlindSpot(
                received, service
            ): f"a client of {service} has left: what it is answered is not shown"
            for service, since in self._left.copy().items()
            if since > left_s
        }
        taken = BlindSpotKind.MAY_NOT_BE_TAKEN
        found |= {BlindSpot(taken, *place): why for place, why in self._takers.unsure().items()}
        timed = {
            BlindSpot(BlindSpotKind.OTHER_TIME, "", node): why
            for node, why in self._simulated.items()
        }
        return timed | {
            spot._replace(channel=spot.channel.removeprefix(prefix)): why
            for spot, why in found.items()
        }

    def read_only(self, fields: FieldsRead) -> None:
        """See ``transports.interface.ReadsParts``."""
        self._fields_read = fields
        for tapped in self._tapped.values():
            if tapped.observing is not None:
                tapped.observing.read_only(fields)

    def peers(self) -> Sequence[str]:
        """Names of the nodes in the graph, and of those that announced themselves."""
        names = self._graph.node_names() | set(self._announcements.names())
        return sorted(names - {self._node.get_name()})

    def problems(self) -> Sequence[str]:
        """What was missed or not decoded, which topics cannot be received, which services have no
        introspection.
        """
        notes = self._notes
        not_received = {
            **notes.without_contents.copy(),
            **notes.other_clock.copy(),
            **self._not_received.copy(),
        }
        contested = (
            f"several nodes claim to be {name}: which of them is the node is not known"
            for name in self._roster.contested()
        )
        return [
            *notes.losses.sentences(),
            *contested,
            *notes.foreign(),
            *not_received.values(),
            *self._silent_services(),
        ]

    def close(self) -> None:
        """Stop listening; idempotent."""
        if self._closed:
            return
        self._closed = True
        for glob in self._globs:
            self._announcements.own.taps.remove(glob)
        if self._executor.is_current():
            self._release()
        else:  # nobody may wait for a subscription that is being destroyed
            self._executor.post(self._release)

    def _release(self) -> None:
        self._executor.no_longer_after_taking(self._pass_on)
        for tapped in self._tapped.values():
            self._drop(tapped)
        self._tapped.clear()
        self._taker.close()
        self._announcements.say_again()

    def _drop(self, tapped: _Tapped) -> None:
        if tapped.subscription is not None:
            self._executor.forget(tapped.subscription)
            self._subscriber.end(tapped.subscription)

    def refresh(self) -> None:
        """The graph has changed (on the executor): look at it, at once if it was quiet before.

        While a system starts it changes a hundred times, and each look takes locks that DDS holds then.
        """
        self._not_complete_before(time.monotonic() + _MATCHED_S)
        if not self._looking and not self._closed:
            self._looking = True
            self._executor.after_real(max(self._quiet_until - time.monotonic(), 0.0), self._look)

    def _look(self) -> None:
        """Look for what is new in the graph, and subscribe to it bit by bit: what else is to be done
        here, a monitor's clock for one, has its turn in between.
        """
        self._looking = False
        self._quiet_until = time.monotonic() + _QUIET_S
        if self._closed:
            return
        if self._close_look is not None:
            self._close_look.cancel()
        self._close_look = self._executor.after_real(_CLOSELY_S, self._look_closely)
        self._look_around()

    def _look_closely(self) -> None:
        for tapped in self._tapped.values():
            tapped.publishers = _UNKNOWN
        self._takers.look_closely()
        if not self._closed:
            self._look_around()

    def _look_around(self) -> None:
        self._graph.learn_participants()
        self._deliver()
        self._note_silence()
        self._note_who_left()
        is_subscribing = bool(self._to_tap)
        topics = self._node.get_topic_names_and_types()
        self._to_tap = deque((topic, types) for topic, types in topics if self._wants(topic))
        self._takers.keep({topic for topic, _ in topics})
        self._simulated = dict(self._with_a_clock(topics))
        if not is_subscribing:
            self._subscribe_next()

    def _with_a_clock(
        self, topics: Sequence[tuple[str, Sequence[str]]]
    ) -> Iterator[tuple[str, str]]:
        """The nodes that subscribe to one of the clocks among ``topics``, each with what is said of it."""
        for topic, types in topics:
            if CLOCK_TYPE in types:
                for info in self._node.get_subscriptions_info_by_topic(topic):
                    if (name := self._graph.name_of(info)) == UNKNOWN:
                        continue  # it is soon known, which is a change of the graph
                    yield (
                        name,
                        f"{name} has its time from {topic}, which may stand still or be faster",
                    )

    def _subscribe_next(self) -> None:
        """Subscribe to some of what is to be tapped, the rest in the next turn."""
        deadline = time.monotonic() + _TURN_S
        while self._to_tap and not self._closed and time.monotonic() < deadline:
            self._subscribe(*self._to_tap.popleft())
        if self._to_tap:
            self._executor.post(self._subscribe_next)
        self._report_refused()

    def _report_refused(self) -> None:
        """Once nothing is on its way any more."""
        if self._to_tap or self._making or self._closed:
            return
        if self._announcements.own.refused != (refused := sorted(self._not_received)):
            self._announcements.own.refused = refused
            self._announcements.say_again()

    def _wants(self, topic: str) -> bool:
        if topic == self._prefix + ros_forms.CALL_ERRORS:
            return True
        if not topic.startswith(self._prefix + "/"):
            return False
        if topic == self._prefix + NODES_TOPIC or topic in _QUIET:
            return topic in self._globs
        return matches(topic.removesuffix(EVENT_SUFFIX), self._globs)

    def _subscribe(self, topic: str, types: Sequence[str]) -> None:
        tapped = self._tapped.get(topic)
        count = self._node.count_publishers(topic)
        if topic != self._prefix + ros_forms.CALL_ERRORS:
            self._takers.look(topic, count)
        if tapped is not None:
            if tapped.publishers == count:
                return
            tapped.publishers = count
        if not count:
            return
        publishers = self._node.get_publishers_info_by_topic(topic)
        offered = sorted({info.topic_type for info in publishers})
        if tapped is not None:
            if tapped.type_name not in offered:
                # a participant that declares a topic anew with another type crashes in rmw_fastrtps
                self._not_received[topic] = (
                    f"{topic} is not received any more: it is published as {', '.join(offered)} now, "
                    f"and was as {tapped.type_name}, the only type that this node can have it as; "
                    "restart this program"
                )
                return
            self._not_received.pop(topic, None)
            if not any(qos.mismatch(info.qos_profile, tapped.profile) for info in publishers):
                return
            self._drop(tapped)  # who publishes now offers less than those before: ask for less
            del self._tapped[topic]
        if len(offered) > 1:
            self._not_received[topic] = (
                f"{topic} is published with different types ({', '.join(offered)}): "
                f"only {offered[0]} is received"
            )
        try:
            type_name = offered[0] if offered else types[0]
            profile = qos.to_receive_all(publishers)
            ros = ros_class(type_name)
            self._shared.require_type(topic, type_name, self._node.get_name())
        except TransportError as error:
            self._not_received[topic] = f"{topic} is not received: {error}"
            return
        is_own = all(info.node_name == self._node.get_name() for info in publishers)
        tapped = self._tapped[topic] = _Tapped(topic, type_name, profile, count, is_own)
        self._making += 1
        self._subscriber.subscribe(topic, ros, profile, partial(self._subscribed, tapped, ros))

    def _subscribed(
        self, tapped: _Tapped, ros: Any, made: RawSubscription | TransportError
    ) -> None:
        """What was to be tapped is subscribed to, or cannot be."""
        self._making -= 1
        is_wanted = self._tapped.get(tapped.topic) is tapped
        if isinstance(made, TransportError):
            if is_wanted:
                self._not_received[tapped.topic] = f"{tapped.topic} is not received: {made}"
                del self._tapped[tapped.topic]
        elif is_wanted:
            tapped.subscription = made
            self._take_from(made, tapped, ros)
        else:
            self._subscriber.end(made)
        self._report_refused()

    def _take_from(self, handle: RawSubscription, tapped: _Tapped, ros: Any) -> None:
        topic = tapped.topic
        observing = tapped.observing = self._observing(topic, tapped.type_name, ros)
        observing.read_only(self._fields_read)

        def take() -> bool:
            taken = None if self._closed else self._taker.take(handle)
            if taken is None:
                return False
            size = len(taken.payload)
            if size * tapped.profile.depth > 2 * MOST_KEPT_BYTES and not self._closed:
                self._executor.post(partial(self._keep_fewer, tapped, ros, size))
            if taken.number:
                if taken.number <= tapped.numbers.get(taken.gid, 0):
                    return True  # a transient local one that this subscription's forerunner had
                tapped.numbers[taken.gid] = taken.number
            try:
                data = observing.read(taken.payload)
            except CdrError as error:
                source = self._graph.publisher_of(topic, taken.gid)
                self._notes.losses.undecodable(topic, source, error)
                return True
            # what one publisher sends stays in its order, by which it is numbered
            newest, gid = self._newest, taken.gid
            newest[gid] = stamp_ns = max(newest.get(gid, 0), observing.stamp_ns(taken, data))
            self._taken.append(_Waiting(stamp_ns, observing, taken, data, time.monotonic()))
            self._turn_bytes += size
            if self._turn_bytes > MOST_TURN_BYTES:
                self._pass_on()
            return True

        self._executor.handle(handle, take, qos.TAP_DEPTH, is_patient=True)
        if not tapped.is_own:
            self._not_complete_before(self._began_s + _DISCOVERY_S)
            self._not_complete_before(time.monotonic() + _MATCHED_S)

    def _keep_fewer(self, tapped: _Tapped, ros: Any, size: int) -> None:
        """Subscribe anew, with a shorter history: messages of ``size`` bytes come on this topic."""
        depth = max(MOST_KEPT_BYTES // size, _LEAST_DEPTH)
        if (
            self._closed
            or self._tapped.get(tapped.topic) is not tapped
            or tapped.profile.depth <= depth
        ):
            return
        self._drop(tapped)
        tapped.subscription = None
        tapped.profile.depth = depth
        self._making += 1
        self._subscriber.subscribe(
            tapped.topic, ros, tapped.profile, partial(self._subscribed, tapped, ros)
        )

    def _observing(self, topic: str, type_name: str, ros: Any) -> Observing:
        if topic == self._prefix + ros_forms.CALL_ERRORS:
            return Errors(self._notes, topic, self._globs, ros)
        is_of_service = topic.endswith(EVENT_SUFFIX) and type_name.endswith(TYPE_SUFFIX)
        made = Events if is_of_service else Messages
        return made(self._notes, topic, type_name, ros)

    def _pass_on(self) -> None:
        """Hand on what was taken in one turn in the order in which it happened: what one node reported on
        several topics would be handed on topic by topic else, and look as if it had come late.
        """
        self._taken.sort(key=_STAMP)
        self._waiting += self._taken
        self._taken.clear()
        self._turn_bytes = 0
        self._newest.clear()
        self._deliver()

    def _deliver(self) -> None:
        """Hand on what was taken, in its order, once the graph shows the names in it.

        DDS shows an endpoint before ROS 2 says whose it is, so the first messages of a new node may have to
        wait; not for long: they go without a name then.
        """
        waiting = self._waiting
        while waiting and not self._closed:
            first = waiting[0]
            nameless = first.observing.nameless(first.taken, first.data)
            if nameless and self._waits_for(nameless, first):
                if not self._retrying:
                    self._retrying = True
                    self._executor.after_real(_RETRY_S, self._retry)
                return
            waiting.popleft()
            observation = first.observing.observation(first.taken, first.data)
            if observation is not None:
                self._handler(observation)

    def _waits_for(self, nameless: tuple[bytes, ...], first: _Waiting) -> bool:
        """Whether ``first`` waits for the names of these."""
        now = time.monotonic()
        since_s = [self._nameless.setdefault(gid, now) for gid in nameless]
        if now >= max(since_s) + _NEVER_NAMED_S:
            return False
        self._not_complete_before(now + _MATCHED_S)
        joins = now < self._began_s + _DISCOVERY_S  # nobody judges yet what it receives
        return now < first.since_s + (_NEVER_NAMED_S if joins else _NAMELESS_S)

    def _retry(self) -> None:
        self._retrying = False
        self._deliver()

    def _note_silence(self) -> None:
        """Note since when calls on services are not shown: rcl and this transport publish events of them only
        at the ends where that is switched on.
        """
        now = time.monotonic()
        silent = {
            (service, node)
            for service, types in self._node.get_service_names_and_types()
            if matches(service, self._globs)
            and not types[0].startswith(_QUIET_PACKAGES)
            and self._node.count_services(service)
            for node in self._silent_ends(service)
        }
        known = self._silent_since
        self._silent_since = {end: known.get(end, now) for end in silent}
        services = {service for service, _ in silent}
        self._called = frozenset(filter(self._node.count_clients, services))

    def _silent_ends(self, service: str) -> set[str]:
        """The nodes that publish no events of ``service``, where a server and a client of it do not; ``""``:
        nobody does.
        """
        node = self._node
        events = node.count_publishers(service + EVENT_SUFFIX)
        if not events:
            return {""}
        if events >= node.count_services(service) + node.count_clients(service):
            return set()
        request = request_topic(service)
        shown = self._nodes_of(node.get_publishers_info_by_topic(service + EVENT_SUFFIX))
        servers = self._nodes_of(node.get_subscriptions_info_by_topic(request, no_mangle=True))
        clients = self._nodes_of(node.get_publishers_info_by_topic(request, no_mangle=True))
        if servers <= shown or clients <= shown:
            return set()
        return {name for _, name in (servers | clients) - shown}

    def _nodes_of(self, endpoints: Iterable[Any]) -> set[tuple[bytes, str]]:
        """The participant and the name of each node: one of this name may have been there before."""
        return {
            (native.participant_of(native.gid_of(endpoint)), self._graph.name_of(endpoint))
            for endpoint in endpoints
        }

    def _note_who_left(self) -> None:
        """Note which services are about to answer a client that is not there: rcl shows no answer then."""
        now = time.monotonic()
        self._left = {name: since for name, since in self._left.items() if since > now - _LEFT_S}
        unanswered = self._notes.unanswered
        for service in {service for service, _, _ in unanswered}:
            there = self._graph.clients_of(service)
            gone = [call for call in unanswered if call[0] == service and call[1] not in there]
            for call in gone:
                self._left[service] = now
                del unanswered[call]

    def _silent_services(self) -> list[str]:
        """Services whose calls cannot be observed, for people: not those that are just coming or going."""
        self._note_silence()
        limit = time.monotonic() - _SILENT_S
        silent = sorted(end for end, since in self._silent_since.copy().items() if since <= limit)
        return list(dict.fromkeys(_unseen(service) for service, _ in silent))


def _unseen(service: str) -> str:
    """What is said of a service whose calls cannot be observed."""
    action, is_part, _ = service.partition("/_action/")
    if is_part:
        return (
            f"goals of {action} are not received, its feedback and status are: ROS 2's own action "
            "servers and clients have no service introspection in Jazzy"
        )
    return f"calls on {service} are not received: it has no service introspection; {_HOW}"
