"""The ``m2c`` command line. A command's module is imported when it runs, not before."""

from __future__ import annotations

import click

from m2c.installed import version_option
from m2c.lazy_group import LazyGroup

_COMMANDS = {
    "check": ("m2c.check.command:check", "Check models: every fault with file:line:column."),
    "completion": (
        "m2c.completion:m2c_completion",
        "Write a script by which a shell completes m2c.",
    ),
    "convert": ("m2c.convert.command:convert", "Write models in one dialect, with today's names."),
    "deploy": ("m2c.deploy.command:deploy", "Write systemd units and a compose file of a system."),
    "doctor": (
        "m2c.doctor.command:doctor",
        "Say what works here, what does not, and what mends it.",
    ),
    "draw": ("m2c.draw.command:draw", "Draw a machine, a system's wiring or a policy."),
    "generate": ("m2c.codegen.command:generate", "Generate running Python nodes from models."),
    "interfaces": ("m2c.rosidl.command:interfaces", "Build ROS interface packages."),
    "new": ("m2c.new.command:new", "Begin a system, or add a model to one."),
    "run": ("m2c.launch.command:run", "Run a system: every node, and the policy."),
}

_ELSEWHERE = {
    "monitor": "moon monitor`, or `m2c run --monitor",
    "record": "moon record`, or `m2c run --record",
    **{name: f"moon {name}" for name in ("tap", "explain", "replay", "keys", "check-properties")},
    "report": "moon check --report",
    "watch": "m2c check --watch`, or `m2c run --watch",
    "simulate": "m2c run --transport simulated",
    "test": "m2c check",
    "build": "m2c generate`, or `m2c interfaces build",
    "init": "m2c new",
    "create": "m2c new",
    **dict.fromkeys(("mutate", "mutants", "mutation"), "make mutants"),
    "version": "m2c --version",
    "help": "m2c --help",
}
"""Words that are tried as commands, and what does what they say."""


@click.group(
    cls=LazyGroup,
    lazy_commands=_COMMANDS,
    elsewhere=_ELSEWHERE,
    context_settings={"help_option_names": ["-h", "--help"]},
    params=[version_option("m2c")],
)
def main() -> None:
    """Compile models of robot deliberation (state machines, behaviour trees) into running nodes.

    \b
    Example:
      m2c check system.xml && m2c generate system.xml -o generated && m2c run generated
    """


if __name__ == "__main__":
    main()
