"""What a node's variables begin with, as its launcher says it: ROS 2's parameters, here without ROS 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from m2c.model import DiagnosticLog, load
from m2c.simulation.program import compile_node
from m2c.simulation.semantics import Semantics
from transports.interface import TransportError
from transports.simulated import SimulatedTransport, SimulatedWorld

MODEL = """<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="Go" initial="a">
<ros_time_rate name="t" rate_hz="1"/>
<datamodel>
  <data id="poi" type="int8" expr="1"/>
  <data id="count" type="int32" expr="poi * 2"/>
  <data id="speed" type="float32" expr="0.5"/>
  <data id="name" type="string" expr="'x'"/>
  <data id="is_on" type="bool" expr="false"/>
  <data id="few" type="int16[&lt;=3]" expr="[]"/>
  <data id="pair" type="float64[2]" expr="[1, 2]"/>
  <data id="at" type="geometry_msgs/Point" expr="{}"/>
  <data id="class" type="int32" expr="7"/>
</datamodel>
<state id="a"><ros_rate_callback name="t">
  <assign location="count" expr="count + poi"/>
  <assign location="speed" expr="speed + 1"/>
  <assign location="is_on" expr="name == 'y'"/>
  <assign location="pair[0]" expr="class"/>
  <assign location="few[0]" expr="1"/>
</ros_rate_callback></state></ascxml>"""

ATTRIBUTES = {
    **{name: name for name in ("poi", "count", "speed", "name", "is_on", "few", "pair")},
    "class": "data_class",
}
"""What the class of the machine calls its variables."""


class Launched(SimulatedTransport):
    """A transport on which a launcher has set values."""

    values: dict[str, object]
    asked: list[str]

    def parameter(self, name: str, default: float, meaning: str) -> float:
        return default

    def given(self, name: str, meaning: str) -> object:
        self.asked.append(name)
        return self.values.get(name)


def machine(folder: Path, **values: object) -> Any:
    (folder / "Go.ascxml").write_text(MODEL)
    log = DiagnosticLog()
    system = load([folder / "Go.ascxml"], log)
    assert system is not None
    assert not log.has_errors, log.diagnostics
    node_class = compile_node(system.nodes[0], system, Semantics.DEPLOYED)
    transport = Launched(SimulatedWorld(seed=1), "Go")
    transport.values, transport.asked = values, []
    made = node_class(transport).machine
    assert transport.asked == ["poi", "count", "speed", "name", "is_on", "few", "pair", "class"]
    return made


def begun(folder: Path, **values: object) -> dict[str, object]:
    made = machine(folder, **values)
    return {name: getattr(made, attribute) for name, attribute in ATTRIBUTES.items()}


MODELS = {
    **{"poi": 1, "count": 2, "speed": 0.5, "name": "x", "is_on": False, "few": []},
    **{"pair": [1.0, 2.0], "class": 7},
}


def test_without_parameters_a_node_is_as_its_model_says(tmp_path: Path) -> None:
    assert begun(tmp_path) == MODELS


@pytest.mark.parametrize(
    ("values", "others"),
    [
        ({"poi": 3}, {"count": 6}),
        ({"poi": 3, "count": 1}, {}),
        ({"speed": 2}, {}),
        ({"speed": 0.1}, {"speed": 0.10000000149011612}),
        ({"name": "y", "is_on": True}, {}),
        ({"few": [1, 2]}, {}),
        ({"few": []}, {}),
        ({"pair": (3, 4)}, {"pair": [3.0, 4.0]}),
        ({"class": 8}, {}),
    ],
)
def test_a_variable_begins_with_what_is_set(
    tmp_path: Path, values: dict[str, object], others: dict[str, object]
) -> None:
    assert begun(tmp_path, **values) == {**MODELS, **values, **others}


def test_it_changes_afterwards_as_any_variable(tmp_path: Path) -> None:
    made = machine(tmp_path, poi=3, speed=1.5, name="y")
    made.on_t_timer()
    made.on_t_timer()
    assert (made.count, made.speed, made.is_on) == (12, 3.5, True)
    assert type(made).__name__ == "Go"


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("poi", 200, "int8"),
        ("poi", 1.0, "int8"),
        ("poi", True, "int8"),
        ("poi", "1", "int8"),
        ("speed", "fast", "float32"),
        ("speed", False, "float32"),
        ("name", 1, "string"),
        ("is_on", 1, "bool"),
        ("few", [1, 2, 3, 4], r"int16\[<=3\]"),
        ("few", "12", r"int16\[<=3\]"),
        ("few", 1, r"int16\[<=3\]"),
        ("few", [1, "a"], r"int16\[<=3\]"),
        ("pair", [1.0, 2.0, 3.0], r"float64\[<=2\]"),
    ],
)
def test_what_is_not_of_the_type_is_refused(
    tmp_path: Path, name: str, value: object, kind: str
) -> None:
    with pytest.raises(TransportError, match=f"the parameter {name} is .*: expected {kind}$"):
        machine(tmp_path, **{name: value})


def test_the_reserved_names_of_ros_2_stay_what_they_are(tmp_path: Path) -> None:
    (tmp_path / "Go.ascxml").write_text(
        MODEL.replace('"speed"', '"call_timeout_s"').replace("speed + 1", "1")
    )
    system = load([tmp_path / "Go.ascxml"], DiagnosticLog())
    assert system is not None
    transport = Launched(SimulatedWorld(seed=1), "Go")
    transport.values, transport.asked = {}, []
    compile_node(system.nodes[0], system, Semantics.DEPLOYED)(transport)
    assert "call_timeout_s" not in transport.asked
