"""Generated machines against two other engines: same state, data and logs after every event.

Random flat machines without middleware: conditions, assignments, entry and exit content, raised events,
targetless, self and eventless transitions, logs as the output. The order of content is visible in
`trace` and in the order of the logs. Qt runs ECMAScript; python-statemachine's reader of SCXML runs
Python, so its machines keep to expressions that mean the same in both (no division, no negatives).
"""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PySide6 import QtCore, QtScxml
from statemachine.io.scxml.processor import SCXMLProcessor

from tests.codegen.harness import Generated
from tests.drawn import examples

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

STATES = ["s0", "s1", "s2", "s3"]
EVENTS = ["e", "f", "g"]
LIMIT = 6
"""Eventless transitions count `steps` up to here, so that every macrostep ends."""


@st.composite
def content(draw: st.DrawFn, raising: bool) -> str:
    """Executable content that leaves its mark in `trace`."""
    mark = draw(st.integers(1, 9))
    text = f'<assign location="trace" expr="(trace * 10 + {mark}) % 1000003"/>'
    match draw(st.integers(0, 5)):
        case 0:
            text += '<if cond="x % 2 == 0"><assign location="x" expr="x + 3"/>'
            text += '<elseif cond="x &lt; 0"/><assign location="x" expr="-x"/>'
            text += '<else/><assign location="x" expr="x - 5"/></if>'
        case 1:
            text += '<assign location="x" expr="x * 2 - trace % 7"/>'
        case 2 if raising:
            text += '<raise event="internal"/>'
        case 3:
            text += '<assign location="text" expr="text.length > 20 ? \'\' : text + x"/>'
        case 4:
            text += f'<log label="out{mark}" expr="x"/>'
        case _:
            text += '<assign location="x" expr="Math.max(-50, Math.min(50, x))"/>'
    return text


@st.composite
def transition(draw: st.DrawFn) -> str:
    event = draw(st.sampled_from([*EVENTS, *EVENTS, "internal", "*"]))
    condition = draw(st.sampled_from(["", "", ' cond="x > 1"', ' cond="trace % 2"', ' cond="!x"']))
    target = draw(st.sampled_from(["", *(f' target="{state}"' for state in STATES)]))
    body = draw(content(raising=event in EVENTS))
    return f'<transition event="{event}"{condition}{target}>{body}</transition>'


@st.composite
def eventless(draw: st.DrawFn) -> str:
    target = draw(st.sampled_from(STATES))
    body = draw(content(raising=False))
    count = '<assign location="steps" expr="steps + 1"/>'
    return f'<transition cond="steps &lt; {LIMIT} &amp;&amp; x % 3 == 0" target="{target}">{count}{body}</transition>'


@st.composite
def machines(draw: st.DrawFn) -> str:
    """A whole machine as SCXML text."""
    parts = [
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" '
        'name="Random" initial="s0"><datamodel><data id="x" expr="1"/><data id="trace" expr="0"/>'
        '<data id="steps" expr="0"/><data id="text" expr="\'\'"/></datamodel>'
    ]
    for state in STATES:
        inner = [draw(eventless())] if draw(st.integers(0, 3)) == 0 else []
        inner += draw(st.lists(transition(), max_size=4))
        entry = draw(content(raising=False)) if draw(st.booleans()) else ""
        leaving = draw(content(raising=False)) if draw(st.booleans()) else ""
        parts.append(f'<state id="{state}"><onentry>{entry}</onentry><onexit>{leaving}</onexit>')
        parts += [*inner, '<transition event="never"/></state>']
    return "".join([*parts, "</scxml>"])


@st.composite
def shared_content(draw: st.DrawFn, raising: bool) -> str:
    """Executable content that means the same in ECMAScript and in Python."""
    mark = draw(st.integers(1, 9))
    text = f'<assign location="trace" expr="(trace * 10 + {mark}) % 1000003"/>'
    match draw(st.integers(0, 4)):
        case 0:
            text += '<if cond="x % 2 == 0"><assign location="x" expr="x + 3"/>'
            text += '<elseif cond="x &gt; 20"/><assign location="x" expr="x - 20"/>'
            text += f'<log label="large{mark}" expr="x"/>'
            text += '<else/><assign location="x" expr="x * 2"/></if>'
        case 1:
            text += '<assign location="x" expr="(x * 2 + trace) % 31"/>'
        case 2 if raising:
            text += '<raise event="internal"/>'
        case 3:
            text += f'<log label="out{mark}" expr="x + trace"/>'
        case _:
            text += '<assign location="x" expr="x % 7"/>'
    return text


@st.composite
def shared_machines(draw: st.DrawFn) -> str:
    """A whole machine in the language that all three engines have in common."""
    parts = [
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" '
        'name="Random" initial="s0"><datamodel><data id="x" expr="1"/><data id="trace" expr="0"/>'
        '<data id="steps" expr="0"/></datamodel>'
    ]
    targets = ["", *(f' target="{state}"' for state in STATES)]
    conditions = ["", "", ' cond="x &gt; 3"', ' cond="trace % 2 == 1"', ' cond="x == 0"']
    for state in STATES:
        parts.append(f'<state id="{state}">')
        for name in ("onentry", "onexit"):
            if draw(st.booleans()):
                parts.append(f"<{name}>{draw(shared_content(raising=False))}</{name}>")
        if draw(st.integers(0, 3)) == 0:
            target = draw(st.sampled_from(STATES))
            count = '<assign location="steps" expr="steps + 1"/>'
            body = draw(shared_content(raising=False))
            limit = draw(st.integers(1, LIMIT))
            parts.append(f'<transition cond="steps &lt; {limit}" target="{target}">{count}')
            parts.append(f"{body}</transition>")
        for _ in range(draw(st.integers(0, 4))):
            event = draw(st.sampled_from([*EVENTS, *EVENTS, "internal", "*"]))
            condition = draw(st.sampled_from(conditions))
            target = draw(st.sampled_from(targets))
            body = draw(shared_content(raising=event in EVENTS))
            parts.append(f'<transition event="{event}"{condition}{target}>{body}</transition>')
        parts.append('<transition event="never"/></state>')
    return "".join([*parts, "</scxml>"])


class Qt:
    """The machine in Qt's engine."""

    application: Any = None

    def __init__(self, text: str, names: tuple[str, ...]) -> None:
        if Qt.application is None:
            Qt.application = QtCore.QCoreApplication.instance() or QtCore.QCoreApplication([])
            QtCore.QLoggingCategory.setFilterRules("scxml.statemachine=true")
        self._names = names
        self._logs: list[tuple[str, str]] = []
        self._buffer = QtCore.QBuffer()
        self._buffer.setData(QtCore.QByteArray(text.encode()))
        self._buffer.open(QtCore.QBuffer.OpenModeFlag.ReadOnly)
        self._machine = QtScxml.QScxmlStateMachine.fromData(self._buffer)
        assert self._machine.parseErrors() == []
        self._machine.start()
        self._settle()

    def _settle(self) -> None:
        # Its `log` signal does not reach every slot in PySide6 6.12; the message handler hears all.
        QtCore.qInstallMessageHandler(self._hear)
        try:
            Qt.application.processEvents()
        finally:
            QtCore.qInstallMessageHandler(None)

    def _hear(self, _: object, context: Any, message: str) -> None:
        if context.category == "scxml.statemachine":
            label, _, value = message.partition(" : ")
            self._logs.append((label.strip('"'), value.strip('"')))

    def send(self, event: str) -> None:
        self._machine.submitEvent(event)
        self._settle()

    def view(self) -> dict[str, Any]:
        data = self._machine.dataModel()
        values = {name: data.scxmlProperty(name) for name in self._names}
        return {"state": self._machine.activeStateNames()[0], **values, "logs": self._logs}


class Peer:
    """The machine in python-statemachine."""

    def __init__(self, text: str, names: tuple[str, ...]) -> None:
        self._names = names
        self._logs: list[tuple[str, str]] = []
        processor = SCXMLProcessor()
        processor.parse_scxml("Random", text.replace('"ecmascript"', '"python"'))
        with self._listening():
            self._machine: Any = processor.start()

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            yield
        for line in printed.getvalue().splitlines():
            label, _, value = line.partition(": ")
            self._logs.append((label, value))

    def send(self, event: str) -> None:
        with self._listening():
            self._machine.send(event)

    def view(self) -> dict[str, Any]:
        (state,) = self._machine.configuration
        values = {name: getattr(self._machine.model, name) for name in self._names}
        return {"state": state.id, **values, "logs": self._logs}


def view_of(made: Generated, names: tuple[str, ...]) -> dict[str, Any]:
    logs = [item[1:] for item in made.outputs.sent if item[0] == "log"]
    values = {name: getattr(made.it, name) for name in names}
    return {"state": made.it.state.value, **values, "logs": logs}


def compare(
    text: str, events: list[str], names: tuple[str, ...], *engines: type[Qt] | type[Peer]
) -> None:
    """Drive all with ``events``; they agree after each."""
    with tempfile.TemporaryDirectory() as scratch:
        made = Generated(Path(scratch), text)
    references = [engine(text, names) for engine in engines]
    for event in [None, *events]:
        if event is not None:
            made.it.on_event(event)
        for reference in references:
            if event is not None:
                reference.send(event)
            assert view_of(made, names) == reference.view(), (type(reference).__name__, event)


bounded = settings(
    max_examples=examples(40, 400), deadline=None, suppress_health_check=[HealthCheck.too_slow]
)


@bounded
@given(text=machines(), events=st.lists(st.sampled_from(EVENTS), max_size=12))
def test_a_generated_machine_does_what_qts_engine_does(text: str, events: list[str]) -> None:
    compare(text, events, ("x", "trace", "steps", "text"), Qt)


@bounded
@given(text=shared_machines(), events=st.lists(st.sampled_from(EVENTS), max_size=12))
def test_three_engines_agree_on_what_they_have_in_common(text: str, events: list[str]) -> None:
    compare(text, events, ("x", "trace", "steps"), Qt, Peer)
