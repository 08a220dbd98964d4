"""Where a node numbers each channel by itself, its reports on one may come seconds after those on another."""

from __future__ import annotations

from random import Random

import pytest
from msgspec.structs import replace

from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from tests.oracle.agreement import accusations, bounds_of
from tests.oracle.machines import NAME, library
from tests.oracle.strategies import case
from transports.interface import ObservationKind

pytestmark = pytest.mark.slow

MS = 1_000_000
CASES = 400
BLOCKS = 4
STEP_NS = 20 * MS


def _accused(seed: int) -> str:
    """What the machine's node reports on one channel of calls comes up to 4 s late, but for the first of it."""
    draw = Random(seed)
    found = case(draw, perturb=False)
    seen = [replace(item, received_ns=item.stamp_ns) for item in found.trace.observations]
    own: dict[str, list[int]] = {}
    for item in seen:
        if item.source == NAME and item.kind is not ObservationKind.MESSAGE:
            own.setdefault(item.channel, []).append(item.stamp_ns)
    own = {channel: stamps for channel, stamps in own.items() if len(stamps) > 1}
    if not own:
        return ""
    slow = draw.choice(sorted(own))
    first_ns = draw.choice(own[slow][1:])
    arrived_ns = draw.randint(0, 4_000) * MS + first_ns
    seen = [
        replace(item, received_ns=max(item.received_ns, arrived_ns))
        if item.channel == slow and item.source == NAME and item.stamp_ns >= first_ns
        else item
        for item in seen
    ]
    shared = Shared()
    shared.losses.by_channel = True
    oracle = Oracle(found.machine, library(), bounds=bounds_of(found), shared=shared)
    oracle.start(0, whole=True)
    received = sorted(seen, key=lambda item: (item.received_ns, item.stamp_ns))
    until_ns = received[-1].received_ns + found.latency_ns
    wrong = accusations(oracle, received, STEP_NS, until_ns)
    return f"seed {seed}: {wrong[0]}\n{slow} until {arrived_ns}\n{found}" if wrong else ""


@pytest.mark.parametrize("block", range(BLOCKS))
def test_a_node_is_not_accused_by_reports_that_are_late_on_one_channel(block: int) -> None:
    size = CASES // BLOCKS
    wrong = [text for seed in range(block * size, (block + 1) * size) if (text := _accused(seed))]
    assert not wrong, f"{len(wrong)} of {size}\n{wrong[0]}"
