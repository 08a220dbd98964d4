"""Where the leaves of a policy stand in its file."""

from __future__ import annotations

from m2c.diagnostics import DiagnosticLog
from m2c.model.system import System
from m2c.policy.leaves import bind_leaves
from m2c.policy.plugins import has_children
from m2c.policy.reader import read_policy_file


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
