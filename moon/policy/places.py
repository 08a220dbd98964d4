"""Where the leaves of a policy stand in its file, and a system's policy as something to be checked."""

from __future__ import annotations

from m2c.diagnostics import DiagnosticLog
from m2c.model.system import System
from m2c.policy.leaves import bind_leaves
from m2c.policy.plugins import has_children
from m2c.policy.program import read_policy
from m2c.policy.reader import read_policy_file
from moon.oracle.bounds import Bounds
from moon.policy.oracle import PolicyOracle


def leaf_places(system: System) -> dict[str, tuple[str, ...]]:
    """``file:line:column`` of each place where each leaf of ``system``'s policy stands, by its id."""
    if system.policy is None:
        return {}
    log = DiagnosticLog()
    plugins = {plugin.name: has_children(plugin) for plugin in system.plugins}
    file = read_policy_file(system.policy, log, plugins)
    found: dict[str, tuple[str, ...]] = {}
    if file is not None:
        for position, leaf in bind_leaves(file, system, log).items():
            found[leaf.name] = (*found.get(leaf.name, ()), str(position))
    return found


def policy_oracle(
    system: System,
    log: DiagnosticLog,
    node: str = "policy",
    bounds: Bounds | None = None,
    synchronised: bool = True,
    rate_hz: float | None = None,
) -> PolicyOracle | None:
    """The oracle of ``system``'s policy; None if it has none, or after an error reported to ``log``.

    Args:
        system: the models and where the policy is.
        log: where faults of the policy go (see :func:`m2c.policy.program.read_policy`).
        node: that runs it.
        bounds: what is assumed of the middleware.
        synchronised: whether the policy is known to start after the monitor.
        rate_hz: at which the tree is ticked, if not at the policy's own rate; 0 if not known.
    """
    if system.policy is None:
        return None
    policy = read_policy(system.policy, system, log)
    if policy is None:
        return None
    return PolicyOracle(
        policy,
        node,
        bounds,
        synchronised=synchronised,
        plugins=system.plugins,
        places=leaf_places(system),
        rate_hz=rate_hz,
    )
