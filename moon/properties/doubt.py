"""Monitoring while some values are not known: every formula at its best and at its worst.

A predicate is unknown before its first observation, after a value that it cannot judge, and where
messages were lost. Then the network runs twice, split by polarity: *best* takes every unknown the way
that helps the formula, *worst* the way that harms it. Where both agree, so would every completion of
what was heard; where they do not, the verdict is inconclusive. When both have come to the same state
there is no doubt left, and the monitor goes on with one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from heapq import heapify, heappush
from typing import Any

from moon.properties.compiler import Program, compile_network
from moon.properties.formula import Formula
from moon.properties.network import Network, NetworkBuilder, Node, build_network
from moon.properties.rules import NEVER, mode, state_names

State = dict[int, tuple[Any, ...]]
"""Per remembering node, its variables in a normal form (see :func:`normal`)."""


def normal(node: Node, values: Sequence[Any], now: int) -> tuple[Any, ...]:
    """A node's variables without what no later instant can see; equal forms behave equally."""
    lower, upper = node.interval.lower, node.interval.upper
    match mode(node):
        case "ever" | "lower":
            first = values[0]
            return (NEVER if first == NEVER else max(first, now - lower),)
        case "upper":
            open_, start, end = values
            return (open_, start == now if open_ else False, end if not open_ and end > now else -1)
        case "both":
            open_, start, shown, queue = values
            return (
                open_,
                start == now if open_ else False,
                max(shown, now) if open_ else -1,
                tuple((max(first, now), last) for first, last in queue if last > now),
            )
        case "since":
            return (values[0],)
        case "since_lower":
            first, waiting = values
            return (NEVER if first == NEVER else max(first, now - lower), waiting)
        case "since_upper":
            open_, waiting, start, end = values
            return (
                open_,
                waiting,
                start == now if open_ else False,
                end if not open_ and end > now else -1,
            )
        case _:
            open_, waiting, start, shown, queue = values
            assert upper is not None
            return (
                open_,
                waiting,
                start == now if open_ else False,
                max(shown, now) if open_ else -1,
                tuple((max(first, now), last) for first, last in queue if last > now),
            )


def read_state(network: Network, program: Program) -> dict[int, tuple[Any, ...]]:
    """The raw variables of every remembering node (deques copied)."""
    variables = program.read()
    return {
        index: tuple(
            deque(value) if isinstance(value := variables[name], deque) else value
            for name in state_names(index, node)
        )
        for index, node in enumerate(network.nodes)
        if node.kind in ("once", "since")
    }


def state_form(network: Network, program: Program, now: int) -> tuple[Any, ...]:
    """Everything of ``program`` that decides how it goes on from ``now``."""
    raw = read_state(network, program)
    variables = program.read()
    nodes = tuple(normal(network.nodes[index], values, now) for index, values in raw.items())
    atoms = tuple(variables[name] for name in variables if name[0] in "pX")
    pulses = tuple(sorted(instant for instant, _ in program.heap if instant == now + 1))
    return nodes, atoms, pulses, program.values()


def write_state(
    network: Network, program: Program, states: Mapping[int, Sequence[Any]], now: int
) -> None:
    """Put raw variables into ``program``, at instant ``now``, and plan what follows from them."""
    values: dict[str, Any] = {"now": now}
    plans: list[tuple[int, int]] = [(NEVER, NEVER)]
    for index, raw in states.items():
        node = network.nodes[index]
        kept = [deque(value) if isinstance(value, deque) else value for value in raw]
        values.update(zip(state_names(index, node), kept, strict=True))
        plans += [(instant, index) for instant in _instants(node, kept) if now < instant < NEVER]
    program.write(values)
    program.heap[:] = plans
    heapify(program.heap)


def _instants(node: Node, raw: Sequence[Any]) -> Iterable[int]:
    """When the node may change by itself."""
    match mode(node):
        case "lower" | "since_lower":
            return (raw[0] + node.interval.lower,)
        case "upper" | "since_upper":
            return (raw[-1],)
        case "both" | "since_both":
            shown, queue = raw[-2], raw[-1]
            return (shown, *(instant for pair in queue for instant in pair))
        case _:
            return ()


def havoc(node: Node, raw: Sequence[Any], start: int, end: int, best: bool) -> tuple[Any, ...]:
    """The variables if the inputs may have been anything in ``[start, end)``.

    ``best``: the node's own value is to be as true as it can have become, else as false.
    """
    lower, upper = node.interval.lower, node.interval.upper
    match mode(node):
        case "ever" | "lower":
            first = raw[0]
            return (min(first, start) if best else first if first <= start else NEVER,)
        case "since":
            return (best,)
        case "since_lower":
            return (min(raw[0], start), True) if best else (NEVER, False)
        case "upper":
            assert upper is not None
            return (raw[0], raw[1], max(raw[2], end + upper)) if best else (False, NEVER, -1)
        case "since_upper":
            assert upper is not None
            if best:
                return (raw[0], True, raw[2], max(raw[3], end + upper))
            return (False, False, NEVER, -1)
        case kind:
            assert upper is not None
            shown = min(raw[-2], start + lower) if raw[0] else start + lower
            seen = deque(((shown, max(end, start + 1) + upper),))
            waiting = (best,) if kind == "since_both" else ()
            if best:
                for first, last in raw[-1]:
                    if last < shown:
                        seen.appendleft((first, last))
                    else:
                        seen[-1] = (min(first, seen[-1][0]), max(last, seen[-1][1]))
                queue = deque(sorted(seen))
                return (False, *waiting, NEVER, NEVER, queue)
            return (False, *waiting, NEVER, NEVER, deque())


class Doubt:
    """The network of some formulas run at its best and at its worst.

    Args:
        formulas: the formulas.
        events: texts of predicates that hold for one tick only.
        plain: the network without polarity, whose states can be taken over and given back.
    """

    def __init__(self, formulas: Sequence[Formula], events: Iterable[str], plain: Network) -> None:
        self.network = build_network(formulas, by_polarity=True)
        self._images = _images(self.network, plain)
        self._atoms: dict[str, list[tuple[int, bool]]] = {}
        pulses = []
        self._events = frozenset(events)
        for index, node in enumerate(self.network.nodes):
            if node.kind == "atom":
                self._atoms.setdefault(node.text[1:], []).append((index, node.text[0] == "+"))
                if node.text[1:] in self._events:
                    pulses.append(index)
        logs: dict[str, Callable[[Any], None]] = {f"log{index}": _forget for index in pulses}
        self.best = compile_network(self.network, pulses, environment=dict(logs))
        self.worst = compile_network(self.network, pulses, environment=dict(logs))
        self.unknown: dict[str, str] = {}
        """Texts of unknown predicates, with the reason."""
        self._remembering = [
            (image, node := self.network.nodes[index], state_names(index, node))
            for index, image in self._images.items()
        ]
        self._wanted = sum(node.kind in ("once", "since") for node in plain.nodes)

    def enter(
        self, states: Mapping[int, Sequence[Any]], atoms: Mapping[str, bool | None], now: int
    ) -> None:
        """Take over the plain network's states of instant ``now``, with the atoms' values."""
        for program in (self.best, self.worst):
            own = {index: states[image] for index, image in self._images.items() if image in states}
            write_state(self.network, program, own, now)
        for text, value in atoms.items():
            self._set(text, value, now)

    def lose(self, texts: Iterable[str], start: int, end: int) -> None:
        """The predicates ``texts`` may have been anything in ``[start, end)``."""
        lost = [index for text in texts for index, _ in self._atoms.get(text, ())]
        reached = set(self.network.cone(lost))
        grows = _grows(self.network)
        for program, best in ((self.best, True), (self.worst, False)):
            raw = read_state(self.network, program)
            for index in raw:
                if index in reached:
                    node = self.network.nodes[index]
                    raw[index] = havoc(node, raw[index], start, end, grows[index] == best)
            write_state(self.network, program, raw, end)
            now = program.read()
            for text in self._events:
                for index, _ in self._atoms.get(text, ()):
                    if now[f"p{index}"]:
                        program.heap.append((end + 1, index))
            heapify(program.heap)

    def observe(self, now: int, values: Mapping[str, bool | None]) -> None:
        """Bring everything to ``now`` with the given predicates at new values (None: unknown)."""
        for program in (self.best, self.worst):
            program.before(now)
        for text, value in values.items():
            self._set(text, value, now)
        self.step(now)

    def step(self, now: int) -> None:
        """Evaluate both at ``now``."""
        for program in (self.best, self.worst):
            program.at(now)
            program.step(now)

    def settle(self, now: int) -> None:
        """Make every change that is due up to ``now``."""
        self.best.settle(now)
        self.worst.settle(now)

    def _set(self, text: str, value: bool | None, now: int) -> None:
        pulse = text in self._events and value is not False
        for index, helps in self._atoms.get(text, ()):
            for program, best in ((self.best, True), (self.worst, False)):
                program.put[index](helps == best if value is None else value)
                if pulse:
                    heappush(program.heap, (now + 1, index))

    def next_deadline(self) -> int:
        """The earliest instant at which something changes by itself."""
        return min(self.best.heap[0][0], self.worst.heap[0][0])

    def results(self) -> list[bool | None]:
        """Per formula: true, false, or None where best and worst differ."""
        return [
            best if best == worst else None
            for best, worst in zip(self.best.values(), self.worst.values(), strict=True)
        ]

    def resolved(self, now: int) -> dict[int, tuple[Any, ...]] | None:
        """The plain network's states, if nothing is in doubt any more."""
        if self.unknown:
            return None
        best, worst = self.best.read(), self.worst.read()
        states: dict[int, tuple[Any, ...]] = {}
        forms: dict[int, tuple[Any, ...]] = {}
        for place, (image, node, names) in enumerate(self._remembering):
            values = tuple(best[name] for name in names)
            form = normal(node, values, now)
            others = normal(node, tuple(worst[name] for name in names), now)
            if form != others or forms.setdefault(image, form) != form:
                # what is in doubt mostly still is the next time: looked at first then
                self._remembering.insert(0, self._remembering.pop(place))
                return None
            states[image] = values
        return states if len(states) == self._wanted else None


def _forget(_entry: object) -> None:
    """A pulse's end is logged once, by the monitor, not by both runs."""


def _grows(network: Network) -> list[bool]:
    """Per node: whether its truth helps the formulas (atoms say so by their sign)."""
    grows: list[bool] = []
    for node in network.nodes:
        match node.kind:
            case "atom":
                grows.append(node.text[0] == "+")
            case "constant":
                grows.append(True)
            case "not":
                grows.append(not grows[node.inputs[0]])
            case _:
                known = [grows[item] for item in node.inputs if not _is_constant(network, item)]
                grows.append(known[0] if known else True)
    return grows


def _is_constant(network: Network, index: int) -> bool:
    node = network.nodes[index]
    return node.kind == "constant" or (
        bool(node.inputs) and all(_is_constant(network, item) for item in node.inputs)
    )


def _images(split: Network, plain: Network) -> dict[int, int]:
    """Per remembering node of ``split``, the node of ``plain`` that it is when signs are dropped."""
    builder = NetworkBuilder(False)
    for node in plain.nodes:
        builder.add(node)
    image: list[int] = []
    for node in split.nodes:
        inputs = tuple(image[item] for item in node.inputs)
        match node.kind:
            case "atom":
                image.append(builder.add(Node("atom", text=node.text[1:])))
            case "constant":
                image.append(builder.add(node))
            case "not":
                image.append(builder.negate(inputs[0]))
            case "and":
                image.append(builder.conjoin(inputs))
            case _:
                image.append(builder.add(Node(node.kind, inputs, node.interval)))
    size = len(plain.nodes)
    return {
        index: image[index]
        for index, node in enumerate(split.nodes)
        if node.kind in ("once", "since") and image[index] < size
    }
