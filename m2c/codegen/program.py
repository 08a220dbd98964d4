"""What templates are given: the facts of a node, of a policy, and of the packages they are put in.

Frozen structs, worked out from the model before a template is opened; a template decides nothing, it only
writes down. Fields of type :class:`~m2c.codegen.source.Source` are Python already (names, expressions,
words of doc strings) and are printed as they are. Fields of type ``str`` are the model's own text: a
template that prints one without a filter is refused (``m2c.codegen.rendering``).

This is a public interface, documented in ``docs/templates.md``: what ``m2c generate --templates`` may rely
on. :data:`CONTEXT_VERSION` grows when something that is there changes its meaning or goes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec

from m2c.codegen.source import Source

CONTEXT_VERSION = 1
"""``context_version`` in every template."""


class Fact(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind"):
    """What every struct here is; statements have a ``kind`` that templates branch on."""

    @property
    def kind(self) -> str:
        """The tag: ``assign``, ``call``, ``if`` and so on."""
        tag = self.__struct_config__.tag
        assert isinstance(tag, str)
        return tag


# --- statements -----------------------------------------------------------------------------------


class Assign(Fact, frozen=True, tag="assign"):
    """``target = value``."""

    target: Source
    value: Source


class Call(Fact, frozen=True, tag="call"):
    """``function(arguments…)``: an output that leaves, or something of the machine that is set."""

    function: Source
    arguments: tuple[Source, ...] = ()


class Raise(Fact, frozen=True, tag="raise"):
    """An internal event joins the machine's queue (W3C SCXML 4.2)."""

    event: str
    data: Source


class Branch(Fact, frozen=True):
    """``if test``, or ``else`` where ``test`` is None."""

    test: Source | None
    body: tuple[Statement, ...]


class If(Fact, frozen=True, tag="if"):
    """The first branch whose test holds."""

    branches: tuple[Branch, ...]


class Guard(Fact, frozen=True, tag="guard"):
    """A block of executable content that ends at the first thing which cannot be evaluated.

    ``place`` is ``Model.scxml:18:5``.
    """

    body: tuple[Statement, ...]
    place: str


class Choice(Fact, frozen=True, tag="choice"):
    """One of several targets by chance; ``test`` is on ``draw``, a number from 0 up to 1."""

    branches: tuple[Branch, ...]


class Go(Fact, frozen=True, tag="go"):
    """The machine is in ``state`` from now on, a member of its enumeration."""

    state: Source


class Enter(Fact, frozen=True, tag="enter"):
    """A state with something to do on entry is entered by its method ``method``."""

    method: Source


class Exit(Fact, frozen=True, tag="exit"):
    """A state with something to do on exit is left by its method ``method``."""

    method: Source


class CompleteMacrostep(Fact, frozen=True, tag="complete"):
    """Eventless transitions and internal events are taken until none is enabled."""


class Done(Fact, frozen=True, tag="done"):
    """A transition was taken: nothing else is looked at.

    ``how``: ``return``, ``taken`` (and the sender is told so), ``again`` (a macrostep goes on).
    """

    how: str


Statement = (
    Assign | Call | Raise | If | Guard | Choice | Go | Enter | Exit | CompleteMacrostep | Done
)


def calls_in(body: Iterable[Statement]) -> Iterator[Call]:
    """Every call in ``body``, those within other statements included."""
    for statement in body:
        match statement:
            case Call():
                yield statement
            case If(branches) | Choice(branches):
                for branch in branches:
                    yield from calls_in(branch.body)
            case Guard(body=inner):
                yield from calls_in(inner)


# --- a machine ------------------------------------------------------------------------------------


class Parameter(Fact, frozen=True):
    """``name: type``."""

    name: Source
    type: Source


class StateProgram(Fact, frozen=True):
    """A state: its member of the enumeration, and what is done when it is entered and left.

    ``entry`` and ``exit`` are empty where ``enters`` and ``exits`` are false: no method is needed.
    """

    name: str
    constant: Source
    method: Source
    enters: bool
    exits: bool
    entry: tuple[Statement, ...]
    exit: tuple[Statement, ...]


class StateBranch(Fact, frozen=True):
    """What a method does in one of ``states``."""

    states: tuple[Source, ...]
    body: tuple[Statement, ...]


class EventMethod(Fact, frozen=True):
    """The method of one event. ``reports``: it returns whether a transition was taken."""

    name: Source
    parameters: tuple[Parameter, ...]
    doc: Source
    reports: bool
    branches: tuple[StateBranch, ...]


class Variable(Fact, frozen=True):
    """A variable of the datamodel. ``constant``: nothing assigns it."""

    name: str
    attribute: Source
    type: Source
    value: Source
    constant: bool


class MachineProgram(Fact, frozen=True):
    """The class of a machine, or of one that executes the goals of an action (``is_thread``).

    Attributes:
        name: what the model calls it.
        class_name: its class.
        state_class: its enumeration of states.
        initial: the state it starts in.
        start: what entering that does, when the machine is started.
        slots: names of the instance's attributes, sorted.
        eventless: per state, the eventless transitions; they end in ``Done("again")``.
        takes_internal: it has a queue of internal events.
        takes_named: it has ``on_event`` although no transition waits for an event by name.
        completes: a macrostep may have more than one step.
        uses_random, uses_ports: it draws numbers; it reads behaviour-tree ports.
        may_fail: something in it can turn out not to be possible (SCXML's ``error.execution``).
        has_conditions_that_may_fail: so can a condition.
    """

    name: str
    class_name: Source
    state_class: Source
    is_thread: bool
    initial: StateProgram
    start: tuple[Statement, ...]
    states: tuple[StateProgram, ...]
    variables: tuple[Variable, ...]
    slots: tuple[str, ...]
    methods: tuple[EventMethod, ...]
    eventless: tuple[StateBranch, ...]
    takes_internal: bool
    takes_named: bool
    completes: bool
    uses_random: bool
    uses_ports: bool
    may_fail: bool
    has_conditions_that_may_fail: bool


def calls_of(machine: MachineProgram) -> Iterator[Call]:
    """Every call in the methods of ``machine``."""
    yield from calls_in(machine.start)
    for state in machine.states:
        yield from calls_in((*state.entry, *state.exit))
    for branch in (
        *machine.eventless,
        *(part for item in machine.methods for part in item.branches),
    ):
        yield from calls_in(branch.body)


# --- messages -------------------------------------------------------------------------------------


class MessageField(Fact, frozen=True):
    """``attribute: annotation = default``; ``renamed`` where the attribute is not called as the field."""

    name: str
    attribute: Source
    annotation: Source
    default: Source
    is_factory: bool
    renamed: bool


class MessageClass(Fact, frozen=True):
    """The class of a message type, ``pkg/msg/Name``."""

    type_name: str
    class_name: Source
    fields: tuple[MessageField, ...]


# --- a node ---------------------------------------------------------------------------------------


class Channel(Fact, frozen=True):
    """A topic, service or action: a constant, or made where a port gives its name at run time.

    Attributes:
        shape: ``Topic``, ``Service`` or ``Action``.
        constant: what the constant is called.
        name: the channel's; None where the behaviour-tree port ``port`` gives it.
        classes: of its messages.
    """

    shape: Source
    constant: Source
    name: str | None
    port: str | None
    type_name: str
    classes: tuple[Source, ...]
    best_effort: bool
    latched: bool


class TimerHandler(Fact, frozen=True):
    """What a timer calls: a method of the machine, or of each of ``threads``."""

    method: Source
    threads: Source | None


class Endpoint(Fact, frozen=True):
    """One end of a channel, or a timer.

    Attributes:
        role: ``publisher``, ``subscriber``, ``server``, ``client``, ``action_server``, ``action_client``
            or ``timer``.
        attribute: of the node, that has it.
        channel: None for a timer.
        handlers: what is called on what; None where the model has no handler. In order: of a
            subscriber, the message; of a server, the request; of a client, response and error; of an
            action server, goal and cancel; of an action client, see ``named``.
        named: of an action client, by keyword.
        timer: name, rate in Hz and handlers of a timer.
    """

    role: str
    attribute: Source
    channel: Channel | None = None
    handlers: tuple[Source | None, ...] = ()
    named: tuple[tuple[Source, Source], ...] = ()
    timer_name: str = ""
    rate_hz: float = 0.0
    timer_handlers: tuple[TimerHandler, ...] = ()


class Output(Fact, frozen=True):
    """A method of ``Outputs``, which the node implements.

    Attributes:
        role: ``call`` calls ``target`` with ``arguments``; ``start_thread`` and ``free_thread`` have
            ``handler`` called as the next event, of a thread of ``threads`` or of the machine.
    """

    method: Source
    parameters: tuple[Parameter, ...]
    doc: Source
    role: str
    target: Source
    arguments: tuple[Source, ...]
    handler: Source | None = None


class ThreadProgram(Fact, frozen=True):
    """``count`` machines of class ``class_name`` that execute goals, in the attribute ``attribute``."""

    attribute: Source
    class_name: Source
    count: int
    uses_ports: bool


class ChildHandler(Fact, frozen=True):
    """What the machine does when the child with number ``child`` answers."""

    child: Source
    method: Source


class CancelMethod(Fact, frozen=True):
    """Cancelling a goal concerns several machines: the node's own and those of ``threads``."""

    name: Source
    machine: Source | None
    threads: tuple[tuple[Source, Source], ...]


class NodeProgram(Fact, frozen=True):
    """A node: its machine, and what binds that to channels.

    Attributes:
        name: what the model calls it.
        package: its Python package (dotted, for a plugin of a policy).
        class_name: the class in ``node.py``.
        machines: its own, then those that execute goals.
        is_plugin: it is ticked by a behaviour tree.
        takes_ports: it is given the values of behaviour-tree ports.
        ticked, halted: its model handles tick and halt.
        child_status, child_halted: what it does when a child answers; empty where it never asks one.
    """

    name: str
    package: Source
    class_name: Source
    machines: tuple[MachineProgram, ...]
    messages: tuple[MessageClass, ...]
    channels: tuple[Channel, ...]
    endpoints: tuple[Endpoint, ...]
    outputs: tuple[Output, ...]
    threads: tuple[ThreadProgram, ...]
    cancels: tuple[CancelMethod, ...]
    is_plugin: bool
    takes_ports: bool
    ticked: bool
    halted: bool
    child_status: tuple[ChildHandler, ...]
    child_halted: tuple[ChildHandler, ...]

    @property
    def machine(self) -> MachineProgram:
        """The node's own machine."""
        return self.machines[0]


# --- packages -------------------------------------------------------------------------------------


class PluginClass(Fact, frozen=True):
    """The node class of the plugin ``name``, as the policy imports it."""

    name: str
    module: Source
    class_name: Source
    alias: Source


class PolicyProgram(Fact, frozen=True):
    """The program that ticks the behaviour tree of the system ``name``."""

    name: str
    package: Source
    plugins: tuple[PluginClass, ...]


class PackageProgram(Fact, frozen=True):
    """What is installed.

    Attributes:
        name: of the Python package in it.
        distribution: of the distribution.
        description: one line.
        depends: packages of a ROS 2 workspace that it needs, sorted.
        is_nested: it has packages and data files within.
        launch: the launch file that it holds instead of code; "" otherwise.
    """

    name: Source
    distribution: Source
    description: str
    depends: tuple[Source, ...] = ()
    is_nested: bool = False
    launch: str = ""


class LaunchProgram(Fact, frozen=True):
    """A system to be started by ``ros2 launch``; ``nodes``: package and name of each."""

    name: str
    package: Source
    file: Source
    nodes: tuple[tuple[str, str], ...]
    policy: str | None
    tick_rate_hz: float
