"""By a coarse clock a node does several things at once, and a bag does not tell in which order."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from tests.campaign.bags import Bag
from tests.offline.from_bags import accused_in, loaded, run_of

CLIENT = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Client" initial="on">
<ros_time_rate name="beat" rate_hz="2"/>
<ros_service_client name="ask" service_name="/ask" type="std_srvs/SetBool"/>
<state id="on"><ros_rate_callback name="beat">
  <ros_service_send_request name="ask"><field name="data" expr="true"/></ros_service_send_request>
</ros_rate_callback></state>
</scxml>"""
SERVER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Server" initial="on">
<datamodel><data id="asked" type="int32" expr="0"/></datamodel>
<ros_service_server name="ask" service_name="/ask" type="std_srvs/SetBool"/>
<ros_topic_publisher topic="/count" type="std_msgs/Int32"/>
<state id="on"><ros_service_handle_request name="ask">
  <assign location="asked" expr="asked + {step}"/>
  <ros_topic_publish name="/count"><field name="data" expr="asked"/></ros_topic_publish>
  <ros_service_send_response name="ask"><field name="success" expr="true"/></ros_service_send_response>
</ros_service_handle_request></state>
</scxml>"""


def written(folder: Path, step: int) -> tuple[Path, ...]:
    folder.mkdir()
    (folder / "Client.scxml").write_text(CLIENT)
    (folder / "Server.scxml").write_text(SERVER.format(step=step))
    return folder / "Client.scxml", folder / "Server.scxml"


@pytest.mark.parametrize(
    ("coarse_ns", "step", "accused"), [(10_000_000, 1, set()), (1, 1, set()), (1, 2, {"Server"})]
)
def test_nobody_is_accused_by_an_order_that_is_not_known(
    tmp_path: Path, coarse_ns: int, step: int, accused: set[str]
) -> None:
    system = loaded(written(tmp_path / "run", 1))
    bag = Bag(seed=3)
    run = [
        replace(one, received_ns=one.received_ns // coarse_ns * coarse_ns)
        for one in bag.recorded(run_of(system, 8.0))
    ]
    expected = written(tmp_path / "expected", step)
    assert accused_in(tmp_path / "bag.mcap", bag, run, system, expected) == accused
