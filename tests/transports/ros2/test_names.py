"""What is told of names without ROS 2 is what ROS 2 says itself."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transports.ros_names import refusal

rclpy = pytest.importorskip("rclpy")
from rclpy.exceptions import NameValidationException  # noqa: E402
from rclpy.validate_full_topic_name import validate_full_topic_name  # noqa: E402
from rclpy.validate_node_name import validate_node_name  # noqa: E402

pytestmark = pytest.mark.ros2
LETTERS = st.sampled_from("aZ0_/ -é漢*$?#@~.{")


def is_taken(kind: str, name: str) -> bool:
    try:
        if kind == "node":
            validate_node_name(name)
        else:
            validate_full_topic_name(name)
    except NameValidationException:
        return False
    return True


@given(
    st.sampled_from(["node", "topic"]), st.text(LETTERS, max_size=8), st.sampled_from([1, 200, 300])
)
def test_a_name_is_refused_if_and_only_if_ros2_refuses_it(kind: str, text: str, times: int) -> None:
    name = (text * times)[:300]
    name = name if kind == "node" else f"/{name}"
    found = refusal(kind, name)
    assert (found is None) is is_taken(kind, name)
    if found is not None and found[1]:
        assert is_taken(kind, found[1]) or len(found[1]) > 247
