"""Nodes whose timers follow another clock, a simulation's: nothing that depends on how much time passes is
concluded of them.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model.walk import has_timers
from tests.monitor import hand_driven
from tests.monitor.hand_driven import HandDriven, S
from tests.monitor.test_properties import Watched
from tests.monitor.test_repair import BEATING
from tests.oracle.machines import read

WHY = "Level has its time from /clock, which may stand still or be faster"
TIMED = """\
ports:
  battery: {topic: /battery, field: data}
  told: {topic: /battery}
properties:
  - {id: late, pattern: recurrence, of: told, within: 1 s}
  - {id: low, pattern: absence, of: battery < 30}
"""


@pytest.mark.parametrize("simulated", [(), ("Battery",), ("Level",)], ids=str)
def test_a_machine_with_timers_is_not_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulated: tuple[str, ...]
) -> None:
    monkeypatch.setattr(hand_driven, "LEVEL", BEATING)
    hand = HandDriven(tmp_path)
    hand.simulated = dict.fromkeys(simulated, WHY)
    hand.pass_time(100)
    hand.node("Level", True)
    for _ in range(4):
        hand.message(0, source="Level")
        hand.pass_time(500)
    for _ in range(4):  # the simulation runs at five times the speed, then stands still
        hand.message(0, source="Level")
        hand.pass_time(100)
    hand.pass_time(3000)
    assert (hand.watch.violations > 0) == ("Level" not in simulated)
    assert any(verdict.reason == WHY for verdict in hand.verdicts) == ("Level" in simulated)


def test_a_machine_without_timers_is_judged(relay: HandDriven) -> None:
    relay.simulated = {"Level": WHY, "Battery": WHY}
    relay.node("Level", True, since=relay.now - S)
    relay.node("Battery", True, since=relay.now - S)
    relay.pass_time(6500)
    relay.message(70)
    relay.pass_time(3000)
    assert any("unresponsive" in verdict.reason for verdict in relay.verdicts)


@pytest.mark.parametrize("node", ["", "Battery", "Level"])
def test_a_property_is_not_violated_by_how_long_something_takes(tmp_path: Path, node: str) -> None:
    watched = Watched(tmp_path, TIMED)
    watched.simulated = {node: WHY}
    for name in ("Level", "Battery", "policy"):
        watched.node(name, True)
    watched.pass_time(500)
    watched.message(90)
    watched.pass_time(3000)
    watched.message(20)
    watched.pass_time(500)
    is_sender = node in ("", "Battery")
    assert ("violated" in watched.of("late")) != is_sender
    assert "violated" in watched.of("low")
    reasons = [verdict.reason for verdict in watched.verdicts if verdict.node == "late"]
    assert any(reason.startswith(WHY) for reason in reasons) == is_sender


@pytest.mark.parametrize(
    ("inside", "is_timed"),
    [
        ('<state id="a"/>', False),
        ('<state id="a"><onentry><raise event="x"/></onentry></state>', False),
        ('<state id="a"><onentry><send event="x"/></onentry></state>', False),
        ('<state id="a"><onentry><send event="x" delay="1s"/></onentry></state>', True),
        (
            '<state id="a"><onentry><if cond="true"><send event="x" delayexpr="9"/></if></onentry>'
            "</state>",
            True,
        ),
        (
            '<ros_time_rate name="r" rate_hz="1"/><state id="a"><ros_rate_callback name="r"/></state>',
            True,
        ),
        (
            '<state id="a"><state id="b"><onentry><send event="x" delay="1s"/></onentry></state>'
            "</state>",
            True,
        ),
    ],
)
def test_which_machines_have_timers(inside: str, is_timed: bool) -> None:
    text = f'<scxml xmlns="http://www.w3.org/2005/07/scxml" name="M" initial="a">{inside}</scxml>'
    assert has_timers(read(text)) == is_timed
