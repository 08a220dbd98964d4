"""The paper's six faults: what they change, and that they can be run in a node's place."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import pytest

from m2c.check import check_flow, check_types
from m2c.model import DiagnosticLog, Machine, System, load
from m2c.model.machine import State
from m2c.model.system import read_with_reference
from moon.properties.files import load_properties
from moon.properties.monitor import PropertySet
from tests.mutation import mutants
from tests.mutation.shape import Shapes

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
FAULTS = EXAMPLE / "faults"
MODULES = [path.stem for path in FAULTS.glob("*.py")]


@pytest.fixture
def inject() -> Iterator[Any]:
    yield from _imported("inject")


@pytest.fixture
def faults_run() -> Iterator[Any]:
    yield from _imported("run")


def _imported(name: str) -> Iterator[ModuleType]:
    """A script of the example, which finds the others beside it."""
    sys.path.insert(0, str(FAULTS))
    try:
        yield _module(name)
    finally:
        sys.path.remove(str(FAULTS))
        for other in MODULES:
            sys.modules.pop(other, None)


def _module(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, FAULTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _system() -> System:
    log = DiagnosticLog()
    system = load([EXAMPLE / "system.xml"], log)
    assert system is not None
    return system


def _faulty(path: Path, node: str, log: DiagnosticLog) -> Machine:
    machine = read_with_reference(path, _system(), node, log)
    assert machine is not None
    return machine


def test_the_catalogue_lists_the_six_of_the_paper(inject: Any) -> None:
    assert [item.id for item in inject.FAULTS] == ["T1", "T2", "T3", "T4", "T5", "T6"]
    assert [str(item.kind) for item in inject.FAULTS] == ["model"] * 4 + ["code"] * 2
    for item in inject.FAULTS:
        assert _system().node(item.node) is not None
        assert item.path.is_file()


@pytest.mark.parametrize("name", ["T1", "T2", "T3", "T4"])
def test_a_faulty_model_passes_the_check_and_differs_from_the_right_one(
    inject: Any, name: str
) -> None:
    chosen = inject.fault(name)
    log = DiagnosticLog()
    machine = _faulty(chosen.path, chosen.node, log)
    check_types(machine, _system().library, log)
    check_flow(machine, log)
    assert not log.has_errors, log.diagnostics
    right = _system().node(chosen.node)
    assert right is not None
    shapes = Shapes()
    assert shapes.of(machine) != shapes.of(right)
    ends = [(item.kind, item.channel, item.type_name) for item in machine.interfaces]
    assert ends == [(item.kind, item.channel, item.type_name) for item in right.interfaces]


@pytest.mark.parametrize("name", ["T1", "T2"])
def test_the_check_warns_of_the_models_that_never_answer(inject: Any, name: str) -> None:
    chosen = inject.fault(name)
    log = DiagnosticLog()
    check_flow(_faulty(chosen.path, chosen.node, log), log)
    assert "request-unanswered" in {found.rule for found in log.diagnostics}


@pytest.mark.parametrize("name", ["T1", "T2"])
def test_the_unresponsive_skills_differ_from_the_right_ones_in_one_target(
    inject: Any, name: str
) -> None:
    chosen = inject.fault(name)
    right = _system().node(chosen.node)
    assert right is not None
    shapes = Shapes()
    faulty = shapes.of(_faulty(chosen.path, chosen.node, DiagnosticLog()))
    made = [item.operator for item in mutants(right) if shapes.of(item.machine) == faulty]
    assert made == ["redirected transition"]


@pytest.mark.parametrize(("name", "state"), [("T3", "idle"), ("T4", "notifying")])
def test_the_random_skills_are_otherwise_as_the_right_ones(
    inject: Any, name: str, state: str
) -> None:
    chosen = inject.fault(name)
    right = _system().node(chosen.node)
    assert right is not None
    faulty = _faulty(chosen.path, chosen.node, DiagnosticLog())
    shapes = Shapes()
    one, other = (
        msgspec.structs.replace(machine, states=(_only(machine, state),), data=())
        for machine in (right, faulty)
    )
    assert shapes.of(one) == shapes.of(other)
    assert {item.name for item in right.data} < {item.name for item in faulty.data}


def _only(machine: Machine, state: str) -> State:
    return msgspec.structs.replace(machine.state(state), on_entry=())


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("T5", "/BatteryComponent/level", "/BatteryComponent/levle"),
        ("T6", "/BlackboardComponent/GetInt", "/BlackboardComponent/GetPoi"),
    ],
)
def test_a_fault_in_the_code_changes_one_channel_of_the_generated_node(
    inject: Any, tmp_path: Path, name: str, old: str, new: str
) -> None:
    chosen = inject.fault(name)
    package = inject.replacement(chosen, tmp_path)
    generated = inject.generated(chosen.node)
    (node,) = package.glob("*/node.py")
    changed = [
        (before, after)
        for path, text in generated.items()
        for before, after in zip(
            text.splitlines(), (package / path).read_text().splitlines(), strict=True
        )
        if before != after
    ]
    assert len(changed) == 1
    before, after = changed[0]
    assert before.replace(f'"{old}"', f'"{new}"') == after
    assert after in node.read_text().splitlines()
    compile(node.read_text(), str(node), "exec")


def test_a_patch_that_no_longer_fits_says_what_it_looked_for(inject: Any) -> None:
    chosen = inject.fault("T5")
    files = inject.generated(chosen.node)
    path = next(name for name in files if name.endswith("/node.py"))
    files[path] = files[path].replace("LEVEL = ", "CHARGE = ")
    with pytest.raises(inject.PatchError) as caught:
        inject.patched(files, chosen.path)
    assert re.match(
        r"T5-BatteryLevelSkill\.patch: does not fit the generated battery_level_skill/node\.py any "
        r"more: the text it replaces \(line \d+\) is not there:\n  LEVEL = Topic",
        str(caught.value),
    )


def test_a_file_that_is_no_patch_is_refused(inject: Any, tmp_path: Path) -> None:
    path = tmp_path / "broken.patch"
    path.write_text("--- a/x\n+++ b/x\n@@ -1 +1 @@\nwhat?\n")
    with pytest.raises(inject.PatchError, match=r"broken\.patch:4: not a line of a unified diff"):
        inject.read_patch(path)
    path.write_text("nothing\n")
    with pytest.raises(inject.PatchError, match="no hunk"):
        inject.read_patch(path)


def test_the_command_prints_what_replace_wants(tmp_path: Path) -> None:
    command = [sys.executable, str(FAULTS / "inject.py"), "T6", "-o", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"IsPoiDone1Skill={tmp_path / 'T6'}\n"
    assert (tmp_path / "T6" / "is_poi_done1_skill" / "__main__.py").is_file()


def test_the_table_in_the_readme_lists_every_fault_with_its_node(inject: Any) -> None:
    text = (FAULTS / "README.md").read_text()
    for item in inject.FAULTS:
        assert f"| {item.id} | {item.node} | {item.kind} |" in text


def test_every_fault_is_found_in_virtual_time_and_nobody_else_is_blamed() -> None:
    command = [sys.executable, str(FAULTS / "run.py"), "--transport", "simulated", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, done.stdout + done.stderr
    assert [row["id"] for row in rows] == ["nominal", "T1", "T2", "T3", "T4", "T5", "T6"]
    assert rows[0]["violated"] == []
    for row in rows[1:]:
        assert row["violated"] == [row["node"]]
        assert row["detected"], row
        assert (row["first"] is None) == (row["id"] in ("T1", "T2", "T5"))
        late_ms = row["after_deadline_ms"]
        if row["first"] is not None:
            assert row["first"]
            assert row["latency_ms"] <= 30
        elif late_ms is None:  # it took its next input without having answered
            assert row["id"] == "T1"
            assert row["latency_ms"] < 1000
        else:
            assert 0 <= late_ms <= 30


def test_a_faulty_node_is_found_on_zenoh(faults_run: Any) -> None:
    for name in ("T2", "T6"):
        chosen = faults_run.fault(name)
        run = faults_run.on_zenoh(chosen, _system(), 30.0)
        row = faults_run.judged(chosen, run)
        # how late depends on the machine that tests run on
        assert row.violated == (chosen.node,), row
        assert row.latency_ms is not None


def _heard(faults_run: Any) -> Any:
    return faults_run.simulated(faults_run.fault("T3"), _system(), 30.0)


def test_a_fault_that_nobody_reports_counts_as_missed(faults_run: Any) -> None:
    deaf = msgspec.structs.replace(_heard(faults_run), violations=())
    row = faults_run.judged(faults_run.fault("T3"), deaf)
    assert not row.detected
    assert row.problem.startswith("missed: FAILURE was answered with enough charge")


def test_a_fault_that_is_reported_late_or_early_counts_as_failed(faults_run: Any) -> None:
    run = _heard(faults_run)
    (said,) = run.violations
    for shift_ns, problem in (
        (400_000_000, "not the first wrong output, but one 400 ms later"),
        (-400_000_000, "blamed 400 ms before the first wrong output"),
    ):
        moved = msgspec.structs.replace(said.verdict, stamp_ns=said.verdict.stamp_ns + shift_ns)
        changed = msgspec.structs.replace(
            run, violations=(msgspec.structs.replace(said, verdict=moved),)
        )
        row = faults_run.judged(faults_run.fault("T3"), changed)
        assert (row.detected, row.problem) == (False, problem)


def test_who_is_blamed_without_a_fault_fails_the_run(faults_run: Any) -> None:
    run = _heard(faults_run)
    (said,) = run.violations
    other = msgspec.structs.replace(said.verdict, node="WaitSkill")
    both = msgspec.structs.replace(
        run, violations=(said, msgspec.structs.replace(said, verdict=other))
    )
    row = faults_run.judged(faults_run.fault("T3"), both)
    assert not row.detected
    reason = said.verdict.reason.splitlines()[0]
    assert row.problem == f"blamed without a fault: WaitSkill ({reason})"
    assert faults_run.judged_nominal(both).problem == (
        f"a false alarm: {said.verdict.node} ({reason}), WaitSkill ({reason})"
    )


def test_a_fault_that_never_shows_is_not_counted_as_found(faults_run: Any) -> None:
    run = faults_run.simulated(None, _system(), 2.0)
    assert faults_run.judged_nominal(run).detected
    for name in ("T3", "T4", "T5"):
        row = faults_run.judged(faults_run.fault(name), run)
        assert row.problem == "the fault never showed itself: nothing could be found"


TABLE = {
    "nominal": set(),
    "T1": {"P1", "P2"},
    "T2": {"P2", "P3", "A1"},
    "T3": {"P1"},
    "T4": {"A2"},
    "T5": {"P2"},
    "T6": {"A3"},
}
"""Which properties each fault breaks."""


def test_the_properties_find_in_virtual_time_what_they_should_and_nothing_else() -> None:
    command = [sys.executable, str(FAULTS / "run.py"), "--transport", "simulated"]
    done = subprocess.run(
        [*command, "--json", "--properties"], capture_output=True, text=True, check=False
    )
    rows = {row["id"]: row for row in map(json.loads, done.stdout.splitlines())}
    assert done.returncode == 0, done.stdout + done.stderr
    broken = {
        name: {cell["property"] for cell in row["properties"] if cell["broken"]}
        for name, row in rows.items()
    }
    assert broken == TABLE
    for row in rows.values():
        assert [cell["property"] for cell in row["properties"]][:3] == ["P1", "P2", "P3"]
        for cell in row["properties"]:
            # how long it waits before it asks, a turn of its timer, question and answer
            assert not cell["broken"] or 0 <= cell["delay_ms"] <= 30
    # what the paper's properties missed
    papers = {
        name: {cell["property"]: cell["paper"] for cell in rows[name]["properties"]}
        for name in ("T2", "T4", "T6")
    }
    assert papers["T2"]["P3"] == papers["T4"]["P1"] == papers["T4"]["P2"] == "no detection"
    assert papers["T6"]["P3"] == "no detection"


def test_moons_form_of_the_properties_means_the_same(faults_run: Any) -> None:
    first, second = (load_properties(EXAMPLE / f"properties.{kind}") for kind in ("yaml", "xml"))
    assert [item.name for item in first] == [item.name for item in second]
    assert [(item.text, item.severity) for item in first] == [
        (item.text, item.severity) for item in second
    ]
    for name in ("T2", "T4", "T6"):
        run = faults_run.simulated(faults_run.fault(name), _system(), 30.0, first)
        verdicts = []
        for properties in (first, second):
            monitor = PropertySet(properties)
            for seen in run.heard:
                monitor.observe(seen)
            verdicts.append(
                {key: (found.status, found.since_ns) for key, found in monitor.verdicts().items()}
            )
        assert verdicts[0] == verdicts[1]
        assert {key for key, (status, _) in verdicts[0].items() if status == "false"} == TABLE[name]


def test_a_property_that_finds_nothing_or_too_much_fails_the_run(faults_run: Any) -> None:
    properties = load_properties(EXAMPLE / "properties.yaml")
    chosen = faults_run.fault("T6")
    run = faults_run.simulated(chosen, _system(), 5.0, properties)
    row = faults_run.judged(chosen, run)
    assert faults_run.with_properties(row, chosen, run).is_well
    deaf = msgspec.structs.replace(run, broken=())
    missed = faults_run.with_properties(row, chosen, deaf)
    assert [cell.problem for cell in missed.properties if cell.problem] == [
        "A3 is not found broken"
    ]
    assert not missed.is_well
    other = faults_run.fault("T4")
    wrong = faults_run.with_properties(row, other, run)
    assert {cell.property for cell in wrong.properties if cell.problem} == {"A2", "A3"}
    nominal = faults_run.with_properties(faults_run.judged_nominal(deaf), None, run)
    assert [cell.property for cell in nominal.properties if cell.problem] == ["A3"]


def test_a_property_of_which_nothing_is_known_fails_the_run(faults_run: Any) -> None:
    properties = load_properties(EXAMPLE / "properties.yaml")
    run = faults_run.simulated(None, _system(), 5.0, properties)
    row = faults_run.judged_nominal(run)
    assert faults_run.with_properties(row, None, run).is_well
    unsure = msgspec.structs.replace(run, standing={**run.standing, "P3": "inconclusive"})
    (cell,) = [
        cell for cell in faults_run.with_properties(row, None, unsure).properties if cell.problem
    ]
    assert cell.problem == "nothing is known of P3: inconclusive"


@pytest.mark.zenoh
def test_a_run_in_which_nothing_is_ticked_ends(
    faults_run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever became of it, nobody waits for a tick that does not come."""
    processes = sys.modules["processes"]
    monkeypatch.setattr(processes, "START_S", 0.01)
    with pytest.raises(processes.RunError, match=r"no tick was received in 0.01 s; this monitor"):
        processes.on_zenoh(None, _system(), 30.0)


def test_the_readme_shows_the_lines_of_today() -> None:
    command = [sys.executable, str(FAULTS / "run.py"), "--transport", "simulated", "--brief"]
    first, *lines = subprocess.run(
        command, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    shown = "\n".join([first, *(f"  {line}" for line in lines)])
    assert shown in (EXAMPLE.parents[1] / "README.md").read_text(encoding="utf-8")


def test_a_few_lines_say_what_was_found_what_was_missed_and_who_was_accused(
    faults_run: Any,
) -> None:
    run = _heard(faults_run)
    t3 = faults_run.fault("T3")
    good = faults_run.judged(t3, run)
    assert faults_run.brief([good]) == [
        "The paper's faults: 1 of 1 found, no false alarm",
        "T3  BatteryLevelSkill  incorrect response   at first occurrence (2 ms)",
    ]
    missed = faults_run.judged(t3, msgspec.structs.replace(run, violations=()))
    accused = faults_run.judged_nominal(run)
    first, line = faults_run.brief([accused, missed])
    assert first == "The paper's faults: 0 of 1 found, FALSE ALARM: BatteryLevelSkill"
    assert line.endswith("NOT DETECTED (never)")
