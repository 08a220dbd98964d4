"""Places in a machine where one thing can be changed, each with the way to put a changed thing back.

A machine is a frozen tree. A :class:`Place` is a part of it (a transition, a block of statements, a
condition) together with ``put``: the whole machine with another part in its stead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from msgspec.structs import replace

from m2c.language.expressions import (
    ArrayFrom,
    ArrayLiteral,
    Binary,
    Conditional,
    Expression,
    Index,
    Logical,
    MathCall,
    Member,
    ObjectLiteral,
    Unary,
)
from m2c.model.machine import (
    Assign,
    Emit,
    Foreach,
    History,
    If,
    Machine,
    State,
    Statement,
    Transition,
)
from m2c.model.machine import Block as Nested
from m2c.model.nesting import lowered

Part = TypeVar("Part")
Block = tuple[Statement, ...]


class Place(Generic[Part]):
    """One part of a machine.

    Args:
        part: what stands there.
        put: the machine with its argument there instead; never changes the original.
    """

    __slots__ = ("part", "put")

    def __init__(self, part: Part, put: Callable[[Part], Machine]) -> None:
        self.part = part
        self.put = put


def machines(machine: Machine) -> Iterator[Place[Machine]]:
    """``machine`` itself and its action threads' machines, each put back into the whole."""
    yield Place(machine, lambda new: new)
    for index, thread in enumerate(machine.threads):

        def put(new: Machine, index: int = index) -> Machine:
            changed = replace(machine.threads[index], machine=new)
            return replace(machine, threads=swapped(machine.threads, index, changed))

        yield Place(thread.machine, put)


def flat(machine: Machine) -> Machine:
    """``machine`` and its action threads as they run: without the states that they were lowered from."""
    threads = tuple(replace(item, machine=flat(item.machine)) for item in machine.threads)
    return replace(machine, tree=(), starts_in="", threads=threads)


def states(machine: Machine) -> Iterator[Place[State]]:
    """The states as they were written, in document order; the machine is lowered again with another one."""

    def put(new: tuple[State, ...]) -> Machine:
        if not machine.tree:
            return replace(machine, states=new)
        return lowered(replace(machine, tree=new))

    yield from _states(machine.written, put)


def _states(
    found: tuple[State, ...], put: Callable[[tuple[State, ...]], Machine]
) -> Iterator[Place[State]]:
    for index, state in enumerate(found):

        def put_state(new: State, index: int = index) -> Machine:
            return put(swapped(found, index, new))

        def put_inner(
            new: tuple[State, ...],
            state: State = state,
            put_state: Callable[[State], Machine] = put_state,
        ) -> Machine:
            return put_state(replace(state, states=new))

        yield Place(state, put_state)
        yield from _states(state.states, put_inner)


def ways(machine: Machine) -> Iterator[tuple[State, History | None, Place[Transition]]]:
    """What leads into each compound state: its initial transition, and the default one of each history."""
    for place in states(machine):
        state = place.part
        if state.initial is not None:

            def put_initial(new: Transition, place: Place[State] = place) -> Machine:
                return place.put(replace(place.part, initial=new))

            yield state, None, Place(state.initial, put_initial)
        for index, history in enumerate(state.histories):

            def put_default(
                new: Transition,
                index: int = index,
                history: History = history,
                place: Place[State] = place,
            ) -> Machine:
                changed = replace(history, default=new)
                histories = swapped(place.part.histories, index, changed)
                return place.put(replace(place.part, histories=histories))

            yield state, history, Place(history.default, put_default)


def transitions(machine: Machine) -> Iterator[tuple[State, Place[Transition]]]:
    """The transitions, in document order, each with its state."""
    for place in states(machine):
        for index, transition in enumerate(place.part.transitions):

            def put(new: Transition, index: int = index, place: Place[State] = place) -> Machine:
                changed = swapped(place.part.transitions, index, new)
                return place.put(replace(place.part, transitions=changed))

            yield place.part, Place(transition, put)


def blocks(machine: Machine) -> Iterator[Place[Block]]:
    """Every sequence of statements: of entry, exit, transitions, targets, and inside ``<if>``.

    Of a machine without its tree (:func:`flat`), what is done before its first state is entered, too.
    """
    for outer in _outer_blocks(machine):
        yield from _with_inner(outer)


def _outer_blocks(machine: Machine) -> Iterator[Place[Block]]:
    if not machine.tree:
        yield Place(machine.on_start, lambda new: replace(machine, on_start=new))
    for place in states(machine):
        state = place.part

        def put_entry(new: Block, place: Place[State] = place) -> Machine:
            return place.put(replace(place.part, on_entry=new))

        def put_exit(new: Block, place: Place[State] = place) -> Machine:
            return place.put(replace(place.part, on_exit=new))

        yield Place(state.on_entry, put_entry)
        yield Place(state.on_exit, put_exit)
    into = [place for _, _, place in ways(machine)]
    for transition in (*(place for _, place in transitions(machine)), *into):

        def put_body(new: Block, place: Place[Transition] = transition) -> Machine:
            return place.put(replace(place.part, body=new))

        yield Place(transition.part.body, put_body)
        for index, target in enumerate(transition.part.targets):

            def put_target(
                new: Block, index: int = index, place: Place[Transition] = transition
            ) -> Machine:
                targets = place.part.targets
                changed = swapped(targets, index, replace(targets[index], body=new))
                return place.put(replace(place.part, targets=changed))

            yield Place(target.body, put_target)


def _with_inner(place: Place[Block]) -> Iterator[Place[Block]]:
    yield place
    for index, statement in enumerate(place.part):
        if isinstance(statement, Nested | Foreach):

            def put_body(
                new: Block, index: int = index, statement: Nested | Foreach = statement
            ) -> Machine:
                return place.put(swapped(place.part, index, replace(statement, body=new)))

            yield from _with_inner(Place(statement.body, put_body))
        if not isinstance(statement, If):
            continue
        for number, (test, body) in enumerate(statement.branches):

            def put(
                new: Block,
                index: int = index,
                number: int = number,
                statement: If = statement,
                test: Expression | None = test,
            ) -> Machine:
                branches = swapped(statement.branches, number, (test, new))
                changed = replace(statement, branches=branches)
                return place.put(swapped(place.part, index, changed))

            yield from _with_inner(Place(body, put))


def conditions(machine: Machine) -> Iterator[Place[Expression]]:
    """What decides: conditions of transitions and of ``<if>``, and tests of ``?:``."""
    for _, transition in transitions(machine):
        if transition.part.cond is not None:

            def put_cond(new: Expression, place: Place[Transition] = transition) -> Machine:
                return place.put(replace(place.part, cond=new))

            yield Place(transition.part.cond, put_cond)
    for place in blocks(machine):
        for index, statement in enumerate(place.part):
            if isinstance(statement, If):
                yield from _branch_tests(place, index, statement)
    for value in values(machine):
        for inner, put in _expressions(value.part, value.put):
            if isinstance(inner, Conditional):

                def put_test(
                    new: Expression,
                    inner: Conditional = inner,
                    put: Callable[[Expression], Machine] = put,
                ) -> Machine:
                    return put(replace(inner, test=new))

                yield Place(inner.test, put_test)


def _branch_tests(place: Place[Block], index: int, statement: If) -> Iterator[Place[Expression]]:
    for number, (test, body) in enumerate(statement.branches):
        if test is None:
            continue

        def put(new: Expression, number: int = number, body: Block = body) -> Machine:
            changed = replace(statement, branches=swapped(statement.branches, number, (new, body)))
            return place.put(swapped(place.part, index, changed))

        yield Place(test, put)


def values(machine: Machine) -> Iterator[Place[Expression]]:
    """The values that are assigned or sent."""
    for place in blocks(machine):
        for index, statement in enumerate(place.part):
            if isinstance(statement, Assign):

                def put_value(
                    new: Expression,
                    index: int = index,
                    statement: Assign = statement,
                    place: Place[Block] = place,
                ) -> Machine:
                    return place.put(swapped(place.part, index, replace(statement, value=new)))

                yield Place(statement.value, put_value)
    yield from (field for _, field in sent_values(machine))


def sent_values(machine: Machine) -> Iterator[tuple[str, Place[Expression]]]:
    """The value of every field of every output, with the field's name."""
    for place in blocks(machine):
        for index, statement in enumerate(place.part):
            if not isinstance(statement, Emit):
                continue
            for number, field in enumerate(statement.fields):

                def put(
                    new: Expression,
                    index: int = index,
                    number: int = number,
                    statement: Emit = statement,
                    place: Place[Block] = place,
                ) -> Machine:
                    changed = replace(statement.fields[number], value=new)
                    fields = swapped(statement.fields, number, changed)
                    return place.put(swapped(place.part, index, replace(statement, fields=fields)))

                yield field.name, Place(field.value, put)


def parts_of(place: Place[Expression]) -> Iterator[Place[Expression]]:
    """``place``'s expression and every expression inside it, outermost first."""
    for inner, put in _expressions(place.part, place.put):
        yield Place(inner, put)


def _expressions(
    expression: Expression, put: Callable[[Expression], Machine]
) -> Iterator[tuple[Expression, Callable[[Expression], Machine]]]:
    yield expression, put
    for child, rebuild in _children(expression):

        def put_child(
            new: Expression, rebuild: Callable[[Expression], Expression] = rebuild
        ) -> Machine:
            return put(rebuild(new))

        yield from _expressions(child, put_child)


def _children(
    node: Expression,
) -> Iterator[tuple[Expression, Callable[[Expression], Expression]]]:
    match node:
        case Member():
            yield node.object, lambda new: replace(node, object=new)
        case Index():
            yield node.object, lambda new: replace(node, object=new)
            yield node.index, lambda new: replace(node, index=new)
        case Unary():
            yield node.operand, lambda new: replace(node, operand=new)
        case Binary() | Logical():
            yield node.left, lambda new: replace(node, left=new)
            yield node.right, lambda new: replace(node, right=new)
        case Conditional():
            yield node.test, lambda new: replace(node, test=new)
            yield node.then, lambda new: replace(node, then=new)
            yield node.otherwise, lambda new: replace(node, otherwise=new)
        case MathCall():
            for index, argument in enumerate(node.arguments):
                yield argument, _nth(node, "arguments", node.arguments, index)
        case ArrayLiteral():
            for index, element in enumerate(node.elements):
                yield element, _nth(node, "elements", node.elements, index)
        case ArrayFrom():
            yield node.length, lambda new: replace(node, length=new)
            yield node.item, lambda new: replace(node, item=new)
        case ObjectLiteral():
            for index, (key, value) in enumerate(node.entries):
                yield value, _entry(node, key, index)


def _nth(
    node: Expression, attribute: str, items: tuple[Expression, ...], index: int
) -> Callable[[Expression], Expression]:
    return lambda new: replace(node, **{attribute: swapped(items, index, new)})


def _entry(node: ObjectLiteral, key: str, index: int) -> Callable[[Expression], Expression]:
    return lambda new: replace(node, entries=swapped(node.entries, index, (key, new)))


Item = TypeVar("Item")


def swapped(items: tuple[Item, ...], index: int, new: Item) -> tuple[Item, ...]:
    """``items`` with ``new`` in place of the one at ``index``."""
    return (*items[:index], new, *items[index + 1 :])


def without(items: tuple[Item, ...], index: int) -> tuple[Item, ...]:
    """``items`` without the one at ``index``."""
    return (*items[:index], *items[index + 1 :])
