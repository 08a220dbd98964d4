"""What commands write for programs says of which version its format is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from m2c.json_format import VERSION, VERSION_KEY
from m2c.json_lines import versioned_line
from moon.cli import main as moon
from moon.feed.counts import Counts
from moon.monitor.screen import JsonLines
from moon.monitor.status import MachineStatus, Summary
from moon.recording.reader import open_recording
from moon.tap.output import LastTable, json_of
from moon.tap.stream import Line
from moon.verdict import Outcome, Verdict
from transports.interface import Observation

ROOT = Path(__file__).parents[2]
TOUR = ROOT / "examples" / "lab_tour"
RUN = ROOT / "tests" / "recordings" / "zenoh-T4.mcap"


def require_versions(text: str) -> None:
    found = [json.loads(line) for line in text.splitlines()]
    assert found
    assert all(next(iter(item.items())) == (VERSION_KEY, VERSION) for item in found), text


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", RUN, TOUR / "system.xml", "--json"),
        ("explain", TOUR / "system.xml", "--json"),
        ("explain", TOUR / "system.xml", "--recording", RUN, "--json"),
        ("check-properties", TOUR / "properties.yaml", "--json"),
    ],
    ids=lambda arguments: " ".join(map(str, arguments[:1])),
)
def test_each_line_says_its_version(arguments: tuple[object, ...]) -> None:
    require_versions(CliRunner().invoke(moon, list(map(str, arguments))).stdout)


def test_each_finding_says_its_version(tmp_path: Path) -> None:
    model = tmp_path / "m.scxml"
    model.write_text('<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M"/>')
    found = json.loads(CliRunner().invoke(m2c, ["check", "--format", "json", str(model)]).stdout)
    assert found
    assert {item[VERSION_KEY] for item in found} == {VERSION}


def test_a_log_of_verdicts_says_its_version(tmp_path: Path) -> None:
    log = tmp_path / "verdicts.jsonl"
    arguments = ["check", str(RUN), str(TOUR / "system.xml"), "--log", str(log)]
    CliRunner().invoke(moon, arguments)
    require_versions(log.read_text())


def test_what_a_monitor_and_a_tap_write_says_its_version(capsys: Any) -> None:
    monitor = JsonLines()
    status = MachineStatus("M", "conforming", (), 0, 0, 0, 0, None, "")
    monitor.take(Verdict("M", "M", Outcome.CONFORMING, 1))
    monitor.finish(Summary(1.0, (status,), Counts(), ()))
    seen = Line(1, "message", "/c", "a", {"bytes": b"x", "nan": float("nan")})
    statistics = LastTable(as_json=True)
    statistics.add(seen)
    statistics.finish(2)
    require_versions(capsys.readouterr().out + json_of(seen).decode())


def test_an_object_without_keys_has_its_version_only() -> None:
    assert json.loads(versioned_line({})) == {VERSION_KEY: VERSION}


def read(folder: Path, *lines: dict[str, Any]) -> tuple[list[Observation], tuple[str, ...]]:
    log = folder / "run.jsonl"
    log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    recording = open_recording(log, None)
    seen = [entry for entry in recording.entries() if isinstance(entry, Observation)]
    return seen, tuple(recording.faults())


def test_a_log_without_a_version_and_one_of_this_version_are_read(tmp_path: Path) -> None:
    line = {"topic": "/a", "time": 1.0, "data": 3}
    seen, faults = read(tmp_path, line, {**line, VERSION_KEY: VERSION})
    assert [one.data for one in seen] == [{"data": 3}, {"data": 3}]
    assert faults == ()


@pytest.mark.parametrize("version", [VERSION + 1, 0, "new", None])
def test_a_line_of_another_version_is_named_and_not_guessed_at(
    version: object, tmp_path: Path
) -> None:
    line = {"topic": "/a", "time": 1.0, "data": 3}
    seen, (fault,) = read(tmp_path, line, {**line, VERSION_KEY: version})
    assert len(seen) == 1
    assert fault.endswith(
        f"run.jsonl:2: format_version is {json.dumps(version)}; this moon reads lines of version 1, "
        "and without one"
    )
