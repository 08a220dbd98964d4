"""Who monitors while the load runs: nobody, ``moon monitor``, or a man in the middle."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from enum import StrEnum
from typing import Any

import msgspec

from benchmarks.processes import Child, ChildError
from examples.overhead.plant import PROPERTIES, SYSTEM, Plant
from examples.overhead.routes import MONITORED


class Observation(StrEnum):
    """How the models are monitored."""

    NONE = "none"
    PASSIVE = "passive"
    WEBSOCKET = "in the middle, WebSocket"
    IN_PROCESS = "in the middle, in-process"

    @property
    def is_in_the_middle(self) -> bool:
        """Whether calls go through the monitor."""
        return self in (Observation.WEBSOCKET, Observation.IN_PROCESS)


class Configuration(msgspec.Struct, frozen=True):
    """Who monitors what. Properties are always monitored passively, as in the paper."""

    name: str
    label: str
    observation: Observation
    models: bool = False
    properties: bool = False


# The control is what chance does: its ratio to no monitor is 1, and how far from it measured.
CONFIGURATIONS = (
    Configuration("none", "no monitor", Observation.NONE),
    Configuration("control", "no monitor, again", Observation.NONE),
    Configuration("properties", "properties", Observation.PASSIVE, properties=True),
    Configuration("models", "models, passive", Observation.PASSIVE, models=True),
    Configuration("both", "both, passive", Observation.PASSIVE, models=True, properties=True),
    *(
        Configuration(f"{what}-{name}", f"{what}, in the middle ({way})", where, True, both)
        for name, way, where in (
            ("websocket", "WebSocket", Observation.WEBSOCKET),
            ("in-process", "in-process", Observation.IN_PROCESS),
        )
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
        return sum(process.processor_s() for process in self.processes)


@contextlib.contextmanager
def observed(configuration: Configuration, plant: Plant) -> Iterator[Observers]:
    """Monitors at work from now until the end of the block.

    Raises:
        ChildError: one does not come up.
    """
    observers = Observers()
    if configuration.observation.is_in_the_middle:
        with _in_the_middle(configuration, plant, observers):
            yield observers
        return
    if configuration.observation is Observation.NONE:
        yield observers
        plant.rest()
        return
    child = _moon(plant, configuration.models, configuration.properties)
    observers.processes.append(child)
    try:
        yield observers
    finally:
        # while the tree is still ticked: where nobody rings the alarm any more, P2 is false 2 s later
        observers.heard = told(child.stop())
    plant.rest()


@contextlib.contextmanager
def _in_the_middle(
    configuration: Configuration, plant: Plant, observers: Observers
) -> Iterator[None]:
    variables = plant.where.environment
    heard = Heard()
    oracle: Child | None = None
    properties: Child | None = None
    middle: Child | None = None
    try:
        address = "in-process"
        if configuration.observation is Observation.WEBSOCKET:
            oracle = Child("the oracle", ["-m", "examples.overhead.websocket_oracle"], variables)
            observers.processes.append(oracle)
            address = oracle.answer()["url"]
        arguments = ["-m", "examples.overhead.middle", "--oracle", address]
        middle = Child("the man in the middle", [*arguments, *plant.where.arguments()], variables)
        observers.processes.append(middle)
        middle.answer()
        plant.settle()
        (oracle or middle).ask({})
        if configuration.properties:
            properties = _moon(plant, models=False, properties=True)
            observers.processes.append(properties)
        yield
        heard = told(properties.stop()) if properties is not None else Heard()
        properties = None
        plant.rest()
    finally:
        said: dict[str, Any] = {}
        if properties is not None:
            properties.stop()
        for child in (middle, oracle):
            for line in child.stop() if child is not None else ():
                said |= line
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
    wanted = {*plant.names, "policy"}
    try:
        child.wait_for(
            lambda line: (
                line.startswith("linked to ") and wanted <= set(line.partition(": ")[2].split(", "))
            )
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
