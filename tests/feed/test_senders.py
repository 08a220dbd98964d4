"""Who may have sent what, by the models."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from moon.feed import senders
from moon.feed.senders import Senders
from moon.monitor.reading import read_checked
from transports.interface import Observation, ObservationKind

TOUR = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
MESSAGE, TAKEN = ObservationKind.MESSAGE, ObservationKind.MESSAGE_TAKEN
ASKED, HEARD = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
LEVEL, TICK = "/BatteryComponent/level", "/AlarmSkill/tick"


@pytest.fixture
def tour() -> Senders:
    system = read_checked([TOUR])
    return Senders(system.nodes, system.plugins)


def seen(source: str, channel: str, kind: ObservationKind, client: str = "") -> Observation:
    return Observation(
        stamp_ns=1,
        received_ns=2,
        channel=channel,
        kind=kind,
        type_name="",
        data=None,
        source=source,
        sequence=3,
        order=4,
        client=client,
        call=5,
    )


@pytest.mark.parametrize(
    "own",
    [
        seen("BatteryComponent", LEVEL, MESSAGE),
        seen("BatteryLevelSkill", LEVEL, TAKEN, "BatteryComponent"),
        seen("AlarmSkill", TICK, HEARD, "policy"),
        seen("policy", TICK, ASKED, "policy"),
        seen("NavigationComponent", "/NavigationComponent/GoToPoi/_action/feedback", MESSAGE),
        seen("NavigationComponent", "/NavigationComponent/GoToPoi/_action/status", MESSAGE),
        seen("AlarmSkill", "/misspelt", MESSAGE),  # nobody's: it is its own fault
        seen("stranger", LEVEL, MESSAGE),
        seen("", LEVEL, MESSAGE),
    ],
)
def test_what_a_node_may_send_and_what_nobody_may_is_its_own(
    tour: Senders, own: Observation
) -> None:
    assert tour.attributed(own) is own
    assert list(tour.sentences()) == []


def test_a_message_in_a_name_that_does_not_publish_there_is_somebodys(tour: Senders) -> None:
    forged = seen("AlarmSkill", LEVEL, MESSAGE)
    found = tour.attributed(forged)
    assert found == msgspec.structs.replace(forged, source="?AlarmSkill", order=-1)
    assert list(tour.sentences()) == [
        f"received 1 message on {LEVEL} in the name of AlarmSkill, which by its model does not send "
        "there: another's, and no evidence about it"
    ]
    taken = tour.attributed(seen("BatteryLevelSkill", LEVEL, TAKEN, "AlarmSkill"))
    assert taken is not None
    assert (taken.client, taken.source, taken.order) == ("?AlarmSkill", "BatteryLevelSkill", 4)


@pytest.mark.parametrize(
    "forged",
    [
        seen("BatteryComponent", TICK, HEARD, "policy"),
        seen("BatteryComponent", TICK, ObservationKind.RESPONSE_SENT, "policy"),
        seen("AlarmSkill", LEVEL, TAKEN, "BatteryComponent"),
        seen("AlarmSkill", "/NavigationComponent/GoToPoi/_action/send_goal", ASKED, "AlarmSkill"),
    ],
)
def test_a_report_in_a_name_that_does_not_make_it_is_dropped(
    tour: Senders, forged: Observation
) -> None:
    assert tour.attributed(forged) is None
    assert len(list(tour.sentences())) == 1


def test_names_and_channels_without_end_are_not_all_kept(
    tour: Senders, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(senders, "MOST_FINDINGS", 2)
    for name in ("AlarmSkill", "WaitSkill", "ResetSkill", "AlarmSkill"):
        tour.attributed(seen(name, LEVEL, MESSAGE))
    first, _ = tour.sentences()
    assert first.startswith("received 2 messages")
