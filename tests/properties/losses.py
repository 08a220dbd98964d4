"""Random triples of properties, a trace and losses: what is said holds for every completion.

A completion is what was observed together with some messages in place of the lost ones. The one that
really happened is among those looked at. What a completion makes of a formula is shown by a monitor that
hears all of it, and by :mod:`tests.properties.direct` where no two stamps are equal.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from moon.properties.formula import predicates, text
from moon.properties.monitor import PropertySet
from moon.properties.network import NEVER, obligations
from moon.properties.property import Fact, Port, Property, Status, Verdict
from moon.properties.syntax import parse_formula
from tests.properties.differential import random_formula
from tests.properties.direct import holds
from tests.properties.runs import seen

NAMES = "pqr"
SHOWN_EVERY = 10_000
COMPLETIONS = 2
"""Random ones, beside what really happened."""
Values = dict[int, bool]
STATUS = {True: Status.TRUE, False: Status.FALSE}


class Message(NamedTuple):
    stamp: int
    name: str
    value: bool


class Loss(NamedTuple):
    name: str
    start: int
    end: int


class Claim(NamedTuple):
    """``status`` of property ``number`` at ``instant``: after observation ``place``, or at its end."""

    number: int
    instant: int
    place: int | None
    status: Status
    reported: frozenset[int]
    """The losses known when it was made, by number."""


class Triple:
    """What ``seed`` makes: properties, messages in order, losses, and what is reported when."""

    def __init__(self, seed: int, edges: bool = False) -> None:
        self.edges = edges
        """Whether formulas may have rises and falls. (A seed makes other triples with them.)"""
        choice = random.Random(seed)
        self.choice = choice
        self.events = {name for name in NAMES if choice.random() < choice.choice([0.0, 0.5])}
        ports = tuple(self.port(name) for name in NAMES)
        alone = choice.random() < 0.8
        self.properties = [
            Property(f"f{number}", self.formula(), ports) for number in range(1 if alone else 2)
        ]
        # properties that share a network share its instants: equal stamps are for those alone
        self.step = choice.choice([(1,), (1, 1, 2, 3), (0, 1, 2, 5) if alone else (1, 3, 9)])
        self.first = choice.randrange(8) if choice.random() < 0.3 else -1
        """Before anything was observed, time was said to have come to here."""
        stamp = self.first + 1 + choice.randrange(3)
        self.messages: list[Message] = []
        for place in range(choice.randint(4, 26)):
            name = NAMES[place] if place < 3 and choice.random() < 0.7 else choice.choice(NAMES)
            self.messages.append(Message(stamp, name, choice.random() < 0.5))
            stamp += choice.choice(self.step)
        self.end = stamp + 6
        self.losses = [self.loss() for _ in range(choice.choice([1, 1, 2, 3]))]
        share = choice.choice([1.0, 1.0, 0.6])  # several sources: some of them were received
        self.lost = {
            place
            for place, message in enumerate(self.messages)
            if any(covers(loss, message) for loss in self.losses) and choice.random() < share
        }
        self.actions = self.plan()

    def port(self, name: str) -> Port:
        if name in self.events:
            return Port(name, f"/{name}", event=True)
        if self.choice.random() < 0.3:
            return Port(name, f"/{name}", path=("value",), initial=self.choice.random() < 0.5)
        return Port(name, f"/{name}", path=("value",))

    def formula(self):
        source = random_formula(self.choice, self.choice.randint(1, 3), 4, self.edges)
        both = not self.events & {"p", "q"} and self.choice.random() < 0.3
        source = source.replace("{n > 2}", "{p == q}" if both else "{p}")
        return parse_formula(source.replace("{n <= 1}", "not {q}"), ticks_per_unit=1)

    def listens(self, item: int, name: str) -> bool:
        """Whether messages of ``name`` are something to property number ``item``."""
        return any(name in atom for atom in predicates(self.properties[item].formula))

    def loss(self) -> Loss:
        stamps = [message.stamp for message in self.messages]
        bounds = [*stamps, self.choice.randrange(self.end)]
        start = self.choice.choice(bounds) + self.choice.choice([0, 0, 1])
        if self.choice.random() < 0.15:
            start = 0
        later = [stamp for stamp in bounds if stamp >= start] or [start + 1]
        end = self.choice.choice(later) + self.choice.choice([0, 0, 1])
        return Loss(self.choice.choice(NAMES), start, max(start, min(end, self.end)))

    def plan(self) -> list[tuple[str, int]]:
        """What is reported, in order: ("observe", place), ("advance", instant) and ("lose", number)."""
        actions: list[tuple[str, int]] = []
        at = self.first
        if at >= 0:
            actions.append(("advance", at))
        often = self.choice.choice([0.0, 0.3, 1.0])
        for place, message in enumerate(self.messages):
            if place in self.lost:
                continue
            if message.stamp - 1 > at and self.choice.random() < often:
                at = self.choice.randint(at + 1, message.stamp - 1)
                actions.append(("advance", at))
            actions.append(("observe", place))
            at = message.stamp
        actions.append(("advance", self.end))
        for number, loss in enumerate(self.losses):
            instants = [self.time(action) for action in actions]
            tell = self.choice.choice([0, loss.start, loss.start, loss.end, self.end])
            before = [place for place, instant in enumerate(instants) if instant >= tell]
            place = before[0] if before else len(actions) - 1
            if self.choice.random() < 0.3:  # after others of the same stamp
                place = min(place + 1, len(actions) - 1)
            actions.insert(place, ("lose", number))
        return actions

    def time(self, action: tuple[str, int]) -> int:
        what, number = action
        if what == "observe":
            return self.messages[number].stamp
        return number if what == "advance" else -1

    def unreported(self, reported: frozenset[int], instant: int) -> bool:
        """Whether there is a loss by ``instant`` that is not one of those that were ``reported``."""
        return any(
            loss.start <= instant and loss.start < loss.end
            for number, loss in enumerate(self.losses)
            if number not in reported
        )

    def observation(self, message: Message):
        return seen(message.stamp, f"/{message.name}", value=message.value)

    def completion(self) -> list[tuple[Message, int | None]]:
        """What was observed, with its place, and random messages in place of those that were lost."""
        found: list[tuple[int, float, Message, int | None]] = [
            (message.stamp, place, message, place)
            for place, message in enumerate(self.messages)
            if place not in self.lost
        ]
        for loss in self.losses:
            for _ in range(self.choice.choice([0, 0, 1, 2, 4])):
                if loss.start >= loss.end:
                    continue
                stamp = self.choice.randrange(loss.start, loss.end)
                beside = [key for other, key, _, _ in found if other == stamp] or [0.0]
                key = self.choice.choice(beside) + self.choice.choice([-0.5, 0.5])
                message = Message(stamp, loss.name, self.choice.random() < 0.5)
                found.append((stamp, key, message, None))
        found.sort(key=lambda item: item[:2])
        return [(message, place) for _, _, message, place in found]

    def truth(self) -> list[tuple[Message, int | None]]:
        return [
            (message, place if place not in self.lost else None)
            for place, message in enumerate(self.messages)
            if place not in self.lost or any(covers(loss, message) for loss in self.losses)
        ]


def covers(loss: Loss, message: Message) -> bool:
    return loss.name == message.name and loss.start <= message.stamp < loss.end


class Claims:
    """What a monitor that is given a triple reports, as claims on instants."""

    def __init__(self, triple: Triple) -> None:
        self.triple = triple
        self.claims: list[Claim] = []
        self.wrong: list[str] = []
        self.begun: dict[int, int] = {}
        """Per property, the place in the actions at which it began."""
        self.started: dict[int, int] = {}
        self.remembered: dict[int, tuple[int, bool]] = {}
        """Per property that remembers something from before it began: since when, that instant included."""
        self.reported: set[int] = set()
        self.monitors = PropertySet(triple.properties)
        self.names = [item.name for item in triple.properties]
        self.groups = [
            next(group for group in self.monitors.groups if name in group.names)
            for name in self.names
        ]
        self.standing = [Status.INCONCLUSIVE for _ in self.names]
        self.final: dict[int, Verdict] = {}
        self.violations: list[tuple[int, Verdict, frozenset[int]]] = []
        self.passed = [-1 for _ in self.names]
        for place, action in enumerate(triple.actions):
            self.take(place, action)

    def take(self, place: int, action: tuple[str, int]) -> None:
        what, number = action
        reached = [group.reached for group in self.groups]
        if what == "lose":
            loss = self.triple.losses[number]
            changes = self.monitors.lose(f"/{loss.name}", loss.start, loss.end)
            self.reported.add(number)
            self.changed(changes, None, None, loss)
        elif what == "advance":
            changes = self.monitors.advance(number)
            self.changed(changes, number + 1, None, None)
        else:
            message = self.triple.messages[number]
            changes = self.monitors.observe(self.triple.observation(message))
            self.changed(changes, message.stamp, number, None)
        for item, group in enumerate(self.groups):
            runs = group._runs  # also where nothing is unknown any more by now
            if item not in self.begun and item not in self.remembered and runs is not None:
                first = max(runs.began, reached[item])
                if group.started < 0 or first < group.started:
                    self.remembered[item] = first, reached[item] < 0
            if item not in self.begun and group.started >= 0:
                self.begun[item], self.started[item] = place, group.started

    def changed(self, changes, until: int | None, place: int | None, loss: Loss | None) -> None:
        for item, name in enumerate(self.names):
            mine = place is not None and self.triple.listens(item, self.triple.messages[place].name)
            own = [verdict for changed, verdict in changes if changed == name]
            for verdict in own:
                before = self.final.pop(item, None)
                if before is not None and (loss is None or loss.start > before.since_ns):
                    self.wrong.append(f"{name}: final since {before.since_ns}, then {verdict}")
                if until is not None:
                    self.pass_to(item, verdict.since_ns - 1)
                if mine and verdict.since_ns == until:
                    self.claim(item, verdict.since_ns, place, verdict.status)
                self.standing[item] = verdict.status
                if verdict.status is Status.FALSE:
                    self.violations.append((item, verdict, frozenset(self.reported)))
                if verdict.final:
                    self.final[item] = verdict
            # what no property of a network listens to tells it no time
            if until is not None and (place is None or self.hears(item, place)):
                self.pass_to(item, until - 1)
                if mine:
                    self.claim(item, until, place, self.standing[item])
            if self.standing[item] is not self.monitors.verdicts()[name].status:
                self.wrong.append(f"{name}: not said: {self.monitors.verdicts()[name]}")

    def hears(self, item: int, place: int) -> bool:
        """Whether the network of property ``item`` listens to the channel of message ``place``."""
        channel = f"/{self.triple.messages[place].name}"
        return any(ports.channel == channel for ports in self.groups[item].binding.groups)

    def pass_to(self, item: int, instant: int) -> None:
        """Up to ``instant`` nothing has changed what stands."""
        for tick in range(self.passed[item] + 1, instant + 1):
            self.claim(item, tick, None, self.standing[item])
        self.passed[item] = max(self.passed[item], instant)

    def facts(self, number: int) -> Iterator[tuple[int, Fact]]:
        """Since when property ``number`` is false, with each fact that is said to make it so."""
        for item, verdict, reported in self.violations:
            at = verdict.since_ns
            if (
                item == number
                and verdict.witness is not None
                and not self.triple.unreported(reported, at)
            ):
                yield from ((at, fact) for fact in verdict.witness.facts)

    def claim(self, item: int, instant: int, place: int | None, status: Status) -> None:
        self.claims.append(Claim(item, instant, place, status, frozenset(self.reported)))


class Reference:
    """A monitor of everything: it tells what completions make of property ``number``."""

    def __init__(self, triple: Triple, claims: Claims, number: int) -> None:
        self.triple = triple
        self.item = triple.properties[number]
        self.start = claims.started[number]
        self.remembered = claims.remembered.get(number)
        self.begun_by = triple.actions[claims.begun[number]]
        ports = (
            port if port.event else Port(port.name, port.channel, path=port.path, initial=False)
            for port in self.item.ports
        )
        self.monitors = PropertySet([Property("f", self.item.formula, tuple(ports))])
        self.fresh = self.monitors.snapshot()

    @property
    def remembers_states(self) -> bool:
        """Whether something but the formula's own past is remembered of states alone."""
        (group,) = self.monitors.groups
        nodes, own = group._network.nodes, set(obligations(group._network))
        alone: set[int] = set()
        for index, node in enumerate(nodes):
            is_event = node.kind == "atom" and node.text in group.binding.events
            if not is_event and alone.issuperset(node.inputs):
                alone.add(index)
        return any(nodes[i].kind in ("once", "since") for i in alone - own)

    def of(self, messages: list[tuple[Message, int | None]]) -> tuple[Values, Values]:
        """The formula's value after each observation and at the end of each tick, of ``messages``.

        What happened before it began is remembered, with some value of each state that was not known yet;
        only whether the formula was false then is not asked.
        """
        after: Values = {}
        ends: Values = {}
        what, at = self.begun_by
        rest = deque(messages)
        self.monitors.restore(self.fresh)
        (group,) = self.monitors.groups
        first, includes_first = self.remembered or (self.start, False)
        values = {
            port.name: port.initial for port in self.item.ports if isinstance(port.initial, bool)
        }
        while rest and (
            rest[0][0].stamp < first + (not includes_first)
            if self.remembered
            else rest[0][1] != at
            if what == "observe"
            else rest[0][0].stamp <= first
        ):
            message, _ = rest.popleft()
            values[message.name] = message.value
        known = {name: value for name, value in values.items() if name in group.binding.ports}
        group._known.values.update(known)  # as if observed before
        # without verdicts and their witnesses: the network's functions are asked
        program = group._program
        handlers = {ports.channel: group.handlers[ports.name] for ports in group.binding.groups}
        group.begin(first)
        has_begun = False

        def begin() -> None:
            nonlocal has_begun
            program.write({f"l{index}": NEVER for index in obligations(group._network)})
            has_begun = True

        for tick in range(first, self.triple.end + 1):
            while rest and rest[0][0].stamp == tick:
                message, place = rest.popleft()
                if what == "observe" and place == at:
                    begin()
                if f"/{message.name}" in handlers:
                    observation = self.triple.observation(message)
                    handlers[f"/{message.name}"](tick, observation.data, observation)
                if what == "observe" and place == at:
                    # it may have changed nothing, or be of a property that shares the network
                    program.at(tick)
                    program.step(tick)
                if place is not None and has_begun:
                    after[place] = program.values()[0]
            program.settle(tick)
            if what == "advance" and tick == self.start:
                begin()
                program.step(tick)
            if has_begun:
                ends[tick] = program.values()[0]
        program.changed.clear()
        return after, ends

    def rows(self, messages: list[tuple[Message, int | None]]) -> list[dict[str, bool]]:
        """The predicates' values at the ticks from the start on."""
        rest = deque(messages)
        row: dict[str, bool] = {
            port.name: port.initial for port in self.item.ports if isinstance(port.initial, bool)
        }
        rows: list[dict[str, bool]] = []
        for tick in range(self.triple.end + 1):
            row |= dict.fromkeys(self.triple.events, False)
            while rest and rest[0][0].stamp == tick:
                message, _ = rest.popleft()
                row[message.name] = message.value or message.name in self.triple.events
            if tick == self.start and self.begun_by[0] == "advance":
                row |= dict.fromkeys(self.triple.events, False)  # what happened before it began
            if tick >= self.start:
                rows.append({**row, "p == q": row.get("p") == row.get("q")})
        return rows


class Tally:
    """How much is said after losses."""

    def __init__(self) -> None:
        self.claims = self.conclusive = self.violated = 0

    def __str__(self) -> str:
        share = self.conclusive / max(self.claims, 1)
        return f"{share:.1%} of {self.claims} claims after a loss are conclusive"


def contradiction(seed: int, tally: Tally | None = None, edges: bool = False) -> str | None:
    """What is said of the triple that ``seed`` makes and is not so in a completion; None: nothing."""
    triple = Triple(seed, edges)
    claims = Claims(triple)
    if claims.wrong:
        return describe(seed, triple, claims.wrong[0])
    completions = [triple.truth(), *(triple.completion() for _ in range(COMPLETIONS))]
    for number in claims.started:
        reference = Reference(triple, claims, number)
        values = [reference.of(messages) for messages in completions]
        for place, messages in enumerate(completions):
            stamps = [message.stamp for message, _ in messages]
            if len(set(stamps)) < len(stamps):
                continue  # ticks have no more than one value
            start = claims.started[number]
            formula = triple.properties[number].formula
            if reference.remembered:  # the definitions know nothing of a time before the first
                continue
            rows = reference.rows(messages)
            if place == 0 and any(
                holds(formula, rows, t - start) != values[0][1][t] for t in values[0][1]
            ):
                return describe(
                    seed, triple, "a monitor of everything differs from the definitions"
                )
            for at, fact in claims.facts(number):
                wrong = range(max(fact.start_ns, start) - start, fact.end_ns + 1 - start)
                if any(rows[t][fact.predicate] is not fact.value for t in wrong):
                    return describe(seed, triple, f"false at {at} for {fact}, not so in {messages}")
        if reference.remembered and reference.remembers_states:
            continue  # a state has no value before its first message; here it has one
        for claim in claims.claims:
            if claim.number != number or claim.instant < claims.started[number]:
                continue
            if claim.place is not None and claim.place not in values[0][0]:
                continue
            if triple.unreported(claim.reported, claim.instant):
                continue
            if tally is not None and any(loss.start <= claim.instant for loss in triple.losses):
                tally.claims += 1
                tally.conclusive += claim.status is not Status.INCONCLUSIVE
            if claim.status is Status.INCONCLUSIVE:
                continue
            for messages, (after, ends) in zip(completions, values, strict=True):
                value = ends[claim.instant] if claim.place is None else after[claim.place]
                if STATUS[value] is not claim.status:
                    return describe(seed, triple, f"{claim} does not hold for {messages}")
    return None


def describe(seed: int, triple: Triple, what: str) -> str:
    formulas = [text(item.formula, 1) for item in triple.properties]
    actions = [
        (act, triple.losses[n] if act == "lose" else triple.messages[n] if act == "observe" else n)
        for act, n in triple.actions
    ]
    lost = [triple.messages[place] for place in sorted(triple.lost)]
    return (
        f"seed {seed}: {formulas}, events {sorted(triple.events)}\n"
        f"told {actions}\nlost {lost}\n{what}\n"
        f"again: python -m tests.properties.soak --losses 1 --seed {seed}"
    )


def soak(triples: int, first_seed: int) -> int:
    """Look at ``triples`` triples, half of them with rises and falls; returns how many are
    contradicted, printing each.
    """
    failures = 0
    tally = Tally()
    for seed in range(first_seed, first_seed + (triples + 1) // 2):
        for edges in (False, True):
            found = contradiction(seed, tally, edges)
            if found is not None:
                failures += 1
                print(found, flush=True)
        done = 2 * (seed + 1 - first_seed)
        if done % SHOWN_EVERY == 0:
            print(f"{done} of {triples}, {failures} contradicted", flush=True)
    print(f"{triples} triples with losses, {failures} contradicted; {tally}", flush=True)
    return failures
