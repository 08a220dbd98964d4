"""From observations to atoms: which names a channel sets, the functions that do it, the last values.

Per channel and group of kinds one function is written into the compiled monitor: it takes the values
out of the message, evaluates the predicates that use them and, only if one of them changed or
something is due, brings the network to the observation's instant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import msgspec

from m2c.model.expressions import Variable
from m2c.model.walk import variables_of
from moon.properties.formula import Formula, Predicate, predicates
from moon.properties.predicates import (
    ENVIRONMENT,
    UNKNOWN_ERRORS,
    PredicateError,
    UnknownValue,
    truth_source,
    why_unknown,
)
from moon.properties.property import Port
from transports.interface import ObservationKind

ANY_CHANNEL = "*"
"""Of ports that were not declared: their field may come on any channel."""


class Group(msgspec.Struct, frozen=True):
    """Ports that the same observations set."""

    name: str
    channel: str
    kinds: tuple[ObservationKind, ...]
    ports: tuple[Port, ...]
    atoms: tuple[str, ...]
    """Texts of the predicates that these ports decide (with others' help, perhaps)."""


class Binding(msgspec.Struct, frozen=True):
    """How the names of some formulas get their values.

    Attributes:
        ports: by name.
        atoms: the predicates by text.
        events: texts of predicates that are events.
        groups: the channels' groups.
        evaluate: per state predicate, ``evaluate(values)`` with values by name; raises one of
            ``UNKNOWN_ERRORS`` (:class:`KeyError` for a name without a value).
        conditions: per event port name, whether a message counts.
    """

    ports: dict[str, Port]
    atoms: dict[str, Predicate]
    events: frozenset[str]
    groups: tuple[Group, ...]
    evaluate: dict[str, Callable[[dict[str, Any]], bool]]
    conditions: dict[str, Callable[[Any], bool]]


def bind(formulas: Iterable[Formula], ports: Iterable[Port]) -> Binding:
    """The binding of ``formulas``; names that ``ports`` do not declare are fields on any channel.

    Raises:
        PredicateError: a predicate uses an event inside a larger expression, or what is no value.
    """
    declared = {port.name: port for port in ports}
    atoms: dict[str, Predicate] = {}
    for formula in formulas:
        atoms.update(predicates(formula))
    used: dict[str, Port] = {}
    users: dict[str, list[str]] = {}
    events = set()
    for text, atom in atoms.items():
        names = variables_of(atom.expression)
        for name in names:
            port = declared.get(name) or Port(name, ANY_CHANNEL, (), (name,))
            used[name] = port
            users.setdefault(name, []).append(text)
            if port.event:
                if not isinstance(atom.expression, Variable):
                    raise PredicateError(
                        f"`{text}`: `{name}` is an event; it stands alone, not inside an expression"
                    )
                events.add(text)
    grouped: dict[tuple[str, tuple[ObservationKind, ...]], list[Port]] = {}
    for port in used.values():
        grouped.setdefault((port.channel, port.kinds), []).append(port)
    groups = tuple(
        Group(
            f"on_{number}",
            channel,
            kinds,
            tuple(members),
            tuple(dict.fromkeys(text for port in members for text in users[port.name])),
        )
        for number, ((channel, kinds), members) in enumerate(grouped.items())
    )
    evaluate = {text: _evaluator(atom) for text, atom in atoms.items() if text not in events}
    conditions = {name: _condition(port) for name, port in used.items() if port.event}
    return Binding(used, atoms, frozenset(events), groups, evaluate, conditions)


def _evaluator(atom: Predicate) -> Callable[[dict[str, Any]], bool]:
    names = variables_of(atom.expression)
    source = truth_source(atom.expression, {name: f"values[{name!r}]" for name in names})
    return _function("values", source)


def _condition(port: Port) -> Callable[[Any], bool]:
    if port.condition is None:
        return lambda data: True
    return _function("data", truth_source(port.condition, {"data": "data"}))


def _function(argument: str, source: str) -> Callable[[Any], bool]:
    scope: dict[str, Any] = dict(ENVIRONMENT)
    exec(compile(f"def evaluate({argument}):\n    return {source}\n", "<predicate>", "exec"), scope)
    made: Callable[[Any], bool] = scope["evaluate"]
    return made


def value_of(port: Port, data: Any) -> Any:
    """The value that a message gives a state port.

    Raises:
        UnknownValue: the contents or the field are not there.
    """
    if data is None:
        raise UnknownValue("the contents are not known")
    value = data
    try:
        for name in port.path:
            value = value[name]
    except UNKNOWN_ERRORS as error:
        raise UnknownValue(f"there is no field `{'.'.join(port.path)}`") from error
    return value


class KnownValues:
    """The last value of every state of ``binding``, by port; first, the ports' initial values."""

    def __init__(self, binding: Binding) -> None:
        self._binding = binding
        self.values: dict[str, Any] = {}
        """Without those never observed; None is a value that an observation did not have."""
        self.waiting: set[str] = set()
        """States of which nothing is known: not observed yet (nor initial), or not since a loss."""
        self.lost: dict[str, str] = {}
        """States that a lost message may have set since they were observed last, with the reason."""
        self._names = {text: variables_of(atom.expression) for text, atom in binding.atoms.items()}
        for port in binding.ports.values():
            if not port.event and port.initial is msgspec.UNSET:
                self.waiting.add(port.name)
            elif not port.event:
                self.values[port.name] = port.initial

    def take(self, port: Port, data: Any) -> None:
        """Take over what an observation's ``data`` says of ``port``."""
        if port.channel == ANY_CHANNEL:
            if not isinstance(data, Mapping) or port.name not in data:
                return
            self.values[port.name] = data[port.name]
            self._found(port.name)
            return
        self._found(port.name)
        try:
            self.values[port.name] = value_of(port, data)
        except UNKNOWN_ERRORS:
            self.values[port.name] = None

    def _found(self, name: str) -> None:
        self.waiting.discard(name)
        self.lost.pop(name, None)

    def lose(self, names: Mapping[str, str]) -> None:
        """The ports ``names`` may have been set by a message that was lost, for the reason given."""
        for name, reason in names.items():
            if not self._binding.ports[name].event:
                self.waiting.add(name)
                self.lost[name] = reason

    def of_handlers(self) -> dict[str, Any]:
        """The values under the names that the compiled handlers keep them by."""
        return {
            f"X{place}": self.values.get(name) for place, name in enumerate(self._binding.ports)
        }

    def take_from_handlers(self, read: Mapping[str, Any]) -> None:
        """Take over what the handlers' variables ``read`` have kept."""
        for place, name in enumerate(self._binding.ports):
            if (value := read[f"X{place}"]) is not None:
                self.values[name] = value

    def holds(self, text: str) -> bool:
        """Whether the state predicate ``text`` holds; one of ``UNKNOWN_ERRORS`` if it has no value."""
        return self._binding.evaluate[text](self.values)

    def judge(self, text: str, unknown: dict[str, str]) -> bool | None:
        """The state predicate's value; None, with the reason in ``unknown``, if it has none."""
        for name in self._names[text]:
            if name in self.lost:
                unknown[text] = self.lost[name]
                return None
        try:
            value = self.holds(text)
        except UNKNOWN_ERRORS as error:
            unknown[text] = f"`{text}` is not known: {why_unknown(error)}"
            return None
        unknown.pop(text, None)
        return value


def handler_source(group: Group, binding: Binding, index_of: dict[str, int]) -> str:
    """The function ``<group.name>(t, data, obs)`` of ``group``; ``t`` has not passed.

    Args:
        group: the ports.
        binding: their binding.
        index_of: network node of each predicate's text.
    """
    number = {name: place for place, name in enumerate(binding.ports)}
    states = [port for port in group.ports if not port.event]
    # an event on which no formula depends (`{e} or not {e}`) has no node
    events = [port for port in group.ports if port.event and port.name in index_of]
    state_atoms = [text for text in group.atoms if text not in binding.events]
    own = {port.name for port in states}
    names = {name: f"{'Y' if name in own else 'X'}{place}" for name, place in number.items()}
    touched = [f"X{number[port.name]}" for port in states]
    touched += [f"p{index_of[text]}" for text in group.atoms]
    lines = [f"def {group.name}(t, data, obs):", f"    nonlocal {', '.join(['now', *touched])}"]
    if group.kinds and group.kinds[0].startswith("response"):
        lines += ["    if obs.error:", "        return"]
    lines += ["    try:", "        pass"]
    lines += [f"        {line}" for line in _values(states, number, group.channel == ANY_CHANNEL)]
    for text in state_atoms:
        source = truth_source(binding.atoms[text].expression, names)
        lines.append(f"        a{index_of[text]} = {source}")
    for port in events:
        condition = "True"
        if port.condition is not None:
            condition = truth_source(port.condition, {"data": "data"})
        lines.append(f"        C{number[port.name]} = {condition}")
    lines += ["    except UNKNOWN as error:", "        raise Unknown from error"]
    lines += ["    changed = due = heap[0][0] <= t and before(t)", "    now = t"]
    lines += [f"    X{number[port.name]} = Y{number[port.name]}" for port in states]
    for text in state_atoms:
        node = index_of[text]
        lines += [
            f"    if a{node} is not p{node}:",
            f"        p{node} = a{node}",
            f"        log{node}((t, a{node}, obs))",
            "        changed = True",
        ]
    for port in events:
        node = index_of[port.name]
        lines += [
            f"    if C{number[port.name]} and not p{node}:",
            f"        p{node} = True",
            f"        log{node}((t, True, obs))",
            f"        heappush(heap, (t + 1, {node}))",
            "        changed = True",
        ]
    lines += ["    if changed:", f"        step(t) if due else {group.name}_cone(t)"]
    return "\n".join(lines)


def _values(states: Sequence[Port], number: dict[str, int], persistent: bool) -> list[str]:
    lines = []
    for port in states:
        name = f"Y{number[port.name]}"
        if persistent:
            field = port.path[0]
            kept = f"X{number[port.name]}"
            lines.append(f"{name} = data[{field!r}] if {field!r} in data else {kept}")
            continue
        fields = "".join(f"[{part!r}]" for part in port.path)
        lines.append(f"{name} = data{fields}")
    return lines
