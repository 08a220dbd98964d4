"""What the transport needs of rcl and rmw in C."""

from __future__ import annotations

import pytest

from transports.interface import TransportError
from transports.ros2 import native

pytestmark = pytest.mark.ros2


def test_a_function_that_an_older_ros_lacks_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    library = native._library

    class Older:
        """A library without a function that Jazzy's has."""

        def __init__(self, name: str | None) -> None:
            self._newer = library(name)

        def __getattr__(self, name: str) -> object:
            if name == "rmw_get_gid_for_client":
                raise AttributeError(name)
            return getattr(self._newer, name)

    monkeypatch.setattr(native, "_libraries", None)
    monkeypatch.setattr(native, "_library", Older)
    with pytest.raises(TransportError, match=r"^this ROS 2 has no rmw_get_gid_for_client; "):
        native.functions()
