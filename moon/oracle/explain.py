"""Explanations of violations, in the words of the model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from m2c.language.datatypes import Structure
from m2c.model.machine import EventKind, OutputKind
from m2c.model.scopes import output_data_type
from moon.oracle.bounds import TooManyError
from moon.oracle.differing import first_difference
from moon.oracle.search import Search
from moon.oracle.state import Hypothesis, Instances, Obligation
from moon.oracle.steps import TooOpenError
from moon.oracle.trace_events import Role, TraceEvent
from moon.verdict import Difference, Evidence, Explanation
from moon.wording import Wording, is_short, value_text

SHOWN = 4
"""So many possibilities are shown; more would hide the point."""


def described(fact: TraceEvent, wording: Wording, differences: Sequence[Difference] = ()) -> str:
    """An observation in one line; first what differs from what was expected, if all is too long."""
    observation = fact.observation
    kind = wording.kind(observation.type_name)
    data = ""
    if fact.data is not None:
        fields = dict.fromkeys(f"{item.path}: {item.observed}" for item in differences)
        data = _beginning_with(", ".join(fields), value_text(fact.data, kind))
    channel = observation.channel
    match fact.role:
        case Role.MESSAGE:
            return f"message on {channel}:{data}"
        case Role.INPUT if fact.event is not None and fact.event[0] is EventKind.MESSAGE:
            return f"message taken on {channel}:{data}"
        case Role.INPUT:
            assert fact.event is not None
            what = {
                EventKind.REQUEST: f"request {fact.call[1]} of {fact.call[0]} to",
                EventKind.RESPONSE: "response from",
                EventKind.CALL_ERROR: f"failed call ({observation.error}) of",
                EventKind.GOAL_FAILED: f"failed goal ({observation.error}) of",
            }.get(fact.event[0], f"{fact.event[0]} on")
            return f"{what} {channel}{data}"
        case Role.UNDECLARED:
            return (
                f"{observation.kind.replace('_', ' ')} on {channel}, which its model does not name"
            )
        case _ if fact.output is not None:
            return f"{_OUTPUTS[fact.output]} {channel}{data}"
        case _:
            return f"{observation.kind} on {channel}"


def _beginning_with(first: str, message: str) -> str:
    """A message that is shown; ``first``, what matters of it, stands before one that takes several lines."""
    return f" {message}" if not first or is_short(message) else f" {first} in {message}"


_OUTPUTS = {
    OutputKind.PUBLISH: "message on",
    OutputKind.REQUEST: "call of",
    OutputKind.RESPONSE: "response on",
    OutputKind.SEND_GOAL: "goal sent to",
    OutputKind.SEND_CANCEL: "cancel request to",
    OutputKind.ACCEPT_GOAL: "acceptance of a goal on",
    OutputKind.REJECT_GOAL: "rejection of a goal on",
    OutputKind.FEEDBACK: "feedback on",
    OutputKind.SUCCEED: "success of a goal on",
    OutputKind.ABORT: "abortion of a goal on",
    OutputKind.CANCEL: "cancellation of a goal on",
}


def survivors_of(search: Search, before: list[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
    """What may have been so just before ``fact``, after ``before``."""
    try:
        return search.reachable(before, fact.stamp, 0)
    except (TooManyError, TooOpenError):
        return before


def explanation_of(
    search: Search,
    survivors: list[Hypothesis],
    fact: TraceEvent | None,
    history: Iterable[TraceEvent],
) -> Explanation:
    """Why ``fact`` (None: that nothing came) cannot be after ``survivors``."""
    owed = [(h, h.owed[0]) for h in survivors if h.owed]
    expected: dict[str, None] = {}
    places: dict[str, None] = {}
    differences: dict[Difference, None] = {}
    for _, item in owed:
        difference = difference_from(search, item, fact)
        if difference is not None:
            differences[difference] = None
        expected[owed_text(search, item, difference)] = None
        places[str(item.transition)] = None
    if not owed:
        expected["nothing to be sent"] = None
    # what is owed is owed by a step that was taken: its state is the one before that
    befores = [before for h, item in owed for before in item.before or (h.instances,)]
    states = {
        state_text(search, instances): None
        for instances in befores or (h.instances for h in survivors)
    }
    observed = "nothing in time"
    channel = channel_of(search, owed[0][1]) if owed else ""
    if fact is not None:
        observed = described(fact, search.wording, tuple(differences)[:SHOWN])
        channel = fact.observation.channel
    return Explanation(
        tuple(expected)[:SHOWN],
        observed,
        tuple(states)[:SHOWN],
        tuple(Evidence(item.stamp, described(item, search.wording)) for item in history),
        tuple(places)[:SHOWN],
        channel,
        tuple(differences)[:SHOWN],
    )


def difference_from(search: Search, owed: Obligation, fact: TraceEvent | None) -> Difference | None:
    """The first field in which what was sent is not what was owed, where it is the same output."""
    if fact is None or fact.output is not owed.kind or fact.interface != owed.interface:
        return None
    return first_difference(owed.data, fact.data, data_type(search, owed))


def data_type(search: Search, owed: Obligation) -> Structure | None:
    """The type of the message that is owed."""
    program = search.program
    return output_data_type(owed.kind, owed.interface, program.machine, program.library)


def channel_of(search: Search, owed: Obligation) -> str:
    """The channel by which it is to leave."""
    return search.program.channel_of_output(owed.kind, owed.interface)


def owed_text(search: Search, owed: Obligation, difference: Difference | None = None) -> str:
    """What a machine owes, in one line; first the field in which what it sent differs, if all is too long."""
    channel = channel_of(search, owed)
    data = ""
    if owed.data is not None:
        first = "" if difference is None else f"{difference.path}: {difference.expected}"
        data = _beginning_with(first, value_text(owed.data, data_type(search, owed)))
    to = f" to {owed.call[0]}" if owed.call and owed.call[0] else ""
    return f"{_OUTPUTS[owed.kind]} {channel}{data}{to}"


def state_text(search: Search, instances: Instances) -> str:
    """State and data of a machine and its threads, in one line."""
    texts = []
    for program, (state, data) in zip(search.program.parts, instances, strict=True):
        values = ", ".join(
            f"{declared.name}={value_text(value, declared.type)}"
            for declared, value in zip(program.machine.data, data, strict=True)
            if declared.name in program.assigned and declared.name in program.live
        )
        texts.append(f"{program.states[state].name}{f' ({values})' if values else ''}")
    return " | ".join(texts)
