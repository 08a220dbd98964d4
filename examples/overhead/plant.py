"""What is measured: the nodes of the lab tour that table III is about, running, and their policy."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.processes import ROOT, Child, ChildError
from benchmarks.ticking import Middleware, Order, Taken, middleware, ordered
from examples.overhead.load import tick_tree
from examples.overhead.routes import rerouted_system
from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.launch.description import Package, read_description
from m2c.model import DiagnosticLog, load
from m2c.model.system import System

SYSTEM = Path(__file__).parent / "models" / "system.xml"
PROPERTIES = ROOT / "examples/lab_tour/properties.yaml"
SETTLING = 50
"""So often it is tried whether ticks succeed."""


def read_system() -> System:
    """The models."""
    log = DiagnosticLog()
    system = load([SYSTEM], log)
    log.raise_if_errors()
    assert system is not None
    return system


def generate(folder: Path, through_the_middle: bool) -> Path:
    """Generate the nodes into ``folder``; ``through_the_middle``: the skills call the monitor."""
    system = read_system()
    write_files(system_files(rerouted_system(system) if through_the_middle else system), folder)
    return folder


def start_node(where: Middleware, node: Package, folder: Path) -> Child:
    """A node of those generated into ``folder``."""
    paths = [str(folder / node.path), where.environment.get("PYTHONPATH", "")]
    path = os.pathsep.join(filter(None, paths))
    arguments = ["-m", node.package, *where.arguments(), "--log-level", "ERROR"]
    return Child(node.name, arguments, {**where.environment, "PYTHONPATH": path})


class Plant:
    """A set of running nodes and the policy's process, which ticks when it is told.

    Ticks succeed from the beginning; through the middle, once that is there.

    Args:
        where: their middleware.
        folder: the generated packages.
        through_the_middle: the policy calls the monitor, as the nodes in ``folder`` do.
    """

    def __init__(self, where: Middleware, folder: Path, through_the_middle: bool = False) -> None:
        description = read_description(folder)
        package = description.policy
        assert package is not None
        self.where = where
        self.names = [node.name for node in description.nodes]
        self.nodes: dict[str, Child] = {}
        path = str(folder / package.path / package.package)
        meeting = where.transport, where.options("listen")
        with contextlib.ExitStack() as stack:
            self.load = Child.calling(
                "the policy",
                tick_tree,
                *(path, *meeting, self.names, through_the_middle),
                environment=where.environment,
            )
            stack.enter_context(self.load)
            for node in description.nodes:
                self.nodes[node.name] = stack.enter_context(start_node(where, node, folder))
            self.load.answer()
            if not through_the_middle:
                self.settle()
                self.rest()
            self._stack = stack.pop_all()

    def run(self, order: Order) -> Taken:
        """Have the tree ticked.

        Raises:
            ChildError: the policy's process is gone.
        """
        return ordered(self.load, order)

    def settle(self) -> None:
        """Tick until ticks succeed: at first a skill may not have heard that the battery is low, and after
        a man in the middle has come, the others look for him.

        Raises:
            ChildError: none does.
        """
        for _ in range(SETTLING):
            taken = self.run(Order(3, 0.0, 0))
            if not any(taken.failures.values()):
                return
        raise ChildError(f"no tick succeeds: {taken.reasons}")

    def rest(self) -> None:
        """Do not tick until the next order: the monitors are about to go."""
        self.run(Order(0, 0.0, 0, rest=True))

    def __enter__(self) -> Plant:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


@contextlib.contextmanager
def running(transport: str, through_the_middle: bool = False) -> Iterator[Plant]:
    """Generated nodes at work, with a middleware of their own."""
    with contextlib.ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="overhead-")))
        where = stack.enter_context(middleware(transport))
        yield stack.enter_context(
            Plant(where, generate(scratch, through_the_middle), through_the_middle)
        )
