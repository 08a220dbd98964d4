"""Whether the clock of another host was set, by the lags of what its nodes report."""

from __future__ import annotations

from random import Random

import pytest

from moon.feed.host_clocks import FEW_LAGS, HostClocks
from transports.interface import Observation, ObservationKind

MS = 1_000_000
LATENCY = 200 * MS
SKEW = 20 * MS
USUAL = (1 * MS, 6 * MS)


class Heard:
    """Two nodes that report in turn, ten milliseconds apart; the clock of the first is set."""

    def __init__(self, skew_ns: int = 0) -> None:
        self.clocks = HostClocks(LATENCY, skew_ns)
        self.draw = Random(1)
        self.now = 1_000_000 * MS
        self.ahead = 0
        self.slow = 0
        self.answers = self.is_numbered = False
        self.steps: list[tuple[str, int]] = []

    def hear(self, times: int = 40, nodes: tuple[str, ...] = ("far", "near")) -> Heard:
        for _ in range(times):
            for node in nodes:
                self.now += 10 * MS
                stamp = self.now + (self.ahead if node == "far" else 0)
                lag = self.draw.randint(*USUAL) + (self.slow if node == "far" else 0)
                is_numbered = self.is_numbered and node == "far"
                found = self.clocks.heard(node, stamp, self.now + lag, False, is_numbered)
                if found:
                    self.steps.append((node, found))
            if self.answers:
                self.ask()
        return self

    def ask(self) -> None:
        """Those who are to be asked answer at once, whatever they hold back."""
        for node in self.clocks.take_questions():
            asked = self.now
            self.now += 2 * MS
            stamp = self.now + (self.ahead if node == "far" else 0)
            self.now += 2 * MS
            found = self.clocks.answered(node, asked, stamp, self.now)
            if found:
                self.steps.append((node, found))


@pytest.mark.parametrize("step_ms", [-3_600_000, -1000, -190, -120, 50, 100, 300, 3_600_000])
def test_a_clock_that_is_set_is_found_and_by_how_much(step_ms: int) -> None:
    heard = Heard().hear()
    assert heard.steps == []
    heard.ahead = step_ms * MS
    heard.hear()
    ((node, found),) = heard.steps
    assert node == "far"
    assert abs(found - step_ms * MS) <= USUAL[1]


@pytest.mark.parametrize("step_ms", [-190, -120, 120, 300])
def test_clocks_that_differ_are_doubtful_until_they_agree_again(step_ms: int) -> None:
    heard = Heard().hear()
    assert heard.clocks.doubtful(["far", "near", "unknown"]) == set()
    heard.ahead = step_ms * MS
    heard.hear()
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}
    heard.ahead = 0
    heard.hear()
    assert heard.clocks.doubtful(["far", "near"]) == set()


def test_one_report_that_comes_late_is_a_doubt_that_the_next_reports_end() -> None:
    heard = Heard().hear()
    heard.slow = 120 * MS
    heard.hear(1)
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}
    heard.slow = 0
    heard.hear(10)
    assert heard.clocks.doubtful(["far", "near"]) == set()
    assert heard.steps == []


def test_reports_that_are_held_back_together_are_of_no_clock() -> None:
    """A node that has nothing to do with a tick holds its reports for up to 50 ms, but not its answers."""
    heard = Heard().hear()
    heard.answers = True
    heard.slow = 50 * MS
    heard.hear()
    assert heard.steps == []
    assert heard.clocks.doubtful(["far", "near"]) == set()
    assert heard.hear().clocks.take_questions() == []  # it is usual by now


@pytest.mark.parametrize("slow_ms", [30, 150, 5000])
def test_one_that_answers_late_itself_is_busy_and_is_asked_again_until_it_answers(
    slow_ms: int,
) -> None:
    heard = Heard().hear()
    heard.answers = True
    heard.slow = 30 * MS
    heard.hear(1)
    heard.answers = False
    heard.slow = slow_ms * MS + 30 * MS
    asked = [node for _ in range(60) for node in heard.hear(1).clocks.take_questions()]
    assert heard.steps == []
    assert set(asked) == {"far"}
    assert 5 <= len(asked) <= 1_200 * MS // LATENCY + 1
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}
    heard.answers = True
    heard.hear(FEW_LAGS + 1)
    assert heard.steps == []


def test_one_that_numbers_all_that_it_reports_is_believed_to_answer_before_it_has() -> None:
    heard = Heard()
    heard.is_numbered = True
    heard.hear().slow = 100 * MS
    heard.hear()
    assert heard.steps == []
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}


@pytest.mark.parametrize("step_ms", [-3_600_000, -190, -60, -20, 5, 100, 3_600_000])
def test_an_answer_shows_a_clock_that_was_set(step_ms: int) -> None:
    heard = Heard().hear()
    heard.answers = True
    heard.ahead = step_ms * MS
    heard.hear(4)
    ((node, found),) = heard.steps
    assert node == "far"
    assert abs(found - step_ms * MS) <= USUAL[1]
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}
    heard.ahead = 0
    heard.hear()
    assert heard.clocks.doubtful(["far", "near"]) == set()


@pytest.mark.parametrize("step_ms", [-90, -30, 30])
def test_who_answers_nothing_is_known_by_lags_that_all_changed_by_as_much(step_ms: int) -> None:
    heard = Heard().hear()
    heard.ahead = step_ms * MS
    heard.hear()
    ((node, found),) = heard.steps
    assert node == "far"
    assert abs(found - step_ms * MS) <= USUAL[1]
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}


def test_a_clock_that_another_one_pulls_along_does_not_agree() -> None:
    """A hybrid logical clock is right for a moment when its host has received something."""
    heard = Heard().hear()
    heard.answers = True
    for _ in range(30):
        heard.ahead = -90 * MS
        heard.hear(2)
        heard.ahead = 0
        heard.hear(2)
    assert len(heard.steps) == 1
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}


def test_the_monitors_own_clock_that_is_set_shows_who_is_on_another_host() -> None:
    heard = Heard().hear()
    heard.clocks.clock_set()
    heard.ahead = -90 * MS
    heard.hear()
    assert [node for node, _ in heard.steps] == ["far"]


def test_where_all_are_late_by_different_times_no_clock_was_set() -> None:
    """A monitor that is busy takes all nodes' reports late."""
    heard = Heard().hear()
    for number in range(100):
        heard.now += 10 * MS
        lag = 110 * MS + heard.draw.randint(0, 200) * MS
        for node in ("far", "near"):
            assert not heard.clocks.heard(node, heard.now - lag, heard.now), number


def test_a_doubt_ends_where_nothing_more_is_received() -> None:
    heard = Heard().hear()
    heard.slow = 120 * MS
    heard.hear(1)
    heard.clocks.now_ns += 2 * LATENCY
    assert heard.clocks.doubtful(["far"]) == set()


def test_what_was_delayed_together_and_comes_at_once_is_of_no_clock() -> None:
    """A link that stood still for 150 ms: all that was sent meanwhile comes when it goes on."""
    heard = Heard().hear()
    since, until = heard.now, heard.now + 150 * MS
    for stamp in range(since, until, 10 * MS):
        heard.clocks.heard("far", stamp, until)
        heard.clocks.heard("near", stamp, max(stamp, heard.clocks.now_ns))
    heard.now = until
    heard.hear()
    assert heard.steps == []


def test_no_clock_was_set_where_clocks_differ_by_what_was_said() -> None:
    heard = Heard(SKEW)
    heard.ahead = SKEW
    heard.hear()
    assert heard.steps == []
    assert heard.clocks.doubtful(["far", "near"]) == set()


def test_a_clock_that_is_slewed_is_a_doubt_until_it_is_right_again() -> None:
    """Each report is a little later than the one before: none is late by what is usual."""
    heard = Heard(10 * MS)
    heard.clocks.are_own = True
    heard.hear(20)
    for _ in range(30):
        heard.ahead -= MS
        heard.hear(1)
    assert heard.steps == []
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}
    heard.ahead = 0
    heard.hear(2)
    assert heard.clocks.doubtful(["far", "near"]) == set()


def test_stamps_that_go_back_are_news_once() -> None:
    heard = Heard().hear()
    assert heard.clocks.went_back("far", LATENCY // 2)
    assert not heard.clocks.went_back("far", LATENCY // 2)
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}
    assert not heard.clocks.differs("far")


def test_a_clock_differs_whose_stamps_go_back_and_are_late_for_that() -> None:
    """One late report alone may be late by the network."""
    heard = Heard().hear()
    heard.ahead = -5 * LATENCY
    heard.hear(1, ("far",))
    assert not heard.clocks.differs("far")
    assert heard.clocks.went_back("far", 5 * LATENCY)
    assert heard.clocks.differs("far")


@pytest.mark.parametrize("reports", [1, 3])
def test_a_clock_that_is_set_soon_after_its_node_was_found_is_a_doubt(reports: int) -> None:
    heard = Heard().hear(reports)
    heard.ahead = -36 * MS
    heard.hear(1)
    assert heard.clocks.doubtful(["far", "near"]) == {"far"}
    heard.hear()
    ((node, _),) = heard.steps
    assert node == "far"


def test_what_a_node_did_in_calls_comes_later_than_its_messages_and_no_clock_was_set() -> None:
    """A node of ROS 2 sends one message, and then answers calls, which it reports ten milliseconds later."""
    heard = Heard()
    heard.hear(1, ("far",))
    heard.hear(nodes=("near",))
    for _ in range(40):
        heard.now += 200 * MS
        lag = 11 * MS + heard.draw.randint(0, MS)
        assert not heard.clocks.heard("far", heard.now, heard.now + lag, is_held=True)
        heard.hear(1, ("near",))
    assert heard.clocks.doubtful(["far", "near"]) == set()


@pytest.mark.parametrize("step_ms", [-90, -30])
def test_a_step_shows_in_messages_and_in_what_is_held_back(step_ms: int) -> None:
    heard = Heard().hear()
    for number in range(80):
        heard.now += 10 * MS
        stamp = heard.now + (step_ms * MS if number >= 40 else 0)
        lag = 11 * MS + heard.draw.randint(0, MS)
        if set_ns := heard.clocks.heard("far", stamp, heard.now + lag, is_held=True):
            heard.steps.append(("far", set_ns))
        heard.hear(1, ("near",))
    ((node, found),) = heard.steps
    assert node == "far"
    assert abs(found - step_ms * MS) <= USUAL[1]


SAID = {"channel": "/said", "type_name": "t", "data": {}}


class Calls:
    """One node asks another, whose clock is ahead, ten times a second; both report both ends of each call."""

    def __init__(self, ahead_ms: int, differ_ns: int = 10 * MS) -> None:
        self.clocks = HostClocks(LATENCY, differ_ns)
        self.clocks.are_own = differ_ns > 0
        self.ahead = {"far": ahead_ms * MS, "near": 0}
        self.draw = Random(2)
        self.now, self.call = 1_000_000 * MS, 0

    def report(self, node: str, kind: ObservationKind, by_ns: int = 0) -> Observation:
        stamp = self.now + self.ahead[node] + by_ns
        self.clocks.heard(
            node, stamp, self.now + 60 * MS
        )  # a slow link, beside which 40 ms are nothing
        return Observation(
            stamp_ns=stamp,
            received_ns=self.now,
            channel="/ask",
            kind=kind,
            type_name="t",
            data={},
            source=node,
            client="near",
            call=self.call,
        )

    def make(self, times: int = 1, by_ns: int = 0) -> list[tuple[str, str, int]]:
        """What is found of so many; what is received is stamped ``by_ns`` later than it is."""
        found = []
        for _ in range(times):
            self.call += 1
            for sender, receiver, what in (("near", "far", "REQUEST"), ("far", "near", "RESPONSE")):
                seen = [self.report(sender, ObservationKind[f"{what}_SENT"])]
                self.now += self.draw.randint(1, 5) * MS
                seen.append(self.report(receiver, ObservationKind[f"{what}_RECEIVED"], by_ns))
                self.draw.shuffle(seen)  # their reports overtake one another
                found += [one for one in map(self.clocks.crossed, seen) if one is not None]
            self.now += 90 * MS
        return found


@pytest.mark.parametrize(("ahead_ms", "pair"), [(40, ("far", "near")), (-40, ("near", "far"))])
def test_clocks_that_always_differed_show_in_calls(ahead_ms: int, pair: tuple[str, str]) -> None:
    calls = Calls(ahead_ms)
    assert calls.make(FEW_LAGS - 1) == []
    ((*nodes, before_ns),) = calls.make(20)
    assert tuple(nodes) == pair
    assert 35 * MS <= before_ns < 40 * MS
    assert calls.clocks.doubtful(["far", "near"]) == {"far", "near"}
    calls.ahead["far"] = 0
    assert calls.make(40) == []
    assert calls.clocks.doubtful(["far", "near"]) == set()


def test_clocks_that_hardly_differ_do_not() -> None:
    calls = Calls(9)
    assert calls.make(100) == []
    assert calls.clocks.doubtful(["far", "near"]) == set()


def test_one_call_that_is_stamped_late_is_a_doubt_for_a_moment() -> None:
    """Its client was held up between sending it and stamping that."""
    calls = Calls(0)
    assert calls.make(10) == []
    assert calls.make(by_ns=-30 * MS) == []
    assert calls.clocks.doubtful(["far", "near"]) == {"far", "near"}
    assert calls.make(4) == []
    assert calls.clocks.doubtful(["far", "near"]) == set()


def test_by_a_hybrid_logical_clock_nothing_is_compared() -> None:
    assert Calls(40, differ_ns=0).make(20) == []


def test_who_takes_a_message_after_another_is_compared_with_its_sender_alone() -> None:
    clocks = HostClocks(LATENCY, 10 * MS)
    clocks.are_own = True
    for number in range(20):
        now = 1_000_000 * MS + number * 500 * MS
        seen = [
            Observation(
                **SAID,
                kind=ObservationKind.MESSAGE,
                source="near",
                sequence=number,
                stamp_ns=now,
                received_ns=now,
            )
        ]
        for taker, after_ms in (("slow", 150), ("far", 5), ("other", 80)):
            taken = now + after_ms * MS
            seen.append(
                Observation(
                    **SAID,
                    kind=ObservationKind.MESSAGE_TAKEN,
                    source=taker,
                    client="near",
                    call=number,
                    stamp_ns=taken,
                    received_ns=taken,
                )
            )
        assert [clocks.crossed(one) for one in seen] == [None] * 4
    assert clocks.doubtful(["near", "slow", "far", "other"]) == set()
