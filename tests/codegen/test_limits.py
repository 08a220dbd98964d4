"""What the check accepts runs, whatever the values: see ``tests.codegen.limits``."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.codegen.limits import Writer, run
from tests.drawn import examples

MODELS = examples(50, 500)


@settings(
    max_examples=MODELS,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
@given(draw=st.randoms(use_true_random=False), seed=st.integers(0, 2**16))
def test_what_the_check_accepts_runs_and_conforms_at_the_limits_of_its_types(
    draw: Random, seed: int
) -> None:
    found = run(Writer(draw).machine(), seed)
    assume(found.accepted)
    assert found.problems == ()
    assert found.published >= 3


def test_the_random_machines_are_mostly_accepted_and_meet_faults() -> None:
    found = [run(Writer(Random(seed)).machine(), seed) for seed in range(40)]
    assert sum(item.accepted for item in found) >= 20
    assert sum(bool(item.faults) for item in found) >= 5
    assert not any(item.problems for item in found)


MODEL = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Limits">
<ros_topic_subscriber topic="/in" type="limits/Values"/>
<ros_topic_publisher topic="/out" type="limits/Values"/>
<ros_time_rate name="clock" rate_hz="10"/>
<datamodel><data id="n" type="int32" expr="7"/><data id="values" type="int32[]" expr="[1, 2]"/>
<data id="after" type="int32"/><data id="faults" type="int32"/></datamodel>
<state id="a"><ros_topic_callback name="/in">{}<assign location="after" expr="after + 1"/>
</ros_topic_callback><ros_rate_callback name="clock"><ros_topic_publish name="/out">
<field name="i32" expr="n"/><field name="i64" expr="after"/><field name="faults" expr="faults"/>
<field name="b" expr="n > 0"/></ros_topic_publish></ros_rate_callback>
<transition event="error.execution"><assign location="faults" expr="faults + 1"/></transition></state></scxml>"""


@pytest.mark.parametrize(
    ("value", "n", "fails"),
    [
        ("values[5]", 7, True),
        ("values[0]", 1, False),
        ("n * 3 - 1000000000", -1000000000 + 7 * 3, False),
        ("n * 2147483647", 2**31 - 7, False),
        ("_msg.f64", None, None),  # refused: a float where an integer is declared
        ("Math.floor(_msg.f64 * 0 - 1 / 0 * 0)", 7, True),
        ("n % (n - 7)", 7, True),
        ("_msg.s || n", None, None),
    ],
)  # fmt: skip
def test_an_assignment_wraps_fails_or_is_refused(
    value: str, n: int | None, fails: bool | None
) -> None:
    found = run(MODEL.format(f'<assign location="n" expr="{value}"/>'), 1, events=1)
    assert found.problems == ()
    assert found.accepted is (n is not None)
    if n is not None:
        assert found.last["i32"] == n
        assert found.faults == int(bool(fails))
        assert found.last["i64"] == int(not fails)  # the error ends the block
