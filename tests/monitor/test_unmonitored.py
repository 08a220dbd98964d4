"""What is not monitored though one might think so is said at the beginning and at the end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from moon.cli import main
from tests.monitor.processes import free_endpoint
from transports.zenoh import connect

ROOT = Path(__file__).parents[2]
SYSTEM = str(ROOT / "examples" / "lab_tour" / "system.xml")
RUN = str(ROOT / "tests" / "recordings" / "zenoh-nominal.mcap")
BY_NAME = "the policy is not monitored: --without policy"
BY_NODE = "the policy is not monitored: that needs all of its nodes, and WaitSkill is not monitored"


@pytest.mark.parametrize(
    ("node", "sentence", "machines"), [("policy", BY_NAME, 17), ("WaitSkill", BY_NODE, 16)]
)
def test_a_check_without_a_node_says_that_the_policy_is_not_monitored(
    node: str, sentence: str, machines: int
) -> None:
    done = CliRunner().invoke(main, ["check", RUN, SYSTEM, "--without", node])
    assert done.exit_code == 0, done.output
    assert done.stderr.splitlines() == [sentence]
    assert sentence in done.stdout.splitlines()
    assert f"; {machines} machines: {machines} conforming; " in done.stdout
    assert "\npolicy  " not in done.stdout


def test_all_of_a_system_has_nothing_to_be_said() -> None:
    done = CliRunner().invoke(main, ["check", RUN, SYSTEM])
    assert "not monitored" not in done.output
    assert "; 18 machines: " in done.stdout


def test_many_nodes_that_are_missing_are_counted() -> None:
    done = CliRunner().invoke(main, ["check", RUN, SYSTEM, "--only", "WaitSkill"])
    (said,) = done.stderr.splitlines()
    assert said.endswith("PeopleDetectorComponent and 11 more are not monitored")


def test_the_policy_alone_cannot_be_monitored_and_a_wrong_name_gets_a_suggestion() -> None:
    for arguments, error in (
        (("--only", "policy"), "error: --only policy: the policy is monitored together with all"),
        (("--without", "polcy"), "error: lab_tour has no node polcy; did you mean policy?"),
    ):
        done = CliRunner().invoke(main, ["check", RUN, SYSTEM, *arguments])
        assert done.exit_code == 2
        assert done.stderr.startswith(error)


@pytest.mark.zenoh
@pytest.mark.parametrize("as_json", [False, True])
def test_a_monitor_says_it_when_it_starts_and_in_its_summary(as_json: bool) -> None:
    endpoint = free_endpoint()
    node = connect("somebody", {"listen": endpoint})
    arguments = ["monitor", SYSTEM, "--without", "policy", "--endpoint", endpoint, "--for", "0.2"]
    try:
        done = CliRunner().invoke(main, [*arguments, *(["--json"] if as_json else [])])
    finally:
        node.close()
    assert done.exit_code == 0, done.output
    assert done.stderr.splitlines()[0] == BY_NAME
    if as_json:
        summary = json.loads(done.stdout.splitlines()[-1])
        assert summary["unmonitored"] == [BY_NAME]
        assert "policy" not in {item["machine"] for item in summary["machines"]}
    else:
        assert BY_NAME in done.stdout.splitlines()
