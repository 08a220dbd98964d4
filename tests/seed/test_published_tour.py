"""The published case study: every model of it goes through check, generate and a run."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from m2c.check import check_system
from m2c.check.types import check_types
from m2c.model import DiagnosticLog, Severity, System, load
from m2c.model.system import read_with_reference
from m2c.policy.program import read_policy

SEED = Path(__file__).parents[3] / "shared" / "seed_models" / "lab_tour"
pytestmark = [
    pytest.mark.seed,
    pytest.mark.skipif(
        not SEED.is_dir(), reason="the published models are not beside the checkout"
    ),
]


def errors(log: DiagnosticLog) -> list[str]:
    return [str(found) for found in log.diagnostics if found.severity is Severity.ERROR]


def read(path: Path) -> System:
    log = DiagnosticLog()
    system = load([path], log)
    assert system is not None
    assert errors(log) == []
    return system


@pytest.mark.parametrize("folder", ["skills", "components", "plugins"])
def test_every_published_model_is_accepted(folder: str) -> None:
    log = DiagnosticLog()
    system = load([SEED / folder], log)
    assert system is not None
    check_system(system, log)
    assert errors(log) == []
    assert len(system.nodes) == len(list((SEED / folder).glob("*.scxml")))


@pytest.mark.parametrize(
    "policy", ["Policy.xml", "Policy_battery.xml", "Policy_monitored_btcpp3.xml"]
)
def test_every_published_policy_is_read(policy: str) -> None:
    system = read(SEED / "policies" / "main.xml")
    log = DiagnosticLog()
    assert read_policy(SEED / "policies" / policy, system, log) is not None
    assert errors(log) == []


@pytest.mark.parametrize(
    ("fault", "node", "place"),
    [
        ("T1-BatteryLevelSkillSM", "BatteryLevelSkill", "20:49"),
        ("T3-BatteryLevelSkillSM", "BatteryLevelSkill", "19:49"),
        ("T5-BatteryLevelSkillSM", "BatteryLevelSkill", "13:49"),
    ],
)
def test_a_faulty_skill_that_reads_a_missing_field_is_refused(
    fault: str, node: str, place: str
) -> None:
    system = read(SEED / "policies" / "main.xml")
    path = SEED / "faulty_skills" / f"{fault}.scxml"
    log = DiagnosticLog()
    machine = read_with_reference(path, system, node, log)
    assert machine is not None
    check_types(machine, system.library, log)
    assert errors(log) == [
        f"{path}:{place}: error: <assign>: std_msgs/msg/Int32 has no field `percentage`; known: data "
        "[unknown-field]"
    ]


@pytest.mark.parametrize(
    ("fault", "node"),
    [
        ("T2-SetPoi1SkillSM", "SetPoi1Skill"),
        ("T4-AlarmSkillSM", "AlarmSkill"),
        ("T6-IsPoiDone1SkillSM", "IsPoiDone1Skill"),
    ],
)
def test_a_faulty_skill_that_is_a_well_formed_model_is_accepted(fault: str, node: str) -> None:
    system = read(SEED / "policies" / "main.xml")
    log = DiagnosticLog()
    path = SEED / "faulty_skills" / f"{fault}.scxml"
    machine = read_with_reference(path, system, node, log)
    assert machine is not None
    check_types(machine, system.library, log)
    assert errors(log) == []
    assert machine.name == node


def free_endpoint() -> str:
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.mark.slow
@pytest.mark.zenoh
@pytest.mark.parametrize("replacement", [None, "T4-AlarmSkillSM", "T6-IsPoiDone1SkillSM"])
def test_the_published_system_runs_on_zenoh(replacement: str | None) -> None:
    arguments = []
    if replacement is not None:
        node = replacement[3:].removesuffix("SM")
        arguments = ["--replace", f"{node}={SEED / 'faulty_skills' / replacement}.scxml"]
    m2c = Path(sys.executable).parent / "m2c"
    run = [str(m2c), "run", str(SEED / "policies" / "main.xml"), "--ticks", "10"]
    done = subprocess.run(
        [*run, "--endpoint", free_endpoint(), *arguments],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "17 nodes are up" in done.stdout
    assert "tick   10" in done.stdout
