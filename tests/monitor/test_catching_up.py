"""A monitor that stood still goes on with what has waited, where numbers show that nothing is missing."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.run import Run
from tests.monitor.hand_driven import MS, HandDriven, S
from transports.interface import Answer, ObservationKind

REQUEST, RESPONSE = "t/srv/Tick_Request", "t/srv/Tick_Response"


class Standing(HandDriven):
    """The battery is at 20; then the monitor stands still for a while."""

    repair_s = 0.1

    def __init__(self, folder: Path, stands_ns: int = 3 * S) -> None:
        super().__init__(folder)
        for node in ("policy", "Level", "Battery"):
            self.node(node, True)
        self.pass_time(1000)
        self.message(90)
        self.tick(1, status=0)
        self.pass_time(1000)
        self.message(20)
        self.tick(2, status=1)
        self.pass_time(1000)
        assert (self.status.verdict, self.watch.violations) == ("conforming", 0)
        self.stood_ns = self.now
        self.now += stands_ns

    def waited(self, after_ns: int, status: int, call: int = 3) -> None:
        """What happened ``after_ns`` after it had begun to stand still: a call, answered with ``status``."""
        stamp = {"stamp_ns": self.stood_ns + after_ns, "call": call}
        for source, kind in (("policy", "SENT"), ("Level", "RECEIVED")):
            self.hear(
                "/Level/tick", ObservationKind[f"REQUEST_{kind}"], REQUEST, {}, source, **stamp
            )
        stamp["stamp_ns"] += MS
        for source, kind in (("Level", "SENT"), ("policy", "RECEIVED")):
            what = ObservationKind[f"RESPONSE_{kind}"]
            self.hear("/Level/tick", what, RESPONSE, {"status": status}, source, **stamp)

    def charge(self, after_ns: int, data: int, **changes) -> None:
        """The level of the battery, ``after_ns`` after it had begun to stand still."""
        self.message(data, stamp_ns=self.stood_ns + after_ns, **changes)

    @property
    def is_anew(self) -> bool:
        """Whether it found the machine anew."""
        return self.watch.summary().counts.stalls > 0


@pytest.fixture
def level(tmp_path: Path) -> Standing:
    return Standing(tmp_path)


@pytest.mark.parametrize(("status", "violations"), [(1, 0), (0, 1)])
def test_what_happened_meanwhile_is_judged(level: Standing, status: int, violations: int) -> None:
    level.waited(1 * S, status)
    level.pass_time(1000)
    level.confirm()  # a level before the last one may have been lost
    level.confirm()
    assert level.watch.violations == violations
    assert not level.is_anew
    assert any("stood still for 3.0 s; what has waited was judged" in text for text in level.said)
    level.tick(9, status=0)
    level.confirm()
    level.confirm()
    assert level.watch.violations == violations + 1


@pytest.mark.parametrize(("charged_ns", "violations"), [(3 * S // 2, 0), (5 * S // 2, 1)])
def test_one_channel_comes_after_the_other_and_all_is_judged_in_its_order(
    level: Standing, charged_ns: int, violations: int
) -> None:
    level.waited(1 * S, status=1)
    level.waited(2 * S, status=0, call=4)
    level.charge(charged_ns, 90)
    level.pass_time(1000)
    level.confirm()
    level.confirm()
    assert level.watch.violations == violations
    assert not level.is_anew


def test_what_did_not_happen_meanwhile_is_found(level: Standing) -> None:
    """A request that is taken, and not answered."""
    stamp = {"stamp_ns": level.stood_ns + S, "call": 3}
    for source, kind in (("policy", "SENT"), ("Level", "RECEIVED")):
        level.hear("/Level/tick", ObservationKind[f"REQUEST_{kind}"], REQUEST, {}, source, **stamp)
    level.pass_time(1000)
    assert "unresponsive" in level.verdicts[-1].reason


def missing(level: Standing) -> None:
    level._numbers["Battery", "/battery", True] += 1


def answered_more(level: Standing) -> None:
    level.hear("/Level/tick", ObservationKind.REQUEST_SENT, REQUEST, {}, "policy", order=9, call=7)


def nameless(level: Standing) -> None:
    level.message(90, source="", sequence=-1)


def dropped(level: Standing) -> None:
    level.dropped = [("/battery", "Battery")]


def restarted(level: Standing) -> None:
    level.node("Battery", False)
    level.node("Battery", True)


def began_anew(level: Standing) -> None:
    level.since["Battery"] = level.now


@pytest.mark.parametrize("what", [missing, answered_more, nameless, dropped, restarted, began_anew])
def test_where_something_may_be_missing_the_machine_is_found_anew(level: Standing, what) -> None:
    level.waited(1 * S, status=1)
    what(level)
    level.charge(2 * S, 90)
    level.waited(3 * S - MS, status=1, call=4)
    level.pass_time(4000)
    assert level.is_anew
    assert level.watch.violations == 0


@pytest.mark.parametrize(("reported", "is_whole"), [(3, True), (4, False), (None, False)])
def test_who_can_be_asked_is_asked_how_far_it_has_reported(
    tmp_path: Path, reported: int | None, is_whole: bool
) -> None:
    level = Standing(tmp_path, 0)
    level.node("Other", True)
    for order in range(3):
        level.message(20, source="Other", order=order)
    level.watch._feed.sources.answered("Other", 3, level.now)
    level.pass_time(1000)
    level.asked.clear()
    level.stood_ns = level.now
    level.now += 3 * S
    level.waited(1 * S, status=0)
    answered = level.asked["Other"]
    level.pass_time(100)
    if reported is not None:
        answered(Answer(level.now, reported))
    level.pass_time(3000)
    assert level.is_anew is not is_whole
    level.confirm()
    level.confirm()
    assert level.watch.violations == is_whole


@pytest.mark.parametrize("is_again", [False, True])
def test_what_was_asked_before_it_woke_is_no_answer(tmp_path: Path, is_again: bool) -> None:
    level = Standing(tmp_path, 0)
    level.node("Other", True)
    level.message(20, source="Other", order=0)
    level.watch._feed.sources.answered("Other", 1, level.now)
    level.pass_time(1000)
    asked_ns = level.now
    level.now += 3 * S
    level.message(20)
    answered = level.asked["Other"]
    if is_again:
        asked_ns = level.now
        level.now += S
        level.message(20)
    answered(Answer(asked_ns, 1, asked_ns=asked_ns))
    level.pass_time(3000)
    assert level.is_anew


@pytest.mark.parametrize("repair_s", [0.0, 0.1])
def test_where_nothing_is_sent_again_all_nodes_have_to_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, repair_s: float
) -> None:
    """The last message of one that does not may have been dropped: nothing that comes shows it."""
    monkeypatch.setattr(Standing, "repair_s", repair_s)
    level = Standing(tmp_path)
    level.waited(1 * S, status=1)
    level.pass_time(3000)
    assert level.is_anew == (not repair_s)


def test_it_may_stand_still_once_more(level: Standing) -> None:
    level.waited(1 * S, status=1)
    level.now += 2 * S
    level.waited(4 * S, status=0, call=4)
    level.pass_time(1000)
    level.confirm()
    level.confirm()
    assert level.watch.violations == 1
    assert any("stood still for 5.0 s" in text for text in level.said)


def test_a_timer_that_rings_twice_is_no_error(tmp_path: Path) -> None:
    """As a damaged recording of a monitor has it."""
    level = Standing(tmp_path, 0)
    ring = level._turn
    ring()
    ring()
    level.pass_time(1000)
    assert (level.status.verdict, level.is_anew) == ("conforming", False)


def test_what_is_longer_is_not_made_up_for(tmp_path: Path) -> None:
    level = Standing(tmp_path, 11 * S)
    level.waited(1 * S, status=0)
    level.pass_time(2000)
    assert level.is_anew
    assert level.watch.violations == 0


@pytest.mark.parametrize("ends", [Run.settle, Run.close])
def test_one_that_ends_meanwhile_says_nothing_of_it(level: Standing, ends) -> None:
    level.waited(1 * S, status=0)
    ends(level.watch)
    assert level.status.verdict == "inconclusive"
    assert level.watch.violations == 0
    assert level.is_anew


def test_nodes_that_ended_while_it_stood_still_for_a_moment_did_so_as_they_were(
    tmp_path: Path,
) -> None:
    """The monitor hears of their end in its turn. Until then it takes no node for one that has started again."""
    level = Standing(tmp_path, 450 * MS)
    before = list(level.verdicts)
    for node in ("policy", "Level", "Battery"):
        level.node(node, False)
    level.pass_time(4000)
    assert (level.status.verdict, level.status.states) == ("conforming", ("(gone)",))
    assert level.verdicts == before
