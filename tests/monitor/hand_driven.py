"""A transport whose clock, nodes and observations a test moves by hand."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path

from m2c.diagnostics import DiagnosticLog
from m2c.model import load
from moon.monitor.properties import PropertyWatch
from moon.monitor.reading import no_system
from moon.monitor.subject import Monitored
from moon.oracle.bounds import Bounds
from moon.run import Run
from moon.sources.source import Outputs
from moon.verdict import Verdict
from transports.interface import (
    Answer,
    BlindSpot,
    BlindSpotKind,
    Observation,
    ObservationKind,
)

TYPES = {
    "t/srv/Tick.srv": "---\nint8 status\n",
    "t/msg/Level.msg": "int32 data\n",
}
LEVEL = """\
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Level" initial="idle">
  <datamodel><data id="level" type="int32" expr="100"/></datamodel>
  <ros_service_server service_name="/Level/tick" type="t/Tick"/>
  <ros_topic_subscriber topic="/battery" type="t/Level"/>
  <state id="idle">
    <ros_topic_callback name="/battery">
      <assign location="level" expr="_msg.data"/>
    </ros_topic_callback>
    <ros_service_handle_request name="/Level/tick" target="idle">
      <ros_service_send_response name="/Level/tick">
        <field name="status" expr="level &gt; 30 ? 0 : 1"/>
      </ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""
MS = 1_000_000
S = 1000 * MS
START = 1_700_000_000 * S


def write_models(folder: Path) -> Path:
    """The model of ``Level``, its types beside it."""
    for name, text in TYPES.items():
        path = folder / "interfaces" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    model = folder / "Level.scxml"
    model.write_text(LEVEL)
    return model


class Shown(list[Verdict]):
    """What a person is shown."""

    def take(self, verdict: Verdict) -> None:
        self.append(verdict)


class HandDriven:
    """A transport and a watch on it."""

    repair_s = 0.0
    finds_nodes = False

    def __init__(
        self, folder: Path, properties: PropertyWatch | None = None, monitored: bool = True
    ) -> None:
        self.now = START
        self.since: dict[str, int] = {}
        self.set_forward_ns = 0
        """By how much the time of day was set forward since the beginning."""
        self.level = 100
        self._later = itertools.count(1000)
        self.said: list[str] = []
        self.verdicts: list[Verdict] = []
        self.shown = Shown()
        self.heard_by_tap: list[str] = []
        self.dropped: list[tuple[str, str]] = []
        self.asked: dict[str, Callable[[Answer | None], None]] = {}
        """The nodes that were asked how far they have reported, and who waits for it."""
        self._numbers: dict[tuple[str, str, bool], int] = {}
        self._due_ns = 0
        self._turn: Callable[[], None] = lambda: None
        log = DiagnosticLog()
        system = load([write_models(folder)], log)
        assert system is not None
        assert not log.has_errors
        if not monitored:
            system = no_system()
        self.held_up: deque[int] = deque()
        """So many ns pass in the next readings of the clock that nobody sets, one after the other."""
        monitored = Monitored(system, system.nodes, (), Bounds())
        outputs = Outputs([self], self.said.append, [self.shown])
        self.watch = Run(self, monitored, outputs, properties)
        self.watch.start(finds_nodes=self.finds_nodes)

    # what the watch calls
    def now_ns(self) -> int:
        return self.now

    def steady_ns(self) -> int:
        if self.held_up:
            self.now += self.held_up.popleft()
        return self.now - self.set_forward_ns

    def tap(self, channels, handler):
        self._handler = handler
        return self

    contested = ()
    unread: Mapping[str, str] = {}
    """What the tap says that it does not receive."""
    unsure: Mapping[tuple[str, str], str] = {}
    simulated: Mapping[str, str] = {}
    """What the tap says that nodes may not take."""

    def ask(self, node, answered, within_s=1.0) -> None:
        """A node answers when a test has it answer, else never."""
        self.asked[node] = answered

    def take_dropped(self) -> list[tuple[str, str]]:
        dropped, self.dropped = self.dropped, []
        return dropped

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        kind = BlindSpotKind
        found = {BlindSpot(kind.NOT_RECEIVED, channel): why for channel, why in self.unread.items()}
        found |= {BlindSpot(kind.MAY_NOT_BE_TAKEN, *it): why for it, why in self.unsure.items()}
        return found | {
            BlindSpot(kind.OTHER_TIME, "", node): why for node, why in self.simulated.items()
        }

    def is_contested(self, name: str) -> bool:
        return name in self.contested

    def problems(self):
        return self.heard_by_tap

    def close(self) -> None:
        """Nothing is open."""

    def watch_nodes(self, handler) -> None:
        self._node_handler = handler

    def up_since(self, name: str) -> int:
        return self.since.get(name, 0)

    def after(self, delay_s: float, handler):
        self._due_ns, self._turn = self.now + round(delay_s * S), handler
        return self

    def cancel(self) -> None:
        """Another turn is planned in place of the last one."""

    def post(self, handler) -> None:
        handler()

    def take(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)

    # what a test does
    def pass_time(self, milliseconds: int) -> None:
        """Time passes, and the watch sees it pass."""
        until = self.now + milliseconds * MS
        while self._due_ns <= until:
            self.now = max(self.now, self._due_ns)
            self._turn()
        self.now = until

    def jump(self, nanoseconds: int) -> None:
        """Time passes, and the watch does not run meanwhile."""
        self.now += nanoseconds
        self._turn()

    def node(self, name: str, up: bool, since: int | None = None) -> None:
        """A node comes up (having begun to connect ``since``, by default now) or goes away."""
        if up:
            self.since[name] = self.now if since is None else since
        else:
            self.since.pop(name, None)
        self._node_handler(name, up)

    def message(self, data: int, source: str = "Battery", **changes) -> None:
        """A message on the battery's topic."""
        self.level = data
        self.hear(
            "/battery", ObservationKind.MESSAGE, "t/msg/Level", {"data": data}, source, **changes
        )

    def tick(self, call: int, status: int | None = None) -> None:
        """The policy ticks the skill, which answers ``status`` (None: not at all) 1 ms later."""
        seen = (
            (ObservationKind.REQUEST_SENT, "policy", {}),
            (ObservationKind.REQUEST_RECEIVED, "Level", {}),
        )
        for kind, source, data in seen:
            self.hear("/Level/tick", kind, "t/srv/Tick_Request", data, source, call=call)
        self.now += MS
        if status is None:
            return
        for kind, source in (
            (ObservationKind.RESPONSE_SENT, "Level"),
            (ObservationKind.RESPONSE_RECEIVED, "policy"),
        ):
            data = {"status": status}
            self.hear("/Level/tick", kind, "t/srv/Tick_Response", data, source, call=call)

    def confirm(self) -> None:
        """All go on: what comes now shows that nothing is missing of what was before."""
        self.pass_time(300)
        self.message(self.level)
        self.tick(next(self._later), status=0 if self.level > 30 else 1)
        self.pass_time(500)

    def hear(self, channel, kind, type_name, data, source, **changes) -> None:
        """The tap hears something; ``changes`` are fields of the observation."""
        kind = ObservationKind(kind)
        place = (source, channel, kind is ObservationKind.MESSAGE)
        number = self._numbers.get(place, -1) + 1
        self._numbers[place] = number
        self.now += 10_000
        fields = {
            "stamp_ns": self.now,
            "received_ns": self.now,
            "sequence": number,
            "client": "" if kind is ObservationKind.MESSAGE else "policy",
        } | changes
        self._handler(
            Observation(
                channel=channel, kind=kind, type_name=type_name, data=data, source=source, **fields
            )
        )

    def forget_numbers(self, source: str) -> None:
        """The node was restarted: its numbers begin anew."""
        for place in [place for place in self._numbers if place[0] == source]:
            del self._numbers[place]

    @property
    def outcomes(self) -> list[str]:
        """The verdicts so far, without repetitions of one kind."""
        return [str(verdict.outcome) for verdict in self.verdicts]

    @property
    def status(self):
        (status,) = self.watch.statuses()
        return status
