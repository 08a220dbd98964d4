"""Reading states: their content, their transitions, and where those lead."""

from __future__ import annotations

import re
from collections.abc import Collection

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.language.durations import parse_duration
from m2c.model.content import ContentReader
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Block,
    Event,
    EventKind,
    Field,
    History,
    InterfaceKind,
    State,
    Statement,
    Target,
    Transition,
)
from m2c.model.nesting import asked_states
from m2c.model.state_names import STATES, StateNames
from m2c.model.structure import check_element, exclude, note_read_as, number, require
from m2c.model.vocabulary import (
    FINAL_CHILDREN,
    HANDLERS,
    MISPLACED,
    STATE_CHILDREN,
    TRANSITIONS,
    UNSUPPORTED,
)
from m2c.model.xml import Element

LEGACY_EVENTS = {
    "bt_tick": EventKind.BT_TICK,
    "bt_halt": EventKind.BT_HALT,
}
"""How early HL-SCXML plugins spell the tree's events in a plain ``<transition>``."""
_MAX_SHOWN = 80
"""Characters of a value that an error repeats."""


class StateReader:
    """Reads the states of one machine.

    Args:
        log: where faults go.
        content: reads what stands in them.
        root: the machine, or an action thread.
        library: the message types.
        variables: of its datamodel; those of histories are called differently.
    """

    def __init__(
        self,
        log: DiagnosticLog,
        content: ContentReader,
        root: Element,
        library: InterfaceLibrary,
        variables: Collection[str],
    ) -> None:
        self._log = log
        self._content = content
        self._library = library
        self._root = root
        self._names = StateNames(root, log)
        self._variables = set(variables)
        self.remembered: list[History] = []
        """The histories that something leads to."""

    def read(self) -> tuple[tuple[State, ...], str]:
        """All states as they are written, and the id of the initial one; "" if there is none."""
        states = tuple(map(self._state, self._root.all("state", "final")))
        for asked in asked_states(states):
            self._names.check_asked(asked)
        initial = self._root.get("initial")
        self._names.check(initial, self._root, "initial", "the initial state")
        return states, initial or next((state.name for state in states), "")

    def _state(self, element: Element) -> State:
        """The state that ``element`` (``<state>`` or ``<final>``) describes."""
        name = self._names.of(element)
        self._names.take(name, element)
        final = element.tag == "final"
        found: dict[str, list[Element]] = {}
        transitions: list[Transition] = []
        for child in element.children:
            if self._is_allowed(child, name, final):
                found.setdefault(child.tag, []).append(child)
                if child.tag in TRANSITIONS:
                    transitions += self._read_transitions(child, name, len(transitions), element)
        entry, leaving = found.get("onentry", []), found.get("onexit", [])
        if final and element in self._root.children:
            # a machine that ends exits its last state at once (W3C SCXML, exitInterpreter)
            entry, leaving = [*entry, *leaving], []
        return State(
            name=name,
            position=element.position,
            on_entry=self._blocks(entry),
            on_exit=self._blocks(leaving),
            transitions=tuple(transitions),
            final=final,
            states=tuple(map(self._state, element.all("state", "final"))) if not final else (),
            initial=self._initial(element, name, found.get("initial", [])),
            histories=tuple(self._history(child, element) for child in found.get("history", [])),
            done_data=self._done_data(element, found.get("donedata", [])),
        )

    def _is_allowed(self, child: Element, state: str, final: bool) -> bool:
        """Whether ``child`` may stand in ``state``; reports it if not."""
        if child.tag in UNSUPPORTED:
            hint = UNSUPPORTED[child.tag]
            self._log.error("unsupported-element", child.position, child.tag, "not supported", hint)
            return False
        if final and child.tag in STATE_CHILDREN - FINAL_CHILDREN:
            what = f"nothing leads out of the final state `{state}`, and nothing stands in it"
            self._log.error("unknown-tag", child.position, child.tag, what, "make it a <state>")
            return False
        parent = "final" if final else "state"
        inside = FINAL_CHILDREN if final else STATE_CHILDREN
        return check_element(child, self._log, inside=inside, parent=parent)

    # -- compound states ----------------------------------------------------------------------

    def _initial(self, element: Element, name: str, written: list[Element]) -> Transition | None:
        """What is taken where the compound state ``element`` is entered; None if it is atomic."""
        is_given = "initial" in element.attributes
        for child in written[0 if is_given else 1 :]:
            what = f"state `{name}` has an initial state already"
            self._log.error("unknown-tag", child.position, child.tag, what, "write one of them")
        if element.tag == "final" or not any(child.tag in STATES for child in element.children):
            at = written[0].position if written else element.at("initial")
            if written or is_given:
                what = f"state `{name}` has an initial state, and no states inside"
                self._log.error("unknown-target", at, element.tag, what, "leave that out")
            return None
        if is_given:
            target = require(element, "initial", self._log)
            self._names.check_inside(element, target, element, "initial", has_history=True)
            return _to(target, element.at("initial"))
        if written:
            return self._default(written[0], element)
        first = next(element.all("state", "final"), None)
        return None if first is None else _to(self._names.of(first), first.position)

    def _history(self, element: Element, parent: Element) -> History:
        name = require(element, "id", self._log)
        self._names.take(name, element)
        kind = element.get("type", "shallow")
        if kind not in ("shallow", "deep"):
            what = f"`{shortened(kind, _MAX_SHOWN)}` is no type of a history"
            hint = "write shallow or deep"
            self._log.error("unknown-attribute", element.at("type"), "history", what, hint)
        variable = ""
        if self._names.is_aimed_at(name):
            variable = re.sub(r"\W", "_", f"history_{name}", flags=re.ASCII)
            while variable in self._variables:
                variable += "_"
            self._variables.add(variable)
        history = History(
            name=name,
            position=element.position,
            deep=kind == "deep",
            default=self._default(element, parent),
            variable=variable,
        )
        if variable:
            self.remembered.append(history)
        return history

    def _default(self, element: Element, parent: Element) -> Transition:
        """The one transition of an ``<initial>`` or a ``<history>`` (W3C SCXML 3.6, 3.10)."""
        tag, log = element.tag, self._log
        found = [
            child
            for child in element.children
            if check_element(child, log, inside=("transition",), parent=tag)
        ]
        if not found:
            what, hint = (
                f"<{tag}> has no transition",
                f'write <{tag}><transition target="…"/></{tag}>',
            )
            log.error("missing-element", element.position, tag, what, hint)
            return _to("", element.position)
        for other in found[1:]:
            what = f"a second transition of <{tag}>"
            log.error("unknown-tag", other.position, other.tag, what, "leave it out")
        child = found[0]
        for attribute in ("event", "cond", "after"):
            if attribute in child.attributes:
                what = f"the transition of <{tag}> waits for nothing, and always holds"
                hint = f"leave `{attribute}` out"
                log.error("unknown-attribute", child.at(attribute), child.tag, what, hint)
        target = require(child, "target", log)
        self._names.check_inside(parent, target, child, "target", has_history=tag == "initial")
        return _to(target, child.position, self._content.block(child.children))

    def _done_data(self, element: Element, written: list[Element]) -> tuple[Field, ...]:
        """What ``<donedata>`` gives the event of the compound state that is done (W3C SCXML 5.7)."""
        for child in written[1:]:
            what = "a second <donedata>"
            self._log.error("unknown-tag", child.position, child.tag, what, "write one of them")
        if written and element in self._root.children:
            what = "the machine has nobody to give data to when it is done"
            hint = MISPLACED["donedata"]
            self._log.error("unsupported-element", written[0].position, "donedata", what, hint)
            return ()
        return self._content.fields_of(written[0], "param") if written else ()

    def _blocks(self, elements: list[Element]) -> tuple[Statement, ...]:
        """The content of all ``<onentry>``, or ``<onexit>``, of a state; of several, each is a block."""
        found = [Block(self._content.block(item.children), item.position) for item in elements]
        filled = [block for block in found if block.body]
        return filled[0].body if len(filled) == 1 else tuple(filled)

    def _read_transitions(
        self, element: Element, state: str, index: int, parent: Element
    ) -> list[Transition]:
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
                internal=self._is_internal(element, parent),
            )
            for event in events
        ]

    def _is_internal(self, element: Element, parent: Element) -> bool:
        """Whether the transition is of a compound state, which is not exited for a state inside it."""
        kind = element.get("type")
        if kind not in ("", "internal", "external"):
            what = f"`{shortened(kind, _MAX_SHOWN)}` is no type of a transition"
            hint = "write internal or external"
            self._log.error("unknown-attribute", element.at("type"), element.tag, what, hint)
        return kind == "internal" and any(parent.all("state", "final"))

    def _goal_response(self, element: Element) -> list[Transition]:
        interface = self._content.interface_of(element, InterfaceKind.ACTION_CLIENT)
        found = []
        for attribute, kind in (
            ("accept", EventKind.GOAL_ACCEPTED),
            ("reject", EventKind.GOAL_REJECTED),
        ):
            target = require(element, attribute, self._log)
            self._names.check(target, element, attribute)
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
            self._names.check(written, element, "target")
            return (Target(written),)
        if "target" in element.attributes:
            what, hint = "the target is empty", "name a state, or leave the attribute out to stay"
            self._log.error("unknown-target", element.at("target"), element.tag, what, hint)
        targets = []
        left = 1.0
        for child in children:
            check_element(child, self._log)
            name = require(child, "id", self._log)
            self._names.check(name, child, "id")
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


def _to(target: str, position: Position, body: tuple[Statement, ...] = ()) -> Transition:
    return Transition(event=None, position=position, targets=(Target(target),), body=body)
