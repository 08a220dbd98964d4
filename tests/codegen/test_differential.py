"""Generated machines against Qt's SCXML engine: same states and data after every event.

Random flat machines without middleware: conditions, assignments, entry and exit content, raised events,
targetless, self and eventless transitions. The order of content is visible in `trace`.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PySide6 import QtCore, QtScxml

from tests.codegen.harness import Generated

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
    match draw(st.integers(0, 4)):
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


class Qt:
    """The machine in Qt's engine."""

    application: Any = None

    def __init__(self, text: str) -> None:
        if Qt.application is None:
            Qt.application = QtCore.QCoreApplication.instance() or QtCore.QCoreApplication([])
        self._buffer = QtCore.QBuffer()
        self._buffer.setData(QtCore.QByteArray(text.encode()))
        self._buffer.open(QtCore.QBuffer.OpenModeFlag.ReadOnly)
        self._machine = QtScxml.QScxmlStateMachine.fromData(self._buffer)
        assert self._machine.parseErrors() == []
        self._machine.start()
        Qt.application.processEvents()

    def send(self, event: str) -> None:
        self._machine.submitEvent(event)
        Qt.application.processEvents()

    def view(self) -> dict[str, Any]:
        data = self._machine.dataModel()
        values = {name: data.scxmlProperty(name) for name in ("x", "trace", "steps", "text")}
        return {"state": self._machine.activeStateNames()[0], **values}


def view_of(made: Generated) -> dict[str, Any]:
    machine = made.it
    return {
        "state": machine.state.value,
        **{name: getattr(machine, name) for name in ("x", "trace", "steps", "text")},
    }


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(text=machines(), events=st.lists(st.sampled_from(EVENTS), max_size=12))
def test_a_generated_machine_does_what_qts_engine_does(text: str, events: list[str]) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        made = Generated(Path(scratch), text)
        reference = Qt(text)
        assert view_of(made) == reference.view()
        for event in events:
            made.it.on_event(event)
            reference.send(event)
            assert view_of(made) == reference.view(), event
