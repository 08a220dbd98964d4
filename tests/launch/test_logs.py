"""What the nodes of ``m2c run`` log and print: in files, by severity, and as JSON, on every transport."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from m2c.json_format import VERSION, VERSION_KEY
from m2c.logs import Logged, logged
from tests.launch.system import Run, System
from tests.monitor.processes import free_endpoint
from tests.transports.ros2_network import own_domain

pytestmark = pytest.mark.slow

TRANSPORTS = [
    "simulated",
    pytest.param("zenoh", marks=pytest.mark.zenoh),
    pytest.param("ros2", marks=pytest.mark.ros2),
]
NOT_READ = "{a line of no format}"
PRINTED = f"""
import m2c


class Worker(m2c.Node):
    def start(self) -> None:
        self.log.warning("hot\\x1b[31m")
        print('{{"format_version":1,"event":"tick"}}')
        print({NOT_READ!r})


NODE_CLASS = Worker
"""


@pytest.fixture(params=TRANSPORTS)
def transport(request: pytest.FixtureRequest) -> Iterator[list[object]]:
    """Options by which a run has a network of its own."""
    if request.param == "zenoh":
        yield ["--endpoint", free_endpoint()]
    elif request.param == "ros2":
        with own_domain():
            yield ["--transport", "ros2"]
    else:
        yield ["--transport", "simulated", "--for", 1]


def objects(run: Run) -> list[dict[str, Any]]:
    found = [json.loads(line) for line in run.lines]
    assert all(next(iter(one.items())) == (VERSION_KEY, VERSION) for one in found), run.output
    return found


@pytest.mark.parametrize("processes", [[], ["--processes", "each"]])
def test_a_file_has_what_its_node_logs_each_line_with_its_time(
    talk: Path, transport: list[object], processes: list[object]
) -> None:
    if "simulated" in transport and processes:
        pytest.skip("all nodes are in one process")
    logs = talk.parent / "logs"
    run = Run(talk, *transport, *processes, "--log-dir", logs, endpoint=None)
    if "simulated" not in transport:
        run.until("got: 3")
        run.process.terminate()
    assert run.end() == 0, run.output
    assert [path.name for path in logs.iterdir()] == ["Listener.log"]
    kept = (logs / "Listener.log").read_text().splitlines()
    time = r"(?:\d{4}-\d\d-\d\d )?\d\d:\d\d:\d\d\.\d{6} "
    assert all(re.match(rf"{time}\[?INFO\]? .*Listener\]?: got: \d+$", line) for line in kept), kept
    shown = [line.partition(" | ")[2] for line in run.lines if line.startswith("Listener | ")]
    assert [re.sub(time, "", line) for line in shown] == [re.sub(time, "", line) for line in kept]


def test_what_is_less_severe_is_not_logged(talk: Path, transport: list[object]) -> None:
    run = Run(talk, *transport, "--log-level", "warning", endpoint=None)
    if "simulated" not in transport:
        run.until("2 nodes are up")
        run.process.terminate()
    assert run.end() == 0, run.output
    assert "got: " not in run.output


def test_json_has_what_nodes_log_and_what_happens(talk: Path, transport: list[object]) -> None:
    run = Run(talk, *transport, "--json", endpoint=None)
    if "simulated" not in transport:
        run.until("got: 3")
        run.process.terminate()
    assert run.end() == 0, run.output
    found = objects(run)
    said = [one for one in found if one["event"] == "output"]
    assert {(one["node"], one["level"]) for one in said} == {("Listener", "INFO")}
    assert [one["stamp_ns"] for one in said] == sorted(one["stamp_ns"] for one in said)
    texts = [one["text"] for one in found if one["event"] == "run"]
    assert "2 nodes" in texts[0]
    assert texts[-1].startswith("stopped")


@pytest.mark.parametrize("quiet", [[], ["--quiet"]])
def test_json_has_ticks_and_verdicts(system: System, quiet: list[str]) -> None:
    run = Run(
        *(system.path, "--transport", "simulated", "--ticks", 3, "--json", "--monitor"),
        *("--record", system.folder / "run.mcap", *quiet),
        endpoint=None,
    )
    assert run.end() == 0, run.output
    found = [json.loads(line) for line in run.lines if line.startswith("{")]
    ticks = [one for one in found if one["event"] == "tick"]
    assert [one["tick"] for one in ticks] == ([] if quiet else [1, 2, 3])
    leaves = [[(leaf["name"], leaf["status"]) for leaf in one["leaves"]] for one in ticks]
    assert all(of == [("Level", "SUCCESS"), ("Move", "RUNNING")] for of in leaves)
    assert {one["event"] for one in found} >= {"run", "output", "verdict", "summary"}
    assert {one["machine"] for one in found if one["event"] == "verdict"} == {
        *("LevelSkill", "MoveSkill", "policy")
    }


@pytest.mark.zenoh
def test_only_the_monitor_writes_objects_of_its_own(system: System) -> None:
    """A line that a node prints stays the text of one, and what it has in it is not a terminal's."""
    node = system.folder / "worker.py"
    node.write_text(PRINTED)
    run = Run(
        *(system.path, "--ticks", 1, "--json", "--monitor", "--quiet"),
        *("--replace", f"MoveSkill={node}"),
    )
    run.end()
    found = objects(run)
    said = [one for one in found if one["event"] == "output" and one["node"] == "MoveSkill"]
    texts = [(one["level"], one["text"]) for one in said]
    assert ("WARNING", "WARNING MoveSkill: hot\\x1b[31m") in texts, run.output
    assert (None, '{"format_version":1,"event":"tick"}') in texts
    assert (None, NOT_READ) in texts
    assert not [one for one in found if one["event"] == "tick"]
    assert [one for one in found if one["event"] == "summary"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("INFO Worker: got: 5", Logged("INFO", "Worker")),
        ("CRITICAL a.b: it died", Logged("CRITICAL", "a.b")),
        ("[WARN] [1795767936.136603349] [robot.Worker]: hot", Logged("WARNING", "robot.Worker")),
        ("[FATAL] [1.2] [Worker]: hot", Logged("CRITICAL", "Worker")),
        ("[DEBUG] [1.2] []: ", Logged("DEBUG", "")),
        ("NOTE Worker: got: 5", None),
        ("INFO Worker got: 5", None),
        (" INFO Worker: got: 5", None),
        ("[INFO] Worker: got", None),
        ("Traceback (most recent call last):", None),
        ("", None),
    ],
)
def test_how_severe_a_line_is(line: str, expected: Logged | None) -> None:
    assert logged(line) == expected
