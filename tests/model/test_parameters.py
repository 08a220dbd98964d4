"""The parameters of a system file are read, or refused with their place."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, System, load

MODEL = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="A"><state id="a"/></scxml>'


def read(folder: Path, parameters: str) -> tuple[System, list[str]]:
    (folder / "a.scxml").write_text(MODEL)
    path = folder / "system.xml"
    path.write_text(
        f"<roaml><parameters>{parameters}</parameters>"
        '<node_models><input type="node-ascxml" src="a.scxml"/></node_models></roaml>'
    )
    log = DiagnosticLog()
    system = load([path], log)
    assert system is not None
    return system, [str(found).replace(f"{folder}/", "") for found in log.diagnostics]


@pytest.mark.parametrize(
    ("value", "unit", "seconds"),
    [("100", "s", 100.0), ("1.5", "s", 1.5), ("1500", "ms", 1.5), ("2e6", "us", 2.0)],
)
def test_the_time_of_a_run_is_read_with_its_unit(
    tmp_path: Path, value: str, unit: str, seconds: float
) -> None:
    system, found = read(tmp_path, f'<max_time value="{value}" unit="{unit}"/>')
    assert found == []
    assert system.max_time_s == seconds


def test_a_system_without_parameters_has_their_defaults(tmp_path: Path) -> None:
    system, found = read(tmp_path, "")
    assert found == []
    assert system.max_time_s is None
    assert system.max_array_size == 100
    assert system.tick_rate_hz == 1.0


@pytest.mark.parametrize(
    ("parameters", "again"),
    [
        ("", True),
        ('<max_time value="9" unit="s"/>', False),
        ('<max_time value="9" unit="s"/><bt_tick_if_not_running value="true"/>', True),
        ('<bt_tick_if_not_running value="false"/>', False),
    ],
)
def test_a_tree_that_has_ended_is_ticked_again_unless_the_run_has_an_end(
    tmp_path: Path, parameters: str, again: bool
) -> None:
    system, found = read(tmp_path, parameters)
    assert found == []
    assert system.tick_if_not_running is again


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ('<max_tme value="1"/>', "system.xml:1:20: error: <max_tme>: not a parameter; did you mean max_time? [unknown-tag]"),
        ('<rate value="1"/>', "system.xml:1:20: error: <rate>: not a parameter; known: bt_tick_rate, max_time, max_array_size, bt_tick_if_not_running [unknown-tag]"),
        ('<max_time value="1"/>', "system.xml:1:20: error: <max_time>: the attribute `unit` is missing [missing-attribute]"),
        ('<max_time unit="s"/>', "system.xml:1:20: error: <max_time>: the attribute `value` is missing [missing-attribute]"),
        ('<max_time value="1" unit="min"/>', "system.xml:1:46: error: <max_time>: `min` is not a unit of time; one of s, ms, us, ns [bad-parameter]"),
        ('<max_time value="-1" unit="s"/>', 'system.xml:1:37: error: <max_time>: `-1` is not a time; write it like value="100" unit="s" [bad-parameter]'),
        ('<max_array_size value="1.5"/>', "system.xml:1:43: error: <max_array_size>: `1.5` is not a size; a whole number from 1 [bad-parameter]"),
        ('<bt_tick_if_not_running value="yes"/>', "system.xml:1:51: error: <bt_tick_if_not_running>: `yes` is not true or false [bad-parameter]"),
        ('<bt_tick_rate value="1"/><bt_tick_rate value="2"/>', "system.xml:1:45: error: <bt_tick_rate>: given twice; the first is at system.xml:1:20 [bad-parameter]"),
        ('<bt_tick_rate value="1" unit="s"/>', "system.xml:1:50: error: <bt_tick_rate>: unknown attribute `unit`; known: value [unknown-attribute]"),
    ],
)  # fmt: skip
def test_a_fault_of_a_parameter_is_one_error(
    tmp_path: Path, parameters: str, expected: str
) -> None:
    _, found = read(tmp_path, parameters)
    assert found == [expected]
