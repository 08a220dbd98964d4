"""What a machine sends: the ``Outputs`` protocol of ``machine.py``, and its words."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from m2c.codegen.layout import INDENT, call
from m2c.codegen.ports import OutputPort, PortNames
from m2c.model.machine import Machine, OutputKind


class ExtraOutput(msgspec.Struct, frozen=True):
    """An output that is not a message: its parameters, and the binding's method that does it."""

    doc: str
    parameters: tuple[str, ...]
    method: str
    arguments: tuple[str, ...]


EXTRA_OUTPUTS = {
    "start_delay": ExtraOutput(
        "Start the delay of a transition.",
        ("name: str", "delay_s: float"),
        "start_delay",
        ("name", "delay_s", "self.machine.on_elapsed"),
    ),
    "stop_delay": ExtraOutput(
        "Cancel the delay of a transition.", ("name: str",), "stop_delay", ("name",)
    ),
    "send_self": ExtraOutput(
        "Send an event to the machine itself.",
        ("event: str", "data: Any", "delay_s: float", "send_id: str"),
        "send_self",
        ("event", "data", "delay_s", "send_id", "self.machine.on_event"),
    ),
    "cancel_send": ExtraOutput(
        "Cancel a delayed send.", ("send_id: str",), "cancel_send", ("send_id",)
    ),
    "log": ExtraOutput(
        "Write a line to the node's log.",
        ("label: str", "text: str"),
        "say",
        ("label", "text"),
    ),
}
"""By the name of the method."""


def output_protocol(
    machine: Machine,
    emits: Sequence[tuple[OutputKind, str]],
    extra: Sequence[str],
    names: PortNames,
    class_of: dict[str, str],
) -> list[str]:
    """The class ``Outputs``: a method per output in ``emits``, and the ``extra`` ones."""
    lines = ["class Outputs(Protocol):", f'{INDENT}"""What ``{machine.name}`` sends."""']
    for kind, name in emits:
        port = names.output(kind, name)
        doc = output_doc(kind, names.channel(name, kind))
        lines += _method(port.method, parameters(port, class_of), doc)
    for method in extra:
        lines += _method(
            method, ["self", *EXTRA_OUTPUTS[method].parameters], EXTRA_OUTPUTS[method].doc
        )
    return lines


def _method(name: str, accepted: Sequence[str], doc: str) -> list[str]:
    return ["", *call(f"def {name}", accepted, 1, " -> None:"), f'{INDENT * 2}"""{doc}"""']


def parameters(port: OutputPort, class_of: dict[str, str]) -> list[str]:
    """The parameters of the method of ``port``, typed."""
    accepted = ["self", *(f"{name}: {kind}" for name, kind in port.parameters)]
    if port.data is not None:
        accepted.append(f"{port.data_name}: {class_of[port.data.name]}")
    return accepted


def output_doc(kind: OutputKind, channel: str) -> str:
    """A line on what an output of ``kind`` does on ``channel``."""
    where = f" ``{channel}``" if channel else ""
    return {
        OutputKind.PUBLISH: f"Publish on{where}.",
        OutputKind.REQUEST: f"Call{where}; the response is an event.",
        OutputKind.RESPONSE: f"Answer a request to{where}.",
        OutputKind.SEND_GOAL: f"Send a goal to{where}.",
        OutputKind.SEND_CANCEL: f"Ask{where} to cancel a goal.",
        OutputKind.ACCEPT_GOAL: f"Accept a goal of{where}.",
        OutputKind.REJECT_GOAL: f"Reject a goal of{where}.",
        OutputKind.FEEDBACK: f"Send feedback of{where}.",
        OutputKind.SUCCEED: f"End a goal of{where}: succeeded.",
        OutputKind.ABORT: f"End a goal of{where}: aborted.",
        OutputKind.CANCEL: f"End a goal of{where}: canceled.",
        OutputKind.START_THREAD: f"Have a thread of{where} execute a goal.",
        OutputKind.THREAD_FREE: f"A thread of{where} is free again.",
        OutputKind.BT_RETURN_STATUS: "Return a status to the behaviour tree.",
        OutputKind.BT_RETURN_HALTED: "Tell the behaviour tree that this node is halted.",
        OutputKind.BT_SET_OUTPUT: "Set an output port.",
        OutputKind.BT_TICK_CHILD: "Tick a child.",
        OutputKind.BT_HALT_CHILD: "Halt a child.",
    }[kind]
