"""``<qos>`` in a system file: what generated nodes ask of the middleware for a topic."""

from __future__ import annotations

import importlib
import itertools
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from m2c.model import DiagnosticLog, Severity, System, load
from m2c.model.system import read_with_reference
from moon.cli import main as moon
from moon.monitor.reading import judgeable
from tests.codegen.files import node_modules
from tests.transports import ros2_network
from transports.simulated import Conditions, SimulatedWorld
from transports.simulated.world import SimulatedTransport

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="{0}" initial="a">'
TALKER = (
    HEAD.format("Talker")
    + """<ros_topic_publisher topic="/t" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/plain" type="std_msgs/Int32"/>
<state id="a"><onentry>
  <ros_topic_publish name="/t"><field name="data" expr="7"/></ros_topic_publish>
  <ros_topic_publish name="/plain"><field name="data" expr="8"/></ros_topic_publish>
</onentry></state></scxml>"""
)
LISTENER = (
    HEAD.format("Listener")
    + """<datamodel><data id="seen" type="int32" expr="0"/></datamodel>
<ros_topic_subscriber topic="/t" type="std_msgs/Int32"/>
<state id="a"><ros_topic_callback name="/t"><assign location="seen" expr="_msg.data"/>
</ros_topic_callback></state></scxml>"""
)
SYSTEM = """<roaml><node_models>
  <input type="node-ascxml" src="Talker.scxml"/><input type="node-ascxml" src="Listener.scxml"/>
</node_models>{0}</roaml>"""

_numbers = itertools.count()


def written(folder: Path, topic: str) -> Path:
    """A system file whose ``/t`` has the attributes ``topic``."""
    for name, text in (("Talker", TALKER), ("Listener", LISTENER)):
        (folder / f"{name}.scxml").write_text(text)
    path = folder / "system.xml"
    path.write_text(SYSTEM.format(f'<qos><topic name="/t" {topic}/></qos>' if topic else ""))
    return path


def read(folder: Path, topic: str) -> System:
    log = DiagnosticLog()
    system = load([written(folder, topic)], log)
    assert system is not None
    assert all(item.severity is Severity.NOTE for item in log.diagnostics)
    return system


def test_a_topic_may_be_named_without_its_first_slash(tmp_path: Path) -> None:
    path = written(tmp_path, 'reliability="best_effort"')
    path.write_text(path.read_text().replace('topic name="/t"', 'topic name="t"'))
    log = DiagnosticLog()
    system = load([path], log)
    assert system is not None, log.diagnostics
    lossy = [i.channel for machine in system.nodes for i in machine.interfaces if i.best_effort]
    assert lossy == ["/t", "/t"]


def node_classes(folder: Path, topic: str) -> list[Any]:
    """The generated node classes of the talker and the listener."""
    system = read(folder, topic)
    classes = []
    sys.path.insert(0, str(folder))
    try:
        for machine in system.nodes:
            package = f"quality_{next(_numbers)}"
            (folder / package).mkdir()
            for name, text in node_modules(machine, system.library, package).items():
                (folder / package / name).write_text(text)
            importlib.invalidate_caches()
            module = importlib.import_module(f"{package}.node")
            classes.append(getattr(module, f"{machine.name}Node"))
    finally:
        sys.path.remove(str(folder))
    return classes


def seen_by_a_late_listener(folder: Path, topic: str) -> int:
    talker, listener = node_classes(folder, topic)
    world = SimulatedWorld()
    talker(SimulatedTransport(world, "Talker")).start()
    world.run_for(1.0)
    late = listener(SimulatedTransport(world, "Listener"))
    late.start()
    world.run_for(1.0)
    seen: int = late.machine.seen
    return seen


def test_a_late_node_gets_the_last_message_of_a_transient_local_topic_only(tmp_path: Path) -> None:
    assert seen_by_a_late_listener(tmp_path, 'latched="true"') == 7
    assert seen_by_a_late_listener(tmp_path, "") == 0


@pytest.mark.parametrize(
    ("topic", "seen"),
    [("", 7), ('reliability="reliable"', 7), ('reliability="best_effort"', 0)],
)
def test_only_a_best_effort_message_may_be_lost(tmp_path: Path, topic: str, seen: int) -> None:
    talker, listener = node_classes(tmp_path, topic)
    world = SimulatedWorld(conditions=Conditions(loss=1.0))
    early = listener(SimulatedTransport(world, "Listener"))
    early.start()
    world.run_for(1.0)
    talker(SimulatedTransport(world, "Talker")).start()
    world.run_for(1.0)
    assert early.machine.seen == seen


@pytest.mark.ros2
def test_on_ros_2_both_ends_have_the_quality_and_other_topics_do_not(tmp_path: Path) -> None:
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    made = node_classes(tmp_path, 'reliability="best_effort" latched="true"')
    with ros2_network.own_domain():
        network = ros2_network.network()
        try:
            transport: Any = network.node("both")
            for node_class in made:
                node_class(transport)
            ros = transport.ros_node

            def ends() -> list[Any]:
                publishers = ros.get_publishers_info_by_topic("/t")
                return [*publishers, *ros.get_subscriptions_info_by_topic("/t")]

            assert network.until(lambda: len(ends()) == 2)
            qualities = [(e.qos_profile.reliability, e.qos_profile.durability) for e in ends()]
            asked = (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.TRANSIENT_LOCAL)
            assert qualities == [asked] * 2
            (plain,) = ros.get_publishers_info_by_topic("/plain")
            assert plain.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            assert plain.qos_profile.durability == DurabilityPolicy.VOLATILE
        finally:
            network.close()


def test_the_qualities_are_written_into_the_nodes_channels(tmp_path: Path) -> None:
    system = read(tmp_path, 'reliability="best_effort" latched="true"')
    for machine in system.nodes:
        text = node_modules(machine, system.library, "package")["node.py"]
        channel = 'T = Topic("/t", "std_msgs/msg/Int32", Int32, Reliability.BEST_EFFORT, transient_local=True)'
        assert channel in text
        assert "from transports.interface import Reliability, Topic, Transport" in text


def test_a_model_in_the_place_of_another_has_the_qualities_of_the_system(tmp_path: Path) -> None:
    system = read(tmp_path, 'durability="transient_local"')
    machine = read_with_reference(tmp_path / "Listener.scxml", system, "Listener", DiagnosticLog())
    assert machine is not None
    assert [interface.transient_local for interface in machine.interfaces] == [True]


@pytest.mark.parametrize(
    ("topics", "expected"),
    [
        ('<topic/>', "4:6: error: <topic>: the attribute `name` is missing [missing-attribute]"),
        ('<topics/>', "4:6: error: <topics>: not an element of <qos>; use <topic> [unknown-tag]"),
        ('<topic name="/t" latch="true"/>', "4:30: error: <topic>: unknown attribute `latch`; did you mean latched? [unknown-attribute]"),
        ('<topic name="/t" latched="yes"/>', "4:32: error: <topic>: latched cannot be `yes`; one of false, true [bad-quality]"),
        ('<topic name="/x"/>', "4:19: error: <topic>: no model publishes or subscribes to `/x`; known: /t, /plain [unknown-topic]"),
    ],
)  # fmt: skip
def test_a_fault_in_the_qualities_has_its_place(tmp_path: Path, topics: str, expected: str) -> None:
    path = written(tmp_path, "")
    path.write_text(SYSTEM.format(f"\n<qos>{topics}</qos>"))
    done = CliRunner().invoke(m2c, ["check", str(path)])
    assert done.exit_code == 2
    errors = [line for line in done.output.splitlines() if " error: " in line]
    assert len(errors) == 1
    assert errors[0].partition("system.xml:")[2] == expected


@pytest.mark.parametrize(
    ("topic", "why"),
    [
        ('latched="true"', "/t (transient local)"),
        ('durability="transient_local"', "/t (transient local)"),
        ('reliability="best_effort"', "/t (best effort)"),
    ],
)
def test_a_node_whose_inputs_nobody_can_know_is_not_judged(tmp_path: Path, topic, why) -> None:
    kept, reasons = judgeable(read(tmp_path, topic).nodes)
    assert [machine.name for machine in kept] == ["Talker"]
    assert reasons == (
        f"Listener is not judged: it subscribes to {why}; what it received cannot be known",
    )
    alone = ["monitor", str(tmp_path / "system.xml"), "--only", "Listener"]
    done = CliRunner().invoke(moon, alone)
    assert done.exit_code == 2
    assert reasons[0] in done.output
    assert "error: " in done.output
    assert "no node is left to be judged" in done.output


def test_nodes_of_ordinary_topics_are_all_judged(tmp_path: Path) -> None:
    kept, reasons = judgeable(read(tmp_path, 'reliability="reliable"').nodes)
    assert len(kept) == 2
    assert reasons == ()
