"""Properties as AS2FM has them (JANI), decided on one run: which state satisfies what.

A run satisfies ``F p`` if ``p`` holds in one of its states, and ``l U r`` if ``r`` holds in one and ``l`` in all
states before. A state is what was observed last on each channel, so there is one after each observation.
"""

from __future__ import annotations

import json
import operator
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import msgspec

from m2c.policy.ticks import TICKS_CHANNEL
from transports.interface import Observation, ObservationKind
from transports.simulated.world import START_NS

EVENTS = "/plain_events/"
STATUSES = {"SUCCESS": 1, "FAILURE": 2, "RUNNING": 3}
ROOT = 1000
"""The number of the tree's root; the other nodes are numbered from there in preorder."""
GOAL, RESULT = "/_action/send_goal", "/_action/get_result"

_BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "∧": lambda left, right: left and right,
    "∨": lambda left, right: left or right,
    "⇒": lambda left, right: not left or right,
    "=": operator.eq,
    "<": operator.lt,
    "≤": operator.le,
    ">": operator.gt,
    "≥": operator.ge,
    "+": operator.add,
    "-": operator.sub,
}


class Property(msgspec.Struct, frozen=True):
    """``left`` until ``right``, which must come after at least ``least`` steps."""

    name: str
    left: Any
    right: Any
    least: int = 0


def properties_of(system: Path) -> dict[str, Property]:
    """The properties in the files that a system file names, by name."""
    found = {}
    for item in ElementTree.parse(system).getroot().iter("input"):
        if item.get("type") == "jani":
            text = (system.parent / item.attrib["src"]).read_text()
            for written in json.loads(text)["properties"]:
                made = _property(written["name"], written["expression"])
                found[made.name] = made
    return found


def _property(name: str, written: Mapping[str, Any]) -> Property:
    assert (written["op"], written["fun"], written["states"]) == (
        "filter",
        "values",
        {"op": "initial"},
    )
    assert written["values"]["op"] == "Pmin"
    match written["values"]["exp"]:
        case {"op": "F", "exp": right}:
            return Property(name, True, right)
        case {"op": "U", "left": left, "right": right, **others}:
            return Property(name, left, right, others.get("step-bounds", {}).get("lower", 0))
        case other:
            raise NotImplementedError(other["op"])


def leaves_of(tree: Path) -> dict[str, int]:
    """The numbers of a tree's nodes, by the names of its leaves; of two with one name, the first's."""
    behavior = ElementTree.parse(tree).getroot().find("BehaviorTree")
    assert behavior is not None
    nodes = list(behavior.iter())[1:]
    found: dict[str, int] = {}
    for number, node in enumerate(nodes):
        kind = node.get("ID", node.tag) if node.tag in ("Action", "Condition") else node.tag
        for name in (node.get("name", kind), kind):
            found.setdefault(name, ROOT + number)
    return found


class State:
    """What was observed last, by the names that properties have for it.

    Args:
        leaves: the number of each leaf of the tree.
        entry: the value of an entry of the tree's blackboard; None if it has none.
    """

    def __init__(self, leaves: Mapping[str, int], entry: Callable[[str], Any]) -> None:
        self._values: dict[str, Any] = {}
        self._leaves = leaves
        self._entry = entry
        self._now_ns = START_NS

    def observe(self, event: Observation) -> None:
        """Take note of ``event``."""
        self._now_ns = event.stamp_ns
        if event.kind is ObservationKind.MESSAGE and event.channel == TICKS_CHANNEL:
            assert isinstance(event.data, dict)
            self._values[f"bt_{ROOT}_response__status"] = STATUSES[event.data["status"]]
            for leaf in event.data["leaves"]:
                if leaf["status"] in STATUSES and leaf["name"] in self._leaves:
                    number = self._leaves[leaf["name"]]
                    self._values[f"bt_{number}_response__status"] = STATUSES[leaf["status"]]
            return
        prefix, data = _prefix(event), event.data
        if prefix is None or not isinstance(data, dict):
            return
        if event.channel.endswith(RESULT):
            self._values[f"{prefix}__code"] = data["status"]
            data = data["result"]
        elif event.channel.endswith(GOAL):
            data = data["goal"]
        self._values[f"{prefix}.valid"] = True
        is_event = event.channel.startswith(EVENTS)
        self._note(prefix if is_event else f"{prefix}__ros_fields", data)

    def _note(self, prefix: str, data: Mapping[str, Any]) -> None:
        for name, value in data.items():
            key = f"{prefix}__{name}"
            if isinstance(value, dict):
                self._note(key, value)
            numbers = _as_numbers(value)
            self._values[key] = numbers
            if isinstance(numbers, list):
                self._values[f"{key}.d1_len"] = len(numbers)

    def value(self, written: Any) -> Any:
        """The value of an expression of a property; 0 stands for what was never observed."""
        match written:
            case str():
                return self._lookup(written)
            case {"op": "¬", "exp": exp}:
                return not self.value(exp)
            case {"op": "abs", "exp": exp}:
                return abs(self.value(exp))
            case {"op": "av", "elements": elements}:
                return [self.value(element) for element in elements]
            case {"op": "aa", "exp": exp, "index": index}:
                array, place = self.value(exp), self.value(index)
                return array[place] if isinstance(array, list) and place < len(array) else 0
            case {"op": op, "left": left, "right": right}:
                return _BINARY[op](self.value(left), self.value(right))
            case bool() | int() | float():
                return written
            case other:
                raise NotImplementedError(other["op"])

    def _lookup(self, name: str) -> Any:
        if name.startswith("topic_clock_msg__ros_fields__"):
            seconds = (self._now_ns - START_NS) / 1e9
            return int(seconds) if name.endswith("__sec") else int(seconds % 1 * 1e9)
        if name.startswith("bt_blackboard_set_"):
            entry = name.removeprefix("bt_blackboard_set_").removesuffix("__value")
            return self._entry(entry) or 0
        return self._values.get(name, 0)


def _prefix(event: Observation) -> str | None:
    """What names in properties begin with, for a kind of observation that has some."""
    name = event.channel
    if event.kind is ObservationKind.MESSAGE:
        if name.startswith(EVENTS):
            return name.removeprefix(EVENTS).replace("/", ".")
        return f"topic_{_flat(name)}_msg"
    if event.kind is ObservationKind.REQUEST_RECEIVED:
        if name.endswith(GOAL):
            return f"action_{_flat(name.removesuffix(GOAL))}_goal_request"
        if name.endswith(RESULT):
            return None
        return f"srv_{_flat(name)}_request"
    if event.kind is ObservationKind.RESPONSE_SENT and not name.endswith(GOAL):
        if name.endswith(RESULT):
            return f"action_{_flat(name.removesuffix(RESULT))}_result"
        return f"srv_{_flat(name)}_response"
    return None


def _flat(channel: str) -> str:
    return channel.removeprefix("/").replace("/", "__")


def _as_numbers(value: Any) -> Any:
    """A value without texts: those are arrays of their bytes."""
    if isinstance(value, str):
        return list(value.encode())
    if isinstance(value, list):
        return [_as_numbers(item) for item in value]
    return value


class Decider:
    """Decides one property while a run is observed.

    Attributes:
        holds: None as long as it is not decided.
    """

    def __init__(self, wanted: Property) -> None:
        self._property = wanted
        self._steps = 0
        self.holds: bool | None = None

    def look(self, state: State) -> None:
        """The run is in ``state`` now."""
        if self.holds is None:
            if self._steps >= self._property.least and state.value(self._property.right):
                self.holds = True
            elif not state.value(self._property.left):
                self.holds = False
            self._steps += 1
