"""What each condition of a simulated world does, to nodes and to a tap."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from transports.interface import (
    CallOutcome,
    CallResult,
    Observation,
    ObservationKind,
    Reliability,
    Service,
    Topic,
)
from transports.simulated import (
    Conditions,
    Cut,
    HostClock,
    Introspection,
    Kill,
    Lost,
    Pause,
    Reordered,
    Rules,
    SimulatedTransport,
    SimulatedWorld,
    Slowdown,
)
from transports.simulated.world import START_NS

NS = 10**9


class Level(msgspec.Struct):
    data: int = 0


class Ask(msgspec.Struct):
    data: int = 0


class Told(msgspec.Struct):
    data: int = 0


Level.__type_name__ = "t/msg/Level"
Ask.__type_name__ = "t/srv/Ask_Request"
Told.__type_name__ = "t/srv/Ask_Response"
LEVEL = Topic("/level", "t/msg/Level", Level)
SHAKY = Topic("/level", "t/msg/Level", Level, Reliability.BEST_EFFORT)
KEPT = Topic("/level", "t/msg/Level", Level, transient_local=True)
ASK = Service("/ask", "t/srv/Ask", Ask, Told)


class Scene:
    """``a`` publishes a count every 0.1 s, ``b`` receives it and serves, ``monitor`` taps."""

    def __init__(self, conditions: Conditions, topic: Topic = LEVEL, seed: int = 1) -> None:
        self.world = SimulatedWorld(seed, conditions)
        self.true: list[Observation] = []
        self.world.witness(self.true.append)
        self.heard: list[Observation] = []
        self.changes: list[tuple[float, str, bool]] = []
        self.received: list[int] = []
        self.monitor = SimulatedTransport(self.world, "monitor")
        self.tap = self.monitor.tap([], self.heard.append)
        self.monitor.watch_nodes(
            lambda name, up: self.changes.append((self.passed_s, name, up)),
        )
        self.topic = topic
        self.world.starters = {"a": self.start_a, "b": self.start_b}
        self.start_b()
        self.start_a()

    def start_a(self) -> None:
        self.a = SimulatedTransport(self.world, "a")
        publish, count = self.a.publisher(self.topic).publish, iter(range(1000))
        self.a.every(0.1, lambda: publish(Level(next(count))))
        self.asks = self.a.client(ASK)
        self.a.announce()

    def start_b(self) -> None:
        self.b = SimulatedTransport(self.world, "b")
        self.b.subscribe(self.topic, lambda message: self.received.append(message.data))
        self.b.serve(ASK, lambda request: request.respond(Told(request.data.data)))
        self.b.announce()

    @property
    def passed_s(self) -> float:
        return round((self.world.now_ns - START_NS) / NS, 3)

    def messages(self, seen: list[Observation] | None = None) -> list[int]:
        found = self.heard if seen is None else seen
        return [one.data["data"] for one in found if one.kind is ObservationKind.MESSAGE]

    def asking(self, timeout_s: float = 5.0) -> list[CallResult]:
        results: list[CallResult] = []
        self.asks.call(Ask(7), results.append, timeout_s)
        return results


def run(conditions: Conditions, seconds: float, topic: Topic = LEVEL) -> Scene:
    scene = Scene(conditions, topic)
    scene.world.run_for(seconds)
    return scene


def test_one_observation_is_lost_and_the_node_has_the_message() -> None:
    scene = run(Conditions(lost=(Lost("a", "/level", 2),)), 1.05)
    assert scene.messages() == [0, 1, 3, 4, 5, 6, 7, 8, 9]
    assert scene.received == list(range(10))


def test_one_message_of_a_link_is_lost_and_taps_have_it() -> None:
    scene = run(Conditions(lost=(Lost("a", "/level", 2, "b"),)), 1.05)
    assert scene.messages() == list(range(10))
    assert scene.received == [0, 1, 3, 4, 5, 6, 7, 8, 9]


def test_one_report_of_a_message_taken_is_lost() -> None:
    scene = run(Conditions(lost=(Lost("b", "/level/_message_taken", 0),)), 1.05)
    taken = [seen.call for seen in scene.heard if seen.kind is ObservationKind.MESSAGE_TAKEN]
    assert taken == list(range(1, 10))


def test_a_link_is_reordered_and_others_are_not() -> None:
    scene = run(Conditions(reordered=(Reordered("a", "/level", 0.5, "b"),)), 5.0)
    assert scene.received != sorted(scene.received)
    assert scene.messages() == sorted(scene.messages())


def test_one_channel_is_reordered_at_the_tap() -> None:
    scene = run(Conditions(reordered=(Reordered("a", "/level", 0.5),)), 5.0)
    assert scene.received == sorted(scene.received)
    assert scene.messages() != sorted(scene.messages())


def test_who_asks_a_node_has_what_was_overtaken_before() -> None:
    scene = run(Conditions(reordered=(Reordered("a", "/level", 0.5),)), 2.0)
    answers: list[tuple[int, int]] = []

    def answered(answer: object) -> None:
        seen = [one for one in scene.heard if one.source == "a" and one.order < answer.next_order]
        answers.append((len(seen), answer.next_order))

    scene.tap.ask("a", answered)
    scene.world.run_for(1.0)
    ((seen, reported),) = answers
    assert seen == reported


def test_a_node_that_stands_still_takes_what_came_meanwhile_afterwards() -> None:
    scene = Scene(Conditions(pauses=(Pause("b", 0.25, 0.5),)))
    scene.world.run_for(0.74)
    assert scene.received == [0, 1]
    scene.world.run_for(0.02)
    assert scene.received == list(range(7))


def test_of_the_ticks_that_a_node_sleeps_through_one_is_left() -> None:
    scene = run(Conditions(pauses=(Pause("a", 0.25, 0.5),)), 1.05)
    stamps = [round((seen.stamp_ns - START_NS) / NS, 2) for seen in scene.true]
    assert stamps[:8:2] == [0.1, 0.2, 0.75, 0.8]


def test_a_node_that_was_killed_starts_again_and_numbers_anew() -> None:
    scene = run(Conditions(kills=(Kill("a", 0.35, 0.5),)), 1.2)
    assert [name for _, name, up in scene.changes if not up] == ["a"]
    assert scene.changes[-1][:2] == (0.85, "a")
    of_a = [one for one in scene.heard if one.source == "a"]
    assert [one.sequence for one in of_a] == [0, 1, 2, 0, 1, 2]
    assert [one.order for one in of_a] == [0, 1, 2, 0, 1, 2]
    assert scene.monitor.up_since("a") == START_NS + round(0.85 * NS)


def test_calls_of_each_life_are_numbered_from_one() -> None:
    scene = Scene(Conditions(kills=(Kill("a", 0.5, 0.1),)))
    scene.world.run_for(0.1)
    scene.asking()
    scene.world.run_for(0.7)
    scene.asking()
    scene.world.run_for(0.1)
    sent = [one for one in scene.heard if one.kind is ObservationKind.REQUEST_SENT]
    assert [(one.client, one.call) for one in sent] == [("a", 1), ("a", 1)]


def test_the_clock_of_a_host_is_set_and_the_others_are_not() -> None:
    clocks = (HostClock("robot", ahead_s=1.0, steps=((0.25, -0.19),)),)
    scene = run(Conditions(hosts={"a": "robot"}, clocks=clocks, rules=Rules.ROS2), 0.55)
    ahead_s = [
        round((seen.stamp_ns - truly.stamp_ns) / NS, 2)
        for seen, truly in zip(scene.heard, [t for t in scene.true if t.source == "a"], strict=True)
    ]
    assert ahead_s == [1.0, 1.0, 0.81, 0.81, 0.81]
    assert scene.monitor.now_ns() == scene.world.now_ns


def test_stamps_of_a_hybrid_clock_never_go_back_and_follow_what_was_received() -> None:
    clocks = (HostClock("robot", ahead_s=0.3, steps=((0.25, -0.19),)),)
    scene = run(Conditions(hosts={"a": "robot"}, clocks=clocks), 1.05)
    stamps = [seen.stamp_ns for seen in scene.heard]
    assert sorted(stamps) == stamps
    of_b = [seen for seen in scene.heard if seen.source == "b"]
    assert of_b[0].stamp_ns > START_NS + round(0.35 * NS)


def test_a_monitor_reads_the_clock_of_its_host() -> None:
    scene = run(Conditions(clocks=(HostClock(steps=((0.25, 3600.0),)),)), 0.5)
    assert scene.monitor.now_ns() == scene.world.now_ns + 3600 * NS
    assert scene.heard[-1].received_ns >= scene.heard[-1].stamp_ns > START_NS + 3600 * NS


@pytest.mark.parametrize(("topic", "through"), [(LEVEL, range(10)), (SHAKY, [0, 1, 8, 9])])
def test_a_cut_holds_what_is_reliable_and_loses_the_rest(topic: Topic, through: list[int]) -> None:
    conditions = Conditions(hosts={"a": "robot"}, cuts=(Cut(("robot",), 0.25, 0.6),))
    scene = Scene(conditions, topic)
    scene.world.run_for(0.8)
    assert scene.received == [0, 1]
    scene.world.run_for(0.25)
    assert scene.received == list(through)
    assert all(up for _, _, up in scene.changes)


def test_after_a_longer_cut_than_the_lease_what_was_sent_is_lost_and_nodes_come_back() -> None:
    conditions = Conditions(hosts={"a": "robot"}, cuts=(Cut(("robot",), 0.25, 0.6),), lease_s=0.3)
    scene = run(conditions, 1.05)
    assert scene.received == [0, 1, 8, 9]
    assert scene.messages() == [0, 1, 8, 9]
    assert [change for change in scene.changes if change[1] == "a"] == [
        (0.0, "a", True),
        (0.55, "a", False),
        (0.85, "a", True),
    ]
    assert scene.monitor.up_since("a") == START_NS


def test_a_call_across_a_cut_times_out_and_is_served_when_that_is_healed() -> None:
    conditions = Conditions(hosts={"a": "robot"}, cuts=(Cut(("robot",), 0.25, 2.0),))
    scene = Scene(conditions)
    scene.world.run_for(0.5)
    results = scene.asking(timeout_s=1.0)
    scene.world.run_for(1.1)
    assert [result.outcome for result in results] == [CallOutcome.TIMEOUT]
    scene.world.run_for(1.0)
    kinds = [seen.kind for seen in scene.true if seen.channel == "/ask"]
    assert ObservationKind.REQUEST_RECEIVED in kinds


def test_a_subscriber_misses_what_was_published_before_the_two_found_each_other() -> None:
    scene = run(Conditions(discovery_s=(0.35, 0.35)), 1.05)
    assert scene.received == list(range(3, 10))
    kept = run(Conditions(discovery_s=(0.35, 0.35)), 1.05, KEPT)
    assert kept.received == list(range(2, 10))


def test_a_tap_that_joins_late_hears_channel_by_channel() -> None:
    scene = Scene(Conditions(discovery_s=(0.1, 2.5)))
    scene.world.run_for(3.0)
    late: list[Observation] = []
    joined = SimulatedTransport(scene.world, "late")
    tap = joined.tap([], late.append)
    scene.world.run_for(0.05)
    assert late == []
    assert not tap.is_complete
    scene.world.run_for(2.5)
    assert tap.is_complete
    first = {one.channel + one.kind: one for one in reversed(late)}
    assert len({one.stamp_ns // 10**8 for one in first.values()}) == len(first)
    message = first["/level" + ObservationKind.MESSAGE]
    taken = first["/level" + ObservationKind.MESSAGE_TAKEN]
    assert message.sequence == message.data["data"]
    assert taken.call > taken.sequence > 0  # another tap listened before


def test_what_nobody_hears_is_not_counted_among_events_but_among_all_that_a_node_does() -> None:
    world = SimulatedWorld(1, Conditions())
    a, b = (SimulatedTransport(world, name) for name in "ab")
    b.serve(ASK, lambda request: request.respond(Told()))
    client = a.client(ASK)
    for _ in range(3):
        client.call(Ask(), lambda result: None)
        world.run_for(0.1)
    heard: list[Observation] = []
    SimulatedTransport(world, "monitor").tap([], heard.append)
    client.call(Ask(), lambda result: None)
    world.run_for(0.1)
    first = next(one for one in heard if one.source == "a")
    assert (first.sequence, first.order, first.call) == (0, 6, 4)


class TestRos2:
    def test_nothing_is_numbered_but_what_is_published_on_a_channel(self) -> None:
        scene = Scene(Conditions(rules=Rules.ROS2))
        scene.world.run_for(0.5)
        scene.asking()
        scene.world.run_for(0.5)
        assert {one.order for one in scene.heard} == {-1}
        assert ObservationKind.MESSAGE_TAKEN not in {one.kind for one in scene.heard}
        assert min(one.sequence for one in scene.heard) == 0
        assert not scene.monitor.reports_takes
        assert scene.monitor.repair_s > 0
        kinds = {one.kind for one in scene.true}
        assert ObservationKind.MESSAGE_TAKEN in kinds

    def test_two_clients_of_a_node_count_the_calls_of_a_service_together(self) -> None:
        """As on ROS 2, where they are one client."""
        scene = run(Conditions(rules=Rules.ROS2), 0.5)
        scene.asking()
        scene.asks = scene.a.client(ASK)
        scene.asking()
        scene.world.run_for(0.5)
        sent = [one for one in scene.heard if one.kind is ObservationKind.REQUEST_SENT]
        assert [one.call for one in sent] == [1, 2]

    def test_nodes_cannot_be_asked(self) -> None:
        scene = run(Conditions(rules=Rules.ROS2), 0.5)
        answers: list[object] = []
        scene.tap.ask("a", answers.append)
        scene.world.run_for(0.1)
        assert answers == [None]

    def test_a_node_that_was_killed_is_there_twice_until_its_lease_is_over(self) -> None:
        conditions = Conditions(kills=(Kill("a", 0.5, 0.2),), rules=Rules.ROS2, lease_s=2.0)
        scene = Scene(conditions)
        scene.world.run_for(0.6)
        assert not scene.tap.is_contested("a")
        scene.world.run_for(0.2)
        assert scene.tap.is_contested("a")
        assert scene.monitor.up_since("a") == 0
        scene.world.run_for(8.0)
        assert not scene.tap.is_contested("a")
        assert [change for change in scene.changes if change[1] == "a"] == [(0.0, "a", True)]

    def test_a_node_may_be_up_before_a_tap_hears_its_channels(self) -> None:
        scene = Scene(Conditions(rules=Rules.ROS2, discovery_s=(0.1, 0.6)))
        scene.world.run_for(1.0)
        found = [when for when, name, _ in scene.changes if name != "monitor"]
        assert len(found) == 2
        assert 0.1 <= min(found) < 0.6

    def test_a_plain_node_does_not_say_that_it_is_there(self) -> None:
        scene = Scene(Conditions(rules=Rules.ROS2, plain={"a": Introspection.OFF}))
        scene.world.run_for(0.1)
        scene.asking()
        scene.world.run_for(0.1)
        assert "a" not in {name for _, name, _ in scene.changes}
        assert {one.source for one in scene.heard if one.channel == "/ask"} == {"b"}

    def test_of_a_service_without_introspection_nothing_is_received_and_that_is_said(self) -> None:
        plain = dict.fromkeys(("a", "b"), Introspection.OFF)
        scene = Scene(Conditions(rules=Rules.ROS2, plain=plain))
        scene.asking()
        assert {(it.channel, it.node) for it in scene.tap.blind_spots()} == {
            ("/ask", "a"),
            ("/ask", "b"),
        }
        assert not [one for one in scene.heard if one.channel == "/ask"]

    def test_metadata_has_no_contents(self) -> None:
        scene = Scene(Conditions(rules=Rules.ROS2, plain={"a": Introspection.METADATA}))
        scene.asking()
        scene.world.run_for(0.1)
        of_a = [one for one in scene.heard if one.channel == "/ask" and one.source == "a"]
        assert [one.data for one in of_a] == [None, None]
        assert not scene.tap.blind_spots()

    def test_who_calls_is_known_by_a_number_before_its_name_is_known(self) -> None:
        scene = Scene(Conditions(rules=Rules.ROS2, discovery_s=(0.2, 0.2)))
        for _ in range(4):
            scene.world.run_for(0.1)
            scene.asking()
        scene.world.run_for(0.5)
        clients = {(one.call, one.client[:3]) for one in scene.heard if one.channel == "/ask"}
        assert (4, "a") in clients
        assert {call for call, name in clients if name == "gid"}.isdisjoint({4})

    def test_each_client_counts_its_own_calls(self) -> None:
        scene = Scene(Conditions(rules=Rules.ROS2))
        other = Service("/other", "t/srv/Ask", Ask, Told)
        scene.b.serve(other, lambda request: request.respond(Told()))
        scene.asking()
        scene.a.client(other).call(Ask(), lambda result: None)
        scene.world.run_for(0.1)
        assert {one.call for one in scene.heard} == {1}

    def test_the_end_of_a_call_that_failed_has_no_number(self) -> None:
        scene = Scene(Conditions(rules=Rules.ROS2))
        nobody = Service("/nobody", "t/srv/Ask", Ask, Told)
        scene.a.client(nobody).call(Ask(), lambda result: None)
        scene.world.run_for(0.05)
        (ended,) = [one for one in scene.heard if one.error]
        assert ended.sequence == -1


def test_conditions_that_nodes_do_not_know_leave_a_run_as_it_was() -> None:
    """What taps receive is drawn apart from what happens where it is new: a trace can be compared."""
    conditions = Conditions(delay_s=(0.0, 0.1), lost=(Lost("a", "/level", 1),))
    with_loss = run(conditions, 3.0)
    without = run(msgspec.structs.replace(conditions, lost=()), 3.0)
    assert with_loss.received == without.received
    assert with_loss.true == without.true


def test_a_witness_has_everything_in_order_by_the_true_clock() -> None:
    conditions = Conditions(
        tap_loss=0.5,
        tap_delay_s=(0.0, 0.3),
        clocks=(HostClock(steps=((0.25, -3600.0),)),),
        rules=Rules.ROS2,
    )
    scene = run(conditions, 1.05)
    assert scene.messages(scene.true) == list(range(10))
    stamps = [one.stamp_ns for one in scene.true]
    assert sorted(set(stamps)) == stamps
    assert stamps[0] >= START_NS
    for node in "ab":
        orders = [one.order for one in scene.true if one.source == node]
        assert orders == list(range(len(orders)))


def test_a_busy_hosts_nodes_send_everything_later_for_a_while_and_their_answers_too() -> None:
    scene = run(Conditions(slowdowns=(Slowdown(("a",), 0.45, 0.3, 0.25),)), 1.35)
    assert scene.received == scene.messages() == list(range(13))
    lags_ms = [round((seen.received_ns - seen.stamp_ns) / 1e6) for seen in scene.heard]
    of_a = [lag for seen, lag in zip(scene.heard, lags_ms, strict=True) if seen.source == "a"]
    assert max(of_a[:4]) == 0
    assert of_a[4:7] == [250, 250, 250]
    assert of_a[-3:] == [0, 0, 0]
    slow = Scene(Conditions(slowdowns=(Slowdown(("a",), 0.45, 0.3, 0.25),)))
    slow.world.run_for(0.5)
    answers: list[float] = []
    slow.tap.ask("a", lambda answer: answers.append(slow.passed_s))
    slow.world.run_for(0.4)
    assert len(answers) == 1
    assert answers[0] == pytest.approx(0.75, abs=0.01)


def test_a_call_that_waits_for_its_server_goes_to_who_serves_then() -> None:
    conditions = Conditions(discovery_s=(0.3, 0.3), kills=(Kill("b", 0.2, 0.05),))
    scene = Scene(conditions)
    scene.world.run_for(0.1)
    results = scene.asking(timeout_s=2.0)
    scene.world.run_for(1.0)
    assert [result.outcome for result in results] == [CallOutcome.RESPONSE]
    gone = Scene(Conditions(discovery_s=(0.3, 0.3), kills=(Kill("b", 0.2),)))
    gone.world.run_for(0.1)
    results = gone.asking(timeout_s=2.0)
    gone.world.run_for(1.0)
    assert [result.outcome for result in results] == [CallOutcome.UNAVAILABLE]


def test_several_conditions_combine() -> None:
    def conditions() -> Conditions:
        return Conditions(
            delay_s=(0.0, 0.05),
            tap_delay_s=(0.0, 0.1),
            loss=0.1,
            tap_loss=0.1,
            duplication=0.1,
            discovery_s=(0.0, 0.2),
            pauses=(Pause("monitor", 0.5, 0.3),),
            slowdowns=(Slowdown(("a", "b"), 0.3, 0.3, 0.05),),
            kills=(Kill("a", 0.6, 0.1), Kill("b", 0.9)),
            hosts={"a": "robot"},
            clocks=(HostClock("robot", -0.1, ((0.7, 0.4),)),),
            cuts=(Cut(("robot",), 1.0, 0.2),),
            reordered=(Reordered("a", "/level", 0.1),),
        )

    printed = msgspec.json.decode(msgspec.json.encode(conditions()), type=Conditions)
    assert printed == conditions()
    runs = [run(made, 3.0) for made in (conditions(), printed)]
    assert runs[0].heard == runs[1].heard
    assert runs[0].true == runs[1].true


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Conditions(discovery_s=(1.0, 0.5)),
        lambda: Conditions(lease_s=-1.0),
        lambda: Conditions(reordered=(Reordered("a", "/x", 0.1, probability=2.0),)),
        lambda: Conditions(pauses=(Pause("a", -1.0, 0.5),)),
        lambda: Conditions(slowdowns=(Slowdown(("a",), 0.0, 1.0, -0.1),)),
        lambda: Conditions(kills=(Kill("a", float("nan")),)),
        lambda: Conditions(cuts=(Cut(("robot",), 0.0, 1.0),)),
        lambda: Conditions(clocks=(HostClock("robot"),)),
    ],
)
def test_conditions_that_mean_nothing_are_refused(wrong: Callable[[], Conditions]) -> None:
    with pytest.raises(ValueError, match=r"must be|is a probability|no node is on host"):
        wrong()


def test_who_asks_again_at_once_where_nobody_serves_lets_time_pass() -> None:
    world, ends = SimulatedWorld(1), list[CallResult]()
    client = SimulatedTransport(world, "client").client(ASK)

    def ask(result: CallResult | None = None) -> None:
        if result is not None:
            ends.append(result)
        client.call(Ask(), ask)

    ask()
    world.run_for(1.0)
    assert 500 <= len(ends) <= 1000
    assert {result.outcome for result in ends} == {CallOutcome.UNAVAILABLE}
