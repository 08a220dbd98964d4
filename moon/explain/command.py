"""The ``moon explain`` command."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command()
@click.argument(
    "models", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="MODEL...|SYSTEM"
)
@click.option(
    "--interfaces",
    multiple=True,
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Folder of ROS interface packages (repeatable).",
)
@click.option("--only", multiple=True, metavar="NODE", help="Explain only this one (repeatable).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a machine and line.")
def explain(
    models: tuple[Path, ...], interfaces: tuple[Path, ...], only: tuple[str, ...], as_json: bool
) -> None:
    """Say what a monitor would observe of models, and what it cannot check, and why.

    MODEL...|SYSTEM are models (.scxml, .ascxml), folders of them, or one system file. Exit code 0, or
    2 for models in which `m2c check` finds errors.

    Example: moon explain examples/lab_tour/skills/GoToPoiSkill.scxml
    """
    import msgspec

    from m2c.model import ModelError
    from m2c.model.typing import nearest
    from moon.explain.observables import observables
    from moon.explain.report import ASSUMED, report
    from moon.monitor.reading import read_checked, say_why

    try:
        system = read_checked(models, interfaces)
    except ModelError as error:
        say_why(error)
        sys.exit(2)
    known = [machine.name for machine in (*system.nodes, *system.plugins)]
    for name in only:
        if name not in known:
            message = f"error: {system.name} has no machine {name}; {nearest(name, known)}"
            click.echo(message, err=True)
            sys.exit(2)
    found = [
        observables(machine, plugin=machine in system.plugins)
        for machine in (*system.nodes, *system.plugins)
        if not only or machine.name in only
    ]
    if as_json:
        for item in found:
            click.echo(msgspec.json.encode(item).decode())
        return
    for item in found:
        click.echo("\n".join(report(item)) + "\n")
    click.echo(ASSUMED)
