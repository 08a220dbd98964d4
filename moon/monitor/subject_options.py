"""The options by which ``moon monitor`` and ``moon check`` learn what to check."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from m2c.changes import Changes
from m2c.inputs import DecimalRange, change_options, interface_folders
from m2c.terminal import fail, say

if TYPE_CHECKING:
    from moon.monitor.subject import Monitored, Subject

SECONDS = DecimalRange(min=0, min_open=True, max=86_400 * 365)

_OPTIONS = (
    click.option(
        "--properties",
        "property_files",
        multiple=True,
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE",
        help="Monitor the properties in it, .yaml or .xml (repeatable).",
    ),
    interface_folders,
    click.option(
        "--only", multiple=True, metavar="NODE", help="Monitor only this node (repeatable)."
    ),
    click.option(
        "--without", multiple=True, metavar="NODE", help="Do not monitor it (repeatable)."
    ),
    click.option(
        "--deadline",
        type=SECONDS,
        default=1.0,
        show_default=True,
        help="Seconds within which a node must send an output that its model expects.",
    ),
    click.option(
        "--latency-bound",
        type=SECONDS,
        default=0.2,
        show_default=True,
        help="Seconds within which a subscriber takes a message, and an event reaches the monitor.",
    ),
    click.option(
        "--clock-skew",
        type=DecimalRange(min=0, max=3600),
        default=0.0,
        show_default=True,
        help="Seconds by which the clocks of the hosts differ at most; on ROS 2 at least 0.01.",
    ),
)


class Choice(NamedTuple):  # msgspec's would cost each --help its import
    """What the options say; see :class:`moon.monitor.subject.Subject`."""

    property_files: tuple[Path, ...]
    interfaces: tuple[Path, ...]
    only: tuple[str, ...]
    without: tuple[str, ...]
    deadline: float
    latency_bound: float
    clock_skew: float
    changes: Changes

    def subject(self, models: tuple[Path, ...], property_ids: tuple[str, ...] = ()) -> Subject:
        """These options, for ``models``, and of the properties those of ``property_ids`` (empty: all)."""
        from moon.monitor.subject import Subject
        from moon.oracle.bounds import Bounds

        bounds = Bounds(
            latency=round(self.latency_bound * 1e9),
            deadline=round(self.deadline * 1e9),
            skew=round(self.clock_skew * 1e9),
        )
        return Subject(
            models,
            self.property_files,
            self.interfaces,
            self.only,
            self.without,
            bounds,
            self.changes,
            property_ids,
        )


def subject_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command these options; it gets them as one argument, ``choice``."""

    @functools.wraps(command)
    def with_choice(**given: Any) -> None:
        choice = Choice(**{name: given.pop(name) for name in Choice._fields})
        command(choice=choice, **given)

    with_options = change_options(with_choice)
    for option in reversed(_OPTIONS):
        with_options = option(with_options)
    return with_options


def read_or_fail(subject: Subject) -> Monitored:
    """Read ``subject``, and say what is to be known of it; what is wrong with it ends the process."""
    from m2c.model import ModelError
    from moon.monitor.reading import SelectionError, say_why
    from moon.monitor.subject import NothingLeftError, read_subject

    if not subject.models and not subject.properties:
        raise click.UsageError("Missing argument 'MODEL...|SYSTEM' (or --properties FILE)")
    if not subject.models and (subject.only or subject.without):
        raise click.UsageError("--only and --without choose nodes of models, and there are none")
    try:
        monitored = read_subject(subject)
    except ModelError as error:
        say_why(error)
        sys.exit(2)
    except NothingLeftError as error:
        *notes, last = str(error).splitlines()
        for sentence in notes:
            say(sentence)
        fail(last)
    except SelectionError as error:
        fail(str(error))
    for sentence in monitored.notes:
        say(sentence)
    return monitored
