"""Recognising plugins that only pass a tick on to a skill, so that the runner can call the skill.

That saves two thread switches a tick, and a failed call, which such a plugin does not handle, does
not leave it waiting for an answer for ever. Recognised by what the machine does, not by its name.
"""

from __future__ import annotations

from m2c.language.expressions import Binary, EventData, Expression, Literal, Member, Variable
from m2c.model.machine import Emit, EventKind, InterfaceKind, Machine, OutputKind, Transition

ANSWERS = {"SUCCESS": 0, "FAILURE": 1, "RUNNING": 2}
"""SKILL_SUCCESS, SKILL_FAILURE and SKILL_RUNNING of ConditionResponse and ActionResponse."""


def only_forwards(plugin: Machine) -> bool:
    """Whether ``plugin`` does nothing but call one service and return its ``status`` unchanged."""
    if len(plugin.interfaces) != 1 or plugin.interfaces[0].kind is not InterfaceKind.CLIENT:
        return False
    if any(state.on_entry or state.on_exit for state in plugin.states):
        return False
    transitions = [transition for state in plugin.states for transition in state.transitions]
    values = {data.name: data.initial for data in plugin.data}
    return bool(transitions) and all(_forwards(found, values) for found in transitions)


def _forwards(transition: Transition, values: dict[str, Expression]) -> bool:
    if transition.event is None or len(transition.body) != 1 or len(transition.targets) != 1:
        return False
    target, emit = transition.targets[0], transition.body[0]
    if target.body or target.probability is not None or not isinstance(emit, Emit):
        return False
    if transition.event.kind is EventKind.BT_TICK:
        return emit.kind is OutputKind.REQUEST and transition.cond is None and not emit.fields
    if transition.event.kind is not EventKind.RESPONSE:
        return False
    if emit.kind is not OutputKind.BT_RETURN_STATUS or len(emit.fields) != 1:
        return False
    status = emit.fields[0].value
    return (
        isinstance(status, Literal)
        and isinstance(status.value, str)
        and status.value in ANSWERS
        and _compared_status(transition.cond, values) == ANSWERS[status.value]
    )


def _compared_status(cond: Expression | None, values: dict[str, Expression]) -> object:
    """``n`` where ``cond`` is ``_res.status == n``, else None."""
    match cond:
        case Binary(
            operator="==" | "===", left=Member(object=EventData(), name="status"), right=to
        ):
            value = values.get(to.name) if isinstance(to, Variable) else to
            return value.value if isinstance(value, Literal) else None
        case _:
            return None
