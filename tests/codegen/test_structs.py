"""Declared structures and columns of arrays of structures: generated code and the oracle mean the same."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

import m2c
import moon
from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog
from tests.codegen.quality import formatted, strictly_typed
from transports import Observation, SimulatedWorld

TYPES = """<types>
  <struct id="Stop"><member id="place" type="string"/><member id="x" type="float32"/>
    <member id="Visits" type="int8"/></struct>
  <struct id="Route"><member id="stops" type="Stop[]"/></struct>
</types>"""
DATA = """
<data id="home" type="Stop" expr="{'place': 'home', 'x': 0.5, 'Visits': 1}"/>
<data id="route" type="Route" expr="{'stops': [{'place': 'a', 'x': 1}, {'place': 'b', 'x': 2}]}"/>
<data id="routes" type="Route[]" expr="[{'stops': []}]"/>
<data id="few" type="Stop[2]" expr="[]"/>
<data id="grid" type="int32[][2]" expr="[[1], [2, 3], []]"/>
<data id="xs" type="float32[]" expr="[]"/>
<data id="n" type="int32" expr="0"/>
"""
MODEL = """<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="Planner" initial="wait">
<ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32MultiArray"/>
<ros_time_rate name="clock" rate_hz="1"/>
<datamodel>{data}</datamodel>
<state id="wait"><ros_rate_callback name="clock" target="wait">{content}</ros_rate_callback></state>
</ascxml>"""


def written(folder: Path, content: str) -> Path:
    (folder / "planner.ascxml").write_text(MODEL.format(data=DATA, content=content))
    (folder / "types.xml").write_text(TYPES)
    path = folder / "system.xml"
    path.write_text(
        '<roaml><data_declarations><input type="xml" src="types.xml"/></data_declarations>'
        '<node_models><input type="node-ascxml" src="planner.ascxml"/></node_models></roaml>'
    )
    return path


def assign(location: str, value: str) -> str:
    return f"<assign location={quoteattr(location)} expr={quoteattr(value)}/>"


def publish(**fields: str) -> str:
    given = "".join(
        f"<field name={quoteattr(name.replace('__', '.'))} expr={quoteattr(value)}/>"
        for name, value in fields.items()
    )
    return f'<ros_topic_publish name="out">{given}</ros_topic_publish>'


def ran(folder: Path, content: str) -> list[object]:
    """What the model's node publishes in one second; the monitor finds that it does as its model."""
    system = m2c.read_system(written(folder, content))
    world = SimulatedWorld(seed=1)
    seen: list[Observation] = []
    monitor = moon.Monitor(world.connect("monitor"), system)
    monitor.start()
    world.connect("tap").tap(["/out"], seen.append)
    world.run_for(0.01)
    m2c.simulate(system, world).run(1.5)
    assert monitor.violations == 0, monitor.problems()
    assert [status.verdict for status in monitor.statuses()] == ["conforming"]
    return [event.data["data"] for event in seen if event.kind == "message"]


def test_structures_and_columns_are_read(tmp_path: Path) -> None:
    values = {
        "route.stops.length": 2,
        "route.length": 2,  # of a structure that is one array
        "routes[0].length": 0,
        "few.length": 0,
        "home.Visits": 1,
        "home.x == 0.5 ? 1 : 0": 1,
        "route.stops[1].place == 'b' ? 1 : 0": 1,
        "grid[1][1]": 3,
        "grid.length": 3,
        "grid[2].length": 0,
        "route.stops.x[1] == 2 ? 1 : 0": 1,
        "route.stops.place.length": 2,
        "route.stops.Visits[0]": 0,
        "routes.stops.length": 1,
        "routes[0].stops.x.length": 0,
    }
    (got,) = ran(tmp_path, publish(data=f"[{', '.join(values)}]"))
    assert dict(zip(values, got, strict=True)) == values


def test_structures_and_columns_are_assigned(tmp_path: Path) -> None:
    statements = [
        assign("home.x", "2.5"),
        assign("route.stops[2]", "home"),
        assign("home.x", "7"),  # the one in the array is a copy
        assign("route.stops.Visits", "[1, 2, 3]"),
        assign("routes[1]", "route"),
        assign("routes[1].stops.x", "[4, 5, 6]"),
        assign("few.x", "[1.5, 2.5]"),
        assign("few[0]", "routes[1].stops[2]"),
        assign("xs", "routes[1].stops.x"),
    ]
    values = {
        "route.stops.length": 3,
        "route.stops[2].x == 2.5 ? 1 : 0": 1,
        "route.stops.Visits[2]": 3,
        "routes[1].stops[0].Visits": 1,
        "xs[2] == 6 ? 1 : 0": 1,
        "few[0].x == 6 ? 1 : 0": 1,
        "few[1].x == 2.5 ? 1 : 0": 1,
        "few.length": 2,
        "route.stops[0].x == 1 ? 1 : 0": 1,
    }
    (got,) = ran(tmp_path, "".join(statements) + publish(data=f"[{', '.join(values)}]"))
    assert dict(zip(values, got, strict=True)) == values


def test_an_assignment_that_does_not_fit_ends_its_block(tmp_path: Path) -> None:
    blocks = [
        assign("route.stops.x", "[1]"),  # of another length
        assign("route.stops[2]", "home") + assign("few.x", "route.stops.x"),  # more than fit
        assign("few[route.length]", "home"),
        assign("xs", "routes[3].stops.x"),  # of undefined
    ]
    for block in blocks:
        assert ran(tmp_path, block + publish(data="[1]")) == [], block


def test_columns_of_a_message_are_set_by_fields(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        publish(
            data="route.stops.Visits",
            layout__dim__label="route.stops.place",
            layout__dim__size="[1, 2]",
            layout__data_offset="4",
        ),
    )
    system = m2c.read_system(path)
    world = SimulatedWorld(seed=1)
    seen: list[Observation] = []
    monitor = moon.Monitor(world.connect("monitor"), system)
    monitor.start()
    world.connect("tap").tap(["/out"], seen.append)
    m2c.simulate(system, world).run(1.5)
    assert seen[0].data["layout"] == {
        "data_offset": 4,
        "dim": [
            {"label": "a", "size": 1, "stride": 0},
            {"label": "b", "size": 2, "stride": 0},
        ],
    }
    assert [status.verdict for status in monitor.statuses()] == ["conforming"]


def test_columns_of_different_lengths_are_no_message(tmp_path: Path) -> None:
    fields = {"layout__dim__label": "route.stops.place", "layout__dim__size": "[1]"}
    assert ran(tmp_path, publish(data="[1]", **fields)) == []


def test_generated_code_for_structures_is_typed_and_formatted(tmp_path: Path) -> None:
    content = (
        assign("route.stops.x", "xs") + assign("xs", "route.stops.x") + assign("few[1]", "home")
    )
    system = m2c.read_system(written(tmp_path, content + publish(data="[route.length]")))
    generated = tmp_path / "generated"
    m2c.generate(system, generated)
    formatted(generated)
    strictly_typed(generated, [generated / "planner"])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (assign("route.length", "3"), "the length of Route cannot be assigned; assign that of its array: .stops.length [bad-location]"),
        (assign("xs", "route.stops.y"), "Stop has no field `y`; known: Visits, place, x [unknown-field]"),
        (assign("xs", "route.stops.place"), "a value of type string[] where float32[] is declared; a value of type float32[] is needed [type-mismatch]"),
        (assign("xs", "routes.stops.x"), "a value of type Stop[][] has no `x`; it has `length` [unknown-field]"),
        (publish(layout__dim__lable="[]"), "std_msgs/msg/MultiArrayDimension[] has no field `lable`; did you mean label? [unknown-field]"),
        (publish(layout__dim="[]", layout__dim__label="[]"), "`layout.dim.label` is set twice [duplicate-field]"),
    ],
)  # fmt: skip
def test_a_fault_with_a_structure_or_column_is_one_error(
    tmp_path: Path, content: str, expected: str
) -> None:
    log = DiagnosticLog()
    read_and_check([written(tmp_path, content)], [], log)
    found = [str(item) for item in log.diagnostics if item.severity == "error"]
    assert len(found) == 1, found
    assert found[0].endswith(f">: {expected}")
