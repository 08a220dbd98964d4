"""The code of a system, generated and imported in this process.

The nodes are the very code that ``m2c generate`` writes; only the processes are left out.
"""

from __future__ import annotations

import itertools
import linecache
import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import msgspec

from m2c.codegen.names import machine_class, package_name
from m2c.codegen.package import node_texts
from m2c.diagnostics import DiagnosticLog, ModelError
from m2c.language.conversion import message_fields
from m2c.model.machine import Machine
from m2c.model.system import System
from m2c.policy.program import Policy, read_policy
from m2c.simulation.semantics import Semantics
from m2c.suggestions import nearest

NodeClass = Callable[..., Any]

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
                # annotations are looked up in sys.modules, once; later they are not there
                msgspec.msgpack.Decoder(value)
                message_fields(value)
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
