"""Property monitors against Reelay 25, in one run on the same observations.

Updates per second (of processor time) and ratios: the paper's P1 to P3, Reelay's own dense benchmark formulas
(timescales) with three sizes of bounds, and a thousand properties at once against a thousand monitors.
"""

from __future__ import annotations

import functools
import gc
import random
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import reelay

from benchmarks.page import Row, beside, command
from benchmarks.sampling import measured, ratio
from moon.properties.formula import Formula
from moon.properties.monitor import PropertyMonitor, PropertySet
from moon.properties.property import Port, Property
from moon.properties.syntax import parse_formula
from transports.interface import REQUESTS, RESPONSES, Observation, ObservationKind

SECOND = 1_000_000_000
ROUNDS = 5
UNIT = "updates/s"

PAPER = {
    "P1": "historically({level > 30} -> historically(not {alarm}))",
    "P2": "historically(({alarm} -> once{level <= 30}) and not(not {alarm} since[5:] {level <= 30}))",
    "P3": "historically(({set} -> once(not {done: 0})) and not(not {set} since[5:] (not {done: 0})))",
}
PORTS = (
    Port("level", "/battery_level", path=("data",), initial=100),
    Port("alarm", "/AlarmSkill/tick", REQUESTS, event=True),
    Port("done", "/IsPoiDone1Skill/tick", RESPONSES, ("status",), initial=1),
    Port("set", "/SetPoi1Skill/tick", RESPONSES, event=True),
)
TIMESCALES = {
    "AbsentAQ": "historically((once[:{b}]{{q}}) -> ((not{{p}}) since {{q}}))",
    "AbsentBR": "historically({{r}} -> (historically[:{b}](not{{p}})))",
    "AbsentBQR": "historically(({{r}} && !{{q}} && once{{q}}) -> ((not{{p}}) since[{a}:{b}] {{q}}))",
    "AlwaysAQ": "historically((once[:{b}]{{q}}) -> ({{p}} since {{q}}))",
    "AlwaysBR": "historically({{r}} -> (historically[:{b}]{{p}}))",
    "AlwaysBQR": "historically(({{r}} && !{{q}} && once{{q}}) -> ({{p}} since[{a}:{b}] {{q}}))",
    "RecurGLB": "historically(once[:{b}]{{p}})",
    "RecurBQR": "historically(({{r}} && !{{q}} && once{{q}}) -> ((once[:{b}]({{p}} or {{q}})) since {{q}}))",
    "RespondGLB": "historically((({{s}} -> once[{a}:{b}]{{p}}) and not((not {{s}}) since[{b}:] {{p}})))",
}


def seen(t: int, channel: str, kind: ObservationKind, data: dict[str, Any]) -> Observation:
    return Observation(
        stamp_ns=t,
        received_ns=t,
        channel=channel,
        kind=kind,
        type_name="",
        data=data,
        source="robot",
    )


def seconds(work: Callable[[], Any]) -> float:
    gc.collect()
    begin = time.process_time()  # others may use the machine
    work()
    return time.process_time() - begin


def speeds(
    count: int, ours: Callable[[], Any], theirs: Callable[[], Any]
) -> tuple[list[list[float]], list[list[float]]]:
    """Updates per second in each round; ``count`` are made each time."""

    def turn(work: Callable[[], Any]) -> list[float]:
        return [count / seconds(work)]

    found = measured({work: functools.partial(turn, work) for work in (ours, theirs)}, ROUNDS)
    return found[ours], found[theirs]


def paper_observations(count: int) -> list[Observation]:
    """What the tour's channels carry when all is well: battery levels, ticks of skills in between."""
    choice = random.Random(1)
    found = []
    for number in range(count):
        t = number * 20_000_000
        level = 100 - 100 * number // count
        where, kind, data = "/battery_level", ObservationKind.MESSAGE, {"data": level}
        match choice.randrange(10):
            case 0 if level <= 30:
                where, kind, data = "/AlarmSkill/tick", ObservationKind.REQUEST_RECEIVED, {}
            case 1:
                data = {"status": choice.randrange(2)}
                where, kind = "/IsPoiDone1Skill/tick", ObservationKind.RESPONSE_SENT
            case 2:
                where, kind = "/SetPoi1Skill/tick", ObservationKind.RESPONSE_SENT
                data = {"status": 0}
        found.append(seen(t, where, kind, data))
    return found


def as_reelay(observations: list[Observation]) -> list[dict[str, Any]]:
    """The same as MOON hands it to Reelay: every predicate's value, at every observation."""
    values: dict[str, Any] = {"level": 100, "alarm": False, "done": 1, "set": False}
    steps: list[dict[str, Any]] = [{"time": 0.0, **values}]
    for observation in observations:
        values = {**values, "alarm": False, "set": False}
        match observation.channel:
            case "/battery_level":
                values["level"] = observation.data["data"]
            case "/AlarmSkill/tick":
                values["alarm"] = True
            case "/IsPoiDone1Skill/tick":
                values["done"] = observation.data["status"]
            case _:
                values["set"] = True
        steps.append({"time": observation.stamp_ns / SECOND + 1e-6, **values})
    return steps


def feed_ours(what: Property | Formula | str, observations: list[Observation]) -> None:
    observe = PropertyMonitor(what).observe
    for observation in observations:
        observe(observation)


def feed_reelay(formula: str, steps: list[dict[str, Any]]) -> None:
    update = reelay.dense_timed_monitor(pattern=formula).update
    for step in steps:
        update(step)


def paper(count: int) -> list[Row]:
    observations = paper_observations(count)
    steps = as_reelay(observations)
    rows = []
    for name, source in PAPER.items():
        item = Property(name, parse_formula(source), PORTS)
        ours, theirs = speeds(
            count,
            functools.partial(feed_ours, item, observations),
            functools.partial(feed_reelay, source, steps),
        )
        rows.append(
            beside(name, UNIT, ours, "Reelay 25", theirs, least=500_000.0, is_of_value=True)
        )
    return rows


def timescales_steps(name: str, bound: int, count: int) -> list[dict[str, Any]]:
    """A condensed behaviour that keeps the formula true, on the scale of its bound."""
    choice = random.Random(name)
    steps: list[dict[str, Any]] = [{"time": 0, "p": True, "q": True, "r": False, "s": False}]
    t = 0
    always = name.startswith("Always")
    absent = name.startswith("Absent")
    for number in range(1, count):
        t += choice.randint(1, max(1, bound // 10))
        turn = number % 4
        p = True if always else False if absent else turn == 0
        s = name == "RespondGLB" and turn == 2
        steps.append({"time": t, "p": p, "q": turn == 0, "r": turn == 3, "s": s})
    return steps


def timescales(count: int) -> list[Row]:
    ratios = []
    for name, template in TIMESCALES.items():
        for bound in (10, 100, 1000):
            source = template.format(a=bound * 3 // 10, b=bound)
            steps = timescales_steps(name, bound, count)
            observations = [
                seen(step["time"] * SECOND, "/x", ObservationKind.MESSAGE, step) for step in steps
            ]
            ours, theirs = speeds(
                count,
                functools.partial(feed_ours, source, observations),
                functools.partial(feed_reelay, source, steps),
            )
            ratios.append(ratio(ours, theirs).value)
    what = "Reelay's own formulas, times as fast as Reelay 25"
    return [
        Row(f"{what}: the least of {len(ratios)}", min(ratios), "", least=1.0),
        Row(f"{what}: the median of {len(ratios)}", statistics.median(ratios), "", least=1.0),
    ]


def thousand(count: int) -> Row:
    ports = tuple(Port(name, f"/{name}", path=("v",), initial=0) for name in "xyz")
    properties = []
    for number in range(1000):
        shared = f"(once[:{5 + number % 10}]{{x > {number % 10}}}) since {{x > {number % 10 + 5}}}"
        own = f"{{y > {number}}} -> once[:3]{{z > {number}}}"
        source = f"historically(({shared}) or ({own}))"
        properties.append(Property(f"f{number}", parse_formula(source), ports))
    choice = random.Random(2)
    observations = []
    for number in range(count):
        name = choice.choice("xxyz")
        value = choice.randrange(20 if name == "x" else 1000)
        observations.append(
            seen(number * SECOND // 4, f"/{name}", ObservationKind.MESSAGE, {"v": value})
        )

    together = PropertySet(properties)
    alone = [PropertyMonitor(item) for item in properties]

    def feed(monitors: Sequence[PropertySet | PropertyMonitor]) -> None:
        for observation in observations:
            for monitor in monitors:
                monitor.observe(observation)

    ours, theirs = (seconds(functools.partial(feed, each)) for each in ([together], alone))
    what = "1,000 properties that share half, together"
    return beside(what, "s", [[ours]], "each alone", [[theirs]], most=0.35)


def rows(updates: int = 50_000) -> list[Row]:
    """What is shown."""
    return [*paper(updates), *timescales(updates // 4), thousand(min(updates // 50, 1000))]


if __name__ == "__main__":
    command(rows)
