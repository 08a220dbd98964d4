"""Expressions are ECMAScript; a model in another language is refused as a whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.model.test_reader_messages import findings

MODEL = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="M" {0}>
<datamodel><data id="x" expr="1"/></datamodel><state id="a"><transition event="e" cond="{1}"/></state></scxml>"""


@pytest.mark.parametrize(
    "name", ["lua", "xpath", "python", "cplusplus:Data:data.h", "jexl", "x" * 500]
)
def test_another_language_is_one_error(name: str, tmp_path: Path) -> None:
    path = tmp_path / "M.scxml"
    path.write_text(MODEL.format(f'datamodel="{name}"', "x ~= 1 and not y"))
    shown = name if len(name) <= 80 else f"{name[:80]}…"
    assert findings(path) == [
        f"1:68: error: <scxml>: the data model `{shown}` is not part of the language; write expressions in "
        'ECMAScript, and datamodel="ecmascript" [unsupported-element]'
    ]


@pytest.mark.parametrize(
    "given", ["", 'datamodel=""', 'datamodel="ecmascript"', 'datamodel="ECMAScript"']
)
def test_ecmascript_need_not_be_named(given: str, tmp_path: Path) -> None:
    path = tmp_path / "M.scxml"
    path.write_text(MODEL.format(given, "x == 1"))
    assert findings(path) == []
