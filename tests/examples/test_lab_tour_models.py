"""What single models of the example promise the tour, event by event."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.codegen.harness import Generated

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
SUCCESS, FAILURE, RUNNING = 0, 1, 2
INTERFACES = {
    str(path.relative_to(EXAMPLE / "interfaces")): path.read_text()
    for pattern in ("*/srv/*.srv", "*/action/*.action")
    for path in (EXAMPLE / "interfaces").glob(pattern)
}


def generated(folder: Path, model: str) -> Generated:
    """The machine of a model of the example, compiled and started."""
    return Generated(folder, (EXAMPLE / model).read_text(), INTERFACES)


@pytest.mark.parametrize(("level", "status"), [(31, SUCCESS), (30, SUCCESS), (29, FAILURE)])
def test_the_battery_is_low_below_30_percent_and_not_at_30(
    tmp_path: Path, level: int, status: int
) -> None:
    skill = generated(tmp_path, "skills/BatteryLevelSkill.scxml")
    skill.it.on_level_message(skill.interfaces.Int32(data=level))
    skill.it.on_tick_request(skill.interfaces.TickConditionRequest())
    ((name, response),) = skill.outputs.sent
    assert (name, response.status, response.is_ok) == ("respond_tick", status, True)


@pytest.fixture
def go_to_poi(tmp_path: Path) -> Generated:
    """The skill that drives, ticked once: it has asked where to."""
    skill = generated(tmp_path, "skills/GoToPoiSkill.scxml")
    skill.it.on_tick_request(skill.interfaces.TickActionRequest())
    assert skill.outputs.names() == ["call_get_poi"]
    return skill


def halt(skill: Generated) -> None:
    """A request to halt, which every state takes."""
    assert skill.it.on_halt_request(skill.interfaces.HaltActionRequest())


def test_no_goal_is_sent_after_a_halt_was_answered(go_to_poi: Generated) -> None:
    halt(go_to_poi)
    assert go_to_poi.outputs.names() == ["respond_tick", "respond_halt"]
    go_to_poi.it.on_get_poi_response(go_to_poi.interfaces.GetPoiResponse(poi=1))
    assert go_to_poi.outputs.names() == []


def test_a_tick_after_such_a_halt_asks_anew_where_to_go(go_to_poi: Generated) -> None:
    halt(go_to_poi)
    go_to_poi.outputs.names()
    tick = go_to_poi.interfaces.TickActionRequest()
    go_to_poi.it.on_tick_request(tick)
    assert go_to_poi.outputs.sent[-1][1].status == RUNNING
    go_to_poi.it.on_get_poi_response(go_to_poi.interfaces.GetPoiResponse(poi=1))
    assert go_to_poi.outputs.names() == ["respond_tick"]
    go_to_poi.it.on_tick_request(tick)
    go_to_poi.it.on_get_poi_response(go_to_poi.interfaces.GetPoiResponse(poi=2))
    assert [item[0] for item in go_to_poi.outputs.sent] == [
        "call_get_poi",
        "send_goal_go_to_poi",
        "respond_tick",
    ]
    assert go_to_poi.outputs.sent[1][1].poi == 2


def test_a_halt_while_the_goal_is_being_sent_cancels_it(go_to_poi: Generated) -> None:
    go_to_poi.it.on_get_poi_response(go_to_poi.interfaces.GetPoiResponse(poi=1))
    go_to_poi.outputs.names()
    halt(go_to_poi)
    assert go_to_poi.outputs.names() == ["send_cancel_go_to_poi", "respond_halt"]
    go_to_poi.it.on_go_to_poi_accepted(1)
    go_to_poi.it.on_go_to_poi_canceled(go_to_poi.interfaces.GoToPoiResult(), 1, 5)
    assert go_to_poi.it.state.value == "idle"


def test_a_drive_that_ended_before_its_cancel_is_not_taken_for_the_next_ones_success(
    go_to_poi: Generated,
) -> None:
    go_to_poi.it.on_get_poi_response(go_to_poi.interfaces.GetPoiResponse(poi=1))
    go_to_poi.it.on_go_to_poi_accepted(1)
    halt(go_to_poi)
    go_to_poi.it.on_go_to_poi_succeeded(go_to_poi.interfaces.GoToPoiResult(reached=True), 1, 4)
    go_to_poi.outputs.names()
    go_to_poi.it.on_tick_request(go_to_poi.interfaces.TickActionRequest())
    assert go_to_poi.outputs.names() == ["call_get_poi"]


def test_a_drive_to_where_the_robot_already_is_is_over_after_one_step(tmp_path: Path) -> None:
    navigation = generated(tmp_path, "components/NavigationComponent.scxml")
    thread = navigation.machine.NavigationComponentThread(navigation.outputs, 0)
    goal = navigation.interfaces.GoToPoiGoal(poi=1)
    thread.start()

    def drive() -> list[str]:
        thread.on_go_to_poi_thread_start(goal, 1, 0)
        while thread.state.value == "moving":
            thread.on_step_timer()
        return navigation.outputs.names()

    ended = ["succeed_go_to_poi", "free_thread_go_to_poi"]
    assert drive() == ["feedback_go_to_poi"] * 79 + ended
    assert drive() == ended
