"""The one thing that a machine can have done, where there is only one: nothing has to be searched then."""

from __future__ import annotations

from typing import Any

from m2c.model.machine import EventKind, OutputKind
from m2c.model.scopes import interface_kind_of
from moon.oracle.calls import Call
from moon.oracle.channels import Channels
from moon.oracle.outputs import Outputs
from moon.oracle.program import Program
from moon.oracle.state import Hypothesis, Obligation
from moon.oracle.steps import Step
from moon.oracle.successors import Occasion, Successors
from moon.oracle.trace_events import Role, TraceEvent

_INPUTS = (EventKind.REQUEST, EventKind.RESPONSE, EventKind.CALL_ERROR, EventKind.MESSAGE)
_PLAIN = (OutputKind.PUBLISH, OutputKind.REQUEST, OutputKind.RESPONSE)
_OUTPUT, _INPUT, _REQUEST, _RESPONSE = (  # looked up for every observation
    Role.OUTPUT,
    Role.INPUT,
    EventKind.REQUEST,
    OutputKind.RESPONSE,
)


class Effect:
    """What a step comes to, wherever it is taken.

    Attributes:
        data: the datamodel after it.
        owed: for each output ``(kind, interface, fields, position, transition)``.
        answers: the interface of the one response among them; "" if there is none.
    """

    __slots__ = ("answers", "data", "owed")

    def __init__(self, data: tuple[Any, ...], owed: tuple[Any, ...], answers: str) -> None:
        self.data = data
        self.owed = owed
        self.answers = answers


class DeterministicSuccessor:
    """The one successor of a hypothesis, where there is one; it comes to the same as the search.

    Args:
        successors: the machine's steps.
        outputs: what it sent.
        program: the machine.
        channels: its channels.
    """

    def __init__(
        self, successors: Successors, outputs: Outputs, program: Program, channels: Channels
    ) -> None:
        self._successors = successors
        self._outputs = outputs
        self._program = program
        self._main = program.parts[0]
        self._certain = program.certain
        self._channels = channels

    def of(self, hypothesis: Hypothesis, fact: TraceEvent) -> Hypothesis | None:
        """What ``hypothesis`` is after ``fact``, where that is one thing and plain to see.

        That is so for an input or an output stamped where it was taken or made, while nothing else can
        have been taken since. ``hypothesis`` itself is changed, as a rule: nobody else may hold it.

        Returns:
            None where the search has to be asked.
        """
        owed = hypothesis.owed
        if (
            hypothesis.pending
            or hypothesis.queue
            or hypothesis.goals
            or hypothesis.free
            or hypothesis.vague
            or not self._certain
            or self._successors.may_fail(hypothesis)
        ):
            return None
        if fact.role is _OUTPUT:
            if not owed or owed[0].optional or not self._outputs.is_owed(hypothesis, owed[0], fact):
                return None
            if self._outputs.slept(hypothesis, owed[0].timer, fact.stamp) is not None:
                return None
            if owed[0].timer is not None or fact.output not in _PLAIN:
                return self._outputs.fulfilled(hypothesis, 0, fact)
            hypothesis.owed = owed[1:]
            hypothesis.forget_key()
            return hypothesis
        event = fact.event
        if owed or fact.role is not _INPUT or event is None or event[0] not in _INPUTS:
            return None
        if len(self._program.takers_of(event)) > 1:
            return None
        stamp = fact.stamp
        if hypothesis.timers:
            if not self._successors.is_still(hypothesis, stamp):
                return None
            hypothesis = self._successors.normalised(hypothesis, stamp)
        state, data = hypothesis.instances[0]
        ((taken, step),) = self._main.take(state, data, event, fact.data, {}, False)
        asked = event[0] is _REQUEST
        if not taken and step.transition is None:
            return hypothesis  # a request that the state discards is never answered
        if not taken and asked:
            return None
        return self._affected(hypothesis, step, fact, fact.call if asked else None)

    def _affected(
        self, hypothesis: Hypothesis, step: Step, fact: TraceEvent, call: Call | None
    ) -> Hypothesis:
        """``hypothesis`` after ``step``, which ``fact`` caused; ``call``: if it is a request."""
        stamp, waiting = fact.stamp, hypothesis.waiting
        if call is not None:
            waiting = (*waiting, (fact.interface, call))
        effect = step.effect
        if effect is None:
            effect = step.effect = self._effect(step)
        answered = None
        if effect is not False and effect.answers and call is None:
            answered = next((item for item in waiting if item[0] == effect.answers), None)
        elif effect is not False and effect.answers == fact.interface and call is not None:
            answered = waiting[-1]
        if (
            effect is False
            or hypothesis.timers
            or len(hypothesis.instances) > 1
            or (effect.answers and answered is None)
        ):
            when = Occasion(stamp, stamp, call=call)
            return self._successors.absorb(hypothesis, 0, step, when, waiting)
        if answered is not None:
            place = waiting.index(answered)
            waiting = waiting[:place] + waiting[place + 1 :]
        made = []
        for kind, interface, fields, position, transition in effect.owed:
            answers = answered[1] if answered and kind is _RESPONSE else None
            owed = Obligation(kind, interface, fields, stamp, stamp, position, transition, answers)
            owed.before = (hypothesis.instances,)
            made.append(owed)
        hypothesis.instances = ((step.state, effect.data),)
        hypothesis.owed = tuple(made)
        hypothesis.waiting = waiting
        if stamp > hypothesis.moment:
            hypothesis.moment = stamp
        hypothesis.forget_key()
        return hypothesis

    def _effect(self, step: Step) -> Effect | bool:
        """What ``step`` comes to; False where that depends on more than requests that wait."""
        kinds = [output.kind for output in step.outputs]
        if step.scheduled or any(kind not in _PLAIN for kind in kinds):
            return False
        if kinds.count(OutputKind.RESPONSE) > 1:
            return False
        owed = []
        answers = ""
        for output in step.outputs:
            kind, interface = output.kind, output.interface
            side = interface_kind_of(kind)
            if self._program.declared_channel(kind, interface) is None:
                return False
            if kind is OutputKind.RESPONSE:
                answers = interface
            elif side is not None:
                interface = self._channels.name_of(side, interface)
            owed.append((kind, interface, output.fields, output.position, output.transition))
        return Effect(tuple(step.data), tuple(owed), answers)
