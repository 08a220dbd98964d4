"""A system compiled once, for all that monitors make of it: each robot of a fleet runs the same models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property

from m2c.diagnostics import DiagnosticLog
from m2c.model.machine import Machine
from m2c.model.system import System
from m2c.policy.program import Policy, read_policy
from moon.oracle.bounds import Bounds
from moon.oracle.program import Program
from moon.policy.oracle import PolicyOracle
from moon.policy.places import leaf_places


class CompiledSystem:
    """The machines of a system ready to be stepped, and its policy read.

    Nothing of a run is kept in them, except for outcomes of steps, which are the same in every run.

    Args:
        system: all models.
        machines: those to be monitored.

    Attributes:
        programs: of those, by their names.
        others: the system's other nodes: what they publish matters all the same.
    """

    def __init__(self, system: System, machines: Iterable[Machine]) -> None:
        self._system = system
        self.programs: Mapping[str, Program] = {
            machine.name: Program(machine, system.library) for machine in machines
        }
        self.others = tuple(node for node in system.nodes if node.name not in self.programs)

    def policy_oracle(self, bounds: Bounds) -> PolicyOracle | None:
        """An oracle of the policy, to be found in the middle of its run; None if there is no policy."""
        policy = self._policy
        if policy is None:
            return None
        return PolicyOracle(
            policy,
            bounds=bounds,
            synchronised=False,
            plugins=self._system.plugins,
            places=self._places,
            rate_hz=0.0,  # it is not checked: whoever starts the policy may choose another
        )

    @cached_property
    def _policy(self) -> Policy | None:
        path = self._system.policy
        return None if path is None else read_policy(path, self._system, DiagnosticLog())

    @cached_property
    def _places(self) -> Mapping[str, tuple[str, ...]]:
        return leaf_places(self._system)
