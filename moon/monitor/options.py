"""What ``moon monitor`` is asked to do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from moon.connection import Network
from moon.monitor.subject_options import Choice

if TYPE_CHECKING:
    from moon.fleet.choice import Shard


class MonitorOptions(NamedTuple):  # msgspec's would cost each --help its import
    """The command line of ``moon monitor``; what was not given is None, empty or False.

    Attributes:
        models: what the system is, unless properties alone are monitored.
        network: where it runs.
        choice: what of it is judged, and by which bounds.
        as_json: whether verdicts are shown as JSON.
        log_file: to which they are appended.
        record_file: to which the run is recorded.
        ready_fd: the open file that is told when everything is subscribed to.
        exit_on_violation: whether the first one ends it.
        seconds: after how many it ends.
        fleet: the namespaces of robots, and which share of them.
    """

    models: tuple[Path, ...]
    network: Network
    choice: Choice
    as_json: bool
    log_file: Path | None
    record_file: Path | None
    ready_fd: int | None
    exit_on_violation: bool
    seconds: float | None
    fleet: tuple[str, Shard] | None
