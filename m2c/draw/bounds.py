"""How much a picture can show: who asks for more is told so, instead of waiting for it."""

from __future__ import annotations

MAX_NODES = 2_000
"""Of a policy's tree: sub-trees in sub-trees can make it grow exponentially."""
MAX_ITEMS = 20_000
"""Of a layout: boxes, labels, and a place for each link in every layer that it passes. The largest
machine of the lab tour has 48; a picture of so many takes seconds and is wider than any screen."""
ALL_EFFORT = 3_000
"""A layout of more items is made in one direction only, and improved less often."""


class TooLargeError(Exception):
    """More than a picture can show; the text says what, and what would be right."""
