"""Diagrams of machines, systems and policies: SVG, Mermaid and DOT."""

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
