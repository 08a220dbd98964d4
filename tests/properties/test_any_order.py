"""What is false in every order that the latency bound allows, held to all of them, one by one."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from itertools import permutations

from moon.properties.any_order import MOST_ORDERS, AnyOrder
from moon.properties.formula import Interval
from moon.properties.monitor import PropertySet
from moon.properties.patterns import Pattern, PatternName, Scope, ScopeName, pattern_formula
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.runs import seen
from transports.interface import Observation

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
)


def random_property(chance: random.Random) -> Property:
    if chance.random() < 0.4:
        return Property("x", parse_formula(chance.choice(FORMULAS)), PORTS)
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


def orders(messages: Sequence[Observation]) -> Iterator[list[tuple[int, Observation]]]:
    """All that the bound allows, each with the latest instants."""
    for order in permutations(range(len(messages))):
        pairs = [(a, b) for n, a in enumerate(order) for b in order[n + 1 :]]
        if any(
            a > b
            and (
                messages[a].channel == messages[b].channel
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


def found_by(
    item: Property, messages: Sequence[Observation], chance: random.Random, most: int = MOST_ORDERS
) -> int:
    monitor = AnyOrder(item, LATENCY, most)
    monitor.start(BEGIN)
    for it in messages:
        if chance.random() < 0.5:
            monitor.advance(it.stamp_ns)
        monitor.observe(it)
    monitor.finish(END)
    return monitor.times


def test_it_is_false_exactly_as_often_as_in_every_order():
    violated = found = different = 0
    for seed in range(300):
        chance = random.Random(seed)
        item, messages = random_property(chance), random_messages(chance)
        each = [times_false(item, order) for order in orders(messages)]
        said = found_by(item, messages, chance)
        assert said <= min(each), (seed, item.formula, messages)
        violated += min(each) > 0
        found += said > 0
        different += min(each) == 0 < max(each)
    assert (found, different > 10) == (violated, True)


def test_with_more_orders_than_are_followed_nothing_is_wrong():
    found = 0
    for seed in range(200):
        chance = random.Random(seed)
        item, messages = random_property(chance), random_messages(chance)
        said = found_by(item, messages, chance, most=chance.randint(1, 3))
        assert said <= min(times_false(item, order) for order in orders(messages)), seed
        found += said > 0
    assert found


def test_what_is_missing_may_have_been_anything():
    """What is said without a message is so for each thing that it may have been."""
    found = 0
    for seed in range(200):
        chance = random.Random(seed)
        item, messages = random_property(chance), random_messages(chance)
        each = [times_false(item, order) for order in orders(messages)]
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
        assert monitor.times == 0 or min(each) > 0, (seed, item.formula, messages)
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
