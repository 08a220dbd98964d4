"""The control nodes and decorators that BehaviorTree.CPP, as it is here, does not have, and those that wait.

Their meaning stands here once: the policy runs them by it, and the monitor follows them by it. What the two
have of their own is the clock: a timer for the one, for the other what the policy reported.

Those of Nav2 have the meaning that its documentation gives (https://docs.nav2.org, behaviour-tree plugins).
A child that has ended starts anew when it is ticked again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

from m2c.policy.program import Leaf
from m2c.policy.ticking import Children, PortError, TreeNode, read_port, write_port
from m2c.policy.tree import TIMED


class Clock(Protocol):
    """By which a node waits."""

    def start(self, delay_s: float) -> None:
        """A time begins that lasts ``delay_s``; one that has begun before is given up."""
        ...

    def is_over(self) -> bool:
        """Whether it has passed; a node that waits asks once at each tick."""
        ...

    def stop(self) -> None:
        """Nobody waits any more."""
        ...


class Control:
    """One place of a tree where such a node stands.

    Args:
        leaf: the node: BehaviorTree.CPP takes it for a leaf.
        node: the same in the tree.
        children: its children.
        clock: by which it waits.
    """

    def __init__(self, leaf: Leaf, node: TreeNode, children: Children, clock: Clock) -> None:
        self.node = node  # kept, so that no other node gets its id()
        self.children = children
        self.clock = clock
        self.leaf = leaf
        self.is_active = False
        """Whether it has begun, and was not told to start anew since."""
        self.is_first = False
        """Whether no child was ticked since it has begun."""
        self.current = 0
        """The child that is next, or the last one that was reached."""
        self.count = 0
        """What it counts: retries, or children that failed."""
        self.skipped = 0
        self.catches = False
        self._tick = _TICKS[leaf.built_in]

    def tick(self) -> str:
        """SUCCESS, FAILURE, RUNNING or SKIPPED.

        Raises:
            PortError: the blackboard does not give the value of a port.
            PolicyError: BehaviorTree.CPP cannot tick a child.
        """
        try:
            status = self._tick(self)
        except PortError:
            self._stop()
            raise
        if status != "RUNNING":
            self.children.halt_all()
            if self.leaf.kept and status != "SKIPPED":
                self.children.keep(self._begin_anew)
            else:
                self._begin_anew()
        return status

    def halt(self) -> None:
        """Stop what is RUNNING.

        Raises:
            PortError: the blackboard does not give the value of a port.
            PolicyError: BehaviorTree.CPP cannot halt a child.
        """
        try:
            if self.leaf.built_in == "TryCatch" and not self.catches and self.port("catch_on_halt"):
                self.children.halt_all()
                self.children.tick(len(self.children) - 1)
        finally:
            self._stop()

    def _stop(self) -> None:
        self._begin_anew()
        self.reset()
        self.children.halt_all()

    def reset(self) -> None:
        """Forget where it was."""
        self.current = self.count = self.skipped = 0
        self.catches = False

    def port(self, key: str) -> Any:
        """The value of an input port."""
        return read_port(next(port for port in self.leaf.inputs if port.key == key), self.node)

    def number(self, key: str) -> float:
        """The value of an input port that is a number."""
        return float(self.port(key))

    def write(self, key: str, value: int) -> None:
        """Write an output port."""
        write_port(next(port for port in self.leaf.outputs if port.key == key), value, self.node)

    def _begin_anew(self) -> None:
        self.is_active = False
        self.clock.stop()


def _begins(node: Control) -> bool:
    """Whether ``node`` begins with this tick."""
    begins = not node.is_active
    if begins:
        node.is_active = node.is_first = True
    return begins


def _waits(node: Control, key: str) -> bool:
    """Whether the time of ``node``, in its port ``key`` (ms), has not passed yet."""
    if _begins(node):
        node.clock.start(node.number(key) / 1e3)
    return not node.clock.is_over()


def _sleep(node: Control) -> str:
    return "RUNNING" if _waits(node, TIMED["Sleep"]) else "SUCCESS"


def _delay(node: Control) -> str:
    return "RUNNING" if _waits(node, TIMED["Delay"]) else node.children.tick(0)


def _timeout(node: Control) -> str:
    return node.children.tick(0) if _waits(node, TIMED["Timeout"]) else "FAILURE"


def _rate_controller(node: Control) -> str:
    """The child is ticked at once, then at most ``hz`` times a second; while it runs, always."""
    if _begins(node):
        node.clock.start(_period_s(node))
    is_over = node.clock.is_over()
    if not (node.is_first or is_over or node.children.is_running(0)):
        return "RUNNING"
    node.is_first = False
    status = node.children.tick(0)
    if status == "SUCCESS":
        node.clock.start(_period_s(node))
    return status


def _period_s(node: Control) -> float:
    rate_hz = node.number("hz")
    return 1 / rate_hz if rate_hz > 0 else math.inf


def _pipeline_sequence(node: Control) -> str:
    """A sequence that ticks all children before the one that runs, too, at each tick."""
    skipped = 0
    for child in range(len(node.children)):
        status = node.children.tick(child)
        if status == "FAILURE":
            node.reset()
            return status
        if status == "RUNNING" and child >= node.current:
            node.current = child
            return status
        skipped += status == "SKIPPED"
    node.reset()
    return "SKIPPED" if skipped == len(node.children) else "SUCCESS"


def _nonblocking_sequence(node: Control) -> str:
    """All children are ticked at each tick, until one fails, or all succeed at once."""
    statuses = []
    for child in range(len(node.children)):
        statuses.append(node.children.tick(child))
        if statuses[-1] == "FAILURE":
            return "FAILURE"
    if "RUNNING" in statuses:
        return "RUNNING"
    return "SUCCESS" if "SUCCESS" in statuses else "SKIPPED"


def _persistent_sequence(node: Control) -> str:
    """A sequence that keeps the number of its child on the blackboard, also when it is halted."""
    key = "current_child_idx"
    current = int(node.port(key))
    if current < 0:
        raise PortError(f"its port `{key}` is {current}: children are numbered from 0")
    while current < len(node.children):
        status = node.children.tick(current)
        if status == "RUNNING":
            return status
        current = 0 if status == "FAILURE" else current + 1
        node.write(key, current)
        if status == "FAILURE":
            return status
    node.write(key, 0)
    return "SUCCESS"


def _round_robin(node: Control) -> str:
    """One child after the other until one succeeds; the next time it begins with the one after that."""
    many = len(node.children)
    wraps_around = node.port("wrap_around")
    skipped = 0
    while node.count + skipped < many:
        status = node.children.tick(node.current)
        if status == "RUNNING":
            return status
        node.current += 1
        is_last = node.current == many
        node.current %= many
        if status == "SUCCESS":
            node.count = 0
            return status
        node.count += status == "FAILURE"
        skipped += status == "SKIPPED"
        if is_last and not wraps_around:
            break
    node.reset()
    return "SKIPPED" if skipped == many else "FAILURE"


def _recovery_node(node: Control) -> str:
    """The first child; whenever it fails the second one, and then the first again, up to so many times."""
    retries = node.number("number_of_retries")
    while True:
        status = node.children.tick(node.current)
        if status == "RUNNING":
            return status
        if node.current == 0:
            if status != "FAILURE" or node.count >= retries:
                node.reset()
                return status
            node.children.halt(0)
            node.current = 1
        elif status == "SUCCESS":
            node.children.halt(1)
            node.count += 1
            node.current = 0
            if not node.children.may_go_back():
                return "RUNNING"  # the next tick goes on
        elif status == "SKIPPED":  # there is no recovery; it counts as no retry
            node.current = 0
            return "FAILURE"
        else:
            node.reset()
            return status


def _single_trigger(node: Control) -> str:
    """The child until it has ended, once; then FAILURE, until the node starts anew."""
    _begins(node)
    if not node.is_first:
        return "FAILURE"
    status = node.children.tick(0)
    node.is_first = status not in ("SUCCESS", "FAILURE")
    return status


def _try_catch(node: Control) -> str:
    """All children but the last as a sequence; where one fails, the last one, and then FAILURE."""
    last = len(node.children) - 1
    while not node.catches and node.current < last:
        status = node.children.tick(node.current)
        if status == "RUNNING":
            return status
        if status == "FAILURE":
            node.children.halt_all()
            node.catches = True
        node.current += 1
        node.skipped += status == "SKIPPED"
    if node.catches and node.children.tick(last) == "RUNNING":
        return "RUNNING"
    status = "FAILURE" if node.catches else "SKIPPED" if node.skipped == last else "SUCCESS"
    node.reset()
    return status


_TICKS: dict[str, Callable[[Control], str]] = {
    "Sleep": _sleep,
    "Delay": _delay,
    "Timeout": _timeout,
    "RateController": _rate_controller,
    "PipelineSequence": _pipeline_sequence,
    "NonblockingSequence": _nonblocking_sequence,
    "PersistentSequence": _persistent_sequence,
    "RoundRobin": _round_robin,
    "RecoveryNode": _recovery_node,
    "SingleTrigger": _single_trigger,
    "TryCatch": _try_catch,
}
