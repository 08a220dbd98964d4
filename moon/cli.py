"""The ``moon`` command line. A command's module is imported when it runs, not before."""

from __future__ import annotations

import importlib

import click

_COMMANDS = {
    "tap": ("moon.tap.command:tap", "Watch everything that happens, live and decoded."),
}


class LazyGroup(click.Group):
    """A group that knows its commands' names and help without importing them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names, in order."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return the command called ``cmd_name``."""
        if cmd_name not in _COMMANDS:
            return None
        module, _, attribute = _COMMANDS[cmd_name][0].partition(":")
        command = getattr(importlib.import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table of commands in ``--help``."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in _COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="m2c-moon", prog_name="moon")
def main() -> None:
    """Watch a running robot system without touching it.

    Example: moon tap '/BatteryLevelSkill/*' --endpoint tcp/127.0.0.1:7447
    """


if __name__ == "__main__":
    main()
