"""Requests that rcl itself takes and answers."""

from __future__ import annotations

from typing import Any

import pytest

from tests.transports.ros2.bare import Bare
from transports.networks import PATIENCE_S, ThreadedNetwork

pytestmark = pytest.mark.ros2


def never(request: Any, response: Any) -> Any:
    raise AssertionError("nobody spins this node")


def test_a_request_says_whose_it_is_and_its_answer_reaches_him(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from rcl_interfaces.srv import ListParameters
    from rclpy.exceptions import InvalidHandle

    from transports.ros2 import native
    from transports.ros2.requests import RequestId, Requests

    node = network.node("server").ros_node
    service = node.create_service(ListParameters, "/list", never)
    node.executor.ignore(service)
    requests = Requests(service.handle, ListParameters.Request, ListParameters.Response)
    assert requests.take() is None
    client = bare.node.create_client(ListParameters, "/list")
    assert client.wait_for_service(PATIENCE_S)
    (asking,) = bare.node.get_publishers_info_by_topic("rq/listRequest", no_mangle=True)

    def taken() -> tuple[RequestId, Any]:
        found: list[tuple[RequestId, Any]] = []
        assert network.until(lambda: bool(found) or found.extend(filter(None, [requests.take()])))
        return found[0]

    for call, prefixes in enumerate([["a", "bb"], [], ["ü" * 300]], start=1):
        future = client.call_async(ListParameters.Request(prefixes=prefixes, depth=2**63))
        id_, request = taken()
        assert native.participant_of(id_.gid) == native.participant_of(asking.endpoint_gid)
        assert id_.call == call
        assert (request.prefixes, request.depth) == (prefixes, 2**63)
        response = ListParameters.Response()
        response.result.names = [*prefixes, "answered"]
        requests.answer(id_, response)
        assert network.until(future.done)
        assert future.result().result.names == [*prefixes, "answered"]
    service.destroy()
    for use in (requests.take, lambda: requests.answer(id_, response)):
        with pytest.raises(InvalidHandle):
            use()


def test_who_has_left_is_answered_without_trouble(bare: Bare) -> None:
    from std_srvs.srv import Trigger

    from transports.ros2.requests import RequestId, Requests

    service = bare.node.create_service(Trigger, "/trigger", never)
    requests = Requests(service.handle, Trigger.Request, Trigger.Response)
    requests.answer(RequestId(bytes(16), 1), Trigger.Response())
