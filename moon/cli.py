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


@click.group(
    cls=LazyGroup,
    lazy_commands=_COMMANDS,
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
