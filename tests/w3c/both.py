"""A generated machine and the oracle's interpreter of the same model, given the same events."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from m2c.codegen.context import MachineContext
from m2c.codegen.ports import PortNames
from m2c.model.machine import EventKind
from m2c.runtime.machine import EndlessLoopError
from moon.oracle.program import MachineProgram
from moon.oracle.steps import Delayed, Output, Step
from moon.oracle.trace_events import EventKey
from tests.campaign.differential import plain
from tests.codegen.harness import Generated

HEAD = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe">
<ros_topic_publisher topic="/out" type="std_msgs/Int32" name="out"/>"""


def say(value: object) -> str:
    """Content that publishes ``value``, a number or an expression."""
    return f'<ros_topic_publish name="out"><field name="data" expr="{value}"/></ros_topic_publish>'


def probe(content: str) -> str:
    """A machine that can publish on ``/out``; ``content`` is its datamodel and its states."""
    return f"{HEAD}{content}</scxml>"


class Both:
    """Both of them. What one does and the other does not fails the test.

    Args:
        folder: where code is generated.
        text: the model.
    """

    def __init__(self, folder: Path, text: str) -> None:
        self.made = Generated(folder, text)
        model, library = self.made.machine_model, self.made.library
        self.program = MachineProgram(model, library)
        names = PortNames(model, library)
        self._context = MachineContext(model, library, names, {}, "")
        self.said: list[int] = []
        """All numbers published on ``/out``."""
        self._waiting: list[tuple[float, int, EventKey, Any, str]] = []
        self._numbers = itertools.count()
        self._delays = {name for state in self.program.states for (_, name), _ in state.pending}
        self._now_s = 0.0
        ((_, step),) = self.program.start(self.program.initial_data())
        self._same(step)

    @property
    def state(self) -> str:
        """The active state."""
        return str(self.made.it.state.value)

    def take(self, *names: str, data: Mapping[str, Any] | None = None) -> list[int]:
        """Send events from outside, each with what follows of it; the numbers that were published."""
        already = len(self.said)
        for name in names:
            self._take(name, data)
            self.settle()
        return self.said[already:]

    def settle(self) -> list[int]:
        """Take what the machine sent to itself until nothing is left; all numbers published so far."""
        self.wait(float("inf"))
        return self.said

    def wait(self, seconds: float) -> None:
        """Take what the machine sent to itself within ``seconds``."""
        end = self._now_s + seconds
        while self._waiting and self._waiting[0][0] <= end:
            due, _, event, data, _ = self._waiting.pop(0)
            self._now_s = due
            self._take_event(event, data)
        if end < float("inf"):
            self._now_s = end

    def send(self, name: str, data: Mapping[str, Any] | None = None) -> None:
        """Send an event from outside, and take nothing else yet but what follows at once."""
        self._take(name, data)
        self.wait(0.0)

    def _take(self, name: str, data: Any) -> None:
        self._take_event((EventKind.INTERNAL, name), data)

    def _take_event(self, event: EventKey, data: Any) -> None:
        self.made.outputs.sent.clear()
        kind, name = event
        with contextlib.suppress(EndlessLoopError):
            if kind is EventKind.AFTER:
                self.made.it.on_elapsed(name)
            elif hasattr(self.made.it, "on_event"):
                self.made.it.on_event(name, data)
        before = self._step
        parts = {} if kind is EventKind.AFTER else {"name": name}
        found = self.program.take(
            before.state, tuple(before.data), event, data, parts, symbolic=False
        )
        ((_, step),) = found
        self._same(step)

    def _same(self, step: Step) -> None:
        self._step = step
        it, sent = self.made.it, self.made.outputs.sent
        published = [item[1].data for item in sent if item[0] == "publish_out"]
        assert published == [
            item.fields["data"] for item in step.outputs if item.interface == "out"
        ]
        assert self.state == self.program.states[step.state].name
        for name, value in zip(self.program.names, step.data, strict=True):
            if name in self.program.live:
                assert plain(getattr(it, self._context.attribute(name))) == plain(value), name
        self._schedule(step.scheduled)
        scheduled = [item[:-1] for item in sent if item[0] in _SCHEDULED]
        assert scheduled == [
            self._sent(item) for item in step.scheduled if not isinstance(item, Output)
        ]
        self.said += published

    def _sent(self, item: Delayed | str) -> tuple[Any, ...]:
        """What the generated machine calls for ``item``."""
        if isinstance(item, str):
            return ("stop_delay" if item in self._delays else "cancel_send", item)
        kind, name = item.event
        if kind is EventKind.AFTER:
            return ("start_delay", name, item.delay_s)
        return ("send_self", name, item.data, item.delay_s, item.id)

    def _schedule(self, scheduled: list[Delayed | Output | str]) -> None:
        for item in scheduled:
            if isinstance(item, str):
                self._waiting = [known for known in self._waiting if known[-1] != item]
            elif isinstance(item, Delayed):
                due = self._now_s + item.delay_s
                number = next(self._numbers)
                self._waiting.append((due, number, item.event, item.data, item.id))
        self._waiting.sort(key=lambda item: item[:2])


_SCHEDULED = ("send_self", "cancel_send", "start_delay", "stop_delay")
