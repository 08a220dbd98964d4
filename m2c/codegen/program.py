"""What templates are given: the facts of a node, of a policy, and of the packages they are put in.

Frozen structs, worked out from the model before a template is opened; a template decides nothing, it only
writes down. Fields of type :class:`~m2c.codegen.source.Source` are Python already (names, expressions,
words of doc strings) and are printed as they are. Fields of type ``str`` are the model's own text: a
template that prints one without a filter is refused (``m2c.codegen.rendering``).

This is a public interface, documented in ``docs/templates.md``: what ``m2c generate --templates`` may rely
on. :data:`CONTEXT_VERSION` grows when something that is there changes its meaning or goes.
"""

from __future__ import annotations

import msgspec

from m2c.codegen.source import Source

CONTEXT_VERSION = 1
"""``context_version`` in every template."""

Parameters = tuple[tuple[Source, Source], ...]
"""Names and types."""


class Fact(msgspec.Struct, frozen=True):
    """What every struct here is."""

    @property
    def kind(self) -> str:
        """Of a statement, what templates branch on: ``assign``, ``call``, ``if`` and so on."""
        return type(self).__name__.lower()


# --- statements -----------------------------------------------------------------------------------


class Assign(Fact, frozen=True):
    """``target = value``."""

    target: Source
    value: Source


class Call(Fact, frozen=True):
    """``function(arguments…)``: an output that leaves, a state that is entered, and the like."""

    function: Source
    arguments: tuple[Source, ...] = ()


class Branch(Fact, frozen=True):
    """``if test``, or ``else`` where ``test`` is None."""

    test: Source | None
    body: tuple[Statement, ...]


class If(Fact, frozen=True):
    """The first branch whose test holds."""

    branches: tuple[Branch, ...]


class Loop(Fact, frozen=True):
    """``body`` for ``each`` of ``elements``; if ``counted``, with its ``place`` from 0."""

    elements: Source
    counted: bool
    body: tuple[Statement, ...]


class Guard(Fact, frozen=True):
    """A block that ends at the first thing which cannot be evaluated; ``place``: ``Model.scxml:18:5``."""

    body: tuple[Statement, ...]
    place: str


class Choice(Fact, frozen=True):
    """One of several targets by chance: the tests are on ``draw``, a number from 0 up to 1."""

    branches: tuple[Branch, ...]


class Done(Fact, frozen=True):
    """A transition was taken. ``how``: ``return``, ``taken`` (the sender is told), ``again`` (the
    macrostep goes on); or none was: ``discarded`` (the sender is told).
    """

    how: str


Statement = Assign | Call | If | Loop | Guard | Choice | Done


# --- a machine ------------------------------------------------------------------------------------


class StateProgram(Fact, frozen=True):
    """A state: its member of the enumeration, and the methods that enter and exit it; empty ones are not
    made. ``method`` is what their names end in.
    """

    name: str
    constant: Source
    method: Source
    entry: tuple[Statement, ...]
    exit: tuple[Statement, ...]


class BlockMethod(Fact, frozen=True):
    """The method, without its ``_``, of what several transitions do who enter or exit a compound state."""

    method: Source
    doc: str
    body: tuple[Statement, ...]


class StateBranch(Fact, frozen=True):
    """What a method does in one of ``states``."""

    states: tuple[Source, ...]
    body: tuple[Statement, ...]


class EventMethod(Fact, frozen=True):
    """The method of an event; ``reports``: it returns whether a transition was taken."""

    name: Source
    parameters: Parameters
    doc: Source
    reports: bool
    branches: tuple[StateBranch, ...]


class Variable(Fact, frozen=True):
    """A variable of the datamodel; ``constant``: nothing assigns it."""

    name: str
    attribute: Source
    type: Source
    value: Source
    constant: bool


class MachineProgram(Fact, frozen=True):
    """The class of a machine, or of one that executes the goals of an action (``is_thread``).

    Attributes:
        initial: the state it starts in; ``start``: what entering that does.
        blocks: what transitions do besides, who enter or exit compound states.
        slots: names of the instance's attributes, sorted.
        eventless: per state, its eventless transitions.
        takes_internal: it has a queue of internal events.
        takes_named: it has ``on_event`` although no transition waits for an event by name.
        uses_random, uses_ports: it draws numbers; it reads ports of the behaviour tree.
        sends: its outputs that are no messages: ``log``, ``fault`` (something may turn out not to be
            possible, SCXML's ``error.execution``), ``send_self``, ``cancel_send``, ``start_delay``,
            ``stop_delay``.
        tests_may_fail: a condition may turn out not to be possible.
        looks_again: in some state, eventless transitions are tested after an event that none takes, too.
    """

    name: str
    class_name: Source
    state_class: Source
    is_thread: bool
    initial: StateProgram
    start: tuple[Statement, ...]
    states: tuple[StateProgram, ...]
    blocks: tuple[BlockMethod, ...]
    variables: tuple[Variable, ...]
    slots: tuple[str, ...]
    methods: tuple[EventMethod, ...]
    eventless: tuple[StateBranch, ...]
    takes_internal: bool
    takes_named: bool
    uses_random: bool
    uses_ports: bool
    sends: frozenset[str]
    tests_may_fail: bool
    looks_again: bool


# --- messages -------------------------------------------------------------------------------------


class MessageField(Fact, frozen=True):
    """A field ``name``; ``default`` is a value, or what makes one (``is_factory``)."""

    name: str
    attribute: Source
    annotation: Source
    default: Source
    is_factory: bool


class MessageClass(Fact, frozen=True):
    """The class of a message type, ``pkg/msg/Name``."""

    type_name: str
    class_name: Source
    fields: tuple[MessageField, ...]


class TypeOfCalls(Fact, frozen=True):
    """A service or an action type (``shape``: ``ServiceType``, ``ActionType``) with messages of
    ``classes``.
    """

    shape: Source
    type_name: str
    class_name: Source
    classes: tuple[Source, ...]


class MessageModule(Fact, frozen=True):
    """The message classes of nodes that are written by hand: ``m2c interfaces python``."""

    name: str
    messages: tuple[MessageClass, ...]
    types: tuple[TypeOfCalls, ...]


# --- a node ---------------------------------------------------------------------------------------


class Channel(Fact, frozen=True):
    """A topic, service or action (``shape``: ``Topic``, ``Service``, ``Action``) with messages of
    ``classes``: a constant, or made where the behaviour-tree port ``port`` gives its ``name``.
    """

    shape: Source
    constant: Source
    name: str | None
    port: str | None
    type_name: str
    classes: tuple[Source, ...]
    best_effort: bool
    transient_local: bool


class Endpoint(Fact, frozen=True):
    """One end of a channel, or a timer.

    Attributes:
        role: ``publisher``, ``subscriber``, ``server``, ``client``, ``action_server``, ``action_client``
            or ``timer``; what the binding's method is called.
        attribute: of the node, that has it.
        channel: None for a timer.
        handlers: what is called when something comes; None where the model has no handler. Of a client:
            response and error; of an action server: goal and cancel; of a publisher: what takes its
            messages in the node itself, if something does.
        named: handlers of an action client, by keyword.
        timer: the model's name of a timer; ``rate_hz``: how often a second it fires.
        rate_port: the port that says so instead.
        each: methods of each thread that a timer calls: the node's attribute with the threads, method.
    """

    role: Source
    attribute: Source
    channel: Channel | None = None
    handlers: tuple[Source | None, ...] = ()
    named: Parameters = ()
    timer: str = ""
    rate_hz: float = 0.0
    rate_port: str | None = None
    each: Parameters = ()


class Output(Fact, frozen=True):
    """A method of ``Outputs``, which the node implements.

    Attributes:
        leaves_by: what it calls with its parameters; None where it is told to a thread of the node or to
            the machine: ``handler``, called as the next event.
        threads: the attribute with the threads, of which one is told; None for the machine.
    """

    method: Source
    parameters: Parameters
    doc: Source
    leaves_by: Source | None
    handler: Source | None = None
    threads: Source | None = None


class ThreadProgram(Fact, frozen=True):
    """``count`` machines of class ``class_name`` that execute goals, in the attribute ``attribute``."""

    attribute: Source
    class_name: Source
    count: int
    uses_ports: bool
    uses_random: bool


class SharedMethod(Fact, frozen=True):
    """A message or a cancel request concerns the node's ``machine`` and, as in ``each``, its threads."""

    name: Source
    parameters: Parameters
    machine: Source | None
    each: Parameters


class NodeProgram(Fact, frozen=True):
    """A node: its machine, and what binds that to channels.

    Attributes:
        package: its Python package (dotted, for a plugin of a policy).
        class_name: the class in ``node.py``.
        machines: its own, then those that execute goals.
        is_plugin: it is ticked by a behaviour tree; ``ticked``, ``halted``: its model handles that.
        takes_ports: it is given the values of behaviour-tree ports.
        parameters: what the variables are called that its launcher may set: in the model, in the class of
            the machine, and their types as a model writes them; none of a plugin's.
        child_status, child_halted: children (a number, or where one is kept) and what is called when
            one answers; empty where the model never asks one.
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
    shared: tuple[SharedMethod, ...]
    is_plugin: bool
    takes_ports: bool
    parameters: tuple[tuple[str, str, str], ...]
    ticked: bool
    halted: bool
    child_status: Parameters
    child_halted: Parameters

    @property
    def machine(self) -> MachineProgram:
        """The node's own machine."""
        return self.machines[0]

    @property
    def sends(self) -> frozenset[str]:
        """What any of its machines sends that is no message."""
        return frozenset().union(*(machine.sends for machine in self.machines))


# --- packages -------------------------------------------------------------------------------------


class PluginClass(Fact, frozen=True):
    """The node class of the plugin ``name``, and what the policy imports it as."""

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
    """What is installed: the Python package ``name`` as the distribution ``distribution``.

    Attributes:
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
    """A system for ``ros2 launch PACKAGE FILE``; ``nodes``: package and name of each."""

    name: str
    package: Source
    file: Source
    nodes: tuple[tuple[str, str], ...]
    policy: str | None
    tick_rate_hz: float
