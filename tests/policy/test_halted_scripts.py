"""``_onHalted`` scripts that fail: BehaviorTree.CPP runs them in a destructor, which would end the process."""

from __future__ import annotations

import gc
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from m2c.policy.library import PolicyError
from m2c.policy.runner import PolicyRunner
from moon.policy.run import BEGIN, TreeRun, Trees
from tests.docs.trees import ANSWERS, Skills, read

FAILS = ("n = 1", "n += 1", "n := m", "n = 'a'", "n = 1; m := n")
"""Scripts that an empty blackboard does not take."""
PLACES = {
    "root": '<R _onHalted="{}"/>',
    "control": '<Sequence _onHalted="{}"><R/></Sequence>',
    "never ticked": '<Sequence><R/><S _onHalted="{}"/></Sequence>',
    "halted": '<Sequence><Parallel success_count="1"><R _onHalted="{}"/><S/></Parallel><R/></Sequence>',
    "sub-tree": '<BehaviorTree ID="Main"><SubTree ID="T" _onHalted="{}"/></BehaviorTree>'
    '<BehaviorTree ID="T"><R/></BehaviorTree>',
    "child of a Timeout": '<Timeout msec="500"><R _onHalted="{}"/></Timeout>',
}
SETS = {"n": '<Script code="n := 1"/>', "m": '<Script code="m := 2; n := 3"/>'}


def somewhere_set(tree: str) -> str:
    """``tree`` beside nodes that set what it names, if they were ever ticked."""
    setting = f"<Sequence><F/>{''.join(SETS.values())}</Sequence>"
    if tree.startswith("<BehaviorTree"):
        return f'{tree}<BehaviorTree ID="Set">{setting}</BehaviorTree>'
    return f"<Fallback>{setting}{tree}</Fallback>"


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("script", FAILS)
def test_a_script_that_fails_when_a_tree_is_thrown_away_ends_nothing(
    tmp_path: Path, place: str, script: str
) -> None:
    policy, said = read(tmp_path, somewhere_set(PLACES[place].format(script)))
    assert policy is not None, said
    transport = Skills({f"/{name}/tick": answer for name, answer in ANSWERS.items()})
    for end in (True, False):
        runner = PolicyRunner(transport, policy)
        with suppress(PolicyError):
            runner.run(10.0, 1)
        if end:
            runner.stop()
        del runner
        gc.collect()
    run = TreeRun(Trees(policy, frozenset(), records=True))
    run.step(BEGIN)
    run.close()
    del run
    gc.collect()


def test_what_runs_is_halted_though_the_tree_cannot_be(tmp_path: Path) -> None:
    policy, said = read(
        tmp_path, somewhere_set('<Parallel><R _onHalted="n = 1"/><R name="other"/></Parallel>')
    )
    assert policy is not None, said
    halted: list[str] = []

    class Halts(Skills):
        def client(self, service: Any) -> Any:
            client = super().client(service)
            called = client.call_and_wait

            def call(request: Any, timeout_s: float) -> Any:
                if service.name.endswith("/halt"):
                    halted.append(service.name)
                return called(request, timeout_s)

            client.call_and_wait = call
            return client

    transport = Halts({f"/{name}/tick": answer for name, answer in ANSWERS.items()})
    with pytest.raises(PolicyError, match="the tree cannot be halted: Error in script"):
        PolicyRunner(transport, policy).run(10.0, 1)
    assert halted == ["/R/halt", "/R/halt"]


@pytest.mark.parametrize(
    "tree",
    [
        '<Sequence><S _onHalted="n = 1"/><Repeat num_cycles="x"><S/></Repeat></Sequence>',
        '<R _onHalted="n = ="/>',
        '<Timeout msec="5"><Repeat num_cycles="x"><S _onHalted="n = 1"/></Repeat></Timeout>',
        '<S _onSuccess="n := 1e999"/>',
        '<Script code="n := 1e999"/>',
    ],
)
def test_a_policy_that_is_refused_beside_such_a_script_is_a_finding(
    tmp_path: Path, tree: str
) -> None:
    policy, said = read(tmp_path, somewhere_set(tree))
    assert policy is None
    assert any("BehaviorTree.CPP refuses the policy" in line for line in said)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("check",), 0),
        (("explain",), 0),
        (("run", "--transport", "simulated", "--ticks", "2"), 1),
        (("generate", "-o", "out"), 0),
    ],
)
def test_commands_end_as_they_should(tmp_path: Path, arguments: tuple[str, ...], code: int) -> None:
    read(tmp_path, somewhere_set('<R _onHalted="n = 1"/>'))
    package = "moon" if arguments[0] == "explain" else "m2c"
    command, *options = arguments
    ran = subprocess.run(
        [sys.executable, "-m", f"{package}.cli", command, "system.xml", *options],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == code, ran.stderr
    assert "Traceback" not in ran.stderr + ran.stdout
