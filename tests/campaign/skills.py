"""Skills and plugins: what the leaves of a tree tick."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import msgspec

from tests.campaign.channels import Channel, call, use
from tests.campaign.elements import Element, e
from tests.campaign.kinds import ACTION, BOOL, CONDITION, HALT, INT32, Kinds, Service
from tests.campaign.machines import Machine, message
from tests.campaign.plans import NAMESPACE, Model, Spelling
from tests.campaign.values import Values, parts_of

SUCCESS, FAILURE, RUNNING = "0", "1", "2"


class Leaf(msgspec.Struct, frozen=True):
    """A leaf of the tree: its element, and whether it may be RUNNING."""

    element: Element
    is_action: bool


def condition(
    draw: Random, kinds: Kinds, number: int, uses: list[Channel], spelling: Spelling
) -> tuple[Machine, Leaf]:
    """A condition: it answers by its data, or asks a service first."""
    skill = _Skill(draw, kinds, f"Ready{number}", "Condition" * (spelling is Spelling.PLAIN))
    skill.condition(uses)
    return skill.machine, skill.leaf("Condition")


def action(
    draw: Random, kinds: Kinds, number: int, uses: list[Channel], spelling: Spelling
) -> tuple[Machine, Leaf]:
    """An action: it is RUNNING for some ticks, and can be halted."""
    skill = _Skill(draw, kinds, f"Do{number}", "Action" * (spelling is Spelling.PLAIN))
    skill.action(uses)
    return skill.machine, skill.leaf("Action")


class _Skill:
    def __init__(self, draw: Random, kinds: Kinds, name: str, suffix: str) -> None:
        self.draw = draw
        self.name = name
        self.machine = Machine(draw, kinds, name + suffix)
        self.machine.hidden("asked", BOOL, "false")

    def leaf(self, tag: str) -> Leaf:
        """How a tree addresses it: by its service, or by its name."""
        is_action = tag == "Action"
        service = f"/{self.name}/tick"
        halt = f"/{self.name}/halt" if is_action else None
        head = {"name": self.name, "service_name": service}
        if self.draw.random() < 0.3 and is_action:
            head = {"name": self.name, "service_name_tick": service}
            return Leaf(e("Action", ID="ROS2Action", **head, service_name_halt=halt), True)
        return Leaf(e(tag, ID=f"ROS2{tag}", **head), is_action)

    def _serve(self, what: str, service: Service) -> tuple[str, int]:
        channel = f"/{self.name}/{what}"
        name = self.machine.declare("ros_service_server", channel, service.name, "service_name")
        number = self.machine.on("ros_service_handle_request", 0, name=name, always=True)
        return name, number

    def _answer(self, name: str, status: str) -> Element:
        fields = (
            e("field", name="status", expr=status),
            e("field", name="is_ok", expr=self.draw.choice(("true", "on"))),
        )
        return e("ros_service_send_response", *fields, name=name)

    def condition(self, uses: list[Channel]) -> None:
        """Its triggers and outputs."""
        name, tick = self._serve("tick", CONDITION)
        services = [item for item in uses if item.kind == "service"]
        for other in uses:
            if other.kind == "service":
                continue
            use(self.machine, other, tick)
        if services and self.draw.random() < 0.5:
            self._asks(services[0], tick, lambda status: self._answer(name, status))
        else:
            self.machine.must(
                tick, lambda values: [self._answer(name, f"{values.condition()} ? 0 : 1")]
            )

    def _asks(self, channel: Channel, tick: int, answer: Callable[[str], Element]) -> None:
        """Each tick is a call; its answer answers the tick."""
        service = channel.service
        assert service is not None
        name = self.machine.declare(
            "ros_service_client", channel.name, service.name, "service_name"
        )

        def ask(values: Values) -> list[Element]:
            return [e("ros_service_send_request", *message(values, service.request), name=name)]

        self.machine.must(tick, ask)
        readable = parts_of("_res", service.response)
        response = self.machine.on(
            "ros_service_handle_response", channel.depth, readable, always=True, name=name
        )
        field = service.response.fields[0][0]
        self.machine.must(response, lambda _: [answer(f"_res.{field} > 0 ? 0 : 1")])
        error = self.machine.on("ros_service_handle_error", channel.depth, always=True, name=name)
        self.machine.must(error, lambda _: [answer(FAILURE)])

    def action(self, uses: list[Channel]) -> None:
        """Its triggers and outputs."""
        machine = self.machine
        name, tick = self._serve("tick", ACTION)
        halt_name, halt = self._serve("halt", HALT)
        machine.hidden("left", INT32, "0")
        for other in uses:
            if other.kind == "service":
                call(machine, other)
            else:
                use(machine, other, tick)
        steps = self.draw.randint(1, 8)

        def set_left(value: str) -> Element:
            return e("assign", location="left", expr=value)

        def step(values: Values) -> list[Element]:
            status = f"{values.condition()} || a > 1 ? {SUCCESS} : {FAILURE}"
            return [
                e(
                    "if",
                    set_left(str(steps)),
                    self._answer(name, RUNNING),
                    e("elseif", cond="left > 1"),
                    set_left("left - 1"),
                    self._answer(name, RUNNING),
                    e("else"),
                    set_left("0"),
                    self._answer(name, status),
                    cond="left == 0",
                )
            ]

        machine.must(tick, step)
        ok = e("field", name="is_ok", expr="true")
        halted = [set_left("0"), e("ros_service_send_response", ok, name=halt_name)]
        machine.must(halt, lambda _: halted)


# -- plugins ----------------------------------------------------------------------------------------


def plugin(draw: Random, number: int) -> tuple[Model, Leaf]:
    """A plugin with ports: a condition, or an action that is RUNNING for some ticks."""
    name = f"Look{number}"
    status = e("bt_return_status", status="SUCCESS")
    read = e("assign", e("expr", e("bt_get_input", key="level")), location="level")
    write = e("bt_set_output", key="out", expr="level % 5 + 1")
    ports = (
        e("bt_declare_port_in", key="level", type="int32"),
        e("bt_declare_port_out", key="out", type="int32"),
    )
    data = [
        e("data", id="level", type="int32", expr="0"),
        e("data", id="left", type="int32", expr=str(draw.randint(0, 2))),
        e("data", id="status", type="string", expr="'SUCCESS'"),
    ]
    is_action = draw.random() < 0.5
    by_data = e("bt_return_status", status="status")
    fail = e("if", e("assign", location="status", expr="'FAILURE'"), e("else"),
             e("assign", location="status", expr="'SUCCESS'"), cond="level % 3 == 0")  # fmt: skip
    states: tuple[Element, ...]
    if not is_action:
        states = (e("state", e("bt_tick", read, write, fail, by_data), id="idle"),)
    else:
        go = e("bt_tick", read, write, e("bt_return_status", status="RUNNING"), target="busy")
        always = draw.choice((None, "left > -9"))
        halt = e("bt_halt", e("bt_return_halted"), target="idle", cond=always)
        done = e("bt_tick", draw.choice((status, by_data)), target="idle")
        more = e(
            "bt_tick",
            e("assign", location="left", expr="left - 1"),
            e("bt_return_status", status="RUNNING"),
            cond="left > 0",
        )
        states = (e("state", go, id="idle"), e("state", more, done, halt, id="busy"))
    root = _plugin(name, "idle", *ports, e("datamodel", *data), *states)
    value = draw.choice(("3", "{level}"))
    tag = "Action" if is_action else "Condition"
    leaf = e(tag, ID=name, level=value, out=draw.choice(("{level}", "{other}")))
    return Model(name, root, Spelling.ASCXML, True), Leaf(leaf, is_action)


def decorator(draw: Random, number: int) -> Model:
    """A plugin with one child: it turns the child's answer round, or ticks it again."""
    name = f"Wrap{number}"
    running = e("bt_return_status", status="RUNNING")
    again = draw.random() < 0.5
    failed = e(
        "bt_child_status",
        *((e("bt_tick_child", id=0),) if again else (e("bt_return_status", status="SUCCESS"),)),
        id=0,
        cond="_bt.status == 'FAILURE'" + " && count < 2" * again,
        target="ticking" if again else "idle",
    )
    count = e("assign", location="count", expr="count + 1")
    failed = failed.holding(count, *failed.children)
    answered = [
        e("bt_child_status", running, id=0, cond="_bt.status == 'RUNNING'", target="running"),
        failed,
        e("bt_child_status", e("bt_return_status", status="SUCCESS" if again else "FAILURE"),
          id=0, target="idle"),
    ]  # fmt: skip
    tick = e("bt_tick", e("bt_tick_child", id=0), target="ticking")
    fresh = e("bt_tick", e("assign", location="count", expr="0"), e("bt_tick_child", id=0),
              target="ticking")  # fmt: skip
    halt = e("bt_halt", e("bt_halt_child", id=0), target="halting")
    always = draw.choice((None, "count < 99"))
    halted = e("bt_child_halted", e("bt_return_halted"), id=0, target="idle", cond=always)
    states = (
        e("state", fresh, id="idle"),
        e("state", *answered, id="ticking"),
        e("state", tick, halt, id="running"),
        e("state", halted, id="halting"),
    )
    data = e("datamodel", e("data", id="count", type="int32", expr="0"))
    return Model(name, _plugin(name, "idle", data, *states), Spelling.ASCXML, True)


def _plugin(name: str, initial: str, *parts: Element) -> Element:
    return e("scxml", *parts, xmlns=NAMESPACE, version="1.0", name=name, initial=initial)
