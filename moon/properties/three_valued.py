"""Three-valued evaluation: every formula at its best and at its worst, while some values are not known.

A predicate is unknown after a value that it cannot judge and where messages were lost. Then the network
runs twice, split by polarity: *best* takes every unknown the way that helps the formula, *worst* the way
that harms it. Where both agree the verdict is theirs (Kleene), else it is inconclusive. When both have
come to the same state, and nothing is unknown any more, the monitor goes on with one.

**Why it is sound.** A *completion* is what was observed, in its order, with any messages put in place of
the lost ones: stamped within the loss, any number, before or after what was observed with the same
stamp. A conclusive verdict on an instant is that of the monitor which observes the completion, for every
completion of the losses reported so far; a verdict that was reported before a loss was holds for instants
before it, and is withdrawn otherwise (:meth:`moon.properties.monitor_group.MonitorGroup.lose`).

1. *Values.* While a message may be lost that sets a predicate, the predicate is unknown: from the first
   instant of the loss on, until the last one if it is an event, and until it is set anew by an
   observation after the loss if it is a state. What is observed in the middle of a loss (of another
   source of the channel) is known at its place in the order, and unknown again behind it. So at every
   place in the order the two runs' values enclose those of each completion.
2. *Operators.* In the network split by polarity every node is monotone in its atoms: ``+p`` only ever
   helps, ``-p`` only ever harms, and ``and``, ``once`` and ``since`` are monotone in their inputs. Where
   the inputs enclose those of a completion, so do the outputs, and what the nodes remember.
3. *Steps.* A completion makes steps where the two runs make none: at lost messages. Between two steps of
   a run its inputs are constant, and to step twice with the same inputs is to step once, so that these
   steps add nothing, but for an observation at the same instant. There they may do two things:

   * A value may end at the instant at which it began; it then counts for that one tick, whereas a value
     that has lasted counts up to the tick before. Where a run cannot tell, a bound from above counts the
     tick and one from below does not (:meth:`ThreeValued.observe`, ``before``).
   * What is due at that instant may be evaluated before the observation is. Whatever depends on something
     that is due then is bounded as if its inputs had been anything at that instant (:func:`forget`).
4. *Time.* A loss ends just before its end: nothing is evaluated at that instant until what was observed
   then has come, or time has passed it.
5. *Losses that are reported late.* What the runs remember rests on values that were taken for known. For
   every node that depends on a lost predicate it is replaced by a bound of what any inputs since the
   beginning of the loss leave (:func:`forget`); if an observation met something due since then, for all
   nodes (3.).
6. *The way back.* The runs are given up only if nothing is unknown, no loss is to come, both have equal
   atoms and equal memories, up to what no later instant can see (:func:`normal`), and no run had to guess
   whether a value that may still end at this instant began at it (3.).

A verdict may be inconclusive although all completions agree: ``+p`` and ``-p`` are chosen independently
(``p or not p``), and a bound is not a set. With finite bounds that ends when they have passed.
"""

from __future__ import annotations

from bisect import insort
from collections import deque
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from heapq import heapify, heappush
from typing import Any

from moon.properties.compiler import BEGINNING, CompiledNetwork, network_code
from moon.properties.formula import Formula
from moon.properties.network import (
    NEVER,
    Network,
    NetworkBuilder,
    Node,
    build_network,
    mode,
    obligations,
    state_names,
)

Gap = tuple[int, int, str, str]
"""(start, end, port, reason): messages stamped in ``[start, end)`` that would have set ``port``."""
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


def read_state(network: Network, program: CompiledNetwork) -> dict[int, tuple[Any, ...]]:
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


def write_state(
    network: Network, program: CompiledNetwork, states: Mapping[int, Sequence[Any]], now: int
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


def forget(
    node: Node, raw: Sequence[Any], start: int, now: int, began: int, upper: bool
) -> tuple[Any, ...]:
    """The variables if the inputs may have been anything in ``[start, now]``: a bound of every case.

    Args:
        node: the node.
        raw: its variables at ``now``, of some values of its inputs in that time.
        start: the first instant that is not known.
        now: the last one.
        began: the instant at which monitoring began.
        upper: whether the bound is one of the node's value from above, else from below.
    """
    low, high = node.interval.lower, node.interval.upper
    kind = mode(node)
    if kind in ("ever", "lower"):
        first = raw[0]
        if upper:
            return (min(first, max(start, began)),)
        return (first if first < start else NEVER,)
    if kind == "since":
        return (upper,)
    # what was remembered of the time before may be overwritten: it is not looked at
    if kind == "since_lower":
        return (began if upper else NEVER, False)
    assert high is not None
    last = now + 1 + high
    match kind:
        case "upper":
            return (False, NEVER, last if upper else -1)
        case "since_upper":
            return (False, False, NEVER, last if upper else -1)
        case "both":
            open_, _, shown, queue = raw
            seen = [first for first, _ in queue] + ([shown] if open_ else [])
            span = (min([start + low, *seen]), last)
            return (False, NEVER, NEVER, deque((span,) if upper else ()))
        case _:
            span = (began + low, last)
            return (False, False, NEVER, NEVER, deque((span,) if upper else ()))


class SplitNetwork:
    """The network of some formulas split by polarity, for any number of :class:`ThreeValued`.

    Args:
        formulas: the formulas.
        events: texts of predicates that hold for one tick only.
        plain: the network without polarity, whose states can be taken over and given back.
    """

    def __init__(self, formulas: Sequence[Formula], events: Iterable[str], plain: Network) -> None:
        self.network = build_network(formulas, by_polarity=True)
        self.images = _images(self.network, plain)
        self.atoms: dict[str, list[tuple[int, bool]]] = {}
        pulses = []
        self.events = frozenset(events)
        for index, node in enumerate(self.network.nodes):
            if node.kind == "atom":
                self.atoms.setdefault(node.text[1:], []).append((index, node.text[0] == "+"))
                if node.text[1:] in self.events:
                    pulses.append(index)
        self.pulses = frozenset(pulses)
        self._code = network_code(self.network, pulses)
        self.remembering = [
            (image, node := self.network.nodes[index], state_names(index, node))
            for index, image in self.images.items()
        ]
        self.wanted = sum(node.kind in ("once", "since") for node in plain.nodes)
        own = obligations(plain)
        self.obligations = {
            f"l{index}": NEVER
            for index in obligations(self.network)
            if self.images.get(index) in own
        }
        self.grows = _grows(self.network)
        self.spells: dict[bool, list[str]] = {True: [], False: []}
        """Where nodes keep the instant at which their input became true, by :func:`_grows`."""
        for index, node in enumerate(self.network.nodes):
            if node.kind in ("once", "since") and node.interval.upper is not None:
                self.spells[self.grows[index]].append(f"l{index}")

    def program(self) -> CompiledNetwork:
        """One run of it."""
        logs: dict[str, Callable[[Any], None]] = {f"log{index}": _forget for index in self.pulses}
        return self._code.program(logs)


class ThreeValued:
    """The network of some formulas run at its best and at its worst.

    Args:
        split: the network.
    """

    def __init__(self, split: SplitNetwork) -> None:
        self.network = split.network
        self._images = split.images
        self._atoms = split.atoms
        self._events = split.events
        self._pulses = split.pulses
        self.best = split.program()
        self.worst = split.program()
        self.unknown: dict[str, str] = {}
        """Texts of unknown predicates, with the reason."""
        self._remembering = list(split.remembering)
        self._wanted = split.wanted
        self._began = -1
        self._initial = self.best.snapshot(), self.worst.snapshot()
        self._obligations = split.obligations
        self._grows = split.grows
        self._spells = split.spells

    def reset(self, began: int) -> None:
        """Know nothing, of a network that began at ``began``."""
        self._began = began
        self.unknown = {}
        for program, initial in zip((self.best, self.worst), self._initial, strict=True):
            program.go_back(initial)

    def enter(
        self,
        states: Mapping[int, Sequence[Any]],
        atoms: Mapping[str, bool | None],
        now: int,
        met: int,
    ) -> None:
        """Take over the plain network's states of instant ``now``, with the atoms' values.

        ``met`` is the last instant that was due when something was observed.
        """
        for program in (self.best, self.worst):
            own = {index: states[image] for index, image in self._images.items() if image in states}
            write_state(self.network, program, own, now)
            program.write({"met": met})
        for text, value in atoms.items():
            self._set(text, value, now, held=value is None)

    @property
    def began(self) -> int:
        """The first instant of which anything is remembered."""
        return self._began

    def began_at(self, instant: int) -> None:
        """What is remembered may be of ``instant``, or later."""
        self._began = instant

    def forget_obligations(self) -> None:
        """The formulas begin: whether they were false before is not asked."""
        for program in (self.best, self.worst):
            program.write(self._obligations)

    def begin(self, now: int) -> None:
        """The first step of all is due at ``now``."""
        for program in (self.best, self.worst):
            heappush(program.heap, (now, BEGINNING))

    def lose(self, texts: Iterable[str], start: int, now: int) -> None:
        """The predicates ``texts`` may have been anything in ``[start, now]``, which has passed.

        What was due at an instant of an observation may also have been evaluated before it, if a
        message that was lost had that instant, too: then nothing that was computed since stands.
        """
        self._began = min(self._began, start)
        if self.met >= start:
            self._forget(range(len(self.network.nodes)), start, now)
            return
        lost = [index for text in texts for index, _ in self._atoms.get(text, ())]
        self._forget(self.network.cone(lost), start, now)

    def _forget(self, indices: Iterable[int], start: int, now: int) -> None:
        """The nodes ``indices`` may have had any inputs in ``[start, now]``; a step is to follow."""
        reached = set(indices)
        for program, best in ((self.best, True), (self.worst, False)):
            raw = read_state(self.network, program)
            for index in raw:
                if index in reached:
                    node, upper = self.network.nodes[index], self._grows[index] == best
                    raw[index] = forget(node, raw[index], start, now, self._began, upper)
            self._rewrite(program, raw, now)

    def not_yet(self, texts: Container[str], now: int) -> None:
        """What was unknown of the predicates ``texts`` until ``now`` is that they had no value.

        Then nothing that rests on them alone has happened by that. A step is to follow.
        """
        nodes = self.network.nodes
        settled: set[int] = set()
        for index, node in enumerate(nodes):
            is_atom = node.kind == "atom"
            if node.text[1:] in texts if is_atom else all(item in settled for item in node.inputs):
                settled.add(index)
        raws = [read_state(self.network, program) for program in (self.best, self.worst)]
        least = {index: raws[self._grows[index]][index] for index in raws[0] if index in settled}
        for program, raw in zip((self.best, self.worst), raws, strict=True):
            self._rewrite(program, raw | least, now)

    def _rewrite(
        self, program: CompiledNetwork, raw: Mapping[int, Sequence[Any]], now: int
    ) -> None:
        """Put raw variables into ``program``; what else is due there stays."""
        ends = [due for due in program.heap if due[1] in self._pulses or due[1] == BEGINNING]
        write_state(self.network, program, raw, now)
        program.heap.extend(ends)
        heapify(program.heap)

    def observe(
        self,
        now: int,
        values: Mapping[str, bool | None],
        held: Container[str] = (),
        missing: bool = False,
        opened: Collection[str] = (),
    ) -> None:
        """Bring everything to ``now`` with the given predicates at new values (None: unknown).

        Args:
            now: the instant.
            values: the new values.
            held: events that stay what they are, until a value is given, rather than for one tick.
            missing: something was observed, and a message of the same instant may have been lost.
            opened: the predicates that such a message may have set at this instant, not before.
        """
        before = missing or self.best.clock() == now
        due: set[int] = set()
        for program in (self.best, self.worst):
            program.settle(now - 1)
            due.update(cause for instant, cause in program.heap if instant == now)
        for program in (self.best, self.worst):
            program.before(now)
        due.discard(BEGINNING)
        if missing and due:
            due.update(index for text in opened for index, _ in self._atoms.get(text, ()))
            reached = set(self.network.cone(due))
            nodes = self.network.nodes
            after = [i for i in reached if any(item in reached for item in nodes[i].inputs)]
            self._forget(after, now, now)
        elif missing and opened:
            for text in opened:
                self._set(text, None, now, text in held)
            self.step(now)
        if before:
            # what ends at the instant at which it began has lasted for a tick: it may have begun now
            for program, best in ((self.best, True), (self.worst, False)):
                upper, lower = self._spells[best], self._spells[not best]
                spells = {**dict.fromkeys(upper, now), **dict.fromkeys(lower, now - 1)}
                program.write({**spells, "again": now})
        for text, value in values.items():
            self._set(text, value, now, text in held)
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

    def _set(self, text: str, value: bool | None, now: int, held: bool) -> None:
        pulse = text in self._events and value is not False and not held
        for index, helps in self._atoms.get(text, ()):
            for program, best in ((self.best, True), (self.worst, False)):
                program.put[index](helps == best if value is None else value)
                if held:
                    program.heap[:] = [due for due in program.heap if due[1] != index]
                    heapify(program.heap)
                elif pulse:
                    heappush(program.heap, (now + 1, index))

    @property
    def met(self) -> int:
        """The last instant that was due when something was observed."""
        met: int = max(program.read()["met"] for program in (self.best, self.worst))
        return met

    def next_deadline(self) -> int:
        """The earliest instant at which something changes by itself."""
        return min(self.best.heap[0][0], self.worst.heap[0][0])

    def results(self) -> list[bool | None]:
        """Per formula: true, false, or None where best and worst differ."""
        return [
            best if best == worst else None
            for best, worst in zip(self.best.values(), self.worst.values(), strict=True)
        ]

    def atoms(self) -> dict[str, bool] | None:
        """The predicates' values, if all are known."""
        best, worst = self.best.read(), self.worst.read()
        found: dict[str, bool] = {}
        for text, places in self._atoms.items():
            values = {run[f"p{index}"] for index, _ in places for run in (best, worst)}
            if len(values) > 1:
                return None
            found[text] = values.pop()
        return found

    def resolved(self, now: int) -> dict[int, tuple[Any, ...]] | None:
        """The plain network's states, if nothing is unknown any more, nor rests on what was."""
        if self.unknown:
            return None
        best, worst = self.best.read(), self.worst.read()
        again = best["again"] == now
        states: dict[int, tuple[Any, ...]] = {}
        forms: dict[int, tuple[Any, ...]] = {}
        for place, (image, node, names) in enumerate(self._remembering):
            values = tuple(best[name] for name in names)
            form = normal(node, values, now)
            others = normal(node, tuple(worst[name] for name in names), now)
            # of what is true since this very instant a run may not know whether it was before
            since_now = again and node.interval.upper is not None and _begins(form, others)
            if since_now or form != others or forms.setdefault(image, form) != form:
                # where the runs differ they mostly still do the next time: looked at first then
                self._remembering.insert(0, self._remembering.pop(place))
                return None
            states[image] = values
        return states if len(states) == self._wanted else None


def _begins(*forms: tuple[Any, ...]) -> bool:
    """Whether a node's input is true since this very instant, by one of the node's normal forms."""
    # open or not, then perhaps what was waited for, then whether it began just now
    return any(form[0] and True in form[1:3] for form in forms)


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
    builder = NetworkBuilder()
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


class Gaps:
    """Which ports may have any value, and until when: losses reported and not wholly passed, by port.

    They may be reported in any order and may overlap; a port is open until the last of those that have
    begun has ended.
    """

    def __init__(self) -> None:
        self.coming: list[Gap] = []
        """Those that have not begun, in order."""
        self.open: dict[str, tuple[int, str]] = {}
        """Per port that a lost message may set now: the instant from which on none does, and why."""

    def add(self, ports: Iterable[str], start: int, end: int, reason: str) -> None:
        """Messages stamped in ``[start, end)`` that would have set one of ``ports`` were lost."""
        for port in ports:
            insort(self.coming, (start, end, port, reason))

    @property
    def next_ns(self) -> int:
        """The earliest instant at which one begins or ends, or ``NEVER``."""
        begins = self.coming[0][0] if self.coming else NEVER
        return min(begins, *(end for end, _ in self.open.values())) if self.open else begins

    @property
    def is_empty(self) -> bool:
        """Whether none is left."""
        return not (self.coming or self.open)

    def pass_to(self, now: int) -> tuple[dict[str, str], list[str]]:
        """The time is ``now``: the ports of the gaps that began (with the reason), and those closed."""
        begun: dict[str, str] = {}
        count = 0
        for start, end, port, reason in self.coming:
            if start > now:
                break
            count += 1
            begun[port] = reason
            if port not in self.open or self.open[port][0] < end:
                self.open[port] = (end, reason)
        del self.coming[:count]
        closed = [port for port, (end, _) in self.open.items() if end <= now]
        for port in closed:
            del self.open[port]
        return begun, closed
