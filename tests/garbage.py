"""How often a process that runs tests looks for garbage.

By default Python looks after every 700 allocations, among all that a test file has imported too: a trial that
follows many hypotheses, which are many objects and no cycles, spent half of its time so.
"""

from __future__ import annotations

import gc

ALLOCATIONS = 50_000
"""Garbage is looked for after so many."""


def look_seldom() -> None:
    """From now on look seldom, and never among what is there already: modules, and the tests themselves."""
    gc.freeze()
    gc.set_threshold(ALLOCATIONS)
