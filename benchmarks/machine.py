"""A compiled machine against python-statemachine on the same chart, in one run."""

from __future__ import annotations

import functools
import importlib
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from statemachine import State, StateMachine

from benchmarks.page import Row, beside, command
from benchmarks.processes import ROOT
from benchmarks.sampling import measured
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


def compiled(folder: Path) -> Callable[[int], list[float]]:
    """A function that feeds the generated machine pairs of message and tick; events per second."""
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

    def run(pairs: int) -> list[float]:
        before = answers.count
        began = time.perf_counter()
        for _ in range(pairs):
            machine.on_level_message(message)
            machine.on_tick_request(request)
        taken = time.perf_counter() - began
        assert answers.count == before + pairs
        return [2 * pairs / taken]

    return run


def peer(pairs: int) -> list[float]:
    """The same events for python-statemachine."""
    chart = BatteryLevelChart()
    began = time.perf_counter()
    for _ in range(pairs):
        chart.send("level", data=50)
        chart.send("tick")
    taken = time.perf_counter() - began
    assert chart.count == pairs
    return [2 * pairs / taken]


def rows(events: int = 80_000, rounds: int = 5) -> list[Row]:
    """What is shown, of so many events in each round."""
    pairs = events // 2
    with tempfile.TemporaryDirectory() as scratch:
        run = compiled(Path(scratch))
        run(pairs)  # which warms the caches
        few = functools.partial(peer, max(pairs // 50, 1))
        found = measured({"ours": functools.partial(run, pairs), "theirs": few}, rounds)
    ours, theirs = found["ours"], found["theirs"]
    return [beside("compiled machine", "events/s", ours, "python-statemachine", theirs, least=10.0)]


if __name__ == "__main__":
    command(rows)
