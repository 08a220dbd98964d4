"""Marks in models: which statement failed, and when its error was processed, becomes a value."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from msgspec.structs import replace

from m2c.model.vocabulary import EXECUTABLE
from tests.campaign.elements import Element, e
from tests.campaign.plans import Plan, Spelling

_OUTER = ("state", "final", "ros_action_thread")
ARRAY = "numbers"
MARK, TRAIL = "mark_", "trail_"


def marked(plan: Plan) -> Plan:
    """The same system, each machine of which keeps the number of the statement that it is at, and a trail of
    the numbers at which errors were processed."""
    numbers = itertools.count(1)
    models = tuple(
        model
        if model.spelling is Spelling.PLAIN
        else replace(model, root=_machine(model.root, numbers))
        for model in plan.models
    )
    return replace(plan, models=models)


def in_blocks(plan: Plan) -> Plan:
    """The same system, of which each statement on entry and exit is in an element of its own."""
    models = tuple(replace(model, root=_in_blocks(model.root)) for model in plan.models)
    return replace(plan, models=models)


def _in_blocks(root: Element) -> Element:
    children: list[Element] = []
    for child in root.children:
        if child.tag in ("onentry", "onexit"):
            children += (child.holding(item) for item in child.children)
        else:
            children.append(_in_blocks(child) if child.tag in _OUTER else child)
    return root.holding(*children)


def looped(plan: Plan, array: str = ARRAY) -> Plan:
    """The same system, in which machines assign in loops over ``array``: a literal, or their variable of that
    name.
    """
    models = tuple(replace(model, root=_looped(model.root, array)) for model in plan.models)
    return replace(plan, models=models)


def _looped(root: Element, array: str) -> Element:
    names = {item.get("id") for child in root.children for item in child.children}
    is_there = array != ARRAY or array in names
    children = []
    for child in root.children:
        if child.tag == "ros_action_thread":
            children.append(_looped(child, array))
        else:
            children.append(_with_loops(child, array) if is_there else child)
    return root.holding(*children)


def _with_loops(block: Element, array: str) -> Element:
    if block.tag == "assign":
        return e("foreach", block, array=array, item="each_", index="place_")
    return block.holding(*(_with_loops(child, array) for child in block.children))


def _machine(root: Element, numbers: Iterator[int]) -> Element:
    children = [
        _machine(child, numbers) if child.tag == "ros_action_thread" else _state(child, numbers)
        for child in root.children
    ]
    data = [e("data", id=name, type="int32", expr="0") for name in (MARK, TRAIL)]
    if not any(child.tag == "datamodel" for child in children):
        children.insert(0, e("datamodel"))
    return root.holding(
        *(
            child.holding(*child.children, *data) if child.tag == "datamodel" else child
            for child in children
        )
    )


def _state(state: Element, numbers: Iterator[int]) -> Element:
    """With a trail of its errors; that is read, else nobody would keep it."""
    if state.tag != "state":
        return state
    kept = e("assign", location=TRAIL, expr=f"({TRAIL} * 31 + {MARK}) % 65521")
    seen = [_block(child, numbers) for child in state.children]
    handled = [item for item in seen if item.get("event") == "error.execution"]
    if handled:
        seen = [i.holding(kept, *i.children) if i in handled else i for i in seen]
    else:
        seen.append(e("transition", kept, event="error.execution"))
    return state.holding(*seen, e("transition", event="never_", cond=f"{TRAIL} == -1"))


def _block(block: Element, numbers: Iterator[int]) -> Element:
    children: list[Element] = []
    for child in block.children:
        if child.tag in EXECUTABLE:
            children.append(e("assign", location=MARK, expr=next(numbers)))
        children.append(_block(child, numbers) if child.tag == "if" else child)
    return block.holding(*children)
