"""``Array.from``: what generated code makes of it is what the oracle expects, each element in its range."""

from __future__ import annotations

from typing import Any

import pytest

from m2c.language.conversion import to_float32
from m2c.model import Machine
from moon.oracle.program import MachineProgram
from moon.oracle.unknowns import agree
from moon.wording import number_text
from tests.oracle.machines import library, read

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Lidar" initial="a">'
"""A model of somebody else's driver: it publishes as it begins."""


def machine(ranges: str, data: str = "") -> Machine:
    ranges = ranges.replace("<", "&lt;").replace(">", "&gt;")
    return read(
        f'{HEAD}<ros_topic_publisher name="scan" topic="/scan" type="sensor_msgs/LaserScan"/>'
        f"<datamodel>{data}</datamodel><state id='a'><onentry>"
        f'<ros_topic_publish name="scan"><field name="ranges" expr="{ranges}"/></ros_topic_publish>'
        "</onentry></state></scxml>"
    )


def conforms(model: Machine, ranges: list[Any]) -> bool:
    """Whether the model may publish ``ranges`` as it begins."""
    program = MachineProgram(model, library())
    kind = library().message("sensor_msgs/LaserScan").field("ranges")
    sent = [
        output.fields["ranges"]
        for _, step in program.start(program.initial_data())
        for output in step.outputs
    ]
    assert len(sent) < 4
    received = [to_float32(item) for item in ranges]
    return any(agree(expected, received, kind) for expected in sent)


FREE = "Array.from({length: 360}, () => 0.1 + Math.random() * 3.4)"
OR_NOTHING = "Array.from({length: 360}, () => Math.random() < 0.1 ? Infinity : 0.5 + Math.random())"
ANY_OF = "Array.from({length: 3}, () => Math.random() < 0.3 ? 1 : Math.random() < 0.5 ? 2.5 : 7)"
BY_INDEX = "Array.from({length: 3}, (_, i) => i + Math.random() / 2)"


@pytest.mark.parametrize(
    ("ranges", "observed", "holds"),
    [
        (FREE, [0.1] * 360, True),
        (FREE, [0.1, 3.5] * 180, True),
        (FREE, [0.2] * 359, False),
        (FREE, [0.2] * 361, False),
        (FREE, [0.2] * 359 + [3.6], False),
        (FREE, [0.2] * 359 + [float("nan")], False),
        (OR_NOTHING, [0.75, float("inf")] * 180, True),
        (OR_NOTHING, [0.75, 2.0] * 180, False),
        (OR_NOTHING, [float("-inf")] * 360, False),
        (ANY_OF, [1.0, 2.5, 7.0], True),
        (ANY_OF, [1.0, 2.0, 7.0], False),
        (BY_INDEX, [0.25, 1.25, 2.25], True),
        (BY_INDEX, [0.25, 0.25, 2.25], False),
        ("Array.from({length: 3}, (_, i) => i * i)", [0.0, 1.0, 4.0], True),
        ("Array.from({length: 3}, (_, i) => i * i)", [0.0, 1.0, 5.0], False),
        ("Array.from({length: n}, () => x)", [0.5, 0.5], True),
        ("Array.from({length: n}, () => x)", [0.5], False),
        ("Array.from({length: 1 + Math.floor(Math.random() * 2)}, () => x)", [0.5], True),
        ("Array.from({length: 1 + Math.floor(Math.random() * 2)}, () => x)", [0.5, 0.5], True),
        ("Array.from({length: 1 + Math.floor(Math.random() * 2)}, () => x)", [0.5] * 3, False),
    ],
)
def test_a_message_conforms_if_its_length_and_each_element_fit(
    ranges: str, observed: list[float], holds: bool
) -> None:
    data = '<data id="n" type="int32" expr="2"/><data id="x" type="float64" expr="0.5"/>'
    assert conforms(machine(ranges, data), observed) is holds


@pytest.mark.parametrize(
    ("length", "count"),
    [("n", 2), ("n - 5", 0), ("n / 0", None), ("n * 1000000", None), ("f", 2), ("0 * n / 0", 0)],
)
def test_a_length_is_truncated_or_fails(length: str, count: int | None) -> None:
    data = '<data id="n" type="int32" expr="2"/><data id="f" type="float64" expr="2.9"/>'
    model = machine(f"Array.from({{length: {length}}}, () => 1)", data)
    program = MachineProgram(model, library())
    [(_, step)] = program.start(program.initial_data())
    lengths = [len(output.fields["ranges"]) for output in step.outputs]
    assert lengths == ([] if count is None else [count])


def test_elements_drawn_are_told_apart_and_remembered() -> None:
    """What one element is found to be says nothing of the others."""
    model = machine("a", f'<data id="a" type="float32[3]" expr="{BY_INDEX}"/>')
    program = MachineProgram(model, library())
    [(_, step)] = program.start(program.initial_data())
    first, second, third = step.outputs[0].fields["ranges"]
    assert [number_text(item.low) for item in (first, second, third)] == ["0", "1", "2"]
    assert len({id(item) for item in (first, second, third)}) == 3
