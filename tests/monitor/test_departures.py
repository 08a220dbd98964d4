"""Who is not there owes no response to properties either; what was late before it left, is."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.monitor.departures import Departures
from moon.properties.files import load_properties
from moon.properties.formula import text
from moon.properties.property import Property
from tests.monitor.hand_driven import MS, S
from tests.monitor.test_properties import Watched
from transports.interface import ObservationKind

PORTS = """\
ports:
  battery: {topic: /battery, field: data}
  asked: {service: /Level/tick, on: request}
  answered: {service: /Level/tick, on: response}
  docked: {topic: /docked}
properties:
"""
ANSWERS = (
    f"{PORTS}  - {{id: P, pattern: response, request: asked, response: answered, within: 1 s}}\n"
)
DOCKS = f"{PORTS}  - {{id: P, pattern: response, request: battery < 30, response: docked, within: 1 s}}\n"


def watching(folder: Path, file: str = ANSWERS) -> Watched:
    """Two nodes and the policy are up."""
    it = Watched(folder, file)
    for name in ("Level", "Battery", "Dock", "policy"):
        it.node(name, True)
    it.message(90)
    it.tick(1, 0)
    it.pass_time(300)
    assert it.of("P") == ["conforming"]
    return it


def dock(it: Watched) -> None:
    it.hear("/docked", ObservationKind.MESSAGE, "std_msgs/msg/Empty", {}, "Dock")


def test_a_node_that_leaves_owes_no_response_any_more(tmp_path):
    it = watching(tmp_path)
    it.tick(2)
    it.pass_time(500)
    it.node("Level", False)
    it.pass_time(3000)
    assert it.of("P") == ["conforming"]
    assert it.properties.violations == 0


def test_a_deadline_that_had_passed_before_it_left_was_missed(tmp_path):
    it = watching(tmp_path)
    it.tick(2)
    it.pass_time(1001)
    it.node("Level", False)
    it.pass_time(3000)
    assert it.of("P") == ["conforming", "violated"]


def test_what_is_asked_while_nobody_is_there_who_could_answer_is_owed(tmp_path):
    it = watching(tmp_path)
    it.node("Level", False)
    it.pass_time(100)
    asked = it.now
    it.hear("/Level/tick", "request_sent", "t/srv/Tick_Request", {}, "policy", call=2)
    it.pass_time(3000)
    assert it.of("P") == ["conforming", "violated"]
    assert it.verdicts[-1].stamp_ns - asked in range(S, S + MS)


def test_nothing_is_owed_when_who_asked_has_left_too(tmp_path):
    it = watching(tmp_path)
    it.node("Level", False)
    it.pass_time(100)
    it.hear("/Level/tick", "request_sent", "t/srv/Tick_Request", {}, "policy", call=2)
    it.pass_time(100)
    it.node("policy", False)
    it.pass_time(3000)
    assert it.of("P") == ["conforming"]


@pytest.mark.parametrize("last", ["Dock", "Battery"])
def test_a_state_that_asks_asks_no_more_when_all_have_left(tmp_path, last):
    """As when a system is stopped, whoever leaves first."""
    it = watching(tmp_path, DOCKS)
    it.message(29)
    dock(it)
    for name in sorted(("Dock", "Battery"), key=lambda name: name == last):
        it.pass_time(100)
        it.node(name, False)
    it.pass_time(3000)
    assert it.of("P") == ["conforming"]


def test_all_may_leave_at_one_instant(tmp_path):
    it = watching(tmp_path, DOCKS)
    it.message(29)
    dock(it)
    it.pass_time(100)
    for name in ("Dock", "Level", "Battery", "policy"):
        it.node(name, False)
    it.pass_time(3000)
    assert it.of("P") == ["conforming"]


def test_a_state_that_asks_goes_on_asking_while_who_sends_it_is_there(tmp_path):
    it = watching(tmp_path, DOCKS)
    it.message(29)
    dock(it)
    it.pass_time(100)
    left = it.now
    it.node("Dock", False)
    it.pass_time(3000)
    assert it.of("P") == ["conforming", "violated"]
    assert it.verdicts[-1].stamp_ns - left in range(S, S + MS)


def test_that_another_node_leaves_changes_nothing(tmp_path):
    it = watching(tmp_path)
    it.tick(2)
    it.pass_time(500)
    it.node("Battery", False)
    it.node("Dock", False)
    it.pass_time(3000)
    assert it.of("P") == ["conforming", "violated"]


def test_a_node_that_comes_back_owes_again(tmp_path):
    it = watching(tmp_path)
    it.node("Level", False)
    it.node("policy", False)
    it.pass_time(2000)
    it.forget_numbers("Level")
    it.forget_numbers("policy")
    it.node("Level", True)
    it.node("policy", True)
    it.pass_time(500)
    it.tick(1)
    it.pass_time(3000)
    assert it.of("P") == ["conforming", "violated"]


def test_of_a_node_that_nobody_knows_to_respond_silence_is_a_violation(tmp_path):
    it = watching(tmp_path, DOCKS)
    it.message(29)
    it.pass_time(100)
    it.node("Dock", False)  # it never docked, and no model says that it would
    it.pass_time(3000)
    assert it.of("P") == ["conforming", "violated"]


def test_a_violation_says_nothing_of_departures(tmp_path):
    it = watching(tmp_path)
    it.tick(2)
    it.pass_time(2000)
    (said,) = [verdict for verdict in it.verdicts if verdict.node == "P" and verdict.explanation]
    why = said.explanation
    assert "departure" not in str(why)
    assert why.observed == "asked and not (answered) for 1 s"
    assert [item.text.split(":")[0] for item in why.evidence] == ["asked", "not (answered) for 1 s"]


def properties(folder: Path, file: str) -> list[Property]:
    path = folder / "p.yaml"
    path.write_text(file)
    return load_properties(path)


def test_what_has_not_to_happen_in_time_stays_as_it_is(tmp_path):
    file = f"{PORTS}  - {{id: P, pattern: universality, of: battery > 3, within: 1 s}}\n"
    (item,) = properties(tmp_path, file)
    (same,) = Departures([item]).properties
    assert same is item


def test_every_link_of_a_chain_is_owed_by_its_own_nodes(tmp_path):
    file = (
        f"{PORTS}  - {{id: P, pattern: response_chain, request: asked, "
        "responses: [answered, docked], within: 1 s}\n"
    )
    found = Departures(properties(tmp_path, file))
    assert "{answered} or {@departure P 0}" in text(found.properties[0].formula)
    assert "{docked} or {@departure P 1}" in text(found.properties[0].formula)
    assert found.channels == {"/Level/tick", "/docked"}


# --- the beginning -------------------------------------------------------------------------------

OFTEN = f"{PORTS}  - {{id: P, pattern: recurrence, of: docked, within: 1 s}}\n"
ONCE = f"{PORTS}  - {{id: P, pattern: existence, of: docked, within: 1 s}}\n"


class Awaiting(Watched):
    """It is told which nodes are there."""

    finds_nodes = True


def beginning(folder: Path, file: str) -> Watched:
    """A monitor of a system of Level and Dock, which is started before it."""
    it = Awaiting(folder, file, awaited=("Level", "Dock"))
    it.pass_time(5000)
    assert it.of("P") == []
    assert it.standing()["P"] == "unseen"
    return it


def require_due_a_second_from_now(it):
    """The property P has begun now, and is violated if nothing happens for a second."""
    found = it.now
    it.pass_time(900)
    assert it.of("P") == ["conforming"]
    it.pass_time(500)
    assert it.of("P") == ["conforming", "violated"]
    assert it.verdicts[-1].stamp_ns - found in range(S, S + 2 * MS)


@pytest.mark.parametrize("file", [OFTEN, ONCE])
def test_what_is_to_happen_in_time_begins_when_all_nodes_were_found(tmp_path, file):
    it = beginning(tmp_path, file)
    it.node("Level", True)
    it.pass_time(5000)
    (status,) = [one for one in it.watch.statuses() if one.machine == "P"]
    assert (status.verdict, status.last) == ("unseen", "not found yet: Dock")
    it.node("Dock", True)
    require_due_a_second_from_now(it)


@pytest.mark.parametrize("file", [OFTEN, ONCE])
def test_a_node_that_does_not_announce_itself_is_found_by_what_it_does(tmp_path, file):
    it = beginning(tmp_path, file)
    it.node("Level", True)
    it.pass_time(3000)
    it.hear("/elsewhere", ObservationKind.MESSAGE, "std_msgs/msg/Empty", {}, "Dock")
    require_due_a_second_from_now(it)


@pytest.mark.parametrize("file", [OFTEN, ONCE])
def test_what_is_to_happen_in_time_may_happen_before_all_were_found(tmp_path, file):
    it = beginning(tmp_path, file)
    it.node("Dock", True)
    dock(it)
    it.pass_time(700)
    dock(it)
    it.node("Level", True)
    it.pass_time(700)
    assert it.of("P") == ["conforming"]


def test_what_has_begun_goes_on_though_a_node_is_still_to_come(tmp_path):
    it = beginning(tmp_path, OFTEN)
    it.node("Dock", True)
    dock(it)
    last = it.now
    it.pass_time(2000)
    assert it.of("P") == ["violated"]
    assert it.verdicts[-1].stamp_ns - last in range(S, S + 2 * MS)


def test_who_came_once_is_not_waited_for_again(tmp_path):
    it = beginning(tmp_path, OFTEN)
    it.node("Dock", True)
    it.node("Dock", False)
    it.node("Level", True)
    it.pass_time(2000)
    assert it.of("P")[-1:] == ["violated"]


def test_where_nobody_says_which_nodes_are_there_the_beginning_is_the_monitors(tmp_path):
    found = []
    for awaited in ((), ("Level", "Dock")):
        it = Watched(tmp_path, OFTEN, awaited=awaited)
        assert not it.finds_nodes
        it.pass_time(2000)
        found.append([(item.outcome, item.stamp_ns, item.reason) for item in it.verdicts])
    assert found[0] == found[1]
    assert found[0][-1][0] == "violated"


@pytest.mark.parametrize("scope", ["", ", after: asked", ", after_until: [asked, answered]"])
@pytest.mark.parametrize("pattern", ["recurrence", "existence"])
def test_nothing_is_owed_once_the_nodes_are_about_to_be_ended(tmp_path, pattern, scope):
    found = {}
    for is_ending in (True, False):
        it = Watched(
            tmp_path,
            f"{PORTS}  - {{id: P, pattern: {pattern}, of: docked, within: 1 s{scope}}}\n",
        )
        it.hear("/Level/tick", "request_sent", "t/srv/Tick_Request", {}, "policy", call=1)
        it.pass_time(700)
        if is_ending:
            it.watch.ending(it.now)
        it.pass_time(3000)
        found[is_ending] = it.of("P")[-1]
    assert found == {True: "conforming", False: "violated"}


def test_what_was_due_before_the_nodes_were_to_be_ended_was_owed(tmp_path):
    it = Watched(tmp_path, OFTEN)
    it.pass_time(1002)
    it.watch.ending(it.now)
    it.pass_time(3000)
    assert it.of("P")[-1] == "violated"


def test_the_nodes_are_about_to_be_ended_whatever_becomes_of_the_clock(tmp_path):
    it = Watched(tmp_path, OFTEN)
    it.pass_time(500)
    it.watch.ending(it.now)
    it.set_forward_ns += 3600 * S
    it.jump(3600 * S)
    it.pass_time(5000)
    assert "violated" not in it.of("P")
