"""Random small machines, written as SCXML and read as any other model is."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from pathlib import Path
from random import Random
from zlib import crc32

from m2c.model import DiagnosticLog, InterfaceLibrary, Machine
from m2c.model.reader import machine_of
from m2c.model.xml import parse_xml

INTERFACES = Path(__file__).parent / "interfaces"
NAME = "Probe"
TIMER_HZ = 4.0

SERVER = "/Probe/ask"
OTHER_SERVER = "/Probe/tell"
CLIENT = "/Other/ask"


@functools.cache
def library() -> InterfaceLibrary:
    """The standard types, and ``probe_interfaces/srv/Ask``."""
    return InterfaceLibrary.load([INTERFACES], DiagnosticLog())


@functools.lru_cache(maxsize=64)
def read(text: str) -> Machine:
    """The machine that ``text`` describes; its faults fail the test."""
    log = DiagnosticLog()
    root = parse_xml(text.encode(), "probe.scxml", log)
    assert root is not None, log.diagnostics
    machine = machine_of(root, log, library())
    assert machine is not None, log.diagnostics
    assert not log.has_errors, (text, log.diagnostics)
    return machine


def model(draw: Random, delays: bool = False) -> str:
    """The text of a random machine called ``Probe``.

    One to three states; topics in and out, services served and called, a timer; conditions,
    assignments, internal events, entries and exits, eventless transitions, choices left to chance.
    Eventless transitions only lead to later states and internal events raise no others, so that a
    macrostep ends.

    Args:
        draw: where all chance comes from.
        delays: whether it has delayed transitions, and events that it sends itself with a delay and cancels.
    """
    return _Writer(draw, delays).text()


def nested_model(draw: Random, delays: bool = False) -> str:
    """The text of such a machine with compound states: some of its states stand in one, some in another in that.

    These have entries and exits, a history each, and transitions for messages; inputs may lead to them.
    Eventless transitions stay as they are, so that a macrostep ends.
    """
    writer = _Writer(draw, delays)
    first, *rest = writer.text().split("\n  <state ")
    rest[-1] = rest[-1].removesuffix("\n</scxml>\n")
    states = [f"  <state {text}" for text in rest]
    names = re.findall(r'<state id="(\w+)"', "\n".join(states))
    begin = draw.randrange(len(states))
    inner = draw.randrange(begin, len(states))
    deep = writer.compound("inner", states[inner:], names[inner:])
    outer = writer.compound("outer", [*states[begin:inner], deep], names[begin:])
    text = "\n".join([first, *states[:begin], outer, "</scxml>", ""])
    groups = ("outer", "inner", "outer_last", "inner_last")

    def led(found: re.Match[str]) -> str:
        return f'{found[1]}target="{draw.choice(groups)}"' if draw.random() < 0.5 else found[0]

    return re.sub(r'(<(?:ros_\w+|transition event="note")[^>]*)target="\w+"', led, text)


class _Writer:
    def __init__(self, draw: Random, delays: bool) -> None:
        self._draw = draw
        self._delays = delays
        self._states = [f"s{index}" for index in range(draw.randint(1, 3))]
        self._inputs = ["/in"] + (["/other_in"] if self._chance(0.4) else [])
        self._outputs = ["/out"] + (["/other_out"] if self._chance(0.3) else [])
        self._servers = [SERVER] if self._chance(0.8) else []
        if self._servers and self._chance(0.25):
            self._servers.append(OTHER_SERVER)
        self._has_client = self._chance(0.4)
        self._has_timer = self._chance(0.12)
        self._raises = self._chance(0.25)
        self._random = self._chance(0.25)

    def _chance(self, probability: float) -> bool:
        return self._draw.random() < probability

    # -- the whole --------------------------------------------------------------------------------

    def text(self) -> str:
        lines = [
            f'<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="{NAME}" '
            f'initial="{self._states[0]}">',
            "  <datamodel>",
            f'    <data id="a" type="int32" expr="{self._draw.randint(0, 2)}"/>',
            f'    <data id="b" type="int32" expr="{self._draw.randint(0, 2)}"/>',
            '    <data id="on" type="bool" expr="false"/>',
            '    <data id="LIMIT" type="int32" expr="2"/>',
            "  </datamodel>",
        ]
        ask = "probe_interfaces/Ask"
        lines += [
            f'  <ros_topic_subscriber topic="{name}" type="std_msgs/Int32"/>'
            for name in self._inputs
        ]
        lines += [
            f'  <ros_topic_publisher topic="{name}" type="std_msgs/Int32"/>'
            for name in self._outputs
        ]
        lines += [
            f'  <ros_service_server service_name="{name}" type="{ask}"/>' for name in self._servers
        ]
        if self._has_client:
            lines.append(f'  <ros_service_client service_name="{CLIENT}" type="{ask}"/>')
        if self._has_timer:
            lines.append(f'  <ros_time_rate name="clock" rate_hz="{TIMER_HZ}"/>')
        for index, state in enumerate(self._states):
            lines += self._state(index, state)
        return "\n".join([*lines, "</scxml>", ""])

    def _state(self, index: int, state: str) -> list[str]:
        lines = [f'  <state id="{state}">']
        if self._chance(0.25):
            lines += ["    <onentry>", *self._content("", may_raise=False), "    </onentry>"]
        if self._chance(0.1):
            lines += ["    <onexit>", *self._content("", may_raise=False), "    </onexit>"]
        for name in self._inputs:
            lines += self._handlers("ros_topic_callback", name, "_msg.data")
        for name in self._servers:
            lines += self._handlers("ros_service_handle_request", name, "_req.value", name)
        if self._has_client:
            lines += self._handlers("ros_service_handle_response", CLIENT, "_res.value")
            lines += self._handlers("ros_service_handle_error", CLIENT, "")
        if self._has_timer:
            lines += self._handlers("ros_rate_callback", "clock", "")
        if self._raises and self._chance(0.7):
            lines += self._transition('transition event="note"', "transition", "", may_raise=False)
        lines += self._delayed()
        later = self._states[index + 1 :]
        if later and self._chance(0.2):
            cond = f' cond="{self._condition("")}"' if self._chance(0.6) else ""
            lines.append(f'    <transition{cond} target="{self._draw.choice(later)}">')
            lines += [*self._content("", may_raise=False), "    </transition>"]
        return [*lines, "  </state>"]

    def compound(self, name: str, states: Sequence[str], names: Sequence[str]) -> str:
        """A compound state around ``states``, of which those called ``names`` are atomic."""
        draw = self._draw
        initial, default = draw.choice(names), draw.choice(names)
        kind = draw.choice(("shallow", "deep"))
        lines = [
            f'  <state id="{name}">',
            f'    <initial><transition target="{initial}">',
            *self._content("", may_raise=False),
            "    </transition></initial>",
            f'    <history id="{name}_last" type="{kind}"><transition target="{default}">',
            *self._content("", may_raise=False),
            "    </transition></history>",
        ]
        for tag in ("onentry", "onexit"):
            if self._chance(0.6):
                lines += [f"    <{tag}>", *self._content("", may_raise=False), f"    </{tag}>"]
        lines += self._handlers("ros_topic_callback", draw.choice(self._inputs), "_msg.data")
        lines += self._delayed()
        return "\n".join([*lines, *states, "  </state>"])

    def _handlers(self, tag: str, name: str, data: str, server: str = "") -> list[str]:
        if self._chance(0.15):
            return []
        lines: list[str] = []
        if self._chance(0.4):
            cond = self._condition(data)
            lines += self._transition(f'{tag} name="{name}" cond="{cond}"', tag, data, server)
        if self._chance(0.85):
            lines += self._transition(f'{tag} name="{name}"', tag, data, server)
        return lines

    def _delayed(self) -> list[str]:
        """A transition after a while, one for an event that the machine sent itself."""
        if not self._delays:
            return []
        heads = [f'transition after="{self._delay()}"'] if self._chance(0.4) else []
        if self._chance(0.15):
            heads.append(f'transition after="{self._delay()}" cond="{self._condition("")}"')
        lines = [line for head in heads for line in self._transition(head, "transition", "")]
        if self._chance(0.6):
            target = f' target="{self._draw.choice(self._states)}"' if self._chance(0.5) else ""
            lines.append(f'    <transition event="later"{target}>')
            lines += [*self._content("", may_raise=False), "    </transition>"]
        return lines

    def _delay(self) -> str:
        return self._draw.choice(("60ms", "120ms", "0.25s", "400ms"))

    def _transition(
        self, head: str, tag: str, data: str, server: str = "", may_raise: bool = True
    ) -> list[str]:
        body = self._content(data, may_raise)
        if server and self._chance(0.75):
            body += self._response(server, data)
        if self._random and len(self._states) > 1 and self._chance(0.2) and tag == "transition":
            one, other = self._draw.choice(self._states), self._draw.choice(self._states)
            targets = [f'      <target id="{one}" prob="0.5"/>']
            targets += [f'      <target id="{other}" prob="0.5"/>']
            return [f"    <{head}>", *targets, *body, f"    </{tag}>"]
        target = f' target="{self._draw.choice(self._states)}"' if self._chance(0.5) else ""
        return [f"    <{head}{target}>", *body, f"    </{tag}>"]

    # -- content ----------------------------------------------------------------------------------

    def _content(self, data: str, may_raise: bool = True) -> list[str]:
        return [
            line
            for _ in range(self._draw.choice((0, 1, 1, 2)))
            for line in self._statement(data, may_raise)
        ]

    def _statement(self, data: str, may_raise: bool, depth: int = 0) -> list[str]:
        kinds = ["assign", "assign", "publish", "publish"]
        kinds += ["call"] * self._has_client
        kinds += ["respond"] * bool(self._servers)
        kinds += ["raise"] * (self._raises and may_raise)
        kinds += ["if"] * (depth == 0)
        if self._delays:  # what is sent for an input ends with the inputs
            kinds += ["cancel", *["later", "later", "cancel"] * bool(data)]
        match self._draw.choice(kinds):
            case "assign" if self._chance(0.25):
                return [f'      <assign location="on" expr="{self._condition(data)}"/>']
            case "assign":
                name = self._draw.choice(("a", "b"))
                return [f'      <assign location="{name}" expr="{self._integer(data)}"/>']
            case "publish":
                name = self._draw.choice(self._outputs)
                return self._send("ros_topic_publish", name, {"data": self._integer(data)})
            case "call":
                fields = {"value": self._integer(data)}
                return self._send("ros_service_send_request", CLIENT, fields)
            case "respond":
                return self._response(self._draw.choice(self._servers), data)
            case "later":
                name = self._draw.choice(("", ' id="one"', ' id="one"'))
                return [f'      <send event="later" delay="{self._delay()}"{name}/>']
            case "cancel":
                return ['      <cancel sendid="one"/>']
            case "raise":
                return ['      <raise event="note"/>']
            case _:
                lines = [f'      <if cond="{self._condition(data)}">']
                lines += self._statement(data, may_raise, depth + 1)
                if self._chance(0.5):
                    lines += ["      <else/>", *self._statement(data, may_raise, depth + 1)]
                return [*lines, "      </if>"]

    def _response(self, server: str, data: str) -> list[str]:
        fields = {"value": self._integer(data)}
        if self._chance(0.5):
            fields["ok"] = self._draw.choice(("true", "on", self._condition(data)))
        return self._send("ros_service_send_response", server, fields)

    def _send(self, tag: str, name: str, fields: dict[str, str]) -> list[str]:
        inner = [f'        <field name="{key}" expr="{expr}"/>' for key, expr in fields.items()]
        return [f'      <{tag} name="{name}">', *inner, f"      </{tag}>"]

    # -- expressions ------------------------------------------------------------------------------

    def _integer(self, data: str) -> str:
        """A whole number; some of them by ``Array.from``, which draws nothing: seeds stay what they are."""
        item = self._one_integer(data)
        chosen = crc32(item.encode())
        if chosen % 6:
            return item
        length = 1 if "random" in item else 2
        return f"Array.from({{length: {length}}}, (_, i) =&gt; {item})[{chosen % length}]"

    def _one_integer(self, data: str) -> str:
        simple = ["a", "b", "LIMIT", str(self._draw.randint(0, 3)), *([data] * 3 if data else [])]
        one = self._draw.choice(simple)
        match self._draw.randint(0, 5):
            case 0 if not self._random:  # an oracle need not calculate with what it cannot know
                return f"({one} + {self._draw.choice(simple)}) % 4"
            case 1 if not self._random:
                return f"({one} + 1) % 4"
            case 2 if self._random:
                return f"Math.floor(Math.random() * {self._draw.randint(2, 3)})"
            case 3:
                return f"on ? {one} : {self._draw.choice(simple)}"
            case _:
                return one

    def _condition(self, data: str) -> str:
        one, other = (self._draw.choice(("a", "b", *([data] * 2 if data else []))) for _ in "12")
        operator = self._draw.choice(("&lt;", "&lt;=", "&gt;", "&gt;=", "==", "!="))
        match self._draw.randint(0, 7):
            case 0:
                return "on"
            case 1:
                return "!on"
            case 2:
                return f"{one} {operator} {other}"
            case 3:
                return f"on || {one} {operator} LIMIT"
            case 4:
                return f"on &amp;&amp; {one} {operator} 1"
            case 5 if self._random:
                return "Math.random() &lt; 0.5"
            case _:
                return f"{one} {operator} {self._draw.randint(0, 3)}"
