"""The options of ``m2c run`` that only a system in virtual time has."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import click

from m2c.inputs import DecimalRange, Integer
from m2c.language.numerals import decimal

TRANSPORT = "simulated"
"""The transport that these options are for."""
LONGEST_S = 86_400.0 * 365
"""A run that is to end by something else than time."""
_LONGEST_MS = 3_600_000.0


class Simulation(NamedTuple):  # msgspec's would cost each --help its import
    """What these options say; None where they say nothing.

    Attributes:
        seconds: of virtual time, after which the run ends.
        seed: decides everything that is random.
        speed: seconds of virtual time in one of real time.
        delay_s: shortest and longest time that a message is under way.
        loss: probability that a message of a best-effort topic is lost.
        tap_loss: probability that an observation is lost.
        semantics: what models mean (``m2c.simulation.semantics.Semantics``).
    """

    seconds: float | None
    seed: int | None
    speed: float | None
    delay_s: tuple[float, float] | None
    loss: float | None
    tap_loss: float | None
    semantics: str | None

    def given(self) -> list[str]:
        """The options that were given."""
        names = ("--for", "--seed", "--speed", "--delay", "--loss", "--tap-loss", "--semantics")
        return [name for name, value in zip(names, self, strict=True) if value is not None]


def _delay(
    _: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    """``5`` or ``1..20``, in milliseconds, as a pair of seconds."""
    if text is None:
        return None
    least, dots, most = text.partition("..")
    shortest, longest = decimal(least), decimal(most if dots else least)
    if shortest is None or longest is None or not 0 <= shortest <= longest <= _LONGEST_MS:
        raise click.BadParameter(
            f"{text!r} is no delay; write milliseconds (5), or the shortest and the longest (1..20)"
        )
    return shortest / 1e3, longest / 1e3


_POSITIVE = DecimalRange(min=0, min_open=True)
_PROBABILITY = DecimalRange(min=0, max=1)
_OPTIONS = (
    click.option(
        "--for",
        "seconds",
        type=DecimalRange(min=0, min_open=True, max=LONGEST_S),
        help="Simulated: stop after this many seconds of virtual time; by default the system's `max_time`, "
        "or 60, and with --ticks as long as they take.",
    ),
    click.option("--seed", type=Integer(), help="Simulated: decides what is random.  [default: 0]"),
    click.option(
        "--speed",
        type=_POSITIVE,
        help="Simulated: so many times as fast as real time; by default as fast as it goes.",
    ),
    click.option(
        "--delay",
        "delay_s",
        callback=_delay,
        metavar="MS|MIN..MAX",
        help="Simulated: how long a message is under way.  [default: 0.1]",
    ),
    click.option(
        "--loss",
        type=_PROBABILITY,
        help="Simulated: probability that a message of a best-effort topic is lost.  [default: 0]",
    ),
    click.option(
        "--tap-loss",
        type=_PROBABILITY,
        help="Simulated: the same of what --monitor and --record receive.  [default: 0]",
    ),
    click.option(
        "--semantics",
        type=click.Choice(["deployed", "as2fm"]),
        help="Simulated: what models mean: SCXML with queues, as robots run it, or AS2FM's steps.  "
        "[default: deployed]",
    ),
)


def simulation_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command these options; it gets them as one argument, ``simulation``."""

    @functools.wraps(command)
    def with_simulation(**given: Any) -> None:
        simulation = Simulation(**{name: given.pop(name) for name in Simulation._fields})
        command(simulation=simulation, **given)

    for option in reversed(_OPTIONS):
        with_simulation = option(with_simulation)
    return with_simulation
