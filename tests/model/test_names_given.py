"""Names that a model may leave out: the machine's is its file's, states are numbered (W3C SCXML 3.2, 3.3)."""

from __future__ import annotations

from pathlib import Path

import pytest

import m2c
from m2c.model.machine import Machine

GO = '<transition event="go" target="there"/>'


def read(folder: Path, states: str, head: str = "", file: str = "Probe.scxml") -> Machine:
    path = folder / file
    path.write_text(f'<scxml xmlns="http://www.w3.org/2005/07/scxml" {head}>{states}</scxml>')
    return m2c.read_system(path).nodes[0]


@pytest.mark.parametrize("head", ["", 'name=""', 'name=" "'])
@pytest.mark.parametrize("file", ["Lamp.scxml", "Lamp.xml", "street_lamp.ascxml", "Lamp.v2.scxml"])
def test_a_machine_without_a_name_is_called_as_its_file(
    head: str, file: str, tmp_path: Path
) -> None:
    states = '<state id="a"/>'
    if file.endswith(".ascxml"):
        (tmp_path / file).write_text(f"<ascxml {head}>{states}</ascxml>")
        assert m2c.read_system(tmp_path / file).nodes[0].name == "street_lamp"
    else:
        assert read(tmp_path, states, head, file).name == Path(file).stem


def test_the_name_that_is_written_comes_first(tmp_path: Path) -> None:
    assert read(tmp_path, '<state id="a"/>', 'name="Other"').name == "Other"


@pytest.mark.parametrize(
    ("states", "names"),
    [
        ("<state/>", ["state1"]),
        (f'<state>{GO}</state><state id="there"/>', ["state1", "there"]),
        (f'<state>{GO}</state><state id="there"/><final/>', ["state1", "there", "final3"]),
        (f'<state>{GO}</state><state id="there"/><state/>', ["state1", "there", "state3"]),
        ('<state id="state2"/><state/>', ["state2", "state2_"]),
        ('<state id=""/><state id=" "/>', ["state1", "state2"]),
        ('<state id="state2"/><state/><state id="state2_"/>', ["state2", "state2__", "state2_"]),
    ],
)
def test_states_without_an_id_get_one(states: str, names: list[str], tmp_path: Path) -> None:
    machine = read(tmp_path, states)
    assert [state.name for state in machine.states] == names
    assert machine.initial == names[0]
