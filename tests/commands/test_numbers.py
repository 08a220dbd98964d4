"""Options that are numbers: decimal, of the digits 0 to 9, finite; of every command."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest

from m2c.cli import main as m2c
from m2c.inputs import DecimalRange, Integer, IntegerRange
from moon.cli import main as moon

NUMBERS = (
    *(click.IntRange, click.FloatRange),
    *(click.types.IntParamType, click.types.FloatParamType),
)


def options(command: click.Command, name: str) -> Iterator[tuple[str, click.Parameter]]:
    """Every option of ``command`` and of those in it, with the words that lead to it."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for inner in command.list_commands(context):
            found = command.get_command(context, inner)
            assert found is not None
            yield from options(found, f"{name} {inner}")
    yield from ((f"{name} {option.opts[0]}", option) for option in command.params)


ALL = dict([*options(m2c, "m2c"), *options(moon, "moon")])
NUMERIC = {name: option.type for name, option in ALL.items() if isinstance(option.type, NUMBERS)}


def test_there_are_numbers_of_all_kinds() -> None:
    assert len(NUMERIC) > 20
    assert {type(kind) for kind in NUMERIC.values()} == {DecimalRange, Integer, IntegerRange}


@pytest.mark.parametrize("name", NUMERIC)
@pytest.mark.parametrize(
    "text", ["1_0", "\u0663", "1\u0663", "\uff13", "", "nan", "inf", "1e999", "1 0", "0x1", "ten"]
)
def test_what_is_no_number_to_other_tools_is_none_here(name: str, text: str) -> None:
    with pytest.raises(click.BadParameter, match=r"is no (finite|whole) number"):
        NUMERIC[name].convert(text, None, None)


@pytest.mark.parametrize("name", NUMERIC)
@pytest.mark.parametrize("text", ["1", "+1", " 1 ", "01"])
def test_what_is_one_is_one(name: str, text: str) -> None:
    assert NUMERIC[name].convert(text, None, None) == 1
