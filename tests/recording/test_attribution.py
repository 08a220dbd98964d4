"""Who is taken to have done what a bag does not name: a node of the models, if no other can have."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.recording.attribution import only_node, shared_topics
from transports.interface import Observation, ObservationKind

ASKER = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="{name}" initial="on">
  <ros_service_client name="ask" service_name="/ask" type="few/Ask"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="1"/>
  <state id="on">
    <ros_rate_callback name="beat">
      <ros_service_send_request name="ask"/>
      <ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish>
    </ros_rate_callback>
    <ros_service_handle_response name="ask"/>
  </state>
</scxml>"""
POLICY = """
<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>{leaves}</Sequence></BehaviorTree></root>"""
SYSTEM = """<roaml>
  <behavior_tree><input type="bt.cpp-xml" src="./policy.xml"/>{leaves}</behavior_tree>
  <node_models>{nodes}</node_models>
  <interfaces><input type="ros-interfaces" src="./interfaces"/></interfaces>
</roaml>"""


def system(folder: Path, nodes: tuple[str, ...], leaves: tuple[str, ...]) -> System:
    """Nodes that call ``/ask`` and publish ``/out``, and leaves of a tree that call ``/ask``."""
    types = folder / "interfaces" / "few" / "srv" / "Ask.srv"
    types.parent.mkdir(parents=True)
    types.write_text("---\nbool done\n")
    for name in nodes:
        (folder / f"{name}.scxml").write_text(ASKER.format(name=name))
    bound = (f'<leaf ID="{leaf}" service="/ask" type="few/Ask"/>' for leaf in leaves)
    models = (f'<input type="node-ascxml" src="./{name}.scxml"/>' for name in nodes)
    (folder / "policy.xml").write_text(POLICY.format(leaves="".join(f"<{it}/>" for it in leaves)))
    path = folder / "system.xml"
    path.write_text(SYSTEM.format(leaves="".join(bound), nodes="".join(models)))
    log = DiagnosticLog()
    made = load([path], log)
    assert made is not None, log.diagnostics
    return made


def seen(channel: str, kind: ObservationKind) -> Observation:
    return Observation(
        stamp_ns=1, received_ns=1, channel=channel, kind=kind, type_name="", data={}, source=""
    )


ASKED = seen("/ask", ObservationKind.REQUEST_SENT)


@pytest.mark.parametrize(
    ("nodes", "leaves", "who"),
    [
        (("One",), (), "One"),
        (("One", "Two"), (), ""),
        (("One",), ("Leaf",), ""),
        ((), ("Leaf", "Other"), "policy"),
    ],
)
def test_a_call_is_of_the_only_node_that_makes_such(
    tmp_path: Path, nodes: tuple[str, ...], leaves: tuple[str, ...], who: str
) -> None:
    """The leaves of the tree are one node."""
    assert only_node(system(tmp_path, nodes, leaves))(ASKED) == who


def test_a_topic_is_shared_if_two_nodes_publish_it(tmp_path: Path) -> None:
    assert not shared_topics(system(tmp_path / "one", ("One",), ("Leaf",)))
    assert shared_topics(system(tmp_path / "two", ("One", "Two"), ())) == {"/out"}
