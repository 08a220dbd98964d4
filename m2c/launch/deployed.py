"""``m2c run`` on a middleware: the nodes of a system in processes of this host."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from m2c.check.report import print_findings
from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.launch.description import (
    LaunchDescription,
    LaunchError,
    is_code,
    read_description,
    read_policy_of,
    replace,
    select,
)
from m2c.launch.grouping import Group, deployed, grouped
from m2c.launch.options import RunOptions
from m2c.launch.reading import planned, read_to_run
from m2c.launch.reloading import Models
from m2c.launch.router import Router, met_at_router
from m2c.launch.screen import Guarded, Said, screen_for
from m2c.launch.system import RunningSystem, RunSettings
from m2c.launch.watching import watcher
from m2c.model import ModelError
from m2c.model.event_types import PACKAGE as EVENTS
from m2c.naming import naming_for
from m2c.policy.program import Policy
from m2c.terminal import fail, say
from transports.descriptions import described
from transports.interface import Connection, TransportError, UnreachableError
from transports.open_files import FOR_A_CONNECTION, allow_open_files
from transports.options import DEFAULT_ENDPOINT, LAUNCHER, SECURE_ENDPOINT, meeting_at
from transports.registry import connect
from transports.stop_signals import StopSignals
from transports.watchdog import ended_after
from transports.zenoh_link.refusals import ask_for_refusals, ask_nodes_for_refusals, own_refusals

FILES_OF_PROCESS = 4
"""The launcher's files for each node: its output, its links, and some for a moment as it starts."""
CLOSE_TIMEOUT_S = 10.0
"""How long the launcher's own connection may take to close, when all nodes have ended. Fast DDS waits for
ever where a node that was killed has left a lock in shared memory."""


class _Prepared(msgspec.Struct, frozen=True):
    """What is to be run.

    Attributes:
        folder: of the generated system.
        description: its nodes that are run.
        policy: its tree, if that is run.
        groups: what each process runs.
        interfaces: folders of interface packages.
        models: what is looked at while it runs, and takes the place of what it was; None: nothing.
    """

    folder: Path
    description: LaunchDescription
    policy: Policy | None
    groups: tuple[Group, ...]
    interfaces: tuple[Path, ...]
    models: Models | None = None


def run_deployed(
    options: RunOptions, changed: dict[str, Path], of_monitor: list[str] | None
) -> int:
    """Run the nodes of a system in processes, and tick its policy.

    Args:
        options: the command line.
        changed: what is run in nodes' places, by their names.
        of_monitor: the options of the monitor, if there is to be one.

    Returns:
        The exit code; what keeps the system from being started ends the process with 2.
    """
    with (
        tempfile.TemporaryDirectory(prefix="m2c-run-") as scratch,
        contextlib.ExitStack() as at_router,
    ):
        try:
            prepared = _prepare(options, changed, Path(scratch) / "system")
            return _run(options, prepared, of_monitor, at_router)
        except (LaunchError, TransportError) as error:
            fail(str(error))


def _prepare(options: RunOptions, changed: dict[str, Path], generated: Path) -> _Prepared:
    """Generate the system into the folder ``generated``, unless it is already, and deal out its nodes."""
    system, transport = options.system, options.transport
    folder = system if system.is_dir() else generated
    interfaces: tuple[Path, ...] = ()
    models_run = None
    if not system.is_dir():
        interfaces, models_run = _generate(options, folder, changed)
    models = {name: path for name, path in changed.items() if not is_code(path)}
    if system.is_dir() and models:
        name, path = next(iter(models.items()))
        fail(f"--replace {name}={path}: replacing by a model needs the system file as SYSTEM")
    description = read_description(folder)
    plan = planned(description, options.deployment, options.host, options.processes)
    description = select(description, options.only, options.without)
    packages = {name: path for name, path in changed.items() if is_code(path)}
    description = replace(description, folder, packages)
    policy = read_policy_of(description, folder)
    if options.ticks and policy is None:
        fail(f"--ticks {options.ticks}: the policy is not run, so nothing is ticked")
    if options.tick_timeout and policy is None:
        fail(
            f"--tick-timeout {options.tick_timeout:g}: the policy is not run, so nothing is ticked"
        )
    needs_packages = described(transport).needs_packages
    if needs_packages and policy is not None:
        _provide_ticks(policy)
    if os.path.isdir(events := folder / EVENTS):
        interfaces = (*interfaces, events)
        if needs_packages:
            _provide_events(events)
    if plan:
        groups = deployed(description, plan, options.host or "", packages)
    else:
        apart = [*packages, *_policy_apart(description, options.restarts)]
        count = _count(0 if options.watched else options.processes, options.secure)
        groups = grouped(description, count, apart)
    return _Prepared(folder, description, policy, tuple(groups), interfaces, models_run)


def _run(
    options: RunOptions,
    prepared: _Prepared,
    of_monitor: list[str] | None,
    at_router: contextlib.ExitStack,
) -> int:
    """Start what is prepared and wait for its end; ``at_router`` ends the router that was started for it."""
    groups = prepared.groups
    allow_open_files(FOR_A_CONNECTION + FILES_OF_PROCESS * (len(groups) + 1))
    of_transport = _transport_options(options)
    signals = StopSignals()
    heard = False
    if options.secure is not None:
        _check_certificates(options.secure, groups)
        heard = ask_for_refusals()

    def meet() -> tuple[Connection, Router | None]:
        if options.routed:
            return at_router.enter_context(
                met_at_router(options.transport, prepared.folder, of_transport)
            )
        return connect(options.transport, LAUNCHER, meeting_at(of_transport)), None

    with (
        screen_for(prepared.policy, options.quiet, as_json=options.as_json) as screen,
        contextlib.ExitStack() as reading,
    ):
        if heard:
            guarded = Guarded(screen, lambda _: None)
            width = max(len(name) for name in (LAUNCHER, *(group.name for group in groups)))
            reading.enter_context(own_refusals(lambda text: guarded.said(_own(text), width)))
        connection, router = meet() if options.host is None else _when_reachable(meet, signals)
        if heard:
            ask_nodes_for_refusals()
        settings = _settings(options, prepared, of_transport, of_monitor)
        try:
            system = RunningSystem(
                *(prepared.description, prepared.folder, connection, settings, screen, router),
                models=prepared.models,
            )
            return system.run(signals)
        finally:
            with ended_after(CLOSE_TIMEOUT_S, "closing the connection"):
                connection.close()


def _own(text: str) -> Said:
    """A line of the launcher's own middleware."""
    return Said(LAUNCHER, text, time.time_ns())


def _settings(
    options: RunOptions,
    prepared: _Prepared,
    of_transport: dict[str, str],
    of_monitor: list[str] | None,
) -> RunSettings:
    """How the processes are started, and what is said of them."""
    where = f"on {options.transport}"
    if described(options.transport).has_endpoints:
        the_router = "the router " if options.routed else ""
        files = f"the endpoints of {options.zenoh_config}"
        where = f"at {the_router}{of_transport.get('endpoint') or files}"
    arguments = ["--transport", options.transport]
    for name, value in of_transport.items():
        arguments += [_NODE_OPTIONS[name], value]
    watch = watcher(options.system, of_monitor, options.record, prepared.interfaces)
    if watch:  # to which a router is one of those it meets
        watch += tuple(arguments)
    arguments += ["--router"] if options.routed else []
    arguments += ["--log-level", options.log_level] if options.log_level else []
    return RunSettings(
        prepared.groups,
        tuple(arguments),
        where,
        options.rate,
        options.ticks or 0,
        watch,
        options.restarts,
        options.secure is not None,
        options.observers,
        options.tick_timeout,
        options.log_dir,
    )


def _when_reachable(
    connect: Callable[[], tuple[Connection, Router | None]], signals: StopSignals
) -> tuple[Connection, Router | None]:
    """Connect, as soon as somebody of another host is there; each attempt waits for some seconds itself."""
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


def _count(processes: int | None, secure: Path | None) -> int | None:
    """How many processes there are to be; None: one for each node, as there is a certificate for each."""
    if secure is not None:
        if processes:
            fail("--processes: each node has a certificate of its own; --secure takes only `each`")
        return None
    return (os.cpu_count() or 1) if processes is None else processes or None


def _policy_apart(description: LaunchDescription, restarts: bool) -> list[str]:
    """With --restart the policy has a process of its own: without it, nothing goes on."""
    policy = description.policy
    return [policy.name] if restarts and policy is not None else []


_NODE_OPTIONS = {
    "endpoint": "--endpoint",
    "config": "--zenoh-config",
    "namespace": "--namespace",
    "secure": "--secure",
}
"""How a node's command line spells the transport's options."""


def _transport_options(run: RunOptions) -> dict[str, str]:
    """The options of every process's transport; not every one has a meeting point."""
    options = {"namespace": run.namespace} if run.namespace else {}
    if described(run.transport).has_endpoints:
        if run.zenoh_config is not None:
            options["config"] = str(run.zenoh_config)
        if run.secure is not None:
            if run.zenoh_config is not None:
                fail("--secure: the configurations are in the folder; it excludes --zenoh-config")
            options["secure"] = str(run.secure.absolute())
        if run.routed and not run.endpoint and run.zenoh_config is not None:
            fail("--router: with --zenoh-config give --endpoint, too: where the router is")
        if run.endpoint or run.zenoh_config is None:  # else the nodes meet where the file says
            default = DEFAULT_ENDPOINT if run.secure is None else SECURE_ENDPOINT
            options["endpoint"] = run.endpoint or default
    elif run.endpoint or run.routed or run.zenoh_config is not None or run.secure is not None:
        fail(
            f"--transport {run.transport}: --endpoint, --router, --zenoh-config and --secure are for zenoh"
        )
    return options


def _check_certificates(folder: Path, groups: Sequence[Group]) -> None:
    """TransportError, before any is started, if a process has no certificate: it would end as it starts."""
    from transports.zenoh_link.credentials import check

    for name in (LAUNCHER, *(group.name for group in groups)):
        check(folder, name)


def _provide_ticks(policy: Policy) -> None:
    """Let the processes find ``bt_interfaces``, which is built in, where nobody has built one for ROS 2."""
    from m2c.model.builtin import FOLDER, PACKAGE
    from m2c.rosidl.build import OUTPUT, SETUP_SCRIPT, is_importable

    types = {name for leaf in policy.leaves for name in (leaf.tick_type, leaf.halt_type)}
    if is_importable(PACKAGE) or not any(name.startswith(f"{PACKAGE}/") for name in types):
        return
    script = OUTPUT / SETUP_SCRIPT
    own = f"; what was built here is used after `. {script}`" if script.is_file() else ""
    say(
        f"{PACKAGE} is not on the path: taking the built-in one (built once, in about half a minute){own}"
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
    options: RunOptions, folder: Path, changed: dict[str, Path]
) -> tuple[tuple[Path, ...], Models | None]:
    """Generate the system into ``folder``, with the models of ``changed`` in place of its own.

    Returns:
        The folders of its interface packages, and its models, if they are watched.
    """
    naming = naming_for(options.transport)
    system = read_to_run(options, changed, naming)
    try:
        write_files(system_files(system, naming=naming), folder)
    except ModelError as error:
        print_findings(error.diagnostics)
        sys.exit(2)
    watched = Models(options, changed, naming, system, folder) if options.watched else None
    return system.library.folders, watched
