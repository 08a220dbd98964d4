"""What monitors of the same properties share: what they are made of, and nothing of what they have seen."""

from __future__ import annotations

import pytest

from moon.properties import PropertySet
from moon.properties.group_plan import plans_of
from moon.properties.property import Status
from tests.properties.runs import seen

TEXT = """\
ports:
  ask: {topic: /ask}
  answer: {topic: /answer}
  level: {topic: /level, field: value}
properties:
  - id: answered
    pattern: response
    request: ask
    response: answer
    within: 1 s
  - id: low
    pattern: absence
    of: level > 3
"""


def statuses(monitors: PropertySet) -> dict[str, Status]:
    return {name: verdict.status for name, verdict in monitors.verdicts().items()}


def test_the_same_properties_are_compiled_once() -> None:
    properties = PropertySet.from_text(TEXT).properties
    assert plans_of(properties) is plans_of(list(properties))


def test_equal_properties_that_were_read_twice_are_others() -> None:
    one, other = (PropertySet.from_text(TEXT).properties for _ in range(2))
    assert plans_of(one) is not plans_of(other)


@pytest.mark.parametrize("is_lost", [False, True])
def test_what_one_set_has_seen_is_unknown_to_another(is_lost: bool) -> None:
    one = PropertySet.from_text(TEXT)
    other = PropertySet(one.properties)
    for monitors in (one, other):
        monitors.observe(seen(10, "/level", value=1))
        monitors.advance(20)
    if is_lost:
        one.lose("/level", 21, 30)
    one.observe(seen(40, "/ask"))
    one.observe(seen(50, "/level", value=5))
    one.advance(2_000_000_000)
    assert set(statuses(one).values()) == {Status.FALSE}
    other.advance(2_000_000_000)
    assert set(statuses(other).values()) == {Status.TRUE}
