"""The options by which commands learn which part of a recording is judged, and by which of its times."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from moon.offline.view import Instant
    from moon.sources.time_choice import TimeChoice


def _time(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> TimeChoice | None:
    """The choice that ``text`` names."""
    if text is None:
        return None
    from moon.sources.time_choice import TimeError, time_choice

    try:
        return time_choice(text)
    except TimeError as error:
        raise click.BadParameter(str(error)) from error


def _instant(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> Instant | None:
    """The instant that ``text`` names."""
    if text is None:
        return None
    from moon.offline.view import InstantError, instant

    try:
        return instant(text)
    except InstantError as error:
        raise click.BadParameter(str(error)) from error


time_option = click.option(
    "--time",
    callback=_time,
    metavar="log|publish|header:FIELD|clock",
    help="By which time: when recorded, when published, by a field of the messages (a stamp, or a header "
    "with one), or by /clock. By default by the publishers' stamps, unless they contradict the recorder's.",
)

_OPTIONS = (
    time_option,
    click.option(
        "--from",
        "from_",
        callback=_instant,
        metavar="TIME",
        help="Leave out what is before: seconds since the beginning or the epoch, or ISO 8601.",
    ),
    click.option("--to", callback=_instant, metavar="TIME", help="Leave out what is after."),
)


def view_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command these options; it gets them as one argument, ``view``."""

    @functools.wraps(command)
    def with_view(
        time: TimeChoice | None, from_: Instant | None, to: Instant | None, **others: object
    ) -> None:
        from moon.offline.view import View

        found = View(from_=from_, to=to) if time is None else View(time, from_, to)
        command(view=found, **others)

    for option in reversed(_OPTIONS):
        with_view = option(with_view)
    return with_view
