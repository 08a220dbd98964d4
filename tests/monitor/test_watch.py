"""What the monitor makes of nodes, clocks and odd observations; time and nodes moved by hand."""

from __future__ import annotations

import msgspec
import pytest

from tests.monitor.hand_driven import MS, START, HandDriven, S


def outcomes_shown(watched: HandDriven) -> list[str]:
    return [str(verdict.outcome) for verdict in watched.shown]


@pytest.fixture
def hand(tmp_path) -> HandDriven:
    return HandDriven(tmp_path)


@pytest.fixture
def started(hand) -> HandDriven:
    """A node that came up while the monitor listened, and works; its publisher is linked to it."""
    hand.pass_time(100)
    hand.node("Level", True)
    hand.pass_time(500)
    hand.message(90)
    hand.pass_time(6000)
    hand.message(90)
    hand.pass_time(500)
    assert hand.outcomes == ["conforming"]
    return hand


def test_a_node_that_starts_while_it_listens_is_known_from_its_first_tick(started) -> None:
    started.tick(1, status=0)
    started.pass_time(500)
    assert started.outcomes == ["conforming"]
    assert started.status.states == ("idle",)
    started.tick(2, status=1)
    started.pass_time(500)
    assert started.outcomes == ["conforming", "inconclusive"]  # a level may have been lost
    started.message(90)
    started.pass_time(100)
    assert started.outcomes == ["conforming", "inconclusive", "violated"]
    (wrong,) = [verdict for verdict in started.verdicts if verdict.explanation]
    assert wrong.explanation.expected == ("response on /Level/tick {status: 0} to policy",)
    assert wrong.explanation.observed == "response on /Level/tick {status: 1}"
    assert wrong.explanation.places[0].endswith("Level.scxml:9:5")
    assert wrong.explanation.states == ("idle (level=90)",)


def test_a_node_that_was_there_before_is_found_in_the_middle(hand) -> None:
    hand.pass_time(100)
    hand.node("Level", True, since=START - S)
    hand.tick(1, status=1)  # its level may be anything
    hand.pass_time(1000)
    hand.message(20)
    hand.pass_time(6000)  # its publisher is linked to it
    hand.message(20)
    hand.pass_time(1000)
    hand.tick(2, status=1)
    hand.pass_time(1000)
    assert hand.watch.violations == 0
    assert hand.outcomes == ["inconclusive", "conforming"]
    hand.message(90)
    hand.pass_time(1000)
    hand.tick(3, status=1)
    hand.confirm()
    assert hand.watch.violations == 1


@pytest.mark.parametrize(("silent_ms", "violations"), [(6500, 1), (6000, 0), (4000, 0)])
def test_the_first_thing_that_a_silent_node_does_is_judged_unless_it_was_just_found(
    hand, silent_ms: int, violations: int
) -> None:
    """It may have been asked before this monitor was linked to it, and may have stood still since."""
    hand.pass_time(100)
    hand.node("Level", True, since=START - S)
    hand.pass_time(silent_ms)
    hand.tick(1, status=7)
    hand.pass_time(500)
    assert hand.watch.violations == violations


def test_a_node_that_is_never_heard_owes_nothing(hand) -> None:
    hand.pass_time(100)
    hand.node("Level", True, since=START - S)
    hand.pass_time(10_000)
    assert hand.watch.violations == 0
    assert hand.status.states == ()


def test_a_node_whose_start_is_not_told_is_found_in_the_middle(hand) -> None:
    hand.pass_time(100)
    hand.node("Level", True, since=0)
    hand.tick(1, status=1)
    hand.pass_time(1000)
    assert "violated" not in hand.outcomes


def test_a_missing_answer_is_found_by_the_timer(started) -> None:
    started.tick(1)
    asked = started.now
    while started.outcomes[-1] == "conforming":
        started.pass_time(10)
    assert 1000 * MS <= started.now - asked <= 1250 * MS
    assert started.verdicts[-1].reason.startswith(
        "if no observation is missing here: unresponsive: "
    )
    assert started.watch.violations == 0
    started.confirm()
    (late,) = [verdict for verdict in started.verdicts if verdict.explanation]
    assert late.reason.startswith("unresponsive: ")
    assert 1000 * MS <= late.stamp_ns - asked <= 1250 * MS


def give_up(watched) -> None:
    watched.hear(
        "/Level/tick",
        "response_received",
        "t/srv/Tick_Response",
        None,
        "policy",
        call=1,
        error="timeout: /Level/tick: no answer within the time limit",
    )


def test_a_missing_answer_is_certain_once_its_client_gave_up_and_its_node_was_heard(
    started,
) -> None:
    started.tick(1)
    started.pass_time(1500)
    started.message(90)
    give_up(started)
    started.pass_time(500)
    assert started.watch.violations == 0  # the network between both may be cut
    started.tick(2)
    started.pass_time(500)
    assert started.watch.violations == 1
    assert started.verdicts[-1].reason.startswith("unresponsive: ")


def test_a_node_that_is_still_there_when_a_cut_would_have_shown_did_not_answer(started) -> None:
    started.tick(1)
    started.pass_time(1500)
    started.message(90)
    give_up(started)
    started.pass_time(17_000)
    assert started.watch.violations == 0
    started.pass_time(5_000)
    assert started.watch.violations == 1


@pytest.mark.parametrize("error", ["unavailable: nobody answers", "remote_error: it was refused"])
def test_a_call_that_failed_otherwise_shows_nothing_of_the_answer(started, error: str) -> None:
    started.tick(1)
    started.pass_time(1500)
    started.message(90)
    started.hear(
        "/Level/tick",
        "response_received",
        "t/srv/Tick_Response",
        None,
        "policy",
        call=1,
        error=error,
    )
    started.pass_time(500)
    assert started.watch.violations == 0


def test_an_answer_that_its_client_got_was_given(started) -> None:
    started.tick(1)
    started.hear(
        "/Level/tick",
        "response_received",
        "t/srv/Tick_Response",
        {"status": 0},
        "policy",
        call=1,
    )
    started.pass_time(2000)
    started.confirm()
    started.confirm()
    assert started.watch.violations == 0


def test_a_violation_that_goes_on_stays_one_while_the_next_is_not_certain(started) -> None:
    for call in range(1, 4):
        started.message(90)
        started.pass_time(500)
        started.tick(call, status=1)
        started.pass_time(500)
    started.message(90)
    started.pass_time(500)
    assert started.watch.violations == 3
    assert started.outcomes == ["conforming", "inconclusive", "violated"]


def test_the_same_violation_again_is_counted_and_not_told_again(started) -> None:
    for call in range(1, 4):
        started.message(90)
        started.pass_time(500)
        started.tick(call, status=1)
        started.message(90)
        started.pass_time(500)
    assert started.watch.violations == 3
    assert started.status.violations == 3
    assert started.outcomes == ["conforming", "violated"]


def test_a_link_that_comes_again_is_not_taken_for_a_new_start(started) -> None:
    since = started.since["Level"]
    started.message(20)
    started.pass_time(500)
    started.node("Level", False)
    started.pass_time(1000)
    started.node("Level", True, since=since)
    started.pass_time(300)
    started.tick(1, status=1)  # right, as its level is 20: had it started anew, it would be 100
    started.pass_time(1000)
    assert started.watch.violations == 0


def let_end(started) -> None:
    """``Level`` ends; its next life numbers anew."""
    started.message(20)
    started.pass_time(500)
    started.node("Level", False)
    started.pass_time(1000)
    started.forget_numbers("Level")


def test_a_restarted_node_is_followed_from_its_initial_state(started) -> None:
    let_end(started)
    started.node("Level", True)
    started.pass_time(500)
    started.tick(1, status=0)
    started.pass_time(500)
    assert started.watch.violations == 0
    assert "Level has started again" in started.said
    started.tick(2, status=1)
    started.level = 100  # as it begins
    started.confirm()
    assert started.watch.violations == 1


def test_a_node_that_was_heard_before_it_was_found_has_started_again_all_the_same(started) -> None:
    let_end(started)
    since = started.now
    started.tick(1, status=0)
    started.node("Level", True, since=since)
    started.pass_time(500)
    assert "Level has started again" in started.said
    assert started.watch.violations == 0


def test_what_a_node_did_before_it_died_and_was_received_later_is_not_of_the_next(started) -> None:
    started.tick(1, status=0)
    died_ns = started.now
    started.node("Level", False)
    started.hear(
        *("/Level/tick", "request_received", "t/srv/Tick_Request", {}, "Level"),
        call=2,
        stamp_ns=died_ns,
    )
    started.pass_time(1000)
    started.forget_numbers("Level")
    started.node("Level", True)
    started.pass_time(500)
    started.tick(3, status=0)
    started.pass_time(500)
    assert started.outcomes == ["conforming"]


def test_a_restart_whose_end_was_not_heard_is_noticed(started) -> None:
    started.message(20)
    started.pass_time(500)
    started.forget_numbers("Level")
    started.since["Level"] = started.now  # no `went away`, no `came up`
    started.pass_time(500)
    started.tick(1, status=0)
    started.pass_time(500)
    assert started.watch.violations == 0


def test_a_node_heard_before_it_was_known_to_be_up_is_found_in_the_middle(hand) -> None:
    hand.pass_time(100)
    since = hand.now
    hand.message(20)
    hand.tick(1, status=1)
    hand.node("Level", True, since=since)
    hand.pass_time(500)
    hand.tick(2, status=1)
    hand.pass_time(500)
    assert hand.watch.violations == 0


def test_a_node_that_went_away_owes_nothing_and_what_was_known_stands(started) -> None:
    started.tick(1, status=0)
    started.tick(2)
    started.node("Level", False)
    started.pass_time(5000)
    assert started.watch.violations == 0
    assert started.status.verdict == "conforming"
    assert started.status.states == ("(gone)",)


def test_what_a_node_sent_wrongly_before_it_went_away_is_still_judged(started) -> None:
    started.tick(1, status=1)
    started.node("Level", False)
    started.message(90)
    started.pass_time(1000)
    assert started.watch.violations == 1


def test_a_monitor_that_stood_still_says_so_and_finds_machines_anew(started) -> None:
    started.tick(1)  # the answer is not heard
    started.jump(60 * S)
    assert [text for text in started.said if "stood still for 60.0 s" in text]
    assert started.watch.violations == 0
    started.pass_time(200)
    assert started.outcomes[-1] == "inconclusive"
    started.pass_time(500)
    started.tick(2, status=1)  # it may have got anything meanwhile
    started.pass_time(1000)
    assert started.watch.violations == 0
    started.message(90)
    started.pass_time(1000)
    started.tick(3, status=0)
    started.pass_time(1000)
    assert started.outcomes[-1] == "conforming"
    started.tick(4, status=1)  # a level before the first one may have been lost
    started.confirm()
    assert started.watch.violations == 0
    started.confirm()
    started.tick(5, status=1)
    started.confirm()
    assert started.watch.violations == 1
    assert outcomes_shown(started)[-1] == "violated"
    assert started.watch.summary().counts.stalls == 1


def test_people_are_told_once_that_all_machines_are_resynchronised_not_of_each(started) -> None:
    started.jump(60 * S)
    started.pass_time(500)
    assert started.outcomes == ["conforming", "inconclusive"]
    started.message(90)
    started.pass_time(1000)
    started.tick(1, status=0)
    started.pass_time(1000)
    assert started.outcomes == ["conforming", "inconclusive", "conforming"]
    assert outcomes_shown(started) == ["conforming"]
    assert len([text for text in started.said if "all machines are resynchronised" in text]) == 1
    started.message(
        20, sequence=17
    )  # some were lost: inconclusive for a reason of this machine's own
    started.pass_time(50)
    assert outcomes_shown(started) == ["conforming", "inconclusive"]


def test_a_node_that_ends_while_its_machine_is_resynchronised_keeps_its_verdict(started) -> None:
    started.jump(60 * S)
    started.pass_time(500)
    assert started.outcomes[-1] == "inconclusive"
    started.node("Level", False)
    started.pass_time(2000)
    assert started.outcomes == ["conforming", "inconclusive", "conforming"]
    assert outcomes_shown(started) == ["conforming"]
    assert started.status.verdict == "conforming"
    assert started.status.has_ended


def test_a_node_that_was_in_violation_and_ends_while_it_is_resynchronised_still_is(started) -> None:
    started.tick(1, status=1)
    started.message(90)
    started.pass_time(500)
    assert started.outcomes[-1] == "violated"
    why = started.status.last
    started.jump(60 * S)
    started.pass_time(500)
    started.node("Level", False)
    started.pass_time(2000)
    assert (started.status.verdict, started.status.last) == ("violated", why)


def test_what_was_in_doubt_before_all_were_resynchronised_is_so_at_the_end(started) -> None:
    started.tick(1)
    started.pass_time(1500)
    assert "if no observation is missing here" in started.verdicts[-1].reason
    started.jump(60 * S)
    started.pass_time(500)
    started.node("Level", False)
    started.pass_time(2000)
    assert started.status.verdict == "inconclusive"


def test_a_doubt_of_another_kind_outlives_its_node(started) -> None:
    started.message(20, sequence=7)  # 1 to 6 were lost
    started.pass_time(50)
    started.node("Level", False)
    started.pass_time(2000)
    assert started.status.verdict == "inconclusive"


def test_a_monitor_held_up_while_it_finds_machines_anew_does_not_blame_the_clock(started) -> None:
    started.now += 2 * S
    started.held_up.extend((0, 0, 3 * S))
    started.message(90)
    started.message(90)
    started.pass_time(1000)
    assert not [text for text in started.said if "clock" in text]
    assert [text for text in started.said if "stood still" in text]


def test_a_clock_set_forward_is_said(started) -> None:
    started.set_forward_ns += 60 * S
    started.jump(60 * S)
    assert [text for text in started.said if "the clock was set forward by 60.0 s" in text]


@pytest.mark.parametrize("step_ms", [30, 90, 300])
def test_no_silence_is_what_the_clock_was_set_forward_by(started, step_ms: int) -> None:
    """What Level answers 60 ms after it was asked is the end of something, however much its stamps say."""
    started.tick(1)
    started.pass_time(20)
    started.set_forward_ns += step_ms * MS
    started.jump(step_ms * MS)
    started.pass_time(20)
    started.hear(
        *("/Level/tick", "response_sent", "t/srv/Tick_Response", {"status": 0}, "Level"), call=1
    )
    started.pass_time(1000)
    for _ in range(3):
        started.confirm()
    assert started.watch.violations == 0
    assert started.outcomes[-2:] == ["inconclusive", "conforming"]
    assert [
        text
        for text in started.said
        if f"set forward by {step_ms / 1000:.1f} s" in text or f"by {step_ms} ms" in text
    ]


def test_what_happened_while_it_stood_still_is_not_judged(started) -> None:
    before = started.now
    started.jump(60 * S)
    for call in range(1, 5):  # what waited in the queues comes now
        started.message(90, stamp_ns=before + call * S)
        started.hear(
            "/Level/tick",
            "response_sent",
            "t/srv/Tick_Response",
            {"status": 1},
            "Level",
            stamp_ns=before + call * S + MS,
            call=call,
        )
    started.pass_time(1000)
    assert started.watch.violations == 0
    assert started.watch.summary().counts.before == 8


def test_a_clock_set_back_is_said_and_machines_are_found_anew(started) -> None:
    started.jump(-3600 * S)
    assert [text for text in started.said if "set back by 3600.0 s" in text]
    started.pass_time(1500)
    started.message(90)
    started.pass_time(1000)
    started.tick(1, status=0)
    started.pass_time(1000)
    assert started.watch.violations == 0
    assert started.outcomes[-1] == "conforming"
    started.tick(2, status=1)  # a level before the first one may have been lost
    started.confirm()
    assert started.watch.violations == 0
    started.confirm()
    started.tick(3, status=1)
    started.confirm()
    assert started.watch.violations == 1


def test_a_stamp_from_the_future_is_counted_and_makes_no_wrong_verdict(started) -> None:
    started.tick(1)
    response = {"status": 0}
    started.hear(
        "/Level/tick",
        "response_sent",
        "t/srv/Tick_Response",
        response,
        "Level",
        stamp_ns=started.now + 3600 * S,
        call=1,
    )
    started.pass_time(3000)
    assert started.watch.violations == 0
    assert started.outcomes[-1] in ("inconclusive", "conforming")
    assert "inconclusive" in started.outcomes
    assert any("stamped in the future" in text for text in started.watch.problems())


def test_a_lost_message_makes_it_inconclusive_until_it_is_certain_again(started) -> None:
    started.message(20, sequence=7)  # 1 to 6 were lost
    started.pass_time(50)
    assert started.outcomes[-1] == "inconclusive"
    started.pass_time(1000)
    started.message(20, sequence=8)
    started.pass_time(1000)
    started.tick(1, status=1)
    started.pass_time(1000)
    assert started.outcomes[-1] == "conforming"
    assert started.watch.violations == 0


def test_what_a_started_node_sent_first_and_was_not_heard_makes_it_inconclusive(hand) -> None:
    hand.pass_time(100)
    hand.node("Level", True)
    hand.pass_time(400)
    hand.hear("/elsewhere", "message", "t/msg/Level", {"data": 1}, "Level", sequence=3)
    hand.pass_time(100)
    assert "inconclusive" in hand.outcomes
    assert "violated" not in hand.outcomes


def test_a_message_of_another_type_is_counted_and_taken_by_nobody(started) -> None:
    started.hear("/battery", "message", "std_msgs/msg/String", {"data": "x"}, "stranger")
    started.hear("/battery", "message", "", {"data": "not a number"}, "", sequence=-1)
    started.pass_time(500)
    started.tick(1, status=0)
    started.pass_time(500)
    assert started.outcomes == ["conforming"]
    assert any("of a type that is not the models'" in text for text in started.watch.problems())


def test_a_message_without_a_sender_may_have_been_taken_before_its_stamp(started) -> None:
    started.tick(1)
    started.hear("/battery", "message", "t/msg/Level", {"data": 20}, "", sequence=-1)
    started.hear(
        "/Level/tick", "response_sent", "t/srv/Tick_Response", {"status": 0}, "Level", call=1
    )
    started.pass_time(30)
    # taken by the skill 40 ms ago, heard by the monitor only now
    started.tick(2, status=1)
    started.hear("/battery", "message", "t/msg/Level", {"data": 20}, "", sequence=-1)
    started.pass_time(500)
    assert started.watch.violations == 0
    assert any("without a sender's name" in text for text in started.watch.problems())


def test_channels_that_no_model_names_are_counted(started) -> None:
    for name in ("/a", "/a", "/b", "/rosout", "/moon/verdicts", "/policy/ticks"):
        started.hear(name, "message", "t/msg/Level", {"data": 1}, "stranger")
    assert started.watch.summary().counts.unknown == {"/a": 2, "/b": 1}


@pytest.mark.parametrize(
    ("channel", "said"),
    [
        ("/batery", ["no model names /batery; did you mean /battery?"]),
        ("/Battery", ["no model names /Battery; did you mean /battery?"]),
        ("/battery2", []),
        ("/camera", []),
    ],
)
def test_a_channel_that_nobody_else_uses_is_told_if_it_is_a_slip_for_a_models(
    hand, channel: str, said: list[str]
) -> None:
    hand.node("Level", True)
    hand.hear(channel, "message", "t/msg/Level", {"data": 1}, "driver")
    assert hand.watch.problems() == said
    hand.message(20)  # of the very channel: the other one is somebody's own
    assert hand.watch.problems() == []


def test_endless_new_channels_do_not_fill_the_memory(started) -> None:
    for number in range(1500):
        started.hear(f"/new/{number}", "message", "t/msg/Level", {"data": 1}, "stranger")
    unknown = started.watch.summary().counts.unknown
    assert len(unknown) == 1001
    assert unknown["(others)"] == 500


def test_an_observation_that_is_late_by_less_than_the_bound_changes_nothing(started) -> None:
    for call in range(1, 20):
        level = 20 if call % 2 else 90
        stamp = started.now
        started.pass_time(400)
        started.tick(call, status=0 if level == 90 else 1)
        # now and then: where all are late but the first one, its clock was set
        late_ms = 150 if call % 3 else 3
        started.message(level, stamp_ns=started.now - late_ms * MS)
        started.pass_time(400)
        assert started.now > stamp
    assert started.watch.violations == 0
    assert "inconclusive" not in started.outcomes


def test_observations_of_several_nodes_too_late_make_all_inconclusive(started) -> None:
    started.pass_time(2000)
    started.message(20, stamp_ns=started.now - 800 * MS)
    started.message(20, source="Other", stamp_ns=started.now - 800 * MS)
    started.tick(1, status=1)
    started.pass_time(500)
    assert started.watch.violations == 0
    assert [text for text in started.said if "0.8 s late" in text]


def test_the_summary_is_json(started) -> None:
    started.tick(1, status=1)
    started.message(90)
    started.pass_time(500)
    summary = started.watch.summary()
    decoded = msgspec.json.decode(msgspec.json.encode(summary))
    assert decoded["machines"][0]["verdict"] == "violated"
    assert summary.violations == 1


def test_a_node_that_is_not_there_yet_owes_nothing_though_others_talk_to_it(relay) -> None:
    for level in range(80, 70, -1):
        relay.message(level)
        relay.pass_time(500)
    assert relay.verdicts == []
    relay.node("Level", True)
    relay.pass_time(5500)  # it is linked to who talks to it
    relay.message(70)
    relay.pass_time(2000)
    assert relay.outcomes == ["conforming", "inconclusive"]
    assert "unresponsive" in relay.verdicts[-1].reason
    relay.message(60)
    relay.hear("/told", "message", "t/msg/Level", {"data": 60}, "Level")
    relay.pass_time(500)
    assert relay.outcomes == ["conforming", "inconclusive", "violated"]


def test_of_a_node_that_was_just_found_silence_says_nothing(relay) -> None:
    """The monitor may not be linked yet to what it sends."""
    relay.pass_time(100)
    relay.node("Level", True, since=START - S)
    for level in range(80, 70, -1):
        relay.message(level)
        relay.pass_time(500)
    assert relay.watch.violations == 0
    relay.message(70)
    relay.pass_time(4000)
    assert "unresponsive" in relay.verdicts[-1].reason
    relay.hear("/told", "message", "t/msg/Level", {"data": 70}, "Level")
    relay.message(60)
    relay.pass_time(500)
    assert relay.watch.violations >= 1


def test_what_comes_in_a_name_that_several_claim_is_not_judged(started) -> None:
    started.contested = ("Level",)
    started.tick(1, status=1)  # wrong, if it was Level that answered so
    started.pass_time(1000)
    assert started.watch.violations == 0
    assert started.outcomes[-1] == "inconclusive"
    assert "several sessions claim to be Level" in started.verdicts[-1].reason
    started.contested = ()
    started.message(90)
    started.pass_time(1000)
    for call in (2, 3):
        started.tick(call, status=0)
        started.pass_time(1000)
    assert started.outcomes[-1] == "conforming"
    started.tick(4, status=1)
    started.confirm()
    assert started.watch.violations == 1


@pytest.mark.parametrize(("channel", "source"), [("/battery", ""), ("/Level/tick", "policy")])
def test_what_a_tap_dropped_may_have_been_taken(started, channel, source) -> None:
    started.dropped = [(channel, source)]  # the level may be below 30 now
    started.pass_time(300)
    started.tick(1, status=1)
    started.pass_time(1000)
    assert started.watch.violations == 0
    assert "inconclusive" in started.outcomes
    said = f"messages on {channel} came faster than they were judged"
    assert any(said in verdict.reason for verdict in started.verdicts)


def test_what_a_tap_dropped_elsewhere_concerns_nobody(started) -> None:
    started.dropped = [("/large", "")]
    started.pass_time(300)
    started.tick(1, status=1)
    started.confirm()
    assert started.watch.violations == 1


@pytest.mark.parametrize(
    "data", [{"data": "x"}, {"data": 2**40}, {"data": None}, 5, None, [1], {1: 2}, {"data": {}}]
)
def test_a_message_that_only_says_it_is_of_the_type_is_taken_by_nobody(started, data) -> None:
    started.hear("/battery", "message", "t/msg/Level", data, "stranger")
    started.pass_time(500)
    started.tick(1, status=0)
    started.pass_time(500)
    assert "violated" not in started.outcomes


def test_a_field_that_is_not_there_has_its_default_as_in_the_node_that_takes_it(started) -> None:
    started.hear("/battery", "message", "t/msg/Level", {}, "stranger")
    started.pass_time(500)
    started.tick(1, status=1)
    started.pass_time(500)
    assert started.outcomes == ["conforming"]


@pytest.mark.parametrize("data", [{"status": "x"}, {}, 5, None, [1], {1: 2}, {"status": {}}])
@pytest.mark.parametrize("kind", ["request_sent", "request_received", "response_sent"])
def test_events_of_a_service_may_hold_anything(started, kind, data) -> None:
    types = "t/srv/Tick_Request" if "request" in kind else "t/srv/Tick_Response"
    started.hear("/Level/tick", kind, types, data, "stranger", call=9)
    started.hear("/Level/tick", kind, "x/srv/Y", data, "Level", call=9)
    started.pass_time(1000)


def test_a_stranger_that_says_it_sent_a_request_accuses_nobody(started) -> None:
    types = "t/srv/Tick_Request"
    started.hear("/Level/tick", "request_sent", types, {}, "evil", client="evil", call=0)
    started.hear("/Level/tick", "request_sent", types, {}, "evil", client="policy", call=77)
    started.pass_time(2000)
    started.confirm()
    started.confirm()
    assert started.watch.violations == 0
    assert "inconclusive" not in started.outcomes
