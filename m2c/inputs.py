"""What the commands that read models are given."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from m2c.changes import Changes
from m2c.language.numerals import decimal, integer

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

_Options = TypeVar("_Options")


def options_as(
    options: Callable[..., _Options],
) -> Callable[[Callable[[_Options], None]], Callable[..., None]]:
    """Give a command all its parameters as one value.

    Args:
        options: a class with a field for each.
    """

    def decorate(command: Callable[[_Options], None]) -> Callable[..., None]:
        @functools.wraps(command)
        def with_options(**given: Any) -> None:
            command(options(**given))

        return with_options

    return decorate


class Inputs(NamedTuple):  # msgspec's would cost each --help its import
    """What to read.

    Attributes:
        paths: models, folders of them, or one system file; or the earlier tool's.
        interfaces: folders of interface packages, and the earlier tool's lists of channels.
    """

    paths: tuple[Path, ...]
    interfaces: tuple[Path, ...]


class DecimalRange(click.FloatRange):
    """A finite number, written as in models: not ``1_0``, nor in digits of other scripts."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As ``click.FloatRange``."""
        number = decimal(value) if isinstance(value, str) else value
        if number is None or not math.isfinite(number):
            self.fail(f"{value!r} is no finite number", param, ctx)
        return super().convert(number, param, ctx)


class IntegerRange(click.IntRange):
    """A whole number within bounds, written as in models."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As ``click.IntRange``."""
        return super().convert(_integer(self, value, param, ctx), param, ctx)


class Integer(click.types.IntParamType):
    """A whole number, written as in models."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As ``click.INT``."""
        return super().convert(_integer(self, value, param, ctx), param, ctx)


def _integer(
    kind: click.ParamType[int],
    value: Any,
    param: click.Parameter | None,
    ctx: click.Context | None,
) -> Any:
    number = integer(value) if isinstance(value, str) else value
    if number is None:
        kind.fail(f"{value!r} is no whole number", param, ctx)
    return number


class ExistingPath(click.Path):
    """A path to what is there; one that is misspelt is refused with what was meant."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As ``click.Path`` with ``exists``."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            from m2c.model.paths import meant

            if hint := meant(Path(value)):
                vars(error)["message"] = f"{error.message.removesuffix('.')}; {hint}"
            raise


class TransportName(click.ParamType[str]):
    """The name of a transport; a shell completes those that are installed."""

    name = "text"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem[str]]:
        """Those that begin with ``incomplete``."""
        from click.shell_completion import CompletionItem

        from transports.registry import available

        return [CompletionItem(name) for name in available() if name.startswith(incomplete)]


interface_folders = click.option(
    "--interfaces",
    multiple=True,
    type=ExistingPath(path_type=Path, exists=True, file_okay=False),
    help="Folder of ROS interface packages (repeatable).",
)
"""The option of a command that has PATHS of its own kind; it gets a tuple, ``interfaces``."""

deployment_option = click.option(
    "--deployment",
    type=ExistingPath(path_type=Path, exists=True, dir_okay=False),
    metavar="FILE",
    help="Which nodes share a process, and where, instead of what the system file says.",
)


_CHANGES = (
    click.option(
        "--lenient",
        is_flag=True,
        help="Let strings, numbers and bools become one another as ECMAScript has it, with warnings.",
    ),
    click.option(
        "--param",
        "parameters",
        multiple=True,
        metavar="NODE.NAME=EXPR",
        help="What a variable of a node begins with (repeatable).",
    ),
    click.option(
        "--remap",
        "remaps",
        multiple=True,
        metavar="NODE:FROM:=TO",
        help="The channel that takes the place of one of a node's (repeatable).",
    ),
)

SYSTEM = Path("system.xml")
"""The system file of the current folder, which commands read that are given none."""


def change_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command that reads models the options that change them; it gets one argument, ``changes``."""

    @functools.wraps(command)
    def with_changes(**given: Any) -> None:
        changes = Changes(*(given.pop(name) for name in Changes._fields))
        command(changes=changes, **given)

    for option in reversed(_CHANGES):
        with_changes = option(with_changes)
    return with_changes


_OPTIONS = (
    click.argument("paths", nargs=-1, type=click.Path(path_type=Path)),
    click.option(
        "--interfaces",
        multiple=True,
        type=ExistingPath(path_type=Path, exists=True),
        help="Folder of ROS interface packages, or the earlier tool's INTERFACES.xml (repeatable).",
    ),
    click.option(
        "--model",
        type=click.Path(path_type=Path),
        help="The earlier tool's FULL_MODEL.xml, instead of PATHS.",
    ),
)


def input_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command PATHS and the options beside them; it gets them as one argument, ``inputs``.

    A command line that names nothing to read means the ``system.xml`` of the current folder, as that of
    ``m2c run`` does; without one it is refused.
    """

    @functools.wraps(command)
    def with_inputs(
        paths: tuple[Path, ...], interfaces: tuple[Path, ...], model: Path | None, **others: object
    ) -> None:
        named = (*paths, *([model] if model is not None else []))
        if not named and SYSTEM.is_file():
            named = (SYSTEM,)
        if not named:
            verb = click.get_current_context().info_name
            what = f"nothing to {verb}; give a model, a folder or a system file"
            raise click.UsageError(f"{what}; `m2c new NAME` makes a system")
        command(inputs=Inputs(named, interfaces), **others)

    for option in reversed(_OPTIONS):
        with_inputs = option(with_inputs)
    return with_inputs
