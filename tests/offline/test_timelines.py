"""Timelines go on to the end of what was judged."""

from __future__ import annotations

from pathlib import Path

from moon.monitor.reading import no_system
from moon.monitor.subject import Monitored
from moon.offline.timelines import Timelines
from moon.oracle.bounds import Bounds
from moon.properties.files import load_properties
from moon.recording.entries import Began, Pulse, Turn
from moon.run import Run
from moon.sources.played import Player
from moon.sources.source import Outputs
from transports.interface import Observation, ObservationKind

S, MS = 10**9, 10**6
START = 1_790_000_000 * S
FILE = """\
ports:
  battery: {topic: /battery, field: data}
  alarm: {topic: /alarm}
predicates:
  low: battery < 30
properties:
  - {id: rung, pattern: response, request: low, response: alarm, within: 1 s}
"""


def level(data: int, at_ns: int) -> Observation:
    return Observation(
        stamp_ns=at_ns, received_ns=at_ns, channel="/battery", kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Int32", data={"data": data}, source="a", sequence=0,
    )  # fmt: skip


def test_what_is_false_at_a_deadline_after_the_last_message_is_false_in_the_last_band(
    tmp_path: Path,
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(FILE)
    bounds = Bounds()
    player = Player(0)
    watch = Run(player, Monitored(no_system(), (), tuple(load_properties(path)), bounds), Outputs())
    timelines = Timelines(watch, player)
    first = Began(START)
    player.start(first, watch.start)
    player.play(first)
    timelines.look(first)
    now = START + S
    for entry in (level(50, now), level(20, now + MS)):
        player.play(entry)
        timelines.look(entry)
    while watch.violations == 0:  # the recorder stops as soon as it is false
        now += 10 * MS
        pulse = Pulse(now, Turn.CLOCK, now)
        player.play(pulse)
        timelines.look(pulse)
        assert now < START + 3 * S
    (timeline,) = timelines.finished(now - 5 * MS)
    last = timeline.bands[-1]
    assert last.verdict == "violated"
    assert last.end_ns >= now
    assert last.end_ns > last.start_ns
