"""Subscriptions that rcl makes beside the interpreter."""

from __future__ import annotations

import threading

import pytest

from tests.transports.ros2.bare import Bare
from transports.interface import TransportError
from transports.networks import PATIENCE_S, ThreadedNetwork
from transports.work_queue import WorkQueue

pytestmark = pytest.mark.ros2

INT32 = "std_msgs/msg/Int32"


def test_the_graph_shows_what_was_asked_for(bare: Bare) -> None:
    """So the options are laid out as rcl has them."""
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    from transports.ros2 import qos
    from transports.ros2.interfaces import ros_class
    from transports.ros2.raw_subscription import RawSubscription

    for number, (reliable, transient_local) in enumerate(
        [(True, True), (True, False), (False, True), (False, False)]
    ):
        subscription = RawSubscription(f"/raw{number}")
        subscription.make(bare.node, ros_class(INT32), qos.profile(reliable, transient_local, 5000))
        (info,) = bare.node.get_subscriptions_info_by_topic(f"/raw{number}")
        shown = info.qos_profile
        assert info.topic_type == INT32
        assert (shown.reliability is ReliabilityPolicy.RELIABLE) == reliable
        assert (shown.durability is DurabilityPolicy.TRANSIENT_LOCAL) == transient_local
        assert shown.deadline.nanoseconds == shown.lifespan.nanoseconds > 10**18
        subscription.end(bare.node)
        subscription.end(bare.node)
        assert not bare.node.get_subscriptions_info_by_topic(f"/raw{number}")


def test_what_was_ended_is_used_no_more(bare: Bare) -> None:
    from rclpy.exceptions import InvalidHandle

    from transports.ros2 import qos
    from transports.ros2.interfaces import ros_class
    from transports.ros2.raw_subscription import RawSubscription

    subscription = RawSubscription("/raw")
    with pytest.raises(InvalidHandle, match="/raw is not subscribed to"), subscription:
        pass
    subscription.make(bare.node, ros_class(INT32), qos.profile(True, False, 10))
    with subscription as handle:
        assert handle.pointer
    subscription.end(bare.node)
    with pytest.raises(InvalidHandle), subscription:
        pass


def test_what_rcl_refuses_is_said(network: ThreadedNetwork) -> None:
    from transports.ros2 import qos
    from transports.ros2.interfaces import ros_class
    from transports.ros2.subscribing import Subscriber

    node = network.node("listener")
    done: WorkQueue[object] = WorkQueue()
    subscriber = Subscriber(node.ros_node, node._executor)
    try:
        subscriber.subscribe("/no such", ros_class(INT32), qos.profile(True, False, 10), done.put)
        refused = done.get(timeout=PATIENCE_S)
    finally:
        subscriber.close()
    assert isinstance(refused, TransportError)
    assert str(refused).startswith(
        "topic name must not contain characters other than alphanumerics"
    )
    assert ".c:" not in str(refused)


def test_who_closes_while_a_subscription_is_made_ends_it(
    bare: Bare, monkeypatch: pytest.MonkeyPatch
) -> None:
    from transports.ros2 import native, qos
    from transports.ros2.interfaces import ros_class
    from transports.ros2.subscribing import Subscriber

    class Idle:
        """An executor that never has its turn."""

        def post(self, _: object) -> None:
            posted.append(1)

    posted: list[int] = []
    began, goes_on = threading.Event(), threading.Event()
    make = native.make_subscription

    def slowly(*arguments: object) -> None:
        began.set()
        assert goes_on.wait(PATIENCE_S)
        make(*arguments)

    monkeypatch.setattr(native, "make_subscription", slowly)
    subscriber = Subscriber(bare.node, Idle())
    for name in ("/first", "/second"):
        subscriber.subscribe(name, ros_class(INT32), qos.profile(True, False, 10), lambda _: None)
    assert began.wait(PATIENCE_S)
    closer = threading.Thread(target=subscriber.close)
    closer.start()
    goes_on.set()
    closer.join(PATIENCE_S)
    assert not closer.is_alive()
    assert posted
    assert not bare.node.get_subscriptions_info_by_topic("/first")
    assert not bare.node.get_subscriptions_info_by_topic("/second")
