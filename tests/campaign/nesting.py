"""Machines with compound states: those of a plan, with their states in two groups."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from tests.campaign.elements import Element, e
from tests.campaign.plans import Plan, Spelling

_COUNTED = "crossed"


def nested(plan: Plan) -> Plan:
    """The same system, of which each machine with more than one state has compound states.

    A group counts how often it is entered and left. One of a single state has that one's transitions. From the
    second group some lead to where the first was left.
    """
    models = tuple(
        model
        if model.spelling is Spelling.PLAIN or model.is_plugin
        else replace(model, root=_nested(model.root))
        for model in plan.models
    )
    return replace(plan, models=models)


def _nested(root: Element) -> Element:
    states = [child for child in root.children if child.tag == "state"]
    if len(states) < 2:
        return root
    half = (len(states) + 1) // 2
    first = _group("first", states[:half])
    first = first.holding(
        e("history", e("transition", target=states[0].get("id")), id="as_before", type="shallow"),
        *first.children,
    )
    second = _led_back(
        _group("second", states[half:]), {state.get("id") for state in states[:half]}
    )
    children: list[Element] = []
    for child in root.children:
        if child.tag == "datamodel":
            data = e("data", id=_COUNTED, type="int32", expr=0)
            children.append(child.holding(*child.children, data))
        elif child.tag != "state":
            children.append(child)
        elif child is states[0]:
            children += (first, second)
    return root.holding(*children)


def _group(name: str, states: Sequence[Element]) -> Element:
    inner, handled = list(states), []
    if len(states) == 1:
        (state,) = states
        kept = [child for child in state.children if child.tag in ("onentry", "onexit")]
        handled = [child for child in state.children if child not in kept]
        inner = [state.holding(*kept)]
    count = e("assign", location=_COUNTED, expr=f"({_COUNTED} + 1) % 7")
    return e(
        "state",
        e("onentry", count),
        *inner,
        *handled,
        e("onexit", count),
        id=name,
        initial=states[0].get("id"),
    )


def _led_back(element: Element, names: set[str]) -> Element:
    """``element``, in which every second transition to one of ``names`` leads to the last of them."""
    seen = 0

    def led(item: Element) -> Element:
        nonlocal seen
        attributes = dict(item.attributes)
        if attributes.get("target") in names:
            seen += 1
            if seen % 2:
                attributes["target"] = "as_before"
        children = tuple(map(led, item.children))
        return replace(item, attributes=tuple(attributes.items()), children=children)

    return led(element)
