"""The numbers of all places, kept once."""

from __future__ import annotations

from moon.feed.numbers import Numbers
from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel


def seen(
    source: str, channel: str = "/c", kind: ObservationKind = ObservationKind.MESSAGE
) -> Observation:
    return Observation(
        stamp_ns=1, received_ns=1, channel=channel, kind=kind, type_name="t", data={}, source=source
    )


def test_a_sources_messages_and_events_of_one_channel_are_numbered_apart() -> None:
    numbers = Numbers()
    message = numbers.of(seen("a"))
    sent = numbers.of(seen("a", kind=ObservationKind.REQUEST_SENT))
    assert message is not sent
    assert numbers.of(seen("a", kind=ObservationKind.RESPONSE_RECEIVED)) is sent


def test_what_a_node_sent_before_it_started_again_does_not_count() -> None:
    numbers = Numbers()
    early, late = numbers.of(seen("a", "/early")), numbers.of(seen("a", "/late"))
    early.follow(7, 100)
    late.follow(0, 300)
    numbers.forget("a", 200)
    assert early.follow(0, 250) is Sequel.FIRST
    assert late.follow(1, 350) is Sequel.NEXT


def test_the_places_of_known_nodes_stay_when_there_are_too_many() -> None:
    numbers = Numbers(["known"], most=3)
    known = numbers.of(seen("known"))
    for number in range(10):
        numbers.of(seen(f"stranger{number}"))
    assert numbers.of(seen("known")) is known
    assert len(numbers.counts) == 3


def test_where_all_are_known_more_are_not_remembered() -> None:
    numbers = Numbers(["known"], most=2)
    for channel in ("/a", "/b"):
        numbers.of(seen("known", channel))
    assert numbers.of(seen("known", "/c")).follow(4, 10) is Sequel.FIRST
    assert numbers.of(seen("known", "/c")).follow(9, 20) is Sequel.FIRST
