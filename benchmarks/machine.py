"""A compiled machine against python-statemachine on the same chart, in one run."""

from __future__ import annotations

import importlib
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from statemachine import State, StateMachine

from benchmarks.page import Row, command, faster
from benchmarks.processes import ROOT, Child, say
from m2c.codegen.package import node_modules
from m2c.model import DiagnosticLog, load

MODEL = ROOT / "examples/lab_tour/skills/BatteryLevelSkill.scxml"


class Answers:
    """Takes the machine's outputs."""

    def __init__(self) -> None:
        self.count = 0

    def respond_tick(self, response: object) -> None:
        self.count += 1


class BatteryLevelChart(StateMachine):
    """The same chart for python-statemachine."""

    idle = State(initial=True)
    answer = State()
    level = idle.to.itself(internal=True)
    tick = idle.to(answer)
    answered = answer.to(idle)

    def __init__(self) -> None:
        self.percentage = 100
        self.count = 0
        super().__init__()

    def on_level(self, data: int) -> None:
        self.percentage = data

    def on_enter_answer(self) -> None:
        self.count += 1
        _ = 0 if self.percentage > 30 else 1
        self.answered()


def compiled(folder: Path) -> Callable[[int], float]:
    """A function that feeds the generated machine pairs of message and tick; seconds taken."""
    system = load([MODEL], DiagnosticLog())
    assert system is not None
    package = folder / "battery"
    package.mkdir()
    for name, text in node_modules(system.nodes[0], system.library, "battery").items():
        (package / name).write_text(text)
    sys.path.insert(0, str(folder))
    module = importlib.import_module("battery.machine")
    messages = importlib.import_module("battery.interfaces")
    answers = Answers()
    machine = module.BatteryLevelSkill(answers)
    machine.start()
    message, request = messages.Int32(data=50), messages.TickConditionRequest()

    def run(pairs: int) -> float:
        began = time.perf_counter()
        for _ in range(pairs):
            machine.on_level_message(message)
            machine.on_tick_request(request)
        taken = time.perf_counter() - began
        assert answers.count >= pairs
        return taken

    return run


def peer(pairs: int) -> float:
    """The same events for python-statemachine; seconds taken."""
    chart = BatteryLevelChart()
    began = time.perf_counter()
    for _ in range(pairs):
        chart.send("level", data=50)
        chart.send("tick")
    taken = time.perf_counter() - began
    assert chart.count == pairs
    return taken


QT_CHART = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" initial="idle">
  <datamodel><data id="percentage" expr="100"/><data id="count" expr="0"/></datamodel>
  <state id="idle">
    <transition event="level"><assign location="percentage" expr="_event.data"/></transition>
    <transition event="tick" target="answer"/>
  </state>
  <state id="answer">
    <onentry>
      <if cond="percentage &gt;= 30"><assign location="count" expr="count + 1"/>
      <else/><assign location="count" expr="count + 1"/></if>
    </onentry>
    <transition target="idle"/>
  </state>
</scxml>
"""


QT_PAIRS = 1000


def qt() -> float:
    """The same events for Qt's SCXML engine; seconds that ``QT_PAIRS`` took.

    In a process of its own: PySide6 6.12 counts a reference to None too few at each submitEvent, and an
    interpreter that ends after thousands of them aborts.
    """
    with Child.calling("Qt", qt_here) as child:
        return float(child.answer()["seconds"])


def qt_here() -> None:
    """The same in this process, which it ends."""
    from PySide6 import QtCore, QtScxml

    application = QtCore.QCoreApplication.instance() or QtCore.QCoreApplication([])
    buffer = QtCore.QBuffer()
    buffer.setData(QtCore.QByteArray(QT_CHART.encode()))
    buffer.open(QtCore.QBuffer.OpenModeFlag.ReadOnly)
    chart = QtScxml.QScxmlStateMachine.fromData(buffer)
    assert chart.parseErrors() == []
    chart.start()
    application.processEvents()
    began = time.perf_counter()
    for _ in range(QT_PAIRS):
        chart.submitEvent("level", 50)
        chart.submitEvent("tick")
        application.processEvents()
    taken = time.perf_counter() - began
    assert int(chart.dataModel().scxmlProperty("count")) == QT_PAIRS
    say({"seconds": taken})
    os._exit(0)


def rows(events: int = 400_000) -> list[Row]:
    """What is shown, of so many events."""
    pairs = events // 2
    with tempfile.TemporaryDirectory() as scratch:
        run = compiled(Path(scratch))
        run(pairs // 10)
        ours = 2 * pairs / run(pairs)
    few = max(pairs // 50, 1)
    peers = {
        "python-statemachine": (2 * few / peer(few), 10.0),
        "Qt SCXML": (2 * QT_PAIRS / qt(), None),
    }
    return [
        faster("compiled machine", ours, "events/s", name, theirs, least)
        for name, (theirs, least) in peers.items()
    ]


if __name__ == "__main__":
    command(rows)
