"""``--monitor`` and ``--record`` of ``m2c run``: the command line of what watches the run."""

from __future__ import annotations

import shlex
from pathlib import Path

from m2c.terminal import fail

WATCHER = "moon"
"""The node that watches, its process and its package."""


def watch_options(system: Path, written: str | None, as_json: bool) -> list[str] | None:
    """What ``--monitor`` says; None without it.

    Args:
        system: what is run.
        written: the monitor's own options.
        as_json: whether it is to write JSON, as the run does.
    """
    if written is None:
        return None
    if system.is_dir():
        fail("--monitor: monitoring needs the models: give the system file as SYSTEM")
    try:
        return [*shlex.split(written), *["--json"] * as_json]
    except ValueError as error:
        fail(f"--monitor={written}: {error}")


def watcher(
    system: Path,
    options: list[str] | None,
    record: Path | None,
    interfaces: tuple[Path, ...],
) -> tuple[str, ...]:
    """The command line of ``moon`` that watches this run; empty if nothing is to.

    Args:
        system: what is run.
        options: of the monitor; None: there is to be none.
        record: the file to record to.
        interfaces: folders with the types of what is recorded.
    """
    if record is not None and record.exists():
        fail(f"{record}: is there already; a recording is not written over")
    if options is not None:
        recorded = ["--record", str(record)] if record is not None else []
        return ("monitor", str(system), *recorded, *options)
    if record is not None:
        types = [word for folder in interfaces for word in ("--interfaces", str(folder))]
        return ("record", "-o", str(record), *types)
    return ()
