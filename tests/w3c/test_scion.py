"""SCION's own tests of SCXML, beside W3C's in `@scion-scxml/test-framework`."""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog
from tests.w3c.both import Both
from tests.w3c.test_conformance import FOLDER

PATHS = [
    path
    for path in sorted(FOLDER.parent.glob("*/*.scxml"))
    if path.parent.name != FOLDER.name and path.with_suffix(".json").exists()
]
if not PATHS:
    pytest.skip("SCION's tests are not installed", allow_module_level=True)
REFUSED = {
    **dict.fromkeys(
        ("assign/assign_invalid", "data/data_invalid", "error/error"), "not an expression, a script"
    ),
    **dict.fromkeys(("assign/assign_obj_literal", "data/data_obj_literal"), "JSON.stringify"),
    **dict.fromkeys(("send-data/send1", "send-internal/test0"), "eventexpr"),
    "send-idlocation/test0": "idlocation",
    "misc/deep-initial": "_sessionid",
    "internal-transitions/test0": "a transition of the machine itself, which SCXML does not have",
}
"""What needs neither parallel states nor scripts, and something else that is refused."""


def name_of(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def with_senders(text: str, events: Collection[str]) -> str:
    """``text`` with a state that nobody enters and that sends ``events``: a machine knows what it is sent."""
    sends = "".join(f'<send event="{event}" delay="1s"/>' for event in sorted(events))
    state = f'<state id="of_others"><onentry>{sends}</onentry></state>'
    return text.replace("</scxml>", f"{state}</scxml>") if events else text


@pytest.mark.parametrize("path", PATHS, ids=map(name_of, PATHS))
def test_generated_code_and_the_interpreter_pass_or_the_model_is_refused(
    path: Path, tmp_path: Path
) -> None:
    copy = tmp_path / path.name
    copy.write_bytes(path.read_bytes())
    log = DiagnosticLog()
    read_and_check([copy], [], log)
    text = path.read_text(encoding="utf-8")
    needs_more = "<parallel" in text or "<script" in text or name_of(path) in REFUSED
    assert log.has_errors == needs_more
    if needs_more:
        return
    told = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    both = Both(tmp_path, with_senders(text, {step["event"]["name"] for step in told["events"]}))
    both.wait(0.0)
    found, expected = [both.state], [told["initialConfiguration"]]
    for step in told["events"]:
        both.wait(step.get("after", 0) / 1000)
        both.send(step["event"]["name"], step["event"].get("data"))
        found.append(both.state)
        expected.append(step["nextConfiguration"])
    assert [[state.rpartition("/")[2]] for state in found] == expected
