"""The simulated world, and its nodes: one queue of events, one clock, one source of randomness.

Everything that happens is an event at a virtual time. Nothing else decides what happens next, so a
run is a pure function of the seed, the conditions and the nodes' code.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import random
import threading
from collections.abc import Callable, Iterable, Sequence
from queue import Empty
from typing import Any

from transports import actions
from transports.interface import (
    Action,
    ActionClient,
    Closes,
    GoalHandle,
    Observation,
    Service,
    Topic,
    TransportError,
)
from transports.refusals import Refusals
from transports.simulated.clocks import Clocks
from transports.simulated.conditions import Conditions, Kill, Rules
from transports.simulated.network import NS, Link, Network, Pauses, Range
from transports.simulated.pace import Pace
from transports.simulated.parts import Event, Rank
from transports.simulated.presence import Presence, View
from transports.simulated.routes import Routes, Tap
from transports.simulated.services import Client, Request, Server, Services
from transports.simulated.tasks import Task, current_task
from transports.simulated.topics import Publisher, Subscription, Topics
from transports.simulated.waiting import Completion, Timer
from transports.timers import period_ns
from transports.work_queue import WorkQueue

LOG = logging.getLogger("transports.simulated")
START_NS = 1_700_000_000 * 10**9
"""Virtual time of the first event, ns since the epoch."""


_BELOW = 62
"""A rank decides before the order does, which never has so many bits."""


class SimulatedWorld(Closes):
    """Nodes, links and taps on virtual time.

    Args:
        seed: decides every random choice of the world.
        conditions: how well the network and the machines work.
        ranked: whether a timer fires only when nothing else is due, and a step of a machine
            (:meth:`SimulatedTransport.post_step`) is taken only when no message is. Otherwise what was
            made to happen first happens first.
    """

    def __init__(
        self, seed: int = 0, conditions: Conditions | None = None, ranked: bool = False
    ) -> None:
        self.conditions = conditions = conditions or Conditions()
        self._is_ranked = ranked
        self.seed = seed
        self.random = random.Random(seed)
        self.now_ns = START_NS
        """Virtual time, ns since the epoch."""
        self.running: str | None = None
        """The node whose handler runs, if one does."""
        self.acted: str | None = None
        """The node whose handler ran last."""
        self.failed: str | None = None
        """The node whose handler raised what ``run`` has raised; None: something else did."""
        self.events = 0
        """How many events have happened."""
        self.nodes: dict[str, SimulatedTransport] = {}
        self._lives = 0
        self.starters: dict[str, Callable[[], object]] = {}
        """How each node is started again that was killed (``Conditions.kills``), by its name."""
        self._queue: list[tuple[int, int, Event, Any]] = []
        self._order = 0
        self._last_stamp_ns = self._last_true_ns = 0
        self.network = Network(conditions, START_NS, self.random, seed)
        self.clocks = Clocks(conditions, START_NS, lambda: self.now_ns)
        self.pauses = Pauses(conditions.pauses, START_NS)
        self.routes = Routes(self)
        self.topics = Topics()
        self.services = Services()
        self.presence = Presence(self, self.nodes)
        self._busy = Range(conditions.busy_s, self.random)
        self.is_prompt = not (self._busy.most or conditions.pauses)
        """Whether every node has time for what it gets at once."""
        # put() may come from a signal's handler while get() waits on the same thread
        self._entered: WorkQueue[tuple[Event, Any]] = WorkQueue()
        self._pace: Pace | None = None
        self._thread = threading.get_ident()
        self._tasks: list[Task] = []
        for kill in conditions.kills:
            self.schedule(round(kill.at_s * NS), self._kill, kill)

    # --- time ------------------------------------------------------------------------------------

    def stamp(self) -> int:
        """Now, but later than every stamp before: a hybrid logical clock of the whole world."""
        stamp_ns = self._last_stamp_ns + 1
        self._last_stamp_ns = stamp_ns = stamp_ns if stamp_ns > self.now_ns else self.now_ns
        return stamp_ns

    def true_stamp(self) -> int:
        """Now, but later than every true stamp before."""
        self._last_true_ns = max(self.now_ns, self._last_true_ns + 1)
        return self._last_true_ns

    def stamp_of(self, node: str) -> int:
        """The stamp of what ``node`` does now, by its host's clock."""
        return self.clocks.stamp(node) if self.clocks.differ else self.stamp()

    def schedule(
        self, delay_ns: int, event: Event, argument: Any, rank: Rank = Rank.MESSAGE
    ) -> None:
        """Let ``event(argument)`` happen ``delay_ns`` from now."""
        self._order += 1
        order = self._order + (rank << _BELOW if self._is_ranked else 0)
        heapq.heappush(self._queue, (self.now_ns + delay_ns, order, event, argument))

    def next_order(self) -> int:
        """The place of what is made to happen now, among all that is due at the same time."""
        self._order += 1
        return self._order

    def schedule_at(self, due_ns: int, order: int, event: Event, argument: Any) -> None:
        """Let ``event(argument)`` happen at ``due_ns``, in the place that ``next_order`` gave it."""
        heapq.heappush(self._queue, (due_ns, order, event, argument))

    def enter(self, event: Event, argument: Any) -> None:
        """``event(argument)`` now; from another thread: as soon as the world takes notice."""
        if threading.get_ident() == self._thread or current_task() is not None:
            event(argument)
        else:
            self._entered.put((event, argument))

    def wake(self) -> None:
        """Have ``until`` of ``run`` asked again soon; from any thread, and from a signal's handler."""
        self._entered.put((_nothing, None))

    def keep_pace(self, speed: float | None) -> None:
        """From now on let ``speed`` seconds pass in each second of real time.

        Args:
            speed: more than 0; None: time passes as fast as its events can happen.
        """
        self._pace = None if speed is None else Pace(speed, self.now_ns)

    def send(
        self,
        link: Link,
        event: Event,
        argument: Any,
        behind: Iterable[Link] = (),
        is_lossy: bool = False,
    ) -> None:
        """Let ``event(argument)`` happen when a message sent now on ``link`` arrives, as often as it does.

        Args:
            link: on which.
            event: what happens.
            argument: with what.
            behind: links whose messages that are under way arrive before it.
            is_lossy: whether the middleware may lose it.
        """
        network, now_ns = self.network, self.now_ns
        if network.is_kept and not is_lossy and not behind:
            self._order += 1
            due_ns = network.in_turn(link, now_ns)
            heapq.heappush(self._queue, (due_ns, self._order, event, argument))
            return
        for due_ns in network.message(link, now_ns, is_lossy, behind):
            self._order += 1
            heapq.heappush(self._queue, (due_ns, self._order, event, argument))

    def send_to_tap(self, link: Link, event: Event, argument: Any) -> None:
        """The same for what a tap receives, which may be lost or doubled."""
        network, now_ns = self.network, self.now_ns
        if network.shows_all:
            self._order += 1
            due_ns = network.shown(link, now_ns)
            heapq.heappush(self._queue, (due_ns, self._order, event, argument))
            return
        for due_ns in network.observation(link, now_ns):
            self._order += 1
            heapq.heappush(self._queue, (due_ns, self._order, event, argument))

    def busy_ns(self) -> int:
        """How long the next piece of work keeps its node busy."""
        return self._busy.draw()

    # --- running ---------------------------------------------------------------------------------

    def step(self) -> bool:
        """Let the next event happen; False if there is none."""
        while not self._entered.empty():
            event, argument = self._entered.get()
            event(argument)
        if not self._queue:
            return False
        self.now_ns, _, event, argument = heapq.heappop(self._queue)
        self.events += 1
        event(argument)
        return True

    def run(self, until: Callable[[], object], deadline_ns: int) -> bool:
        """Let events happen until ``until()`` holds; False if ``deadline_ns`` came first.

        The clock stands at the deadline then. ``until`` is asked before each event.
        """
        if self.running is not None:
            raise TransportError(f"the world cannot run within a handler of {self.running}")
        caller, self._thread = self._thread, threading.get_ident()
        try:
            queue, entered, take = self._queue, self._entered, heapq.heappop
            pace = self._pace
            while not until():
                if not entered.empty():
                    event, argument = entered.get()
                    event(argument)
                elif pace is not None and self._held_back(
                    pace, min(queue[0][0], deadline_ns) if queue else deadline_ns
                ):
                    pass  # something may be different now
                elif queue and queue[0][0] <= deadline_ns:
                    self.now_ns, _, event, argument = take(queue)
                    self.events += 1
                    event(argument)
                else:
                    self.now_ns = max(self.now_ns, deadline_ns)
                    return bool(until())
            return True
        finally:
            self._thread = caller

    def _held_back(self, pace: Pace, due_ns: int) -> bool:
        """Whether it was too early for what is due at ``due_ns``: then this has waited."""
        wait_s = pace.left_s(due_ns)
        if wait_s <= 0:
            return False
        try:
            event, argument = self._entered.get(wait_s)
        except Empty:
            return True
        event(argument)
        return True

    def run_for(self, seconds: float) -> None:
        """Let ``seconds`` of virtual time pass."""
        self.run(lambda: False, self.now_ns + round(seconds * 1e9))

    def run_until(self, until: Callable[[], object], timeout_s: float) -> bool:
        """Let events happen until ``until()`` holds, for at most ``timeout_s`` virtual seconds."""
        return self.run(until, self.now_ns + round(timeout_s * 1e9))

    def idle(self) -> bool:
        """Whether nothing will ever happen unless another thread makes it."""
        return not self._queue and self._entered.empty()

    def wait_for_threads(self) -> None:
        """Block until another thread enters something: for ``spin`` of an idle world."""
        self.schedule(0, *self._entered.get())

    # --- nodes -----------------------------------------------------------------------------------

    def next_life(self) -> int:
        """What distinguishes a node that joins from all that were there (``Observation.life``)."""
        self._lives += 1
        return self._lives

    def connect(self, node: str) -> SimulatedTransport:
        """Connect a node to this world.

        Args:
            node: its name, unique in the world.

        Raises:
            TransportError: the world has a node of that name.
        """
        return SimulatedTransport(self, node)

    def spawn(self, work: Callable[[], None], name: str) -> Task:
        """Run ``work`` as one of several callers that may wait (a policy's tick waits for answers).

        It starts with the world's next events and runs only while nothing else does, so the world
        stays a function of its seed. What it raises is raised by ``run``.
        """
        task = Task(work, name)
        self._tasks.append(task)
        self.schedule(0, Task.resume, task)
        return task

    def crash(self, node: str) -> None:
        """``node`` dies without a word: what is under way to it is lost, its callers get an error."""
        if node not in self.nodes:
            known = ", ".join(sorted(self.nodes)) or "none"
            raise TransportError(f"no node `{node}` in this world (there are: {known})")
        self.nodes[node].vanish(killed=True)

    def _kill(self, kill: Kill) -> None:
        if kill.node in self.nodes:
            self.crash(kill.node)
            starter = self.starters.get(kill.node)
            if kill.down_s is not None and starter is not None:
                self.schedule(round(kill.down_s * NS), _start, starter)

    def witness(self, handler: Callable[[Observation], None]) -> None:
        """Have ``handler`` called with everything that nodes do, when they do it.

        The handler gets the truth: every observation, without delay or loss, stamped by the world's own clock
        and numbered. The nodes do not know of it.
        """
        self.routes.witness(handler)

    def close(self) -> None:
        """Close every node and end every spawned caller."""
        for node in tuple(self.nodes.values()):
            node.close()
        for task in self._tasks:
            task.abandon()


def _nothing(_: object) -> None:
    """An event in which nothing happens."""


def _start(starter: Callable[[], object]) -> None:
    starter()


class SimulatedTransport(Closes):
    """A node in a simulated world; see ``transports.interface.Transport`` for every method.

    ``spin`` runs the whole world, so one thread drives any number of nodes.
    """

    def __init__(self, world: SimulatedWorld, node: str) -> None:
        if not node:
            raise TransportError("a node needs a name")
        if node in world.nodes:
            raise TransportError(f"two nodes are named {node} in this world")
        self.world = world
        self.routes, self.topics, self.services = world.routes, world.topics, world.services
        self.alive = True
        is_ros = world.conditions.rules is Rules.ROS2
        self.repair_s = _ROS2_REPAIR_S if is_ros else 0.0
        self.reports_takes = not is_ros
        self.refusals = Refusals(LOG)
        self.listens = False
        """Whether a tap is its."""
        self.node = node
        """Its name."""
        self._calls: dict[str, itertools.count[int]] = {}
        """The numbers of calls: on ROS 2 of those of each service, else of all ("")."""
        self._subscriptions: list[tuple[str, Subscription]] = []
        self._servers: dict[str, Server] = {}
        self._clients: list[Client] = []
        self._own_taps: list[Tap] = []
        self._beside: list[SimulatedTransport] = []
        self._announced = False
        self._free_ns = 0
        self.connected_ns = world.now_ns
        """Virtual time."""
        self.since_ns = SimulatedTransport.now_ns(self)
        """The same by its own clock."""
        self.life = world.next_life()
        self.view = View(self)
        world.nodes[node] = self
        self.routes.begin(node)
        world.presence.connected(self)

    def beside(self, node: str) -> SimulatedTransport:
        """Another node in the same world."""
        other = SimulatedTransport(self.world, node)
        self._beside.append(other)
        return other

    def now_ns(self) -> int:
        """The clock of this node's host, ns since the epoch."""
        world = self.world
        return world.now_ns + (world.clocks.ahead_ns(self.node) if world.clocks.differ else 0)

    def still_ns(self) -> int:
        """How long this node stands still from now on."""
        return self.world.pauses.after(self.node, self.world.now_ns) - self.world.now_ns

    def steady_ns(self) -> int:
        """See ``transports.interface.VirtualTime``."""
        return self.world.now_ns

    def work(self, handler: Callable[[Any], None], argument: Any) -> None:
        """Run ``handler(argument)`` as this node's next piece of work, when it has time for it."""
        world = self.world
        if not world.is_prompt:
            start = world.pauses.after(self.node, max(world.now_ns, self._free_ns))
            self._free_ns = start + world.busy_ns()
            if start > world.now_ns:
                world.schedule(start - world.now_ns, self._run_later, (handler, argument))
                return
        self._run(handler, argument)

    def _run_later(self, item: tuple[Callable[[Any], None], Any]) -> None:
        self._run(*item)

    def _run(self, handler: Callable[[Any], None], argument: Any) -> None:
        if not self.alive:
            return
        world = self.world
        before = world.running
        world.running = world.acted = self.node
        try:
            handler(argument)
        except Exception:
            world.failed = world.failed or self.node
            raise
        finally:
            world.running = before

    def publisher(self, topic: Topic) -> Publisher:
        """Declare a publisher."""
        _check_name(topic.name)
        return Publisher(self, topic)

    def subscribe(self, topic: Topic, handler: Callable[[Any], None]) -> None:
        """Call ``handler(message)`` for every message."""
        _check_name(topic.name)
        subscription = Subscription(self, topic, handler)
        self._subscriptions.append((topic.name, subscription))
        self.topics.subscriptions(topic.name).append(subscription)
        if topic.transient_local:
            for publisher in self.topics.transient_local.get(topic.name, {}):
                subscription.take_last(publisher)

    def serve(self, service: Service, handler: Callable[[Request], None]) -> None:
        """Serve ``service``; a second server of it, here or in another node, is reported."""
        _check_name(service.name)
        if service.name in self._servers:
            raise TransportError(f"{service.name} is served by {self.node} already")
        server = Server(self, service, handler)
        servers = self.services.servers(service.name)
        for other in servers:
            LOG.error(
                "two nodes serve %s: %s and %s; a call reaches only one of them",
                service.name,
                self.node,
                other.node.node,
            )
        servers.append(server)
        self._servers[service.name] = server

    def client(self, service: Service) -> Client:
        """A client of ``service``."""
        _check_name(service.name)
        of = service.name if self.world.conditions.rules is Rules.ROS2 else ""
        client = Client(self, service, self._calls.setdefault(of, itertools.count(1)))
        self._clients.append(client)
        return client

    def serve_action(
        self,
        action: Action,
        goal: Callable[[GoalHandle], None],
        cancel: Callable[[GoalHandle], None],
    ) -> None:
        """Serve ``action``."""
        actions.serve_action(self, action, goal, cancel)

    def action_client(self, action: Action) -> ActionClient:
        """A client of ``action``, whose goal ids come from the world's seed."""
        return actions.action_client(self, action, self._goal_id)

    def _goal_id(self) -> str:
        return f"{self.world.random.getrandbits(128):032x}"

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` every ``period_s`` seconds, without drift."""
        period = period_ns(period_s)
        return Timer(self, period, period, handler)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once, ``delay_s`` seconds from now."""
        return Timer(self, max(0, round(delay_s * 1e9)), 0, handler)

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` as this node's work; callable from any thread."""
        self.world.enter(self._post, handler)

    def post_step(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` as this node's work once no message is due (in a world that ranks)."""
        self.world.schedule(0, self._posted, handler, Rank.STEP)

    def _post(self, handler: Callable[[], None]) -> None:
        self.world.schedule(0, self._posted, handler)

    def _posted(self, handler: Callable[[], None]) -> None:
        self.work(_call, handler)

    def completion(self) -> Completion:
        """A fresh completion; waiting for it runs the world."""
        return Completion(self.world)

    def tick_complete(self) -> None:
        """Nothing to do: taps receive everything at once, and take no time."""

    def wait_for_nodes(self, names: Sequence[str], timeout_s: float) -> Sequence[str]:
        """Run the world until all ``names`` are up; returns those still missing at the end."""

        def missing() -> list[str]:
            there = self.view.names()
            return [name for name in names if name not in there]

        self.world.run_until(lambda: not missing(), timeout_s)
        return missing()

    @property
    def is_announced(self) -> bool:
        """Whether this node counts as up."""
        return self._announced

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` whenever a node announces itself or goes away."""
        self.view.watch(handler)

    def up_since(self, name: str) -> int:
        """When ``name`` joined the world (ns, on its clock); 0 if it is not up, to this node."""
        return self.view.up_since(name)

    def clock_of(self, name: str) -> str:
        """See ``TellsClocks.clock_of``."""
        return self.view.clock_of(name)

    def announce(self) -> None:
        """Say that this node has declared everything and is ready; a plain node does not."""
        if not self._announced and self.node not in self.world.conditions.plain:
            self._announced = True
            self.world.presence.announced(self)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Receive everything on channels that match one of the globs (empty: all), passively."""
        tap = Tap(self, channels, handler)
        self._own_taps.append(tap)
        return tap

    def spin(self, until: Callable[[], bool] | None = None) -> None:
        """Run the world on the calling thread until ``close()`` (or until ``until()`` holds)."""
        world = self.world

        def over() -> bool:
            return not self.alive or (until is not None and until())

        while not over():
            if world.idle():
                world.wait_for_threads()
            world.run_until(lambda: over() or world.idle(), _FOREVER_S)

    def close(self) -> None:
        """Leave the world; idempotent, from any thread."""
        self.world.enter(lambda _: self.vanish(), None)

    def vanish(self, killed: bool = False) -> None:
        """Be gone: nothing arrives here any more, and who called this node gets an error.

        Args:
            killed: without a word.
        """
        if not self.alive:
            return
        for other in self._beside:
            other.vanish(killed)
        self.alive = False
        del self.world.nodes[self.node]
        for tap in self._own_taps:
            tap.close()
        for channel, subscription in self._subscriptions:
            self.topics.subscriptions(channel).remove(subscription)
        for channel, server in self._servers.items():
            self.services.servers(channel).remove(server)
            server.vanish()
        for client in self._clients:
            client.close()
        for publishers in self.topics.transient_local.values():
            for publisher in [one for one in publishers if one.node is self]:
                del publishers[publisher]
        if self._announced:
            self.world.presence.left(self, killed)


_ROS2_REPAIR_S = 3.2
"""As ``transports.ros2`` says of Fast DDS."""
_FOREVER_S = 3600.0 * 24 * 365 * 100


def _call(handler: Callable[[], None]) -> None:
    handler()


def _check_name(channel: str) -> None:
    if not channel.startswith("/") or "" in channel[1:].split("/"):
        raise TransportError(
            f"channel {channel!r} must be absolute, like /a/b, and without empty parts"
        )
