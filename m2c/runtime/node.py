"""A node that is written by hand, on the same interfaces and transports as generated ones."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from inspect import signature
from typing import Any, Generic, Protocol, TypeVar

import msgspec

from m2c.runtime.binding import DEFAULT_SETTINGS, NodeSettings
from m2c.runtime.messages import ActionType, ServiceType
from m2c.runtime.slow_handlers import SlowHandlers
from m2c.suggestions import meant_channel
from transports.interface import (
    Action,
    ActionClient,
    CallOutcome,
    CallResult,
    Connection,
    GoalEvents,
    GoalHandle,
    Reliability,
    Service,
    Timer,
    Topic,
)

Sent_contra = TypeVar("Sent_contra", bound=msgspec.Struct, contravariant=True)
Sent = TypeVar("Sent", bound=msgspec.Struct)
Received = TypeVar("Received", bound=msgspec.Struct)
Asked = TypeVar("Asked", bound=msgspec.Struct)
Answered = TypeVar("Answered", bound=msgspec.Struct)
Goal = TypeVar("Goal", bound=msgspec.Struct)
Result = TypeVar("Result", bound=msgspec.Struct)
Feedback = TypeVar("Feedback", bound=msgspec.Struct)


class Publisher(Protocol[Sent_contra]):
    """Publishes messages of one class."""

    def publish(self, message: Sent_contra) -> None:
        """Send ``message``; returns without waiting for anybody."""
        ...


class Call(Generic[Asked, Answered]):
    """A request that a node serves: ``data`` is what is asked, ``client`` the node that asks."""

    def __init__(self, request: Any) -> None:
        self._request = request
        self.data: Asked = request.data
        self.client: str = request.client

    def respond(self, response: Answered) -> None:
        """Answer, at any time; answering twice raises TransportError."""
        self._request.respond(response)

    def fail(self, error: str) -> None:
        """End the call with an error, which its client receives."""
        self._request.fail(error)


class Client(Generic[Asked, Answered]):
    """Calls one service."""

    def __init__(self, node: Node, service: Service) -> None:
        self._node = node
        self._channel = service.name
        self._client = node.connection.client(service)

    def call(
        self,
        request: Asked,
        done: Callable[[Answered], None],
        failed: Callable[[CallResult], None] | None = None,
        timeout_s: float | None = None,
    ) -> None:
        """Send ``request``; returns at once.

        Args:
            request: what is asked.
            done: called with the response.
            failed: called if the call ends otherwise; that is logged by default.
            timeout_s: how long the response may take (s); by default as the node was started with.
        """
        watched = self._node._watched
        handle, handle_failure = watched(done), None if failed is None else watched(failed)

        def ended(result: CallResult) -> None:
            if result.outcome is CallOutcome.RESPONSE:
                handle(result.response)
            elif handle_failure is not None:
                handle_failure(result)
            else:
                self._node.log.warning("%s: %s: %s", self._channel, result.outcome, result.error)

        within_s = self._node.settings.call_timeout_s if timeout_s is None else timeout_s
        self._client.call(request, ended, within_s)


class _WatchedActionClient(ActionClient):
    """Sends goals by ``client``, the handlers of whose events are ``watched``."""

    def __init__(self, client: ActionClient, watched: Callable[[Any], Any]) -> None:
        self._client = client
        self._watched = watched

    def cancel(self, goal_id: str) -> None:
        """As ``ActionClient.cancel``."""
        self._client.cancel(goal_id)

    def send_goal(self, goal: Any, events: GoalEvents, timeout_s: float = 5.0) -> str:
        """As ``ActionClient.send_goal``."""
        handlers = msgspec.structs.asdict(events)
        watched = GoalEvents(**{name: self._watched(handlers[name]) for name in handlers})
        return self._client.send_goal(goal, watched, timeout_s)


class Node:
    """A node that is written by hand: inherit from it, and declare its channels in :meth:`setup`.

    Handlers run one at a time and must not block: one that runs for a second is logged. Messages are of the
    classes that ``m2c interfaces python`` writes. What a handler raises ends the node.

    Args:
        connection: on any transport; :func:`m2c.run_node` makes one from the command line.
        settings: how it behaves towards others.

    Attributes:
        connection: the same.
        settings: the same; ``settings.random()`` draws numbers that a simulated run repeats.
        log: the node's log.
        channels: the names of those that it has declared.
    """

    def __init_subclass__(cls, **given: Any) -> None:
        """Refuse an ``__init__`` that cannot be given a connection and settings."""
        super().__init_subclass__(**given)
        try:
            signature(cls.__init__).bind(None, None, None)
        except TypeError:
            what = f"{cls.__name__}.__init__ is given a connection and settings"
            raise TypeError(f"{what}; declare channels in `def setup(self)` instead") from None

    def __init__(self, connection: Connection, settings: NodeSettings = DEFAULT_SETTINGS) -> None:
        self.connection = connection
        self.settings = settings
        self.log = logging.getLogger(connection.node)
        self.channels: set[str] = set()
        self._watched = SlowHandlers(self.log).watched
        self.setup()

    @property
    def name(self) -> str:
        """The node's name, unique in the system."""
        return self.connection.node

    def now_ns(self) -> int:
        """The transport's clock, ns since the epoch (virtual where the run is simulated)."""
        return self.connection.now_ns()

    def setup(self) -> None:
        """Declare publishers, subscriptions, services, clients and timers. Nothing can be sent yet."""

    def start(self) -> None:
        """The node begins: called once, when all that observe it are linked."""

    def create_publisher(
        self,
        message: type[Sent],
        channel: str,
        *,
        best_effort: bool = False,
        transient_local: bool = False,
    ) -> Publisher[Sent]:
        """A publisher.

        Args:
            message: the class of its messages.
            channel: the topic, ``/scan``.
            best_effort: messages may be dropped.
            transient_local: late subscribers get the last message.

        Raises:
            TransportError: the transport refuses the channel or the type.
        """
        return self.connection.publisher(
            self._topic(message, channel, best_effort, transient_local)
        )

    def create_subscription(
        self,
        message: type[Received],
        channel: str,
        handler: Callable[[Received], None],
        *,
        best_effort: bool = False,
        transient_local: bool = False,
    ) -> None:
        """Have ``handler`` called with each message of ``channel``, in order per publisher.

        Args:
            message: the class of its messages.
            channel: the topic.
            handler: called with each message.
            best_effort: as of the publishers.
            transient_local: receive the last message of before.

        Raises:
            TransportError: the transport refuses the channel or the type.
        """
        topic = self._topic(message, channel, best_effort, transient_local)
        self.connection.subscribe(topic, self._watched(handler))

    def create_service(
        self,
        service: ServiceType[Asked, Answered],
        channel: str,
        handler: Callable[[Call[Asked, Answered]], Answered | None],
    ) -> None:
        """Serve ``channel``.

        Args:
            service: the type, as in the module of messages.
            channel: the service.
            handler: returns the response, or None if it, or a later handler, calls ``respond`` or ``fail``.

        Raises:
            TransportError: the transport refuses the channel or the type.
        """
        handle = self._watched(handler)

        def serve(request: Any) -> None:
            response = handle(Call(request))
            if response is not None:
                request.respond(response)

        self.connection.serve(self._service(service, channel), serve)

    def create_client(
        self, service: ServiceType[Asked, Answered], channel: str
    ) -> Client[Asked, Answered]:
        """A client of ``channel``.

        Args:
            service: the type, as in the module of messages.
            channel: the service.

        Raises:
            TransportError: the transport refuses the channel or the type.
        """
        return Client(self, self._service(service, channel))

    def create_action_server(
        self,
        action: ActionType[Goal, Result, Feedback],
        channel: str,
        goal: Callable[[GoalHandle], None],
        cancel: Callable[[GoalHandle], None],
    ) -> None:
        """Serve the action ``channel``.

        Args:
            action: the type, as in the module of messages.
            channel: the action.
            goal: is handed each new goal, and accepts or rejects it.
            cancel: is handed an accepted goal whose client asks to cancel it.

        Raises:
            TransportError: the transport refuses the channel or the type.
        """
        watched = self._watched
        self.connection.serve_action(self._action(action, channel), watched(goal), watched(cancel))

    def create_action_client(
        self, action: ActionType[Goal, Result, Feedback], channel: str
    ) -> ActionClient:
        """A client of the action ``channel``.

        Args:
            action: the type, as in the module of messages.
            channel: the action.

        Raises:
            TransportError: the transport refuses the channel or the type.
        """
        client = self.connection.action_client(self._action(action, channel))
        return _WatchedActionClient(client, self._watched)

    def create_timer(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Have ``handler`` called every ``period_s`` seconds, without drift; the timer can be cancelled."""
        return self.connection.every(period_s, self._watched(handler))

    def post(self, handler: Callable[[], None]) -> None:
        """Have ``handler`` called as the next one; from any thread, such as one that waits for a device."""
        self.connection.post(self._watched(handler))

    def _topic(
        self, message: type[Any], channel: str, best_effort: bool, transient_local: bool
    ) -> Topic:
        name = self._part(message, "__type_name__", channel, "the class of a message, as Point")
        reliability = Reliability.BEST_EFFORT if best_effort else Reliability.RELIABLE
        return Topic(channel, name, message, reliability, transient_local)

    def _service(self, service: ServiceType[Any, Any], channel: str) -> Service:
        asked = self._part(service, "Request", channel, "the type of a service, as PlanPath")
        return Service(channel, service.type_name, asked, service.Response)

    def _action(self, action: ActionType[Any, Any, Any], channel: str) -> Action:
        goal = self._part(action, "Goal", channel, "the type of an action, as Drive")
        return Action(channel, action.type_name, goal, action.Result, action.Feedback)

    def _part(self, given: Any, attribute: str, channel: str, wanted: str) -> Any:
        """What ``given``, of ``channel``, has as a type of its kind; TypeError if it is of another kind."""
        self.channels.add(channel)
        try:
            return getattr(given, attribute)
        except AttributeError:
            shown = getattr(given, "type_name", None) or getattr(given, "__type_name__", None)
            what = f"{channel}: {shown or repr(given)} is not {wanted}"
            raise TypeError(f"{what} of the module that `m2c interfaces python` writes") from None


def warn_of_slips(node: object, known: Collection[str]) -> None:
    """Warn of each channel of a node written by hand that is, but for a slip, one of the models'.

    Args:
        node: any node; of generated ones, ``m2c check`` says it.
        known: the channels that the system's models name.
    """
    if not isinstance(node, Node):
        return
    for channel in sorted(node.channels):
        if meant := meant_channel(channel, known):
            node.log.warning("no model names %s; did you mean %s?", channel, meant)
