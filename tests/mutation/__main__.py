"""``python -m tests.mutation PATH…``: how many mutants each operator makes of each machine."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import click

from m2c.printable import printable
from m2c.terminal import say, show


@click.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--list", "listed", is_flag=True, help="Print every mutant instead of the table.")
def main(paths: tuple[Path, ...], listed: bool) -> None:
    """Count the first-order mutants of models.

    PATHS are models, folders of them (a folder with a system.xml stands for that system), or one
    system file.
    """
    from m2c.model import DiagnosticLog, load
    from tests.mutation.operators import OPERATORS, mutants

    log = DiagnosticLog()
    system = load([_system_in(path) for path in paths], log)
    if system is None or log.has_errors:
        say(*map(str, log.diagnostics))
        raise SystemExit(2)
    counts: dict[str, Counter[str]] = {}
    for machine in system.nodes:
        found_of = counts.setdefault(machine.name, Counter())
        for mutant in mutants(machine):
            found_of[mutant.operator] += 1
            if listed:
                show(f"{mutant.description} ({mutant.operator})")
    if not listed:
        _print_table(list(OPERATORS), counts)


def _system_in(path: Path) -> Path:
    system = path / "system.xml"
    return system if system.is_file() else path


def _print_table(operators: list[str], counts: dict[str, Counter[str]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None)
    table.add_column("machine", no_wrap=True)
    for operator in operators:
        table.add_column(operator.replace(" ", "\n"), justify="right")
    table.add_column("all", justify="right")
    total: Counter[str] = Counter()
    for name, found in counts.items():
        total += found
        table.add_row(
            Text(printable(name)), *(str(found[item]) for item in operators), str(found.total())
        )
    table.add_row("all", *(str(total[item]) for item in operators), str(total.total()))
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
