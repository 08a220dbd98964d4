"""``moon monitor`` and ``moon record`` beside a system that runs in this process, in virtual time.

``m2c run --transport simulated`` finds them as entry points (group ``m2c.observers``): m2c does not know
moon. They are the commands of the command line. What differs is who runs the world: a command of its own
process spins its connection; here the system is driven, to its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from moon.connection import Beside, Drive

if TYPE_CHECKING:
    from transports.interface import Connection


def monitor(words: Sequence[str], connection: Connection, drive: Drive) -> int:
    """``moon monitor`` with these words, of a system in this process; its exit code."""
    from moon.monitor.command import monitor as command

    return _exit_code(command, words, Beside(connection, drive))


def record(words: Sequence[str], connection: Connection, drive: Drive) -> int:
    """``moon record``, in the same way."""
    from moon.recording.command import record as command

    return _exit_code(command, words, Beside(connection, drive))


def _exit_code(command: click.Command, words: Sequence[str], beside: Beside) -> int:
    try:
        command.main(list(words), prog_name=f"moon {command.name}", obj=beside)
    except SystemExit as ended:  # as every command of click's ends
        return ended.code if isinstance(ended.code, int) else 0
    return 0
