"""The transport interface: what a middleware must offer so that generated nodes run on it.

A *channel* is a ROS-style absolute name (``/BatteryLevelSkill/tick``) with a type. Messages are
``msgspec.Struct`` instances; how they travel is the transport's business. All callbacks of one
transport instance run one at a time on its executor thread; a handler must not block.
``transports.conformance`` is the suite that holds an implementation to this page.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from enum import StrEnum
from typing import Any, NamedTuple, Protocol, Self, runtime_checkable

import msgspec

from transports.fields_read import FieldsRead

Message = msgspec.Struct
"""A typed message; its class carries ``__type_name__`` (e.g. ``std_msgs/msg/Int32``)."""


class TransportError(Exception):
    """The middleware cannot do what was asked; the text names the channel and what would be right."""


class UnreachableError(TransportError):
    """Nobody is where this process was to connect; somebody may come."""


class Reliability(StrEnum):
    """Whether the middleware may drop messages of a channel."""

    RELIABLE = "reliable"
    BEST_EFFORT = "best_effort"


class Topic(msgspec.Struct, frozen=True):
    """A named stream of messages. ``transient_local``: late subscribers get the last message."""

    name: str
    type_name: str
    message: type[Message]
    reliability: Reliability = Reliability.RELIABLE
    transient_local: bool = False


class Service(msgspec.Struct, frozen=True):
    """A named request/response channel."""

    name: str
    type_name: str
    request: type[Message]
    response: type[Message]


class Action(msgspec.Struct, frozen=True):
    """A long-running request, made of parts that are named as ROS 2 names them.

    Services ``<name>/_action/send_goal``, ``cancel_goal``, ``get_result``; topics ``feedback``,
    ``status``.
    """

    name: str
    type_name: str
    goal: type[Message]
    result: type[Message]
    feedback: type[Message]


class CallOutcome(StrEnum):
    """How a call ended: in exactly one of these ways."""

    RESPONSE = "response"
    REMOTE_ERROR = "remote_error"
    TIMEOUT = "timeout"
    UNAVAILABLE = "unavailable"


class CallResult(msgspec.Struct, frozen=True):
    """The end of a call. ``response`` is set for RESPONSE only; ``error`` explains the others."""

    outcome: CallOutcome
    response: Any = None
    error: str = ""


class GoalStatus(StrEnum):
    """How an action goal stands (action_msgs/msg/GoalStatus)."""

    ACCEPTED = "accepted"
    EXECUTING = "executing"
    CANCELING = "canceling"
    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"


class Publisher(Protocol):
    """Publishes one topic."""

    def publish(self, message: Message) -> None:
        """Send ``message``; returns without waiting for anybody."""
        ...


class Request(Protocol):
    """A request that this node serves. Exactly one of ``respond`` and ``fail`` ends it, any time."""

    @property
    def data(self) -> Any:
        """The decoded request message."""
        ...

    @property
    def client(self) -> str:
        """Who asks (node name)."""
        ...

    def respond(self, response: Message) -> None:
        """Answer. Answering twice raises TransportError."""
        ...

    def fail(self, error: str) -> None:
        """End the call with a remote error."""
        ...


class Client(Protocol):
    """Calls one service."""

    def call(
        self, request: Message, done: Callable[[CallResult], None], timeout_s: float = 5.0
    ) -> None:
        """Send ``request``; ``done`` gets the result on the executor thread, exactly once."""
        ...

    def call_and_wait(self, request: Message, timeout_s: float = 5.0) -> CallResult:
        """Send ``request`` and wait. For a thread that is not the executor's (the policy's)."""
        ...


class GoalHandle(Protocol):
    """The server's end of one goal."""

    @property
    def goal_id(self) -> str:
        """Unique id (32 hex digits, a UUID)."""
        ...

    @property
    def goal(self) -> Any:
        """The decoded goal message."""
        ...

    def accept(self) -> None:
        """Accept the goal; the client receives it."""
        ...

    def reject(self) -> None:
        """Reject the goal; nothing more may follow."""
        ...

    def publish_feedback(self, feedback: Message) -> None:
        """Send feedback to the client."""
        ...

    def succeed(self, result: Message) -> None:
        """End the goal: succeeded."""
        ...

    def abort(self, result: Message) -> None:
        """End the goal: aborted."""
        ...

    def canceled(self, result: Message) -> None:
        """End the goal: canceled, after a cancel request."""
        ...


class GoalEvents(msgspec.Struct, frozen=True):
    """What a client wants to receive of its goal; all run on the executor thread."""

    accepted: Callable[[str], None]
    """(goal_id)"""
    rejected: Callable[[str], None]
    """(goal_id)"""
    feedback: Callable[[str, Any], None]
    """(goal_id, feedback message)"""
    result: Callable[[str, GoalStatus, Any], None]
    """(goal_id, SUCCEEDED | ABORTED | CANCELED, result message)"""
    failed: Callable[[str, CallResult], None]
    """(goal_id, why): send_goal or get_result itself ended without a response"""


class ActionClient(Protocol):
    """Sends goals of one action."""

    def send_goal(self, goal: Message, events: GoalEvents, timeout_s: float = 5.0) -> str:
        """Send a goal and return its id; ``timeout_s`` bounds the goal response, not the result."""
        ...

    def cancel(self, goal_id: str) -> None:
        """Ask the server to cancel the goal."""
        ...


class Completion(Protocol):
    """A value that one thread waits for and the executor delivers (see ``Transport.completion``)."""

    def set(self, value: Any) -> None:
        """Deliver ``value``; only the first delivery counts."""
        ...

    def wait(self, timeout_s: float) -> Any:
        """The value, or None after ``timeout_s`` seconds of the transport's clock.

        For a thread that is not the executor's; under ``simulated`` it runs the world's events.
        """
        ...


class Timer(Protocol):
    """A running timer."""

    def cancel(self) -> None:
        """Stop it; idempotent."""
        ...


class ObservationKind(StrEnum):
    """What a tap can receive (service_msgs/msg/ServiceEventInfo has the four of services)."""

    MESSAGE = "message"
    MESSAGE_TAKEN = "message_taken"
    """A node begins to handle a message. Only numbered messages, and what is taken while a tap listens."""
    REQUEST_SENT = "request_sent"
    REQUEST_RECEIVED = "request_received"
    RESPONSE_SENT = "response_sent"
    RESPONSE_RECEIVED = "response_received"


CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
"""Of a topic on which a simulation publishes its time, whatever it is called."""
HERE = "here"
"""The clock of a connection's own host (``TellsClocks.clock_of``)."""
NAMELESS = "gid "
"""How a client without a name begins; what follows is its endpoint's identifier."""


REQUESTS = (ObservationKind.REQUEST_RECEIVED, ObservationKind.REQUEST_SENT)
RESPONSES = (ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED)
"""What both ends of a call report."""
CLIENT_END = (ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_RECEIVED)
SERVER_END = (ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT)
"""What each end of it does."""


class Observation(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One thing that happened, as a tap received it.

    Attributes:
        stamp_ns: when it happened, taken where it happened (ns since the epoch).
        received_ns: when the tap received it, on the tap's clock.
        channel: the topic or service.
        kind: what happened.
        type_name: of the message, e.g. ``std_msgs/msg/Int32`` or ``pkg/srv/Name_Request``.
        data: the message as plain maps, lists and scalars; None if contents are not known, or taken.
        source: the node that published this observation: of a message taken, the one that took it.
        sequence: counts from 0 per source and channel: a gap shows loss; -1 where not known. Messages taken
            are counted apart from messages.
        order: counts all that the source reports, on whatever channel, in the order in which it
            happened; -1 where not known. Without a gap, nothing older is still to come.
        client, call: for services, who calls and the number of its call. The client begins with ``NAMELESS``
            where only its endpoint is known: another end of the same call may know its name.
            For a message taken, the node that published it and the ``sequence`` that it has.
        life, client_life: which life of the source, and of the client, this is of: a node that is started
            again under its name has another, and numbers anew. 0 where the transport cannot say.
        error: for RESPONSE_* of a call that ended otherwise: ``remote_error: …``, ``timeout: …``.
    """

    stamp_ns: int
    received_ns: int
    channel: str
    kind: ObservationKind
    type_name: str
    data: Any
    source: str
    sequence: int = -1
    order: int = -1
    client: str = ""
    call: int = 0
    error: str = ""
    life: int = 0
    client_life: int = 0


class BlindSpotKind(StrEnum):
    """What a tap may not know."""

    NOT_RECEIVED = "not received"
    """What comes on a channel, as this process does not have its type, for instance; with a node, what that
    node does there in calls."""
    MAY_NOT_BE_TAKEN = "may not be taken"
    """What a node takes of a channel: it need not take all that is published there, or may take it late, as
    it asks for best effort, for instance."""
    OTHER_TIME = "other time"
    """How much time passes for a node: its timers follow another clock than the time of day, as that of a
    simulation; without a name, for any node."""


class BlindSpot(NamedTuple):
    """Something that a tap does not know."""

    kind: BlindSpotKind
    channel: str = ""
    node: str = ""


class Answer(msgspec.Struct, frozen=True):
    """Up to where a node has reported everything.

    All that it did until ``stamp_ns`` (its clock, ns since the epoch) has an ``order`` below ``next_order``,
    and was sent to taps before this answer.
    """

    stamp_ns: int
    next_order: int
    clock_ns: int = 0
    """What the node's clock shows as it answers (ns since the epoch); 0: it does not say. ``stamp_ns`` is of
    before, where the node is just doing something."""
    asked_ns: int = 0
    """When it was asked, on the clock of who asked (ns since the epoch), if it is recorded; else 0."""
    life: int = 0
    """The node's, as in :class:`Observation`; 0: that is not known."""


@runtime_checkable
class VirtualTime(Protocol):
    """A connection that is asked for a clock that nobody sets, too.

    Its time is not that of the computer, or it stands before another connection, which is asked.
    """

    def steady_ns(self) -> int:
        """Time (ns) of the same kind as ``now_ns``, which nobody sets, whatever that one shows."""
        ...


class Closes(Protocol):
    """Something that is closed, by hand or at the end of a ``with`` block."""

    def close(self) -> None:
        """Stop and release everything; idempotent."""
        ...

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close it, whatever was raised."""
        self.close()


class Tap(Closes, Protocol):
    """A passive listener. Observations arrive on the tap's executor in order of reception."""

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        """Ask ``node`` up to where it has reported everything; from any thread.

        ``answered`` is called once, on the tap's executor: with None if the node is not there or its name
        is contested, if no answer comes in ``within_s`` seconds, or if the transport cannot ask. What came
        before the answer has been handed to the tap's handler by then, unless it was dropped. No answer may
        come at all once the tap is closed.
        """
        ...

    @property
    def is_complete(self) -> bool:
        """Whether all that those publish who were there when it was opened reaches it by now."""
        ...

    def is_contested(self, name: str) -> bool:
        """Whether several nodes have claimed ``name`` of late: which of them an observation is from is not
        known then.
        """
        ...

    def take_dropped(self) -> Collection[tuple[str, str]]:
        """Channel and source of what this tap has dropped by itself since it was last asked, as it came
        faster than it was handled (source: empty where it is not known). Gaps in numbers show it later,
        or never.
        """
        ...

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        """What this tap does not know now, each with why."""
        ...

    def peers(self) -> Sequence[str]:
        """Names of the nodes this tap is linked to."""
        ...

    def problems(self) -> Sequence[str]:
        """What the tap cannot receive or could not decode, one sentence each (undecodable payloads,
        lost messages, peers that are known but not linked).
        """
        ...

    def close(self) -> None:
        """Stop listening; idempotent."""
        ...


class Transport(Closes, Protocol):
    """What a node needs of the middleware: its connection."""

    @property
    def node(self) -> str:
        """The node's name, unique in the system."""
        ...

    def now_ns(self) -> int:
        """The transport's clock, ns since the epoch (virtual under ``simulated``)."""
        ...

    def publisher(self, topic: Topic) -> Publisher:
        """Declare a publisher."""
        ...

    def subscribe(self, topic: Topic, handler: Callable[[Any], None]) -> None:
        """Call ``handler(message)`` for every message, in order per source."""
        ...

    def serve(self, service: Service, handler: Callable[[Request], None]) -> None:
        """Serve ``service``; the handler may keep the request and answer later."""
        ...

    def client(self, service: Service) -> Client:
        """A client of ``service``."""
        ...

    def serve_action(
        self,
        action: Action,
        goal: Callable[[GoalHandle], None],
        cancel: Callable[[GoalHandle], None],
    ) -> None:
        """Serve ``action``: ``goal`` receives new goals, ``cancel`` cancel requests of accepted ones."""
        ...

    def action_client(self, action: Action) -> ActionClient:
        """A client of ``action``."""
        ...

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` every ``period_s`` seconds, without drift."""
        ...

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once, ``delay_s`` seconds from now."""
        ...

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` on the executor thread; callable from any thread."""
        ...

    def completion(self) -> Completion:
        """A fresh completion, for the one caller that must wait (the policy's thread)."""
        ...

    def tick_complete(self) -> None:
        """Say that this node has made all calls of a round (a policy: of a tick), and pauses before the next.

        From any thread. A transport may have its nodes report to their taps now what they did, as nobody
        waits for them; it may as well do nothing.
        """

    def announce(self) -> None:
        """Say that this node has declared everything and is ready."""
        ...

    def spin(self, until: Callable[[], bool] | None = None) -> None:
        """Run the executor on the calling thread until ``close()`` (or until ``until()`` holds)."""
        ...

    def close(self) -> None:
        """Stop and release everything; idempotent, from any thread, and always ends ``spin``."""
        ...


class Listener(Closes, Protocol):
    """What one needs who listens to a system."""

    @property
    def node(self) -> str:
        """See ``Transport.node``."""
        ...

    def now_ns(self) -> int:
        """See ``Transport.now_ns``."""
        ...

    def publisher(self, topic: Topic) -> Publisher:
        """See ``Transport.publisher``."""
        ...

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.every``."""
        ...

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.after``."""
        ...

    def post(self, handler: Callable[[], None]) -> None:
        """See ``Transport.post``."""
        ...

    @property
    def repair_s(self) -> float:
        """How long what the middleware dropped while this process stood still may take to come after all (s).

        0 where all that was not received by then is lost, or comes late and in its order.
        """
        ...

    @property
    def reports_takes(self) -> bool:
        """Whether nodes report which messages they take, and can be asked how far they have reported."""
        ...

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` whenever a node announces itself or goes away."""
        ...

    def wait_for_nodes(self, names: Sequence[str], timeout_s: float) -> Sequence[str]:
        """Wait until all ``names`` are up (liveliness); returns those still missing at the end.

        A node counts as up after its ``announce()``.
        """
        ...

    def up_since(self, name: str) -> int:
        """When ``name`` began to connect: ns since the epoch, on its clock; 0 if that is not known.

        Known from when ``watch_nodes`` has reported that it is up. A node that is discovered late (its
        link came up late, or again) began before; one that was restarted began anew.
        """
        ...

    def tap(
        self,
        channels: Sequence[str],
        handler: Callable[[Observation], None],
    ) -> Tap:
        """Receive everything on channels that match one of the globs (empty: all), passively."""
        ...

    def close(self) -> None:
        """See ``Transport.close``."""
        ...


class Composer(Protocol):
    """A connection that other nodes of its process can share."""

    def beside(self, node: str) -> Connection:
        """Connect another node of this process, which shares with this one what a connection costs.

        It has a name, an executor and liveliness of its own, and ends with this node at the latest.

        Args:
            node: its name, unique in the system.

        Raises:
            TransportError: there can be no node of that name.
        """
        ...


class Connection(Transport, Listener, Composer, Protocol):
    """All that a transport offers: what ``connect`` returns."""


class TellsClocks(Protocol):
    """A connection whose nodes say on which host they are."""

    def clock_of(self, name: str) -> str:
        """By which host's clock ``name`` stamps; nodes of one host have one clock.

        Args:
            name: a node's; "": this connection's own.

        Returns:
            ``HERE``: that of this connection's host; else what tells the hosts apart; "" if it is not known.
            Known when ``up_since`` is.
        """
        ...


@runtime_checkable
class ReadsParts(Protocol):
    """A tap that need not make what nobody reads; one that always makes all is no such tap."""

    def read_only(self, fields: FieldsRead) -> None:
        """Its handler reads ``fields`` only, from now on; on the executor, or before it spins.

        Of a sequence of which nothing is read the beginning is enough: ``fields_read.UNREAD_KEPT`` elements.
        """
        ...


@runtime_checkable
class LinksByChannel(Protocol):
    """What a connection has, too, whose channels are linked to taps one by one, after it has declared them.

    With others, whoever listens when a node connects receives all that it sends.
    """

    def when_observed(self, by: str, nodes: Collection[str], handler: Callable[[], None]) -> None:
        """Call ``handler`` once, when taps receive all that this node publishes and does in calls.

        Args:
            by: the node whose taps these are; one that is not there may still come.
            nodes: that one must have been told, too, that these are up (``Listener.watch_nodes``).
            handler: called on some thread, whether the executor runs or not; it must not block.
        """
        ...


@runtime_checkable
class Namespaces(Protocol):
    """What a transport has, too, that can listen to the systems of many namespaces over one connection.

    The connection itself has no namespace then.
    """

    def watch_namespaces(self, pattern: str, handler: Callable[[str, bool], None]) -> None:
        """``handler(namespace, up)`` whenever somebody is at work in a namespace, or nobody is up any more.

        At work is a node that is up and answers, or one that publishes: names alone are not reported.

        Args:
            pattern: the namespaces, ``/`` between their parts; ``*`` stands for anything within one part.
            handler: called on the executor.
        """
        ...

    def within(self, namespace: str, failed: Callable[[Exception], None]) -> Listener:
        """A listener to the system in ``namespace``, which shares this connection and its executor.

        What comes for it waits apart from what comes for others. Closing it ends nothing else.

        Args:
            namespace: as ``watch_namespaces`` reports it.
            failed: called once, on the executor, with what a handler of this listener raised; none of its
                handlers is called any more then. An OSError is not caught: it is of who writes.
        """
        ...


class TransportFactory(Protocol):
    """What an entry point of group ``m2c.transports`` names.

    ``options`` are transport-specific strings (``endpoint``, ``config``, ``namespace``…); unknown
    ones raise TransportError.
    """

    def __call__(self, node: str, options: Mapping[str, str]) -> Connection:
        """Connect the node called ``node``."""
        ...
