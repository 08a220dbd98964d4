"""``--version``: what is installed, and by which transports nodes can be connected."""

from __future__ import annotations

import click

DISTRIBUTION = "m2c-moon"


def version_option(program: str) -> click.Option:
    """The option ``--version`` of the command line ``program``."""

    def write(context: click.Context, _: click.Parameter, asked: bool) -> None:
        if asked and not context.resilient_parsing:
            from m2c.terminal import show

            show(*version_lines(program))
            context.exit()

    return click.Option(
        ["--version"],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=write,
        help="Show what is installed, with the transports, and exit.",
    )


def version_lines(program: str) -> list[str]:
    """The version of this project and of Python, of each transport's library, and how monitors run."""
    import sys
    from importlib.metadata import version

    from transports.registry import available

    python = ".".join(map(str, sys.version_info[:3]))
    lines = [f"{program} {version(DISTRIBUTION)} (Python {python})"]
    lines += [f"transport {name}{_library(name)}" for name in available()]
    return [*lines, f"monitors {'compiled' if is_compiled() else 'not compiled'}"]


def _library(transport: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    from transports.descriptions import described

    library = described(transport).library
    if not library:
        return ""
    try:
        return f": {library} {version(library)}"
    except PackageNotFoundError:
        return f": {library} is not installed"


def is_compiled() -> bool:
    """Whether what runs for every observation was compiled."""
    import importlib.util

    spec = importlib.util.find_spec("moon.oracle.search")
    return spec is not None and not str(spec.origin).endswith(".py")
