"""Every input has somebody who shows that it is missing, or nobody has."""

from __future__ import annotations

import pytest

from m2c.model.machine import EventKind
from moon.oracle.evidence import EVIDENCE, Shown, evidence_of


def test_the_table_has_every_kind_of_event() -> None:
    assert set(EVIDENCE) == set(EventKind)


@pytest.mark.parametrize("kind", EventKind)
def test_what_a_sender_shows_is_taken_for_whole_where_it_has_no_number(kind: EventKind) -> None:
    for is_reported in (True, False):
        shown = evidence_of(kind, is_reported, is_numbered=False)
        assert (shown is Shown.BY_NOBODY) == (kind in (EventKind.MESSAGE, EventKind.FEEDBACK))


@pytest.mark.parametrize("kind", [EventKind.MESSAGE, EventKind.FEEDBACK])
def test_a_gap_in_what_a_publisher_numbers_counts_where_its_taker_reports_nothing(
    kind: EventKind,
) -> None:
    assert evidence_of(kind, is_reported=True) is Shown.BY_NODE
    assert evidence_of(kind, is_reported=False) is Shown.BY_SENDER
