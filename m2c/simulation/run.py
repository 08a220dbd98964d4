"""A run of a system in one process, in virtual time: a pure function of the world's seed and conditions."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import msgspec

from m2c.policy.runner import PolicyRunner, TreeTick
from m2c.runtime.binding import NodeSettings
from m2c.simulation.program import NodeClass, Program
from m2c.simulation.randomness import draws_of
from transports.interface import TransportError
from transports.simulated import SimulatedTransport, SimulatedWorld

POLICY_NODE = "policy"


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
        return msgspec.structs.replace(settings, random=draws_of(self.world.seed, node))

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
            awake_ns = self.world.pauses.after(POLICY_NODE, due)
            if awake_ns > due:
                due = awake_ns
                continue
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
