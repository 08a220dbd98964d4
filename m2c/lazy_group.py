"""A command group that imports a command when it runs, not before: ``--help`` stays quick."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from m2c.printable import printable
from m2c.terminal import give_up, write_to_nobody

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

_HELP = getattr(click.exceptions, "NoArgsIsHelpError", ())
"""What is raised, since click 8.2, where a group without a command shows its help."""


class LazyGroup(click.Group):
    """A group that knows its commands' names and help without importing them."""

    def __init__(
        self,
        *arguments: Any,
        lazy_commands: Mapping[str, tuple[str, str]] | None = None,
        elsewhere: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        """A click group.

        Args:
            arguments: click's.
            lazy_commands: of a name ``(module:attribute, help)``.
            elsewhere: of a word that is no command here, the command line that does what it says.
            options: click's.
        """
        super().__init__(*arguments, **options)
        self._lazy = dict(lazy_commands or {})
        self._elsewhere = dict(elsewhere or {})

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names, in order."""
        return list(self._lazy)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return the command called ``cmd_name``; None if there is none."""
        if cmd_name not in self._lazy:
            return None
        module, _, attribute = self._lazy[cmd_name][0].partition(":")
        command = getattr(importlib.import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that ``args`` begin with; a wrong name is refused with the nearest one."""
        name = args[0]
        if name not in self._lazy and not name.startswith("-") and not ctx.resilient_parsing:
            from m2c.suggestions import nearest

            right = self._elsewhere.get(name)
            hint = f"it is `{right}`" if right else nearest(name, self._lazy)
            ctx.fail(f"No such command '{name}'; {hint}")
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem[str]]:
        """Names of commands that begin with ``incomplete``, and options."""
        from click.shell_completion import CompletionItem

        begun = [name for name in self._lazy if name.startswith(incomplete)]
        names = [CompletionItem(name, help=self._lazy[name][1]) for name in begun]
        return names + click.Command.shell_complete(self, ctx, incomplete)

    def main(self, *arguments: Any, **options: Any) -> Any:
        """Run the command line: what the system refuses (a full disk, too many files) ends it in one line."""
        try:
            return super().main(*arguments, **options)
        except OSError as error:
            give_up(error)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that was named; what click says is wrong names files, and is made printable."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # as after `| head`, which is no violation
            write_to_nobody()
            ctx.exit(0)
        except click.ClickException as error:
            if not isinstance(error, _HELP):
                vars(error)["message"] = printable(error.message)  # an attribute that is final
            raise

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table of commands in ``--help``."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self._lazy.items()])
