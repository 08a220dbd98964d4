"""The campaign's own machinery: a trial is repeatable, its command repeats it, and what is wrong is found."""

from __future__ import annotations

import shlex
from pathlib import Path
from random import Random

import msgspec
import pytest

from moon.verdict import Outcome, Verdict
from tests.campaign import __main__ as command
from tests.campaign import shrink, truth
from tests.campaign import trial as trials
from tests.campaign.circumstances import (
    UNTIL_S,
    WEIGHTS,
    Circumstances,
    Faulty,
    Happened,
    Kind,
    draw,
    fewer,
    nominal,
)
from tests.campaign.plans import write
from tests.campaign.shrink import Case
from tests.campaign.systems import make
from tests.campaign.trial import Failure, Fault, Prepared, Result, try_one
from tests.oracle.machines import read
from tests.systems import EXAMPLES
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, Kill, Lost

SEED = 0


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    return Prepared(write(make(SEED, 1), tmp_path_factory.mktemp("system")))


@pytest.fixture(scope="module")
def happened(prepared: Prepared) -> Happened:
    return prepared.happened(SEED, UNTIL_S)


def test_a_trial_is_a_function_of_its_case(prepared: Prepared, happened: Happened) -> None:
    made = draw(Random(3), happened)
    assert draw(Random(3), happened) == made
    assert try_one(prepared, SEED, made) == try_one(prepared, SEED, made)


def test_the_command_of_a_case_repeats_it(
    happened: Happened, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case(SEED, 1, draw(Random(5), happened), (0,))
    ran: list[Case] = []
    real = command.run

    def noted(case: Case, *more: object) -> object:
        ran.append(case)
        return real(case, *more)

    monkeypatch.setattr(command, "run", noted)
    _, _, module, *words = shlex.split(case.command())
    assert module == "tests.campaign"
    command.main(words)
    assert ran == [case]
    assert "observations" in capsys.readouterr().out


def test_every_kind_of_circumstance_is_drawn(happened: Happened) -> None:
    drawn = [draw(Random(seed), happened) for seed in range(300)]
    usual = Conditions()
    for name in Conditions.__struct_fields__:
        if name != "busy_s":
            values = [getattr(made.conditions, name) for made in drawn]
            assert any(value != getattr(usual, name) for value in values), name
    assert any(made.joins_s for made in drawn)
    assert set(WEIGHTS) == set(Kind)


def test_what_is_drawn_can_be_printed_and_made_less(happened: Happened) -> None:
    for seed in range(50):
        made = draw(Random(seed), happened)
        text = msgspec.json.encode(made)
        assert msgspec.json.decode(text, type=Circumstances) == made
        assert made not in fewer(made)
    assert fewer(Circumstances()) == []


def test_a_failing_case_is_shrunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left is what the fault needs: here a loss, a machine and two seconds."""

    def accuses(case: Case) -> Result:
        lost = any(one.source == "Part0" for one in case.made.conditions.lost)
        there = any(model.name == "Part0" for model in case.plan().models)
        wrong = lost and there and case.made.seconds > 2.0
        failure = Failure(Fault.FALSE_ALARM, "Part0", "it was")
        return Result((failure,) if wrong else (), 0, 0, 0, ())

    monkeypatch.setattr(shrink, "run", accuses)
    monkeypatch.setattr(shrink, "is_valid", lambda plan: True)
    lost = (Lost("Part0", "/a", 1), Lost("Part1", "/a", 1))
    conditions = Conditions(delay_s=(0.0, 0.02), duplication=0.1, hosts={"Part1": "b"}, lost=lost)
    case = Case(SEED, 1, Circumstances(conditions, joins_s=1.0))
    smaller = shrink.shrunk(case, accuses(case).failures, 300.0)
    assert smaller.made.conditions == Conditions(lost=lost[:1])
    assert 2.0 < smaller.made.seconds < 2.5
    assert smaller.made.joins_s == 0
    plan = smaller.plan()
    assert [model.name for model in plan.models] == ["Part0"]
    assert plan.properties == ()


def test_what_raises_is_a_failure_and_ends_nothing(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch
) -> None:
    def go(trial: trials._Trial) -> None:
        raise RuntimeError("no more")

    monkeypatch.setattr(trials._Trial, "go", go)
    (failure,) = try_one(prepared, SEED, Circumstances()).failures
    assert failure.fault is Fault.RAISED
    assert "no more" in failure.text


def test_a_mutant_that_nobody_accuses_is_a_failure(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch
) -> None:
    def deaf(trial: trials._Trial, verdict: Verdict) -> None:
        if verdict.outcome is not Outcome.VIOLATED:
            trial.verdicts.append(verdict)

    all_mutants = enumerate(prepared.mutants_of("Part0"))
    places = [at for at, mutant in all_mutants if mutant.operator == "duplicated output"]
    nothing = msgspec.structs.replace(nominal(Random(1)), seconds=8.0)
    tried = (msgspec.structs.replace(nothing, faulty=Faulty("Part0", at)) for at in places)
    made, seeing = next(
        (m, r) for m in tried if (r := try_one(prepared, SEED, m)).detected is not None
    )
    assert seeing.detected
    assert not seeing.failures
    monkeypatch.setattr(trials._Trial, "take", deaf)
    blind = try_one(prepared, SEED, made)
    assert Fault.MISSED_MUTANT in {failure.fault for failure in blind.failures}


def test_what_a_recording_is_judged_is_compared(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def silent(trial: trials._Trial, verdict: Verdict) -> None:
        pass

    monkeypatch.setattr(trials._Trial, "take", silent)
    made = Circumstances(seconds=3.0)
    (failure,) = try_one(prepared, SEED, made, tmp_path / "run.mcap").failures
    assert failure.fault is Fault.DIFFERS
    assert (tmp_path / "run.mcap").exists()


@pytest.mark.parametrize("at_s", [2.0, 2.0102, 2.0231])
def test_a_policy_that_is_killed_ticks_no_more_and_nobody_is_blamed(at_s: float) -> None:
    """Between two ticks, or in the middle of one."""
    tour = Prepared(EXAMPLES / "lab_tour" / "system.xml")
    made = Circumstances(Conditions(kills=(Kill("policy", at_s, None),)), seconds=5.0)
    assert not try_one(tour, SEED, made).failures


def test_a_mutant_that_goes_on_showing_is_to_be_found_by_a_late_monitor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def deaf(trial: trials._Trial, verdict: Verdict) -> None:
        if verdict.outcome is not Outcome.VIOLATED:
            trial.verdicts.append(verdict)

    prepared = Prepared(EXAMPLES / "navigation" / "system.xml")
    (at,) = (
        at
        for at, mutant in enumerate(prepared.mutants_of("Dispatcher"))
        if mutant.description.endswith("robot_posee")
    )
    made = Circumstances(seconds=40.0, joins_s=1.0, faulty=Faulty("Dispatcher", at))
    seeing = try_one(prepared, SEED, made)
    assert seeing.detected
    assert not seeing.failures
    monkeypatch.setattr(trials._Trial, "take", deaf)
    blind = try_one(prepared, SEED, made)
    assert Fault.MISSED_LATE in {failure.fault for failure in blind.failures}


def test_violations_that_follow_closely_are_one_time_at_which_a_fault_shows() -> None:
    def at(stamp_ns: int) -> Verdict:
        return Verdict("m", "m", Outcome.VIOLATED, stamp_ns)

    found = [at(stamp_ns) for stamp_ns in (5, 90, 100, 108, 116, 130, 131)]
    assert truth.occurrences(found, 50, 10) == [90, 108, 130]


@pytest.mark.parametrize(
    ("then", "kind", "is_open"),
    [
        ('<final id="end"/>', ObservationKind.MESSAGE_TAKEN, True),
        ('<final id="end"/>', ObservationKind.MESSAGE, False),
        ("", ObservationKind.MESSAGE_TAKEN, False),
    ],
)
def test_who_sends_nothing_may_have_ended_where_its_model_can_end(
    then: str, kind: ObservationKind, is_open: bool
) -> None:
    machine = read(
        f"""<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Probe" initial="on">
          <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
          <ros_time_rate name="often" rate_hz="2"/>
          <state id="on"><ros_rate_callback name="often" target="{"end" if then else "on"}">
            <ros_topic_publish name="/out"><field name="data" expr="1"/></ros_topic_publish>
          </ros_rate_callback></state>
          {then}
        </scxml>"""
    )
    before, after = (
        Observation(
            stamp_ns=stamp_ns, received_ns=stamp_ns, channel="/out", kind=kind, source="Probe",
            type_name="std_msgs/msg/Int32", data=None,
        )
        for stamp_ns, kind in ((5, ObservationKind.MESSAGE), (15, kind))
    )  # fmt: skip
    assert truth.may_have_ended(machine, [before, after], 10) is is_open
