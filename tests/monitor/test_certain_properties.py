"""A property is violated once nothing that is missing can be the reason, and never withdrawn."""

from __future__ import annotations

import pytest

from moon.feed.nodes import Nodes
from moon.judge import Intake, NodeChange
from moon.monitor.properties import PropertyWatch
from moon.properties.property import Port, Property
from moon.properties.syntax import parse_formula
from moon.verdict import Outcome
from transports.interface import HERE, REQUESTS, Observation, ObservationKind

MS = 1_000_000
LATENCY_NS = 200 * MS
START = 10**18
PORTS = (Port("asked", "/ask", event=True), Port("done", "/done", event=True))
RESPONSE = "historically (once[1s:1s] {asked} -> once[0:1s] {done})"
ABSENCE = "historically not {done}"


class Watched:
    """A monitor of one property; ``Client`` asks and ``Server`` is done, both number what they report."""

    def __init__(self, formula: str, answers: bool = True) -> None:
        self.watch = PropertyWatch([Property("p", parse_formula(formula), PORTS)], LATENCY_NS)
        self.sources = Nodes(LATENCY_NS)
        self.watch.rely_on(self.sources, {"/ask": ["Client"], "/done": ["Server"]})
        self.sources.listening_ns = START
        self.orders = {"Client": 0, "Server": 0}
        self.said: list[Outcome] = []
        self.asked: set[str] = set()
        for node in self.orders:
            self.sources.changed(node, True, START)
            if answers:
                self.sources.answered(node, 0, START + MS)
        self.watch.start(START)

    def _take(self, verdicts) -> None:
        self.said += [verdict.outcome for verdict in verdicts]

    def hear(self, source: str, channel: str, at_ms: int, now_ms: int) -> None:
        seen = Observation(
            stamp_ns=START + at_ms * MS, received_ns=START + now_ms * MS, channel=channel,
            kind=ObservationKind.MESSAGE, type_name="", data={}, source=source, order=self.orders[source],
        )  # fmt: skip
        self.orders[source] += 1
        gap = self.sources.take(seen, START + now_ms * MS)
        if gap is not None:
            self.watch.gap(gap)
        self.watch.observe(Intake(seen, START + now_ms * MS))

    def answer(self, node: str, at_ms: int) -> None:
        self.sources.answered(node, self.orders[node], START + at_ms * MS)

    def advance(self, now_ms: int) -> None:
        for gap in self.sources.advance(START + now_ms * MS):
            self.watch.gap(gap)
        self._take(self.watch.advance(START + now_ms * MS))
        self.asked |= set(self.watch.take_questions())

    def pass_to(self, now_ms: int, since_ms: int) -> None:
        for at_ms in range(since_ms, now_ms + 1, 20):
            self.advance(at_ms)


def test_silence_is_a_violation_once_who_was_silent_says_so() -> None:
    watched = Watched(RESPONSE)
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(2_000, 20)
    assert Outcome.VIOLATED not in watched.said
    assert "Server" in watched.asked
    for node in ("Client", "Server"):
        watched.answer(node, 1_990)
    watched.advance(2_005)
    assert watched.said.count(Outcome.VIOLATED) == 1


def test_what_comes_long_after_the_latency_bound_was_no_violation_before() -> None:
    watched = Watched(RESPONSE)
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(2_000, 20)
    watched.orders["Server"] += 1  # its report that it was done is lost
    watched.hear("Server", "/other", 2_100, 2_101)
    watched.pass_to(3_000, 2_110)
    assert Outcome.VIOLATED not in watched.said


def test_where_nobody_answers_who_was_never_heard_is_judged_by_the_latency_bound() -> None:
    watched = Watched(RESPONSE, answers=False)
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(2_000, 20)
    assert watched.said.count(Outcome.VIOLATED) == 1


def test_who_was_never_heard_may_be_out_of_reach_for_as_long_as_a_lease() -> None:
    watched = Watched(RESPONSE, answers=False)
    watched.sources.are_asked = True
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(19_980, 20)
    assert Outcome.VIOLATED not in watched.said
    watched.pass_to(20_020, 20_000)
    assert watched.said.count(Outcome.VIOLATED) == 1


@pytest.mark.parametrize("is_heard", [True, False])
def test_who_was_never_heard_was_not_silent_when_listening_ends(is_heard: bool) -> None:
    watched = Watched(RESPONSE, answers=False)
    watched.sources.are_asked = True
    if is_heard:
        watched.hear("Server", "/other", 5, 6)
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(2_000, 20)
    watched._take(watched.watch.finish(START + 2_000 * MS, START + 2_200 * MS))
    assert (Outcome.VIOLATED in watched.said) == is_heard


@pytest.mark.parametrize("answers", [True, False])
def test_what_must_not_happen_and_does_is_certain_whoever_is_silent(answers: bool) -> None:
    watched = Watched(ABSENCE, answers)
    watched.hear("Server", "/done", 500, 502)
    watched.pass_to(1_000, 510)
    assert watched.said.count(Outcome.VIOLATED) == 1


def test_the_first_reports_of_a_node_that_came_up_while_it_was_listened_to_may_be_what_is_missing() -> (
    None
):
    watched = Watched("historically ({asked} -> once {done})")
    watched.orders["Server"] = 1  # the first is lost: that it was done
    watched.hear("Server", "/other", 300, 302)
    watched.pass_to(600, 310)
    watched.hear("Client", "/ask", 700, 702)
    watched.pass_to(2_000, 710)
    for node in ("Client", "Server"):
        watched.answer(node, 2_000)
    watched.pass_to(2_500, 2_010)
    assert Outcome.VIOLATED not in watched.said


LINKED_NS = 5_000 * MS
TOLD = "historically ({asked} -> once {done})"


class OnTopics(Watched):
    """The same, where links are made channel by channel, nodes number each channel, and nobody can be asked."""

    def __init__(self, formula: str, up: tuple[str, ...] = ("Client", "Server")) -> None:
        super().__init__(formula, answers=False)
        self.watch = PropertyWatch([Property("p", parse_formula(formula), PORTS)], LATENCY_NS)
        self.sources = Nodes(LATENCY_NS)
        self.sources.listening_ns, self.sources.are_found = START, True
        self.watch.rely_on(self.sources, {"/ask": ["Client"], "/done": ["Server"]})
        self.watch.start(START, LINKED_NS)
        self.numbers = {"/ask": 0, "/done": 0}
        for node in up:
            self.come_up(node, 0)

    def come_up(self, node: str, at_ms: int) -> None:
        self.sources.changed(node, True, START + at_ms * MS)
        self.watch.node_changed(NodeChange(node, True, START + at_ms * MS, START + at_ms * MS))

    def hear(self, source: str, channel: str, at_ms: int, now_ms: int) -> None:
        seen = Observation(
            stamp_ns=START + at_ms * MS, received_ns=START + now_ms * MS, channel=channel, source=source,
            kind=ObservationKind.MESSAGE, type_name="", data={}, sequence=self.numbers[channel],
        )  # fmt: skip
        self.numbers[channel] += 1
        self.sources.take(seen, START + now_ms * MS)
        self.watch.observe(Intake(seen, START + now_ms * MS))


def test_on_topics_silence_is_a_violation_once_the_next_message_of_each_has_come() -> None:
    watched = OnTopics(RESPONSE)
    watched.hear("Server", "/done", 5, 6)
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(3_000, 20)
    assert Outcome.VIOLATED not in watched.said
    watched.hear("Server", "/done", 3_000, 3_001)
    watched.pass_to(3_300, 3_020)
    assert Outcome.VIOLATED not in watched.said
    watched.hear("Client", "/ask", 3_400, 3_402)
    watched.pass_to(3_700, 3_410)
    assert watched.said.count(Outcome.VIOLATED) == 1


def test_on_topics_a_message_that_was_lost_is_no_violation() -> None:
    watched = OnTopics(RESPONSE)
    watched.hear("Server", "/done", 5, 6)
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(3_000, 20)
    watched.watch.lose("/done", START + 6 * MS, START + 3_000 * MS)
    watched.numbers["/done"] += 1
    watched.hear("Server", "/done", 3_000, 3_001)
    watched.hear("Client", "/ask", 3_400, 3_402)
    watched.pass_to(3_700, 3_020)
    assert Outcome.VIOLATED not in watched.said


@pytest.mark.parametrize("first", [0, 1])
def test_on_topics_what_was_sent_before_a_link_was_made_may_be_missing(first: int) -> None:
    watched = OnTopics(TOLD)
    watched.hear("Client", "/ask", 300, 302)
    watched.pass_to(6_000, 310)
    assert Outcome.VIOLATED not in watched.said
    watched.numbers["/done"] = first
    if first:
        watched.watch.lose("/done", START, START + 6_000 * MS)
    watched.hear("Server", "/done", 6_000, 6_001)
    watched.pass_to(6_300, 6_020)
    assert watched.said.count(Outcome.VIOLATED) == (first == 0)


def test_on_topics_who_is_not_found_yet_may_be_what_is_missing() -> None:
    watched = OnTopics(TOLD, up=("Client",))
    watched.hear("Client", "/ask", 300, 302)
    watched.hear("Client", "/ask", 900, 902)
    watched.pass_to(19_990, 910)
    assert Outcome.VIOLATED not in watched.said
    watched.pass_to(20_030, 20_000)
    assert watched.said.count(Outcome.VIOLATED) == 1


def test_on_topics_what_must_not_happen_and_does_is_certain_at_once() -> None:
    watched = OnTopics(ABSENCE)
    watched.hear("Server", "/done", 500, 502)
    watched.pass_to(720, 510)
    assert watched.said.count(Outcome.VIOLATED) == 1


def test_a_loss_that_is_reported_once_more_undoes_nothing_that_was_certain_in_spite_of_it() -> None:
    watched = Watched(ABSENCE)
    watched.watch.lose("/done", START + 400 * MS, START + 600 * MS)
    watched.hear("Server", "/done", 500, 502)
    for node in ("Client", "Server"):
        watched.answer(node, 700)
    watched.pass_to(800, 510)
    assert watched.said.count(Outcome.VIOLATED) == 1
    withdrawn = []
    watched.watch.withdrawn = lambda name, since_ns: withdrawn.append(name)
    watched.watch.lose("/done", START + 400 * MS, START + 600 * MS)
    watched.pass_to(900, 800)
    assert withdrawn == []


def test_what_is_not_certain_as_a_clock_is_set_does_not_become_so() -> None:
    watched = Watched(RESPONSE)
    watched.hear("Client", "/ask", 10, 12)
    watched.pass_to(1_300, 20)
    assert "Server" in watched.asked
    watched.watch.clock_set(START + 1_100 * MS, START + 1_600 * MS)
    for node in ("Client", "Server"):
        watched.answer(node, 1_990)
    watched.pass_to(2_500, 1_610)
    assert Outcome.VIOLATED not in watched.said


def test_nothing_is_violated_by_stamps_of_a_clock_that_may_have_been_set() -> None:
    watched = Watched(ABSENCE)
    watched.sources.clocks.heard("Server", START + 600 * MS, START + 500 * MS)
    watched.hear("Server", "/done", 510, 512)
    for node in ("Client", "Server"):
        watched.answer(node, 900)
    watched.pass_to(1_000, 520)
    assert watched.said[-1] is Outcome.INCONCLUSIVE
    watched.watch.finish(START + 1_000 * MS, START + 1_010 * MS)
    assert watched.watch.violations == 0


@pytest.mark.parametrize(("since_ms", "is_known"), [(1, True), (-10_000, False)])
def test_who_has_started_since_was_not_there_before_the_beginning(
    since_ms: int, is_known: bool
) -> None:
    watched = Watched(ABSENCE)
    for node in ("Client", "Server"):
        watched.sources.changed(node, True, START + since_ms * MS)
        watched.watch.node_changed(NodeChange(node, True, START + since_ms * MS, START + 2 * MS))
        watched.answer(node, 3)
    watched.hear("Server", "/done", 20, 22)
    for node in ("Client", "Server"):
        watched.answer(node, 30)
    watched.pass_to(100, 32)
    assert (Outcome.VIOLATED in watched.said) == is_known


@pytest.mark.parametrize(("at_ms", "expected"), [(2_000, False), (8_000, True)])
def test_calls_before_a_node_is_linked_for_sure_are_not_known(at_ms: int, expected: bool) -> None:
    """What happened within 1 s before is asked: soon after the start nobody knows, later it is certain."""
    watched = OnTopics(RESPONSE)
    ports = (Port("asked", "/ask", REQUESTS, event=True), PORTS[1])
    formula = parse_formula("historically ({done} -> once[0:1s] {asked})")
    watched.watch = PropertyWatch([Property("p", formula, ports)], LATENCY_NS)
    watched.watch.rely_on(watched.sources, {"/ask": ["Client", "Server"], "/done": ["Server"]})
    watched.watch.start(START, LINKED_NS)
    for node in ("Client", "Server"):
        watched.come_up(node, 0)
    watched.hear("Server", "/done", at_ms, at_ms + 1)
    watched.pass_to(at_ms + 300, at_ms + 20)
    assert (Outcome.VIOLATED in watched.said) == expected


class OnTwoHosts(Watched):
    """The same; the clock of the server's host may be off by 10 ms against that of the client and the monitor."""

    def __init__(self, formula: str) -> None:
        super().__init__(formula)
        self.watch = PropertyWatch([Property("p", parse_formula(formula), PORTS)], LATENCY_NS)
        self.sources.clocks.differ_ns, self.sources.clocks.are_told = 10 * MS, True
        self.watch.rely_on(self.sources, {"/ask": ["Client"], "/done": ["Server"]})
        self.watch.start(START)
        for node, clock in (("Client", HERE), ("Server", "there")):
            self.watch.node_changed(NodeChange(node, True, START, START, clock))


@pytest.mark.parametrize("is_lost", [True, False])
def test_what_another_host_did_may_be_missing_though_it_is_stamped_later(is_lost: bool) -> None:
    """It was done before it was asked, stamped 8 ms ahead, and that is lost."""
    watched = OnTwoHosts("historically ({asked} -> once {done})")
    watched.hear("Client", "/ask", 1_000, 1_002)
    watched.hear("Server", "/other", 1_004, 1_005)
    watched.orders["Server"] += is_lost
    watched.hear("Client", "/other", 1_100, 1_101)
    watched.pass_to(1_500, 1_000)
    assert Outcome.VIOLATED not in watched.said
    watched.hear("Server", "/other", 2_000, 2_001)
    watched.pass_to(2_500, 2_002)
    assert (Outcome.VIOLATED in watched.said) is not is_lost


def test_on_which_hosts_nodes_are_is_still_known_when_all_begins_anew() -> None:
    watched = Watched(RESPONSE)
    watch, clocks = watched.watch, watched.sources.clocks
    clocks.differ_ns, clocks.are_own, clocks.are_told = 10 * MS, True, True
    watch.start(START)
    assert watch._open_times.open_ns("p") == 10 * MS
    for node in ("Client", "Server"):
        watch.node_changed(NodeChange(node, True, START, START, HERE))
    assert not watch._open_times.orders
    watch.begin_anew(START + 1_000 * MS, "the clock was set")
    assert not watch._open_times.orders
