"""The simulated world: one queue of events, one clock, one source of randomness.

Everything that happens is an event at a virtual time. Nothing else decides what happens next, so a
run is a pure function of the seed, the conditions and the nodes' code.
"""

from __future__ import annotations

import heapq
import random
import threading
from collections.abc import Callable, Iterable
from enum import IntEnum
from queue import Empty
from typing import TYPE_CHECKING, Any

from transports.interface import Closes, Observation, TransportError
from transports.simulated.clocks import Clocks
from transports.simulated.conditions import Conditions, Kill
from transports.simulated.network import NS, Link, Network, Pauses, Range
from transports.simulated.pace import Pace
from transports.simulated.presence import Presence
from transports.simulated.routes import Routes
from transports.simulated.tasks import Task, current_task
from transports.work_queue import WorkQueue

if TYPE_CHECKING:
    from transports.simulated.transport import SimulatedTransport

START_NS = 1_700_000_000 * 10**9
"""Virtual time of the first event, ns since the epoch."""

Event = Callable[[Any], None]


class Rank(IntEnum):
    """What happens first of all that is due at one time, in a world that ranks it."""

    MESSAGE = 0
    STEP = 1
    TIMER = 2


_BELOW = 62
"""A rank decides before the order does, which never has so many bits."""


class Completion:
    """A value that one caller waits for; see ``transports.interface.Completion``."""

    __slots__ = ("_task", "_value", "_world", "ready")

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world
        self._value: Any = None
        self._task: Task | None = None
        self.ready = False

    def set(self, value: Any) -> None:
        """Deliver ``value``; only the first delivery counts. From any thread."""
        self._world.enter(self._set, value)

    def _set(self, value: Any) -> None:
        if self.ready:
            return
        self.ready = True
        self._value = value
        if self._task is not None:
            self._world.schedule(0, Task.resume, self._task)

    def wait(self, timeout_s: float) -> Any:
        """The value, or None after ``timeout_s`` virtual seconds, whose events run meanwhile."""
        world = self._world
        if world.running is not None:
            raise TransportError(
                f"{world.running} waits in a handler: nothing else of it would run meanwhile"
            )
        deadline_ns = world.now_ns + max(0, round(timeout_s * 1e9))
        task = current_task()
        if task is None:
            world.run(lambda: self.ready, deadline_ns)
        elif not self.ready:
            self._task = task
            waiting = [True]

            def give_up(_: object) -> None:
                if waiting and not self.ready:
                    task.resume()

            world.schedule(deadline_ns - world.now_ns, give_up, None, Rank.TIMER)
            task.pause()
            waiting.clear()
            self._task = None
        return self._value


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
        self.presence = Presence(self)
        self._busy = Range(conditions.busy_s, self.random)
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
        self._last_stamp_ns = max(self.now_ns, self._last_stamp_ns + 1)
        return self._last_stamp_ns

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
        for due_ns in self.network.message(link, self.now_ns, is_lossy, behind):
            self._plan(due_ns, event, argument)

    def send_to_tap(self, link: Link, event: Event, argument: Any) -> None:
        """The same for what a tap receives, which may be lost or doubled."""
        for due_ns in self.network.observation(link, self.now_ns):
            self._plan(due_ns, event, argument)

    def busy_ns(self) -> int:
        """How long the next piece of work keeps its node busy."""
        return self._busy.draw()

    def _plan(self, due_ns: int, event: Event, argument: Any) -> None:
        self._order += 1
        heapq.heappush(self._queue, (due_ns, self._order, event, argument))

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
        from transports.simulated.transport import SimulatedTransport

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

        It is what a tap would receive that hears all from the beginning, at once, by the world's own clock
        and from nodes that number all that they do. The nodes do not know of it.
        """
        self.routes.witnesses.append(handler)

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
