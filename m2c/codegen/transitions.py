"""Transitions to Python: which is taken on an event, what leaving and entering a state does."""

from __future__ import annotations

from collections.abc import Set

from m2c.codegen.context import MachineContext
from m2c.codegen.layout import INDENT, indent
from m2c.codegen.ports import EventPort
from m2c.codegen.statements import StatementWriter
from m2c.model.datatypes import DataType
from m2c.model.machine import Event, EventKind, Raise, State, Target, Transition
from m2c.model.scopes import event_parts
from m2c.model.walk import statements_of

MAX_EVENTLESS_STEPS = 1000
"""Eventless transitions in one macrostep before it is called an endless loop."""


class TransitionWriter:
    """Writes what one machine does between states."""

    def __init__(self, context: MachineContext, statements: StatementWriter) -> None:
        self._context = context
        self._statements = statements
        self._has_eventless = any(
            transition.event is None
            for state in context.machine.states
            for transition in state.transitions
        )

    def dispatch(
        self, events: list[Event], port: EventPort | None, says: bool = False
    ) -> list[str]:
        """What each state does on any of ``events``: the first enabled transition is taken.

        Args:
            events: of one method.
            port: that method, unless it takes events by name.
            says: the method returns whether a transition was taken.
        """
        branches: dict[tuple[str, ...], list[str]] = {}
        for state in self._context.machine.states:
            found = [transition for transition in state.transitions if transition.event in events]
            if not found:
                continue
            inner: list[str] = []
            for transition in found:
                inner += self.transition(state, transition, port)
                if transition.cond is None and port is not None:
                    break
            branches.setdefault(tuple(inner), []).append(self._context.state_text(state.name))
        if says:
            return [*_chain(branches, "if", "return True"), "return False"]
        branches.pop(("return",), None)  # what is taken and does nothing needs no code
        return _without_final_returns(_chain(branches, "elif", "return"))

    def transition(self, state: State, transition: Transition, port: EventPort | None) -> list[str]:
        """Lines that test and take ``transition``; they end in ``return`` where it is taken."""
        parts = event_parts(transition.event, self._context.machine, self._context.library)
        data_name = port.data_name if port is not None else "data"
        compiler = self._context.compiler(parts, data_name)
        tests: list[str] = []
        event = transition.event
        if event is not None and port is None:
            tests.append(_event_test(event, self._event_names()))
        if transition.cond is not None:
            test = compiler.condition(transition.cond)
            if compiler.may_fail:
                test = f"self._holds(lambda: {test})"
            tests.append(test)
        body = self._taken(state, transition, parts, data_name)
        if not tests:
            return body
        text = (
            tests[0]
            if len(tests) == 1
            else " and ".join(
                f"({test})" if " or " in test or " if " in test else test for test in tests
            )
        )
        return [f"if {text}:", *indent(body)]

    def _taken(
        self, state: State, transition: Transition, parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        lines: list[str] = []
        leaves = bool(transition.targets)
        if leaves and self._has_exit(state):
            lines.append(f"self._leave_{self._context.method_part(state)}()")
        lines += self._statements.block(transition.body, parts, data_name)
        if len(transition.targets) > 1:
            lines += self._choice(state, transition.targets, parts, data_name)
        else:
            for target in transition.targets:
                lines += self._arrive(state, target, parts, data_name)
            if not transition.targets:
                lines += self.settle_call(state)
        return [*lines, "return"]

    def _event_names(self) -> Set[str]:
        """Names of the events that the machine can send to itself, errors included."""
        sent = {
            item.event for item in statements_of(self._context.machine) if isinstance(item, Raise)
        }
        return sent | {"error.execution"}

    def _choice(
        self, state: State, targets: tuple[Target, ...], parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        lines = ["draw = self._random()"]
        bound = 0.0
        for index, target in enumerate(targets):
            bound += target.probability or 0.0
            if index == len(targets) - 1:
                lines.append("else:")
            else:
                lines.append(f"{'if' if index == 0 else 'elif'} draw < {round(bound, 12)!r}:")
            lines += indent(self._arrive(state, target, parts, data_name) or ["pass"])
        return lines

    def _arrive(
        self, source: State, target: Target, parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        state = self._context.machine.state(target.state)
        body = self._statements.block(target.body, parts, data_name)
        entering = self.enter(state)
        assignment = f"self.state = {self._context.state_text(state.name)}"
        if source.name == state.name and entering == [assignment]:
            entering = []
        return [*body, *entering, *self.settle_call(state)]

    def enter(self, state: State) -> list[str]:
        """Lines that enter ``state``."""
        if self._has_entry(state):
            return [f"self._enter_{self._context.method_part(state)}()"]
        return [f"self.state = {self._context.state_text(state.name)}"]

    def settle_call(self, state: State) -> list[str]:
        """The call that follows the arrival in ``state``, if something may be enabled there."""
        eventless = any(transition.event is None for transition in state.transitions)
        return ["self._settle()"] if eventless or self._context.raises else []

    @property
    def needs_settling(self) -> bool:
        """Whether eventless transitions or internal events may follow an event."""
        return self._has_eventless or self._context.raises

    def settle_method(self) -> list[str]:
        """``_settle``: eventless transitions and internal events, until none is enabled."""
        what = [
            *(["eventless transitions"] if self._has_eventless else []),
            *(["internal events"] if self._context.raises else []),
        ]
        lines = [
            "",
            f"{INDENT}def _settle(self) -> None:",
            f'{INDENT * 2}"""Take {" and ".join(what)} until none is enabled."""',
            f"{INDENT * 2}for _ in range({MAX_EVENTLESS_STEPS}):",
        ]
        for state in self._context.machine.states:
            found = [transition for transition in state.transitions if transition.event is None]
            if not found:
                continue
            inner: list[str] = []
            for transition in found:
                body = self.transition(state, transition, None)
                inner += [_continue_instead(line) for line in body]
                if transition.cond is None:
                    break
            inner = [line for line in inner if line.strip() != "self._settle()"]
            lines.append(f"{INDENT * 3}if self.state is {self._context.state_text(state.name)}:")
            lines += indent(inner, 4)
        if self._context.raises:
            lines.append(f"{INDENT * 3}if self._internal:")
            lines.append(f"{INDENT * 4}self.on_event(*self._internal.popleft())")
            lines.append(f"{INDENT * 4}continue")
        lines.append(f"{INDENT * 3}return")
        lines.append(f"{INDENT * 2}raise EndlessLoopError(self.state.value)")
        return lines

    def _delays(self, state: State) -> list[Transition]:
        return [item for item in state.transitions if item.after_s is not None]

    def _has_entry(self, state: State) -> bool:
        return bool(state.on_entry or self._delays(state) or state.final)

    def _has_exit(self, state: State) -> bool:
        return bool(state.on_exit or self._delays(state))

    def entry_method(self, state: State) -> list[str]:
        """``_enter_…`` of a state that does something on entry."""
        if not self._has_entry(state):
            return []
        name = self._context.method_part(state)
        body = [f"self.state = {self._context.state_text(state.name)}"]
        for transition in self._delays(state):
            assert transition.event is not None
            body.append(
                f'self._outputs.start_delay("{transition.event.name}", {transition.after_s!r})'
            )
        body += self._statements.block(state.on_entry, {}, "data")
        if state.final:
            body.append('self._outputs.log("", "the machine has reached its final state")')
        return ["", f"{INDENT}def _enter_{name}(self) -> None:", *indent(body, 2)]

    def exit_method(self, state: State) -> list[str]:
        """``_leave_…`` of a state that does something on exit."""
        if not self._has_exit(state):
            return []
        name = self._context.method_part(state)
        body = self._statements.block(state.on_exit, {}, "data")
        for transition in self._delays(state):
            assert transition.event is not None
            body.append(f'self._outputs.stop_delay("{transition.event.name}")')
        return ["", f"{INDENT}def _leave_{name}(self) -> None:", *indent(body, 2)]


def _event_test(event: Event, names: Set[str]) -> str:
    """The condition under which one of the events ``names`` is ``event``."""
    if event.kind is EventKind.AFTER:
        return f'delay == "{event.name}"'
    name = event.name
    if name == "*":
        return "True"
    prefix = name.removesuffix("*").removesuffix(".")
    longer = any(other.startswith(f"{prefix}.") for other in names)
    return f'matches(name, "{prefix}")' if longer or not prefix else f'name == "{prefix}"'


def _continue_instead(line: str) -> str:
    return line.replace("return", "continue") if line.strip() == "return" else line


def _chain(branches: dict[tuple[str, ...], list[str]], word: str, end: str) -> list[str]:
    """One branch per behaviour, for every state that has it; ``word`` begins all but the first."""
    lines: list[str] = []
    for body, states in branches.items():
        test = f"is {states[0]}" if len(states) == 1 else f"in ({', '.join(states)})"
        lines.append(f"{word if lines else 'if'} self.state {test}:")
        lines += indent(
            [line.replace("return", end) if _is_return(line) else line for line in body]
        )
    return lines


def _is_return(line: str) -> bool:
    return line.strip() == "return"


def _depth(line: str) -> int:
    return len(line) - len(line.lstrip())


def _without_final_returns(lines: list[str]) -> list[str]:
    """Drop every ``return`` after which nothing would run anyway."""
    kept: list[str] = []
    for index, line in enumerate(lines):
        if not (_is_return(line) and _is_final(lines[index + 1 :], _depth(line))):
            kept.append(line)
        elif kept and _depth(kept[-1]) < _depth(line):
            kept.append(line.replace("return", "pass"))
    return kept


def _is_final(following: list[str], depth: int) -> bool:
    """Whether only other branches follow a line that stands so deep."""
    for line in following:
        if _depth(line) > depth:
            continue
        if not line.lstrip().startswith(("elif ", "else:", "except ")):
            return False
        depth = _depth(line)
    return True
