"""``Machine``: one deliberation component or skill, whichever dialect it was written in.

The readers lower every tag to three notions, so that checks, code generator and oracle know no
tags: an :class:`Event` starts a :class:`Transition`, whose :class:`Statement` list may
:class:`Emit` outputs on declared interfaces. Semantics: SCXML run-to-completion (W3C SCXML,
section 3.13 and appendix D). Compound states and history are lowered once, into flat machines
(:mod:`m2c.model.nesting`), which are all that checks, code generator and oracle know.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec

from m2c.diagnostics import Position
from m2c.language.datatypes import DataType
from m2c.language.expressions import Expression, Location


class Dialect(StrEnum):
    """The three dialects of the language in use."""

    HL_SCXML = "hl-scxml"
    ASCXML = "ascxml"
    SCXML = "scxml"


class InterfaceKind(StrEnum):
    """What a machine declares towards the middleware."""

    PUBLISHER = "publisher"
    SUBSCRIBER = "subscriber"
    SERVER = "server"
    CLIENT = "client"
    ACTION_SERVER = "action_server"
    ACTION_CLIENT = "action_client"
    TIMER = "timer"

    @property
    def noun(self) -> str:
        """As messages say it: ``action client``."""
        return self.value.replace("_", " ")


CHANNEL_KINDS = {
    InterfaceKind.PUBLISHER: "topic",
    InterfaceKind.SUBSCRIBER: "topic",
    InterfaceKind.SERVER: "service",
    InterfaceKind.CLIENT: "service",
    InterfaceKind.ACTION_SERVER: "action",
    InterfaceKind.ACTION_CLIENT: "action",
}
"""What a channel is: topics, services and actions have names of their own, ``/x`` may be one of each."""


class Interface(msgspec.Struct, frozen=True, kw_only=True):
    """One declared end of a channel (or a timer).

    Attributes:
        name: what the model calls it (``name=``, or the channel where none is given). Events and
            outputs refer to this name, which is unique within one ``kind`` of a machine.
        channel: absolute channel name; None where ``port`` gives it at run time; the timer's name.
        type_name: canonical ``pkg/msg/Name``, ``pkg/srv/Name`` or ``pkg/action/Name``; "" for timers.
        port: the BT input port whose value is the channel, or the timer's rate (``<bt_get_input key=…/>``).
        rate_hz: timers only; 0 where ``port`` gives it.
        best_effort, transient_local: topics only: messages may be dropped; who comes late gets the last one.
        event: topics only: the plain event that travels on it; "" for a topic that the model declares.
        target: of a plain event that is sent to one machine alone: that machine's name.
        own: subscribers only: no other machine publishes this event; the machine takes what it publishes from
            its own queue, in the order in which it sends, and nothing from the channel.
    """

    kind: InterfaceKind
    name: str
    position: Position
    channel: str | None = None
    type_name: str = ""
    port: str | None = None
    rate_hz: float = 0.0
    best_effort: bool = False
    transient_local: bool = False
    event: str = ""
    target: str = ""
    own: bool = False


class EventKind(StrEnum):
    """What can happen to a machine. ``Event.name`` is the interface's name unless said otherwise."""

    INTERNAL = "internal"  # raised or sent by the machine itself (delayed sends too); name: event
    MESSAGE = "message"  # data: message
    REQUEST = "request"  # data: request, of a service that the machine serves
    RESPONSE = "response"  # data: response, to a call the machine made
    CALL_ERROR = "call_error"  # data: none; a call ended in remote error, timeout or unavailable
    GOAL = "goal"  # server; data: goal, goal_id
    CANCEL = "cancel"  # server; goal_id
    GOAL_ACCEPTED = "goal_accepted"  # client; goal_id
    GOAL_REJECTED = "goal_rejected"  # client; goal_id
    FEEDBACK = "feedback"  # client; data: feedback, goal_id
    SUCCEEDED = "succeeded"  # client; data: result, goal_id, code
    ABORTED = "aborted"  # client; data: result, goal_id, code
    CANCELED = "canceled"  # client; data: result, goal_id, code
    GOAL_FAILED = "goal_failed"  # client; goal_id; no answer, or its server ended; the goal is over
    THREAD_START = "thread_start"  # thread; data: goal fields, goal_id, thread_id
    THREAD_FREE = "thread_free"  # server; goal_id, thread_id
    TIMER = "timer"  # name: timer
    AFTER = "after"  # a delayed transition; name: "<state>#<index of the transition in it>"
    BT_TICK = "bt_tick"  # name: ""
    BT_HALT = "bt_halt"  # name: ""
    BT_CHILD_STATUS = "bt_child_status"  # name: the child's index; status
    BT_CHILD_HALTED = "bt_child_halted"  # name: the child's index


class Event(msgspec.Struct, frozen=True):
    """A trigger: what happened, on which interface (or the internal event's name)."""

    kind: EventKind
    name: str = ""


class OutputKind(StrEnum):
    """What a machine can send. ``Emit.interface`` names the interface unless said otherwise."""

    PUBLISH = "publish"
    REQUEST = "request"
    RESPONSE = "response"
    SEND_GOAL = "send_goal"
    SEND_CANCEL = "send_cancel"
    ACCEPT_GOAL = "accept_goal"
    REJECT_GOAL = "reject_goal"
    FEEDBACK = "feedback"
    SUCCEED = "succeed"
    ABORT = "abort"
    CANCEL = "cancel"
    START_THREAD = "start_thread"
    THREAD_FREE = "thread_free"
    BT_RETURN_STATUS = "bt_return_status"  # fields: status (a literal of STATUSES, or a variable)
    BT_RETURN_HALTED = "bt_return_halted"
    BT_SET_OUTPUT = "bt_set_output"  # interface: the port's key; fields: value
    BT_TICK_CHILD = "bt_tick_child"  # interface: the child's index
    BT_HALT_CHILD = "bt_halt_child"  # interface: the child's index


class Field(msgspec.Struct, frozen=True):
    """``<field name= expr=>`` or ``<param name= expr=>``; ``name`` may be a path ``a.b``."""

    name: str
    value: Expression
    position: Position


class Assign(msgspec.Struct, frozen=True, tag=True):
    """``location = value``."""

    location: Location
    value: Expression
    position: Position


class Emit(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """Send an output on an interface."""

    kind: OutputKind
    interface: str
    position: Position
    fields: tuple[Field, ...] = ()
    goal_id: Expression | None = None
    thread_id: Expression | None = None


class Raise(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """``<raise>``, or a ``<send>`` that goes to nobody else: queue an internal event.

    A raised event joins the internal queue; a sent one (``external``) the external queue, after
    ``delay_s`` seconds (an expression in seconds; None: at once), and can be cancelled by ``id``. It goes to
    the machine ``target``; "": to every machine that takes it.
    """

    event: str
    position: Position
    fields: tuple[Field, ...] = ()
    external: bool = False
    target: str = ""
    delay_s: Expression | None = None
    id: str = ""


class Cancel(msgspec.Struct, frozen=True, tag=True):
    """``<cancel sendid=>``."""

    id: str
    position: Position


class Log(msgspec.Struct, frozen=True, tag=True):
    """``<log label= expr=>``."""

    label: str
    value: Expression | None
    position: Position


class If(msgspec.Struct, frozen=True, tag=True):
    """``<if>/<elseif>/<else>``: the body of the first branch whose condition holds (None: else)."""

    branches: tuple[tuple[Expression | None, tuple[Statement, ...]], ...]
    position: Position


class Foreach(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """``<foreach>``: ``body`` for each element of a copy of ``array``, in order (W3C SCXML 4.6).

    The variable ``item`` holds the element, and ``index`` its place from 0; "" where nobody asks.
    """

    array: Expression
    item: str
    index: str = ""
    body: tuple[Statement, ...]
    position: Position


class Delay(msgspec.Struct, frozen=True, tag=True):
    """A delayed transition of a compound state: its event ``name`` comes after ``after_s``; None: no more."""

    name: str
    after_s: float | None
    position: Position


class Block(msgspec.Struct, frozen=True, tag=True):
    """One of several ``<onentry>`` or ``<onexit>``: what fails in it ends it alone (W3C SCXML 3.8, 3.9).

    ``name`` is that of what several transitions do, who enter or exit the same compound state:
    ``enter moving``. All that have one name are equal, and read no data of the event.
    """

    body: tuple[Statement, ...]
    position: Position
    name: str = ""


Statement = Assign | Emit | Raise | Cancel | Log | If | Foreach | Delay | Block


class Target(msgspec.Struct, frozen=True):
    """Where a transition leads; ``probability`` is None unless there is a choice by ``prob``.

    ``body`` holds the executable content that stands inside ``<target>`` itself.
    """

    state: str
    probability: float | None = None
    body: tuple[Statement, ...] = ()


class Transition(msgspec.Struct, frozen=True, kw_only=True):
    """One transition of a state, in document order (the first that is enabled is taken).

    Attributes:
        event: the trigger; None for an eventless transition.
        targets: empty for a targetless transition (body runs, no exit or entry); several for ``prob``.
        after_s: for ``EventKind.AFTER``: seconds since the state was entered.
        element: the XML element it was written as, for messages.
        internal: a transition of a compound state that does not exit it (W3C SCXML 3.5).
        of: lowered from this compound state, to be a transition of each state in it; "": the state's own.
    """

    event: Event | None
    position: Position
    cond: Expression | None = None
    targets: tuple[Target, ...] = ()
    body: tuple[Statement, ...] = ()
    after_s: float | None = None
    element: str = "transition"
    internal: bool = False
    of: str = ""


class History(msgspec.Struct, frozen=True, kw_only=True):
    """``<history>``: the state that was active last in its parent, or in its parent's child if ``deep``.

    ``default`` is taken where none was; ``variable`` holds the name of the state ("" before).
    """

    name: str
    position: Position
    deep: bool
    default: Transition
    variable: str


class State(msgspec.Struct, frozen=True, kw_only=True):
    """A state. Those of a lowered machine are atomic or final, and named by their path: ``moving/fast``.

    Attributes:
        final: where it is entered, the machine is done, or the compound state around it.
        states: as it was written: of a compound state, those in it.
        initial: of a compound state, what is taken where it is entered by its own name.
        histories: of a compound state.
        done_data: of a final state in a compound one: what the event ``done.state.moving`` brings.
    """

    name: str
    position: Position
    on_entry: tuple[Statement, ...] = ()
    on_exit: tuple[Statement, ...] = ()
    transitions: tuple[Transition, ...] = ()
    final: bool = False
    states: tuple[State, ...] = ()
    initial: Transition | None = None
    histories: tuple[History, ...] = ()
    done_data: tuple[Field, ...] = ()


class Data(msgspec.Struct, frozen=True):
    """A datamodel variable. ``type`` is inferred from ``initial`` where the model declares none.

    ``lower`` and ``upper`` are the least and the greatest value that its model says it has, if it says so;
    ``element`` is the one that says what it begins with, ``param`` for an instance.
    """

    name: str
    type: DataType
    initial: Expression
    position: Position
    declared: bool = True
    lower: int | float | None = None
    upper: int | float | None = None
    element: str = "data"


class Port(msgspec.Struct, frozen=True):
    """A behaviour-tree port of a plugin; an ``optional`` output need not be given in the tree."""

    key: str
    type: DataType
    output: bool
    position: Position
    optional: bool = False


class ActionThread(msgspec.Struct, frozen=True):
    """``<ros_action_thread>``: ``count`` copies of ``machine`` that execute goals of ``interface``."""

    interface: str
    count: int
    machine: Machine
    position: Position


class Machine(msgspec.Struct, frozen=True, kw_only=True):
    """A whole state machine. States are in document order; ``initial`` names one of them.

    ``on_start`` is done before that is entered: it enters the compound states around it. ``tree`` has the
    states as they were written, if some are compound; ``starts_in`` is the initial one of those.

    Of a ``lenient`` one a string, number or bool becomes another of them where its type is needed, as
    ECMAScript has it; else that is an error. ``named_at`` is where its name stands, and ``named_in`` in which
    element, if not in its model.
    """

    name: str
    dialect: Dialect
    position: Position
    initial: str
    states: tuple[State, ...]
    data: tuple[Data, ...] = ()
    interfaces: tuple[Interface, ...] = ()
    ports: tuple[Port, ...] = ()
    threads: tuple[ActionThread, ...] = ()
    lenient: bool = False
    named_at: Position | None = None
    named_in: str = "input"
    on_start: tuple[Statement, ...] = ()
    tree: tuple[State, ...] = ()
    starts_in: str = ""

    @property
    def written(self) -> tuple[State, ...]:
        """The states as they were written."""
        return self.tree or self.states

    @property
    def name_place(self) -> tuple[Position, str]:
        """Where its name stands, and in which element."""
        return (self.named_at, self.named_in) if self.named_at else (self.position, "scxml")

    def state(self, name: str) -> State:
        """The state called ``name``; KeyError if there is none."""
        for state in self.states:
            if state.name == name:
                return state
        raise KeyError(name)

    def made_lenient(self) -> Machine:
        """The same as a ``lenient`` machine, with those that execute its goals."""
        threads = tuple(
            msgspec.structs.replace(thread, machine=thread.machine.made_lenient())
            for thread in self.threads
        )
        return msgspec.structs.replace(self, threads=threads, lenient=True)

    def interface(self, name: str, *kinds: InterfaceKind) -> Interface | None:
        """The interface called ``name`` of one of ``kinds`` (any if none are given)."""
        return next(
            (
                found
                for found in self.interfaces
                if found.name == name and (not kinds or found.kind in kinds)
            ),
            None,
        )
