"""The options by which ``moon monitor`` and ``moon check`` learn where verdicts go."""

from __future__ import annotations

from pathlib import Path

import click

json_option = click.option(
    "--json", "as_json", is_flag=True, help="One JSON object a line, for pipes."
)
log_option = click.option(
    "--log",
    "log_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Append every verdict to this file, a JSON object a line.",
)
