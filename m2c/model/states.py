"""Reading states: their content, their transitions, and where those lead."""

from __future__ import annotations

from m2c.diagnostics import DiagnosticLog
from m2c.language.durations import parse_duration
from m2c.model.content import ContentReader
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Block,
    Event,
    EventKind,
    InterfaceKind,
    State,
    Statement,
    Target,
    Transition,
)
from m2c.model.structure import check_element, exclude, note_read_as, number, require
from m2c.model.vocabulary import FINAL_CHILDREN, HANDLERS, STATE_CHILDREN, UNSUPPORTED
from m2c.model.xml import Element
from m2c.suggestions import nearest

LEGACY_EVENTS = {
    "bt_tick": EventKind.BT_TICK,
    "bt_halt": EventKind.BT_HALT,
}
"""How early HL-SCXML plugins spell the tree's events in a plain ``<transition>``."""


class StateReader:
    """Reads the states of one machine; ``names`` are the ids of all of them."""

    def __init__(
        self,
        log: DiagnosticLog,
        content: ContentReader,
        names: list[str],
        library: InterfaceLibrary,
    ) -> None:
        self._log = log
        self._content = content
        self._library = library
        self._names = frozenset(names)

    def read(self, element: Element, name: str) -> State:
        """The state ``name`` that ``element`` (``<state>`` or ``<final>``) describes."""
        final = element.tag == "final"
        entry: list[Element] = []
        leaving: list[Element] = []
        transitions: list[Transition] = []
        for child in element.children:
            if not self._is_allowed(child, name, final):
                continue
            if child.tag == "onentry":
                entry.append(child)
            elif child.tag == "onexit":
                leaving.append(child)
            else:
                index = len(transitions)
                transitions += self._read_transitions(child, name, index)
        if element.get("initial"):
            self._log.error(
                "unsupported-element",
                element.at("initial"),
                element.tag,
                f"state `{name}` has an initial state: compound states are not part of the language",
                "remove the attribute",
            )
        if final:  # a machine that ends exits its last state at once (W3C SCXML, exitInterpreter)
            entry, leaving = [*entry, *leaving], []
        return State(
            name=name,
            position=element.position,
            on_entry=self._blocks(entry),
            on_exit=self._blocks(leaving),
            transitions=tuple(transitions),
            final=final,
        )

    def _is_allowed(self, child: Element, state: str, final: bool) -> bool:
        """Whether ``child`` may stand in ``state``; reports it if not."""
        if child.tag in ("state", "final", "parallel", "history", "initial"):
            what = f"a state inside state `{state}`: compound states are not part of the language"
            hint = "make it a state of the machine"
            self._log.error("unsupported-element", child.position, child.tag, what, hint)
            return False
        if child.tag in UNSUPPORTED:
            hint = UNSUPPORTED[child.tag]
            self._log.error("unsupported-element", child.position, child.tag, "not supported", hint)
            return False
        if final and child.tag in STATE_CHILDREN - FINAL_CHILDREN:
            what = f"the machine ends in the final state `{state}`, which takes no event"
            self._log.error("unknown-tag", child.position, child.tag, what, "make it a <state>")
            return False
        parent = "final" if final else "state"
        return check_element(child, self._log, inside=STATE_CHILDREN, parent=parent)

    def _blocks(self, elements: list[Element]) -> tuple[Statement, ...]:
        """The content of all ``<onentry>``, or ``<onexit>``, of a state; of several, each is a block."""
        found = [Block(self._content.block(item.children), item.position) for item in elements]
        filled = [block for block in found if block.body]
        return filled[0].body if len(filled) == 1 else tuple(filled)

    def _read_transitions(self, element: Element, state: str, index: int) -> list[Transition]:
        tag = element.tag
        if tag == "ros_action_handle_goal_response":
            return self._goal_response(element)
        handled = self._content.handler_event(element) if tag in HANDLERS else None
        content = self._content.inside(handled, self._library)
        cond = content.expression_of(element, "cond", optional=True)
        targets = self._targets(element, content)
        body = content.block([child for child in element.children if child.tag != "target"])
        events: list[Event | None]
        after = None
        if handled is not None:
            events = [handled]
        elif element.get("after"):
            after = parse_duration(element.get("after"))
            if after is None:
                self._log.error(
                    "bad-duration",
                    element.at("after"),
                    tag,
                    f"`{element.get('after')}` is not a time",
                    "write it like 5s or 200ms",
                )
            exclude(element, "after", "event", self._log)
            events = [Event(EventKind.AFTER, f"{state}#{index}")]
        else:
            written = element.get("event").split()
            for event in LEGACY_EVENTS.keys() & set(written):
                note_read_as(element.at("event"), tag, event, f"<{event}>", self._log)
            events = [
                Event(
                    LEGACY_EVENTS.get(event, EventKind.INTERNAL),
                    "" if event in LEGACY_EVENTS else event,
                )
                for event in written
            ] or [None]
        return [
            Transition(
                event=event,
                position=element.position,
                cond=cond,
                targets=targets,
                body=body,
                after_s=after,
                element=tag,
            )
            for event in events
        ]

    def _goal_response(self, element: Element) -> list[Transition]:
        interface = self._content.interface_of(element, InterfaceKind.ACTION_CLIENT)
        found = []
        for attribute, kind in (
            ("accept", EventKind.GOAL_ACCEPTED),
            ("reject", EventKind.GOAL_REJECTED),
        ):
            target = require(element, attribute, self._log)
            self._check_target(target, element, attribute)
            event = Event(kind, interface)
            found.append(
                Transition(
                    event=event,
                    position=element.position,
                    targets=(Target(target),),
                    body=self._content.inside(event, self._library).block(element.children),
                    element=element.tag,
                )
            )
        return found

    def _targets(self, element: Element, content: ContentReader) -> tuple[Target, ...]:
        written = element.get("target")
        children = list(element.all("target"))
        if written and children:
            what = "a `target` attribute and <target> elements exclude each other"
            self._log.error("unknown-attribute", element.at("target"), element.tag, what)
        if written:
            self._check_target(written, element, "target")
            return (Target(written),)
        if "target" in element.attributes:
            what, hint = "the target is empty", "name a state, or leave the attribute out to stay"
            self._log.error("unknown-target", element.at("target"), element.tag, what, hint)
        targets = []
        left = 1.0
        for child in children:
            check_element(child, self._log)
            name = require(child, "id", self._log)
            self._check_target(name, child, "id")
            probability = number(child.get("prob")) if child.get("prob") else None
            if child.get("prob") and (probability is None or not 0 <= probability <= 1):
                self._log.error(
                    "bad-probability",
                    child.at("prob"),
                    "target",
                    f"`{child.get('prob')}` is not a probability",
                    "a number from 0 to 1",
                )
                probability = 0.0
            if probability is None:
                probability = max(left, 0.0)
            left -= probability
            targets.append(Target(name, probability, content.block(child.children)))
        if len(targets) == 1:
            return (Target(targets[0].state, None, targets[0].body),)
        if children and abs(left) > 1e-9:
            self._log.error(
                "bad-probability",
                element.position,
                element.tag,
                f"the probabilities add up to {1 - left:g}",
                "they add up to 1",
            )
        return tuple(targets)

    def _check_target(self, target: str, element: Element, attribute: str) -> None:
        if target and target not in self._names:
            self._log.error(
                "unknown-target",
                element.at(attribute),
                element.tag,
                f"the target state `{target}` does not exist",
                nearest(target, self._names),
            )
