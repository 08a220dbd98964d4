"""Compound states and history, lowered into a flat machine.

Each atomic or final state of the tree is a state of the flat machine, called by its path (``moving/fast``).
It has the transitions of the states around it after its own (W3C SCXML 3.13, appendix D, selectTransitions);
what a transition exits and enters besides the two atomic states is content of it, in W3C's order: blocks
whose name says what they do, which are equal wherever they stand. A history is a variable with the path of
the state that was active last; a transition whose way depends on it is one for each of its values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

import msgspec

from m2c.diagnostics import Position
from m2c.language.expressions import Binary, Expression, InState, Literal, Logical, Variable, nodes
from m2c.language.macrostep import matches, prefix_of
from m2c.model.machine import (
    Assign,
    Block,
    Delay,
    EventKind,
    History,
    Machine,
    Raise,
    State,
    Statement,
    Target,
    Transition,
)
from m2c.model.walk import delays_of, expressions_in, rewritten

MAX_TRANSITIONS = 20_000
"""Transitions of a flat machine, those of compound states counted for each state in them."""

_Found = TypeVar("_Found")


class TooLargeError(Exception):
    """The flat machine would have more than ``MAX_TRANSITIONS`` transitions."""


def lowered(machine: Machine, most: float = float("inf")) -> Machine:
    """``machine`` with flat ``states`` made of its ``tree``; itself if it has none.

    Raises:
        TooLargeError: it would have more than ``most`` transitions.
    """
    return _Lowering(machine, most).machine() if machine.tree else machine


def with_written(machine: Machine, change: Callable[[State], State]) -> Machine:
    """``machine`` with its states as ``change`` makes them of those that were written."""
    states = tuple(map(change, machine.written))
    if not machine.tree:
        return msgspec.structs.replace(machine, states=states)
    return lowered(msgspec.structs.replace(machine, tree=states))


def asked_states(states: Iterable[State]) -> Iterator[InState]:
    """Every ``In('state')`` of ``states``."""
    for whole in expressions_in(states):
        yield from (part for part in nodes(whole) if isinstance(part, InState))


class _Node:
    """A state in the tree; ``state`` is None for the machine itself."""

    def __init__(self, state: State | None, parent: _Node | None) -> None:
        self.state = state
        self.parent = parent
        self.around: tuple[_Node, ...] = () if parent is None else (parent, *parent.around)
        """What it stands in, from the inside out; the machine is the last."""
        inside = [] if parent is None or state is None else [parent.path, state.name]
        self.path: str = "/".join(filter(None, inside))

    @property
    def chain(self) -> tuple[_Node, ...]:
        """It and what it stands in, from the inside out."""
        return (self, *self.around)

    def is_in(self, other: _Node) -> bool:
        return other in self.around


_Last = Callable[[History], _Node | None]
"""The state that a history remembers; None: none yet."""


class _Open(Exception):
    """The way depends on what ``history`` remembers."""

    def __init__(self, history: History) -> None:
        super().__init__(history.name)
        self.history = history


class _Lowering:
    def __init__(self, machine: Machine, most: float) -> None:
        self._machine = machine
        self._most = most
        self._count = 0
        self._nodes: dict[str, _Node] = {}
        self._histories: dict[str, tuple[History, _Node]] = {}
        self._root = _Node(None, None)
        self._leaves: list[_Node] = []
        self._paths: set[str] = set()
        self._grow(machine.tree, self._root)
        self._blocks: dict[str, Block] = {}
        self._asks = any(asked_states(machine.tree))
        self._taken = [
            prefix_of(item.event.name)
            for node in self._nodes.values()
            for item in _of(node).transitions
            if item.event is not None and item.event.kind is EventKind.INTERNAL
        ]
        self._tests = any(
            item.event is None and item.cond is not None
            for node in self._nodes.values()
            for item in _of(node).transitions
        )

    def _grow(self, states: tuple[State, ...], parent: _Node) -> None:
        for state in states:
            node = self._nodes[state.name] = _Node(state, parent)
            while node.path in self._paths:  # an id with a `/`
                node.path += "_"
            self._paths.add(node.path)
            self._histories.update((item.name, (item, node)) for item in state.histories)
            if not state.states:
                self._leaves.append(node)
            self._grow(state.states, node)

    def machine(self) -> Machine:
        starts_in, on_start = self._arrival(self._machine.starts_in, self._root, lambda _: None)
        return msgspec.structs.replace(
            self._machine,
            initial=starts_in.path,
            data=self._settled(self._machine.data, self._root),
            on_start=on_start,
            states=tuple(map(self._leaf, self._leaves)),
        )

    # -- states -------------------------------------------------------------------------------

    def _leaf(self, node: _Node) -> State:
        state = _of(node)
        is_last = state.final and node.parent is self._root
        return State(
            name=node.path,
            position=state.position,
            on_entry=self._settled((*state.on_entry, *self._done(node)), node),
            on_exit=self._settled(state.on_exit, node),
            transitions=tuple(
                made
                for source in node.chain
                if source.state is not None
                for item in source.state.transitions
                for made in self._transitions(item, source, node)
            ),
            final=is_last,
        )

    def _done(self, node: _Node) -> tuple[Statement, ...]:
        """The event that a final state in a compound one raises, if that makes a difference."""
        state = _of(node)
        if not state.final or node.parent is None or node.parent.state is None:
            return ()
        event = f"done.state.{node.parent.state.name}"
        if not self._tests and not any(matches(event, prefix) for prefix in self._taken):
            return ()
        done = Raise(event=event, position=state.position, fields=state.done_data)
        return (Block((done,), state.position),)

    # -- transitions --------------------------------------------------------------------------

    def _transitions(self, item: Transition, source: _Node, leaf: _Node) -> Iterator[Transition]:
        """``item`` of ``source`` as it is taken in ``leaf``: one for each way that it may go."""
        of = "" if source is leaf else source.path
        for known, made in self._outcomes(lambda last: self._way(item, source, leaf, last)):
            self._count += 1
            if self._count > self._most:
                raise TooLargeError
            cond = self._settled(item.cond, leaf)
            for name, node in reversed([*known.items()]):
                cond = _and(self._is_last(name, node, item), cond)
            yield msgspec.structs.replace(made, cond=cond, of=of)

    def _is_last(self, name: str, node: _Node | None, item: Transition) -> Expression:
        """Whether the history ``name`` remembers ``node``."""
        history, _ = self._histories[name]
        at = item.position
        return Binary(
            operator="===",
            left=Variable(name=history.variable, position=at),
            right=Literal(value="" if node is None else node.path, position=at),
            position=at,
        )

    def _outcomes(
        self, find: Callable[[_Last], _Found]
    ) -> Iterator[tuple[Mapping[str, _Node | None], _Found]]:
        """What ``find`` finds for all that the histories which it asks for may remember."""
        pending: list[dict[str, _Node | None]] = [{}]
        while pending:
            known = pending.pop()

            def last(history: History, known: Mapping[str, _Node | None] = known) -> _Node | None:
                if history.name not in known:
                    raise _Open(history)
                return known[history.name]

            try:
                found = find(last)
            except _Open as asked:
                history, parent = self._histories[asked.history.name]
                kept = [None, *self._kept(history, parent)]
                pending += [{**known, history.name: node} for node in reversed(kept)]
            else:
                yield known, found

    def _kept(self, history: History, parent: _Node) -> list[_Node]:
        """What ``history``, which stands in ``parent``, can remember."""
        if history.deep:
            return [leaf for leaf in self._leaves if leaf.is_in(parent)]
        return [self._nodes[state.name] for state in _of(parent).states]

    def _way(self, item: Transition, source: _Node, leaf: _Node, last: _Last) -> Transition:
        """What ``item`` exits, does and enters, taken in ``leaf`` (W3C SCXML, appendix D)."""
        if not item.targets:
            return self._settled(item, leaf)
        domain = self._domain(item, source, last)
        inner = self._settled(item.body, domain)
        exited = [node for node in leaf.around if node.is_in(domain)]
        body: list[Statement] = []
        now: dict[str, _Node] = {}
        for node in exited:
            for history in _of(node).histories:
                if history.variable:
                    kept = leaf if history.deep else _child_of(node, leaf)
                    now[history.name] = kept
                    body.append(_remembered(history, kept))
        for node in exited:
            body += self._exit(node)
        body += [Block(inner, item.position)] if body and inner else inner

        def later(history: History) -> _Node | None:
            return now[history.name] if history.name in now else last(history)

        targets = []
        for target in item.targets:
            to, entered = self._arrival(target.state, domain, later)
            content: tuple[Statement, ...] = self._settled(target.body, domain)
            if entered and content:
                content = (Block(content, item.position),)
            targets.append(Target(to.path, target.probability, (*content, *entered)))
        return msgspec.structs.replace(item, body=tuple(body), targets=tuple(targets))

    def _domain(self, item: Transition, source: _Node, last: _Last) -> _Node:
        """The state that ``item`` does not exit (W3C SCXML, appendix D, getTransitionDomain)."""
        targets = [self._effective(target.state, last) for target in item.targets]
        is_internal = item.internal and bool(_of(source).states)
        if is_internal and all(target.is_in(source) for target in targets):
            return source
        return next(node for node in source.around if all(target.is_in(node) for target in targets))

    def _effective(self, name: str, last: _Last) -> _Node:
        if name not in self._histories:
            return self._nodes[name]
        history, _ = self._histories[name]
        return last(history) or self._effective(history.default.targets[0].state, last)

    def _arrival(
        self, name: str, domain: _Node, last: _Last
    ) -> tuple[_Node, tuple[Statement, ...]]:
        """The atomic state that is entered where ``name`` is, and what enters those around it."""
        content: dict[_Node, list[Block]] = {}
        leaf = self._descend(name, last, content)
        entered = [node for node in reversed(leaf.around) if node.is_in(domain)]
        return leaf, tuple(
            block for node in entered for block in (*self._enter(node), *content.get(node, ()))
        )

    def _descend(self, name: str, last: _Last, content: dict[_Node, list[Block]]) -> _Node:
        """The atomic state that is entered where ``name`` is; ``content`` is done on the way."""
        if name in self._histories:
            history, node = self._histories[name]
            kept = last(history)
            if kept is not None:
                return self._descend(_of(kept).name, last, content)
            way, block = history.default, f"default {node.path}/{name}"
        else:
            node = self._nodes[name]
            initial = _of(node).initial
            if initial is None:
                return node
            way, block = initial, f"initial {node.path}"
        if way.body:
            content.setdefault(node, []).extend(self._named(block, way.body, way.position, node))
        return self._descend(way.targets[0].state, last, content)

    # -- compound states ----------------------------------------------------------------------

    def _enter(self, node: _Node) -> tuple[Block, ...]:
        """What enters the compound state ``node``."""
        state = _of(node)
        delays = tuple(
            Delay(name, delay, state.position) for name, delay in delays_of(state).items()
        )
        body = (*delays, *state.on_entry)
        return self._named(f"enter {node.path}", body, state.position, node)

    def _exit(self, node: _Node) -> tuple[Block, ...]:
        state = _of(node)
        delays = tuple(Delay(name, None, state.position) for name in delays_of(state))
        body = state.on_exit
        if delays and body:
            body = (Block(body, state.position),)
        return self._named(f"exit {node.path}", (*body, *delays), state.position, node)

    def _named(
        self, name: str, body: tuple[Statement, ...], position: Position, node: _Node
    ) -> tuple[Block, ...]:
        if not body:
            return ()
        if name not in self._blocks:
            self._blocks[name] = Block(self._settled(body, node), position, name)
        return (self._blocks[name],)

    def _settled(self, part: _Found, node: _Node) -> _Found:
        """``part`` as it is while ``node`` is active, and nothing in it: ``In`` is true or false."""
        if not self._asks:
            return part
        active = {inner.state.name for inner in node.chain if inner.state is not None}

        def settled(expression: Expression) -> Expression:
            if not isinstance(expression, InState):
                return expression
            return Literal(value=expression.state in active, position=expression.position)

        return rewritten(part, settled)


def _of(node: _Node) -> State:
    assert node.state is not None
    return node.state


def _child_of(node: _Node, leaf: _Node) -> _Node:
    """The state directly in ``node`` that is ``leaf``, or around it."""
    return next(inner for inner in leaf.chain if inner.parent is node)


def _remembered(history: History, kept: _Node) -> Assign:
    at = history.position
    variable = Variable(name=history.variable, position=at)
    return Assign(variable, Literal(value=kept.path, position=at), at)


def _and(test: Expression, cond: Expression | None) -> Expression:
    if cond is None:
        return test
    return Logical(operator="&&", left=test, right=cond, position=cond.position)
