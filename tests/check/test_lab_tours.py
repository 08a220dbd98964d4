"""The check on whole systems: nothing on our tour, the known faults in the published one."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog, load

ROOT = Path(__file__).parents[2]
SEED = ROOT.parent / "shared" / "seed_models" / "lab_tour"
published = pytest.mark.skipif(
    not SEED.is_dir(), reason="the published models are not beside the checkout"
)
FLOW = (
    *("request-discarded", "request-unanswered", "unreachable-state", "shadowed-transition"),
    *("never-taken", "eventless-cycle", "unread-input", "unused-interface", "nobody-serves"),
)


def findings(folder: Path, *paths: str, rules: tuple[str, ...] = ()) -> list[str]:
    log = DiagnosticLog()
    system = load([folder / path for path in paths], log)
    assert system is not None
    check_system(system, log)
    return sorted(
        f"{Path(found.position.file).name}:{found.position.line} {found.rule}"
        for found in log.diagnostics
        if not rules or found.rule in rules
    )


def test_nothing_is_found_in_our_tour() -> None:
    assert findings(ROOT / "examples" / "lab_tour", "system.xml") == []
    assert findings(ROOT / "examples" / "lab_tour", "skills", "components") == []


@published
def test_what_is_found_in_the_published_tour_is_there() -> None:
    # skills that call a service and discard the next tick meanwhile; a tick handler in a state that
    # is left at once
    found = findings(SEED, "skills", "components", "plugins", rules=FLOW)
    assert {text.split()[1] for text in found} == {"request-discarded", "shadowed-transition"}
    assert [text for text in found if "shadowed" in text] == [
        "BatteryLevelSkill.scxml:41 shadowed-transition"
    ]
    assert len(found) == 13


@published
@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        # the target of the tick was dropped: it is never answered
        ("T1-BatteryLevelSkillSM", "T1-BatteryLevelSkillSM.scxml:17 request-unanswered"),
        ("T2-SetPoi1SkillSM", "T2-SetPoi1SkillSM.scxml:13 request-unanswered"),
    ],
)
def test_a_published_fault_is_found_before_it_runs(fault: str, expected: str) -> None:
    assert expected in findings(SEED, f"faulty_skills/{fault}.scxml", "components")
