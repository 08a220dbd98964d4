"""What is said after losses holds whatever the lost messages were, and is not nothing."""

from __future__ import annotations

import pytest

from moon.properties.monitor import PropertyMonitor, PropertySet, TimeOrderError
from moon.properties.ordering import OrderedProperties
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties import losses
from tests.properties.runs import seen
from transports.interface import REQUESTS, RESPONSES, ObservationKind

pytestmark = pytest.mark.slow

TRIPLES = 300
"""Of each kind and each run of the suite; ``tests.properties.soak`` looks at fresh ones."""


@pytest.mark.parametrize("edges", [False, True])
def test_a_verdict_holds_in_every_completion_of_what_was_lost(edges):
    tally = losses.Tally()
    found = [losses.contradiction(seed, tally, edges) for seed in range(TRIPLES)]
    assert [what for what in found if what is not None] == []
    # a floor: a monitor that gives up at the first loss says hardly anything afterwards
    assert tally.claims > 10 * TRIPLES
    assert tally.conclusive > tally.claims // 2, tally


@pytest.mark.parametrize("edges", [False, True])
@pytest.mark.parametrize("seed", [20007520, 20106439, 30006399, 40039918, 1257, 21522, 502525])
def test_nor_in_those_that_once_failed(seed, edges):
    assert losses.contradiction(seed, edges=edges) is None


def state(name: str, **more) -> Port:
    return Port(name, f"/{name}", path=("v",), **more)


def event(name: str) -> Port:
    return Port(name, f"/{name}", event=True)


def monitor(source: str, *ports: Port) -> PropertyMonitor:
    return PropertyMonitor(Property("f", parse_formula(source, ticks_per_unit=1), ports))


RESPONSE = "historically(not((not {answered}) since[5:] {asked}))"


def test_what_is_stamped_with_the_end_of_a_loss_still_counts():
    """The answer is in time; that a message of another channel was lost just before changes nothing."""
    it = monitor(f"({RESPONSE}) or {{q}}", event("asked"), event("answered"), state("q"))
    it.observe(seen(0, "/q", v=False))
    it.observe(seen(0, "/asked"))
    it.lose("/q", 3, 5)
    assert it.observe(seen(5, "/answered")).status is Status.TRUE


def test_what_other_channels_say_in_the_middle_of_a_loss_counts():
    it = monitor("historically {p} or {q}", state("p"), state("q"))
    it.observe(seen(0, "/p", v=True))
    it.observe(seen(0, "/q", v=False))
    it.lose("/q", 1, 100)
    assert it.observe(seen(50, "/p", v=False)).status is Status.INCONCLUSIVE
    it.observe(seen(60, "/p", v=True))
    assert it.observe(seen(100, "/q", v=False)).status is Status.FALSE


def test_a_final_violation_is_taken_back_by_a_loss_that_had_begun_by_then():
    it = monitor("historically({p} -> {q})", state("p"), state("q"))
    it.observe(seen(0, "/p", v=False))
    it.observe(seen(1, "/q", v=False))
    it.advance(7)
    verdict = it.observe(seen(8, "/p", v=True))
    assert (verdict.status, verdict.final) == (Status.FALSE, True)
    verdict = it.lose("/q", 4, 6)
    assert (verdict.status, verdict.final) == (Status.INCONCLUSIVE, False)
    assert verdict.reason == "messages on /q were missed"


def test_a_final_violation_stands_after_a_loss_that_began_later():
    it = monitor("historically({p} -> {q})", state("p"), state("q"))
    it.observe(seen(0, "/p", v=True))
    verdict = it.observe(seen(1, "/q", v=False))
    assert (verdict.status, verdict.final) == (Status.FALSE, True)
    it.advance(9)
    assert it.lose("/q", 2, 8) == verdict
    assert it.advance(20) == verdict


def test_a_violation_in_the_middle_of_a_loss_of_its_own_channel_is_said():
    """Two nodes answer on one channel; of one of them messages were lost."""
    it = PropertySet(
        [Property("f", parse_formula("not {alarm}", ticks_per_unit=1), (event("alarm"),))]
    )
    it.advance(0)
    it.lose("/alarm", 5, 10)
    said = [*it.observe(seen(7, "/alarm")), *it.advance(20)]
    assert [(verdict.status, verdict.since_ns) for _, verdict in said] == [
        (Status.INCONCLUSIVE, 5),
        (Status.FALSE, 7),
        (Status.INCONCLUSIVE, 7),
        (Status.TRUE, 10),
    ]


def test_uncertainty_ends_when_the_last_bound_has_passed_it():
    it = monitor("historically[:10] {p}", state("p"))
    it.observe(seen(0, "/p", v=True))
    it.lose("/p", 20, 23)
    assert it.advance(19).status is Status.TRUE
    assert it.advance(20).status is Status.INCONCLUSIVE
    assert it.observe(seen(30, "/p", v=True)).status is Status.INCONCLUSIVE
    # until 30 it may have been false, as nobody heard what it was
    assert it.next_deadline() == 40
    assert it.advance(39).status is Status.INCONCLUSIVE
    verdict = it.advance(40)
    assert (verdict.status, verdict.since_ns) == (Status.TRUE, 40)


def test_a_loss_of_one_channel_is_nothing_to_properties_of_others():
    ports = (state("p", initial=True), state("q", initial=True))
    formulas = {name: parse_formula(f"historically {{{name}}}", 1) for name in "pq"}
    both = PropertySet([Property(name, formula, ports) for name, formula in formulas.items()])
    both.advance(0)
    both.lose("/q", 1, 5)
    both.advance(9)
    both.lose("/q", 3, 6)
    statuses = {name: verdict.status for name, verdict in both.verdicts().items()}
    assert statuses == {"p": Status.TRUE, "q": Status.INCONCLUSIVE}


def test_a_state_that_was_lost_before_the_beginning_is_waited_for_again():
    it = monitor("once {p} or {q}", state("p"), state("q"))
    it.observe(seen(0, "/p", v=False))
    it.lose("/p", 2, 4)
    assert it.observe(seen(5, "/q", v=True)).status is Status.INCONCLUSIVE
    assert it.observe(seen(6, "/p", v=False)).status is Status.TRUE
    # it may have been true in the meantime
    assert it.observe(seen(7, "/q", v=False)).status is Status.INCONCLUSIVE
    assert it.observe(seen(8, "/p", v=True)).status is Status.TRUE


def test_a_lost_value_stays_unknown_although_another_one_it_is_compared_with_is_heard():
    it = monitor("{a > b}", state("a"), state("b"))
    it.observe(seen(0, "/a", v=5))
    it.observe(seen(0, "/b", v=1))
    it.lose("/a", 2, 4)
    assert it.observe(seen(6, "/b", v=2)).status is Status.INCONCLUSIVE
    assert it.observe(seen(7, "/a", v=3)).status is Status.TRUE


def test_a_witness_says_nothing_of_the_time_in_which_messages_were_lost():
    it = monitor("historically(not (once[:10]{p} and {q}))", state("p"), event("q"))
    it.observe(seen(0, "/p", v=True))
    it.observe(seen(1, "/p", v=False))
    it.lose("/p", 3, 6)
    it.observe(seen(8, "/p", v=True))
    it.observe(seen(9, "/p", v=False))
    verdict = it.observe(seen(12, "/q"))
    assert verdict.status is Status.FALSE
    facts = [(fact.predicate, fact.value, fact.start_ns) for fact in verdict.witness.facts]
    assert facts == [("p", True, 8), ("q", True, 12)]


@pytest.mark.parametrize(("start", "end"), [(5, 4), (-1, 3)])
def test_a_loss_without_a_time_is_refused(start, end):
    it = monitor("historically {p}", state("p"))
    it.observe(seen(5, "/p", v=True))
    with pytest.raises(TimeOrderError):
        it.lose("/p", start, end)
    assert it.verdict.status is Status.TRUE


def test_of_a_final_violation_that_a_late_loss_leaves_open_the_order_says_so_too():
    ports = (
        Port("asked", "/a", REQUESTS, event=True),
        Port("answered", "/a", RESPONSES, event=True),
    )
    item = Property("f", parse_formula(RESPONSE, ticks_per_unit=1), ports)
    ordered = OrderedProperties([item], latency_ns=10)
    ordered.advance(11)
    ordered.observe(seen(20, "/a", ObservationKind.REQUEST_SENT))
    ordered.advance(60)
    assert ordered.verdicts()["f"].final
    ordered.lose("/a", 22, 23)
    assert ordered.verdicts()["f"].status is Status.INCONCLUSIVE
    assert not ordered.verdicts()["f"].final


def test_a_property_is_unknown_for_reasons_of_its_own_channels_only():
    """Properties that begin together are evaluated together; a loss of one is no reason of another."""
    channels = {"one": "p", "two": "q", "both": "pr"}
    it = PropertySet(
        Property(
            name,
            parse_formula(
                f"historically(not({' or '.join(f'{{{port}}}' for port in ports)}))",
                ticks_per_unit=1,
            ),
            tuple(map(event, ports)),
        )
        for name, ports in channels.items()
    )
    it.advance(1)
    for port in "pqr":
        it.lose(f"/{port}", 3, 5)
    it.advance(8)
    for name, verdict in it.verdicts().items():
        assert verdict.status is Status.INCONCLUSIVE
        for port in "pqr":
            if port not in channels[name]:
                assert f"/{port}" not in verdict.reason, (name, verdict.reason)
    assert it.verdicts()["one"].reason == "messages on /p were missed"
