"""What a node sent last: a message is dropped where its publisher is known to be gone before it arrives."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from rclpy.duration import Duration


class LastWords:
    """Waits for what was sent last to arrive: no longer in all than ``patience_s``, where a subscriber stands
    still.
    """

    def __init__(self, patience_s: float) -> None:
        self._left_s = patience_s

    def wait(self, publishers: Iterable[Any]) -> None:
        """Wait until all who receive from these (of rclpy) have what they sent, if patience is left."""
        for publisher in publishers:
            if self._left_s <= 0:
                return
            began_s = time.monotonic()
            publisher.wait_for_all_acked(Duration(nanoseconds=int(self._left_s * 1e9)))
            self._left_s -= time.monotonic() - began_s
