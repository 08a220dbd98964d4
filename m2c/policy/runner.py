"""Running a policy: BehaviorTree.CPP ticks the tree, a leaf's tick is a call of its skill's service."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import msgspec

from m2c.policy.program import Leaf, Policy
from m2c.runtime.binding import NodeSettings
from m2c.runtime.messages import TypedMessage, message_class
from transports.interface import (
    CallOutcome,
    Client,
    Completion,
    Service,
    Topic,
    Transport,
    TransportError,
)

STATUS_CODES = {0: "SUCCESS", 1: "FAILURE", 2: "RUNNING"}
"""The ``status`` of a tick's response."""

TICKS_CHANNEL = "/policy/ticks"


class LeafTick(TypedMessage):
    """One leaf in one tick of the tree: its status, and how long its skill took to answer."""

    __type_name__: ClassVar[str] = "m2c/msg/LeafTick"
    name: str = ""
    status: str = ""
    duration_us: float = 0.0


class TreeTick(TypedMessage):
    """One tick of the tree; ``leaves`` are those that were ticked, in order."""

    __type_name__: ClassVar[str] = "m2c/msg/TreeTick"
    tick: int = 0
    status: str = ""
    leaves: list[LeafTick] = msgspec.field(default_factory=list)


TICKS = Topic(TICKS_CHANNEL, TreeTick.__type_name__, TreeTick)


class PolicyRunner:
    """Ticks one policy over one transport.

    Args:
        transport: the policy's own connection.
        policy: the tree and its leaves.
        plugins: generated node class per plugin name, for leaves that a plugin runs.
        tick_timeout_s: how long a skill may take to answer; it counts as FAILURE then.
    """

    def __init__(
        self,
        transport: Transport,
        policy: Policy,
        plugins: Mapping[str, Callable[..., Any]] | None = None,
        tick_timeout_s: float = 5.0,
    ) -> None:
        import behaviortreepy

        self._transport = transport
        self._timeout_s = tick_timeout_s
        self._log = logging.getLogger("policy")
        self._statuses = {
            name: getattr(behaviortreepy.NodeStatus, name) for name in STATUS_CODES.values()
        }
        self._publisher = transport.publisher(TICKS)
        self._ticked: list[LeafTick] = []
        self._count = 0
        self._faults: list[Exception] = []
        self._stopped: Completion = transport.completion()
        factory = behaviortreepy.BehaviorTreeFactory()
        for leaf in policy.leaves:
            run: _ServiceLeaf | _PluginLeaf
            if leaf.plugin:
                made = (plugins or {})[leaf.plugin]
                run = _PluginLeaf(leaf, transport, made, tick_timeout_s, self._log)
            else:
                run = _ServiceLeaf(leaf, transport, tick_timeout_s, self._log)
            tick = self._tick_of(leaf, run)
            if leaf.action:
                factory.register_simple_stateful_action(
                    leaf.id, tick, tick, self._halt_of(leaf, run)
                )
            else:
                factory.register_simple_condition(leaf.id, tick)
        self._tree = factory.create_tree_from_text(policy.xml)

    def _tick_of(self, leaf: Leaf, run: _ServiceLeaf | _PluginLeaf) -> Callable[..., Any]:
        def tick(*_: object) -> Any:
            began_ns = self._transport.now_ns()
            status = self._guarded(leaf, run.tick) or "FAILURE"
            if status == "RUNNING" and not leaf.action:
                self._log.error("condition %s answers RUNNING; taken as FAILURE", leaf.name)
                status = "FAILURE"
            micros = (self._transport.now_ns() - began_ns) / 1e3
            self._ticked.append(LeafTick(leaf.name, status, micros))
            return self._statuses[status]

        return tick

    def _halt_of(self, leaf: Leaf, run: _ServiceLeaf | _PluginLeaf) -> Callable[..., None]:
        def halt(*_: object) -> None:
            self._guarded(leaf, run.halt)
            self._ticked.append(LeafTick(leaf.name, "HALTED"))

        return halt

    def _guarded(self, leaf: Leaf, what: Callable[[], str | None]) -> str | None:
        """``what()``; an exception must not unwind through C++, so ``tick`` raises it afterwards."""
        try:
            return what()
        except TransportError as error:
            self._log.error("leaf %s: %s; taken as FAILURE", leaf.name, error)
        except Exception as error:
            self._faults.append(error)
        return None

    def tick(self) -> TreeTick:
        """Tick the tree once, publish what happened and return it.

        An exception that a leaf raised counts as its FAILURE and is raised after the tick.
        """
        self._ticked = []
        status = self._tree.tick_once()  # again while a node of the tree itself wakes it up
        self._count += 1
        record = TreeTick(self._count, status.name, self._ticked)
        self._publisher.publish(record)
        if self._faults:
            raise self._faults.pop(0)
        return record

    def run(self, rate_hz: float, ticks: int | None = None) -> int:
        """Tick at ``rate_hz`` until :meth:`stop` or for ``ticks`` ticks, then halt the tree.

        A tick that takes longer than the period delays the next one; no tick is made up for.

        Returns:
            How many ticks were made.
        """
        period_ns = round(1e9 / rate_hz)
        due = self._transport.now_ns()
        while ticks is None or self._count < ticks:
            self.tick()
            due = max(due + period_ns, self._transport.now_ns())
            if ticks is not None and self._count >= ticks:
                break
            remaining = (due - self._transport.now_ns()) / 1e9
            if self._stopped.wait(max(remaining, 0.0)) is not None:
                break
        self._tree.halt_tree()
        return self._count

    def stop(self) -> None:
        """End :meth:`run` after the tick it is in; from any thread."""
        self._stopped.set(True)


class _ServiceLeaf:
    """A leaf whose skill serves a tick service."""

    def __init__(
        self, leaf: Leaf, transport: Transport, timeout_s: float, log: logging.Logger
    ) -> None:
        assert leaf.tick_request is not None
        assert leaf.tick_response is not None
        self._leaf = leaf
        self._timeout_s = timeout_s
        self._log = log
        request = message_class(leaf.tick_request)
        response = message_class(leaf.tick_response)
        service = Service(leaf.tick, leaf.tick_type, request, response)
        self._request = request()
        self._client = transport.client(service)
        self._halt: Client | None = None
        if leaf.halt and leaf.halt_request is not None and leaf.halt_response is not None:
            self._halt_request = message_class(leaf.halt_request)()
            halt_response = message_class(leaf.halt_response)
            self._halt = transport.client(
                Service(leaf.halt, leaf.halt_type, type(self._halt_request), halt_response)
            )

    def tick(self) -> str:
        leaf = self._leaf
        result = self._client.call_and_wait(self._request, self._timeout_s)
        if result.outcome is not CallOutcome.RESPONSE:
            why = result.error or result.outcome
            self._log.error("leaf %s: %s: %s; taken as FAILURE", leaf.name, leaf.tick, why)
            return "FAILURE"
        status = STATUS_CODES.get(result.response.status)
        if status is None:
            wrong = result.response.status
            self._log.error("leaf %s: %s answers status %s", leaf.name, leaf.tick, wrong)
            return "FAILURE"
        return status

    def halt(self) -> None:
        if self._halt is None:
            return
        result = self._halt.call_and_wait(self._halt_request, self._timeout_s)
        if result.outcome is not CallOutcome.RESPONSE:
            why = result.error or result.outcome
            self._log.error("leaf %s: %s: %s", self._leaf.name, self._leaf.halt, why)


class _PluginLeaf:
    """A leaf that a generated plugin machine runs, on the transport's executor."""

    def __init__(
        self,
        leaf: Leaf,
        transport: Transport,
        node_class: Callable[..., Any],
        timeout_s: float,
        log: logging.Logger,
    ) -> None:
        self._leaf = leaf
        self._transport = transport
        self._timeout_s = timeout_s
        self._log = log
        self._node_class = node_class
        self._node = self._started()

    def _started(self) -> Any:
        answers = self._answers = _Answers()
        node = self._node_class(
            self._transport,
            NodeSettings(self._timeout_s),
            self._leaf.ports,
            answers.deliver,
            lambda: answers.deliver("HALTED"),
        )
        self._transport.post(node.start)
        return node

    def tick(self) -> str:
        status = self._ask(self._node.tick)
        if status is None:
            self._log.error(
                "leaf %s: its plugin %s gave no status within %g s (%s); taken as FAILURE",
                self._leaf.name,
                self._leaf.plugin,
                self._timeout_s,
                self._leaf.tick or "no service",
            )
            self._node = self._started()  # the old machine waits for its answer for ever
            return "FAILURE"
        return status

    def halt(self) -> None:
        if self._ask(self._node.halt) is None:
            self._log.error("leaf %s: its plugin does not halt", self._leaf.name)
            self._node = self._started()

    def _ask(self, what: Callable[[], None]) -> str | None:
        waiting = self._answers.waiting = self._transport.completion()
        self._transport.post(what)
        answer = waiting.wait(self._timeout_s)
        return None if answer is None else str(answer)


class _Answers:
    """Where one plugin machine's answers go; those of a machine given up go nowhere."""

    def __init__(self) -> None:
        self.waiting: Completion | None = None

    def deliver(self, status: str) -> None:
        if self.waiting is not None:
            self.waiting.set(status)
