"""What a system file asks of the middleware for a topic: ``<qos><topic name="/scan" …/></qos>``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.machine import Interface, InterfaceKind, Machine
from m2c.model.naming import absolute
from m2c.model.structure import check_attributes, note_read_as, require
from m2c.model.xml import Element
from m2c.suggestions import nearest

_TOPICS = (InterfaceKind.PUBLISHER, InterfaceKind.SUBSCRIBER)
_VALUES = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("volatile", "transient_local"),
    "latched": ("false", "true"),
}
"""What can be said; the first is what holds if nothing is. ROS 1 called transient local ``latched``."""
_ATTRIBUTES = ("name", *_VALUES)


class TopicQuality(msgspec.Struct, frozen=True):
    """How the messages of one topic travel, at both of its ends.

    Attributes:
        topic: the channel.
        is_best_effort: messages may be dropped.
        is_transient_local: a subscriber that comes late gets the last message.
        position: of the name, for messages.
    """

    topic: str
    is_best_effort: bool
    is_transient_local: bool
    position: Position


def read_qualities(element: Element, log: DiagnosticLog) -> list[TopicQuality]:
    """The topics of ``<qos>``, each once; faults go to ``log``."""
    found: dict[str, TopicQuality] = {}
    for child in element.children:
        if child.tag != "topic":
            what = f"not an element of <{element.tag}>"
            log.error("unknown-tag", child.position, child.tag, what, "use <topic>")
            continue
        check_attributes(child, _ATTRIBUTES, log)
        if child.get("latched") == "true":
            meaning = '`durability="transient_local"`'
            note_read_as(child.at("latched"), child.tag, 'latched="true"', meaning, log)
        written = require(child, "name", log)
        topic = absolute(written) if written else ""
        said = {name: _value(child, name, log) for name in _VALUES}
        if topic in found:
            what, hint = f"`{topic}` is given twice", "one <topic> says all of a topic"
            log.error("duplicate-quality", child.at("name"), child.tag, what, hint)
        elif topic:
            found[topic] = TopicQuality(
                topic,
                said["reliability"] == "best_effort",
                said["durability"] == "transient_local" or said["latched"] == "true",
                child.at("name"),
            )
    return list(found.values())


def _value(element: Element, name: str, log: DiagnosticLog) -> str:
    allowed = _VALUES[name]
    if name not in element.attributes:
        return allowed[0]
    written = element.get(name)
    if written not in allowed:
        what, hint = f"{name} cannot be `{written}`", f"one of {', '.join(allowed)}"
        log.error("bad-quality", element.at(name), element.tag, what, hint)
    return written


def with_qualities(machine: Machine, qualities: Sequence[TopicQuality]) -> Machine:
    """``machine`` with its topics' qualities."""
    by_topic = {quality.topic: quality for quality in qualities}

    def changed(interface: Interface) -> Interface:
        quality = by_topic.get(interface.channel or "")
        if quality is None or interface.kind not in _TOPICS:
            return interface
        return msgspec.structs.replace(
            interface,
            best_effort=quality.is_best_effort,
            transient_local=quality.is_transient_local,
        )

    interfaces = tuple(changed(interface) for interface in machine.interfaces)
    return msgspec.structs.replace(machine, interfaces=interfaces)


def report_unknown_topics(
    qualities: Iterable[TopicQuality], machines: Iterable[Machine], log: DiagnosticLog
) -> None:
    """``unknown-topic``: a quality is asked for on a topic that no machine has."""
    known = {
        interface.channel
        for machine in machines
        for interface in machine.interfaces
        if interface.kind in _TOPICS and interface.channel
    }
    for quality in qualities:
        if quality.topic not in known:
            what = f"no model publishes or subscribes to `{quality.topic}`"
            hint = nearest(quality.topic, sorted(known))
            log.error("unknown-topic", quality.position, "topic", what, hint)
