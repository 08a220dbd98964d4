"""What nodes do on which channels, by their models."""

from __future__ import annotations

from pathlib import Path

from moon.feed.places import by_channel, nodes_at
from moon.monitor.reading import read_checked
from transports.interface import ObservationKind

TOUR = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
GO = "/NavigationComponent/GoToPoi/_action"


def test_the_models_say_who_does_what() -> None:
    system = read_checked([TOUR])
    found = nodes_at(system.nodes, system.plugins)
    level = "/BatteryComponent/level"
    assert found[level, ObservationKind.MESSAGE] == {"BatteryComponent"}
    assert found[level, ObservationKind.MESSAGE_TAKEN] == {"BatteryLevelSkill"}
    assert found["/AlarmSkill/tick", ObservationKind.RESPONSE_SENT] == {"AlarmSkill"}
    for part in ("send_goal", "cancel_goal", "get_result"):
        place = f"{GO}/{part}"
        assert found[place, ObservationKind.RESPONSE_SENT] == {"NavigationComponent"}
        assert found[place, ObservationKind.REQUEST_SENT] == {"GoToPoiSkill"}
    for part in ("feedback", "status"):
        assert found[f"{GO}/{part}", ObservationKind.MESSAGE] == {"NavigationComponent"}


def test_a_topic_and_a_service_of_one_name_have_the_nodes_of_both() -> None:
    found = by_channel({("/c", True): {"A"}, ("/c", False): {"B"}, ("/d", True): {"A"}})
    assert found == {"/c": {"A", "B"}, "/d": {"A"}}
