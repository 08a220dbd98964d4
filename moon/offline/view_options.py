"""The options by which commands learn which part of a recording is judged, and by which of its times."""

from __future__ import annotations

import functools
from collections.abc import Callable

import click

_OPTIONS = (
    click.option(
        "--time",
        "time_text",
        default="",
        metavar="log|publish|header:FIELD|clock",
        help="By which time: when recorded, when published, by a field of the messages (a stamp, or a "
        "header with one), or by /clock. By default by the publishers' stamps, unless they contradict the "
        "recorder's.",
    ),
    click.option(
        "--from",
        "from_text",
        default="",
        metavar="TIME",
        help="Leave out what is before: seconds since the beginning or the epoch, or ISO 8601.",
    ),
    click.option("--to", "to_text", default="", metavar="TIME", help="Leave out what is after."),
)


def view_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command these options; it gets them as one argument, ``view``."""

    @functools.wraps(command)
    def with_view(time_text: str, from_text: str, to_text: str, **others: object) -> None:
        from moon.offline.view import InstantError, View, instant
        from moon.ordering.time_base import TimeChoice, TimeError, time_choice

        try:
            time = time_choice(time_text) if time_text else TimeChoice()
        except TimeError as error:
            raise click.BadParameter(str(error), param_hint="'--time'") from error
        found = []
        for name, text in (("from", from_text), ("to", to_text)):
            try:
                found.append(instant(text) if text else None)
            except InstantError as error:
                raise click.BadParameter(str(error), param_hint=f"'--{name}'") from error
        command(view=View(time, *found), **others)

    for option in reversed(_OPTIONS):
        with_view = option(with_view)
    return with_view
