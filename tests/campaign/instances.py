"""Nodes that are instances of models: what such a model says, and what the system file puts in its place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from msgspec.structs import replace

from tests.campaign.elements import Element, e

if TYPE_CHECKING:
    from tests.campaign.plans import Model

_OTHER = {"int32": "77", "float64": "-0.25", "bool": "true", "string": "'another'"}
"""What the data of a model begins with, by type: an instance has another value."""
_CHANNELS = ("topic", "service_name", "action_name")
_DATA = "datamodel"
_MODELLED = "/modelled"


def modelled(root: Element) -> Element:
    """The model of which the machine ``root`` is an instance."""
    channels = _channels(root)

    def other(element: Element) -> Element:
        attributes = tuple(
            (key, _MODELLED + value if value in channels else value)
            for key, value in element.attributes
        )
        children = tuple(map(other, element.children))
        return replace(element, attributes=attributes, children=children)

    def begins_otherwise(child: Element) -> Element:
        return child.holding(*map(_otherwise, child.children)) if child.tag == _DATA else child

    made = other(root)
    named = tuple(
        (key, f"{value}Model" if key == "name" else value) for key, value in made.attributes
    )
    return replace(made, attributes=named, children=tuple(map(begins_otherwise, made.children)))


def _channels(root: Element) -> dict[str, None]:
    """What ``root`` declares."""
    return dict.fromkeys(
        value for item in root.all() for key, value in item.attributes if key in _CHANNELS
    )


def _otherwise(data: Element) -> Element:
    if not _is_given(data):
        return data
    attributes = tuple(
        (key, _OTHER[data.get("type")] if key == "expr" else value)
        for key, value in data.attributes
    )
    return replace(data, attributes=attributes)


def _is_given(data: Element) -> bool:
    return bool(data.get("expr")) and data.get("type") in _OTHER


def instance(model: Model, node: Element) -> Element:
    """``node``, the ``<input>`` of ``model``, as the instance that behaves as ``model`` does."""
    attributes = (*node.attributes, ("name", model.name))
    return replace(node, attributes=attributes, children=tuple(_changes(model.root)))


def _changes(root: Element) -> Iterator[Element]:
    for child in root.children:
        for data in child.children if child.tag == _DATA else ():
            if _is_given(data):
                yield e("param", name=data.get("id"), expr=data.get("expr"))
    for channel in _channels(root):
        yield Element("remap", (("from", _MODELLED + channel), ("to", channel)))
