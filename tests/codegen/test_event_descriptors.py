"""An event descriptor names an event and all that are more specific (W3C SCXML 3.12.1)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.codegen.harness import Generated

MODEL = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript"
    name="Descriptors" initial="begin">
  <datamodel><data id="list" expr="[1]"/><data id="text" expr="'a'"/></datamodel>
  <state id="begin">
    <transition event="go" target="trying"><raise event="{raised}"/></transition>
  </state>
  <state id="trying"><transition event="{taken}" target="there"/></state>
  <state id="there"/>
</scxml>"""


@pytest.mark.parametrize(
    ("taken", "raised", "arrives"),
    [
        ("e", "e", True),
        ("e", "e.f", True),
        ("e.*", "e.f", True),
        ("e.", "e.f.g", True),
        ("e", "ef", False),
        ("e.f", "e", False),
        ("*", "anything", True),
        ("error", "error.mine", True),
    ],
)
def test_a_descriptor_takes_what_begins_with_its_tokens(
    tmp_path: Path, taken: str, raised: str, arrives: bool
) -> None:
    generated = Generated(tmp_path, MODEL.format(taken=taken, raised=raised))
    generated.it.on_event("go")
    assert (generated.it.state.value == "there") is arrives


def test_error_takes_a_failed_expression(tmp_path: Path) -> None:
    text = MODEL.format(taken="error", raised="other").replace(
        '<raise event="other"/>', '<assign location="text" expr="list[3].x"/>'
    )
    generated = Generated(tmp_path, text)
    generated.it.on_event("go")
    assert generated.it.state.value == "there"
