"""What becomes of single observations: repeated, renumbered, unreadable, of equal stamps."""

from __future__ import annotations

import functools
import gc
import threading
from collections.abc import Iterable

import msgspec
import pytest

from moon.policy import PolicyOracle
from moon.policy.calls import call_of
from moon.verdict import Outcome, Verdict
from tests.monitor_policy.scripted import Heard, leaf, run, tree
from transports.interface import Observation, ObservationKind

BODY = (
    f"<ReactiveSequence>{leaf('BatteryLevel')}<Fallback>{leaf('SetPoi1')}{leaf('SetPoi2')}</Fallback>"
    f"{leaf('GoToPoi')}</ReactiveSequence>"
)


@functools.cache
def nominal() -> Heard:
    """A run with nothing wrong in it."""
    heard = run(tree(BODY), 5)
    assert not heard.verdicts
    return heard


def own() -> list[Observation]:
    """What the policy did in that run, in order."""
    found = [
        seen
        for seen in nominal().observations
        if seen.source == "policy" and seen.kind is not ObservationKind.MESSAGE
    ]
    found.sort(key=lambda seen: seen.stamp_ns)
    # all that it reports is numbered; these are all here
    return [msgspec.structs.replace(seen, order=order) for order, seen in enumerate(found)]


def judged(
    observations: Iterable[Observation], oracle: PolicyOracle | None = None
) -> tuple[PolicyOracle, list[Verdict]]:
    """An oracle that has heard ``observations`` and then nothing for long."""
    oracle = oracle or PolicyOracle(tree(BODY))
    verdicts: list[Verdict] = []
    last = 0
    for seen in observations:
        verdicts += oracle.feed(seen)
        last = max(last, seen.received_ns)
    return oracle, verdicts + oracle.advance(last + 10**10)


def test_observations_in_any_order_within_the_latency_bound_are_put_in_order() -> None:
    seen = own()
    shuffled = [
        msgspec.structs.replace(each, received_ns=each.stamp_ns + (k * 7919) % 190 * 1_000_000)
        for k, each in enumerate(seen)
    ]
    # on one channel, nothing overtakes: numbers would show it
    latest: dict[str, int] = {}
    for k, each in enumerate(shuffled):
        at = max(each.received_ns, latest.get(each.channel, 0))
        latest[each.channel] = at
        shuffled[k] = msgspec.structs.replace(each, received_ns=at)
    shuffled.sort(key=lambda each: each.received_ns)
    assert [each.stamp_ns for each in shuffled] != [each.stamp_ns for each in seen]
    oracle, verdicts = judged(shuffled)
    assert not verdicts
    assert oracle.outputs == len(seen) / 2


def test_an_observation_that_is_heard_twice_counts_once() -> None:
    oracle, verdicts = judged(each for seen in own() for each in (seen, seen))
    assert not verdicts
    assert oracle.repeated == len(own())


def twice() -> tuple[list[Observation], list[Observation]]:
    """A run that is cut off in the middle of a tick, and another, whose numbers begin anew."""
    first = own()[:100]
    later = first[-1].stamp_ns - first[0].stamp_ns + 10**9
    again = [
        msgspec.structs.replace(
            seen, stamp_ns=seen.stamp_ns + later, received_ns=seen.received_ns + later
        )
        for seen in own()
    ]
    return first, again


def test_a_policy_that_starts_again_is_found_by_its_numbers() -> None:
    first, again = twice()
    oracle, verdicts = judged([*first, *again])
    assert [v.outcome for v in verdicts] == [Outcome.INCONCLUSIVE]
    assert "was restarted" in verdicts[0].reason
    assert oracle.outcome is Outcome.CONFORMING


def test_a_policy_that_is_known_to_start_again_is_followed_from_its_first_tick() -> None:
    first, again = twice()
    oracle = PolicyOracle(tree(BODY))
    for seen in first:
        assert not oracle.feed(seen)
    oracle.start(again[0].stamp_ns - 1)
    _, verdicts = judged(again, oracle)
    assert not verdicts
    assert oracle.outcome is Outcome.CONFORMING


def test_what_a_policy_did_before_it_was_known_to_be_up_is_not_lost() -> None:
    first, again = twice()
    oracle = PolicyOracle(tree(BODY))
    for seen in [*first, *again[:2]]:
        oracle.feed(seen)
    oracle.start(again[0].stamp_ns - 1)
    assert oracle.outcome is Outcome.CONFORMING
    _, verdicts = judged(again[2:], oracle)
    assert not verdicts


def test_a_policy_whose_first_call_was_not_heard_is_found_in_the_middle() -> None:
    oracle, verdicts = judged(own()[1:])
    assert [v.outcome for v in verdicts] == [Outcome.INCONCLUSIVE]
    assert oracle.outcome is Outcome.CONFORMING


@pytest.mark.parametrize("data", [None, {}, {"other": 1}, 5, {"status": [0]}, {"status": "0"}])
def test_an_answer_that_cannot_be_read_makes_it_inconclusive(data: object) -> None:
    seen = own()
    place = next(
        k for k, s in enumerate(seen) if k > 50 and s.kind is ObservationKind.RESPONSE_RECEIVED
    )
    seen[place] = msgspec.structs.replace(seen[place], data=data, error="")
    _, verdicts = judged(seen)
    assert [v.outcome for v in verdicts] == [Outcome.INCONCLUSIVE]
    assert "cannot be read" in verdicts[0].reason


def test_a_call_and_the_answer_before_it_may_have_equal_stamps() -> None:
    """An answer is told as late as the call that follows it; they are heard the wrong way round."""
    seen = own()
    for place in range(1, len(seen) - 1, 2):
        answer, call = seen[place], seen[place + 1]
        if answer.channel != call.channel and call.stamp_ns - answer.stamp_ns < 10**6:
            seen[place] = msgspec.structs.replace(call, stamp_ns=answer.stamp_ns)
            seen[place + 1] = answer
    oracle, verdicts = judged(seen)
    assert not verdicts
    assert oracle.outcome is Outcome.CONFORMING


@pytest.mark.parametrize("skew_ns", [-(10**9), -(10**6)])
def test_what_comes_after_its_time_is_not_judged(skew_ns: int) -> None:
    seen = own()
    seen[60] = msgspec.structs.replace(seen[60], stamp_ns=seen[60].stamp_ns + skew_ns)
    oracle, verdicts = judged(seen)
    assert Outcome.VIOLATED not in {v.outcome for v in verdicts} or skew_ns == -(10**6)
    assert oracle.outcome is Outcome.CONFORMING


def test_a_violation_is_told_with_what_led_there() -> None:
    """One answer is heard as another than the policy got: what it does next is wrong then."""
    seen = own()
    place = next(
        k
        for k, s in enumerate(seen)
        if s.channel == "/BatteryLevelSkill/tick"
        and s.kind is ObservationKind.RESPONSE_RECEIVED
        and isinstance(s.data, dict)
        and not s.error
        and s.data["status"] == 0
    )
    seen[place] = msgspec.structs.replace(seen[place], data={"status": 1})
    oracle, verdicts = judged(seen)
    first = verdicts[0]
    assert first.outcome is Outcome.VIOLATED
    assert first.stamp_ns == seen[place + 1].stamp_ns
    assert first.explanation is not None
    assert first.explanation.evidence[-1].text == "answer FAILURE on /BatteryLevelSkill/tick"
    assert oracle.violations == len([v for v in verdicts if v.outcome is Outcome.VIOLATED])
    assert oracle.outcome is Outcome.CONFORMING, "not found again"


def test_an_oracle_leaves_no_threads_behind() -> None:
    oracle, _ = judged(own()[:31])
    assert oracle.states()
    running = [thread for thread in threading.enumerate() if thread.name == "policy run"]
    del oracle
    gc.collect()
    left = [thread for thread in threading.enumerate() if thread.name == "policy run"]
    assert len(left) < len(running)


LATE = "/SetPoi1Skill/tick"
"""The channel that a tap finds last."""


def found_in_the_middle(since_ns: int, until_ns: int) -> list[Verdict]:
    """What is said of who does not number all that he does: ``LATE`` is received from ``until_ns`` on.

    ``since_ns``: so long after the first observation everything is received.
    """
    seen = [msgspec.structs.replace(one, order=-1) for one in own()]
    began_ns = seen[0].stamp_ns
    heard = [one for one in seen if one.channel != LATE or one.stamp_ns > began_ns + until_ns]
    oracle = PolicyOracle(tree(BODY), synchronised=False)
    oracle.listen(began_ns + since_ns)
    _, verdicts = judged(heard[1:], oracle)
    return [verdict for verdict in verdicts if verdict.outcome is Outcome.VIOLATED]


@pytest.mark.parametrize("until_ms", range(3_900, 4_200, 30))
def test_a_call_of_which_the_channel_is_not_found_yet_may_have_been_missed(until_ms: int) -> None:
    """Also where it is found before anything is said of that call."""
    assert not found_in_the_middle(since_ns=5 * 10**9, until_ns=until_ms * 10**6)


def test_a_call_that_never_comes_is_missing_once_all_channels_are_found() -> None:
    assert found_in_the_middle(since_ns=5 * 10**9, until_ns=10**12)
    assert found_in_the_middle(since_ns=0, until_ns=4 * 10**9)


@pytest.mark.parametrize("late_ms", [250, 900, 3_000])
def test_a_call_that_comes_late_by_itself_accuses_nobody(late_ms: int) -> None:
    """On ROS 2 each channel is numbered by itself, and comes when it comes; the tick goes on without it."""
    seen = [msgspec.structs.replace(one, order=-1) for one in own()]
    for number in range(0, len(seen), 14):
        call = call_of(seen[number])
        mixed = [
            msgspec.structs.replace(one, received_ns=one.received_ns + late_ms * 1_000_000)
            if call_of(one) == call
            else one
            for one in seen
        ]
        mixed.sort(key=lambda one: one.received_ns)
        _, verdicts = judged(mixed)
        assert Outcome.VIOLATED not in {verdict.outcome for verdict in verdicts}, number


def test_a_call_that_is_left_out_is_missing_once_no_report_of_it_can_come_any_more() -> None:
    """The policy that runs has no leaf ``GoToPoi``, so nothing ever comes on its channel."""
    seen = [msgspec.structs.replace(one, order=-1) for one in own()]
    place = [one.channel for one in seen].index("/GoToPoiSkill/tick", 100)
    kept = [one for k, one in enumerate(seen) if k < place or one.channel != "/GoToPoiSkill/tick"]
    _, verdicts = judged(kept)
    found = [verdict for verdict in verdicts if verdict.outcome is Outcome.VIOLATED]
    assert found
    assert found[0].stamp_ns >= seen[place].stamp_ns
