"""``m2c run --watch``: the node of a changed model takes the old one's place, in the running system."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main
from tests.launch.system import LEVEL, MOVE, Run, System

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]


@pytest.fixture
def watched(system: System) -> Run:
    run = Run(system.path, "--watch")
    run.until("Level ok")
    return run


def finished(run: Run) -> str:
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    assert run.lines[-1].endswith("all nodes have ended")
    assert "Traceback" not in run.output
    return run.output


def test_a_changed_node_takes_the_place_of_the_old_one(system: System, watched: Run) -> None:
    before = watched.children()
    model = system.folder / "LevelSkill.scxml"
    for status, shown in (("1", "Level no"), ("0", "Level ok")):
        model.write_text(LEVEL.replace("{status}", status))
        watched.until("LevelSkill.scxml has changed; LevelSkill is started again")
        watched.until(shown)
    after = watched.children()
    assert after["LevelSkill"] != before["LevelSkill"]
    assert {**after, "LevelSkill": 0} == {**before, "LevelSkill": 0}
    finished(watched)


def test_while_a_model_is_not_valid_the_old_node_goes_on(system: System, watched: Run) -> None:
    before = watched.children()
    model = system.folder / "LevelSkill.scxml"
    for text, error in (
        ("<scxml", "malformed-xml"),
        (LEVEL.replace("{status}", "'high'"), "type-mismatch"),
    ):
        model.write_text(text)
        watched.until(f"[{error}]")
        watched.until("LevelSkill.scxml has changed and cannot be used: the old nodes go on")
        watched.until("Level ok")
    assert watched.children() == before
    model.write_text(LEVEL.replace("{status}", "1"))
    watched.until("LevelSkill is started again")
    watched.until("Level no")
    finished(watched)


def test_what_makes_no_difference_starts_nothing_again(system: System, watched: Run) -> None:
    before = watched.children()
    (system.folder / "MoveSkill.scxml").write_text(MOVE + "<!-- a remark -->")
    watched.until("MoveSkill.scxml has changed; no node is another for it")
    assert watched.children() == before
    finished(watched)


def change_system(system: System) -> None:
    system.path.write_text(system.path.read_text().replace('value="50"', 'value="20"'))


def change_policy(system: System) -> None:
    policy = system.folder / "policy.xml"
    policy.write_text(policy.read_text().replace("ReactiveSequence", "ReactiveFallback"))


def change_types(system: System) -> None:
    types = system.folder / "interfaces/t/srv/HaltAction.srv"
    types.write_text(types.read_text() + "string reason\n")


@pytest.mark.parametrize("change", [change_system, change_policy, change_types])
def test_what_all_nodes_share_needs_a_new_run(system: System, watched: Run, change: object) -> None:
    assert callable(change)
    before = watched.children()
    change(system)
    said = watched.until("has changed: all nodes share")
    assert said.endswith("; stop, and run it again")
    watched.until("tick ")
    assert watched.children() == before
    finished(watched)


def test_what_was_taken_back_is_no_reason_for_a_new_run(system: System, watched: Run) -> None:
    before, policy = system.path.read_text(), system.folder / "policy.xml"
    change_system(system)
    watched.until("has changed: all nodes share the system file")
    system.path.write_text(before)
    watched.until("has changed; no node is another for it")
    text = policy.read_text()
    policy.unlink()
    watched.until("policy.xml has changed and cannot be used: the old nodes go on")
    policy.write_text(text)
    watched.until("policy.xml has changed; no node is another for it")
    (system.folder / "LevelSkill.scxml").write_text(LEVEL.replace("{status}", "1"))
    watched.until("LevelSkill is started again")
    finished(watched)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ["--monitor"],
            "--watch excludes --monitor: it would judge a changed node by the old model",
        ),
        (["--processes", "2"], "--watch excludes --processes N, --deployment and --host"),
        (["--transport", "simulated"], "--watch is for a middleware"),
    ],
)
def test_what_does_not_go_with_it_is_refused(system: System, options: list[str], said: str) -> None:
    done = CliRunner().invoke(main, ["run", str(system.path), "--watch", *options])
    assert done.exit_code == 2
    assert said in done.output


def test_a_generated_system_is_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["run", str(tmp_path), "--watch"])
    assert done.exit_code == 2
    assert (
        "--watch: these nodes are generated already; give the system file as SYSTEM" in done.output
    )
