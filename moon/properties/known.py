"""What the ports of a cell were last observed to be, and what the predicates on them say."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from m2c.model.walk import variables_of
from moon.properties.binding import ANY_CHANNEL, Binding, value_of
from moon.properties.predicates import UNKNOWN_ERRORS, why_unknown
from moon.properties.property import Port


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
