"""The robots of a fleet: each judged by itself, as it comes and goes."""

from __future__ import annotations

import msgspec
import pytest

from moon.fleet.choice import Shard
from moon.fleet.notices import RobotNotices
from moon.fleet.report import closing, table
from moon.fleet.robot import Robot
from moon.fleet.screen import Troubles
from moon.monitor.machines import MIDDLE
from moon.sources.source import Outputs
from moon.verdict import Outcome, Verdict
from tests.fleet.by_hand import FleetByHand


@pytest.fixture
def by_hand(tmp_path) -> FleetByHand:
    return FleetByHand(tmp_path)


def test_a_violation_of_one_robot_concerns_no_other(by_hand) -> None:
    good, bad = by_hand.robot("robots/r1"), by_hand.robot("robots/r2")
    for robot in (good, bad):
        robot.start()
    for _ in range(3):
        good.run()
        bad.run(status=1)
    assert {v.robot for v in by_hand.verdicts if v.outcome == "violated"} == {"robots/r2"}
    assert {v.robot for v in by_hand.verdicts} == {"robots/r1", "robots/r2"}
    assert by_hand.status("robots/r1").verdict == "conforming"
    assert by_hand.status("robots/r1").fine == by_hand.status("robots/r1").judged
    wrong = by_hand.status("robots/r2")
    assert (wrong.verdict, wrong.fine) == ("violated", wrong.judged - 1)
    assert [machine.machine for machine in wrong.machines] == ["Level"]
    assert wrong.last.startswith("Level: expected response on /Level/tick")
    assert by_hand.fleet.is_violated
    assert by_hand.fleet.violations == wrong.violations == 3


def test_verdicts_are_published_in_the_namespace_of_their_robot_only(by_hand) -> None:
    good, bad = by_hand.robot("robots/r1"), by_hand.robot("robots/r2")
    for robot in (good, bad):
        robot.start()
        robot.run(status=1 if robot is bad else 0)
    for robot, expected in ((good, False), (bad, True)):
        assert {channel for channel, _ in robot.published} == {"/moon/verdicts"}
        assert any(m.outcome == "violated" for _, m in robot.published) is expected


def test_a_robot_whose_nodes_have_all_gone_keeps_its_line_but_not_its_judges(by_hand) -> None:
    robot = by_hand.robot("robots/r1")
    robot.start()
    robot.run()
    received = by_hand.status("robots/r1").received
    assert received > 0
    robot.end()
    robot.pass_time(1000)
    assert robot.is_open  # it may be back soon
    robot.pass_time(40_000)
    assert not robot.is_open
    status = by_hand.status("robots/r1")
    assert (status.verdict, status.present, status.received) == ("conforming", False, received)
    summary = by_hand.fleet.summary()
    assert summary.robots == {"gone, conforming until it ended": 1}
    assert summary.troubled == ()


def test_a_robot_that_is_back_soon_is_followed_by_the_same_judges_from_its_start(by_hand) -> None:
    robot = by_hand.robot("robots/r1")
    robot.start()
    robot.run()
    robot.end()
    robot.pass_time(5000)
    robot.forget_numbers("Level")
    robot.forget_numbers("policy")
    robot.start()
    robot.pass_time(40_000)
    assert robot.is_open
    assert robot.opened == 1
    robot.run()
    assert by_hand.status("robots/r1").verdict == "conforming"
    by_hand.fleet.look_around()
    assert "robots/r1: Level has started again" in by_hand.said


def test_a_robot_that_is_back_late_is_judged_anew_and_what_it_violated_before_counts(
    by_hand,
) -> None:
    robot = by_hand.robot("robots/r1")
    robot.start()
    robot.run(status=1)
    robot.end()
    robot.pass_time(40_000)
    (machine,) = by_hand.status("robots/r1").machines
    assert (machine.machine, machine.verdict) == ("Level", "violated")
    assert by_hand.fleet.summary().robots == {"gone, violated": 1}
    robot.start()
    assert robot.opened == 2
    robot.run()
    assert by_hand.fleet.violations == 1
    assert by_hand.status("robots/r1").verdict == "violated"
    robot.run(status=1)
    assert by_hand.fleet.violations == 2


def test_there_are_so_many_robots_at_most_and_who_is_gone_for_longest_makes_room(tmp_path) -> None:
    by_hand = FleetByHand(tmp_path, most=2)
    first, second = by_hand.robot("robots/r1"), by_hand.robot("robots/r2")
    first.start()
    first.run(status=1)
    second.start()
    for name in ("robots/r3", "robots/r4"):
        by_hand.changed(name, True)
        by_hand.changed(name, False)
    assert sum("more than 2 robots" in sentence for sentence in by_hand.said) == 1
    first.end()
    by_hand.robot("robots/r5").start()
    assert [robot.name for robot in by_hand.fleet.robots()] == ["robots/r2", "robots/r5"]
    assert not first.is_open
    assert by_hand.fleet.violations == 1
    assert by_hand.fleet.summary().robots["forgotten"] == 1


def test_a_share_takes_its_own_robots_and_says_that_the_others_are_there(tmp_path) -> None:
    shares = [FleetByHand(tmp_path, Shard(number, 2)) for number in (1, 2)]
    names = {f"robots/r{number}" for number in range(20)}
    for share in shares:
        for name in sorted(names):
            share.changed(name, True)
    taken = [{robot.name for robot in share.fleet.robots()} for share in shares]
    assert taken[0] | taken[1] == names
    assert not taken[0] & taken[1]
    other = FleetByHand(tmp_path, Shard(1, 2))
    other.changed(min(taken[1]), True)
    for _ in range(5):
        other.fleet.look_around()
    assert other.said == ["1 robot is there, none of shard 1/2: waiting for one"]


def test_that_nobody_matches_is_said_once(by_hand) -> None:
    for _ in range(20):
        by_hand.fleet.look_around()
    assert by_hand.said == [
        "no robot in robots/* yet: waiting for one; is this the endpoint where the robots' nodes meet?"
    ]


def test_who_comes_and_goes_is_said_together(by_hand) -> None:
    for number in range(10):
        by_hand.changed(f"robots/r{number}", True)
    by_hand.fleet.look_around()
    by_hand.changed("robots/r3", False)
    by_hand.fleet.look_around()
    by_hand.fleet.look_around()
    named = ", ".join(f"robots/r{number}" for number in range(8))
    assert by_hand.said == [
        f"10 robots: + {named} and 2 more",
        "9 robots: - robots/r3",
    ]


def test_a_fault_of_the_monitor_concerns_the_robot_whose_input_led_to_it(by_hand) -> None:
    one, other = by_hand.robot("robots/r1"), by_hand.robot("robots/r2")
    for robot in (one, other):
        robot.start()
    try:
        raise ValueError("it was not thought of")
    except ValueError as error:
        one.fail(error)
    assert not one.is_open
    other.run(status=1)
    assert by_hand.status("robots/r2").verdict == "violated"
    status = by_hand.status("robots/r1")
    assert status.verdict == "inconclusive"
    assert "not judged any more: ValueError: it was not thought of (" in status.last
    assert by_hand.fleet.failures == 1
    one.end()
    one.start()  # what led to the fault may lead there again
    assert not one.is_open


def test_problems_are_said_with_the_robot_they_are_of(by_hand) -> None:
    robot = by_hand.robot("robots/r1")
    robot.start()
    robot.heard_by_tap.append("missed 5 messages on /battery from Battery")
    by_hand.robot("robots/r2").start()
    by_hand.fleet.look_around()
    by_hand.fleet.look_around()
    warnings = [sentence for sentence in by_hand.said if "warning" in sentence]
    assert warnings == ["robots/r1: warning: missed 5 messages on /battery from Battery"]
    assert set(by_hand.fleet.summary().problems) == {"robots/r1"}


def test_what_is_so_of_many_robots_is_said_once() -> None:
    said: list[str] = []
    notices = RobotNotices(said.append)
    for number in range(9):
        notices.of(f"robots/r{number}")(f"this monitor stood still for 0.{number + 1} s")
    notices.of("robots/r3")("Level has started again")
    notices.flush()
    notices.flush()
    named = ", ".join(f"robots/r{number}" for number in range(5))
    assert said == [
        f"{named} and 4 more: this monitor stood still for 0.1 s",
        "robots/r3: Level has started again",
    ]


def test_the_end_has_a_line_for_each_robot_that_is_not_fine_and_totals(by_hand) -> None:
    for number in range(5):
        robot = by_hand.robot(f"robots/r{number}")
        robot.start()
        robot.run(status=1 if number == 3 else 0)
    summary = by_hand.fleet.summary()
    heading, row = table(summary.troubled)
    assert heading.split() == ["robot", "verdict", "machines", "obs/s", "last"]
    assert row.split()[:3] == ["robots/r3", "violated", "0/1"]
    (last,) = closing(msgspec.structs.replace(summary, seconds=12.0))
    assert last.startswith("1 violation in 12.0 s; 5 robots: 4 conforming, 1 violated; received ")


def test_people_are_not_told_of_each_machine_that_it_conforms(by_hand) -> None:
    robot = by_hand.robot("robots/r1")
    robot.start()
    robot.run()
    robot.run(status=1)
    troubles = Troubles()
    told = [str(verdict.outcome) for verdict in by_hand.shown if troubles.concerns(verdict)]
    assert "conforming" not in told
    assert told[-1] == "violated"
    conforming = next(v for v in by_hand.shown if v.outcome == "conforming")
    assert troubles.concerns(conforming)  # as it was violated before
    assert not troubles.concerns(conforming)
    middle = msgspec.structs.replace(conforming, outcome=Outcome.INCONCLUSIVE, reason=MIDDLE)
    assert not troubles.concerns(middle)


def test_the_last_of_a_robot_is_about_how_it_stands_now() -> None:
    def say(node: str, outcome: Outcome, reason: str = "") -> None:
        robot.take(Verdict(node, node, outcome, 1, reason))

    robot = Robot("robots/r1", None, None, Outputs())
    assert robot.status().last == ""
    say("A", Outcome.INCONCLUSIVE, "observations were lost")
    say("B", Outcome.INCONCLUSIVE, "started in the middle of a run")
    assert robot.status().last == "B: started in the middle of a run"
    say("B", Outcome.CONFORMING)
    assert robot.status().last == "A: observations were lost"
    say("A", Outcome.CONFORMING)
    assert (robot.status().verdict, robot.status().last) == ("conforming", "")


def test_the_last_of_a_robot_that_was_violated_is_its_last_violation(by_hand) -> None:
    bad = by_hand.robot("robots/r2")
    bad.start()
    bad.run(status=1)
    wrong = by_hand.status("robots/r2").last
    assert wrong.startswith("Level: expected response on /Level/tick")
    bad.end()
    bad.pass_time(40_000)
    bad.start()
    bad.run()
    status = by_hand.status("robots/r2")
    assert (status.verdict, status.last) == ("violated", wrong)


def test_the_last_of_a_robot_is_the_newest_of_violations_that_repeat_one_another(by_hand) -> None:
    bad = by_hand.robot("robots/r2")
    bad.start()
    bad.run(status=1)
    first = by_hand.status("robots/r2").last
    bad.run(status=2)
    status = by_hand.status("robots/r2")
    said = [v for v in by_hand.verdicts if v.outcome is Outcome.VIOLATED]
    assert len(said) == 1, "the same response, the same field"
    assert status.violations == 2
    assert first.endswith("observed response on /Level/tick {status: 1}")
    assert status.last.endswith("observed response on /Level/tick {status: 2}")
