"""A system in one process: its generated code on a simulated world, in virtual time.

The nodes are the very code that ``m2c generate`` writes; only the processes are left out. A run is a
pure function of the world's seed and conditions.
"""

from __future__ import annotations

import functools
import itertools
import linecache
import random
import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import msgspec

from m2c.codegen.names import machine_class, package_name
from m2c.codegen.package import node_texts
from m2c.diagnostics import DiagnosticLog, ModelError
from m2c.launch.semantics import Semantics
from m2c.model.machine import Machine
from m2c.model.system import System
from m2c.policy.program import Policy, read_policy
from m2c.policy.runner import PolicyRunner, TreeTick
from m2c.runtime.binding import NodeSettings
from m2c.suggestions import nearest
from transports.interface import TransportError
from transports.simulated import SimulatedTransport, SimulatedWorld

NodeClass = Callable[..., Any]

POLICY_NODE = "policy"

_ORDER = ("__init__", "interfaces", "machine", "node")


class Program(msgspec.Struct, frozen=True):
    """The code of a system, imported once and run any number of times.

    Attributes:
        nodes: node class per node name.
        plugins: node class per plugin name.
        policy: the behaviour tree, if the system has one.
        semantics: what its models mean.
    """

    nodes: Mapping[str, NodeClass]
    plugins: Mapping[str, NodeClass]
    policy: Policy | None
    semantics: Semantics = Semantics.DEPLOYED

    def replacing(self, name: str, node: NodeClass) -> Program:
        """The same system with another class for the node ``name`` (KeyError if there is none)."""
        if name not in self.nodes:
            raise KeyError(f"no node `{name}`; {nearest(name, self.nodes)}")
        return msgspec.structs.replace(self, nodes={**self.nodes, name: node})


def compile_system(system: System, semantics: Semantics = Semantics.DEPLOYED) -> Program:
    """Generate and import all of ``system``.

    Args:
        system: what is to run, without errors.
        semantics: what its models mean; the run needs a world of the same (``Semantics.world``).

    Raises:
        ModelError: the policy cannot be used.
    """
    policy = None
    if system.policy is not None:
        log = DiagnosticLog()
        policy = read_policy(system.policy, system, log)
        if policy is None:
            raise ModelError(log.diagnostics)
    return Program(
        {machine.name: compile_node(machine, system, semantics) for machine in system.nodes},
        {machine.name: compile_node(machine, system, semantics) for machine in system.plugins},
        policy,
        semantics,
    )


def compile_node(
    machine: Machine, system: System, semantics: Semantics = Semantics.DEPLOYED
) -> NodeClass:
    """Generate and import ``machine``; its node class."""
    package = package_name(machine.name)
    modules = node_texts(machine, system.library, package, semantics.is_stepwise)
    return import_node(
        package, {name.removesuffix(".py"): text for name, text in modules.items()}, machine.name
    )


def import_node(package: str, modules: Mapping[str, str], name: str) -> NodeClass:
    """The node class of a generated package, from the text of its modules.

    The package is not left in ``sys.modules``, so variants of one node can be there side by side.

    Args:
        package: the package's name, as its modules import one another.
        modules: source text per module (``interfaces``, ``machine``, ``node``).
        name: the machine's name.
    """
    saved = {key: sys.modules.pop(key) for key in tuple(sys.modules) if _is_in(key, package)}
    try:
        for module in sorted(modules, key=_ORDER.index):
            full = package if module == "__init__" else f"{package}.{module}"
            made = ModuleType(full)
            if module == "__init__":
                made.__path__ = []
            file = f"<{full}#{next(_numbers)}>"
            # lets tracebacks find the text
            linecache.cache[file] = (
                len(modules[module]),
                None,
                modules[module].splitlines(keepends=True),
                file,
            )
            sys.modules[full] = made
            exec(compile(modules[module], file, "exec"), made.__dict__)
        for value in vars(sys.modules[f"{package}.interfaces"]).values():
            if isinstance(value, type) and issubclass(value, msgspec.Struct):
                # msgspec looks annotations up in sys.modules, once; later they are not there
                msgspec.msgpack.Decoder(value)
        node_class: NodeClass = getattr(
            sys.modules[f"{package}.node"], f"{machine_class(name)}Node"
        )
        return node_class
    finally:
        for key in [key for key in sys.modules if _is_in(key, package)]:
            del sys.modules[key]
        sys.modules.update(saved)


def _is_in(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


_numbers = itertools.count()


class SimulatedRun:
    """One run of a program in a world.

    Args:
        program: the code.
        world: where it runs; taps and further nodes may be there already.
        settings: how nodes behave towards the others.
        ticked: called with each tick of the tree when it is over.
        is_over: nothing more happens once it holds; asked before each event as the nodes start.
        tick_timeout_s: how long a leaf may take to answer. Without time limits (``Semantics``) this and
            ``settings`` are as long as the run.

    Attributes:
        policy: what ticks the tree, if the program has one.
        ticks: what the tree did while :meth:`run` ticked it.
    """

    def __init__(
        self,
        program: Program,
        world: SimulatedWorld,
        settings: NodeSettings | None = None,
        ticked: Callable[[TreeTick], None] | None = None,
        is_over: Callable[[], bool] = lambda: False,
        tick_timeout_s: float = 5.0,
    ) -> None:
        self.world = world
        self._is_stepwise = program.semantics.is_stepwise
        self.ticks: list[TreeTick] = []
        self._transports: list[SimulatedTransport] = []
        self.nodes: dict[str, Any] = {}
        for name, node_class in program.nodes.items():
            start = functools.partial(
                self._start, name, node_class, self._settings_of(name, settings or NodeSettings())
            )
            start()
            world.starters[name] = start
        self.policy: PolicyRunner | None = None
        self._of_policy: SimulatedTransport | None = None
        if program.policy is not None:
            self._of_policy = transport = self._connect(POLICY_NODE)
            self.policy = PolicyRunner(
                transport,
                program.policy,
                program.plugins,
                tick_timeout_s,
                ticked,
                self._settings_of(POLICY_NODE, settings or NodeSettings(tick_timeout_s)),
            )
            self._rate_hz = program.policy.tick_rate_hz
            transport.announce()
        if not self._is_stepwise:  # there, a chain of steps may need no time and have no end
            world.run(is_over, world.now_ns)

    def _settings_of(self, node: str, settings: NodeSettings) -> NodeSettings:
        """The settings of one node, with a source of randomness of its own, from the world's seed."""
        draws = random.Random(f"{self.world.seed} {node}")
        return msgspec.structs.replace(settings, random=draws.random)

    def _start(self, name: str, node_class: NodeClass, settings: NodeSettings) -> None:
        transport = self._connect(name)
        try:
            node = node_class(transport, settings)
        except Exception:
            self.world.failed = name
            raise
        self.nodes[name] = node
        transport.post(node.start)
        transport.post(transport.announce)

    def _connect(self, name: str) -> SimulatedTransport:
        transport = SimulatedTransport(self.world, name)
        self._transports.append(transport)
        return transport

    def close(self) -> None:
        """The policy leaves the world, then the nodes do."""
        for transport in reversed(self._transports):
            transport.close()

    def run(self, seconds: float, until: Callable[[], object] = lambda: False) -> None:
        """Let ``seconds`` of virtual time pass; the policy ticks at the system's rate until it is over.

        A policy that is killed (``SimulatedWorld.crash``) does not tick, nor say what it was about to.

        In steps (``docs/semantics.md``), a tree that has ended for good ends the run when it would be
        ticked next, and what is due when ``seconds`` have passed still happens, a tick included.

        Args:
            seconds: how long.
            until: asked before each event outside of a tick; ends the run.
        """
        end = self.world.now_ns + round(seconds * 1e9)
        if self.policy is None:
            self.world.run(until, end)
            return
        period_ns = round(1e9 / self._rate_hz)
        due = self.world.now_ns + (period_ns if self._is_stepwise else 0)
        while not self.world.run(until, min(due, end)):
            if self.policy.is_over or self._is_policy_dead:
                self.world.run(until, due if self._is_stepwise else end)
                return
            if due > end or (due == end and not self._is_stepwise):
                return
            due = self.world.now_ns + period_ns
            try:
                self.ticks.append(self.policy.tick())
            except TransportError:
                if not self._is_policy_dead:
                    raise
            due = max(due, self.world.now_ns)

    @property
    def _is_policy_dead(self) -> bool:
        return self._of_policy is not None and not self._of_policy.alive
