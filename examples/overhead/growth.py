"""How the cost of monitoring grows: with taps, with monitored skills, with the rate, with the payload.

``python -m examples.overhead.growth [--only taps|skills|rate|payload] [--transport …]`` measures and
prints it. Each point is measured unwatched and watched in the same round, in random order.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from examples.overhead import accounts, echo, fleet
from examples.overhead.children import READY_S, Child, ChildError
from examples.overhead.growth_points import EXPERIMENTS, Run, points
from examples.overhead.load import ROOT, Order, Taken
from examples.overhead.observers import CONFIGURATIONS, observed, told
from examples.overhead.plant import ORDER_S, Middleware, Plant, generate, middleware
from examples.overhead.schedule import rounds

FLEET_RATE_HZ = 100.0
"""Ticks of all skills together: the same load however many are monitored."""
PAYLOAD_RATE_HZ = 20.0


class GrowthPlan(msgspec.Struct, frozen=True):
    """How much is measured.

    Attributes:
        rounds: how often each point is measured.
        taps, skills, rates, sizes: the points (rates in ticks/s, 0 is saturation; sizes in bytes).
        ticks: in each block, at most.
        seconds: a block at a slow rate is over after so long.
    """

    rounds: int = 4
    taps: tuple[int, ...] = (0, 1, 2, 4, 8)
    skills: tuple[int, ...] = (1, 10, 50, 100, 200)
    rates: tuple[float, ...] = (3, 10, 30, 100, 0)
    sizes: tuple[int, ...] = (16, 256, 4_096, 65_536, 1_048_576)
    ticks: int = 60
    seconds: float = 3.0
    seed: int = 5

    def block(self, rate_hz: float) -> int:
        """How many ticks a block at this rate has."""
        return self.ticks if not rate_hz else max(5, min(self.ticks, int(rate_hz * self.seconds)))


QUICK = GrowthPlan(
    rounds=1,
    taps=(0, 1, 4),
    skills=(1, 20),
    rates=(10, 0),
    sizes=(16, 65_536),
    ticks=20,
    seconds=1.0,
)


Say = Callable[[str], None]


class Meter:
    """What the operating system has on record between two moments."""

    def __init__(self, processor_s: Callable[[], float]) -> None:
        self._processor_s = processor_s
        self._used = processor_s()
        self._busy, self._all = accounts.machine_s()

    def read(self, seconds: float) -> tuple[float, float]:
        """Processor time of the watchers a second, and how much of the machine was busy."""
        used = self._processor_s() - self._used
        busy, total = accounts.machine_s()
        return used / seconds, (busy - self._busy) / max(total - self._all, 1e-9)


def _run(
    experiment: str,
    transport: str,
    rate_hz: float,
    x: float,
    number: int,
    watchers: Sequence[Child],
    measure: Callable[[], Taken],
) -> Run:
    meter = Meter(lambda: sum(child.processor_s() for child in watchers))
    taken = measure()
    processor, busy = meter.read(taken.seconds)
    micros = taken.micros[ROOT]
    return Run(
        experiment,
        transport,
        rate_hz,
        x,
        number,
        len(watchers),
        micros,
        taken.failures[ROOT] + taken.warm_up_failures,
        tuple(taken.reasons),
        len(micros) / taken.seconds,
        processor,
        busy,
    )


def measure_taps(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Run]:
    """ROOT against the number of taps, each a process that decodes everything it hears."""
    with _plant(transport) as plant:
        names = [*plant.names, "policy"]
        for number, count in rounds(plan.taps, plan.rounds, plan.seed):
            say(f"{transport}: round {number + 1} of {plan.rounds}, {count} taps")
            with contextlib.ExitStack() as stack:
                taps = [stack.enter_context(_listener(plant.where, names)) for _ in range(count)]
                for tap in taps:
                    tap.answer()
                for rate_hz in (10.0, 0.0):
                    order = Order(plan.block(rate_hz), rate_hz)
                    for tap in taps:
                        tap.ask({})
                    run = _run(
                        "taps",
                        transport,
                        rate_hz,
                        count,
                        number,
                        taps,
                        lambda order=order: plant.run(order),
                    )
                    yield _with_lag(run, [tap.ask({}) for tap in taps])
                plant.rest()


def measure_rates(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Run]:
    """ROOT against the rate of the tree, unmonitored and with everything monitored passively."""
    chosen = [item for item in CONFIGURATIONS if item.name in ("none", "both")]
    with _plant(transport) as plant:
        turns = [(rate_hz, item) for rate_hz in plan.rates for item in chosen]
        for number, (rate_hz, configuration) in rounds(turns, plan.rounds, plan.seed):
            say(f"{transport}: round {number + 1} of {plan.rounds}, {rate_hz:g} ticks/s")
            order = Order(plan.block(rate_hz), rate_hz, 3 if 0 < rate_hz < 5 else 5)
            with observed(configuration, plant) as observers:
                run = _run(
                    "rate",
                    transport,
                    rate_hz,
                    rate_hz,
                    number,
                    observers.processes,
                    lambda order=order: plant.run(order),
                )
            heard = observers.heard
            yield msgspec.structs.replace(run, lag_ms=heard.lag_ms, heard=heard.observations)


def measure_skills(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Run]:
    """One tick against the number of skills that ``moon monitor`` has models of."""
    if transport != "zenoh":
        say(f"{transport}: no fleet: DDS has room for about 120 participants on a machine")
        return
    for count in plan.skills:
        with contextlib.ExitStack() as stack:
            scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fleet-")))
            say(f"{transport}: starting {count} skills")
            folder, clients, load = _fleet(stack, scratch, count)
            for number, watched in rounds((False, True), plan.rounds, plan.seed):
                say(f"{transport}: round {number + 1} of {plan.rounds}, {count} skills")
                order = Order(plan.ticks, FLEET_RATE_HZ, max(10, count))
                watcher = _fleet_monitor(folder, clients, count) if watched else None
                watchers = [watcher] if watcher is not None else []
                run = _run(
                    "skills",
                    transport,
                    FLEET_RATE_HZ,
                    count,
                    number,
                    watchers,
                    lambda load=load, order=order: _asked(load, order),
                )
                if watcher is not None:
                    heard = told(watcher.stop())
                    run = msgspec.structs.replace(
                        run, lag_ms=heard.lag_ms, heard=heard.observations
                    )
                yield run


def _fleet(stack: contextlib.ExitStack, scratch: Path, count: int) -> tuple[Path, Path, Child]:
    """Running skills: their models, the configuration of Zenoh's clients, who ticks them."""
    folder = scratch / "models"
    folder.mkdir()
    fleet.write_models(folder, count)
    with middleware("zenoh") as where:
        meeting = where.endpoint
    router, clients = scratch / "router.json5", scratch / "clients.json5"
    router.write_bytes(msgspec.json.encode({"mode": "router", "listen": {"endpoints": [meeting]}}))
    clients.write_bytes(
        msgspec.json.encode({"mode": "client", "connect": {"endpoints": [meeting]}})
    )
    command = ["-m", "examples.overhead.fleet"]
    load = stack.enter_context(
        Child("the load", [*command, "load", str(folder), "--zenoh-config", str(router)])
    )
    load.wait_for(lambda line: "listening" in line)
    host = stack.enter_context(
        Child("the skills", [*command, "host", str(folder), "--zenoh-config", str(clients)])
    )
    host.answer(fleet.READY_S)
    load.answer(fleet.READY_S)
    return folder, clients, load


def _fleet_monitor(folder: Path, clients: Path, count: int) -> Child:
    """``moon monitor`` of all of them, linked to all of them."""
    arguments = ["monitor", str(folder), "--interfaces", str(fleet.INTERFACES), "--json"]
    child = Child("moon monitor", ["-m", "moon.cli", *arguments, "--zenoh-config", str(clients)])
    try:
        child.wait_for(lambda line: line.startswith(f"linked to {count + 1} nodes"), fleet.READY_S)
    except ChildError:
        child.stop()
        raise
    return child


def measure_payloads(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Run]:
    """One call against the size of its answer, untapped and tapped."""
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(middleware(transport))
        sizes = [word for size in plan.sizes for word in ("--size", str(size))]
        command = ["-m", "examples.overhead.echo"]
        listen = ["--listen", where.endpoint] if where.endpoint else []
        caller = stack.enter_context(
            Child(
                "the caller",
                [*command, "call", "--transport", transport, *listen, *sizes],
                where.environment,
            )
        )
        stack.enter_context(
            Child("the server", [*command, "serve", *where.arguments(), *sizes], where.environment)
        ).answer()
        caller.answer()
        turns = [(size, watched) for size in plan.sizes for watched in (False, True)]
        for number, (size, watched) in rounds(turns, plan.rounds, plan.seed):
            say(f"{transport}: round {number + 1} of {plan.rounds}, {size} bytes")
            order = echo.EchoOrder(
                plan.block(PAYLOAD_RATE_HZ), PAYLOAD_RATE_HZ, warm_up=5, size=size
            )
            with contextlib.ExitStack() as turn:
                taps = []
                if watched:
                    names = [echo.SERVER, echo.CLIENT]
                    taps = [turn.enter_context(_listener(where, names))]
                    taps[0].answer()
                run = _run(
                    "payload",
                    transport,
                    PAYLOAD_RATE_HZ,
                    size,
                    number,
                    taps,
                    lambda order=order: _asked(caller, order),
                )
                yield _with_lag(run, [tap.ask({}) for tap in taps])


def _asked(child: Child, order: Any) -> Taken:
    answer = child.ask(msgspec.to_builtins(order), READY_S + ORDER_S)
    return msgspec.convert(answer, Taken)


@contextlib.contextmanager
def _plant(transport: str) -> Iterator[Plant]:
    with contextlib.ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="overhead-")))
        where = stack.enter_context(middleware(transport))
        yield stack.enter_context(Plant(where, generate(scratch, through_the_middle=False)))


def _listener(where: Middleware, names: Sequence[str]) -> Child:
    links = [word for name in names for word in ("--link", name)]
    arguments = ["-m", "examples.overhead.listener", *where.arguments(), *links]
    return Child("a tap", arguments, where.environment)


def _with_lag(run: Run, reports: Sequence[dict[str, Any]]) -> Run:
    """The run with what its taps heard: the slowest one's lag."""
    if not reports:
        return run
    return msgspec.structs.replace(
        run,
        lag_ms=max(report["lag_p50_ms"] for report in reports),
        lag_p99_ms=max(report["lag_p99_ms"] for report in reports),
        heard=min(report["heard"] for report in reports),
    )


MEASURES: dict[str, Callable[[str, GrowthPlan, Say], Iterator[Run]]] = {
    "taps": measure_taps,
    "skills": measure_skills,
    "rate": measure_rates,
    "payload": measure_payloads,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    from examples.overhead.tables import growth_tables, print_table

    parser = argparse.ArgumentParser(description="How the cost of monitoring grows.")
    parser.add_argument("--only", action="append", choices=EXPERIMENTS, help="(repeatable)")
    parser.add_argument("--transport", choices=("zenoh", "ros2"), default="zenoh")
    parser.add_argument("--rounds", type=int)
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args(arguments)
    plan = QUICK if chosen.quick else GrowthPlan()
    if chosen.rounds:
        plan = msgspec.structs.replace(plan, rounds=chosen.rounds)
    runs: list[Run] = []
    for name in chosen.only or EXPERIMENTS:
        runs += MEASURES[name](chosen.transport, plan, lambda text: print(text, file=sys.stderr))
    for table in growth_tables(points(runs)):
        print_table(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
