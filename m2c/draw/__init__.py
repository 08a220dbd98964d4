"""Diagrams of machines, systems and policies: SVG, Mermaid and DOT.

The names below are loaded when they are first used: ``m2c draw --help`` draws nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from m2c.draw.diagram import transition_keys
    from m2c.draw.machine import draw_machine
    from m2c.draw.policy import draw_policy, leaf_keys, tree_of
    from m2c.draw.svg import Picture, document, inline
    from m2c.draw.wiring import draw_wiring, wiring_of

__all__ = [
    "Picture",
    "document",
    "draw_machine",
    "draw_policy",
    "draw_wiring",
    "inline",
    "leaf_keys",
    "transition_keys",
    "tree_of",
    "wiring_of",
]

_HOMES = {
    "Picture": "svg",
    "document": "svg",
    "draw_machine": "machine",
    "draw_policy": "policy",
    "draw_wiring": "wiring",
    "inline": "svg",
    "leaf_keys": "policy",
    "transition_keys": "diagram",
    "tree_of": "policy",
    "wiring_of": "wiring",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
