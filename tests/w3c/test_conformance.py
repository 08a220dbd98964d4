"""W3C's own tests of SCXML, as `@scion-scxml/test-framework` has them for ECMAScript.

``npm install @scion-scxml/test-framework`` beside the tests, or ``SCXML_TESTS`` says where they are.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog
from tests.w3c.both import Both

INSTALLED = "node_modules/@scion-scxml/test-framework/test/w3c-ecma"
FOLDER = Path(os.environ.get("SCXML_TESTS") or Path(__file__).parents[2] / INSTALLED)
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
    # compound states, history, In, data models in states
    *(278, 279, 372, 387, 388, 399, 409, 411, 412, 416, 421, 505, 506, 550, 551, 579),
)
"""What needs only the language that is read here; all others are refused, but for those below."""
OTHERWISE = {
    159: "an event to a machine that is not there is an error of the run; here a warning before it",
    194: "the same",
}


def model(number: int) -> str:
    return (FOLDER / f"test{number}.txml.scxml").read_text(encoding="utf-8")


def expected(number: int) -> tuple[list[str], list[str]]:
    """The events that a test is sent, and the states that it ends in; 415 is a manual test."""
    path = FOLDER / f"test{number}.txml.json"
    if not path.exists():
        return [], ["final"]
    told = json.loads(path.read_text(encoding="utf-8"))
    steps = told["events"]
    last = steps[-1]["nextConfiguration"] if steps else told["initialConfiguration"]
    return [step["event"]["name"] for step in steps], last


@pytest.mark.parametrize("number", PASSED)
def test_generated_code_and_the_interpreter_pass(number: int, tmp_path: Path) -> None:
    events, ends = expected(number)
    both = Both(tmp_path, model(number))
    both.settle()
    both.take(*events)
    assert [both.state.rpartition("/")[2]] == ends


def test_what_is_not_passed_is_refused(tmp_path: Path) -> None:
    accepted = []
    for path in sorted(FOLDER.glob("test*.txml.scxml")):
        copy = tmp_path / path.name
        copy.write_bytes(path.read_bytes())
        log = DiagnosticLog()
        read_and_check([copy], [], log)
        name = path.name.partition(".")[0].removeprefix("test")
        if not log.has_errors and name.isdigit():
            accepted.append(int(name))
    assert sorted(accepted) == sorted((*PASSED, *OTHERWISE))
