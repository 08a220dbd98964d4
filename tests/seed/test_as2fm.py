"""The systems that AS2FM publishes: m2c check accepts them as they are, or says why not."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog, Severity

SEED = Path(__file__).parents[3] / "shared" / "as2fm"
pytestmark = [
    pytest.mark.seed,
    pytest.mark.skipif(not SEED.is_dir(), reason="AS2FM's systems are not beside the checkout"),
]


class Refused(msgspec.Struct, frozen=True):
    """Why a system is not accepted, and the rules that say so."""

    why: str
    rules: frozenset[str]


REFUSED = {
    "systems/string_msg_comparison/main.xml": Refused(
        "its own fault: the publisher and the subscriber of a topic declare different types",
        frozenset({"type-disagreement", "unknown-field"}),
    ),
}
"""The systems that are not accepted; all others are."""
SYSTEMS = sorted(str(path.relative_to(SEED)) for path in SEED.rglob("main*.xml"))


def test_all_systems_are_looked_at() -> None:
    assert len(SYSTEMS) == 49
    assert set(REFUSED) <= set(SYSTEMS)


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_published_system_is_accepted_unless_it_is_listed_here(name: str) -> None:
    log = DiagnosticLog()
    read_and_check([SEED / name], [], log)
    errors = [found for found in log.diagnostics if found.severity is Severity.ERROR]
    expected = REFUSED[name].rules if name in REFUSED else frozenset()
    assert {found.rule for found in errors} == expected, "\n".join(map(str, errors))


def test_the_system_with_a_fault_of_its_own_is_told_which() -> None:
    log = DiagnosticLog()
    read_and_check([SEED / "systems/string_msg_comparison/main.xml"], [], log)
    found = next(item for item in log.diagnostics if item.rule == "type-disagreement")
    assert found.message == (
        "string_receive declares /str_topic as nested_interfaces/msg/Internal, string_send as "
        "example_interfaces/msg/String"
    )
