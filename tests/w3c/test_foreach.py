"""``<foreach>``: W3C SCXML 4.6 and its tests 150 to 156 and 525."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model.walk import statements_of
from tests.model.test_reader_messages import findings
from tests.mutation.places import blocks
from tests.oracle.machines import read
from tests.w3c.both import Both, probe, say

DATA = """<datamodel><data id="items" type="int32[]" expr="[4, 5, 6]"/><data id="mixed" expr="[1, 2]"/>
<data id="rows" type="geometry_msgs/Point[]" expr="[{'x': 1}, {'x': 2}]"/><data id="none" type="int32[]"/>
<data id="n" type="int32" expr="0"/><data id="word" expr="'ab'"/><data id="small" type="int8" expr="0"/>
<data id="grid" expr="[[1, 2], [3], []]"/></datamodel>"""


def loop(content: str, array: str = "items", item: str = "it", index: str = "") -> str:
    place = f' index="{index}"' if index else ""
    return f'<foreach array="{array}" item="{item}"{place}>{content}</foreach>'


def said(folder: Path, content: str) -> list[int]:
    errors = f'<transition event="error.execution">{say(99)}</transition>'
    state = f'<state id="a"><onentry>{content}</onentry>{errors}</state>'
    return Both(folder, probe(DATA + state)).said


LOOPS = {
    "declares its variables (150, 151)": (loop(say("it + at"), index="at"), [4, 6, 8]),
    "takes declared ones": (loop(say("n"), item="n"), [4, 5, 6]),
    "keeps what it left": (loop("", item="n", index="small") + say("n * 10 + small"), [62]),
    "counts where nothing is done (155)": (loop('<assign location="n" expr="n + it"/>') + say("n"), [15]),
    "of nothing": (loop(say("it"), "none") + say("7"), [7]),
    "of a literal": (loop(say("it"), "[3, 1]"), [3, 1]),
    "of what has no type": (loop(say("it"), "mixed"), [1, 2]),
    "of structures": (loop(say("it.x * 2"), "rows"), [2, 4]),
    "in another": (loop(loop(say("it * 10 + each"), "[0, 1]", "each")), [40, 41, 50, 51, 60, 61]),
    "of arrays": (loop(loop(say("cell"), "row", "cell"), "grid", "row"), [1, 2, 3]),
    "of a copy (525)": (
        loop('<assign location="items[items.length]" expr="it"/>') + say("items.length"), [6],
    ),
    "changes no element": (
        loop('<assign location="it.x" expr="9"/>', "rows") + say("rows[0].x"), [1],
    ),
    "ends at an error (156)": (loop(say("it") + '<assign location="n" expr="items[9].x"/>') + say(8), [4, 99]),
    "of no array (152)": (say(1) + loop(say("it"), "mixed[0]") + say(2), [1, 99]),
    "of what fails": (loop(say("it"), "mixed[7].x") + say(2), [99]),
    "whose item does not fit": (loop(say("small"), "[1, 'x']", "small"), [1, 99]),
    "raises events": (loop('<raise event="e"/>') + say(1), [1]),
    "under a condition": (loop(f'<if cond="it % 2 == 0">{say("it")}<else/>{say("-it")}</if>'), [4, -5, 6]),
}  # fmt: skip


@pytest.mark.parametrize("which", LOOPS)
def test_a_loop(which: str, tmp_path: Path) -> None:
    content, expected = LOOPS[which]
    assert said(tmp_path, content) == expected


def test_an_event_s_array_is_looped_over(tmp_path: Path) -> None:
    take = f'<transition event="go">{loop(say("it"), "_event.data.items")}</transition>'
    both = Both(tmp_path, probe(f'<state id="a">{take}</state>'))
    assert both.take("go", data={"items": [3, 4]}) == [3, 4]
    assert both.take("go", data={"items": 3}) == []


FAULTS = [
    ('<foreach item="x"/>', "`array` is missing"),
    ('<foreach array="items"/>', "`item` is missing"),
    ('<foreach array="n" item="x"/>', "a value of type int32 where an array is needed"),
    ('<foreach array="word" item="x"/>', "a value of type string where an array is needed"),
    ('<foreach array="items" item="items[0]"/>', "`items[0]` is not a variable"),
    ('<foreach array="items" item="x" index="x.y"/>', "`x.y` is not a variable"),
    ('<foreach array="items" item="word"/>', "a value of type int32 where string is declared"),
    ('<foreach array="items" item="x" index="word"/>', "a value of type int64 where string is declared"),
    ('<foreach array="items" item="x" at="y"/>', "unknown attribute `at`"),
    ('<foreach array="lisst" item="x"/>', "`lisst` is not declared"),
    ('<foreach array="items" item="if"/>', "if"),
    ('<foreach array="items" item="x"><transition/></foreach>', "not an element of <executable content>"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "what"), FAULTS)
def test_a_faulty_loop_is_one_error(text: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "Probe.scxml"
    path.write_text(probe(f'{DATA}<state id="a"><onentry>{text}</onentry></state>'))
    errors = [line for line in findings(path) if " error: " in line]
    assert len(errors) == 1
    assert what in errors[0]


def test_what_stands_in_a_loop_is_a_statement_like_any_other() -> None:
    inner = loop(loop(say("each"), "[1]", "each"))
    machine = read(probe(f'{DATA}<state id="a"><onentry>{inner}</onentry></state>'))
    assert [type(item).__name__ for item in statements_of(machine)] == [
        "Foreach",
        "Foreach",
        "Emit",
    ]
    assert len([place for place in blocks(machine) if place.part]) == 3
