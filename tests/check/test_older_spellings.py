"""What is written as an earlier version or another tool has it is read, and a note says as what."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main
from m2c.model.loading import current_input_type

NS = 'xmlns="http://www.w3.org/2005/07/scxml"'
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">{0}</BehaviorTree></root>'
SUB = '<BehaviorTree ID="Sub"><AlwaysSuccess/></BehaviorTree>'


def notes(path: Path) -> list[str]:
    """The notes on spellings, with their places in the file; nothing is an error."""
    result = CliRunner().invoke(main, ["check", "--format", "json", str(path)])
    found = json.loads(result.output)
    assert [item for item in found if item["severity"] == "error"] == []
    return [
        f"{item['line']}:{item['column']} {item['message']}"
        for item in found
        if item["rule"] == "older-spelling"
    ]


def machine(body: str, before: str = "", name: str = "M") -> str:
    return f'<scxml {NS} name="{name}" initial="a">\n{before}\n<state id="a">{body}</state></scxml>'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            machine('<transition event="bt_tick"><bt_return_status status="SUCCESS"/></transition>'),
            ["3:34 `bt_tick` is read as <bt_tick>"],
        ),
        (
            machine('<bt_halt><send event="bt_halt_response"/></bt_halt>'),
            ["3:37 `bt_halt_response` is read as <bt_return_halted>"],
        ),
        (
            machine("", '<ros_service_client service="/s" type="std_srvs/Empty"/>'),
            ["2:30 `service` is read as `service_name`"],
        ),
        (
            machine('<onentry><log expr=" False || !True"/></onentry>'),
            ["3:36 `False` is read as `false`", "3:46 `True` is read as `true`"],
        ),
        (
            machine('<transition event="CMD_HALT CMD_HALT"/>', name="FillAction"),
            ["1:1 `FillAction` is read as the skill `Fill`", "3:15 `CMD_HALT` is read as a request to /Fill/halt"],
        ),
        (
            machine("<q:onentry/><q:onexit/>"),
            ["3:15 `q:onentry` is read as `onentry`"],
        ),
        (machine('<onentry><log expr="true"/></onentry>'), []),
    ],
)  # fmt: skip
def test_a_model_s_spelling_is_noted(text: str, expected: list[str], tmp_path: Path) -> None:
    path = tmp_path / "m.scxml"
    path.write_text(text)
    assert notes(path) == expected


def test_a_system_s_spellings_are_noted_and_fail_nothing(tmp_path: Path) -> None:
    publisher = '<ros_topic_publisher topic="/t" type="std_msgs/Empty"/>'
    publish = '<onentry><ros_topic_publish name="/t"/></onentry>'
    (tmp_path / "m.ascxml").write_text(machine(publish, publisher).replace("scxml ", "ascxml ", 1).replace("/scxml>", "/ascxml>"))  # fmt: skip
    path = tmp_path / "system.xml"
    path.write_text(
        '<convince_mc_tc>\n<mc_parameters><bt_tick_rate value="5"/></mc_parameters>\n<node_models>\n'
        '<input type="ascxml" src="m.ascxml"/></node_models>\n'
        '<qos><topic name="/t" latched="true"/></qos>\n</convince_mc_tc>'
    )
    assert notes(path) == [
        "1:1 `convince_mc_tc` is read as `roaml`",
        "2:1 `mc_parameters` is read as `parameters`",
        f"4:14 `ascxml` is read as `{current_input_type('ascxml')}`",
        '5:32 `latched="true"` is read as `durability="transient_local"`',
    ]
    result = CliRunner().invoke(main, ["check", "--strict", str(path)])
    assert result.exit_code == 0, result.output
    assert result.output.count(": note: ") == 4


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        ("<SequenceStar><AlwaysSuccess/></SequenceStar>", "`SequenceStar` is read as `SequenceWithMemory`"),
        ('<SubTreePlus ID="Sub"/>', "`SubTreePlus` is read as `SubTree`"),
        ('<SubTree ID="Sub" __autoremap="1"/>', "`__autoremap` is read as `_autoremap`"),
    ],
)  # fmt: skip
def test_a_policy_s_spelling_is_noted(tree: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    text = TREE.format(tree).replace("</root>", f"{SUB}</root>")
    path.write_text(text.replace("<root ", '<root main_tree_to_execute="Main" '))
    assert [note.partition(" ")[2] for note in notes(path)] == [expected]


def test_what_convert_writes_has_no_older_spelling(tmp_path: Path) -> None:
    path = tmp_path / "m.scxml"
    body = '<transition event="CMD_TICK" cond="True"><send event="TICK_RESPONSE"/></transition>'
    path.write_text(machine(body, name="FillCondition"))
    assert len(notes(path)) == 4
    CliRunner().invoke(main, ["convert", str(path), "-o", str(tmp_path / "out")])
    assert notes(tmp_path / "out" / "m.ascxml") == []
