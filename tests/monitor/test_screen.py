"""What a terminal shows, and what a pipe gets."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time

import msgspec
import pytest

from moon.feed.counts import Counts
from moon.monitor.report import cells, closing, last_explanations, table, verdict_lines
from moon.monitor.status import AWAY, MachineStatus, Summary
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from tests.monitor.hand_driven import write_models
from tests.monitor.processes import WAIT_S, free_endpoint
from transports.interface import Topic
from transports.zenoh import connect

GOOD = MachineStatus("Good", "conforming", ("idle",), 5, 4, 0, 0, 0.52, "started in the middle")
BAD = MachineStatus("Bad", "violated", ("a", "b"), 1, 2, 3, 0, None, "expected A, observed B")
STAMP = 1_700_000_000_123_456_000


def test_a_row_names_states_and_counts_violations() -> None:
    assert cells(GOOD) == ("Good", "conforming", "idle", "5", "4", "0.5")
    assert cells(BAD) == ("Bad", "violated ×3", "a or b", "1", "2", "")


def test_the_columns_of_the_table_are_aligned() -> None:
    heading, good, bad, below = table([GOOD, BAD])
    assert below == "Bad: expected A, observed B"
    for name, row in (("conforming", good), ("violated", bad)):
        assert row.index(name) == heading.index("verdict")
    assert good.index("0.5") + 3 == heading.index("lag [ms]") + len("lag [ms]")


def test_a_violation_is_explained_with_local_times() -> None:
    why = Explanation(
        ("A", "B"), "C", ("idle (x=1)",), (Evidence(STAMP, "message on /m: {}"),), ("/m.scxml:3:4",)
    )
    lines = verdict_lines(Verdict("M", "m1", Outcome.VIOLATED, STAMP, "expected A or B", why))
    clock = time.strftime("%H:%M:%S", time.localtime(STAMP // 10**9)) + ".123456"
    assert lines == [
        f"{clock}  m1 (M)  VIOLATED",
        "    expected  A",
        "              B",
        "    observed  C",
        "    in state  idle (x=1)",
        f"    after     {clock}  message on /m: {{}}",
        "    model     /m.scxml:3:4",
    ]


def test_what_came_over_the_network_stays_on_its_line_and_is_no_command_to_the_terminal() -> None:
    why = Explanation(("A",), "x\x1b[2J\ny")
    (_, _, observed) = verdict_lines(Verdict("M", "M", Outcome.VIOLATED, STAMP, "r", why))
    assert observed == "    observed  x\\x1b[2J\\ny"


def test_the_end_counts_machines_by_verdict_and_names_unknown_channels() -> None:
    counts = Counts(received=12, unconcerned=3)
    counts.unknown["/a"] = 2
    lines = closing(Summary(2.0, (GOOD, BAD), counts, ()))
    assert lines == [
        "3 violations in 2.0 s; 2 machines: 1 conforming, 1 violated; "
        "received 12 observations, 3 of no monitored machine",
        "channels that no model names: /a",
    ]


def test_the_end_says_of_machines_whose_nodes_went_away_that_they_conformed_until_then() -> None:
    gone = [
        msgspec.structs.replace(GOOD, machine=name, states=(AWAY,)) for name in ("One", "Other")
    ]
    last = msgspec.structs.replace(BAD, states=(AWAY,))
    (both,) = closing(Summary(2.0, (*gone, GOOD, last), Counts(), ()))
    assert "4 machines: 1 conforming, 2 conforming until they ended, 1 violated; " in both
    (one,) = closing(Summary(2.0, (gone[0],), Counts(), ()))
    assert "1 machine: 1 conforming until it ended; " in one
    assert cells(gone[0])[1:3] == ("conforming", "(gone)")


def test_machines_with_one_reason_have_one_line_below_the_table() -> None:
    doubtful = msgspec.structs.replace(GOOD, verdict="inconclusive", last="it stood still")
    names = ["A", "B", "C", "D", "E", "F", "G"]
    rows = [BAD, *(msgspec.structs.replace(doubtful, machine=name) for name in names)]
    assert last_explanations(rows) == [
        "Bad: expected A, observed B",
        "A, B, C, D, E and 2 more: it stood still",
    ]


@pytest.mark.zenoh
@pytest.mark.parametrize("columns", [60, 120])
def test_a_terminal_shows_a_table_that_is_refreshed(columns: int, tmp_path) -> None:
    model = write_models(tmp_path)
    endpoint = free_endpoint()
    battery = connect("Battery", {"listen": endpoint})
    main, child = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "moon.cli", "monitor", str(model), "--endpoint", endpoint],
        stdout=child,
        stderr=subprocess.PIPE,
        env={**os.environ, "TERM": "xterm", "COLUMNS": str(columns)},
    )
    os.close(child)
    shown = b""

    def read_until(pattern: bytes) -> None:
        nonlocal shown
        deadline = time.monotonic() + WAIT_S
        while not re.search(pattern, re.sub(rb"\x1b\[[0-9;?]*[A-Za-z]", b"", shown)):
            assert time.monotonic() < deadline, shown
            if select.select([main], [], [], 0.1)[0]:
                shown += os.read(main, 65536)

    try:
        read_until(rb"machine +verdict")
        read_until(rb"Level +unseen")
        level = connect("Level", {"endpoint": endpoint})
        level.publisher(Topic("/elsewhere", "t/msg/Level", _level_type()))
        level.announce()
        read_until(rb"Level +conforming")
        process.send_signal(signal.SIGINT)
        read_until(rb"0 violations in")
        assert process.wait(WAIT_S) == 0
        assert b"\x1b[?25h" in shown  # the cursor is shown again
        level.close()
    finally:
        process.kill()
        process.communicate()
        os.close(main)
        battery.close()


def _level_type():
    return msgspec.defstruct(
        "Level", [("data", int, 0)], namespace={"__type_name__": "t/msg/Level"}
    )


@pytest.mark.zenoh
def test_a_node_says_when_it_began_to_connect() -> None:
    endpoint = free_endpoint()
    watcher = connect("watcher", {"listen": endpoint})
    seen = []
    try:
        watcher.watch_nodes(lambda name, up: seen.append((name, up)))
        before = time.time_ns()
        node = connect("node", {"endpoint": endpoint})
        after = time.time_ns()
        node.announce()
        watcher.spin(until=lambda: ("node", True) in seen)
        assert before <= watcher.up_since("node") <= after
        first = watcher.up_since("node")
        node.close()
        watcher.spin(until=lambda: ("node", False) in seen)
        assert watcher.up_since("node") == 0
        seen.clear()
        node = connect("node", {"endpoint": endpoint})
        node.announce()
        watcher.spin(until=lambda: ("node", True) in seen)
        assert watcher.up_since("node") > first
        node.close()
    finally:
        watcher.close()
