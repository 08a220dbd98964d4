"""What is measured: the nodes of the lab tour that table III is about, running, and their policy."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.processes import ROOT, Child, ChildError, free_endpoint
from examples.overhead.load import Order, Taken
from examples.overhead.routes import rerouted_system
from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.launch.description import Package, read_description
from m2c.model import DiagnosticLog, load
from m2c.model.system import System

SYSTEM = Path(__file__).parent / "models" / "system.xml"
INTERFACES = ROOT / "examples/lab_tour/interfaces"
PROPERTIES = ROOT / "examples/lab_tour/properties.yaml"
SETTLING = 50
"""So often it is tried whether ticks succeed."""
ORDER_S = 120.0
"""Beyond its own time, an order may take this long to be carried out."""


class Middleware(msgspec.Struct, frozen=True):
    """Where one set of processes meets.

    Attributes:
        transport: ``zenoh`` or ``ros2``.
        endpoint: of Zenoh; the policy's process listens there.
        environment: variables of all its processes.
    """

    transport: str
    endpoint: str = ""
    environment: dict[str, str] = {}

    def arguments(self) -> list[str]:
        """By which a command finds it."""
        where = ["--endpoint", self.endpoint] if self.endpoint else []
        return ["--transport", self.transport, *where]


class MiddlewareMissingError(Exception):
    """A transport cannot be used here; the text says why and what would help."""


@contextlib.contextmanager
def middleware(transport: str) -> Iterator[Middleware]:
    """A Zenoh endpoint or a ROS domain of its own, on loopback only.

    Raises:
        MiddlewareMissingError: ROS 2 is not installed.
    """
    if transport == "zenoh":
        yield Middleware(transport, free_endpoint())
        return
    base = ros_environment()
    from domain_coordinator import domain_id

    start = os.getpid()

    def candidate() -> int:
        nonlocal start
        start += 1
        return start % 100 + 1

    with domain_id(candidate) as number:
        yield Middleware(transport, environment={**base, "ROS_DOMAIN_ID": str(number)})


def ros_environment() -> dict[str, str]:
    """What processes on ROS 2 need; the interface packages are built the first time (20 s).

    Raises:
        MiddlewareMissingError: ROS 2 is not installed, or the packages cannot be built.
    """
    import importlib.util

    from m2c.rosidl.build import InterfaceBuildError, build_interfaces

    if importlib.util.find_spec("rclpy") is None:
        raise MiddlewareMissingError("ROS 2 is not installed: pip install '.[ros2]'")
    try:
        install = build_interfaces([INTERFACES], ROOT / "build/interfaces")
    except InterfaceBuildError as error:
        raise MiddlewareMissingError(str(error)) from error
    kept = {name: os.environ[name] for name in _PATHS if name in os.environ}
    return {
        **install.environment(kept),
        "ROS_LOCALHOST_ONLY": "1",
        "RCUTILS_LOGGING_SEVERITY": "ERROR",
    }


_PATHS = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH")


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


def listener(where: Middleware, names: Sequence[str]) -> Child:
    """A tap as a process of its own; it answers once it is linked to all of ``names``."""
    links = [word for name in names for word in ("--link", name)]
    arguments = ["-m", "examples.overhead.listener", *where.arguments(), *links]
    return Child("a tap", arguments, where.environment)


class Plant:
    """A set of running nodes and the policy's process, which ticks when it is told.

    Ticks succeed from the beginning; through the middle, once that is there.

    Args:
        where: their middleware.
        folder: the generated packages.
        through_the_middle: the policy calls the monitor, as the nodes in ``folder`` do.
        apart: who starts a node in another way, by the node's name.
    """

    def __init__(
        self,
        where: Middleware,
        folder: Path,
        through_the_middle: bool = False,
        apart: Mapping[str, Callable[[Plant, Package, Path], Child]] | None = None,
    ) -> None:
        description = read_description(folder)
        assert description.policy is not None
        self.where = where
        self.names = [node.name for node in description.nodes]
        self._stack = contextlib.ExitStack()
        self.nodes: dict[str, Child] = {}
        try:
            package = description.policy
            path = folder / package.path / package.package
            listen = ["--listen", where.endpoint] if where.endpoint else []
            route = ["--rerouted"] if through_the_middle else []
            waits = [word for name in self.names for word in ("--wait-for", name)]
            options = ["--transport", where.transport, *listen, *route, *waits]
            self.load = self._started(
                "the policy", ["-m", "examples.overhead.load", str(path), *options]
            )
            for node in description.nodes:
                start = (apart or {}).get(node.name)
                self.nodes[node.name] = (
                    self._stack.enter_context(start(self, node, folder))
                    if start is not None
                    else self._start_node(node, folder)
                )
            self.load.answer()
            if not through_the_middle:
                self.settle()
                self.rest()
        except BaseException:
            self._stack.close()
            raise

    def _start_node(self, node: Package, folder: Path) -> Child:
        path = os.pathsep.join(
            filter(None, [str(folder / node.path), self.where.environment.get("PYTHONPATH", "")])
        )
        return self._started(
            node.name,
            ["-m", node.package, *self.where.arguments(), "--log-level", "ERROR"],
            {"PYTHONPATH": path},
        )

    def _started(
        self, name: str, arguments: Sequence[str], environment: dict[str, str] | None = None
    ) -> Child:
        variables = {**self.where.environment, **(environment or {})}
        return self._stack.enter_context(Child(name, arguments, variables))

    def run(self, order: Order) -> Taken:
        """Have the tree ticked.

        Raises:
            ChildError: the policy's process is gone.
        """
        expected = (order.ticks + order.warm_up) / order.rate_hz if order.rate_hz else 0.0
        answer: Any = self.load.ask(msgspec.to_builtins(order), expected + ORDER_S)
        return msgspec.convert(answer, Taken)

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

    def close(self) -> None:
        """Stop everything; idempotent."""
        self._stack.close()

    def __enter__(self) -> Plant:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
