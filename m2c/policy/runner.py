"""Running a policy: BehaviorTree.CPP ticks the tree, a leaf's tick is a call of its skill's service."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable, Mapping
from typing import Any

from m2c.policy.control_leaf import ControlLeaf
from m2c.policy.library import PolicyError, TreeFactory, halt_tree
from m2c.policy.plugin_leaf import PluginLeaf
from m2c.policy.program import Leaf, Policy
from m2c.policy.skill_leaf import SkillLeaf
from m2c.policy.ticking import (
    NODE_STATUSES,
    Nesting,
    PortError,
    RunsLeaf,
    TreeNode,
    may_wake,
    tick_tree,
)
from m2c.policy.ticks import HALTED, TICKS, LeafTick, TreeTick
from m2c.runtime.binding import NodeSettings
from transports.interface import Completion, Transport, TransportError

__all__ = ["TICKS", "LeafTick", "PolicyRunner", "TreeTick"]


class PolicyRunner:
    """Ticks one policy over one transport.

    Args:
        transport: the policy's own connection.
        policy: the tree and its leaves.
        plugins: generated node class per plugin name, for leaves that a plugin runs.
        tick_timeout_s: how long a skill may take to answer; it counts as FAILURE then.
        ticked: called with each tick when it is over, on the thread that ticks.
        settings: how the plugins' machines behave towards others; by default their calls may take as
            long as a skill's answer.

    Raises:
        PolicyError: BehaviorTree.CPP refuses the tree.
    """

    def __init__(
        self,
        transport: Transport,
        policy: Policy,
        plugins: Mapping[str, Callable[..., Any]] | None = None,
        tick_timeout_s: float = 5.0,
        ticked: Callable[[TreeTick], None] | None = None,
        settings: NodeSettings | None = None,
    ) -> None:
        import behaviortreepy

        self._transport = transport
        self._timeout_s = tick_timeout_s
        self._report = ticked
        self._log = logging.getLogger("policy")
        self._statuses = {name: getattr(behaviortreepy.NodeStatus, name) for name in NODE_STATUSES}
        self._publisher = transport.publisher(TICKS)
        self._ticked: list[LeafTick] = []
        self._count = 0
        self._ends = not policy.tick_if_not_running
        self._has_ended = False
        self._faults: list[BaseException] = []
        self._stopped: Completion = transport.completion()
        self._wakes = may_wake(policy)
        self._runs: dict[str, RunsLeaf] = {}
        self._running: dict[int, tuple[Leaf, TreeNode]] = {}
        """The leaves that are RUNNING."""
        factory = TreeFactory()
        self._nesting = nesting = Nesting(factory)
        for leaf in policy.leaves:
            run: RunsLeaf
            if leaf.built_in:
                run = ControlLeaf(leaf, transport, nesting)
            elif leaf.plugin:
                made = (plugins or {})[leaf.plugin]
                run = PluginLeaf(
                    leaf,
                    transport,
                    made,
                    tick_timeout_s,
                    self._log,
                    nesting,
                    settings or NodeSettings(tick_timeout_s),
                )
            else:
                run = SkillLeaf(leaf, transport, tick_timeout_s, self._log)
            self._runs[leaf.id] = run
            halt = self._halt_of(leaf) if leaf.action else None
            factory.register(leaf.id, self._tick_of(leaf), halt)
        factory.load(policy.xml)
        self._tree = factory.create_tree(policy.main)

    # The tree's callbacks know the runner weakly, and what runs the leaves only through it: these hold the
    # tree or its factory, and Python cannot see references that go through C++, so they would keep each
    # other alive for ever.

    def _tick_of(self, leaf: Leaf) -> Callable[..., Any]:
        known = weakref.ref(self)
        failure = self._statuses["FAILURE"]

        def tick(node: TreeNode) -> Any:
            runner = known()
            return failure if runner is None else runner._tick_leaf(leaf, node)

        return tick

    def _tick_leaf(self, leaf: Leaf, node: TreeNode) -> Any:
        run = self._runs[leaf.id]
        began_ns = self._transport.now_ns()
        place = len(self._ticked)
        record = LeafTick(leaf.name)
        status = self._guarded(leaf, run.tick, node, record) or "FAILURE"
        if status == "RUNNING" and not leaf.action:
            self._log.error("condition %s answers RUNNING; taken as FAILURE", leaf.name)
            status = "FAILURE"
        if status == "RUNNING":
            self._running[id(node)] = (leaf, node)
        else:
            self._running.pop(id(node), None)
        record.status = status
        record.duration_us = max(self._transport.now_ns() - began_ns, 0) / 1e3
        self._ticked.insert(place, record)
        return self._statuses[status]

    def _halt_of(self, leaf: Leaf) -> Callable[..., None]:
        known = weakref.ref(self)

        def halt(node: TreeNode) -> None:
            runner = known()
            if runner is not None:  # a tree that is thrown away halts itself
                runner._halt_leaf(leaf, node)

        return halt

    def _halt_leaf(self, leaf: Leaf, node: TreeNode) -> None:
        record = LeafTick(leaf.name, HALTED)
        self._running.pop(id(node), None)
        self._guarded(leaf, self._runs[leaf.id].halt, node, record)
        self._ticked.append(record)

    def _guarded(
        self,
        leaf: Leaf,
        what: Callable[[TreeNode, LeafTick], str | None],
        node: TreeNode,
        record: LeafTick,
    ) -> str | None:
        """``what(…)``; an exception must not unwind through C++, so ``tick`` raises it afterwards."""
        try:
            return what(node, record)
        except (TransportError, PortError) as error:
            self._log.error("leaf %s: %s; taken as FAILURE", leaf.name, error)
        except BaseException as error:  # that of a world which is closed, too: C++ would print it
            self._faults.append(error)
        return None

    def tick(self) -> TreeTick:
        """Tick the tree once, publish what happened and return it.

        An exception that a leaf raised counts as its FAILURE and is raised after the tick.

        Raises:
            PolicyError: BehaviorTree.CPP cannot go on, for instance with a script.
        """
        self._ticked = []
        self._nesting.retries = 0
        status = tick_tree(self._tree, self._wakes)
        self._count += 1
        self._has_ended = status != "RUNNING"
        record = TreeTick(self._count, status, self._ticked)
        self._publisher.publish(record)
        if self._report is not None:
            self._report(record)
        if self._faults:
            raise self._faults.pop(0)
        return record

    @property
    def is_over(self) -> bool:
        """Whether the tree has ended and the policy does not tick it again."""
        return self._ends and self._has_ended

    def run(self, rate_hz: float, ticks: int | None = None, waits: bool = False) -> int:
        """Tick at ``rate_hz`` until :meth:`stop`, for ``ticks`` ticks, until a tick raises or the
        policy is over.

        However it ends, the tree is halted, so that no skill goes on without its policy.

        A tick that takes longer than the period delays the next one; no tick is made up for. With
        ``waits`` the first tick comes after one period, and so does the end, after the last tick.

        Returns:
            How many ticks were made.

        Raises:
            PolicyError: BehaviorTree.CPP cannot go on, for instance with a script.
        """
        period_ns = round(1e9 / rate_hz)
        try:
            if waits and self._stopped.wait(1.0 / rate_hz) is not None:
                return 0
            due = self._transport.now_ns()
            while ticks is None or self._count < ticks:
                self.tick()
                if self.is_over and not waits:
                    break
                now_ns = self._transport.now_ns()
                due = min(
                    max(due + period_ns, now_ns), now_ns + period_ns
                )  # the clock may be set back
                if ticks is not None and self._count >= ticks:
                    break
                remaining = (due - self._transport.now_ns()) / 1e9
                if remaining > 0:
                    self._transport.tick_complete()
                if self._stopped.wait(max(remaining, 0.0)) is not None or self.is_over:
                    break
        finally:
            self._halt()
        return self._count

    def _halt(self) -> None:
        """Halt the tree, and where it cannot go on with that, each leaf that is RUNNING."""
        try:
            halt_tree(self._tree)
        except PolicyError:
            for leaf, node in tuple(self._running.values()):
                self._halt_leaf(leaf, node)
            raise

    def stop(self) -> None:
        """End :meth:`run` after the tick it is in; from any thread."""
        self._stopped.set(True)
