"""Small recordings of others, each with what is right."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from moon.cli import main

CASES = Path(__file__).parents[3] / "shared" / "cases" / "recordings"
pytestmark = [
    pytest.mark.seed,
    pytest.mark.skipif(not CASES.is_dir(), reason="the cases are not beside the checkout"),
]
OPEN = "inconclusive"


def check(run: str, properties: str) -> tuple[int, dict[str, str], dict[str, object]]:
    arguments = ["check", str(CASES / run), "--properties", str(CASES / properties), "--json"]
    done = CliRunner().invoke(main, arguments)
    events = [json.loads(line) for line in done.stdout.splitlines()]
    verdicts = {item["machine"]: item["verdict"] for item in events[-1]["machines"]}
    return done.exit_code, verdicts, events[0]


@pytest.mark.parametrize("run", ["last.jsonl", "last_ok.jsonl"])
def test_the_last_entry_is_judged(run: str) -> None:
    code, verdicts, _ = check(run, "a.yaml")
    assert (code, verdicts) == (1, {"A": "violated"})


def test_nothing_is_missed_before_the_first_entry() -> None:
    code, verdicts, _ = check("hz20.mcap", "hz.yaml")
    assert code == 0
    assert set(verdicts.values()) == {"conforming"}


def test_simulated_time_beside_the_wall_clocks_loses_nothing() -> None:
    code, verdicts, facts = check("simtime.mcap", "lvl2.yaml")
    assert (code, verdicts) == (1, {"A": "violated", "R": "conforming"})
    assert str(facts["time"]).startswith("log_time")


def test_a_service_that_was_not_recorded_is_a_limit() -> None:
    code, verdicts, facts = check("topics_only.mcap", "srv2.yaml")
    assert (code, verdicts) == (0, {"never": OPEN, "exist": OPEN, "resp": OPEN})
    assert facts["unrecorded"] == ["/set"]


def test_definitions_are_read_whatever_their_encoding_is_called() -> None:
    code, _, facts = check("srv_unknown.mcap", "srv.yaml")
    assert (code, facts["faults"], facts["observations"]) == (0, [], 8)
    code, verdicts, _ = check("crlf.mcap", "a.yaml")
    assert (code, verdicts) == (1, {"A": "violated"})
