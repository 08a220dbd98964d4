"""``m2c doctor``."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.inputs import TransportName
from m2c.printable import printable
from m2c.terminal import fail, folded, has_colour, show, show_painted
from transports.options import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from transports.diagnosis import Finding

_STATES = 9
"""The column of states, and two spaces."""


@click.command()
@click.option(
    "--transport",
    "transports",
    type=TransportName(),
    multiple=True,
    help="Look at this transport, which has to work (repeatable).  [default: all that are installed]",
)
@click.option(
    "--endpoint", default="", help=f"Zenoh: where the nodes meet.  [default: {DEFAULT_ENDPOINT}]"
)
@click.option(
    "--secure",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Zenoh: look at the certificates in DIR, and connect with one of them.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="A line of JSON for each thing, for programs."
)
def doctor(transports: tuple[str, ...], endpoint: str, secure: Path | None, as_json: bool) -> None:
    """Say what works on this host, what is missing, what is wrong, and what mends it.

    Looked at: Python, packages, the clock; on Zenoh loopback, gossip, who is at the endpoint, ZENOH_*
    variables, certificates; on ROS 2 its wheels, its variables, and whether two nodes reach each other.
    Nothing is changed. On ROS 2 two nodes are up for a moment, and on Zenoh a session that says nothing.

    Exit code 0, 1 if something is wrong, or a named transport misses something, or 2 if there is no such
    transport.

    \b
    Example:
      m2c doctor
      m2c doctor --transport ros2
      m2c doctor --endpoint tls/192.168.1.10:7447 --secure keys
    """
    from concurrent.futures import ThreadPoolExecutor

    from m2c.doctor.host import host
    from m2c.json_lines import versioned_line
    from m2c.suggestions import nearest
    from transports.diagnosis import State, diagnose
    from transports.registry import available

    installed = available()
    for name in transports:
        if name not in installed:
            fail(f"no transport {name} is installed; {nearest(name, installed)}")
    wanted = list(dict.fromkeys(transports)) or installed
    options = {"endpoint": endpoint, "secure": "" if secure is None else str(secure)}
    with ThreadPoolExecutor(len(wanted)) as at_once:
        found = list(host())
        for findings in at_once.map(lambda name: diagnose(name, options), wanted):
            found += findings
    if as_json:
        show(*(versioned_line(finding).decode() for finding in found))
    else:
        _show(found)
    needed = {State.WRONG, State.MISSING} if transports else {State.WRONG}
    sys.exit(1 if any(finding.state in needed for finding in found) else 0)


def _show(found: Sequence[Finding]) -> None:
    """A line for each finding, below it what mends it, and at the end how many there are of each state."""
    from transports.diagnosis import State

    shades = {State.WORKS: 32, State.NOTE: 36, State.MISSING: 33, State.WRONG: 31}
    colour = has_colour()
    subjects = max(len(finding.subject) for finding in found)
    indent = _STATES + subjects + 2
    for finding in found:
        state = f"{finding.state:<{_STATES}}"
        if colour:
            state = f"\x1b[{shades[finding.state]}m{state}\x1b[0m"
        line = f"{state}{finding.subject:<{subjects}}  {printable(finding.text)}"
        show_painted(*folded(line, indent))
        if finding.mend:
            show(f"{'':{indent}}→ {finding.mend}")
    counts = Counter(finding.state for finding in found)
    said = {State.NOTE: "note" if counts[State.NOTE] == 1 else "notes"}
    show(", ".join(f"{counts[one]} {said.get(one, one)}" for one in State if counts[one]))
