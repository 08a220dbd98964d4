"""An output port that writes a number to what a node declares as text ends the run: it is an error."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog

PLUGIN = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Set">
<bt_declare_port_out key="out" type="{kind}"/>
<state id="a"><bt_tick><bt_set_output key="out" expr="{value}"/><bt_return_status status="SUCCESS"/></bt_tick>
</state></scxml>"""
SYSTEM = """<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/>
<input type="bt-plugin-ascxml" src="set.scxml"/></behavior_tree></roaml>"""
SET = '<Action ID="Set" out="{level}"/>'
SWITCH = '<Switch2 variable="{level}" case_1="1" case_2="2"><AlwaysSuccess/><AlwaysSuccess/><AlwaysFailure/></Switch2>'
SUB = '</BehaviorTree><BehaviorTree ID="Sub">'


def errors(folder: Path, tree: str, kind: str = "int32", value: str = "1") -> list[str]:
    (folder / "system.xml").write_text(SYSTEM)
    (folder / "set.scxml").write_text(PLUGIN.format(kind=kind, value=value))
    (folder / "policy.xml").write_text(
        f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{tree}</BehaviorTree></root>'
    )
    log = DiagnosticLog()
    read_and_check([folder / "system.xml"], [], log)
    return [f"{item.rule}: {item.message}" for item in log.diagnostics if item.severity == "error"]


@pytest.mark.parametrize(
    "tree",
    [
        f"<Sequence>{SWITCH}{SET}</Sequence>",
        f"<Sequence>{SET}{SWITCH}</Sequence>",
        f'<Sequence>{SET}<Delay delay_msec="5">{SWITCH}</Delay></Sequence>',
        f'<Sequence>{SET}<SubTree ID="Sub" _autoremap="true"/></Sequence>{SUB}{SWITCH}',
        f'<Sequence>{SWITCH}<SubTree ID="Sub" one="{{level}}"/></Sequence>{SUB}{SET.replace("level", "one")}',
        f'<Sequence>{SWITCH}<SubTree ID="Sub"/></Sequence>{SUB}{SET.replace("level", "@level")}',
    ],
)
def test_a_number_for_an_entry_of_text_is_an_error(tmp_path: Path, tree: str) -> None:
    (found,) = errors(tmp_path, tree)
    assert found.startswith("leaf-port: the port `out` writes int to the entry `")
    assert "which is text to the <Switch2> at 1:" in found


@pytest.mark.parametrize(
    "tree",
    [
        f'<Sequence>{SET}{SWITCH.replace("level", "other")}<Script code="other := 1"/></Sequence>',
        f'<Sequence>{SET}<SubTree ID="Sub"/></Sequence>{SUB}{SWITCH}',
        f'<Sequence>{SET}<SubTree ID="Sub" level="{{own}}"/></Sequence>{SUB}{SWITCH}',
    ],
)
def test_another_entry_is_none(tmp_path: Path, tree: str) -> None:
    assert errors(tmp_path, tree) == []


def test_text_for_an_entry_of_text_is_none(tmp_path: Path) -> None:
    assert errors(tmp_path, f"<Sequence>{SET}{SWITCH}</Sequence>", "string", "'1'") == []
