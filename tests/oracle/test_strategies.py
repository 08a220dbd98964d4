"""The random cases: what they promise, and that the steps behind them agree with generated code."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from m2c.check import check_types
from m2c.model import DiagnosticLog, Machine
from m2c.model.machine import Event, EventKind, InterfaceKind, OutputKind
from tests.codegen.harness import Generated
from tests.oracle.machines import INTERFACES, library, model, read
from tests.oracle.steps import Stepper
from tests.oracle.strategies import Case, case, cases, conforming_cases, machines
from tests.oracle.traces import DEADLINE_NS, LATENCY_NS, filled

pytestmark = pytest.mark.slow

unhurried = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@unhurried
@given(conforming_cases())
def test_a_run_of_the_machine_conforms_to_it(found: Case) -> None:
    assert found.conforms(check_calls=True), str(found)


@unhurried
@given(machines())
def test_random_machines_have_no_type_faults(machine: Machine) -> None:
    log = DiagnosticLog()
    check_types(machine, library(), log)
    assert not log.has_errors, log.diagnostics


@unhurried
@given(cases())
def test_verdicts_do_not_hang_on_when_exactly_a_deadline_begins(found: Case) -> None:
    begins = [0, *(item.stamp_ns for item in found.trace.observations)]
    judged = [found.trace.end_ns, *begins]
    for begin in begins:
        early, late = begin + DEADLINE_NS - LATENCY_NS, begin + DEADLINE_NS + 2 * LATENCY_NS
        assert not any(early < moment < late for moment in judged)


def test_the_same_seed_gives_the_same_case() -> None:
    assert case(Random(7)) == case(Random(7))


def test_perturbed_traces_are_of_both_kinds_and_every_change_matters_sometimes() -> None:
    verdicts: Counter[bool] = Counter()
    broke: Counter[str] = Counter()
    for seed in range(700):
        if len(broke) == 12 and min(verdicts[False], verdicts[True]) > 150:
            break
        found = case(Random(seed), perturb=True)
        verdict = found.conforms()
        verdicts[verdict] += 1
        if not verdict:
            broke.update(name for name in found.made.split(", ") if ":" not in name)
            broke["mutant"] += ":" in found.made
    assert verdicts[False] > 150
    assert verdicts[True] > 150
    assert len(broke) == 12, broke


def test_sequence_numbers_have_no_gaps_and_own_stamps_are_distinct() -> None:
    for seed in range(200):
        found = case(Random(seed))
        seen: dict[tuple[str, str], int] = {}
        for item in found.trace.observations:
            key = (item.source, item.channel)
            assert item.sequence == seen.get(key, 0)
            seen[key] = item.sequence + 1
        own = [item.stamp_ns for item in found.trace.observations if item.source == "Probe"]
        if not found.made:
            assert len(set(own)) == len(own)


EVENTS = {
    InterfaceKind.SUBSCRIBER: (EventKind.MESSAGE,),
    InterfaceKind.SERVER: (EventKind.REQUEST,),
    InterfaceKind.CLIENT: (EventKind.RESPONSE, EventKind.CALL_ERROR),
    InterfaceKind.TIMER: (EventKind.TIMER,),
}


@pytest.mark.parametrize("seed", range(60))
def test_the_steps_agree_with_generated_code(seed: int, tmp_path: Path) -> None:
    draw = Random(seed)
    text = model(draw)
    while "Math.random" in text or "prob=" in text:
        text = model(draw)
    machine = read(text)
    ask = (INTERFACES / "probe_interfaces" / "srv" / "Ask.srv").read_text()
    generated = Generated(tmp_path, text, {"probe_interfaces/srv/Ask.srv": ask})
    stepper = Stepper(machine)
    ((configuration, sent),) = stepper.start()
    nobody = dict.fromkeys((item.name for item in machine.interfaces), 0)
    begun = _without_dropped(_sent(generated, machine), None, nobody)
    assert begun == [_comparable(output) for output in sent]
    for _ in range(25):
        interface = draw.choice([item for item in machine.interfaces if item.kind in EVENTS])
        event = Event(draw.choice(EVENTS[interface.kind]), interface.name)
        data = _data(event.kind, draw)
        before = configuration
        ((configuration, sent),) = stepper.take(configuration, event, data)
        _feed(generated, machine, event, data)
        waited = {name: len(before.waiting.get(name, ())) for name in nobody}
        found = _without_dropped(_sent(generated, machine), event, waited)
        assert found == [_comparable(output) for output in sent], (event, data)
        assert generated.it.state.value == configuration.state
        for data_item in machine.data:
            assert getattr(generated.it, data_item.name) == configuration.data[data_item.name]


def _data(kind: EventKind, draw: Random) -> dict[str, Any] | None:
    match kind:
        case EventKind.MESSAGE:
            return {"data": draw.randint(0, 3)}
        case EventKind.REQUEST:
            return {"value": draw.randint(0, 3)}
        case EventKind.RESPONSE:
            return {"value": draw.randint(0, 3), "ok": draw.random() < 0.5}
        case _:
            return None


def _comparable(output: Any) -> tuple[str, str, dict[str, Any]]:
    return (str(output.kind), output.channel, filled(output))


def _feed(generated: Generated, machine: Machine, event: Event, data: Any) -> None:
    from m2c.codegen.ports import PortNames

    method = PortNames(machine, library()).event(event).method
    handler = getattr(generated.it, method, None)
    if handler is None:  # no state takes it
        return
    classes = {
        EventKind.MESSAGE: "Int32",
        EventKind.REQUEST: "AskRequest",
        EventKind.RESPONSE: "AskResponse",
    }
    if event.kind in classes:
        handler(getattr(generated.interfaces, classes[event.kind])(**data))
    else:
        handler()


def _sent(generated: Generated, machine: Machine) -> list[tuple[str, str, dict[str, Any]]]:
    from m2c.codegen.ports import PortNames

    names = PortNames(machine, library())
    by_method = {}
    for interface in machine.interfaces:
        for kind, owner in (
            (OutputKind.PUBLISH, InterfaceKind.PUBLISHER),
            (OutputKind.REQUEST, InterfaceKind.CLIENT),
            (OutputKind.RESPONSE, InterfaceKind.SERVER),
        ):
            if interface.kind is owner:
                method = names.output(kind, interface.name).method
                by_method[method] = (str(kind), interface.channel or "")
    found = []
    for method, *arguments in generated.outputs.sent:
        if method in by_method:
            kind, channel = by_method[method]
            data = {name: getattr(arguments[0], name) for name in arguments[0].__struct_fields__}
            found.append((kind, channel, data))
    generated.outputs.sent.clear()
    return found


def _without_dropped(
    sent: list[tuple[str, str, dict[str, Any]]], event: Event | None, waited: dict[str, int]
) -> list[tuple[str, str, dict[str, Any]]]:
    """Without the responses that nobody waits for: the runtime drops them, not the machine."""
    waiting = dict(waited)
    if event is not None and event.kind is EventKind.REQUEST:
        waiting[event.name] += 1
    kept = []
    for kind, channel, data in sent:
        if kind == OutputKind.RESPONSE:
            if not waiting[channel]:
                continue
            waiting[channel] -= 1
        kept.append((kind, channel, data))
    return kept
