"""What a process logs, logged as ROS 2 does: on the console in its form, and on ``/rosout``.

Each of its nodes has a logger of its own there.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any


class RosLogHandler(logging.Handler):
    """Hands records of Python's ``logging`` to the rclpy logger of the node that they are from.

    That is the node after which the record's thread is named, as that thread runs the node's executor; else
    the one after which its logger is named; else ``node``.

    Args:
        nodes: gives the process's nodes by name (each an ``rclpy.node.Node``).
        node: the name of the one from which all other records are.
        level: what is below it is left out (of ``logging``; rclpy's levels have the same numbers).
    """

    def __init__(self, nodes: Callable[[], Mapping[str, Any]], node: str, level: int) -> None:
        super().__init__(level)
        self._nodes = nodes
        self._node = node
        self._loggers: dict[str, Any] = {}
        self._logger_of(node)

    def emit(self, record: logging.LogRecord) -> None:
        """Log ``record``; who logged it is named where it is not the node itself."""
        nodes = self._nodes()
        of = (name for name in (record.threadName, record.name) if name is not None)
        node = next((name for name in of if name in nodes), self._node)
        logger = self._logger_of(node)
        text = self.format(record)
        if record.name != node:
            text = f"{record.name}: {text}"
        # rclpy wants one severity per place in the code
        if record.levelno >= logging.CRITICAL:
            logger.fatal(text)
        elif record.levelno >= logging.ERROR:
            logger.error(text)
        elif record.levelno >= logging.WARNING:
            logger.warning(text)
        elif record.levelno >= logging.INFO:
            logger.info(text)
        else:
            logger.debug(text)

    def _logger_of(self, node: str) -> Any:
        logger = self._loggers.get(node)
        if logger is None:
            logger = self._loggers[node] = self._nodes()[node].get_logger()
            logger.set_level(self.level // 10 * 10)
        return logger
