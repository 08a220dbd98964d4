"""W3C's own tests of SCXML, as `@scion-scxml/test-framework` has them for ECMAScript.

``make scxml-tests`` brings them, or ``SCXML_TESTS`` says where they are.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog
from tests.w3c.both import Both
from tests.w3c.left_out import reason_of, rows

INSTALLED = "build/scxml-tests/test/w3c-ecma"
FOLDER = Path(os.environ.get("SCXML_TESTS") or Path(__file__).parents[2] / INSTALLED)
PAGE = Path(__file__).parents[2] / "docs/w3c-tests.md"
if not FOLDER.is_dir():
    pytest.skip("W3C's tests are not installed", allow_module_level=True)

PASSED = (
    *(
        144,
        147,
        148,
        149,
        150,
        151,
        153,
        155,
        158,
        175,
        176,
        185,
        186,
        189,
        205,
        208,
        287,
        323,
        355,
    ),
    *(375, 376, 377, 378, 396, 407, 415, 419, 423, 445, 449, 503, 560),
    *(193, 200, 348, 495),  # whose events name SCXML's own processor
    # compound states, history, In, data models in states
    *(278, 279, 372, 387, 388, 399, 409, 411, 412, 416, 421, 505, 506, 550, 551, 579, "403a"),
)
"""What needs only the language that is read here; all others are refused, but for those below."""
OTHERWISE = {
    159: "an event to a machine that is not there is an error of the run; here a warning before it",
    194: "the same",
}


def model(number: int | str) -> str:
    return (FOLDER / f"test{number}.txml.scxml").read_text(encoding="utf-8")


def expected(number: int | str) -> tuple[list[str], list[str]]:
    """The events that a test is sent, and the states that it ends in; 415 is a manual test."""
    path = FOLDER / f"test{number}.txml.json"
    if not path.exists():
        return [], ["final"]
    told = json.loads(path.read_text(encoding="utf-8"))
    steps = told["events"]
    last = steps[-1]["nextConfiguration"] if steps else told["initialConfiguration"]
    return [step["event"]["name"] for step in steps], last


@pytest.mark.parametrize("number", PASSED)
def test_generated_code_and_the_interpreter_pass(number: int | str, tmp_path: Path) -> None:
    events, ends = expected(number)
    both = Both(tmp_path, model(number))
    both.settle()
    both.take(*events)
    assert [both.state.rpartition("/")[2]] == ends


def refused(folder: Path) -> dict[str, list[str]]:
    """The tests that the check refuses, by reason; what is read is copied to ``folder``."""
    found: dict[str, list[str]] = {}
    for path in sorted(FOLDER.glob("test*.txml.scxml")):
        copy = folder / path.name
        copy.write_bytes(path.read_bytes())
        log = DiagnosticLog()
        read_and_check([copy], [], log)
        if log.has_errors:
            rules = {finding.rule for finding in log.diagnostics}
            reason = reason_of(path.read_text(encoding="utf-8"), rules)
            found.setdefault(reason, []).append(path.name.partition(".")[0].removeprefix("test"))
    return found


def test_what_is_not_passed_is_refused_and_why_is_documented(tmp_path: Path) -> None:
    found = refused(tmp_path)
    stems = {
        path.name.partition(".")[0].removeprefix("test") for path in FOLDER.glob("test*.scxml")
    }
    names = {name for name in stems if "sub" not in name}  # those are invoked by others
    accepted = names - {name for group in found.values() for name in group}
    assert accepted == {str(number) for number in (*PASSED, *OTHERWISE)}
    assert [line for line in PAGE.read_text().splitlines() if line in set(rows(found))] == list(
        rows(found)
    )
