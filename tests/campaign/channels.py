"""The ends of channels, as parts of a machine: topics, services, actions, plain events."""

from __future__ import annotations

from random import Random

import msgspec

from tests.campaign.elements import Element, e
from tests.campaign.kinds import INT32, INT64, STRING, ActionType, Kind, Service, array
from tests.campaign.machines import Machine, message
from tests.campaign.values import Values, parts_of
from tests.campaign.weights import happens


class Channel(msgspec.Struct, frozen=True):
    """What machines talk over.

    Attributes:
        kind: topic, service, action or event.
        owner: who publishes, serves or sends.
        depth: see ``tests.campaign.machines``.
    """

    name: str
    kind: str
    owner: str
    depth: int
    message: Kind | None = None
    service: Service | None = None
    action: ActionType | None = None


def offer(machine: Machine, channel: Channel, beat: int) -> None:
    """The owner's end; ``beat`` is a timer of the machine."""
    match channel.kind:
        case "topic":
            _publish(machine, channel)
        case "service":
            _serve(machine, channel, beat)
        case "action":
            _work(machine, channel, beat)
        case _:
            _send(machine, channel)


def use(machine: Machine, channel: Channel, beat: int) -> None:
    """The other end."""
    match channel.kind:
        case "topic":
            _subscribe(machine, channel)
        case "service":
            call(machine, channel)
        case "action":
            _order(machine, channel, beat)
        case _:
            _take(machine, channel)


# -- topics and events ------------------------------------------------------------------------------


def _publish(machine: Machine, channel: Channel) -> None:
    kind = channel.message
    assert kind is not None
    name = machine.declare("ros_topic_publisher", channel.name, kind.name, "topic")
    machine.may(
        channel.depth,
        lambda values: [e("ros_topic_publish", *message(values, kind), name=name)],
    )


def _subscribe(machine: Machine, channel: Channel) -> None:
    kind = channel.message
    assert kind is not None
    name = machine.declare("ros_topic_subscriber", channel.name, kind.name, "topic")
    machine.on("ros_topic_callback", channel.depth, parts_of("_msg", kind), name=name)


EVENT = Kind("", (("number", INT32), ("word", STRING), ("numbers", array(INT32))))
"""What a plain event carries: each is a variable of its sender."""


def _send(machine: Machine, channel: Channel) -> None:
    params = [
        e("param", name="number", expr="a"),
        e("param", name="word", location="word"),
        e("param", name="numbers", expr="numbers"),
    ]
    machine.may(channel.depth, lambda _: [e("send", *params, event=channel.name)])


def _take(machine: Machine, channel: Channel) -> None:
    readable = parts_of("_event.data", EVENT)
    machine.on("transition", channel.depth, readable, event=channel.name)


# -- services ---------------------------------------------------------------------------------------


def _serve(machine: Machine, channel: Channel, beat: int) -> None:
    """It answers at once, or at a later beat; several callers may wait then."""
    service = channel.service
    assert service is not None
    name = machine.declare("ros_service_server", channel.name, service.name, "service_name")
    readable = parts_of("_req", service.request)
    request = machine.on("ros_service_handle_request", channel.depth, readable, name=name)

    def answer(values: Values) -> list[Element]:
        fields = message(values, service.response)
        return [e("ros_service_send_response", *fields, name=name)]

    if not happens(machine.draw, "deferred answer"):
        machine.must(request, answer)
        return
    waiting = f"waiting_{channel.depth}"
    machine.hidden(waiting, INT32, "0")
    machine.must(request, lambda _: [_set(waiting, f"{waiting} + 1")])
    machine.must(
        beat,
        lambda values: [
            e("if", *answer(values), _set(waiting, f"{waiting} - 1"), cond=f"{waiting} > 0")
        ],
    )


def call(machine: Machine, channel: Channel) -> None:
    """It calls ``channel``, and handles answers and failures."""
    service = channel.service
    assert service is not None
    name = machine.declare("ros_service_client", channel.name, service.name, "service_name")
    machine.may(
        channel.depth,
        lambda values: [
            e("ros_service_send_request", *message(values, service.request), name=name)
        ],
    )
    readable = parts_of("_res", service.response)
    machine.on("ros_service_handle_response", channel.depth, readable, name=name)
    machine.on("ros_service_handle_error", channel.depth, name=name)


def _set(location: str, value: str) -> Element:
    return e("assign", location=location, expr=value)


# -- actions ----------------------------------------------------------------------------------------

FREE = "free"


def _work(machine: Machine, channel: Channel, beat: int) -> None:
    action = channel.action
    assert action is not None
    name = machine.declare("ros_action_server", channel.name, action.name, "action_name")
    server = _Server(machine, name, action, channel.depth)
    if happens(machine.draw, "threads"):
        server.in_threads(machine.draw.randint(1, 2))
    else:
        server.alone(beat)


class _Server:
    """The server's end: it has as many goals at once as it has threads, or one."""

    def __init__(self, machine: Machine, name: str, action: ActionType, depth: int) -> None:
        self.machine = machine
        self.draw: Random = machine.draw
        self.name = name
        self.action = action
        self.depth = depth
        self.goal_number = (("_action.goal_id", INT64),)
        self.of_goal = (*parts_of("_goal", action.goal), *self.goal_number)

    def _end(self, values: Values, tag: str, goal: str) -> Element:
        return e(tag, *message(values, self.action.result), name=self.name, goal_id=goal)

    def _feedback(self, values: Values, goal: str) -> Element:
        fields = message(values, self.action.feedback)
        return e("ros_action_feedback", *fields, name=self.name, goal_id=goal)

    def _ending(self, values: Values, goal: str) -> list[Element]:
        """It succeeds, or is aborted, as data says."""
        good, bad = (self._end(values, f"ros_action_{how}", goal) for how in ("succeed", "aborted"))
        return [e("if", good, e("else"), bad, cond=f"{values.condition()} || on")]

    def _on_goal(self, free: str, accept: list[Element]) -> None:
        number = self.machine.on(
            "ros_action_handle_goal",
            self.depth,
            self.of_goal,
            name=self.name,
        )
        goal_id = self.draw.choice(("_action.goal_id", "_event.goal_id"))
        reject = e("ros_action_reject_goal", name=self.name, goal_id=goal_id)
        self.machine.must(number, lambda _: [e("if", *accept, e("else"), reject, cond=free)])

    def alone(self, beat: int) -> None:
        """The machine itself executes a goal, step by step at each beat; it may accept it late."""
        machine, name = self.machine, self.name
        goal, left = f"goal_{self.depth}", f"left_{self.depth}"
        machine.hidden(goal, INT64, "0")
        machine.hidden(left, INT32, "0")
        steps = self.draw.randint(1, 4)
        accept = e("ros_action_accept_goal", name=name, goal_id=goal)
        late = self.draw.random() < 0.3
        taken = [_set(goal, "_action.goal_id"), _set(left, str(steps + late))]
        self._on_goal(f"{goal} == 0", [*taken, *([] if late else [accept])])

        def step(values: Values) -> list[Element]:
            down = _set(left, f"{left} - 1")
            working = [self._feedback(values, goal), down]
            ended = [*self._ending(values, goal), _set(goal, "0")]
            go_on: list[Element] = []
            if late:
                go_on = [accept, down, e("elseif", cond=f"{left} > 0")]
            first = f"{left} > {steps}" if late else f"{left} > 0"
            inner = e("if", *go_on, *working, e("else"), *ended, cond=first)
            return [e("if", inner, cond=f"{goal} != 0")]

        machine.must(beat, step)
        if self.draw.random() < 0.8:
            number = machine.on(
                "ros_action_handle_cancel",
                self.depth,
                self.goal_number,
                name=name,
                cond=f"_action.goal_id == {goal} && {left} <= {steps}",
            )
            machine.must(
                number,
                lambda values: [self._end(values, "ros_action_canceled", goal), _set(goal, "0")],
            )

    def in_threads(self, count: int) -> None:
        """Threads execute the goals."""
        machine, name = self.machine, self.name
        for number in range(count):
            machine.hidden(f"busy_{number}", INT32, "0")
        starts: list[Element] = []
        accept = e("ros_action_accept_goal", name=name, goal_id="_action.goal_id")
        goal = self.action.goal.fields[0][0]
        for number in range(count):
            start = e(
                "ros_action_start_thread",
                e("field", name=goal, expr=f"_goal.{goal}"),
                name=name,
                thread_id=number,
                goal_id="_action.goal_id",
            )
            if number:
                starts.append(e("elseif", cond=f"busy_{number} == 0"))
            starts += [accept, _set(f"busy_{number}", "1"), start]
        free = e("if", *starts, cond="busy_0 == 0")
        some = " || ".join(f"busy_{number} == 0" for number in range(count))
        self._on_goal(some, [free])
        freed = machine.on(
            "ros_action_handle_thread_free", self.depth, (("_event.thread_id", INT64),), name=name
        )
        thread_id = self.draw.choice(("_event.thread_id", "_event.data.thread_id"))
        sets = [_set("busy_0", "0")]
        if count == 2:
            sets = [
                e("if", *sets, e("else"), _set("busy_1", "0"), cond=f"{thread_id} == 0"),
            ]
        machine.must(freed, lambda _: sets)
        machine.timer(f"work_{self.depth}", self.draw.choice((3, 5)))
        machine.threads.append(self._thread(count))

    def _thread(self, count: int) -> Element:
        machine, name, draw = self.machine, self.name, self.draw
        values = Values(draw, (("steps", INT32), ("amount", INT32)), machine.draws)
        field = self.action.goal.fields[0][0]
        amount = self.action.goal.fields[0][1]
        data = e(
            "datamodel",
            e("data", id="goal", type="int64", expr="0"),
            e("data", id="steps", type="int32", expr="0"),
            e("data", id="amount", type=amount.name, expr="0"),
            e("data", id="on", type="bool", expr=draw.choice(("true", "false"))),
        )
        number = draw.choice((None, "0"))
        done = e("ros_action_thread_free", name=name, goal_id="goal", thread_id=number)
        start = e(
            "ros_action_handle_thread_start",
            _set("goal", "_action.goal_id"),
            _set("amount", f"_goal.{field}"),
            _set("steps", str(draw.randint(1, 4))),
            name=name,
            cond=draw.choice((None, f"_goal.{field} >= -1 || steps < 9")),
            target="working",
        )
        step = e(
            "ros_rate_callback",
            _set("steps", "steps - 1"),
            self._feedback(values, "goal"),
            name=f"work_{self.depth}",
            cond="steps > 0",
            target=draw.choice(("working", None)),
        )
        ending = [*self._ending(values, "goal"), done]
        last = e("ros_rate_callback", *ending, name=f"work_{self.depth}", target=FREE)
        canceled = e(
            "ros_action_handle_cancel",
            self._end(values, "ros_action_canceled", "goal"),
            done,
            name=name,
            cond="_action.goal_id == goal",
            target=FREE,
        )
        working = [step, last, *([canceled] if draw.random() < 0.8 else [])]
        if draw.random() < 0.3:
            aborted = self._end(values, "ros_action_aborted", "goal")
            working.append(e("transition", aborted, done, after="900ms", target=FREE))
        states = (e("state", start, id=FREE), e("state", *working, id="working"))
        return e("ros_action_thread", data, *states, name=name, n_threads=count, initial=FREE)


def _order(machine: Machine, channel: Channel, beat: int) -> None:
    """The client's end: one goal at a time by its own count; it cancels the last, or a certain one."""
    action, draw = channel.action, machine.draw
    assert action is not None
    name = machine.declare("ros_action_client", channel.name, action.name, "action_name")
    pending, last = f"pending_{channel.depth}", f"sent_{channel.depth}"
    machine.hidden(pending, INT32, "0")
    machine.hidden(last, INT64, "0")

    def send(values: Values) -> list[Element]:
        goal = e("ros_action_send_goal", *message(values, action.goal), name=name)
        counted = [goal, _set(last, f"{last} + 1"), _set(pending, "12")]
        return [e("if", *counted, cond=f"{pending} <= 0")]

    machine.may(channel.depth, send)
    machine.must(beat, lambda _: [e("if", _set(pending, f"{pending} - 1"), cond=f"{pending} > 0")])
    if draw.random() < 0.6:
        which = draw.choice((None, last, f"{last} - 1"))
        cancel = e("ros_action_send_cancel", name=name, goal_id=which)
        cond = f"{pending} == {draw.randint(5, 11)}"
        machine.must(beat, lambda _: [e("if", cancel, cond=cond)])
    number = (("_event.goal_id", INT64),)
    machine.on("ros_action_handle_goal_response", channel.depth, number, name=name)
    feedback = (*parts_of("_feedback", action.feedback), *number)
    machine.on("ros_action_handle_feedback", channel.depth, feedback, name=name)
    result = (
        *parts_of("_wrapped_result.result", action.result),
        ("_wrapped_result.code", INT32),
        *number,
    )
    for how in ("success", "aborted", "canceled"):
        ended = machine.on(f"ros_action_handle_{how}_result", channel.depth, result, name=name)
        machine.must(ended, lambda _: [_set(pending, "0")])
    if happens(draw, "handles lost goals"):
        lost = machine.on("ros_action_handle_error", channel.depth, number, name=name)
        machine.must(lost, lambda _: [_set(pending, "0")])
