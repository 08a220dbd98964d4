"""Plain events between machines: ``<send event="x">`` names no channel, and travels on a topic of its own.

A machine is read by itself, and takes such an event for its own. Once all machines of a system are known,
the events that concern others become messages: senders publish, and transitions take what is received.
What follows (checks, generated code, taps, the oracle) knows topics only.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

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
from m2c.model.nesting import with_written
from m2c.model.walk import changed, statements_of, with_event_name, with_threads
from m2c.suggestions import nearest

_TOPIC = CHANNEL_KINDS[InterfaceKind.PUBLISHER]
_PARAM = re.compile(r"[A-Za-z]\w*", re.ASCII)
"""What a field of a message can be called."""


class Address(NamedTuple):
    """A plain event, and the one machine that it is sent to; "": every machine that takes it."""

    event: str
    target: str = ""


def channel_of(address: Address) -> str:
    """The topic on which a plain event travels: ``/plain_events/nav/done`` for ``nav.done``.

    What is sent to one machine has a topic of its own: ``/plain_events_to/Base/nav/done``.
    """
    path = address.event.replace(".", "/")
    return f"/{PACKAGE}_to/{address.target}/{path}" if address.target else f"/{PACKAGE}/{path}"


def link_events(
    machines: Sequence[Machine], library: InterfaceLibrary, log: DiagnosticLog
) -> tuple[Machine, ...]:
    """The same machines, with the plain events that concern others than their sender as messages.

    An event that only one machine sends and only the same machine takes stays its own, as does one that
    a machine sends itself, by its name or with a delay. Machines that were linked before may be among them.

    Args:
        machines: all machines of a system, nodes and plugins.
        library: gets the types of the events (:func:`m2c.model.event_types.define_types`).
        log: where faults go: ``unsupported-event``, ``bad-name``, ``duplicate-interface``, those of the
            types, and the warning ``unknown-machine``.
    """
    uses = [_Use(machine, machine) for machine in machines]
    threads = [_Use(item.machine, machine) for machine in machines for item in machine.threads]
    shared = _shared(uses, threads)
    _report_delays(uses, threads, log)
    if not shared:
        return tuple(machines)
    _report_threads(threads, shared, log)
    _report_names((*uses, *threads), shared, log)
    _report_targets((*uses, *threads), machines, log)
    _report_taken_channels(machines, shared, log)
    known = {address.event: name for use in uses for address, name in use.linked.items()}
    types = type_names((address.event for address in shared), known, library.structures)
    linked = tuple(
        _Linker(machine, types, shared, _own(use, uses, threads), log).linked()
        for machine, use in zip(machines, uses, strict=True)
    )
    owners = [owner for item in linked for owner in with_threads(item)]
    define_types(owners, types, library, log)
    return linked


class _Use:
    """What a machine, or an action thread of it, does with plain events.

    Attributes:
        machine: the name of the machine.
        linked: those that are messages to it already, and their types.
        sends: those it sends at once, as messages or not, each with its first place.
        delayed: its sends with a delay.
        raises: every event that it queues for itself, if no other machine has a transition for it.
        takes: the descriptors of its transitions, each with its first place.
    """

    def __init__(self, owner: Machine, machine: Machine) -> None:
        self.machine = machine.name
        self.linked = {_address_of(it): it.type_name for it in owner.interfaces if it.event}
        self.sends: dict[Address, Position] = {}
        self.delayed: list[Raise] = []
        self.raises: set[str] = set()
        self.takes: dict[str, Position] = {}
        ends = [it for it in owner.interfaces if it.event]
        self._hears = {_address_of(it) for it in ends if it.kind is InterfaceKind.SUBSCRIBER}
        published = {it.name: _address_of(it) for it in ends if it.kind is InterfaceKind.PUBLISHER}
        for item in statements_of(owner):
            if isinstance(item, Raise):
                self.raises.add(item.event)
                if _goes_out(item, owner):
                    self.sends.setdefault(Address(item.event, item.target), item.position)
                elif item.external and item.delay_s is not None:
                    self.delayed.append(item)
            elif isinstance(item, Emit) and item.interface in published:
                self.sends.setdefault(published[item.interface], item.position)
        for event, position in _descriptors(owner):
            self.takes.setdefault(event, position)
        self._tokens = frozenset(map(prefix_of, self.takes))

    def does_take(self, address: Address) -> bool:
        """Whether a transition is for ``address``."""
        if address.target not in ("", self.machine):
            return False
        names = _descriptors_of(address.event)
        return address in self._hears or any(name in self._tokens for name in names)


def _address_of(interface: Interface) -> Address:
    return Address(interface.event, interface.target)


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


def _by_descriptor(addresses: Iterable[Address]) -> dict[str, list[Address]]:
    """Those of ``addresses`` that each descriptor is for; some it is for, if it is there."""
    found: dict[str, list[Address]] = {}
    for address in addresses:
        for descriptor in _descriptors_of(address.event):
            found.setdefault(descriptor, []).append(address)
    return found


def _goes_out(item: Raise, owner: Machine) -> bool:
    """Whether ``item`` is sent, at once, to others than ``owner``, or to whoever takes it.

    Plain SCXML has events that mean channels.
    """
    is_plain = owner.dialect is Dialect.SCXML
    if not item.external or item.delay_s is not None or item.target == owner.name:
        return False
    return not (is_plain and means_channel(item.event))


def _shared(uses: Sequence[_Use], threads: Iterable[_Use]) -> list[Address]:
    """The events that are messages, those already linked first."""
    found = dict.fromkeys(address for use in uses for address in use.linked)
    for address in dict.fromkeys(address for use in uses for address in use.sends):
        senders = [use for use in uses if address in use.sends]
        if len(senders) != 1 or senders != [use for use in uses if use.does_take(address)]:
            found[address] = None
    for use in threads:  # what a thread sends and takes is its own
        found.update((address, None) for address in use.sends if _leaves_thread(address, use))
    return list(found)


def _leaves_thread(address: Address, thread: _Use) -> bool:
    """Whether what ``thread`` sends is for others: what has no target, and it takes, is its own."""
    return bool(address.target) or not thread.does_take(address)


def _own(use: _Use, uses: Iterable[_Use], threads: Iterable[_Use]) -> frozenset[str]:
    """The events that ``use`` alone sends, and takes: their order is that in which it sends them."""
    of_others = {address for it in uses if it is not use for address in it.sends}
    of_others.update(a for it in threads for a in it.sends if _leaves_thread(a, it))
    mine = (a for a in use.sends if not a.target and a not in of_others)
    return frozenset(address.event for address in mine if use.does_take(address))


def _report_delays(uses: Sequence[_Use], threads: Sequence[_Use], log: DiagnosticLog) -> None:
    """``unsupported-event``: an event is sent with a delay that another machine is to take."""
    for use in (*uses, *threads):
        for sent in use.delayed:
            address = Address(sent.event, sent.target)
            is_for_other = sent.target not in ("", use.machine)
            if is_for_other or (
                not use.does_take(address) and any(it.does_take(address) for it in uses)
            ):
                what = f"`{sent.event}` goes to other machines, and is sent with a delay"
                hint = "delay an event of the machine's own, and send this one when that is taken"
                log.error("unsupported-event", sent.position, "send", what, hint)


def _report_threads(threads: Iterable[_Use], shared: Sequence[Address], log: DiagnosticLog) -> None:
    """``unsupported-event``: an action thread has a transition for an event that only others send."""
    for use in threads:
        of_others = _by_descriptor(it for it in shared if it.target in ("", use.machine))
        own = _by_descriptor(map(Address, (*use.raises, ERROR_EXECUTION)))
        for descriptor, position in use.takes.items():
            tokens = prefix_of(descriptor)
            if tokens in of_others and tokens not in own:
                event = of_others[tokens][0].event
                what = f"an action thread takes `{event}`, which other machines send"
                hint = "take it in the machine around the thread"
                log.error("unsupported-event", position, "transition", what, hint)


def _report_names(uses: Iterable[_Use], shared: Sequence[Address], log: DiagnosticLog) -> None:
    """``bad-name``: an event has a slash, by which names of topics are divided as events are by dots."""
    reported: set[str] = set()
    for use in uses:
        for address, position in use.sends.items():
            event = address.event
            if address in shared and "/" in event and event not in reported:
                reported.add(event)
                what = f"an event of several machines cannot be called `{event}`"
                hint = f"write `{event.replace('/', '_')}`"
                log.error("bad-name", position, "send", what, hint)


def _report_targets(uses: Iterable[_Use], machines: Iterable[Machine], log: DiagnosticLog) -> None:
    """``unknown-machine``: an event is sent to a machine that is not among those that were read."""
    names = {machine.name for machine in machines}
    reported: set[Position] = set()
    for use in uses:
        for address, position in use.sends.items():
            if address.target and address.target not in names and position not in reported:
                reported.add(position)
                what = (
                    f"`{address.event}` is sent to `{address.target}`, and no such machine was read"
                )
                hint = (
                    nearest(address.target, names - {use.machine}) or "read it together with this"
                )
                log.warning("unknown-machine", position, "send", what, hint)


def _report_taken_channels(
    machines: Iterable[Machine], shared: Sequence[Address], log: DiagnosticLog
) -> None:
    """``duplicate-interface``: a model declares the topic of a plain event itself."""
    channels = {channel_of(address): address.event for address in shared}
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
        shared: these events, and to whom they are sent.
        own: those that it alone sends, and takes.
        log: where faults go.
    """

    def __init__(
        self,
        machine: Machine,
        types: Mapping[str, str],
        shared: Collection[Address],
        own: Collection[str],
        log: DiagnosticLog,
    ) -> None:
        self._machine = msgspec.structs.replace(
            machine, interfaces=tuple(_owned(item, own) for item in machine.interfaces)
        )
        self._types = types
        self._own = own
        self._shared = frozenset(shared)
        self._taken = _by_descriptor(it for it in shared if it.target in ("", machine.name))
        self._log = log
        self._added: dict[tuple[InterfaceKind, str], Interface] = {}

    def linked(self) -> Machine:
        """The machine, with its action threads."""
        own = self._lowered(self._machine, takes=True)
        inner = [self._lowered(item.machine, takes=False) for item in self._machine.threads]
        known = {(item.kind, item.name) for item in self._machine.interfaces}
        added = [item for key, item in self._added.items() if key not in known]
        return msgspec.structs.replace(
            _with(own, added),
            threads=tuple(
                msgspec.structs.replace(item, machine=_with(made, added))
                for item, made in zip(self._machine.threads, inner, strict=True)
            ),
        )

    def _lowered(self, owner: Machine, takes: bool) -> Machine:
        use = _Use(owner, self._machine)

        def sent(statement: Statement) -> Statement:
            if not isinstance(statement, Raise) or not _goes_out(statement, owner):
                return statement
            address = Address(statement.event, statement.target)
            if address not in self._shared or not (takes or _leaves_thread(address, use)):
                return statement
            return Emit(
                kind=OutputKind.PUBLISH,
                interface=self._interface(InterfaceKind.PUBLISHER, address, statement.position),
                position=statement.position,
                fields=tuple(filter(self._can_be_field, statement.fields)),
            )

        sending = with_written(owner, lambda state: changed(state, sent))
        if not takes:
            return sending
        kept = _by_descriptor(map(Address, (ERROR_EXECUTION, *_Use(sending, sending).raises)))
        return with_written(sending, lambda state: self._taking(state, kept))

    def _taking(self, state: State, kept: Mapping[str, list[Address]]) -> State:
        return msgspec.structs.replace(
            state,
            transitions=tuple(self._transitions(state, kept)),
            states=tuple(self._taking(inner, kept) for inner in state.states),
        )

    def _can_be_field(self, param: Field) -> bool:
        if _PARAM.fullmatch(param.name) is None:
            what = f"no field of a message can be called `{param.name}`"
            hint = "write letters, digits and underscores"
            self._log.error("bad-name", param.position, "param", what, hint)
            return False
        return True

    def _transitions(self, state: State, kept: Mapping[str, list[Address]]) -> Iterator[Transition]:
        """The transitions of ``state``; ``kept``: the events that the machine queues for itself."""
        before = {(item.event, item.position) for item in state.transitions}
        for item in state.transitions:
            event = item.event
            if event is None or event.kind is not EventKind.INTERNAL:
                yield item
                continue
            found = self._taken.get(prefix_of(event.name), [])
            for address in found:
                heard = self._interface(InterfaceKind.SUBSCRIBER, address, item.position)
                message = Event(EventKind.MESSAGE, heard)
                if (message, item.position) not in before:
                    named = with_event_name(item, address.event)
                    yield msgspec.structs.replace(named, event=message)
            if not found or prefix_of(event.name) in kept:
                yield item

    def _interface(self, kind: InterfaceKind, address: Address, position: Position) -> str:
        channel = channel_of(address)
        made = Interface(
            kind=kind,
            name=channel,
            position=position,
            channel=channel,
            type_name=self._types[address.event],
            event=address.event,
            target=address.target,
        )
        made = _owned(made, self._own)
        return self._added.setdefault((kind, channel), made).name


def _owned(interface: Interface, own: Collection[str]) -> Interface:
    """``interface``, of which it is said whether the machine alone publishes on it."""
    is_own = interface.kind is InterfaceKind.SUBSCRIBER and not interface.target
    is_own = is_own and interface.event in own
    return msgspec.structs.replace(interface, own=is_own)


def _with(machine: Machine, added: Iterable[Interface]) -> Machine:
    return msgspec.structs.replace(machine, interfaces=(*machine.interfaces, *added))
