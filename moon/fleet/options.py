"""The options by which ``moon monitor`` learns that it monitors a fleet."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import click

from moon.connection import Network
from moon.fleet.choice import WHOLE, ChoiceError, Shard, fleet_pattern, read_shard
from transports.descriptions import described


def _pattern(_: click.Context, __: click.Parameter, text: str | None) -> str | None:
    try:
        return None if text is None else fleet_pattern(text)
    except ChoiceError as error:
        raise click.BadParameter(str(error)) from None


def _shard(_: click.Context, __: click.Parameter, text: str | None) -> Shard | None:
    try:
        return None if text is None else read_shard(text)
    except ChoiceError as error:
        raise click.BadParameter(str(error)) from None


_OPTIONS = (
    click.option(
        "--fleet",
        "pattern",
        callback=_pattern,
        metavar="PATTERN",
        help="Monitor each robot whose namespace matches, e.g. 'robots/*', with judges of its own (zenoh).",
    ),
    click.option(
        "--shard",
        callback=_shard,
        metavar="K/N",
        help="Only share K of N of the fleet, by a hash of each robot's name.",
    ),
)


def fleet_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command these options; it gets ``fleet``: a pattern and a share, or None."""

    @functools.wraps(command)
    def with_fleet(
        pattern: str | None,
        shard: Shard | None,
        network: Network,
        record_file: Path | None,
        **others: object,
    ) -> None:
        if pattern is None:
            if shard is not None:
                raise click.UsageError("--shard is a share of a fleet; give --fleet, too")
            fleet = None
        else:
            _refuse_what_is_of_one_robot(network, record_file)
            fleet = (pattern, shard or WHOLE)
        command(fleet=fleet, network=network, record_file=record_file, **others)

    for option in reversed(_OPTIONS):
        with_fleet = option(with_fleet)
    return with_fleet


def _refuse_what_is_of_one_robot(network: Network, record_file: Path | None) -> None:
    if not described(network.transport).has_namespaces:
        raise click.UsageError(
            f"--fleet: on {network.transport} a monitor listens to one namespace; start one for each robot, "
            "with --namespace"
        )
    if network.namespace:
        raise click.UsageError(
            "--fleet names the namespaces of all robots, and --namespace that of one; give one of the two"
        )
    if network.secure is not None:
        raise click.UsageError(
            "--fleet: the certificates that `moon keys init` makes are for one robot; start a monitor for "
            "each, with --namespace, or give --zenoh-config with access control for all"
        )
    if record_file is not None:
        raise click.UsageError(
            "--fleet: a recording is of one robot; `moon record --namespace ROBOT` records it beside "
            "the monitor"
        )
