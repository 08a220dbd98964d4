"""Leaves whose status nobody hears: what plugins and the clock may have said is accepted, no more."""

from __future__ import annotations

from random import Random
from typing import Any

import msgspec
import pytest

from m2c.policy.program import Policy
from moon.policy import PolicyOracle
from moon.verdict import Outcome
from tests.monitor_policy.scripted import leaf, run, tree
from transports.simulated import Conditions

LATE = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.15))


class Decides:
    """A plugin that answers at random, in the place of a generated one."""

    def __init__(self, transport: object, talk: Any, *_: object) -> None:
        self._talk = talk
        self._draw = Random(11)

    def start(self) -> None:
        """Nothing to do."""

    def tick(self) -> None:
        self._talk.return_status(self._draw.choice(["SUCCESS", "FAILURE", "RUNNING"]))

    def halt(self) -> None:
        self._talk.return_halted()


def with_plugin(policy: Policy, name: str) -> Policy:
    """``policy`` with the leaf ``name`` run by a plugin that calls nobody."""
    leaves = tuple(
        msgspec.structs.replace(
            found, plugin="Decides", tick="", tick_type="", tick_request=None, halt="", halt_type=""
        )
        if found.id == name
        else found
        for found in policy.leaves
    )
    return msgspec.structs.replace(policy, leaves=leaves)


BODY = (
    f"<ReactiveSequence><Fallback>{leaf('SetPoi1')}{leaf('SetPoi2')}</Fallback>"
    f"<Sequence>{leaf('Wait')}{leaf('IsPoiDone1')}{leaf('GoToPoi')}</Sequence></ReactiveSequence>"
)


@pytest.mark.parametrize("hidden", ["SetPoi1", "SetPoi2", "Wait", "GoToPoi"])
@pytest.mark.parametrize("join_after", [0, 5])
def test_whatever_a_plugin_answers_is_accepted(hidden: str, join_after: int) -> None:
    policy = with_plugin(tree(BODY), hidden)
    for seed in range(3):
        heard = run(policy, seed, 80, LATE, plugins={"Decides": Decides}, join_after=join_after)
        assert not heard.verdicts, heard.reasons
        assert heard.oracle.outcome is Outcome.CONFORMING
        assert heard.oracle.outputs > 40


def test_what_no_answer_of_a_plugin_explains_is_a_violation() -> None:
    policy = with_plugin(tree(BODY), "SetPoi1")
    exchanged = BODY.replace(
        leaf("IsPoiDone1") + leaf("GoToPoi"), leaf("GoToPoi") + leaf("IsPoiDone1")
    )
    other = with_plugin(tree(exchanged), "SetPoi1")
    heard = run(policy, 3, actual=other, plugins={"Decides": Decides})
    first = heard.violations[0]
    assert first.reason == (
        "expected tick IsPoiDone1 (/IsPoiDone1Skill/tick), "
        "observed tick GoToPoi (/GoToPoiSkill/tick)"
    )


WAITS = (
    f'<Sequence>{leaf("SetPoi1")}<Sleep msec="500"/>'
    f'<Timeout msec="700"><Delay delay_msec="300">{leaf("GoToPoi")}</Delay></Timeout>'
    f"{leaf('IsPoiDone1')}</Sequence>"
)


@pytest.mark.parametrize("join_after", [0, 5])
def test_waiting_nodes_end_when_the_clock_says_so(join_after: int) -> None:
    for seed in range(3):
        heard = run(tree(WAITS), seed, 200, LATE, join_after=join_after)
        assert not heard.verdicts, heard.reasons
        assert heard.oracle.outcome is Outcome.CONFORMING
        assert any(seen.channel == "/GoToPoiSkill/halt" for seen in heard.observations)


def test_under_a_waiting_node_only_its_own_leaves_are_ticked() -> None:
    other = WAITS.replace(leaf("GoToPoi"), leaf("Alarm"))
    heard = run(tree(WAITS), 1, 100, actual=tree(other))
    assert heard.violations[0].reason.endswith(
        "observed a call of /AlarmSkill/tick, which no leaf of the tree makes"
    )


def test_a_plugin_that_ticks_children_cannot_be_checked_and_that_is_said() -> None:
    policy = tree(BODY)
    leaves = tuple(
        msgspec.structs.replace(found, plugin="Chooses", children=2)
        if found.id == "Wait"
        else found
        for found in policy.leaves
    )
    oracle = PolicyOracle(msgspec.structs.replace(policy, leaves=leaves))
    assert oracle.outcome is Outcome.INCONCLUSIVE
    assert "Chooses decides, unobserved" in oracle.verdict().reason
