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
from m2c.launch.description import LaunchDescription, is_code
from m2c.launch.options import RunOptions
from m2c.model import DiagnosticLog, load
from m2c.model.deployment import Process, hosts_of, names_in_deployment, read_deployment_file
from m2c.model.loading import linked
from m2c.model.naming import Naming
from m2c.model.overrides import with_changes
from m2c.model.paths import meant
from m2c.model.system import System, read_with_reference
from m2c.suggestions import nearest
from m2c.terminal import fail


def parse_replacements(written: tuple[str, ...]) -> dict[str, Path]:
    """Node → what runs in its place, from ``NODE=PATH``."""
    found = {}
    for text in written:
        name, equals, path = text.partition("=")
        if not equals or not name or not path:
            fail(f"--replace {text}: expected NODE=PATH")
        if not os.path.exists(path):
            wanted = meant(Path(path)) or "expected a model, a package or a node written by hand"
            fail(f"--replace {name}: {path}: no such file or folder; {wanted}")
        found[name] = Path(path)
    return found


def planned(
    description: LaunchDescription, file: Path | None, host: str | None, processes: int | None
) -> tuple[Process, ...]:
    """The deployment by which a system is run; empty if its nodes are dealt out by their number.

    Args:
        description: the whole system.
        file: what ``--deployment`` says.
        host: what ``--host`` says.
        processes: what ``--processes`` says.
    """
    if processes is not None:
        if file is not None or host is not None:
            fail(
                "--processes: how many there are, the deployment says; it excludes --deployment and --host"
            )
        return ()
    plan = description.deployment
    if file is not None:
        log = DiagnosticLog()
        names = names_in_deployment(description.nodes, description.policy is not None)
        plan = read_deployment_file(file, names, log)
        print_findings(log.diagnostics)
        if log.has_errors:
            sys.exit(2)
    if host is not None and host not in hosts_of(plan):
        hosts = hosts_of(plan)
        there_is = nearest(host, hosts) if hosts else "it names no hosts"
        where = file or "the system's deployment"
        fail(f"--host {host}: {where} has no such host; {there_is}")
    return plan


def read_to_run(options: RunOptions, changed: dict[str, Path], naming: Naming) -> System:
    """The system that is to be run, with the models of ``changed`` in place of its own, without errors.

    What is found is printed, warnings too.
    """
    log = DiagnosticLog()
    system = read_changed(options, changed, naming, log)
    print_findings(log.diagnostics)
    if system is None or log.has_errors:
        sys.exit(2)
    return system


def read_changed(
    options: RunOptions, changed: dict[str, Path], naming: Naming, log: DiagnosticLog
) -> System | None:
    """The system that is to be run, with the models of ``changed`` in place of its own."""
    system = load([options.system], log, options.interfaces)
    if system is not None:
        nodes = list(system.nodes)
        for name, model in changed.items():
            index = next((i for i, node in enumerate(nodes) if node.name == name), None)
            if index is None:
                fail(
                    f"{system.name} has no node {name}; "
                    f"{nearest(name, [node.name for node in nodes])}"
                )
            if not is_code(model):
                machine = read_with_reference(model, system, name, log)
                if machine is not None:
                    nodes[index] = machine
        if changed:
            system = linked(msgspec.structs.replace(system, nodes=tuple(nodes)), log)
        system = with_changes(system, options.changes, log)
        check_system(system, log, naming)
    return system
