"""The ``moon check-properties`` command."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.changes import Changes
from m2c.inputs import change_options, interface_folders
from m2c.terminal import fail, say, show

if TYPE_CHECKING:
    from moon.properties.files.interfaces import Interfaces
    from moon.properties.property import Property


@click.command("check-properties")
@click.argument(
    "paths",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    metavar="FILE... [MODEL...|SYSTEM]",
)
@interface_folders
@change_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object a property, for pipes.")
def check_properties(
    paths: tuple[Path, ...], interfaces: tuple[Path, ...], changes: Changes, as_json: bool
) -> None:
    """Check property files (XML or YAML) and say what each property means.

    For every property: its formula, its meaning in one sentence, the deadline it implies. With models
    (.scxml, .ascxml), folders of them, or one system file, its channels, fields and types are checked
    against theirs. Every finding names file, line and column, and what would be right.

    Exit code 0: no errors; 2: errors.

    \b
    Example:
      moon check-properties examples/lab_tour/properties.yaml examples/lab_tour/system.xml
    """
    from m2c.diagnostics import DiagnosticLog
    from moon.properties.files import read_properties

    files = tuple(path for path in paths if not _is_model(path))
    if not files:
        fail("all that is named are models; give a property file, too (.yaml or .xml)")
    models = tuple(path for path in paths if path not in files)
    known = _interfaces(models, interfaces, changes)
    log = DiagnosticLog()
    found: list[Property] = []
    for path in files:
        for item in read_properties(path, log, known):
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


def _is_model(path: Path) -> bool:
    """Whether ``path`` is a model, a folder of them or a system file, rather than a property file."""
    from m2c.diagnostics import DiagnosticLog
    from m2c.model.system import SYSTEM_ROOTS, is_model
    from m2c.model.xml import read_xml

    if is_model(path) or os.path.isdir(path):
        return True
    root = read_xml(path, DiagnosticLog()) if path.suffix == ".xml" else None
    return root is not None and root.tag in (*SYSTEM_ROOTS, "specification")


def _interfaces(
    models: tuple[Path, ...], folders: tuple[Path, ...], changes: Changes
) -> Interfaces | None:
    """What the properties are held against; models with errors end the process."""
    from m2c.diagnostics import ModelError
    from moon.monitor.reading import interfaces_of, no_system, read_checked, say_why

    try:
        system = no_system(folders)
        if models:
            system = read_checked(models, folders, changes=changes)
    except ModelError as error:
        say_why(error)
        sys.exit(2)
    return interfaces_of(system, folders)


def _as_text(item: Property) -> list[str]:
    from moon.properties.describe import duration
    from moon.properties.formula import text

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
    from m2c.json_lines import versioned_line
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
