"""Trees that remember more than what is RUNNING, with leaves that no call shows: their reports decide."""

from __future__ import annotations

import re
from random import Random
from typing import Any

import msgspec
import pytest

from m2c.policy.plugins import PortValue
from m2c.policy.program import Policy
from m2c.policy.ticks import TICKS_CHANNEL
from moon.policy import PolicyOracle
from moon.policy.run import BEGIN, ELAPSED, WAITING, AskKind, TreeRun, Trees
from moon.policy.shape import shape_of
from moon.verdict import Outcome
from tests.monitor_policy.scripted import ACTIONS, CONDITIONS, HALTED, Heard, leaf, run, tree
from tests.monitor_policy.trees import CONTROLS_THAT_REMEMBER, PLAIN
from transports.simulated import Conditions

pytestmark = pytest.mark.slow

LATE = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.15))
LOSSY = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.15), tap_loss=0.02, duplication=0.03)
REPEATS = ('Repeat num_cycles="3"', 'RetryUntilSuccessful num_attempts="3"')
TIMED = ('Delay delay_msec="250"', 'Timeout msec="450"')
DECORATORS = ("Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure", "RunOnce")
SCRIPTED = (
    '<ScriptCondition code="n &gt; 1"/>',
    '<ScriptCondition code="n == 2 || flag"/>',
    "<AlwaysSuccess/>",
)
WRITES = "Alarm"
"""The leaf that a plugin runs, which writes to the blackboard."""
OUTPUTS = (
    PortValue(key="count", kind="int", entry="n"),
    PortValue(key="flag", kind="bool", entry="flag"),
)
BLOCK = 25


class Writes:
    """A plugin that answers and writes at random, in the place of a generated one."""

    made = 0

    def __init__(self, transport: object, talk: Any, *_: object) -> None:
        self._talk = talk
        Writes.made += 1
        self._draw = Random(Writes.made)

    def start(self) -> None:
        """Nothing to do."""

    def tick(self) -> None:
        self._write()
        self._talk.return_status(self._draw.choice(["SUCCESS", "FAILURE", "RUNNING"]))

    def halt(self) -> None:
        self._write()
        self._talk.return_halted()

    def _write(self) -> None:
        for _ in range(self._draw.randrange(3)):
            self._talk.set_output("count", self._draw.randrange(4))
        if self._draw.random() < 0.5:
            self._talk.set_output("flag", self._draw.random() < 0.5)


def random_body(draw: Random, depth: int = 0) -> str:
    """Decorators around what waits, and conditions on what a plugin writes."""

    def node(tag: str, count: int) -> str:
        children = "".join(random_body(draw, depth + 1) for _ in range(count))
        return f"<{tag}>{children}</{tag.split(maxsplit=1)[0]}>"

    kind = draw.random()
    if depth >= 4 or kind < 0.2:
        return leaf(draw.choice(CONDITIONS + ACTIONS + HALTED))
    if kind < 0.3:
        return draw.choice(SCRIPTED)
    if kind < 0.38:
        return leaf(WRITES)
    if kind < 0.46:
        return '<Sleep msec="250"/>'
    if kind < 0.58:
        return node(draw.choice(REPEATS), 1)
    if kind < 0.68:
        return node(draw.choice(TIMED), 1)
    if kind < 0.76:
        return node(draw.choice(DECORATORS), 1)
    return node(draw.choice(PLAIN + CONTROLS_THAT_REMEMBER[:4]), draw.randint(2, 3))


def policy_of(body: str) -> Policy:
    """``body`` as a policy in which a plugin runs ``WRITES``."""
    entries = '<RunOnce><Script code="n := 0; flag := false"/></RunOnce>'
    policy = tree(f"<Sequence>{entries}{body}</Sequence>")
    leaves = tuple(
        msgspec.structs.replace(
            found,
            plugin="Writes",
            tick="",
            tick_type="",
            tick_request=None,
            halt="",
            halt_type="",
            outputs=OUTPUTS,
        )
        if found.id == WRITES
        else found
        for found in policy.leaves
    )
    return msgspec.structs.replace(policy, leaves=leaves)


def judged(expected: Policy, seed: int, **more: Any) -> Heard:
    Writes.made = seed
    return run(expected, seed, plugins={"Writes": Writes}, **more)


def trees(seeds: range) -> list[tuple[int, str]]:
    return [
        (seed, f"<Sequence>{leaf('SetPoi1')}{random_body(Random(seed))}</Sequence>")
        for seed in seeds
    ]


@pytest.mark.parametrize("block", range(6))
def test_whatever_the_clock_says_and_plugins_write_the_policy_conforms(block: int) -> None:
    for seed, body in trees(range(block * BLOCK, (block + 1) * BLOCK)):
        policy = policy_of(body)
        heard = judged(policy, seed, conditions=LATE)
        assert not heard.verdicts, f"{seed} {body}: {heard.reasons[:2]}"
        assert heard.oracle.outcome is Outcome.CONFORMING


@pytest.mark.parametrize("block", range(2))
def test_lost_and_doubled_observations_of_such_a_policy_raise_no_alarm(block: int) -> None:
    for seed, body in trees(range(block * BLOCK, (block + 1) * BLOCK)):
        heard = judged(policy_of(body), seed, conditions=LOSSY, join_after=seed % 3)
        assert not heard.violations, f"{seed} {body}: {heard.reasons[:2]}"


@pytest.mark.parametrize("block", range(2))
def test_a_tree_that_forgets_at_its_end_is_found_in_the_middle_of_its_run(block: int) -> None:
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        draw = Random(seed)
        body = (
            f"<Sequence>{leaf('SetPoi1')}"
            f'<Repeat num_cycles="2"><Fallback>{leaf(draw.choice(CONDITIONS))}<Sleep msec="250"/></Fallback>'
            f'</Repeat><RetryUntilSuccessful num_attempts="2">{leaf(draw.choice(ACTIONS))}'
            "</RetryUntilSuccessful></Sequence>"
        )
        heard = run(tree(body), seed, conditions=LATE, join_after=1 + seed % 7)
        assert not heard.violations, f"{seed} {body}: {heard.reasons[:2]}"
        assert heard.oracle.outcome is Outcome.CONFORMING


@pytest.mark.parametrize("seed", range(150))
def test_a_tree_that_forgets_goes_on_as_a_fresh_one_once_it_has_ended(seed: int) -> None:
    draw = Random(seed)
    body = random_body(draw).replace("RunOnce", "Inverter")
    for script in SCRIPTED:
        body = body.replace(script, "<AlwaysSuccess/>")
    policy = tree(body)
    answers = {
        AskKind.TICK: ("SUCCESS", "FAILURE", "RUNNING"),
        AskKind.HALT: ("done",),
        AskKind.END: (BEGIN,),
        AskKind.OPEN: (ELAPSED, WAITING),
    }
    if not shape_of(policy).forgets:
        return
    made = Trees(policy, frozenset(), records=True)
    used = TreeRun(made)
    for _ in range(10):
        used.step(BEGIN)
        while used.ask.kind is not AskKind.END:
            used.step(draw.choice(answers[used.ask.kind]))
        if used.ask.status in ("SUCCESS", "FAILURE"):
            fresh = TreeRun(made)
            for _ in range(40):
                answer = draw.choice(answers[used.ask.kind])
                asked, fresh_asked = used.step(answer), fresh.step(answer)
                assert asked == fresh_asked
            fresh.close()
            break
    used.close()


A, B, C = leaf("SetPoi1"), leaf("SetPoi2"), leaf("Reset")
RIGHT = (
    f'<Sequence><RetryUntilSuccessful num_attempts="3">{A}</RetryUntilSuccessful>'
    f'<Repeat num_cycles="2"><Sequence>{B}<Sleep msec="250"/>{C}</Sequence></Repeat>'
    f"<Fallback>{leaf(WRITES)}<AlwaysSuccess/></Fallback>"
    f'<Fallback><Sequence><ScriptCondition code="n &gt; 1"/>{leaf("GoToPoi")}</Sequence>'
    f"{leaf('IsPoiDone1')}</Fallback></Sequence>"
)


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        (f'{B}<Sleep msec="250"/>{C}', f'{B}<Sleep msec="250"/>'),
        (f'{B}<Sleep msec="250"/>{C}', f'<Sleep msec="250"/>{C}'),
        (f'{B}<Sleep msec="250"/>{C}', f'{C}<Sleep msec="250"/>{B}'),
        (f'{B}<Sleep msec="250"/>{C}', f'<Sleep msec="250"/>{B}{C}'),
        (f'{B}<Sleep msec="250"/>{C}', f"{B}{C}"),
        (f'{B}<Sleep msec="250"/>', f'<ForceSuccess>{B}</ForceSuccess><Sleep msec="250"/>'),
        ('num_attempts="3"', 'num_attempts="2"'),
        ('num_cycles="2"', 'num_cycles="3"'),
        ("n &gt; 1", "n &lt; 2"),
        (leaf("GoToPoi"), leaf("IsPoiDone1")),
        (leaf(WRITES), f"<Inverter>{leaf('IsPoiDone1')}</Inverter>"),
        (f"{leaf('IsPoiDone1')}</Fallback></Sequence>", "</Fallback></Sequence>"),
        (
            f"{leaf('IsPoiDone1')}</Fallback>",
            f"<Inverter>{leaf('IsPoiDone1')}</Inverter></Fallback>",
        ),
    ],
)
def test_another_tree_is_found(was: str, becomes: str) -> None:
    """A leaf left out, another order, another child, a failure ignored, another count, another condition."""
    assert was in RIGHT
    other = policy_of(RIGHT.replace(was, becomes, 1))
    expected = policy_of(RIGHT)
    found = [bool(judged(expected, seed, ticks=400, actual=other).violations) for seed in range(4)]
    assert all(found), found


def mutant(body: str, draw: Random) -> str:
    """``body`` with one leaf left out, exchanged for another or inverted, or one decorator changed."""
    names = CONDITIONS + HALTED
    places = [m.span() for m in re.finditer(r"<(Action|Condition) [^>]*/>", body)]
    start, end = draw.choice(places)
    was = body[start:end]
    becomes = draw.choice(
        ["<AlwaysSuccess/>", f"<Inverter>{was}</Inverter>", leaf(draw.choice(names)), was + was]
    )
    if becomes == was + was:
        becomes = f"<Sequence>{was}{leaf(draw.choice(names))}</Sequence>"
    return body[:start] + becomes + body[end:]


def test_most_mutants_of_random_trees_are_found() -> None:
    found = missed = 0
    for seed, body in trees(range(80)):
        changed = mutant(body, Random(seed))
        if changed == body:
            continue
        heard = judged(policy_of(body), seed, actual=policy_of(changed), conditions=LATE)
        found += bool(heard.violations)
        missed += not heard.violations
    assert found > 3 * missed, (found, missed)


def test_without_its_reports_such_a_policy_is_inconclusive_and_that_is_said() -> None:
    policy = policy_of(RIGHT)
    heard = judged(policy, 1)
    oracle = PolicyOracle(policy)
    for observation in heard.observations:
        if observation.channel != TICKS_CHANNEL:
            oracle.feed(msgspec.structs.replace(observation, order=-1))
    oracle.advance(heard.observations[-1].received_ns + 10_000_000_000)
    assert oracle.outcome is Outcome.INCONCLUSIVE
    assert oracle.verdict().reason == (
        "what plugins and the clock answer is in its ticks (/policy/ticks), and none was received"
    )


def test_reports_of_an_earlier_m2c_lack_what_no_call_shows() -> None:
    policy = policy_of(RIGHT)
    heard = judged(policy, 1)
    oracle = PolicyOracle(policy)
    for observation in heard.observations:
        data = observation.data
        if observation.channel == TICKS_CHANNEL:
            old = ("name", "status", "duration_us")
            leaves = [{key: one[key] for key in old} for one in data["leaves"]]
            data = {**data, "leaves": leaves}
        oracle.feed(msgspec.structs.replace(observation, data=data))
    assert oracle.outcome is Outcome.INCONCLUSIVE
    assert "do not say what plugins wrote" in oracle.verdict().reason


def test_a_report_of_a_leaf_that_the_tree_does_not_tick_is_a_violation() -> None:
    policy = tree(f'<Repeat num_cycles="2"><Sequence>{A}<Sleep msec="250"/></Sequence></Repeat>')
    assert not shape_of(policy).plain
    other = tree(f'<Repeat num_cycles="2"><Sequence><Sleep msec="250"/>{A}</Sequence></Repeat>')
    heard = run(policy, 3, actual=other)
    assert heard.violations[0].reason.startswith(
        "expected tick SetPoi1 (/SetPoi1Skill/tick), observed"
    )
