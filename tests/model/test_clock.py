"""The topic /clock is there for models that take it for granted."""

from __future__ import annotations

from pathlib import Path

import pytest

import m2c
from transports import Observation, SimulatedWorld

LISTENER = """<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="a">
<ros_topic_subscriber name="time" topic="clock" type="{type}"/>
<state id="a"><ros_topic_callback name="time" target="a"/></state></ascxml>"""
SPEAKER = """<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="Own" initial="a">
<ros_topic_publisher name="time" topic="/clock" type="builtin_interfaces/Time"/>
<state id="a"><onentry><ros_topic_publish name="time"><field name="sec" expr="1"/>
<field name="nanosec" expr="0"/></ros_topic_publish></onentry></state></ascxml>"""


def system(folder: Path, *models: str) -> m2c.System:
    inputs = ""
    for number, text in enumerate(models):
        (folder / f"{number}.ascxml").write_text(text)
        inputs += f'<input type="node-ascxml" src="{number}.ascxml"/>'
    path = folder / "system.xml"
    path.write_text(f"<roaml><node_models>{inputs}</node_models></roaml>")
    return m2c.read_system(path)


def listener(kind: str = "builtin_interfaces/Time", name: str = "Listener") -> str:
    return LISTENER.format(name=name, type=kind)


def test_a_node_is_added_that_tells_the_time_since_the_start(tmp_path: Path) -> None:
    found = system(tmp_path, listener())
    assert [node.name for node in found.nodes] == ["Listener", "SystemClock"]
    assert [item.rule for item in m2c.check(found)] == ["provided-topic"]
    world = SimulatedWorld(seed=1)
    seen: list[Observation] = []
    world.connect("tap").tap(["/clock"], seen.append)
    m2c.simulate(found, world).run(1.25)
    times = [event.data for event in seen if event.kind == "message"]
    assert [(time["sec"], time["nanosec"]) for time in times] == [
        *[(0, tenths * 100_000_000) for tenths in range(1, 10)],
        (1, 0),
        (1, 100_000_000),
        (1, 200_000_000),
    ]


def test_the_node_is_called_otherwise_where_its_name_is_taken(tmp_path: Path) -> None:
    found = system(tmp_path, listener(name="SystemClock"))
    assert [node.name for node in found.nodes] == ["SystemClock", "SystemClock_"]
    assert len(m2c.generate(found, tmp_path / "generated")) > 0


@pytest.mark.parametrize(
    "models",
    [
        (listener("rosgraph_msgs/Clock"),),
        (listener(), SPEAKER),
        (SPEAKER,),
    ],
)
def test_nothing_is_added_where_the_clock_is_another_s(
    tmp_path: Path, models: tuple[str, ...]
) -> None:
    assert len(system(tmp_path, *models).nodes) == len(models)
