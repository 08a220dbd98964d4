"""How fast a machine is judged that takes a topic at a high rate, and what a flood costs.

Each machine gets messages at some rate, with values that change, and is asked ten times a second; all are
taken a millisecond after they were sent. "times real time" is the time of the trace by the processor's.
"""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.page import Row, command
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from transports.interface import Observation, ObservationKind

S = 1_000_000_000
MS = 1_000_000
START = 1_700_000_000 * S
TAKEN_NS = MS
"""A message is taken so long after it was sent."""
ASKED_NS = S // 10
TURN_NS = 10 * MS
TARGET = 5.0

TYPES = {"t/srv/Tick.srv": "---\nint32 status\n", "t/msg/Level.msg": "int32 data\n"}
MODEL = """\
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Probe" initial="idle">
  <datamodel><data id="level" type="int32" expr="0"/></datamodel>
  <ros_service_server service_name="/Probe/tick" type="t/Tick"/>
  <ros_topic_subscriber topic="/level" type="t/Level"/>
  <ros_topic_publisher topic="/told" type="t/Level"/>
  <state id="idle">
    <ros_topic_callback name="/level">{on_message}</ros_topic_callback>
    <ros_service_handle_request name="/Probe/tick" target="idle">
      <ros_service_send_response name="/Probe/tick">
        <field name="status" expr="{answer}"/>
      </ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""
KEEP = '<assign location="level" expr="_msg.data"/>'
COUNT = '<assign location="level" expr="level + 1"/>'
TELL = (
    KEEP + '<ros_topic_publish name="/told"><field name="data" expr="level"/></ros_topic_publish>'
)
MACHINES = {
    "keeps the last value": (KEEP, "level"),
    "compares it with a limit": (KEEP, "level &gt; 50 ? 1 : 0"),
    "counts": (COUNT, "level"),
    "tells it on": (TELL, "level"),
}


def read(name: str) -> System:
    """The model of one machine."""
    on_message, answer = MACHINES[name]
    with tempfile.TemporaryDirectory() as folder:
        for path, text in TYPES.items():
            (Path(folder) / "interfaces" / path).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / "interfaces" / path).write_text(text)
        model = Path(folder) / "Probe.scxml"
        model.write_text(MODEL.format(on_message=on_message, answer=answer))
        system = load([model], DiagnosticLog())
        assert system is not None
        Oracle(system.nodes[0], system.library)  # its types are read from their files once
    return system


def trace(name: str, rate: int, sources: int, seconds: float) -> Iterator[Observation]:
    """What is heard of a healthy run: ``rate`` messages a second from each of ``sources``."""
    numbers: dict[tuple[str, str, bool], int] = {}
    order = itertools.count()

    def seen(
        stamp: int, kind: ObservationKind, channel: str, data: object, source: str
    ) -> Observation:
        place = (source, channel, kind is ObservationKind.MESSAGE)
        number = numbers[place] = numbers.get(place, -1) + 1
        calls = kind is not ObservationKind.MESSAGE
        return Observation(
            stamp_ns=stamp,
            received_ns=stamp + MS,
            channel=channel,
            kind=kind,
            type_name="",
            data=data,
            source=source,
            client="asker" if calls else "",
            call=number // 2 if calls else 0,
            sequence=number,
            order=next(order) if source == "Probe" else -1,
        )

    events: list[tuple[int, int, int, int]] = []
    for source in range(sources):
        for index in range(round(rate * seconds)):
            sent = START + index * S // rate + source * 1_000
            value = (index * 37 + source * 11) % 101
            events += [(sent, 0, source, value), (sent + TAKEN_NS, 1, source, value)]
    asked = range(START + ASKED_NS // 2 + MS // 2, START + round(seconds * S), ASKED_NS)
    events += [(stamp, 2, 0, 0) for stamp in asked]
    level = 0
    message, told = ObservationKind.MESSAGE, name == "tells it on"
    for stamp, what, source, value in sorted(events):
        if what == 0:
            yield seen(stamp, message, "/level", {"data": value}, f"sensor{source}")
        elif what == 1:
            level = level + 1 if name == "counts" else value
            if told:
                yield seen(stamp + 1000, message, "/told", {"data": level}, "Probe")
        else:
            answer = int(level > 50) if "limit" in name else level
            received, sent_kind = ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT
            yield seen(stamp + 2000, received, "/Probe/tick", {}, "Probe")
            yield seen(stamp + 3000, sent_kind, "/Probe/tick", {"status": answer}, "Probe")


def judge(name: str, rate: int, sources: int, seconds: float) -> tuple[float, str]:
    """Times real time; how it ended."""
    system = read(name)
    oracle = Oracle(system.nodes[0], system.library)
    oracle.start(START, whole=True)
    heard = list(trace(name, rate, sources, seconds))
    verdicts, turn = [], START
    began = time.process_time()
    for observation in heard:
        while turn < observation.received_ns:
            verdicts += oracle.advance(turn)
            turn += TURN_NS
        verdicts += oracle.feed(observation)
    taken = time.process_time() - began
    assert not [verdict for verdict in verdicts if verdict.outcome is Outcome.VIOLATED], verdicts[0]
    return seconds / taken, f"{oracle.outcome} {oracle.verdict().reason}".strip()


def rows(seconds: float = 5.0) -> list[Row]:
    """What is shown; ``seconds`` of each trace."""
    found = []
    for rate, sources in ((100, 1), (1000, 1), (100, 3), (300, 2), (1000, 2), (20_000, 1)):
        slowest = (float("inf"), "")
        for name in MACHINES:
            speed, how = judge(name, rate, sources, seconds)
            slowest = min(slowest, (speed, name))
            what = f"a machine that {name}, {sources} × {rate} messages/s"
            print(f"{what}: {speed:.1f} times real time; {how}")
        what = f"{sources} × {rate} messages/s, the slowest: a machine that {slowest[1]}"
        found.append(Row(what, slowest[0], "x", least=TARGET))
    return found


if __name__ == "__main__":
    command(rows)
