"""The ``m2c`` command line. A command's module is imported when it runs, not before."""

from __future__ import annotations

import importlib

import click

_COMMANDS = {
    "check": ("m2c.check.command:check", "Check models: every fault with file:line:column."),
    "generate": ("m2c.codegen.command:generate", "Generate running Python nodes from models."),
    "interfaces": ("m2c.rosidl.command:interfaces", "Build ROS interface packages."),
    "run": ("m2c.launch.command:run", "Run a system: every node, and the policy."),
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
@click.version_option(package_name="m2c-moon", prog_name="m2c")
def main() -> None:
    """Compile models of robot deliberation (state machines, behaviour trees) into running nodes.

    Example: m2c check system.xml && m2c generate system.xml -o generated && m2c run generated
    """


if __name__ == "__main__":
    main()
