"""Results of checks, made up: what a page must be able to show, at any size."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

from m2c.model import DiagnosticLog, Machine, load
from moon.feed.counts import Counts
from moon.monitor.status import PROPERTY, MachineStatus
from moon.offline.result import Band, CheckResult, RecordingFacts, Timeline
from moon.recording.entries import ReportedVerdict
from moon.verdict import Evidence, Explanation, Outcome, Verdict

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
START_S = 1_790_000_000
START = START_S * 10**9
HOSTILE = '</script><script>alert("x")</script><!-- <img src=x onerror=alert(1)>'


def write_log(path: Path, count: int, channels: int = 24, seconds: float = 60.0) -> Path:
    """A log of ``count`` observations, evenly over ``seconds``."""
    with path.open("w", encoding="utf-8") as log:
        for number in range(count):
            time = START_S + seconds * number / max(count, 1)
            channel = number % channels
            if channel % 3 == 0:
                entry = {"topic": f"/node{channel}/level", "time": time, "data": number % 977}
            else:
                half = "request" if channel % 3 == 1 else "response"
                name = f"/node{channel - channel % 3}/tick"
                entry = {"service": name, "time": time, half: {"status": number % 7, "is_ok": True}}
            log.write(json.dumps(entry) + "\n")
    return path


def machines() -> tuple[Machine, ...]:
    system = load([EXAMPLE / "system.xml"], DiagnosticLog())
    assert system is not None
    return system.nodes


def violation(machine: Machine, after_s: float, number: int = 0, text: str = "") -> ReportedVerdict:
    """A violation of ``machine``, at its first transition that has words."""
    when = START + round(after_s * 1e9)
    state = machine.states[number % len(machine.states)]
    place = str(state.transitions[number % len(state.transitions)].position)
    why = Explanation(
        (f"response on /{machine.name}/tick {{status: 0, is_ok: True}} to policy",),
        text or f"response on /{machine.name}/tick {{status: 1, is_ok: True}}",
        (f"{state.name} (percentage={number})",),
        (Evidence(when - 10**8, f"request {number} of policy to /{machine.name}/tick {{}}"),),
        (place,),
    )
    reason = f"expected {why.expected[0]}, observed {why.observed}"
    verdict = Verdict(machine.name, machine.name, Outcome.VIOLATED, when, reason, why)
    return ReportedVerdict(when + 10**7, verdict)


def property_violation(after_s: float) -> ReportedVerdict:
    when = START + round(after_s * 1e9)
    why = Explanation(
        ("historically(low implies once[0:1](alarm))",),
        "low was true, alarm was not",
        (),
        (Evidence(when - 10**9, "message on /BatteryComponent/level: {data: 28}"),),
        ("examples/lab_tour/properties.yaml:12:5",),
    )
    name = "alarm_in_time"
    return ReportedVerdict(
        when, Verdict(name, name, Outcome.VIOLATED, when, "is false", why, PROPERTY)
    )


def result(
    recording: Path,
    observations: int,
    violations: tuple[ReportedVerdict, ...] = (),
    seconds: float = 60.0,
    models: tuple[str, ...] = (str(EXAMPLE / "system.xml"),),
    bands: int = 40,
) -> CheckResult:
    """A result in which every machine changes its state ``bands`` times."""
    nodes = machines() if models else ()
    end = START + round(seconds * 1e9) if observations else 0
    statuses, timelines = [], []
    for machine in nodes:
        count = sum(said.verdict.machine == machine.name for said in violations)
        word = "violated" if count else "conforming" if observations else "unseen"
        states = (machine.initial,) if observations else ()
        told = "expected response, observed another" if count else ""
        statuses.append(MachineStatus(machine.name, word, states, 59, 40, count, 0, 2.5, told))
        timelines.append(Timeline(machine.name, "model", _bands(machine, violations, end, bands)))
    for name in dict.fromkeys(s.verdict.machine for s in violations if s.verdict.kind == PROPERTY):
        statuses.append(MachineStatus(name, "violated", (), 5, 0, 1, 0, None, "is false", PROPERTY))
        band = Band(START, max(end, START), (), "violated")
        timelines.append(Timeline(name, PROPERTY, (band,)))
    facts = RecordingFacts(
        str(recording), "JSON lines", observations, START if end else 0, end, complete=True
    )
    counts = Counts(received=observations)
    return CheckResult(
        facts, models, "lab_tour" if models else "", (), (), violations,
        tuple(statuses), tuple(timelines), counts, (), seconds=0.4,
    )  # fmt: skip


def _bands(
    machine: Machine, violations: tuple[ReportedVerdict, ...], end: int, count: int
) -> tuple[Band, ...]:
    if not end:
        return ()
    wrong = [said.received_ns for said in violations if said.verdict.machine == machine.name]
    edges = [START + (end - START) * step // count for step in range(count + 1)]
    return tuple(
        Band(
            low,
            high,
            (machine.states[step % len(machine.states)].name,),
            "violated" if any(low <= when < high for when in wrong) else "conforming",
        )
        for step, (low, high) in enumerate(pairwise(edges))
    )
