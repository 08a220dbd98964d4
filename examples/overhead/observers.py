"""Who monitors while the load runs: nobody, ``moon monitor``, or a man in the middle."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import msgspec

from benchmarks.processes import Child, ChildError
from examples.overhead.middle import judge_over_websocket, stand
from examples.overhead.plant import PROPERTIES, SYSTEM, Plant
from examples.overhead.routes import MONITORED

NOBODY = "none"
"""The configuration that the others are compared with."""


class Configuration(msgspec.Struct, frozen=True):
    """Who monitors what. Properties are always monitored passively, as in the paper.

    Attributes:
        middle: how the models are monitored: "" passively, else by a monitor in the middle whose oracle is
            behind a "WebSocket" or "in-process".
    """

    name: str
    label: str
    models: bool = False
    properties: bool = False
    middle: str = ""


# The control is what chance does: its ratio to no monitor is 1, and how far from it measured.
CONFIGURATIONS = (
    Configuration(NOBODY, "no monitor"),
    Configuration("control", "no monitor, again"),
    Configuration("properties", "properties", properties=True),
    Configuration("models", "models, passive", models=True),
    Configuration("both", "both, passive", models=True, properties=True),
    *(
        Configuration(f"{what}-{way.lower()}", f"{what}, in the middle ({way})", True, both, way)
        for way in ("WebSocket", "in-process")
        for what, both in (("models", False), ("both", True))
    ),
)


class Heard(msgspec.Struct, frozen=True):
    """What the monitors of one block did: without it, a monitor that is deaf would look cheap.

    Attributes:
        observations: heard (passive), or asked of the oracle (in the middle).
        violations: false ones, as the system has no fault.
        conforming: how many machines and properties were found to be as they should.
        lag_ms: from an event to the monitor: the median of the machines' medians; None if unknown.
        problems: what the monitor could not hear.
        doubts: what it could not judge and why, the first few.
    """

    observations: int = 0
    violations: int = 0
    conforming: int = 0
    lag_ms: float | None = None
    problems: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


class Observers:
    """The monitors' processes of one configuration, and what they said at the end."""

    def __init__(self) -> None:
        self.processes: list[Child] = []
        self.heard = Heard()

    def processor_s(self) -> float:
        """Processor time that all of them have used."""
        return sum(child.processor_s() for child in self.processes)


@contextlib.contextmanager
def observed(configuration: Configuration, plant: Plant) -> Iterator[Observers]:
    """Monitors at work from now until the end of the block.

    Raises:
        ChildError: one does not come up.
    """
    observers, where = Observers(), plant.where
    said: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:

        def begun(name: str, function: Callable[..., object], *arguments: object) -> Child:
            child = Child.calling(name, function, *arguments, environment=where.environment)
            stack.callback(lambda: [said.update(line) for line in child.stop()])
            observers.processes.append(child)
            return child

        if configuration.middle:
            oracle, url = None, ""
            if configuration.middle == "WebSocket":
                oracle = begun("the oracle", judge_over_websocket)
                url = oracle.answer()["url"]
            middle = begun("the man in the middle", stand, where.transport, where.options(), url)
            middle.answer()
            plant.settle()
            (oracle or middle).ask({})
        models = configuration.models and not configuration.middle
        if models or configuration.properties:
            child = _moon(plant, models, configuration.properties)
            observers.processes.append(child)
            try:
                yield observers
            finally:
                # while the tree is still ticked: where nobody rings the alarm any more, P2 is false 2 s later
                observers.heard = told(child.stop())
        else:
            yield observers
        plant.rest()
    heard = observers.heard
    observers.heard = msgspec.structs.replace(
        heard,
        observations=heard.observations + said.get("asked", 0),
        violations=heard.violations + said.get("violations", 0),
        conforming=heard.conforming + len(said.get("conforming", ())),
        problems=(*heard.problems, *said.get("reasons", ())),
    )


def _moon(plant: Plant, models: bool, properties: bool) -> Child:
    """``moon monitor``, linked to all nodes."""
    what = [str(SYSTEM)] if models else []
    if properties:
        what += ["--properties", str(PROPERTIES)]
    arguments = ["-m", "moon.cli", "monitor", *what, "--json", *plant.where.arguments()]
    child = Child("moon monitor", arguments, plant.where.environment)
    wanted = len({*plant.names, "policy"})
    try:
        child.wait_for(
            lambda line: line.startswith("linked to ") and int(line.split()[2]) >= wanted
        )
    except ChildError:
        child.stop()
        raise
    return child


def told(lines: list[dict[str, Any]]) -> Heard:
    """What ``moon monitor --json`` said of itself at the end."""
    found = next((line for line in lines if line.get("event") == "summary"), None)
    reasons = [
        f"{line['node']}: {line['reason']}"
        for line in lines
        if line.get("event") == "verdict" and line["outcome"] == "violated"
    ]
    if found is None:
        return Heard(problems=("the monitor ended without a summary",))
    machines = found["machines"]
    doubts = [
        f"{item['machine']}: {item['last']}"
        for item in machines
        if item["verdict"] == "inconclusive"
    ]
    lags = sorted(item["lag_ms"] for item in machines if item["lag_ms"] is not None)
    return Heard(
        found["counts"]["heard"],
        sum(item["violations"] for item in machines),
        sum(item["verdict"] == "conforming" for item in machines),
        lags[len(lags) // 2] if lags else None,
        (*found["problems"], *reasons[:3]),
        tuple(doubts[:6]),
    )


def deaf(configuration: Configuration, heard: Heard, ticks: int) -> str:
    """Why the monitors of a block did not do their work; "" if they did.

    Each tick of the tree is four ticks of skills, of which three make a call of their own: the
    monitors of models must have got at least the requests and responses of all of them.
    """
    least = 0
    if configuration.models:
        least += 2 * ticks * (2 * len(MONITORED) - 1)
    elif configuration.properties:
        least += ticks * len(MONITORED)
    if heard.observations < least:
        return f"received {heard.observations} of at least {least} events"
    if heard.violations:
        return f"{heard.violations} violations in a system without a fault: {heard.problems}"
    if heard.conforming == 0 and (configuration.models or configuration.properties):
        why = "found nothing to be as it should"
        return f"{why}: {'; '.join(heard.doubts)}" if heard.doubts else why
    return ""
