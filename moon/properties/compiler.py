"""A network of nodes to Python: one closure per monitor, constant work per change.

A node that remembers keeps a handful of integers; ``once[a:b]`` and ``since[a:b]`` with ``a > 0`` keep
the intervals of their input that a later instant can still see, no more. When a node's value will
change by itself, the instant is pushed on a heap: :func:`settle` makes those changes in order, so
that nothing needs to be asked between two observations. Which instants they are depends on the
bounds, how much work they are does not.

The generated text is Python of our own making from the tree: no text of a formula reaches it.
"""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from heapq import heapify, heappop, heappush
from types import CodeType
from typing import Any

import msgspec

from moon.properties.network import INITIAL, NEVER, UPDATES, Network, Node, mode, state_names

BEGINNING = -1
"""The cause, on the heap, of the first step."""
CONES_FROM = 60
"""Networks with more nodes get a function per cause of change, smaller ones one for all."""
CONES_UP_TO = 50
"""So do no networks of which every node has more than so many that depend on it, on the average: the
functions would be quadratic in the size of the formula. A thousand properties have ten."""


class CompiledNetwork(msgspec.Struct, frozen=True):
    """A compiled network's functions.

    Attributes:
        step: ``step(t)`` brings every node to instant ``t`` with the atoms as they are.
        settle: ``settle(t)`` makes every change that is due up to ``t``, in order.
        before: ``before(t)`` makes those due before ``t``; true if something is due at ``t`` itself.
        handlers: the functions of ``extra``, by name.
        clock: the instant that the network is at; -1 before the first.
        read: all variables by name; ``met`` is the last instant for which ``before`` was true, ``again``
            is for :mod:`moon.properties.three_valued`.
        write: sets variables by name.
        put: per atom (node index), sets it.
        at: sets the instant.
        values: ``values()`` are the roots' values; None before the first step.
        changed: roots whose value changed since the list was last cleared.
        heap: instants of changes to come, with their causes; ends with ``NEVER``.
        source: the Python text.
    """

    step: Callable[[int], None]
    settle: Callable[[int], None]
    before: Callable[[int], bool]
    handlers: dict[str, Callable[..., Any]]
    clock: Callable[[], int]
    read: Callable[[], dict[str, Any]]
    write: Callable[[dict[str, Any]], None]
    put: dict[int, Callable[[bool], None]]
    at: Callable[[int], None]
    values: Callable[[], tuple[bool | None, ...]]
    changed: list[int]
    heap: list[tuple[int, int]]
    source: str

    def snapshot(self) -> tuple[dict[str, Any], list[tuple[int, int]]]:
        """The variables and the heap, copied."""
        variables = {
            name: deque(value) if isinstance(value, deque) else value
            for name, value in self.read().items()
        }
        return variables, list(self.heap)

    def go_back(self, state: tuple[dict[str, Any], list[tuple[int, int]]]) -> None:
        """Restore what :meth:`snapshot` returned."""
        variables, heap = state
        self.write(
            {
                name: deque(value) if isinstance(value, deque) else value
                for name, value in variables.items()
            }
        )
        self.heap[:] = heap
        self.changed.clear()


class NetworkCode(msgspec.Struct, frozen=True):
    """A network as Python, for any number of programs that run it.

    Attributes:
        source: the Python text.
        code: the same, compiled.
    """

    source: str
    code: CodeType

    def program(self, environment: Mapping[str, Any] | None = None) -> CompiledNetwork:
        """A program of its own, at the beginning; ``environment``: names that its handlers use."""
        scope: dict[str, Any] = {
            **{"deque": deque, "heappush": heappush, "heappop": heappop, "heapify": heapify},
            **(environment or {}),
        }
        exec(self.code, scope)
        made: CompiledNetwork = scope["build"](CompiledNetwork, self.source)
        return made


def network_code(
    network: Network,
    pulses: Sequence[int] = (),
    groups: Mapping[str, Sequence[int]] | None = None,
    extra: str = "",
    extra_variables: Sequence[str] = (),
) -> NetworkCode:
    """Write ``network`` as Python.

    Args:
        network: what to compute.
        pulses: atoms (node indices) that hold for one tick only and end by themselves.
        groups: functions ``name(t)`` to write: each brings what depends on its atoms to ``t``.
        extra: source of further functions at the closure's level (the channels' handlers).
        extra_variables: the variables that ``extra`` keeps, all starting as None.
    """
    writer = _Writer(network, pulses, groups or {})
    source = writer.module(extra, extra_variables)
    return NetworkCode(source, _code(source))


@functools.lru_cache(maxsize=64)
def _code(source: str) -> CodeType:
    """Equal networks have one text."""
    return compile(source, "<monitor>", "exec")


class _Writer:
    """Writes the module's text."""

    def __init__(
        self, network: Network, pulses: Sequence[int], groups: Mapping[str, Sequence[int]]
    ) -> None:
        self._network = network
        self._nodes = network.nodes
        self._pulses = tuple(pulses)
        self._groups = groups
        uses = [0] * len(self._nodes)
        for node in self._nodes:
            for item in node.inputs:
                uses[item] += 1 + (node.kind == "since")
        for root in network.roots:
            uses[root] += 1
        self._shared = {
            index
            for index, node in enumerate(self._nodes)
            if node.kind == "and" and uses[index] > 1
        }
        self._roots_of: dict[int, list[int]] = {}
        for number, root in enumerate(network.roots):
            self._roots_of.setdefault(root, []).append(number)

    def module(self, extra: str, extra_variables: Sequence[str]) -> str:
        """The whole text: ``build(CompiledNetwork)`` returns the compiled program."""
        variables: dict[str, str] = {"now": "-1", "met": "-1", "again": "-1"}
        for index, node in enumerate(self._nodes):
            if node.kind == "atom":
                variables[f"p{index}"] = "False"
            elif node.kind in ("once", "since"):
                for name in state_names(index, node):
                    variables[name] = INITIAL[name[0]]
                if mode(node) != "ever":
                    variables[f"v{index}"] = "False"
        for number in range(len(self._network.roots)):
            variables[f"r{number}"] = "None"
        variables.update(dict.fromkeys(extra_variables, "None"))
        every = range(len(self._nodes))
        parts = ["def build(CompiledNetwork, source):"]
        parts += [f"    {name} = {value}" for name, value in variables.items()]
        parts += [f"    heap = [({NEVER}, {NEVER})]", "    changed = []"]
        parts += self._function("step", every, variables)
        parts += self._causes(variables)
        parts += _TIME.splitlines()
        parts += [f"    {line}".rstrip() for line in extra.splitlines()]
        names = list(variables)
        parts += ["    def clock():", "        return now", "    def read():"]
        parts.append(f"        return {{{', '.join(f'{name!r}: {name}' for name in names)}}}")
        parts.append("    def write(values):")
        for start in range(0, len(names), 200):
            parts.append(f"        nonlocal {', '.join(names[start : start + 200])}")
        parts += [f"        {name} = values.get({name!r}, {name})" for name in names]
        atoms = [index for index, node in enumerate(self._nodes) if node.kind == "atom"]
        for index in atoms:
            parts += [f"    def put{index}(value):", f"        nonlocal p{index}"]
            parts.append(f"        p{index} = value")
        parts.append(f"    put = {{{', '.join(f'{index}: put{index}' for index in atoms)}}}")
        parts += ["    def at(t):", "        nonlocal now", "        now = t"]
        parts.append("    def values():")
        roots = "".join(f"r{number}, " for number in range(len(self._network.roots)))
        parts.append(f"        return ({roots})")
        handlers = [line[4 : line.index("(")] for line in extra.splitlines() if line[:4] == "def "]
        named = ", ".join(f"{name!r}: {name}" for name in handlers)
        parts.append(
            f"    return CompiledNetwork(step, settle, before, {{{named}}}, clock, read, write, put, at,"
            " values,"
            " changed, heap, source)"
        )
        return "\n".join(parts) + "\n"

    def _causes(self, variables: dict[str, str]) -> list[str]:
        """``CAUSES``: what to run when a node is due alone; ``ENDS``: how a pulse ends."""
        lines: list[str] = []
        starts = [i for i, node in enumerate(self._nodes) if node.kind in ("atom", "once", "since")]
        small = len(self._nodes) <= CONES_FROM
        cones = {} if small else {index: self._network.cone([index]) for index in starts}
        size = sum(1 + len(self._nodes[i].inputs) for cone in cones.values() for i in cone)
        small = small or size > CONES_UP_TO * len(self._nodes)
        causes: dict[int, str] = {BEGINNING: "step"}
        for index, node in enumerate(self._nodes):
            if node.kind not in ("atom", "once", "since"):
                continue
            if small:
                causes[index] = "step"
                continue
            causes[index] = f"cone{index}"
            start = [index] if node.kind != "atom" else []
            cone = [item for item in cones[index] if item != index]
            lines += self._function(f"cone{index}", start + cone, variables)
        lines.append(
            f"    causes = {{{', '.join(f'{key}: {name}' for key, name in causes.items())}}}"
        )
        for index in self._pulses:
            lines += [
                f"    def end{index}(t):",
                f"        nonlocal p{index}",
                f"        p{index} = False",
                f"        log{index}((t, False, None))",
            ]
        for name, atoms in self._groups.items():
            if small:
                lines.append(f"    {name} = step")
            else:
                lines += self._function(name, self._network.cone(atoms), variables)
        ends = ", ".join(f"{index}: end{index}" for index in self._pulses)
        lines.append(f"    ends = {{{ends}}}")
        return lines

    def _function(self, name: str, indices: Sequence[int], variables: dict[str, str]) -> list[str]:
        body: list[str] = []
        inside = set(indices)
        available = self._shared & inside
        for index in indices:
            node = self._nodes[index]
            if node.kind in ("once", "since"):
                body += self._update(index, node, available)
            elif index in available:
                body.append(f"b{index} = {self._and(index, available)}")
            for number in self._roots_of.get(index, ()):
                body += [
                    f"r = {self._value(index, available)}",
                    f"if r is not r{number}:",
                    f"    r{number} = r",
                    f"    changed.append({number})",
                ]
        assigned = sorted(
            {
                line.split(" = ")[0].strip()
                for line in body
                if " = " in line and line.split(" = ")[0].strip() in variables
            }
        )
        lines = [f"    def {name}(t):"]
        if assigned:
            lines.append(f"        nonlocal {', '.join(assigned)}")
        lines += [f"        {line}" for line in body or ["pass"]]
        return lines

    def _value(self, index: int, available: set[int]) -> str:
        node = self._nodes[index]
        match node.kind:
            case "constant":
                return "True" if node.text == "true" else "False"
            case "atom":
                return f"p{index}"
            case "not":
                inner = self._nodes[node.inputs[0]]
                if inner.kind == "once" and mode(inner) == "ever":
                    return f"(l{node.inputs[0]} == {NEVER})"
                return f"(not {self._value(node.inputs[0], available)})"
            case "and":
                return f"b{index}" if index in available else f"({self._and(index, available)})"
            case _:
                return f"(l{index} < {NEVER})" if mode(node) == "ever" else f"v{index}"

    def _and(self, index: int, available: set[int]) -> str:
        return " and ".join(self._value(item, available) for item in self._nodes[index].inputs)

    def _update(self, index: int, node: Node, available: set[int]) -> list[str]:
        inputs = [self._value(item, available) for item in node.inputs]
        lower, upper = node.interval.lower, node.interval.upper
        template = UPDATES[mode(node)]
        text = (
            template.replace("#", str(index)).replace("<A>", str(lower)).replace("<B>", str(upper))
        )
        text = text.replace("<NEVER>", str(NEVER)).replace("<P>", inputs[0])
        return text.replace("<Q>", inputs[-1]).strip("\n").splitlines()


_TIME = """    def due(t):
        found = set()
        while heap[0][0] == t:
            cause = heappop(heap)[1]
            found.add(cause)
            if cause in ends:
                ends[cause](t)
        return found
    def settle(t):
        nonlocal now
        while heap[0][0] <= t:
            d = heap[0][0]
            found = due(d)
            if len(found) == 1:
                causes[found.pop()](d)
            else:
                step(d)
            now = d
        if t > now:
            now = t
    def before(t):
        nonlocal met
        if heap[0][0] < t:
            settle(t - 1)
        if heap[0][0] == t:
            due(t)
            met = t
            return True
        return False"""
