"""Property monitors against Reelay 25 and rtamt, in one run on the same observations.

Updates per second (of processor time) and ratios: the paper's P1 to P3, Reelay's own dense benchmark formulas
(timescales) with three sizes of bounds, what a monitor keeps in memory, and a thousand properties at once
against a thousand monitors.
"""

from __future__ import annotations

import gc
import itertools
import random
import statistics
import time
import tracemalloc
from collections.abc import Callable, Sequence
from typing import Any

import reelay
import rtamt

from benchmarks.page import Row, command, faster
from moon.properties.formula import Formula
from moon.properties.monitor import PropertyMonitor, PropertySet
from moon.properties.property import REQUESTS, RESPONSES, Port, Property
from moon.properties.syntax import parse_formula
from transports.interface import Observation, ObservationKind

SECOND = 1_000_000_000
ROUNDS = 5

PAPER = {
    "P1": "historically({level > 30} -> historically(not {alarm}))",
    "P2": "historically(({alarm} -> once{level <= 30}) and not(not {alarm} since[5:] {level <= 30}))",
    "P3": "historically(({set} -> once(not {done: 0})) and not(not {set} since[5:] (not {done: 0})))",
}
PAPER_RTAMT = {
    "P1": "historically((level <= 30) or historically(alarm <= 0.5))",
    "P2": "historically(((alarm <= 0.5) or once(level <= 30)))",
    "P3": "historically(((set <= 0.5) or once(done >= 0.5)))",
}
RTAMT_USES = {"P1": ("level", "alarm"), "P2": ("level", "alarm"), "P3": ("done", "set")}
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


def best(work: Callable[[], Any]) -> float:
    return min(seconds(work) for _ in range(ROUNDS))


def paper_observations(count: int) -> list[Observation]:
    """What the tour's channels carry when all is well: battery levels, ticks of skills in between."""
    choice = random.Random(1)
    found = []
    for number in range(count):
        t = number * 20_000_000
        level = 100 - 100 * number // count
        match choice.randrange(10):
            case 0 if level <= 30:
                found.append(seen(t, "/AlarmSkill/tick", ObservationKind.REQUEST_RECEIVED, {}))
            case 1:
                data = {"status": choice.randrange(2)}
                found.append(seen(t, "/IsPoiDone1Skill/tick", ObservationKind.RESPONSE_SENT, data))
            case 2:
                found.append(
                    seen(t, "/SetPoi1Skill/tick", ObservationKind.RESPONSE_SENT, {"status": 0})
                )
            case _:
                data = {"data": level}
                found.append(seen(t, "/battery_level", ObservationKind.MESSAGE, data))
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


def feed_rtamt(formula: str, names: Sequence[str], steps: list[dict[str, Any]]) -> None:
    specification = rtamt.StlDenseTimeOnlineSpecification()
    for name in names:
        specification.declare_var(name, "float")
    specification.declare_var("out", "float")
    specification.spec = f"out = {formula}"
    specification.parse()
    for before, after in itertools.pairwise(steps):
        span = (before["time"], after["time"])
        specification.update(*([name, [[t, float(before[name])] for t in span]] for name in names))


def paper(count: int) -> list[Row]:
    rows = []
    observations = paper_observations(count)
    steps = as_reelay(observations)
    for name, source in PAPER.items():
        item = Property(name, parse_formula(source), PORTS)
        ours = count / best(lambda i=item: feed_ours(i, observations))
        theirs = count / best(lambda n=name: feed_reelay(PAPER[n], steps))
        rows.append(
            Row(name, ours, "updates/s", "Reelay 25", theirs, ours / theirs, None, 500_000.0, True)
        )
        short = steps[: max(count // 200, 100)]
        took = seconds(lambda n=name, s=short: feed_rtamt(PAPER_RTAMT[n], RTAMT_USES[n], s))
        rows.append(faster(name, ours, "updates/s", "rtamt", len(short) / took))
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
    ratios, slower = [], []
    for name, template in TIMESCALES.items():
        rates = []
        for bound in (10, 100, 1000):
            source = template.format(a=bound * 3 // 10, b=bound)
            steps = timescales_steps(name, bound, count)
            observations = [
                seen(step["time"] * SECOND, "/x", ObservationKind.MESSAGE, step) for step in steps
            ]
            ours = count / best(lambda s=source, o=observations: feed_ours(s, o))
            theirs = count / best(lambda s=source, o=steps: feed_reelay(s, o))
            ratios.append(ours / theirs)
            rates.append(ours)
        slower.append(rates[0] / rates[-1])
    return [
        Row(
            f"Reelay's own formulas, times as fast as Reelay 25: {what} of {len(ratios)}",
            value,
            "",
            least=1.0,
        )
        for what, value in (("the least", min(ratios)), ("the median", statistics.median(ratios)))
    ] + [
        Row("a bound of 1,000", statistics.median(slower), "times the time of a bound of 10"),
    ]


def memory() -> list[Row]:
    rows = []
    for bound in (100, 1000, 10_000):
        source = f"historically(once[{bound // 2}:{bound}]{{p}})"
        kept = []
        tracemalloc.start()
        monitor = PropertyMonitor(source)
        for number in range(16 * bound):
            t = number * SECOND
            monitor.observe(seen(t, "/x", ObservationKind.MESSAGE, {"p": number % 2 == 0}))
            if number + 1 in (2 * bound, 4 * bound, 8 * bound, 16 * bound):
                gc.collect()
                kept.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
        rows.append(
            Row(
                f"once[{bound // 2}:{bound}], kept after {16 * bound:,} s",
                kept[-1] / 1e3,
                "kB",
                f"after {2 * bound:,} s",
                kept[0] / 1e3,
            )
        )
    return rows


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

    def one() -> None:
        for observation in observations:
            together.observe(observation)

    def many() -> None:
        for observation in observations:
            for monitor in alone:
                monitor.observe(observation)

    once, all_alone = seconds(one), seconds(many)
    return Row(
        "1,000 properties that share half, together",
        once,
        "s",
        "each alone",
        all_alone,
        once / all_alone,
        most=0.35,
    )


def rows(updates: int = 50_000) -> list[Row]:
    """What is shown."""
    found = [*paper(updates), *timescales(updates // 4), *memory()]
    return [*found, thousand(min(updates // 50, 1000))]


if __name__ == "__main__":
    command(rows)
