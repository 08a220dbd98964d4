"""Two systems are the same if nothing but places and spellings differs; else the first other part is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.convert.comparison import first_difference
from m2c.model import DiagnosticLog, Position, System, load

MODEL = """\
<{root} xmlns="http://www.w3.org/2005/07/scxml" name="M" initial="a">
<datamodel><data id="n" type="float64" expr="{value}"/></datamodel>
<state id="a"><onentry><log label="{label}" expr="n"/></onentry>
<transition event="{event}" target="{target}"/></state>
<state id="b"/></{root}>
"""
USUAL = {"root": "scxml", "value": "1", "label": "l", "event": "e", "target": "b"}


def system(folder: Path, **changed: str) -> System:
    path = folder / "m.scxml"
    path.write_text(MODEL.format(**(USUAL | changed)))
    found = load([path], DiagnosticLog())
    assert found is not None
    return found


def place(one: System, other: System) -> str | None:
    found = first_difference(one, other, Position("whole"))
    return None if found is None else f"{found.line}:{found.column}"


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"root": "ascxml"}, None),
        ({"value": " 1"}, None),
        ({"value": "2"}, "2:46"),
        ({"value": "true"}, "2:46"),
        ({"label": "other"}, "3:24"),
        ({"event": "other"}, "4:1"),
        ({"target": "a"}, "4:1"),
        ({"event": "e other"}, "3:1"),
    ],
)
def test_a_difference_in_meaning_has_its_place(
    changed: dict[str, str], expected: str | None, tmp_path: Path
) -> None:
    assert place(system(tmp_path), system(tmp_path, **changed)) == expected


def test_what_is_no_number_is_the_same_as_itself(tmp_path: Path) -> None:
    assert place(system(tmp_path, value="NaN"), system(tmp_path, value="NaN")) is None


def test_a_system_that_could_not_be_read_again_is_another(tmp_path: Path) -> None:
    assert first_difference(system(tmp_path), None, Position("whole")) == Position("whole")
