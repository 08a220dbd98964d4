"""Leaves that are interfaces: a tree's own actions, services and conditions on topics, bound in the system file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from random import Random

from tests.campaign.channels import Channel
from tests.campaign.elements import Element, e
from tests.campaign.kinds import Kind
from tests.campaign.skills import Leaf

MOST = 3
"""Bound leaves of a tree."""
_LITERALS = {"bool": ("true", "false"), "string": ("'dock'", "''")}
_NUMBERS = ("0", "1", "2", "5")


def bound(draw: Random, channels: list[Channel]) -> Iterator[tuple[Element, Leaf]]:
    """Bindings of some of ``channels``, each with a leaf that has it.

    Args:
        draw: where all chance comes from.
        channels: what the system's components offer.
    """
    able = [item for item in channels if item.kind in _MAKE]
    for number, channel in enumerate(draw.sample(able, min(len(able), draw.randint(1, MOST)))):
        binding = _Binding(draw, f"Bound{number}", channel)
        _MAKE[channel.kind](binding)
        yield binding.element(), binding.leaf()


class _Binding:
    def __init__(self, draw: Random, name: str, channel: Channel) -> None:
        self.draw = draw
        self.name = name
        self.channel = channel
        self.attributes: dict[str, str] = {"ID": name}
        self.given: dict[str, str] = {}
        self.parts: list[Element] = []

    def action(self) -> None:
        action = self.channel.action
        assert action is not None
        self._names("action", action.name)
        self._sends(action.goal)
        self._writes("feedback", action.feedback)
        self._writes("result", action.result)
        self._counts("_wrapped_result.result", action.result)

    def service(self) -> None:
        service = self.channel.service
        assert service is not None
        self._names("service", service.name)
        self._sends(service.request)
        self._writes("result", service.response)
        self._counts("_res", service.response)

    def topic(self) -> None:
        message = self.channel.message
        assert message is not None
        self._names("topic", message.name)
        self._writes("result", message)
        self._counts("_msg", message)

    def element(self) -> Element:
        """The binding, for the system file."""
        return e("leaf", *self.parts, **self.attributes)

    def leaf(self) -> Leaf:
        """The leaf, for the tree."""
        is_action = self.channel.kind == "action"
        if self.draw.random() < 0.5:
            return Leaf(e(self.name, **self.given), is_action)
        tag = "Condition" if self.channel.kind == "topic" else "Action"
        return Leaf(e(tag, ID=self.name, **self.given), is_action)

    def _names(self, kind: str, type_name: str) -> None:
        name = self.channel.name
        if self.draw.random() < 0.2:  # the tree says which
            name, self.given["where"] = "{where}", name
        self.attributes |= {kind: name, "type": type_name}

    def _sends(self, kind: Kind) -> None:
        """Some fields of the goal or request, from ports and expressions."""
        for name, field in kind.fields:
            way = self.draw.choice(("port", "expr", "zero"))
            literal = self._literal(field)
            if way == "zero" or literal is None:
                continue
            if way == "expr" and field.item is None:
                self.parts.append(e("field", name=name, expr=literal))
                continue
            self.parts.append(e("field", name=name, port=f"{name}_in"))
            at_will = field.name == "int32" and self.draw.random() < 0.5
            self.given[f"{name}_in"] = "{level}" if at_will else literal.strip("'")

    def _literal(self, kind: Kind) -> str | None:
        if kind.item is not None:
            count = self.draw.randint(0, 3)
            inner = [self._literal(kind.item) for _ in range(count)]
            if kind.item.name not in ("int32",) or None in inner:
                return None
            return json.dumps([int(item) for item in inner if item is not None])
        if kind.is_record:
            return None
        return self.draw.choice(_LITERALS.get(kind.name, _NUMBERS))

    def _writes(self, tag: str, kind: Kind) -> None:
        """Whole numbers of what comes, and sometimes all of it, to entries of the blackboard."""
        for name, field in kind.fields:
            if field.name == "int32" and self.draw.random() < 0.6:
                port = f"{tag}_{name}"
                self.parts.append(e(tag, name=name, port=port))
                self.given[port] = self.draw.choice(("{other}", "{level}", f"{{{self.name}}}"))
        if self.draw.random() < 0.25:
            self.parts.append(e(tag, port=f"{tag}_whole"))
            self.given[f"{tag}_whole"] = f"{{{self.name}_{tag}}}"

    def _counts(self, what: str, kind: Kind) -> None:
        """When an outcome is a success."""
        numbers = [name for name, field in kind.fields if field.name == "int32"]
        if not numbers or self.draw.random() < 0.4:
            return
        limit = str(self.draw.randint(-1, 3))
        if self.draw.random() < 0.4:
            self.parts.append(e("bt_declare_port_in", key="least", type="int32"))
            self.given["least"], limit = limit, "least"
        self.attributes["cond"] = f"{what}.{self.draw.choice(numbers)} >= {limit}"


_MAKE = {"action": _Binding.action, "service": _Binding.service, "topic": _Binding.topic}
