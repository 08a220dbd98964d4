"""The ``moon`` command line. A command's module is imported when it runs, not before."""

from __future__ import annotations

import click

from m2c.installed import version_option
from m2c.lazy_group import LazyGroup

_COMMANDS = {
    "tap": ("moon.tap.command:tap", "Show every message, call and action, live and decoded."),
    "monitor": ("moon.monitor.command:monitor", "Check a running system against its models."),
    "record": ("moon.recording.command:record", "Record everything that happens to an MCAP file."),
    "check": ("moon.offline.command:check", "Check recorded runs as `moon monitor` does live."),
    "explain": ("moon.explain.command:explain", "Say what a monitor can check of a model."),
    "replay": ("moon.replay.command:replay", "Play the nodes of a recording against running ones."),
    "keys": ("moon.keys.command:keys", "Secure a system: certificates and access control."),
    "check-properties": (
        "moon.properties.command:check_properties",
        "Check property files and say what each property means.",
    ),
    "completion": (
        "m2c.completion:moon_completion",
        "Write a script by which a shell completes moon.",
    ),
}

_ELSEWHERE = {
    **{name: f"m2c {name}" for name in ("run", "generate", "new", "doctor", "deploy", "draw")},
    **{name: f"m2c {name}" for name in ("convert", "interfaces")},
    "report": "moon check --report",
    "fleet": "moon monitor --fleet",
    "properties": "moon check-properties",
    "watch": "moon tap`, or `moon monitor",
    "listen": "moon tap",
    "play": "moon replay",
    **dict.fromkeys(("mutate", "mutants", "mutation"), "make mutants"),
    "version": "moon --version",
    "help": "moon --help",
}
"""Words that are tried as commands, and what does what they say."""


@click.group(
    cls=LazyGroup,
    lazy_commands=_COMMANDS,
    elsewhere=_ELSEWHERE,
    context_settings={"help_option_names": ["-h", "--help"]},
    params=[version_option("moon")],
)
def main() -> None:
    """Observe a running robot system passively, and check it against its models and properties.

    \b
    Example:
      moon tap '/BatteryLevelSkill/*'
      moon monitor system.xml --properties properties.yaml
    """


if __name__ == "__main__":
    main()
