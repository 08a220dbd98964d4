"""Compound states and history: generated code and the interpreter do what W3C's algorithm does on the tree."""

from __future__ import annotations

import itertools
import random
from pathlib import Path

import pytest

from tests.w3c.both import Both
from tests.w3c.nested import Algorithm, Endless, Made

COUNT = 25


@pytest.mark.parametrize("first", range(0, 1000 * COUNT, 1000))
def test_a_machine_made_at_random_goes_as_w3c_says(first: int, tmp_path: Path) -> None:
    for seed in itertools.count(first):  # one that comes to rest after each event
        made, draw = Made(seed), random.Random(seed)
        events = [draw.choice("aaabbbcccw") for _ in range(40)]
        try:
            right = Algorithm(made)
            states = [right.state]
            for event in events:
                if event == "w":
                    right.wait(1200)
                else:
                    right.take(event)
                states.append(right.state)
        except Endless:
            continue
        break
    both = Both(tmp_path, made.text())
    found = [both.state]
    for event in events:
        if event == "w":
            both.wait(1.2)
        else:
            both.send(event)
        found.append(both.state)
    assert both.said == right.said
    assert found == states
