"""Plain events between machines: ``<send event="x">`` names no channel, and travels on a topic of its own.

A machine is read by itself, and takes such an event for its own. Once all machines of a system are known,
the events that concern others become messages: senders publish, and transitions take what is received.
What follows (checks, generated code, taps, the oracle) knows topics only.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.macrostep import ERROR_EXECUTION, prefix_of
from m2c.model.binding import means_channel
from m2c.model.event_types import PACKAGE, define_types, type_names
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    CHANNEL_KINDS,
    Dialect,
    Emit,
    Event,
    EventKind,
    Field,
    Interface,
    InterfaceKind,
    Machine,
    OutputKind,
    Raise,
    State,
    Statement,
    Transition,
)
from m2c.model.walk import changed, statements_of, with_event_name

_TOPIC = CHANNEL_KINDS[InterfaceKind.PUBLISHER]
_PARAM = re.compile(r"[A-Za-z]\w*", re.ASCII)
"""What a field of a message can be called."""


def channel_of(event: str) -> str:
    """The topic on which the plain event ``event`` travels: ``/plain_events/nav/done`` for ``nav.done``."""
    return f"/{PACKAGE}/{event.replace('.', '/')}"


def link_events(
    machines: Sequence[Machine], library: InterfaceLibrary, log: DiagnosticLog
) -> tuple[Machine, ...]:
    """The same machines, with the plain events that concern others than their sender as messages.

    An event that only one machine sends and only the same machine takes stays its own, as does one that
    a machine sends itself with a delay. Machines that were linked before may be among them.

    Args:
        machines: all machines of a system, nodes and plugins.
        library: gets the types of the events (:func:`m2c.model.event_types.define_types`).
        log: where faults go: ``unsupported-event``, ``bad-name``, ``duplicate-interface``, and those of the
            types.
    """
    uses = [_Use(machine) for machine in machines]
    threads = [_Use(item.machine) for machine in machines for item in machine.threads]
    shared = _shared(uses, threads)
    _report_delays(uses, threads, log)
    if not shared:
        return tuple(machines)
    _report_threads(threads, shared, log)
    _report_names((*uses, *threads), shared, log)
    _report_taken_channels(machines, shared, log)
    known = {event: name for use in uses for event, name in use.linked.items()}
    types = type_names(shared, known, library.structures)
    linked = tuple(
        _Linker(machine, types, _own(use, uses, threads), log).linked()
        for machine, use in zip(machines, uses, strict=True)
    )
    owners = [owner for item in linked for owner in (item, *(t.machine for t in item.threads))]
    define_types(owners, types, library, log)
    return linked


class _Use:
    """What one machine, or action thread, does with plain events.

    Attributes:
        linked: those that are messages to it already, and their types.
        sends: those it sends at once, as messages or not, each with its first place.
        delayed: its sends with a delay.
        raises: every event that it queues for itself, if no other machine has a transition for it.
        takes: the descriptors of its transitions, each with its first place.
    """

    def __init__(self, owner: Machine) -> None:
        self.linked = {item.event: item.type_name for item in owner.interfaces if item.event}
        self.sends: dict[str, Position] = {}
        self.delayed: list[Raise] = []
        self.raises: set[str] = set()
        self.takes: dict[str, Position] = {}
        self._hears = {
            item.event for item in owner.interfaces if item.kind is InterfaceKind.SUBSCRIBER
        }
        published = {
            item.name: item.event
            for item in owner.interfaces
            if item.event and item.kind is InterfaceKind.PUBLISHER
        }
        for item in statements_of(owner):
            if isinstance(item, Raise):
                self.raises.add(item.event)
                if _goes_out(item, owner):
                    self.sends.setdefault(item.event, item.position)
                elif item.external and item.delay_s is not None:
                    self.delayed.append(item)
            elif isinstance(item, Emit) and item.interface in published:
                self.sends.setdefault(published[item.interface], item.position)
        for event, position in _descriptors(owner):
            self.takes.setdefault(event, position)
        self._tokens = frozenset(map(prefix_of, self.takes))

    def does_take(self, event: str) -> bool:
        """Whether a transition is for ``event``."""
        return event in self._hears or any(name in self._tokens for name in _descriptors_of(event))


def _descriptors(owner: Machine) -> Iterator[tuple[str, Position]]:
    for state in owner.states:
        for item in state.transitions:
            if item.event is not None and item.event.kind is EventKind.INTERNAL:
                yield item.event.name, item.position


def _descriptors_of(event: str) -> Iterator[str]:
    """The descriptors that are for ``event``, in their shortest spelling (W3C SCXML, section 3.12.1)."""
    tokens = event.split(".")
    for count in range(len(tokens) + 1):
        yield ".".join(tokens[:count])


def _by_descriptor(events: Iterable[str]) -> dict[str, list[str]]:
    """Those of ``events`` that each descriptor is for; some it is for, if it is there."""
    found: dict[str, list[str]] = {}
    for event in events:
        for descriptor in _descriptors_of(event):
            found.setdefault(descriptor, []).append(event)
    return found


def _goes_out(item: Raise, owner: Machine) -> bool:
    """Whether ``item`` is sent, at once, to whoever takes it; plain SCXML has events that mean channels."""
    is_plain = owner.dialect is Dialect.SCXML
    return item.external and item.delay_s is None and not (is_plain and means_channel(item.event))


def _shared(uses: Sequence[_Use], threads: Iterable[_Use]) -> list[str]:
    """The events that are messages, those already linked first."""
    found = dict.fromkeys(event for use in uses for event in use.linked)
    for event in dict.fromkeys(event for use in uses for event in use.sends):
        senders = [use for use in uses if event in use.sends]
        if len(senders) != 1 or senders != [use for use in uses if use.does_take(event)]:
            found[event] = None
    for use in threads:  # what a thread sends and takes is its own
        found.update((event, None) for event in use.sends if not use.does_take(event))
    return list(found)


def _own(use: _Use, uses: Iterable[_Use], threads: Iterable[_Use]) -> frozenset[str]:
    """The events that ``use`` alone sends, and takes: their order is that in which it sends them."""
    of_others = {event for it in uses if it is not use for event in it.sends}
    of_others.update(event for it in threads for event in it.sends if not it.does_take(event))
    return frozenset(
        event for event in use.sends if event not in of_others and use.does_take(event)
    )


def _report_delays(uses: Sequence[_Use], threads: Sequence[_Use], log: DiagnosticLog) -> None:
    """``unsupported-event``: others have a transition for an event that is sent with a delay."""
    for use in (*uses, *threads):
        for sent in use.delayed:
            if not use.does_take(sent.event) and any(it.does_take(sent.event) for it in uses):
                what = f"`{sent.event}` goes to other machines, and is sent with a delay"
                hint = "delay an event of the machine's own, and send this one when that is taken"
                log.error("unsupported-event", sent.position, "send", what, hint)


def _report_threads(threads: Iterable[_Use], shared: Sequence[str], log: DiagnosticLog) -> None:
    """``unsupported-event``: an action thread has a transition for an event that only others send."""
    of_others = _by_descriptor(shared)
    for use in threads:
        own = _by_descriptor((*use.raises, ERROR_EXECUTION))
        for descriptor, position in use.takes.items():
            tokens = prefix_of(descriptor)
            if tokens in of_others and tokens not in own:
                what = f"an action thread takes `{of_others[tokens][0]}`, which other machines send"
                hint = "take it in the machine around the thread"
                log.error("unsupported-event", position, "transition", what, hint)


def _report_names(uses: Iterable[_Use], shared: Sequence[str], log: DiagnosticLog) -> None:
    """``bad-name``: an event has a slash, by which names of topics are divided as events are by dots."""
    reported: set[str] = set()
    for use in uses:
        for event, position in use.sends.items():
            if event in shared and "/" in event and event not in reported:
                reported.add(event)
                what = f"an event of several machines cannot be called `{event}`"
                hint = f"write `{event.replace('/', '_')}`"
                log.error("bad-name", position, "send", what, hint)


def _report_taken_channels(
    machines: Iterable[Machine], shared: Sequence[str], log: DiagnosticLog
) -> None:
    """``duplicate-interface``: a model declares the topic of a plain event itself."""
    channels = {channel_of(event): event for event in shared}
    for machine in machines:
        for item in machine.interfaces:
            event = channels.get(item.channel or "")
            if event and not item.event and CHANNEL_KINDS.get(item.kind) == _TOPIC:
                what = f"{item.channel} is the topic of the plain event `{event}`"
                hint = "send and take the event, or give the topic another name"
                log.error("duplicate-interface", item.position, "", what, hint)


class _Linker:
    """Makes messages of the shared events of one machine.

    Args:
        machine: its states and interfaces are changed.
        types: of all shared events, by event.
        own: those that it alone sends, and takes.
        log: where faults go.
    """

    def __init__(
        self, machine: Machine, types: Mapping[str, str], own: Collection[str], log: DiagnosticLog
    ) -> None:
        self._machine = msgspec.structs.replace(
            machine, interfaces=tuple(_owned(item, own) for item in machine.interfaces)
        )
        self._types = types
        self._own = own
        self._events = _by_descriptor(types)
        self._log = log
        self._added: dict[tuple[InterfaceKind, str], Interface] = {}

    def linked(self) -> Machine:
        """The machine, with its action threads."""
        own = self._states(self._machine, takes=True)
        states = [self._states(item.machine, takes=False) for item in self._machine.threads]
        known = {(item.kind, item.name) for item in self._machine.interfaces}
        added = [item for key, item in self._added.items() if key not in known]
        return msgspec.structs.replace(
            _with(self._machine, own, added),
            threads=tuple(
                msgspec.structs.replace(item, machine=_with(item.machine, made, added))
                for item, made in zip(self._machine.threads, states, strict=True)
            ),
        )

    def _states(self, owner: Machine, takes: bool) -> tuple[State, ...]:
        use = _Use(owner)

        def sent(statement: Statement) -> Statement:
            if not isinstance(statement, Raise) or not _goes_out(statement, owner):
                return statement
            if statement.event not in self._types or (not takes and use.does_take(statement.event)):
                return statement
            return Emit(
                kind=OutputKind.PUBLISH,
                interface=self._interface(
                    InterfaceKind.PUBLISHER, statement.event, statement.position
                ),
                position=statement.position,
                fields=tuple(filter(self._can_be_field, statement.fields)),
            )

        states = tuple(changed(state, sent) for state in owner.states)
        if not takes:
            return states
        lowered = msgspec.structs.replace(owner, states=states)
        kept = _by_descriptor((ERROR_EXECUTION, *_Use(lowered).raises))
        return tuple(
            msgspec.structs.replace(state, transitions=tuple(self._transitions(state, kept)))
            for state in states
        )

    def _can_be_field(self, param: Field) -> bool:
        if _PARAM.fullmatch(param.name) is None:
            what = f"no field of a message can be called `{param.name}`"
            hint = "write letters, digits and underscores"
            self._log.error("bad-name", param.position, "param", what, hint)
            return False
        return True

    def _transitions(self, state: State, kept: Mapping[str, list[str]]) -> Iterator[Transition]:
        """The transitions of ``state``; ``kept``: the events that the machine queues for itself."""
        before = {(item.event, item.position) for item in state.transitions}
        for item in state.transitions:
            event = item.event
            if event is None or event.kind is not EventKind.INTERNAL:
                yield item
                continue
            found = self._events.get(prefix_of(event.name), [])
            for name in found:
                heard = self._interface(InterfaceKind.SUBSCRIBER, name, item.position)
                message = Event(EventKind.MESSAGE, heard)
                if (message, item.position) not in before:
                    yield msgspec.structs.replace(with_event_name(item, name), event=message)
            if not found or prefix_of(event.name) in kept:
                yield item

    def _interface(self, kind: InterfaceKind, event: str, position: Position) -> str:
        channel = channel_of(event)
        made = Interface(
            kind=kind,
            name=channel,
            position=position,
            channel=channel,
            type_name=self._types[event],
            event=event,
        )
        made = _owned(made, self._own)
        return self._added.setdefault((kind, channel), made).name


def _owned(interface: Interface, own: Collection[str]) -> Interface:
    """``interface``, of which it is said whether the machine alone publishes on it."""
    is_own = interface.kind is InterfaceKind.SUBSCRIBER and interface.event in own
    return msgspec.structs.replace(interface, own=is_own)


def _with(machine: Machine, states: tuple[State, ...], added: Iterable[Interface]) -> Machine:
    return msgspec.structs.replace(machine, states=states, interfaces=(*machine.interfaces, *added))
