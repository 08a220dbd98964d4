"""The ``moon check-properties`` command."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.terminal import say, show

if TYPE_CHECKING:
    from moon.properties.property import Property


@click.command("check-properties")
@click.argument(
    "paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE..."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a property, for pipes.")
def check_properties(paths: tuple[Path, ...], as_json: bool) -> None:
    """Check property files (XML or YAML) and say what each property means.

    For every property: its formula, its meaning in one sentence, the deadline it implies. Every
    finding names file, line and column, and what would be right. Exit code 0: no errors; 2: errors.

    Example: moon check-properties examples/lab_tour/properties.yaml
    """
    from m2c.model.diagnostics import DiagnosticLog
    from moon.properties.files import read_properties

    log = DiagnosticLog()
    found: list[Property] = []
    for path in paths:
        for item in read_properties(path, log):
            if any(item.name == other.name for other in found):
                log.error(
                    "bad-property-file", item.position, "", f"`{item.name}` is declared twice"
                )
            found.append(item)
    for item in found:
        show(*([_as_json(item)] if as_json else _as_text(item)))
    diagnostics = sorted(log.diagnostics, key=lambda finding: (finding.position, finding.rule))
    say(*map(str, diagnostics))
    errors = sum(finding.severity == "error" for finding in diagnostics)
    if not as_json:
        show(
            f"{len(found)} propert{'y' if len(found) == 1 else 'ies'}, "
            f"{errors} error{'s' * (errors != 1)}"
        )
    sys.exit(2 if errors else 0)


def _as_text(item: Property) -> list[str]:
    from moon.properties.formula import text
    from moon.properties.meaning import duration

    limit = duration(item.deadline_ticks) if item.deadline_ticks is not None else "none"
    lines = [
        f"{item.name}  ({item.role}, {item.severity})",
        f"  meaning   {item.meaning}",
        f"  formula   {text(item.formula)}",
        f"  deadline  {limit}",
    ]
    if item.text:
        lines.append(f"  operator  {item.text}")
    return lines


def _as_json(item: Property) -> str:
    from moon.json_lines import versioned_line
    from moon.properties.formula import text

    return versioned_line(
        {
            "id": item.name,
            "role": item.role,
            "severity": item.severity,
            "meaning": item.meaning,
            "formula": text(item.formula),
            "deadline_ns": item.deadline_ticks,
            "text": item.text,
            "position": str(item.position),
            "channels": sorted({port.channel for port in item.ports}),
        }
    ).decode()
