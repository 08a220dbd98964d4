"""What is logged, as lines that are safe to show: a record is one line, whatever a message put in it."""

from __future__ import annotations

import logging
import re
from types import TracebackType
from typing import NamedTuple, TypeAlias

from m2c.printable import printable
from m2c.raised import traceback_of

_Fault: TypeAlias = (
    tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]
)

LOG_FORMAT = "%(levelname)s %(name)s: %(message)s"
"""Of what a process logs on standard error, where the middleware has no log of its own."""
_LOGGED = re.compile(
    r"(?P<level>[A-Z]+) (?P<logger>[^ ]+): |\[(?P<severity>[A-Z]+)\] \[\d+\.\d+\] \[(?P<name>[^\]]*)\]: "
)
"""How a line begins in that format, and in ROS 2's own (``RCUTILS_CONSOLE_OUTPUT_FORMAT``)."""
_ROS_LEVELS = {"WARN": "WARNING", "FATAL": "CRITICAL"}


class Logged(NamedTuple):
    """With what severity a line was logged, as Python calls it, and by whom."""

    level: str
    logger: str


def logged(line: str) -> Logged | None:
    """By whom ``line`` was logged; None if it was only printed."""
    found = _LOGGED.match(line)
    if found is None:
        return None
    written = found["level"] or found["severity"]
    level = _ROS_LEVELS.get(written, written)
    if level not in logging.getLevelNamesMapping():
        return None
    return Logged(level, found["logger"] or found["name"])


class LineFormatter(logging.Formatter):
    """Makes a record's message printable, and each line of a traceback, which is set in by two blanks."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The record's own line."""
        return printable(super().formatMessage(record))

    def formatException(self, ei: _Fault) -> str:
        """The traceback's lines, of a node's own code where it has some."""
        return _set_in(traceback_of(ei[1]) if ei[1] is not None else super().formatException(ei))

    def formatStack(self, stack_info: str) -> str:
        """The stack's lines."""
        return _set_in(super().formatStack(stack_info))


def log_as_lines() -> None:
    """Have what this process logs made printable where nobody sets up something else for it.

    Warnings and what is worse go to standard error then (:data:`logging.lastResort`).
    """
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(LineFormatter())


def _set_in(text: str) -> str:
    return "\n".join(f"  {printable(line)}" for line in text.split("\n"))
