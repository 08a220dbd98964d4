"""The ``m2c run`` command."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click

from m2c.inputs import (
    SYSTEM,
    DecimalRange,
    ExistingPath,
    IntegerRange,
    TransportName,
    change_options,
    deployment_option,
    interface_folders,
    options_as,
)
from m2c.language.numerals import integer
from m2c.launch.options import ON_FAILURE, RunOptions
from m2c.launch.restarts import MOST_RESTARTS
from m2c.launch.simulation_options import TRANSPORT as SIMULATED
from m2c.launch.simulation_options import simulation_options
from m2c.terminal import fail
from transports.descriptions import described
from transports.options import DEFAULT_ENDPOINT

_MONITOR_OPTIONS = "--monitor-options"
EACH = "each"
"""The value of ``--processes`` that gives each node one."""
MOST_PROCESSES = 1000


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
        number = integer(text)
        if number is None or not 0 < number <= MOST_PROCESSES:
            self.fail(f"{text!r} is neither a number from 1 to {MOST_PROCESSES} nor {EACH!r}")
        return number


class _Run(click.Command):
    """``--monitor`` with options or without: to click, what begins with a dash is no option's value."""

    def parse_args(self, context: click.Context, arguments: list[str]) -> list[str]:
        """As ``click.Command``."""
        words = []
        for argument in arguments:
            name, equals, value = argument.partition("=")
            words += [_MONITOR_OPTIONS, value] if name == "--monitor" and equals else [argument]
        try:
            return super().parse_args(context, words)
        except click.NoSuchOption as error:
            if "--monitor" in arguments or error.option_name == "--properties":
                written = f'--monitor="{error.option_name} …"'
                vars(error)["message"] = (
                    f"{error.message} What `moon monitor` takes is in {written}."
                )
                vars(error)["possibilities"] = None
            raise


@click.command(cls=_Run)
@click.argument("system", type=click.Path(path_type=Path), default=SYSTEM)
@interface_folders
@click.option(
    "--transport", type=TransportName(), default="zenoh", show_default=True, help="The middleware."
)
@click.option(
    "--rate",
    type=DecimalRange(min=0, min_open=True),
    help="Ticks of the tree a second; by default the system file's.",
)
@click.option("--ticks", type=IntegerRange(min=1), help="Stop after this many ticks.")
@click.option("--only", multiple=True, metavar="NODE", help="Run only this node (repeatable).")
@click.option("--without", multiple=True, metavar="NODE", help="Leave this node out (repeatable).")
@click.option(
    "--replace",
    "replacements",
    multiple=True,
    metavar="NODE=PATH",
    help="Run something else in a node's place: a model, a generated package, or a node written by hand "
    "(repeatable).",
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
    "--observer",
    "observers",
    multiple=True,
    metavar="NODE",
    help="Begin once this node, a monitor that is there before, receives all that nodes send (repeatable).",
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
@change_options
@click.option(
    "--tick-timeout",
    type=DecimalRange(min=0, min_open=True),
    metavar="SECONDS",
    help="How long a leaf may take to answer a tick; it counts as FAILURE then.  [default: 5]",
)
@click.option(
    "--log-level",
    type=click.Choice(["DEBUG", "INFO", "WARNING", "ERROR"], case_sensitive=False),
    help="The least severity that nodes log.  [default: INFO]",
)
@click.option(
    "--log-dir",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Add what each node prints to DIR/<node>.log, too.",
)
@click.option(
    "--watch",
    "watched",
    is_flag=True,
    help="Start the node of a model that has changed again, as it is now; each node has its own process.",
)
@click.option("--quiet", is_flag=True, help="Do not show the tree's ticks.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line, for programs.")
@simulation_options
@options_as(RunOptions)
def run(options: RunOptions) -> None:
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
    from m2c.launch.description import FILE as LAUNCH_FILE
    from m2c.launch.reading import parse_replacements
    from m2c.launch.watching import watch_options
    from m2c.logs import log_as_lines

    system = options.system
    if not os.path.exists(system):
        from m2c.model.paths import meant

        wanted = meant(system) or "expected a system file, or a folder made by `m2c generate`"
        if system == SYSTEM and not meant(system):
            wanted = "name a system file, or a folder made by `m2c generate`; `m2c new NAME` makes a system"
        fail(f"{system}: no such file or folder; {wanted}")
    if (system / SYSTEM).is_file() and not (system / LAUNCH_FILE).exists():
        fail(f"{system} is no folder made by `m2c generate`; its system is {system / SYSTEM}")
    changed = parse_replacements(options.replacements)
    log_as_lines()
    changes = options.changes
    for name, given in (
        ("--lenient", changes.lenient),
        ("--param", changes.parameters),
        ("--remap", changes.remaps),
        ("--interfaces", options.interfaces),
    ):
        if given and system.is_dir():
            fail(f"{name}: these nodes are generated already; give it to `m2c generate`")
    if options.watched:
        _check_watched(options)
    is_plain = options.monitored and options.monitor is None
    of_monitor = watch_options(system, "" if is_plain else options.monitor, options.as_json)
    if of_monitor is not None:
        of_monitor += changes.words()
        of_monitor += [word for path in options.interfaces for word in ("--interfaces", str(path))]
    if described(options.transport).is_one_process:
        _refuse(options.transport, options.of_a_middleware(), "a middleware")
        from m2c.launch.simulated import run_simulated

        sys.exit(run_simulated(options, changed, of_monitor))
    _refuse(options.transport, options.simulation.given(), SIMULATED)
    from m2c.launch.deployed import run_deployed

    sys.exit(run_deployed(options, changed, of_monitor))


def _check_watched(options: RunOptions) -> None:
    """End the process if ``--watch`` is given with what does not go with it."""
    if options.system.is_dir():
        fail("--watch: these nodes are generated already; give the system file as SYSTEM")
    if options.monitored or options.monitor is not None:
        why = "it would judge a changed node by the old model"
        fail(f"--watch excludes --monitor: {why}; start `moon monitor` when you are done")
    if options.processes or options.deployment is not None or options.host is not None:
        why = "each node has a process of its own"
        fail(f"--watch excludes --processes N, --deployment and --host: {why}")


def _refuse(transport: str, options: list[str], right: str) -> None:
    """End the process if ``options`` were given, which are for another transport."""
    if options:
        are = "is" if len(options) == 1 else "are"
        fail(f"--transport {transport}: {' and '.join(options)} {are} for {right}")
