"""What a transition says, in a few words: its event, its guard, its actions.

Channels are named by as few of their last parts as tell them apart within the machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import StrEnum

import msgspec

from m2c.language.expressions import Expression, Literal
from m2c.language.text import expression_text
from m2c.model.machine import (
    Assign,
    Block,
    Cancel,
    Delay,
    Emit,
    Event,
    EventKind,
    Foreach,
    If,
    InterfaceKind,
    Log,
    Machine,
    OutputKind,
    Raise,
    Statement,
    Transition,
)


class Part(StrEnum):
    """What a line of a label is: they are set in different colours."""

    EVENT = "event"
    GUARD = "guard"
    ACTION = "action"


class Phrase(msgspec.Struct, frozen=True):
    """One thing a transition says; it is wrapped where it is drawn."""

    part: Part
    text: str


_EVENTS = {
    EventKind.MESSAGE: "message",
    EventKind.REQUEST: "request",
    EventKind.RESPONSE: "response",
    EventKind.CALL_ERROR: "failed call",
    EventKind.GOAL: "goal",
    EventKind.CANCEL: "cancel request",
    EventKind.GOAL_ACCEPTED: "goal accepted",
    EventKind.GOAL_REJECTED: "goal rejected",
    EventKind.FEEDBACK: "feedback",
    EventKind.SUCCEEDED: "succeeded",
    EventKind.ABORTED: "aborted",
    EventKind.CANCELED: "canceled",
    EventKind.GOAL_FAILED: "goal failed",
    EventKind.THREAD_START: "start of thread",
    EventKind.THREAD_FREE: "thread free",
    EventKind.BT_TICK: "tick",
    EventKind.BT_HALT: "halt",
    EventKind.BT_CHILD_STATUS: "status of child",
    EventKind.BT_CHILD_HALTED: "halted: child",
}
_OUTPUTS = {
    OutputKind.PUBLISH: "publish",
    OutputKind.REQUEST: "call",
    OutputKind.RESPONSE: "respond",
    OutputKind.SEND_GOAL: "send goal",
    OutputKind.SEND_CANCEL: "cancel goal",
    OutputKind.ACCEPT_GOAL: "accept goal",
    OutputKind.REJECT_GOAL: "reject goal",
    OutputKind.FEEDBACK: "feedback",
    OutputKind.SUCCEED: "succeed",
    OutputKind.ABORT: "abort",
    OutputKind.CANCEL: "goal canceled",
    OutputKind.START_THREAD: "start thread",
    OutputKind.THREAD_FREE: "free thread",
    OutputKind.BT_RETURN_STATUS: "return",
    OutputKind.BT_RETURN_HALTED: "return halted",
    OutputKind.BT_SET_OUTPUT: "set output",
    OutputKind.BT_TICK_CHILD: "tick child",
    OutputKind.BT_HALT_CHILD: "halt child",
}


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Each of ``names`` by as few of its last parts (between ``/``) as no other one ends in."""
    distinct = list(dict.fromkeys(names))
    found: dict[str, str] = {}
    for name in distinct:
        parts = name.strip("/").split("/")
        others = [f"/{other.strip('/')}" for other in distinct if other != name]
        for kept in range(1, len(parts) + 1):
            ending = "/".join(parts[-kept:])
            if not any(other.endswith(f"/{ending}") for other in others):
                break
        found[name] = ending if kept < len(parts) else name
    return found


class Wording:
    """The words of one machine."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._short = short_names(interface.name for interface in machine.interfaces)
        self._rates = {
            interface.name: interface.rate_hz
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.TIMER
        }

    def trigger(self, transition: Transition) -> list[Phrase]:
        """Event and guard; nothing for a transition that is taken at once and always."""
        phrases = []
        if transition.event is not None:
            phrases.append(Phrase(Part.EVENT, self.event(transition.event, transition.after_s)))
        if transition.cond is not None:
            phrases.append(Phrase(Part.GUARD, f"[{expression_text(transition.cond)}]"))
        return phrases

    def event(self, event: Event, after_s: float | None = None) -> str:
        """An event: ``request tick``, ``every 0.5 s (measure)``."""
        name = self._short.get(event.name, event.name)
        match event.kind:
            case EventKind.INTERNAL:
                return event.name
            case EventKind.AFTER:
                return f"after {after_s or 0:g} s"
            case EventKind.TIMER:
                rate = self._rates.get(event.name, 0.0)
                return f"every {1 / rate:.4g} s ({name})" if rate else f"timer {name}"
            case kind:
                return f"{_EVENTS[kind]} {name}".strip()

    def actions(self, statements: Sequence[Statement]) -> list[Phrase]:
        """What is done, a phrase for each statement; bodies of ``<if>`` are indented."""
        return [Phrase(Part.ACTION, text) for text in self._block(statements, "")]

    def _block(self, statements: Sequence[Statement], indent: str) -> list[str]:
        texts: list[str] = []
        for statement in statements:
            if isinstance(statement, Foreach):
                place = f", {statement.index}" if statement.index else ""
                head = f"for {statement.item}{place} in {expression_text(statement.array)}"
                texts += [f"{indent}{head}:", *self._block(statement.body, indent + "  ")]
                continue
            if isinstance(statement, Block):
                texts += self._block(statement.body, indent)
                continue
            if isinstance(statement, Delay):  # its transition says so
                continue
            if not isinstance(statement, If):
                texts.append(indent + self._statement(statement))
                continue
            word = "if"
            for condition, body in statement.branches:
                head = "else" if condition is None else f"{word} {expression_text(condition)}"
                texts += [f"{indent}{head}:", *self._block(body, indent + "  ")]
                word = "else if"
        return texts

    def _statement(self, statement: Assign | Emit | Raise | Cancel | Log) -> str:
        match statement:
            case Assign(location=location, value=value):
                return f"{expression_text(location)} := {expression_text(value)}"
            case Emit():
                return self._emit(statement)
            case Raise():
                return _raise(statement)
            case Cancel(id=id):
                return f"cancel {id}"
            case Log(label=label, value=value):
                shown = "" if value is None else expression_text(value)
                return f"log {label}{': ' if label and shown else ''}{shown}".rstrip()

    def _emit(self, emit: Emit) -> str:
        if emit.kind is OutputKind.BT_RETURN_STATUS:
            status = emit.fields[0].value
            return (
                f"return {status.value if isinstance(status, Literal) else expression_text(status)}"
            )
        name = self._short.get(emit.interface, emit.interface)
        arguments = [(field.name, field.value) for field in emit.fields]
        arguments += [
            (key, value)
            for key, value in (("goal_id", emit.goal_id), ("thread_id", emit.thread_id))
            if value is not None
        ]
        return f"{_OUTPUTS[emit.kind]} {name}".rstrip() + _arguments(arguments)


def _raise(statement: Raise) -> str:
    word = "send" if statement.external else "raise"
    arguments = _arguments([(field.name, field.value) for field in statement.fields])
    delay = ""
    if statement.delay_s is not None:
        delay = f" after {expression_text(statement.delay_s)} s"
    named = f" as {statement.id}" if statement.id else ""
    target = f" to {statement.target}" if statement.target else ""
    return f"{word} {statement.event}{arguments}{target}{delay}{named}"


def _arguments(arguments: Sequence[tuple[str, Expression]]) -> str:
    if not arguments:
        return ""
    inside = ", ".join(
        name if expression_text(value) == name else f"{name}: {expression_text(value)}"
        for name, value in arguments
    )
    return f" {{{inside}}}"
