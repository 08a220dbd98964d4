"""Every element of the language: its attributes, where it may stand, and what it is lowered to."""

from __future__ import annotations

import msgspec

from m2c.model.machine import EventKind, InterfaceKind, OutputKind


class Handler(msgspec.Struct, frozen=True):
    """An element that is a transition on something the middleware or the tree delivers."""

    event: EventKind
    interface: InterfaceKind | None


class Output(msgspec.Struct, frozen=True):
    """An element of executable content that sends something."""

    kind: OutputKind
    interface: InterfaceKind | None


K = InterfaceKind
HANDLERS: dict[str, Handler] = {
    "ros_topic_callback": Handler(EventKind.MESSAGE, K.SUBSCRIBER),
    "ros_service_handle_request": Handler(EventKind.REQUEST, K.SERVER),
    "ros_service_handle_response": Handler(EventKind.RESPONSE, K.CLIENT),
    "ros_service_handle_error": Handler(EventKind.CALL_ERROR, K.CLIENT),
    "ros_action_handle_goal": Handler(EventKind.GOAL, K.ACTION_SERVER),
    "ros_action_handle_cancel": Handler(EventKind.CANCEL, K.ACTION_SERVER),
    "ros_action_handle_thread_start": Handler(EventKind.THREAD_START, K.ACTION_SERVER),
    "ros_action_handle_thread_free": Handler(EventKind.THREAD_FREE, K.ACTION_SERVER),
    "ros_action_handle_feedback": Handler(EventKind.FEEDBACK, K.ACTION_CLIENT),
    "ros_action_handle_success_result": Handler(EventKind.SUCCEEDED, K.ACTION_CLIENT),
    "ros_action_handle_aborted_result": Handler(EventKind.ABORTED, K.ACTION_CLIENT),
    "ros_action_handle_canceled_result": Handler(EventKind.CANCELED, K.ACTION_CLIENT),
    "ros_action_handle_error": Handler(EventKind.GOAL_FAILED, K.ACTION_CLIENT),
    "ros_rate_callback": Handler(EventKind.TIMER, K.TIMER),
    "bt_tick": Handler(EventKind.BT_TICK, None),
    "bt_halt": Handler(EventKind.BT_HALT, None),
    "bt_child_status": Handler(EventKind.BT_CHILD_STATUS, None),
    "bt_child_halted": Handler(EventKind.BT_CHILD_HALTED, None),
}

OUTPUTS: dict[str, Output] = {
    "ros_topic_publish": Output(OutputKind.PUBLISH, K.PUBLISHER),
    "ros_service_send_request": Output(OutputKind.REQUEST, K.CLIENT),
    "ros_service_send_response": Output(OutputKind.RESPONSE, K.SERVER),
    "ros_action_send_goal": Output(OutputKind.SEND_GOAL, K.ACTION_CLIENT),
    "ros_action_send_cancel": Output(OutputKind.SEND_CANCEL, K.ACTION_CLIENT),
    "ros_action_accept_goal": Output(OutputKind.ACCEPT_GOAL, K.ACTION_SERVER),
    "ros_action_reject_goal": Output(OutputKind.REJECT_GOAL, K.ACTION_SERVER),
    "ros_action_feedback": Output(OutputKind.FEEDBACK, K.ACTION_SERVER),
    "ros_action_succeed": Output(OutputKind.SUCCEED, K.ACTION_SERVER),
    "ros_action_aborted": Output(OutputKind.ABORT, K.ACTION_SERVER),
    "ros_action_canceled": Output(OutputKind.CANCEL, K.ACTION_SERVER),
    "ros_action_start_thread": Output(OutputKind.START_THREAD, K.ACTION_SERVER),
    "ros_action_thread_free": Output(OutputKind.THREAD_FREE, K.ACTION_SERVER),
    "bt_return_status": Output(OutputKind.BT_RETURN_STATUS, None),
    "bt_return_halted": Output(OutputKind.BT_RETURN_HALTED, None),
    "bt_set_output": Output(OutputKind.BT_SET_OUTPUT, None),
    "bt_tick_child": Output(OutputKind.BT_TICK_CHILD, None),
    "bt_halt_child": Output(OutputKind.BT_HALT_CHILD, None),
}

DECLARATIONS: dict[str, tuple[InterfaceKind, str, str]] = {
    "ros_topic_publisher": (K.PUBLISHER, "topic", "msg"),
    "ros_topic_subscriber": (K.SUBSCRIBER, "topic", "msg"),
    "ros_service_server": (K.SERVER, "service_name", "srv"),
    "ros_service_client": (K.CLIENT, "service_name", "srv"),
    "ros_action_server": (K.ACTION_SERVER, "action_name", "action"),
    "ros_action_client": (K.ACTION_CLIENT, "action_name", "action"),
}
"""Interface declarations: kind, the attribute (or child) that gives the channel, type folder."""

STATEMENTS = frozenset({"assign", "if", "foreach", "log", "raise", "send", "cancel"})
EXECUTABLE = STATEMENTS | OUTPUTS.keys()

_NAME = frozenset({"name"})
_HANDLER = frozenset({"name", "target", "cond", "type"})
ATTRIBUTES: dict[str, frozenset[str]] = {
    "scxml": frozenset(
        {"initial", "version", "name", "datamodel", "model_src", "binding", "xmlns", "exmode"}
    ),
    "datamodel": frozenset(),
    "data": frozenset({"id", "type", "expr", "lower_bound_incl", "upper_bound_incl"}),
    "expr": frozenset(),
    "state": frozenset({"id", "initial"}),
    "final": frozenset({"id"}),
    "initial": frozenset(),
    "history": frozenset({"id", "type"}),
    "donedata": frozenset(),
    "onentry": frozenset(),
    "onexit": frozenset(),
    "transition": frozenset({"event", "cond", "target", "after", "type"}),
    "target": frozenset({"id", "prob"}),
    "assign": frozenset({"location", "expr"}),
    "if": frozenset({"cond"}),
    "elseif": frozenset({"cond"}),
    "else": frozenset(),
    "foreach": frozenset({"array", "item", "index"}),
    "send": frozenset({"event", "target", "delay", "delayexpr", "id", "namelist", "type"}),
    "cancel": frozenset({"sendid"}),
    "param": frozenset({"name", "expr", "location"}),
    "field": frozenset({"name", "expr"}),
    "raise": frozenset({"event"}),
    "log": frozenset({"label", "expr"}),
    "ros_time_rate": frozenset({"name", "rate_hz"}),
    "ros_action_thread": frozenset({"name", "n_threads", "initial"}),
    "ros_action_handle_goal_response": frozenset({"name", "accept", "reject"}),
    "bt_declare_port_in": frozenset({"key", "type"}),
    "bt_declare_port_out": frozenset({"key", "type"}),
    "bt_get_input": frozenset({"key"}),
    **dict.fromkeys(HANDLERS, _HANDLER),
    **dict.fromkeys(("bt_tick", "bt_halt"), frozenset({"target", "cond", "type"})),
    **dict.fromkeys(("bt_child_status", "bt_child_halted"), _HANDLER - {"name"} | {"id"}),
    **dict.fromkeys(OUTPUTS, _NAME),
    **dict.fromkeys(
        (
            *("ros_action_accept_goal", "ros_action_reject_goal", "ros_action_feedback"),
            *("ros_action_succeed", "ros_action_aborted", "ros_action_canceled"),
            "ros_action_send_cancel",
        ),
        frozenset({"name", "goal_id"}),
    ),
    "ros_action_start_thread": frozenset({"name", "goal_id", "thread_id"}),
    "ros_action_thread_free": frozenset({"name", "goal_id", "thread_id"}),
    "bt_return_status": frozenset({"status"}),
    "bt_return_halted": frozenset(),
    "bt_set_output": frozenset({"key", "expr"}),
    "bt_tick_child": frozenset({"id"}),
    "bt_halt_child": frozenset({"id"}),
    **{
        tag: frozenset({"name", "type", channel, channel.removesuffix("_name")})
        for tag, (_, channel, _) in DECLARATIONS.items()
    },
}
"""Attributes that an element may have. ``topic``/``service``/``action`` also stand for ``…_name``."""

UNSUPPORTED: dict[str, str] = {
    "parallel": "parallel states are not part of the language; use one machine per activity",
    "script": "scripts are not part of the language; use <assign> and <if>",
    "invoke": "invoked machines are not part of the language; use a service or an action",
    "finalize": "invoked machines are not part of the language",
    "content": "inline content is not part of the language; use <param>",
}
"""Elements of SCXML that are refused, with what to do instead."""

EVENT_PROCESSORS = frozenset({"", "scxml", "http://www.w3.org/TR/scxml/#SCXMLEventProcessor"})
"""The ``type`` of a ``<send>``: from machine to machine, which is the default (W3C SCXML 6.2.4)."""

MISPLACED: dict[str, str] = {
    "history": "it stands in a compound state, of which it remembers the last state",
    "initial": "it stands in a compound state; a machine has the attribute `initial`",
    "donedata": "it stands in the final state of a compound state",
}
"""Where elements belong that people put elsewhere."""

ROOT_CHILDREN = frozenset(
    {"datamodel", "state", "final", "ros_time_rate", "ros_action_thread"}
    | DECLARATIONS.keys()
    | {"bt_declare_port_in", "bt_declare_port_out"}
)
FINAL_CHILDREN = frozenset({"onentry", "onexit", "donedata"})
TRANSITIONS = frozenset({"transition", "ros_action_handle_goal_response"} | HANDLERS.keys())
STATE_CHILDREN = TRANSITIONS | {
    *("onentry", "onexit", "datamodel"),
    *("state", "final", "initial", "history"),
}
