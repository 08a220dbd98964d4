"""What ``m2c run`` is given: a system file that is read and checked, and what replaces nodes of it.

What is wrong with it ends the process, with exit code 2.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import msgspec

from m2c.check import check_system
from m2c.check.report import print_findings
from m2c.model import DiagnosticLog, load
from m2c.model.naming import Naming
from m2c.model.system import System, linked, read_with_reference
from m2c.suggestions import nearest
from m2c.terminal import fail


def parse_replacements(written: tuple[str, ...]) -> dict[str, Path]:
    """Node → what runs in its place, from ``NODE=PATH``."""
    found = {}
    for text in written:
        name, equals, path = text.partition("=")
        if not equals or not name or not os.path.exists(path):
            fail(f"--replace {text}: expected NODE=PATH, where PATH exists")
        found[name] = Path(path)
    return found


def read_to_run(path: Path, changed: dict[str, Path], naming: Naming, lenient: bool) -> System:
    """The system in ``path``, with the models of ``changed`` in place of its own, without errors.

    What is found is printed, warnings too.
    """
    log = DiagnosticLog()
    system = load([path], log)
    if system is not None:
        nodes = list(system.nodes)
        for name, model in changed.items():
            index = next((i for i, node in enumerate(nodes) if node.name == name), None)
            if index is None:
                fail(
                    f"{system.name} has no node {name}; "
                    f"{nearest(name, [node.name for node in nodes])}"
                )
            if model.is_file():
                machine = read_with_reference(model, system, name, log)
                if machine is not None:
                    nodes[index] = machine
        if changed:
            system = linked(msgspec.structs.replace(system, nodes=tuple(nodes)), log)
        system = system.made_lenient() if lenient else system
        check_system(system, log, naming)
    print_findings(log.diagnostics)
    if system is None or log.has_errors:
        sys.exit(2)
    return system
