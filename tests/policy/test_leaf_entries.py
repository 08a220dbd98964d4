"""A port that reads an entry of the blackboard that nothing sets is a warning; no other port is."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog

PLUGIN = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="{name}">
<bt_declare_port_{way} key="limit" type="int32"/>
<state id="a"><bt_tick>{body}<bt_return_status status="SUCCESS"/></bt_tick></state></scxml>"""
SYSTEM = """<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/>
<input type="bt-plugin-ascxml" src="get.scxml"/><input type="bt-plugin-ascxml" src="set.scxml"/>
</behavior_tree></roaml>"""
GET = '<Action ID="Get" name="Get" limit="{limit}"/>'
SUB = '</BehaviorTree><BehaviorTree ID="Sub">'


def warnings(folder: Path, tree: str) -> list[str]:
    (folder / "system.xml").write_text(SYSTEM)
    (folder / "get.scxml").write_text(PLUGIN.format(name="Get", way="in", body=""))
    value = '<bt_set_output key="limit" expr="1"/>'
    (folder / "set.scxml").write_text(PLUGIN.format(name="Set", way="out", body=value))
    (folder / "policy.xml").write_text(
        f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{tree}</BehaviorTree></root>'
    )
    log = DiagnosticLog()
    read_and_check([folder / "system.xml"], [], log)
    assert not log.has_errors, log.diagnostics
    return [f"{item.message}; {item.hint}" for item in log.diagnostics if item.rule == "unset-port"]


@pytest.mark.parametrize(
    ("tree", "hint"),
    [
        (GET, "write a value, or set it: <SetBlackboard>, <Script> or an output port"),
        (
            f'<Sequence><Action ID="Set" limit="{{limits}}"/>{GET}</Sequence>',
            "did you mean limits?",
        ),
        (
            f'<Sequence>{GET}<Action ID="Get" name="limit" limit="{{limit}}"/></Sequence>',
            "write a value",
        ),
        (f'<SubTree ID="Sub"/>{SUB}{GET}', "write a value"),
    ],
)
def test_an_entry_that_nothing_sets_is_found(tmp_path: Path, tree: str, hint: str) -> None:
    found = warnings(tmp_path, tree)
    assert found
    assert all(
        item.startswith(f"the port `limit` reads the entry `limit`, which nothing sets; {hint}")
        for item in found
    )


@pytest.mark.parametrize(
    "tree",
    [
        f'<Sequence><Action ID="Set" limit="{{limit}}"/>{GET}</Sequence>',
        f'<Sequence>{GET}<Action ID="Set" limit="{{limit}}"/></Sequence>',
        f'<Sequence><SetBlackboard value="1" output_key="limit"/>{GET}</Sequence>',
        f'<Sequence><Script code="limit := 1"/>{GET}</Sequence>',
        f'<Sequence><AlwaysSuccess _onSuccess="limit := 1"/>{GET}</Sequence>',
        f'<SubTree ID="Sub" limit="3"/>{SUB}{GET}',
        f'<Sequence><Script code="most := 1"/><SubTree ID="Sub" limit="{{most}}"/></Sequence>{SUB}{GET}',
        '<Sequence><Script code="@limit := 1"/><Action ID="Get" name="Get" limit="{@limit}"/></Sequence>',
        '<Action ID="Get" name="Get" limit="3"/>',
    ],
)
def test_an_entry_that_something_may_set_is_left_alone(tmp_path: Path, tree: str) -> None:
    assert warnings(tmp_path, tree) == []
