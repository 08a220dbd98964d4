"""``m2c completion``, ``moon completion``: a shell is told to ask the command, which knows its options."""

from __future__ import annotations

import click

SHELLS = ("bash", "zsh", "fish")
_HELP = """Write the script by which a shell completes `{0}`: commands, options, their values, files.

The script asks `{0}` at each completion, so it stays right when {0} is upgraded.

\b
bash: {0} completion bash > ~/.local/share/bash-completion/completions/{0}
zsh:  {0} completion zsh > "${{fpath[1]}}/_{0}"
fish: {0} completion fish > ~/.config/fish/completions/{0}.fish

\b
Example:
  {0} completion bash
"""


def _completion_of(program: str) -> click.Command:
    def completion(shell: str) -> None:
        from click.shell_completion import get_completion_class

        from m2c.terminal import show

        command = click.get_current_context().find_root().command
        made = get_completion_class(shell)
        assert made is not None
        asks = made(command, {}, program, f"_{program.upper()}_COMPLETE")
        show(*(asks.source_template % asks.source_vars()).splitlines())

    argument = click.Argument(["shell"], type=click.Choice(SHELLS))
    help_text = _HELP.format(program)
    return click.Command("completion", params=[argument], callback=completion, help=help_text)


m2c_completion = _completion_of("m2c")
moon_completion = _completion_of("moon")
