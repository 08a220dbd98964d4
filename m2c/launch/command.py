"""The ``m2c run`` command."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.inputs import ExistingPath, deployment_option, finite, lenient_option
from m2c.launch.restarts import MOST_RESTARTS
from m2c.launch.simulation_options import TRANSPORT as SIMULATED
from m2c.launch.simulation_options import Simulation, simulation_options
from m2c.terminal import fail, say
from transports.options import DEFAULT_ENDPOINT, LAUNCHER, SECURE_ENDPOINT, meeting_at

if TYPE_CHECKING:
    from m2c.launch.description import LaunchDescription
    from m2c.launch.grouping import Group
    from m2c.launch.router import Router
    from m2c.policy.program import Policy
    from transports.interface import Connection
    from transports.stop_signals import StopSignals

FILES_OF_PROCESS = 4
"""The launcher's files for each node: its output, its links, and some for a moment as it starts."""
_MONITOR_OPTIONS = "--monitor-options"
EACH = "each"
"""The value of ``--processes`` that gives each node one."""
MOST_PROCESSES = 1000
ON_FAILURE = "on-failure"
"""The value of ``--restart`` that starts again what dies, as Docker and systemd call it."""
CLOSE_TIMEOUT_S = 10.0
"""How long the launcher's own connection may take to close, when all nodes have ended. Fast DDS waits for
ever where a node that was killed has left a lock in shared memory."""


class _Processes(click.ParamType[int]):
    """A number of processes, or ``each``, which is 0."""

    name = "processes"

    def convert(
        self, value: object, param: click.Parameter | None, context: click.Context | None
    ) -> int:
        """The number."""
        text = str(value)
        if text == EACH:
            return 0
        if not text.isdecimal() or not 0 < int(text) <= MOST_PROCESSES:
            self.fail(f"{text!r} is neither a number from 1 to {MOST_PROCESSES} nor {EACH!r}")
        return int(text)


class _Run(click.Command):
    """``--monitor`` with options or without: to click, what begins with a dash is no option's value."""

    def parse_args(self, context: click.Context, arguments: list[str]) -> list[str]:
        """As ``click.Command``."""
        words = []
        for argument in arguments:
            name, equals, value = argument.partition("=")
            words += [_MONITOR_OPTIONS, value] if name == "--monitor" and equals else [argument]
        return super().parse_args(context, words)


@click.command(cls=_Run)
@click.argument("system", type=click.Path(path_type=Path))
@click.option("--transport", default="zenoh", show_default=True, help="The middleware.")
@click.option(
    "--rate",
    type=click.FloatRange(min=0, min_open=True),
    callback=finite,
    help="Ticks of the tree a second; by default the system file's.",
)
@click.option("--ticks", type=click.IntRange(min=1), help="Stop after this many ticks.")
@click.option("--only", multiple=True, metavar="NODE", help="Run only this node (repeatable).")
@click.option("--without", multiple=True, metavar="NODE", help="Leave this node out (repeatable).")
@click.option(
    "--replace",
    "replacements",
    multiple=True,
    metavar="NODE=PATH",
    help="Run something else in a node's place: a model file, or a generated package (repeatable).",
)
@click.option("--endpoint", help=f"Zenoh: where the nodes meet.  [default: {DEFAULT_ENDPOINT}]")
@click.option(
    "--router",
    "routed",
    is_flag=True,
    help="Zenoh: all talk through a router at the endpoint; it is started if there is none.",
)
@click.option(
    "--zenoh-config",
    type=ExistingPath(path_type=Path, exists=True, dir_okay=False),
    help="Zenoh: configuration file for every process (TLS, routers…).",
)
@click.option(
    "--secure",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Zenoh: run with the certificates that `moon keys init` made in DIR.",
)
@click.option("--namespace", default="", help="Prefix of every channel.")
@click.option(
    "--monitor",
    "monitored",
    is_flag=True,
    help='Monitor the whole run with `moon monitor`; --monitor="OPTIONS" gives it options of its own.',
)
@click.option(_MONITOR_OPTIONS, "monitor", hidden=True)
@click.option(
    "--record",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Record the whole run to this MCAP file.",
)
@click.option(
    "--processes",
    type=_Processes(),
    metavar="N|each",
    help="How many processes the nodes are dealt out to; each: one for each node.  "
    "[default: as many as there are processors]",
)
@deployment_option
@click.option("--host", metavar="HOST", help="Run only what the deployment gives to this host.")
@click.option(
    "--restart",
    type=click.Choice(["never", ON_FAILURE]),
    default="never",
    show_default=True,
    help="What becomes of a node that dies once all are up: everything is stopped, or (on-failure) it is "
    f"started again, at most {MOST_RESTARTS} times in a minute.",
)
@lenient_option
@click.option("--quiet", is_flag=True, help="Do not show the tree's ticks.")
@simulation_options
def run(
    system: Path,
    transport: str,
    rate: float | None,
    ticks: int | None,
    only: tuple[str, ...],
    without: tuple[str, ...],
    replacements: tuple[str, ...],
    endpoint: str | None,
    routed: bool,
    zenoh_config: Path | None,
    secure: Path | None,
    namespace: str,
    monitored: bool,
    monitor: str | None,
    record: Path | None,
    processes: int | None,
    deployment: Path | None,
    host: str | None,
    restart: str,
    lenient: bool,
    quiet: bool,
    simulation: Simulation,
) -> None:
    """Run a system: its nodes, in a few processes, and the policy.

    SYSTEM is a folder made by `m2c generate`, or a system file (it is generated first). The policy ticks
    the tree once all nodes are up.

    With --transport simulated a system file is run in this process, without a middleware and in virtual
    time: the first run of a model takes a second.

    Exit code 0: the last tick was made, or Ctrl-C; 1: a node died or did not end when told to, or
    --monitor found a violation; 2: the system could not be started.

    \b
    Example:
      m2c run generated --ticks 100
      m2c run system.xml --transport simulated --for 60 --monitor
      m2c run system.xml --router
      m2c run system.xml --monitor="--properties safety.yaml" --record run.mcap
    """
    from m2c.launch.description import (
        LaunchError,
        read_description,
        read_policy_of,
        replace,
        select,
    )
    from m2c.launch.grouping import deployed, grouped
    from m2c.launch.reading import parse_replacements, planned
    from m2c.launch.refusals import ask_for_refusals, ask_nodes_for_refusals
    from m2c.launch.router import met_at_router
    from m2c.launch.screen import screen_for
    from m2c.launch.system import RunningSystem, RunSettings
    from m2c.launch.watching import watch_options, watcher
    from m2c.logs import log_as_lines
    from m2c.model.event_types import PACKAGE as EVENTS
    from transports.interface import TransportError
    from transports.open_files import FOR_A_CONNECTION, allow_open_files
    from transports.registry import connect
    from transports.stop_signals import StopSignals
    from transports.watchdog import ended_after

    if not os.path.exists(system):
        from m2c.model.paths import meant

        wanted = meant(system) or "expected a system file, or a folder made by `m2c generate`"
        fail(f"{system}: no such file or folder; {wanted}")
    changed = parse_replacements(replacements)
    log_as_lines()
    if lenient and system.is_dir():
        fail("--lenient: these nodes are generated already; give it to `m2c generate`")
    of_monitor = watch_options(system, "" if monitored and monitor is None else monitor)
    if lenient and of_monitor is not None:
        of_monitor.append("--lenient")
    if transport == SIMULATED:
        refused = {
            "--endpoint": endpoint,
            "--router": routed,
            "--zenoh-config": zenoh_config,
            "--secure": secure,
            "--namespace": namespace,
            "--processes": processes is not None,
            "--deployment": deployment,
            "--host": host,
            "--restart": restart == ON_FAILURE,
        }
        _refuse(transport, [name for name, value in refused.items() if value], "a middleware")
        from m2c.launch.simulated import run_simulated

        chosen = (lenient, rate, ticks or 0, only, without)
        sys.exit(run_simulated(system, changed, *chosen, simulation, of_monitor, record, quiet))
    _refuse(transport, simulation.given(), SIMULATED)
    interfaces: tuple[Path, ...] = ()
    with (
        tempfile.TemporaryDirectory(prefix="m2c-run-") as scratch,
        contextlib.ExitStack() as at_router,
    ):
        try:
            folder = system if system.is_dir() else Path(scratch) / "system"
            if not system.is_dir():
                interfaces = _generate(system, folder, changed, transport, lenient)
            models = {name: path for name, path in changed.items() if path.is_file()}
            if system.is_dir() and models:
                name, path = next(iter(models.items()))
                fail(
                    f"--replace {name}={path}: replacing by a model needs the system file as SYSTEM"
                )
            description = read_description(folder)
            plan = planned(description, deployment, host, processes)
            description = select(description, only, without)
            packages = {name: path for name, path in changed.items() if path.is_dir()}
            description = replace(description, folder, packages)
            policy = read_policy_of(description, folder)
            if ticks and policy is None:
                fail(f"--ticks {ticks}: the policy is not run, so nothing is ticked")
            if transport == "ros2" and policy is not None:
                _provide_ticks(policy)
            if os.path.isdir(events := folder / EVENTS):
                interfaces = (*interfaces, events)
                if transport == "ros2":
                    _provide_events(events)
            if plan:
                groups = deployed(description, plan, host or "", packages)
            else:
                apart = [*packages, *_policy_apart(description, restart)]
                groups = grouped(description, _count(processes, secure, transport), apart)
            allow_open_files(FOR_A_CONNECTION + FILES_OF_PROCESS * (len(groups) + 1))
            options = _transport_options(
                transport, endpoint, routed, zenoh_config, secure, namespace
            )
            signals = StopSignals()
            heard = False
            if secure is not None:
                _check_certificates(secure, groups)
                heard = ask_for_refusals()

            def meet() -> tuple[Connection, Router | None]:
                if routed:
                    return at_router.enter_context(met_at_router(folder, options))
                return connect(transport, LAUNCHER, meeting_at(options)), None

            connection, router = meet() if host is None else _when_reachable(meet, signals)
            if heard:
                ask_nodes_for_refusals()
            where = f"on {transport}"
            if transport == "zenoh":
                the_router = "the router " if routed else ""
                where = f"at {the_router}{options.get('endpoint') or f'the endpoints of {zenoh_config}'}"
            arguments = ["--transport", transport]
            for name, value in options.items():
                arguments += [_NODE_OPTIONS[name], value]
            watch = watcher(system, of_monitor, record, interfaces)
            if watch:  # to which a router is one of those it meets
                watch += tuple(arguments)
            arguments += ["--router"] if routed else []
            settings = RunSettings(
                groups,
                tuple(arguments),
                where,
                rate,
                ticks or 0,
                watch,
                restart == ON_FAILURE,
                secure is not None,
            )
            try:
                with screen_for(policy, quiet) as screen:
                    system_run = RunningSystem(
                        description, folder, connection, settings, screen, router
                    )
                    code = system_run.run(signals)
            finally:
                with ended_after(CLOSE_TIMEOUT_S, "closing the connection"):
                    connection.close()
        except (LaunchError, TransportError) as error:
            fail(str(error))
    sys.exit(code)


def _when_reachable(
    connect: Callable[[], tuple[Connection, Router | None]], signals: StopSignals
) -> tuple[Connection, Router | None]:
    """Connect, as soon as somebody of another host is there; each attempt waits for some seconds itself."""
    from transports.interface import UnreachableError

    is_said = False
    while True:
        try:
            return connect()
        except UnreachableError as error:
            if signals.asked:
                raise
            if not is_said:
                say(f"waiting for another host: {error}")
                is_said = True


def _count(processes: int | None, secure: Path | None, transport: str) -> int | None:
    """How many processes there are to be; None: one for each node, as there is a certificate for each, and
    as it is on ROS 2 unless a number is given.
    """
    if secure is not None:
        if processes:
            fail("--processes: each node has a certificate of its own; --secure takes only `each`")
        return None
    if processes is None and transport == "ros2":
        return None
    return (os.cpu_count() or 1) if processes is None else processes or None


def _policy_apart(description: LaunchDescription, restart: str) -> list[str]:
    """With --restart the policy has a process of its own: without it, nothing goes on."""
    policy = description.policy
    return [policy.name] if restart == ON_FAILURE and policy is not None else []


_NODE_OPTIONS = {
    "endpoint": "--endpoint",
    "config": "--zenoh-config",
    "namespace": "--namespace",
    "secure": "--secure",
}
"""How a node's command line spells the transport's options."""


def _transport_options(
    transport: str,
    endpoint: str | None,
    routed: bool,
    zenoh_config: Path | None,
    secure: Path | None,
    namespace: str,
) -> dict[str, str]:
    """The options of every process's transport; only Zenoh has a meeting point."""
    options = {"namespace": namespace} if namespace else {}
    if transport == "zenoh":
        if zenoh_config is not None:
            options["config"] = str(zenoh_config)
        if secure is not None:
            if zenoh_config is not None:
                fail("--secure: the configurations are in the folder; it excludes --zenoh-config")
            options["secure"] = str(secure.absolute())
        if routed and not endpoint and zenoh_config is not None:
            fail("--router: with --zenoh-config give --endpoint, too: where the router is")
        if endpoint or zenoh_config is None:  # else the nodes meet where the file says
            default = DEFAULT_ENDPOINT if secure is None else SECURE_ENDPOINT
            options["endpoint"] = endpoint or default
    elif endpoint or routed or zenoh_config is not None or secure is not None:
        fail(
            f"--transport {transport}: --endpoint, --router, --zenoh-config and --secure are for zenoh"
        )
    return options


def _check_certificates(folder: Path, groups: Sequence[Group]) -> None:
    """TransportError, before any is started, if a process has no certificate: it would end as it starts."""
    from transports.zenoh.credentials import check

    for name in (LAUNCHER, *(group.name for group in groups)):
        check(folder, name)


def _refuse(transport: str, options: list[str], right: str) -> None:
    """End the process if ``options`` were given, which are for another transport."""
    if options:
        are = "is" if len(options) == 1 else "are"
        fail(f"--transport {transport}: {' and '.join(options)} {are} for {right}")


def _provide_ticks(policy: Policy) -> None:
    """Let the processes find ``bt_interfaces``, which is built in, where nobody has built one for ROS 2."""
    from m2c.model.builtin import FOLDER, PACKAGE
    from m2c.rosidl.build import is_importable

    types = {name for leaf in policy.leaves for name in (leaf.tick_type, leaf.halt_type)}
    if is_importable(PACKAGE) or not any(name.startswith(f"{PACKAGE}/") for name in types):
        return
    say(
        f"{PACKAGE} is not on the path: taking the built-in one (built once, in about half a minute)"
    )
    _provide(FOLDER)


def _provide_events(package: Path) -> None:
    """Let the processes find the types of the system's plain events, unless these have been built."""
    from m2c.rosidl.packages import prefixes

    types = {path.name: path.read_text() for path in package.glob("msg/*.msg")}
    for prefix in prefixes():
        share = prefix / "share" / package.name / "msg"
        if {path.name: path.read_text() for path in share.glob("*.msg")} == types:
            return
    say(f"building {package.name}, the types of the system's events (once, in about half a minute)")
    _provide(package)


def _provide(package: Path) -> None:
    from m2c.rosidl.build import InterfaceBuildError, build_once

    try:
        os.environ.update(build_once(package).environment())
    except InterfaceBuildError as error:
        fail(*error.lines)


def _generate(
    path: Path, folder: Path, changed: dict[str, Path], transport: str, lenient: bool
) -> tuple[Path, ...]:
    """Generate the system in ``path``, with the models of ``changed`` in place of its own.

    Returns:
        The folders of its interface packages.
    """
    from m2c.check.report import print_findings
    from m2c.codegen.package import system_files
    from m2c.codegen.writer import write_files
    from m2c.launch.reading import read_to_run
    from m2c.model import ModelError
    from m2c.naming import naming_for

    naming = naming_for(transport)
    system = read_to_run(path, changed, naming, lenient)
    try:
        write_files(system_files(system, naming=naming), folder)
    except ModelError as error:
        print_findings(error.diagnostics)
        sys.exit(2)
    return system.library.folders
