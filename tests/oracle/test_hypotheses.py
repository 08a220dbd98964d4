"""Hypotheses that are joined are joined once, and then stay as they are."""

from __future__ import annotations

from moon.oracle.facts import Fact, Role
from moon.oracle.hypothesis import Hypothesis
from transports.interface import Observation, ObservationKind


def message(stamp: int) -> Fact:
    return Fact(
        Observation(
            stamp_ns=stamp,
            received_ns=stamp,
            channel="/in",
            kind=ObservationKind.MESSAGE,
            type_name="",
            data={},
            source="somebody",
            sequence=-1,
        ),
        Role.MESSAGE,
    )


def test_messages_of_one_stamp_do_not_change_places_for_ever():
    first, second = message(5), message(5)
    one = Hypothesis(((0, ()),), pending=(first, second))
    other = Hypothesis(((0, ()),), pending=(second,))
    wide = one.joined(other)
    assert wide is not None
    assert wide.joined(other) is None
    assert wide.joined(one) is None
    assert wide.joined(wide.with_pending(wide.pending[::-1])) is None


def test_what_only_the_other_has_not_taken_is_under_way_in_its_place():
    first, second, third = message(1), message(2), message(3)
    one = Hypothesis(((0, ()),), pending=(first, third))
    wide = one.joined(Hypothesis(((0, ()),), pending=(second, third)))
    assert wide is not None
    assert [fact.base for fact in wide.pending] == [first, second, third]
    assert [fact.droppable for fact in wide.pending] == [True, True, False]
