"""What a node logs, logged as ROS 2 does: on the console in its form, and on ``/rosout``."""

from __future__ import annotations

import logging
from typing import Any


class RosLogHandler(logging.Handler):
    """Hands records of Python's ``logging`` to a node's rclpy logger.

    Args:
        node: an ``rclpy.node.Node``.
        level: what is below it is left out (of ``logging``; rclpy's levels have the same numbers).
    """

    def __init__(self, node: Any, level: int) -> None:
        super().__init__(level)
        self._logger = node.get_logger()
        self._logger.set_level(level // 10 * 10)
        self._node = node.get_name()

    def emit(self, record: logging.LogRecord) -> None:
        """Log ``record``; who logged it is named where it is not the node itself."""
        text = self.format(record)
        if record.name != self._node:
            text = f"{record.name}: {text}"
        # rclpy wants one severity per place in the code
        if record.levelno >= logging.CRITICAL:
            self._logger.fatal(text)
        elif record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        elif record.levelno >= logging.INFO:
            self._logger.info(text)
        else:
            self._logger.debug(text)
