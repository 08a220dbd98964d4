"""A leaf, a decorator or a control node that a generated plugin machine runs.

The machine runs on the transport's executor, the tree is ticked on a thread that waits for it: they
talk. The tree's side sends an event (tick, halt, a child's status) and takes what the machine says
until that is the answer; ticking a child or writing a port is done in between, by the thread that
ticks the tree.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import msgspec

from m2c.policy.program import Leaf
from m2c.policy.ticking import Children, Nesting, PortError, TreeNode, read_port, write_port
from m2c.policy.ticks import LeafTick, PortOutput
from m2c.runtime.binding import NodeSettings
from transports.interface import Completion, Transport

MAX_CHILD_TICKS = 1_000
"""How often a plugin may tick its children before it answers its own tick."""


class _Answer(msgspec.Struct, frozen=True):
    status: str


class _Output(msgspec.Struct, frozen=True):
    key: str
    value: Any


class _TickChild(msgspec.Struct, frozen=True):
    child: int


class _HaltChild(msgspec.Struct, frozen=True):
    child: int


_Said = _Answer | _Output | _TickChild | _HaltChild


class _PluginError(Exception):
    """The plugin's machine does what it cannot; the text says what."""


class PluginLeaf:
    """All places where one plugin of the policy stands; each has a machine of its own.

    Args:
        leaf: the plugin and its ports.
        transport: the policy's connection.
        node_class: the generated ``…Node``.
        timeout_s: how long the machine may take to answer; it counts as FAILURE then.
        log: where faults are reported.
        nesting: of the trees of its children.
        settings: how the machine behaves towards others.
    """

    def __init__(
        self,
        leaf: Leaf,
        transport: Transport,
        node_class: Callable[..., Any],
        timeout_s: float,
        log: logging.Logger,
        nesting: Nesting,
        settings: NodeSettings,
    ) -> None:
        self._leaf = leaf
        self._nesting = nesting
        self._arguments = (leaf, transport, node_class, timeout_s, log, settings)
        self._places: dict[int, _Place] = {}
        self._first: _Place | None = _Place(*self._arguments)
        if not any(port.entry for port in leaf.inputs):
            self._first.start()  # it hears topics from now on, not from its first tick

    def tick(self, node: TreeNode, record: LeafTick) -> str:
        """SUCCESS, FAILURE or RUNNING."""
        return self._place_of(node).tick(record)

    def _place_of(self, node: TreeNode) -> _Place:
        place = self._places.get(id(node))
        if place is None:
            place = self._first or _Place(*self._arguments)
            self._first = None
            self._places[id(node)] = place
            place.node = node  # kept, so that no other node gets its id()
            place.children = Children(self._nesting, self._leaf.id, self._leaf.children, node)
        return place

    def halt(self, node: TreeNode, record: LeafTick) -> None:
        """Stop what is RUNNING."""
        place = self._places.get(id(node))
        if place is not None:
            place.halt(record)


class _Place:
    """One node of the tree and its machine."""

    node: TreeNode
    children: Children

    def __init__(
        self,
        leaf: Leaf,
        transport: Transport,
        node_class: Callable[..., Any],
        timeout_s: float,
        log: logging.Logger,
        settings: NodeSettings,
    ) -> None:
        self._leaf = leaf
        self._settings = settings
        self._transport = transport
        self._node_class = node_class
        self._timeout_s = timeout_s
        self._log = log
        self._outputs = {port.key: port for port in leaf.outputs}
        self._inputs: dict[str, Any] = {port.key: port.value for port in leaf.inputs}
        self._machine: Any = None

    def start(self) -> None:
        """Start the machine; one that was there before is heard no more."""
        self._talk = _Talk(self._transport, self._inputs)
        self._machine = self._node_class(self._transport, self._talk, self._settings, self._inputs)
        self._transport.post(self._machine.start)

    def tick(self, record: LeafTick) -> str:
        leaf = self._leaf
        try:
            self._read_inputs()
            if self._machine is None:
                self.start()
            status = self._ask(self._machine.tick, record)
        except (PortError, _PluginError) as error:
            self._log.error("leaf %s: %s; taken as FAILURE", leaf.name, error)
            self._give_up()
            return "FAILURE"
        if status is None:
            self._log.error(
                "leaf %s: its plugin %s gave no status within %g s (%s); taken as FAILURE",
                leaf.name,
                leaf.plugin,
                self._timeout_s,
                leaf.tick or "no service",
            )
            self._give_up()
            return "FAILURE"
        if status != "RUNNING":
            self.children.halt_all()
        return status

    def halt(self, record: LeafTick) -> None:
        if self._machine is not None:
            try:
                answer = self._ask(self._machine.halt, record)
            except (PortError, _PluginError) as error:
                self._log.error("leaf %s: %s", self._leaf.name, error)
                answer = "HALTED"
            if answer is None:
                self._log.error("leaf %s: its plugin does not halt", self._leaf.name)
                self._machine = None
        self.children.halt_all()

    def _give_up(self) -> None:
        """The next tick starts with a fresh machine: this one waits for its answer for ever."""
        self._machine = None
        self.children.halt_all()

    def _read_inputs(self) -> None:
        newer = self._talk.not_yet_written() if self._machine is not None else ()
        for port in self._leaf.inputs:
            if port.key not in newer:
                self._inputs[port.key] = read_port(port, self.node)

    def _ask(self, event: Callable[[], object], record: LeafTick) -> str | None:
        """Send ``event`` and do what the machine says until it answers; None if it does not.

        What it writes is noted in ``record``.
        """
        said = self._talk.send(event).wait(self._timeout_s)
        ticks = 0
        while said is not None:
            answer = None
            for what in said:
                match what:
                    case _Answer(status=status):
                        answer = answer or status  # the first one counts
                    case _Output(key=key) if key not in self._outputs:
                        continue  # the tree has no use for it
                    case _Output(key=key, value=value):
                        text = write_port(self._outputs[key], value, self.node)
                        record.outputs.append(PortOutput(key, text))
                    case _TickChild(child=child):
                        ticks += 1
                        if ticks > MAX_CHILD_TICKS:
                            raise _PluginError(
                                f"its plugin {self._leaf.plugin} ticked its children "
                                f"{MAX_CHILD_TICKS} times and gave no status"
                            )
                        self._tick_child(child)
                    case _HaltChild(child=child):
                        self._check_child(child)
                        self.children.halt(child)
                        self._tell("child_halted", child)
            if answer is not None:
                return answer
            said = self._talk.send(None).wait(self._timeout_s)
        return None

    def _tick_child(self, child: int) -> None:
        self._check_child(child)
        status = self.children.tick(child)
        if status == "SKIPPED":
            self._log.error(
                "leaf %s: child %s was skipped; its plugin gets FAILURE", self._leaf.name, child
            )
            status = "FAILURE"
        self._read_inputs()
        self._tell("child_status", child, status)

    def _check_child(self, child: int) -> None:
        if not 0 <= child < len(self.children):
            raise _PluginError(
                f"its plugin {self._leaf.plugin} names child {child}; "
                f"it has {len(self.children)}, numbered from 0"
            )

    def _tell(self, method: str, *arguments: object) -> None:
        handler = getattr(self._machine, method, None)  # a machine that does not listen has none
        if handler is not None:
            self._transport.post(lambda: handler(*arguments))


class _Talk:
    """What one machine says; ``send`` is the tree's end, all else runs on the executor.

    A machine that the tree has given up talks to nobody. ``inputs`` are the values of its ports: what it
    writes to a port that it reads, it reads from then on.
    """

    def __init__(self, transport: Transport, inputs: dict[str, Any]) -> None:
        self._transport = transport
        self._inputs = inputs
        self._said: list[_Said] = []
        self._waiting: Completion | None = None

    def send(self, event: Callable[[], object] | None) -> Completion:
        """Run ``event``, if any; the completion gets what the machine says, once it says something."""
        waiting = self._transport.completion()

        def begin() -> None:
            self._waiting = waiting
            if event is not None:
                # an answer that nobody asked for is not the answer to what is asked now
                self._said = [what for what in self._said if not isinstance(what, _Answer)]
                event()
            self._deliver()

        self._transport.post(begin)
        return waiting

    def not_yet_written(self) -> set[str]:
        """The output ports whose values have not reached the blackboard."""
        return {what.key for what in tuple(self._said) if isinstance(what, _Output)}

    def return_status(self, status: str) -> None:
        self._say(_Answer(status))

    def return_halted(self) -> None:
        self._say(_Answer("HALTED"))

    def set_output(self, key: str, value: object) -> None:
        if key in self._inputs:
            self._inputs[key] = value
        self._say(_Output(key, value))

    def tick_child(self, child: int) -> None:
        self._say(_TickChild(child))

    def halt_child(self, child: int) -> None:
        self._say(_HaltChild(child))

    def _say(self, what: _Said) -> None:
        self._said.append(what)
        self._transport.post(self._deliver)  # after this run to completion, with all it says

    def _deliver(self) -> None:
        if self._waiting is not None and self._said:
            self._waiting.set(tuple(self._said))
            self._waiting = None
            self._said = []
