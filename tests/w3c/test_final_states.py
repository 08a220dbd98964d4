"""A machine that reaches a final state exits it and takes nothing more (W3C SCXML 3.7, appendix D)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.w3c.both import Both, probe, say

DATA = '<datamodel><data id="items" expr="[1]"/><data id="n" type="int32" expr="0"/></datamodel>'
FAILS = '<assign location="n" expr="items[7].x"/>'
GO = '<state id="a"><transition event="go" target="end"/></state>'
PARTS = (f"<onexit>{say(3)}</onexit>", f"<onentry>{say(1)}</onentry>", f"<onexit>{say(4)}</onexit>")


@pytest.mark.parametrize("start", ["", GO])
def test_its_exit_follows_its_entry(start: str, tmp_path: Path) -> None:
    both = Both(tmp_path, probe(f'{start}<final id="end">{"".join(PARTS)}</final>'))
    both.take("go", "go")
    assert both.said == [1, 3, 4]
    assert both.state == "end"


@pytest.mark.parametrize("failing", range(3))
def test_an_error_leaves_the_other_blocks_alone(failing: int, tmp_path: Path) -> None:
    parts = [
        part.replace("<ros", f"{FAILS}<ros", 1) if number == failing else part
        for number, part in enumerate(PARTS)
    ]
    both = Both(tmp_path, probe(f'{DATA}{GO}<final id="end">{"".join(parts)}</final>'))
    left = {0: [1, 4], 1: [3, 4], 2: [1, 3]}
    assert both.take("go") == left[failing]
    assert both.take("go") == []
