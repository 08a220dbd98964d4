"""Binding a machine to channels: what a generated ``node.py`` is made of.

Everything here runs on the transport's executor, so a handler is a run to completion.
"""

from __future__ import annotations

import itertools
import logging
import random
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import msgspec

from m2c.runtime.machine import EndlessLoopError
from m2c.runtime.ports import (
    ActionClientPort,
    ActionServerPort,
    ClientPort,
    GoalHandlers,
    Owner,
    OwnEventPort,
    PublisherPort,
    ServerPort,
)
from transports.interface import (
    Action,
    Message,
    Publisher,
    Request,
    Service,
    Timer,
    Topic,
    Transport,
)

__all__ = [
    "DEFAULT_SETTINGS",
    "Binding",
    "GoalHandlers",
    "HasLog",
    "HasParameters",
    "HasSteps",
    "NodeSettings",
]


class NodeSettings(msgspec.Struct, frozen=True):
    """How a node behaves towards the others.

    Attributes:
        call_timeout_s: bounds its own service calls.
        events_wait: what others wait for an answer to waits until a state takes it, instead of being
            discarded: requests, responses, goals, results, what a behaviour tree says. For nodes whose
            code is generated for a run in steps.
        random: where ``Math.random()`` and targets with a probability draw their numbers, 0 ≤ x < 1.
    """

    call_timeout_s: float = 5.0
    events_wait: bool = False
    random: Callable[[], float] = random.random


DEFAULT_SETTINGS = NodeSettings()


@runtime_checkable
class HasParameters(Protocol):
    """A transport on which whoever launches a node may set its numbers (ROS 2's parameters)."""

    def parameter(self, name: str, default: float, meaning: str) -> float:
        """The positive number called ``name``; TransportError if what was set is none."""
        ...

    def given(self, name: str, meaning: str) -> object:
        """What was set for ``name``: a bool, a number, a string or some of them; None if nothing was."""
        ...


@runtime_checkable
class HasLog(Protocol):
    """A transport that has a log of its own (ROS 2's ``/rosout``)."""

    def log_handler(self, level: int) -> logging.Handler:
        """What hands records to it."""
        ...


@runtime_checkable
class HasSteps(Protocol):
    """A transport on which machines take their steps in turn."""

    def post_step(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` once no message is due."""
        ...


class Binding:
    """One machine's channels on one transport."""

    def __init__(
        self, transport: Transport, name: str, settings: NodeSettings, state: Callable[[], str]
    ) -> None:
        self._transport = transport
        self._settings = settings
        self._state = state
        self._delays: dict[tuple[Callable[[str], object], str], Timer] = {}
        self._sends: dict[tuple[Callable[[str, Any], object], str], dict[int, Timer]] = {}
        """By machine and id those that have not left, each by its number."""
        self._numbers = itertools.count()
        self._faults: set[str] = set()
        self._untaken: list[Callable[[], object]] = []
        self._stepping: set[Callable[[], bool]] = set()
        self.log = logging.getLogger(name)

    @property
    def _owner(self) -> Owner:
        return Owner(self.log, self._state, self.fault)

    def publisher(self, topic: Topic, own: Callable[[Any], object] | None = None) -> Publisher:
        """A publisher of ``topic``; a message that the transport refuses is a fault of the model.

        Args:
            topic: where to publish.
            own: takes each message as an event of the node's own, after what it sent itself before.
        """
        port = PublisherPort(self._transport.publisher(topic), topic.name, self.fault)
        if own is None:
            return port
        guarded = self._guard(own)

        def again(message: Message) -> None:
            self._transport.post(lambda: guarded(message))

        return OwnEventPort(port, again)

    def subscribe(self, topic: Topic, handler: Callable[[Any], object]) -> None:
        """Hand every message of ``topic`` to ``handler``."""
        self._transport.subscribe(topic, self._guard(handler))

    def timer(self, rate_hz: float, handler: Callable[[], object], name: str) -> Timer:
        """Call ``handler`` ``rate_hz`` times a second, or as often as parameter ``rate_hz.<name>`` says."""
        if isinstance(self._transport, HasParameters):
            meaning = f"how often a second the timer {name} of the model fires"
            rate_hz = self._transport.parameter(f"rate_hz.{name}", rate_hz, meaning)
        return self._transport.every(1.0 / rate_hz, self._guard(handler))

    def server(self, service: Service, handler: Callable[[Any], bool] | None) -> ServerPort:
        """Serve ``service``; ``handler`` says whether the active state takes the request."""
        port = ServerPort(service.name, self._owner)
        guarded = self._guard(handler) if handler is not None else None

        def serve(request: Request) -> None:
            if guarded is not None and self._settings.events_wait:
                self.offer(lambda: port.handle(request, guarded))
            elif not port.handle(request, guarded):
                port.discard()

        self._transport.serve(service, serve)
        return port

    def client(
        self,
        service: Service,
        response: Callable[[Any], object] | None,
        error: Callable[[], bool] | None,
    ) -> ClientPort:
        """Call ``service``; ``error`` says whether the active state handles a failed call."""
        return ClientPort(
            self._transport.client(service),
            service.name,
            self._settings.call_timeout_s,
            self._offering(response) if response is not None else None,
            self._guard(error) if error is not None else None,
            self._owner,
        )

    def action_server(
        self,
        action: Action,
        goal: Callable[[Any, int], bool] | None,
        cancel: Callable[[int], object] | None,
    ) -> ActionServerPort:
        """Serve ``action``; goals are numbered from 1 in order of arrival."""
        port = ActionServerPort(action.name, self._owner)
        guarded_goal = self._offering(goal) if goal is not None else None
        guarded_cancel = self._guard(cancel) if cancel is not None else None
        self._transport.serve_action(
            action,
            lambda handle: port.handle_goal(handle, guarded_goal),
            lambda handle: port.handle_cancel(handle, guarded_cancel),
        )
        return port

    def action_client(self, action: Action, handlers: GoalHandlers) -> ActionClientPort:
        """Send goals of ``action``; ``handlers`` hear what becomes of them."""
        return ActionClientPort(
            self._transport.action_client(action),
            action.name,
            self._settings.call_timeout_s,
            msgspec.structs.replace(
                handlers,
                **{
                    field: (self._guard if field == "failed" else self._offering)(handler)
                    for field in handlers.__struct_fields__
                    if (handler := getattr(handlers, field)) is not None
                },
            ),
            self._owner,
        )

    def post(self, handler: Callable[[], object]) -> None:
        """Run ``handler`` as the next event."""
        self._transport.post(self._offering(handler))

    def take(self, handler: Callable[..., Any], *arguments: Any) -> Any:
        """Have the machine take an event now: what ``handler`` returns, True if it ended in a fault."""
        return self._guard(handler)(*arguments)

    def take_step(self, step: Callable[[], bool]) -> None:
        """Take ``step`` when it is this machine's turn, and again as long as it returns true."""
        if step in self._stepping:
            return
        self._stepping.add(step)
        guarded = self._guard(step)

        def take() -> None:
            self._stepping.discard(step)
            if guarded():
                self.take_step(step)

        transport = self._transport
        post = transport.post_step if isinstance(transport, HasSteps) else transport.post
        post(take)

    def offer(self, take: Callable[[], object]) -> None:
        """Have the machine take an event, now or as soon as a state does.

        Args:
            take: offers it; returns False if the state does not take it.
        """
        if self._guard(take)() is False:
            self._untaken.append(take)

    def _offer_again(self) -> None:
        """Offer what waits, in order of arrival, until something is taken: then the state may be another."""
        for place, take in enumerate(self._untaken):
            if self._guard(take)() is not False:
                del self._untaken[place]
                return

    def start_delay(self, name: str, delay_s: float, handler: Callable[[str], object]) -> None:
        """Start the delayed transition ``name`` of the machine, or the thread, that ``handler`` is of."""
        self.stop_delay(name, handler)
        guarded = self._guard(handler)

        def elapsed() -> None:
            self._delays.pop((handler, name), None)
            guarded(name)

        self._delays[handler, name] = self._transport.after(delay_s, elapsed)

    def stop_delay(self, name: str, handler: Callable[[str], object]) -> None:
        """Cancel the delayed transition ``name`` of the same one if it is waiting."""
        timer = self._delays.pop((handler, name), None)
        if timer is not None:
            timer.cancel()

    def send_self(
        self,
        event: str,
        data: Any,
        delay_s: float,
        send_id: str,
        handler: Callable[[str, Any], object],
    ) -> None:
        """Send ``event`` to ``handler``'s machine itself after ``delay_s``; ``send_id`` can cancel it."""
        guarded = self._guard(handler)
        if delay_s <= 0:
            self._transport.post(lambda: guarded(event, data))
            return
        if not send_id:
            self._transport.after(delay_s, lambda: guarded(event, data))
            return
        place, number = (handler, send_id), next(self._numbers)
        waiting = self._sends.setdefault(place, {})

        def due() -> None:
            waiting.pop(number, None)
            if not waiting and self._sends.get(place) is waiting:
                del self._sends[place]
            guarded(event, data)

        waiting[number] = self._transport.after(delay_s, due)

    def cancel_send(self, send_id: str, handler: Callable[[str, Any], object]) -> None:
        """Cancel the delayed sends with this id, of the same machine, that have not left."""
        for timer in self._sends.pop((handler, send_id), {}).values():
            timer.cancel()

    def say(self, label: str, text: str) -> None:
        """A ``<log>`` of the model."""
        self.log.info("%s%s", f"{label}: " if label else "", text)

    def fault(self, place: str, text: str) -> None:
        """Report a fault of the model (SCXML's ``error.execution``), the first time it occurs at a place.

        Args:
            place: the element whose block could not be executed, as ``Model.scxml:18:5``, or what else
                says where.
            text: what could not be done.
        """
        if place in self._faults:
            return
        self._faults.add(place)
        self.log.error("%s: %s (reported once; the machine goes on)", place, text)

    def _guard(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        """A fault of the model ends its macrostep, not the node; what waits is offered again after it."""

        def guarded(*arguments: Any) -> Any:
            try:
                taken = handler(*arguments)
            except EndlessLoopError as error:
                self.fault(f"state {error.state}", str(error))
                taken = error.taken
            if self._untaken and taken is not False:
                self._transport.post(self._offer_again)
            return taken

        return guarded

    def _offering(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        """The same; where events wait, what ``handler`` does not take is offered again later."""
        guarded = self._guard(handler)
        if not self._settings.events_wait:
            return guarded

        def offered(*arguments: Any) -> bool:
            self.offer(lambda: handler(*arguments))
            return True

        return offered
