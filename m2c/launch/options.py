"""What ``m2c run`` is asked to do."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from m2c.changes import Changes
from m2c.launch.simulation_options import Simulation

ON_FAILURE = "on-failure"
"""The value of ``--restart`` that starts again what dies, as Docker and systemd call it."""


class RunOptions(NamedTuple):  # msgspec's would cost each --help its import
    """The command line of ``m2c run``; what was not given is None, "", empty or False.

    Attributes:
        system: a system file, or the folder of a generated system.
        interfaces: folders of interface packages, before the system's own.
        transport: the middleware.
        rate: ticks of the tree a second.
        ticks: after how many to stop.
        only: nodes, of which alone are run.
        without: nodes that are left out.
        replacements: ``NODE=PATH`` of what is run in nodes' places.
        endpoint: where the nodes meet on Zenoh.
        routed: whether they talk through a router there.
        zenoh_config: a configuration file for every process.
        secure: the folder of certificates.
        namespace: prefix of every channel.
        monitored: whether the run is monitored.
        monitor: the monitor's own options.
        record: the file that the run is recorded to.
        observers: nodes that observe the run beside the monitor.
        processes: to how many processes nodes are dealt out; 0: one for each.
        deployment: the file of the deployment.
        host: whose nodes are run.
        restart: what becomes of a node that dies: ``never`` or ``ON_FAILURE``.
        changes: how the models are changed.
        tick_timeout: seconds that a leaf has to answer a tick.
        log_level: the least severity that nodes log.
        log_dir: the folder for a file of each node's output.
        watched: whether changed models take the places of their nodes.
        quiet: whether ticks are not shown.
        as_json: whether all that is shown is JSON.
        simulation: what only a system in virtual time has.
    """

    system: Path
    interfaces: tuple[Path, ...]
    transport: str
    rate: float | None
    ticks: int | None
    only: tuple[str, ...]
    without: tuple[str, ...]
    replacements: tuple[str, ...]
    endpoint: str | None
    routed: bool
    zenoh_config: Path | None
    secure: Path | None
    namespace: str
    monitored: bool
    monitor: str | None
    record: Path | None
    observers: tuple[str, ...]
    processes: int | None
    deployment: Path | None
    host: str | None
    restart: str
    changes: Changes
    tick_timeout: float | None
    log_level: str | None
    log_dir: Path | None
    watched: bool
    quiet: bool
    as_json: bool
    simulation: Simulation

    @property
    def restarts(self) -> bool:
        """Whether what dies is started again."""
        return self.restart == ON_FAILURE

    def of_a_middleware(self) -> list[str]:
        """The options that were given and that a system in virtual time has no place for."""
        given = {
            "--endpoint": self.endpoint,
            "--router": self.routed,
            "--zenoh-config": self.zenoh_config,
            "--secure": self.secure,
            "--namespace": self.namespace,
            "--observer": self.observers,
            "--processes": self.processes is not None,
            "--deployment": self.deployment,
            "--host": self.host,
            "--restart": self.restarts,
            "--watch": self.watched,
        }
        return [name for name, value in given.items() if value]
