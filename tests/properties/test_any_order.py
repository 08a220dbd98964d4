"""What is false whenever things happened, held to all orders that the bound leaves open, and to runs in which they did."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from itertools import pairwise, permutations

import pytest
from msgspec.structs import replace

from moon.properties.any_order import MOST_ORDERS, AnyOrder
from moon.properties.formula import Interval, loosened
from moon.properties.monitor import PropertySet
from moon.properties.patterns import Pattern, PatternName, Scope, ScopeName, pattern_formula
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.runs import seen
from transports.interface import Observation, ObservationKind

MS = 1_000_000
LATENCY = 100 * MS
BEGIN = 1_000 * MS
END = 2_000 * MS
PORTS = (
    Port("p", "/p", event=True),
    Port("q", "/q", event=True),
    Port("s", "/s", path=("v",)),
)
ATOMS = [parse_formula(text) for text in ("{p}", "{q}", "{s > 0}")]
FORMULAS = (
    "historically({p} -> once{q})",
    "historically({p} -> once[:200000000]{q})",
    "historically({p} -> not once[50000000:300000000]{q})",
    "{p} -> once{s > 0}",
    "historically({s > 0} -> ({s > 0} since {q}))",
    "historically(not ({p} and {s > 0}))",
    "historically({q} -> ({s > 0} since[:400000000] {p}))",
    "historically(rises{s > 0} -> once[:150000000]{q})",
    "historically(not (historically[:250000000](not {q}) and falls{s > 0}))",
    "historically({p} -> historically[100000000:300000000](not {q}))",
)


def random_property(chance: random.Random) -> Property:
    if chance.random() < 0.4:
        return Property("x", parse_formula(chance.choice(FORMULAS), 1), PORTS)
    name = chance.choice(list(PatternName))
    first, second, third = chance.sample(ATOMS, 3)
    count = {
        PatternName.PRECEDENCE: 2,
        PatternName.RESPONSE: 2,
        PatternName.RESPONSE_CHAIN: 3,
        PatternName.PRECEDENCE_CHAIN: 3,
    }.get(name, 1)
    scope = chance.choice(
        [
            Scope(),
            Scope(ScopeName.BEFORE, end=third),
            Scope(ScopeName.AFTER, begin=third),
            Scope(ScopeName.BETWEEN, second, third),
        ]
    )
    bound = Interval(0, chance.choice((80, 150, 400)) * MS)
    timed = name in (
        PatternName.RECURRENCE,
        PatternName.RESPONSE,
        PatternName.RESPONSE_CHAIN,
        PatternName.EXISTENCE,
    )
    if not timed and chance.random() < 0.6:
        bound = Interval()
    events = (first, second, third)[:count]
    return Property("x", pattern_formula(Pattern(name, events, scope, bound)), PORTS)


def random_messages(chance: random.Random) -> list[Observation]:
    found = []
    at = BEGIN
    for _ in range(chance.randint(2, 6)):
        at += chance.randint(1, 60 * MS) if chance.random() < 0.7 else chance.randint(1, 400 * MS)
        found.append(seen(at, chance.choice(("/p", "/q", "/s")), v=chance.randint(0, 1)))
    return found


def drawn_before_the_end(chance: random.Random) -> tuple[Property, list[Observation]]:
    item = random_property(chance)
    return item, [it for it in random_messages(chance) if it.stamp_ns < END]


SHARED = frozenset({"/p", "/s"})
"""Topics of several publishers, in the tests of those."""


def orders(
    messages: Sequence[Observation], shared: frozenset[str] = frozenset()
) -> Iterator[list[tuple[int, Observation]]]:
    """All that the bound allows, each with the latest instants."""
    for order in permutations(range(len(messages))):
        pairs = [(a, b) for n, a in enumerate(order) for b in order[n + 1 :]]
        if any(
            a > b
            and (
                messages[a].channel == messages[b].channel not in shared
                or messages[a].stamp_ns - LATENCY > messages[b].stamp_ns
            )
            for a, b in pairs
        ):
            continue
        found: list[tuple[int, Observation]] = []
        later = END
        for place in reversed(order):
            stamp = messages[place].stamp_ns
            later = stamp if stamp < later else later - 10
            found.append((later, messages[place]))
        yield found[::-1]


def times_false(
    item: Property,
    order: Sequence[tuple[int, Observation]],
    begin: int = BEGIN,
    end: int = END,
) -> int:
    monitor = PropertySet([item])
    changes = list(monitor.advance(begin - 1))
    for stamp, it in order:
        changes += monitor.observe(seen(stamp, it.channel, **it.data))
    changes += monitor.advance(end)
    return sum(verdict.status is Status.FALSE for _, verdict in changes)


def loose(item: Property) -> Property:
    """What holds of a run as it was received, in some order, if ``item`` holds of it as it happened."""
    return replace(item, formula=loosened(item.formula, LATENCY + 2 * MS // 1000))


def found_by(
    item: Property,
    messages: Sequence[Observation],
    chance: random.Random,
    most: int = MOST_ORDERS,
    shared: frozenset[str] = frozenset(),
) -> int:
    monitor = AnyOrder(item, LATENCY, most, shared)
    monitor.start(BEGIN)
    for it in messages:
        if chance.random() < 0.5:
            monitor.advance(it.stamp_ns)
        monitor.observe(it)
    monitor.finish(END)
    return monitor.times


def seeds(few: int, many: int, *others: int) -> pytest.MarkDecorator:
    """The first ones and ``others``, and for ``make soak`` the rest, too."""
    more = pytest.param(range(few, many), marks=pytest.mark.soak)
    return pytest.mark.parametrize("tried", [(*range(few), *others), more], ids=["few", "more"])


@seeds(150, 300)
@pytest.mark.parametrize("shared", [frozenset[str](), SHARED], ids=["one sender", "several"])
def test_it_is_false_exactly_as_often_as_in_every_order(
    shared: frozenset[str], tried: Sequence[int]
):
    violated = found = different = 0
    for seed in tried:
        chance = random.Random(seed)
        item, messages = random_property(chance), random_messages(chance)
        each = [times_false(loose(item), order) for order in orders(messages, shared)]
        said = found_by(item, messages, chance, shared=shared)
        assert said <= min(each), (seed, item.formula, messages)
        violated += min(each) > 0
        found += said > 0
        different += min(each) == 0 < max(each)
    assert (found, different > len(tried) // 30) == (violated, True)


def test_where_the_order_is_known_only_durations_are_open():
    found = looser = 0
    for seed in range(200):
        chance = random.Random(seed)
        item, messages = drawn_before_the_end(chance)
        order = [(it.stamp_ns, it) for it in messages]
        monitor = AnyOrder(item, 0, loose_ns=LATENCY)
        monitor.start(BEGIN)
        for it in messages:
            monitor.observe(it)
        monitor.finish(END)
        stamps = {it.stamp_ns for it in messages}
        expected = times_false(loose(item), order)
        assert monitor.times <= expected, (seed, item.formula, messages)
        assert monitor.times == expected or len(stamps) < len(messages), (seed, item.formula)
        found += expected > 0
        looser += expected != times_false(item, order)
    assert found
    assert looser


def test_what_was_before_a_late_beginning_did_not_happen_at_it():
    begin = BEGIN + 1000 * MS
    text = "historically({p} -> not once[50000000:300000000]{q})"
    monitor = AnyOrder(Property("x", parse_formula(text, 1), PORTS), LATENCY)
    monitor.start_late(begin)
    monitor.observe(seen(begin - 400 * MS, "/q"))
    monitor.observe(seen(begin + 170 * MS, "/p"))
    monitor.finish(begin + 1000 * MS)
    assert monitor.times == 0


@pytest.mark.parametrize("begins_late", [False, True])
def test_a_state_that_stays_as_it_is_is_known_again_after_something_was_missing(begins_late: bool):
    item = Property("x", parse_formula("historically(not falls{s > 0})", 1), PORTS)
    monitor = AnyOrder(item, LATENCY)
    (monitor.start_late if begins_late else monitor.start)(BEGIN)
    for at in range(0, 900, 50):
        monitor.observe(seen(BEGIN + at * MS, "/s", v=int(at < 700)))
        monitor.advance(BEGIN + at * MS + 1)
        if at == 100:
            monitor.lose("/s", BEGIN + 60 * MS, BEGIN + 110 * MS)
    monitor.finish(END)
    assert monitor.times == 1


def runs_that_may_have_been(
    messages: Sequence[Observation], chance: random.Random, count: int
) -> Iterator[list[tuple[int, Observation]]]:
    """Each message happened up to the bound before its stamp, those of a channel in order."""
    while count:
        found: list[tuple[int, Observation]] = []
        last: dict[str, int] = {}
        for it in messages:
            first = max(BEGIN, it.stamp_ns - LATENCY, last.get(it.channel, 0) + 2 * MS // 1000)
            drawn = (first, it.stamp_ns, chance.randint(first, max(first, it.stamp_ns)))
            at = last[it.channel] = chance.choice(drawn) if first < it.stamp_ns else first
            found.append((at, it))
        found.sort(key=lambda pair: pair[0])
        if all(one[0] < other[0] for one, other in pairwise(found)):
            count -= 1
            yield found


def is_false_in_each(item: Property, messages: Sequence[Observation], seed: int) -> bool:
    """Whether ``item`` is false in each run of a sample of those that may have been."""
    runs = runs_that_may_have_been(messages, random.Random(f"runs {seed}"), 100)
    return all(times_false(item, run) for run in runs)


@seeds(200, 3000, 2830, 2950)
def test_who_begins_late_says_nothing_that_may_have_been_otherwise(tried: Sequence[int]):
    found = 0
    for seed in tried:
        chance = random.Random(seed)
        item, messages = drawn_before_the_end(chance)
        monitor = AnyOrder(item, LATENCY)
        monitor.start_late(chance.choice(messages).stamp_ns + chance.randint(-LATENCY, LATENCY))
        for it in messages:
            monitor.observe(it)
        monitor.finish(END)
        assert not monitor.times or is_false_in_each(item, messages, seed), (seed, item.formula)
        found += monitor.times > 0
    assert found


def received(
    messages: Sequence[Observation], chance: random.Random, shared: frozenset[str] = frozenset()
) -> list[Observation]:
    """What happened, as it is received: later by up to the latency bound, what one sends on a channel in order."""
    found: list[Observation] = []
    last: dict[str, int] = {}
    for it in messages:
        sender = it.channel + str(chance.randint(0, 1)) * (it.channel in shared)
        at = max(it.stamp_ns + chance.randint(0, LATENCY), last.get(sender, 0))
        last[sender] = at
        found.append(seen(at, it.channel, **it.data))
    return sorted(found, key=lambda it: it.stamp_ns)


@seeds(400, 1200, 761)
@pytest.mark.parametrize("shared", [frozenset[str](), SHARED], ids=["one sender", "several"])
def test_what_holds_of_a_run_is_not_false_by_when_it_was_received(
    shared: frozenset[str], tried: Sequence[int]
):
    """Neither by the order in which it was, nor by how much earlier or later."""
    found = late = 0
    for seed in tried:
        chance = random.Random(f"run {seed}")
        item, drawn = random_property(chance), random_messages(chance)
        messages = [it for it in drawn if it.stamp_ns < END - LATENCY]
        is_false = times_false(item, [(it.stamp_ns, it) for it in messages]) > 0
        got = received(messages, chance, shared)
        seems_false = times_false(item, [(it.stamp_ns, it) for it in got]) > 0
        said = found_by(item, got, chance, shared=shared) > 0
        assert is_false or not said, (seed, item.formula, messages, got)
        found += said
        late += seems_false and not is_false
    assert found > len(tried) // 12
    assert late > len(tried) // 120, "by when it was received more is false than is"


def call(at: int, kind: ObservationKind, client: str, number: int) -> Observation:
    return replace(seen(at, "/ask", kind), client=client, call=number)


ASKED = "historically({answered} -> once[:300000000]{asked})"
CALLS = (
    Port("asked", "/ask", (ObservationKind.REQUEST_SENT,), event=True),
    Port("answered", "/ask", (ObservationKind.RESPONSE_SENT,), event=True),
)


def violated_by(calls: Sequence[Observation]) -> bool:
    monitor = AnyOrder(Property("x", parse_formula(ASKED, 1), CALLS), LATENCY)
    monitor.start(BEGIN)
    for it in calls:
        monitor.observe(it)
    monitor.finish(END)
    return monitor.times > 0


def test_both_ends_of_a_call_have_senders_of_their_own():
    """The request may have been first though it was received later; a later client's may have been, too."""
    asked, answered = ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_SENT
    at = BEGIN + 500 * MS
    assert not violated_by([call(at, answered, "a", 1), call(at + 50 * MS, asked, "a", 1)])
    assert violated_by([call(at, answered, "a", 1), call(at + 150 * MS, asked, "a", 1)])
    others = [call(at, answered, "a", 1), call(at + 50 * MS, asked, "b", 1)]
    assert not violated_by(others)


def test_an_answer_comes_after_its_request():
    """However near to each other they are received."""
    formula = parse_formula("historically({asked} -> not once{answered})")
    asked, answered = ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_SENT
    never = parse_formula("historically(not ({answered} and once{asked}))")
    for item, is_violated in ((never, True), (formula, False)):
        monitor = AnyOrder(Property("x", item, CALLS), LATENCY)
        monitor.start(BEGIN)
        monitor.observe(call(BEGIN + 500 * MS, asked, "a", 1))
        monitor.observe(call(BEGIN + 501 * MS, answered, "a", 1))
        monitor.finish(END)
        assert (monitor.times > 0) == is_violated


def test_with_more_orders_than_are_followed_nothing_is_wrong():
    found = 0
    for seed in range(200):
        chance = random.Random(seed)
        item, messages = random_property(chance), random_messages(chance)
        said = found_by(item, messages, chance, most=chance.randint(1, 3))
        assert said <= min(times_false(item, order) for order in orders(messages)), seed
        found += said > 0
    assert found


@seeds(200, 2500, 1008)
def test_what_is_missing_may_have_been_anything(tried: Sequence[int]):
    """What is said without a message is so for each thing that it may have been, whenever it was."""
    found = 0
    for seed in tried:
        chance = random.Random(seed)
        item, messages = drawn_before_the_end(chance)
        monitor = AnyOrder(item, LATENCY)
        monitor.start(BEGIN)
        missing = chance.choice(messages)
        for it in messages:
            monitor.advance(it.stamp_ns)
            if it is missing:
                monitor.lose(it.channel, it.stamp_ns, it.stamp_ns + 1)
            else:
                monitor.observe(it)
        monitor.finish(END)
        assert not monitor.times or is_false_in_each(item, messages, seed), (seed, item.formula)
        found += monitor.times > 0
    assert found


def test_orders_that_lead_to_one_state_are_one():
    """Pairs of which the order is open, one after the other: their number makes no difference."""
    item = Property("x", parse_formula("historically({q} -> once{p})"), PORTS)
    monitor = AnyOrder(item, LATENCY, most=8)
    monitor.start(BEGIN)
    for number in range(200):
        at = BEGIN + number * 30 * MS
        monitor.advance(at)
        monitor.observe(seen(at, "/q" if number % 2 else "/p"))
    monitor.observe(seen(BEGIN + 9000 * MS, "/s", v=1))
    monitor.finish(BEGIN + 9000 * MS)
    assert monitor.times == 0
    late = AnyOrder(item, LATENCY, most=8)
    late.start(BEGIN)
    for number in range(200):
        at = BEGIN + number * 30 * MS
        late.advance(at)
        late.observe(seen(at, "/p" if number > 4 and number % 2 else "/q"))
    late.finish(BEGIN + 9000 * MS)
    assert late.times == 1
