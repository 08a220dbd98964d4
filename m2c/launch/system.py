"""Running a generated system: start every node, wait until all are up, run the policy, stop all."""

from __future__ import annotations

import functools
import os
import threading
import time
from collections import defaultdict
from pathlib import Path

import msgspec

from m2c.launch import composed
from m2c.launch.description import FILE, LaunchDescription, LaunchError
from m2c.launch.grouping import Group
from m2c.launch.log_files import LogFiles
from m2c.launch.process import (
    STOP_TIMEOUT_S,
    Module,
    NodeProcess,
    asked_by,
    describe_end,
    ended_well,
)
from m2c.launch.reloading import Models
from m2c.launch.restarts import MOST_RESTARTS, Restarts
from m2c.launch.router import NAME as ROUTER
from m2c.launch.router import Router
from m2c.launch.screen import Guarded, Said, Screen
from m2c.launch.watching import WATCHER
from m2c.logs import logged
from m2c.policy.runner import TreeTick
from m2c.suggestions import first_of
from m2c.watched import PERIOD_S
from transports.interface import Connection, Timer
from transports.stop_signals import ENDING, StopSignals
from transports.zenoh_link.refusals import Refusals

_RUN = "m2c run"
START_TIMEOUT_S = 30.0
"""How long the next node may take to be up; a machine under load starts twenty interpreters in it."""
STARTING = 2 * (os.cpu_count() or 1)
"""So many processes come up at a time. More would not be faster, and what listens to them from the start (a
monitor, say) would not get its turn beside them."""
FOUND_VIOLATIONS = 1
"""Its exit code when something was violated."""
LAST_TICK_S = 1.0
"""How long the policy's last reports may take when it has ended; a child of its own may hold them open."""


class RunSettings(msgspec.Struct, frozen=True):
    """How a system is run; see ``m2c run --help``.

    Attributes:
        groups: which nodes share a process.
        node_arguments: how each process finds its middleware.
        where: where they meet, in words.
        rate_hz: ticks a second; by default the system's.
        ticks: after how many to stop; 0: never.
        watcher: the command line of ``moon`` that watches the run from its beginning to its end, and of its
            connection.
        restart: whether a process that dies once all are up is started again; one that ends with exit code 0
            was told to, and is not.
        is_secure: whether each process has a certificate of its name.
        observers: nodes that observe the run beside ``watcher``, and are there before it.
        tick_timeout_s: how long a leaf may take to answer a tick; None: as long as the policy says itself.
        log_folder: where what nodes print is kept, too; None: nowhere.
    """

    groups: tuple[Group, ...]
    node_arguments: tuple[str, ...]
    where: str
    rate_hz: float | None = None
    ticks: int = 0
    watcher: tuple[str, ...] = ()
    restart: bool = False
    is_secure: bool = False
    observers: tuple[str, ...] = ()
    tick_timeout_s: float | None = None
    log_folder: Path | None = None


class RunningSystem:
    """All processes of one system.

    Args:
        description: what to run.
        folder: where the packages are.
        transport: the launcher's own connection, to hear who is up and how the tree ticks.
        settings: how to run it.
        screen: where it is shown.
        router: through which all talk, if it is this run's own.
        models: what is looked at while all run, and whose changed nodes are started again; None: nothing.
    """

    def __init__(
        self,
        description: LaunchDescription,
        folder: Path,
        transport: Connection,
        settings: RunSettings,
        screen: Screen,
        router: Router | None = None,
        models: Models | None = None,
    ) -> None:
        self._description = description
        self._folder = folder
        self._transport = transport
        self._settings = settings
        self._screen = Guarded(screen, self._cannot_show)
        self._logs = LogFiles(settings.log_folder)
        self._unshown: OSError | None = None
        """Why nothing can be shown."""
        self._router = router
        self._models = models
        self._replaced: set[str] = set()
        """The processes that were told to end as their nodes have changed, and are started again then."""
        self._processes: dict[str, NodeProcess] = {}
        self._died: tuple[str, str] | None = None
        """Which process died first and was not started again, and how."""
        self._groups = {group.name: group for group in settings.groups}
        self._group_of = {node.name: group for group in settings.groups for node in group.packages}
        """Who runs here; other nodes of the system run on other hosts."""
        self._dead_node: dict[str, str] = {}
        """Which node of a process that several share has said that it died."""
        self._restarts = Restarts()
        self._refusals: defaultdict[str, Refusals] = defaultdict(Refusals)
        self._ended_badly: dict[str, str] = {}
        """Who was told to end and did not do so well, and what happened instead."""
        self._killed = False
        self._stopping = False
        self._interrupted_by_signal = False
        self._ticks = 0
        self._reports: threading.Thread | None = None
        """Reads what the policy reports of its ticks."""
        self._missing = {node.name for node in description.nodes}
        self._present: set[str] = set()
        """The nodes that are up."""
        self._waiting = list(settings.groups)
        """The groups that were not started yet; the last is started next. System files usually list a node
        that acts by itself before the nodes that listen to it: so these are up before something happens."""
        self._timeout: Timer | None = None
        self._late = False
        self._elsewhere = ""
        """A node of ours that was up before, as somebody else's."""
        self._began_ns = transport.now_ns()
        self._up = False
        self._observer = ""
        """The node that watches the run, once it is ready."""
        self._violated = False
        """What watches the run says so as it ends."""
        self._width = max((len(name) for name in self._group_of), default=0)

    def run(self, signals: StopSignals) -> int:
        """Run to the end.

        Args:
            signals: what stops it.

        Returns:
            0 after the policy's last tick or Ctrl-C, 1 if a process died or did not end when it was told to.

        Raises:
            LaunchError: a node did not come up in time.
            OSError: a process cannot be started, or the screen cannot be written to.
        """
        transport = self._transport
        signals.call(self._interrupted, self._interrupted_again)
        nodes = len(self._description.nodes)
        here = sum(len(group.nodes) for group in self._settings.groups)
        counted = f"{here} of {nodes}" if here < nodes else str(nodes)
        self._screen.line(
            f"{self._description.system}: starting {counted} {'node' if nodes == 1 else 'nodes'} "
            f"{self._settings.where}"
        )
        transport.watch_nodes(self._changed)
        if self._router is not None:
            self._processes[ROUTER] = self._router.process
            self._router.follow(self._line, self._ended)
        try:
            if self._settings.watcher:
                self._start_watcher()
                self._wait_for_watcher()
            self._start_next()
            self._restart_timeout()
            transport.spin(lambda: self._is_enough() or not self._missing_here())
            self._cancel_timeout()
            if self._missing and not self._is_enough():
                self._screen.line(f"waiting for other hosts: {first_of(sorted(self._missing))}")
                transport.spin(lambda: self._is_enough() or not self._missing)
            if self._elsewhere:
                raise LaunchError(
                    f"{self._elsewhere} is up already {self._settings.where}: is the system running? "
                    "Another one needs a --namespace of its own"
                )
            if self._late:
                missing = ", ".join(sorted(self._missing_here()))
                raise LaunchError(
                    f"not up after {START_TIMEOUT_S:g} s: {missing}; their output is above"
                )
            if not self._stopping:
                self._note_up()
                if self._models is not None:
                    transport.every(PERIOD_S, self._look_at_models)
                transport.spin(lambda: self._stopping)
                if not self._interrupted_by_signal:
                    self._show_last_ticks()
        finally:
            self._stopping = True
            self._stop_all()
            self._logs.close()
        self._show_last_ticks()
        code = self._report()
        if self._unshown is not None and not self._interrupted_by_signal:
            raise self._unshown
        return code

    def _is_enough(self) -> bool:
        """Whether there is a reason not to wait for nodes any more."""
        return bool(self._stopping or self._late or self._elsewhere)

    def _missing_here(self) -> set[str]:
        return self._missing & self._group_of.keys()

    def _start_watcher(self) -> None:
        """What is to hear everything is there first."""
        ready, say_ready = os.pipe()
        try:
            self._processes[WATCHER] = NodeProcess(
                WATCHER,
                Module(
                    package=WATCHER,
                    folders=[self._folder],
                    arguments=[*self._settings.watcher, "--ready-fd", str(say_ready)],
                    files=[say_ready],
                ),
                self._line,
                self._ended,
            )
        finally:
            os.close(say_ready)

        def follow() -> None:
            with open(ready, "rb") as lines:
                if line := lines.readline():
                    node = line.decode().strip()
                    self._transport.post(functools.partial(self._watcher_is_ready, node))

        threading.Thread(target=follow, name="ready", daemon=True).start()

    def _watcher_is_ready(self, node: str) -> None:
        self._observer = node

    def _wait_for_watcher(self) -> None:
        self._restart_timeout()
        self._transport.spin(lambda: self._stopping or self._late or bool(self._observer))
        self._cancel_timeout()
        if self._late:
            raise LaunchError(f"{WATCHER} is not ready after {START_TIMEOUT_S:g} s")
        if self._died is not None and not self._observer:
            name, how = self._died
            raise LaunchError(f"{name} {how}; it says why above")

    def _changed(self, name: str, up: bool) -> None:
        (self._present.add if up else self._present.discard)(name)
        is_older = 0 < self._transport.up_since(name) < self._began_ns
        if up and is_older and name in self._group_of:
            self._elsewhere = name
        elif up and name in self._missing:
            self._missing.discard(name)
            if self._missing_here():
                self._restart_timeout()
                self._start_next()

    def _restart_timeout(self) -> None:
        self._cancel_timeout()
        self._timeout = self._transport.after(START_TIMEOUT_S, self._start_timed_out)

    def _cancel_timeout(self) -> None:
        if self._timeout is not None:
            self._timeout.cancel()
            self._timeout = None

    def _start_next(self) -> None:
        """Start as many processes as may come up at a time."""
        while self._waiting and not self._stopping:
            coming = {self._group_of[name].name for name in self._missing_here()}
            if len(coming - {group.name for group in self._waiting}) >= STARTING:
                return
            self._start(self._waiting.pop())

    def _look_at_models(self) -> None:
        """Start the nodes again whose models have changed."""
        assert self._models is not None
        reload = None if self._stopping or self._replaced else self._models.look()
        if reload is None:
            return
        self._screen.line(reload.said)
        for name in reload.nodes:
            group = self._group_of.get(name)
            if group is not None and self._processes[group.name].code is None:
                self._replaced.add(group.name)
                process = self._processes[group.name]
                process.terminate()
                self._transport.after(
                    STOP_TIMEOUT_S, functools.partial(self._kill_replaced, process)
                )

    def _kill_replaced(self, process: NodeProcess) -> None:
        if process.name in self._replaced and self._processes[process.name] is process:
            process.kill()

    def _replace(self, group: Group) -> None:
        """Its process has ended, as it was told to: start the changed node."""
        self._replaced.discard(group.name)
        if not self._stopping:
            self._start(group)
            self._transport.after(START_TIMEOUT_S, functools.partial(self._look_for, group))

    def _start_timed_out(self) -> None:
        self._late = True

    def _interrupted(self) -> None:
        """A signal: stop."""
        self._interrupted_by_signal = True
        self._transport.post(self._stop)

    def _interrupted_again(self, _: int) -> None:
        """A second one: do not wait for the processes."""
        self._killed = True
        for process in list(self._processes.values()):
            process.kill()
        self._interrupted()

    def _stop_all(self) -> None:
        """The policy first: it halts its tree, for which the skills must be there. What watches, last.

        The router is there until this process's own connection is closed, too.
        """
        if self._observer:
            self._processes[WATCHER].terminate(ENDING)
        first = [group.name for group in self._settings.groups if group.policy is not None]
        rest = [name for name in self._processes if name not in (*first, WATCHER, ROUTER)]
        for names in (first, rest, [WATCHER]):
            processes = [self._processes[name] for name in names if name in self._processes]
            for process in processes:
                process.terminate()
            deadline = time.monotonic() + STOP_TIMEOUT_S
            for process in processes:
                how = process.finish(deadline)
                if process.name == WATCHER and process.code == FOUND_VIOLATIONS:
                    self._violated = True
                elif how:
                    self._ended_badly[process.name] = how
                    self._note_stuck(process)

    def _note_stuck(self, process: NodeProcess) -> None:
        """Whose thread was at work in a process that did not end."""
        group, stuck = self._groups.get(process.name), process.stuck
        if group is not None and stuck is not None and stuck.number < len(group.packages):
            self._dead_node.setdefault(process.name, group.packages[stuck.number].name)

    def _start(self, group: Group) -> None:
        """Start the process of ``group``."""
        arguments = list(self._settings.node_arguments)
        report_to = None
        if group.policy is not None:
            reports, report_to = os.pipe()
            self._reports = threading.Thread(
                target=self._follow_ticks, args=[reports], name="ticks", daemon=True
            )
            self._reports.start()
            arguments += self._policy_arguments(report_to)
        files = [] if report_to is None else [report_to]
        if self._settings.is_secure:
            arguments += ["--identity", group.name]
        for observer in (*self._settings.observers, *filter(None, [self._observer])):
            arguments += ["--observer", observer]
        if any(node.is_replacement for node in group.nodes):
            arguments += ["--channels", str(self._folder / FILE)]
        folders = [self._folder / package.path for package in group.packages]
        if len(group.packages) == 1 and not group.packages[0].is_module:
            package = group.packages[0].package
            arguments += ["--node-name", group.packages[0].name]
        else:
            package = composed.__name__
            for node in group.nodes:
                arguments += ["--node", f"{node.name}={node.package}"]
            if group.policy is not None:
                arguments += ["--policy", f"{group.policy.name}={group.policy.package}"]
        try:
            self._processes[group.name] = NodeProcess(
                group.name,
                Module(package, folders, arguments, files, group.priority),
                self._line,
                self._ended,
            )
        finally:
            if report_to is not None:
                os.close(report_to)

    def _policy_arguments(self, report_to: int) -> list[str]:
        arguments = ["--rate", str(self._rate_hz()), "--report-to", str(report_to)]
        arguments += ["--wait-timeout", "0"]  # how long to wait is known here
        if self._settings.ticks:
            arguments += ["--ticks", str(self._settings.ticks)]
        if self._settings.tick_timeout_s is not None:
            arguments += ["--tick-timeout", str(self._settings.tick_timeout_s)]
        for node in self._description.nodes:
            arguments += ["--wait-for", node.name]
        return arguments

    def _rate_hz(self) -> float:
        return self._settings.rate_hz or self._description.tick_rate_hz

    def _note_up(self) -> None:
        """All are up, as was heard, or as the policy ticks: it waits for them, and may hear of them first."""
        if self._up:
            return
        self._up = True
        self._missing.clear()
        self._screen.line(f"{_nodes_are(self._description)} up")
        if self._reports is not None:
            self._screen.line(f"ticking the tree {self._rate_hz():g} times a second")

    def _follow_ticks(self, reports: int) -> None:
        with open(reports, "rb") as lines:
            for line in lines:
                tick = msgspec.json.decode(line, type=TreeTick)
                self._transport.post(functools.partial(self._show_tick, tick))

    def _line(self, name: str, text: str) -> None:
        node, separator, said = text.partition(composed.SEPARATOR)
        if separator and self._is_in(node, name):
            if said == composed.DIED:
                self._dead_node.setdefault(name, node)
        else:
            node, said = self._logged_by(text, name), text
        shown = self._refusals[name].instead(said)
        if shown is not None:
            line = Said(node, shown, time.time_ns())
            self._logs.write(line)
            self._screen.said(line, self._width)

    def _logged_by(self, text: str, process: str) -> str:
        """The node of ``process`` that logged ``text``, if that says so as in ROS 2; else the process."""
        by = logged(text)
        node = "" if by is None else by.logger.rpartition(".")[2]  # before it: its namespace
        return node if self._is_in(node, process) else process

    def _is_in(self, node: str, process: str) -> bool:
        group = self._group_of.get(node)
        return group is not None and group.name == process

    def _ended(self, name: str, code: int) -> None:
        """A process has ended: the policy's after its last tick, or anybody's by dying."""
        if self._stopping:
            return
        group = self._groups.get(name)
        has_policy = group is not None and group.policy is not None
        if group is not None and name in self._replaced:
            self._transport.post(functools.partial(self._replace, group))
            return
        by = asked_by(code)
        if by:
            self._screen.line(
                f"{self._who(name)} was asked to end by {by}, which {_RUN} did not send"
            )
        if not ended_well(code) and group is not None and not has_policy and self._settings.restart:
            self._transport.post(functools.partial(self._process_died, group, code))
            return
        if not (has_policy and code == 0):
            self._died = self._died or (name, describe_end(code))
        self._transport.post(self._stop)

    def _process_died(self, group: Group, code: int) -> None:
        """Start it again, unless it is one that does not come up, or that dies again and again."""
        if self._stopping:
            return
        how = describe_end(code)
        if not self._up:
            self._stop_for(group, how)
        elif not self._restarts.start(group.name, time.monotonic()):
            self._stop_for(group, f"{how}, started again {MOST_RESTARTS} times in a minute before")
        else:
            self._report_end(group.name, f"{how}; it is started again")
            self._dead_node.pop(group.name, None)
            self._start(group)
            self._transport.after(START_TIMEOUT_S, functools.partial(self._look_for, group))

    def _look_for(self, group: Group) -> None:
        """Whether a process that was started again is up: the time runs on if it dies once more."""
        missing = sorted({node.name for node in group.nodes} - self._present)
        if not self._stopping and missing:
            names = "" if len(group.nodes) == 1 else f" ({', '.join(missing)})"
            self._stop_for(
                group, f"was started again and is not up after {START_TIMEOUT_S:g} s{names}"
            )

    def _stop_for(self, group: Group, how: str) -> None:
        self._died = self._died or (group.name, how)
        self._stop()

    def _cannot_show(self, error: OSError) -> None:
        """A terminal that is gone, a full disk: nobody would see how it goes on."""
        self._unshown = error
        self._transport.post(self._stop)

    def _stop(self) -> None:
        self._stopping = True

    def _show_tick(self, tick: TreeTick) -> None:
        self._note_up()
        self._ticks = tick.tick
        self._screen.tick(tick)

    def _show_last_ticks(self) -> None:
        """What the policy has reported until its end."""
        if self._reports is None:
            return
        over = False

        def end() -> None:
            nonlocal over
            over = True

        self._reports.join(LAST_TICK_S)
        self._transport.post(end)
        self._transport.spin(lambda: over)

    def _report(self) -> int:
        if self._died is not None:
            name, how = self._died
            if name == WATCHER and self._processes[name].code == FOUND_VIOLATIONS:
                self._screen.line(f"{WATCHER} found a violation; everything was stopped")
                return 1  # --exit-on-violation
            self._report_end(name, f"{how}; everything was stopped")
            return 1
        if not self._up:
            stopped = "stopped before all nodes were up"
        else:
            ticks = "1 tick" if self._ticks == 1 else f"{self._ticks} ticks"
            stopped = "stopped" if self._reports is None else f"stopped after {ticks}"
        if self._killed:  # as was wished: by a second signal
            self._screen.line(f"{stopped}; nodes that had not ended yet were killed")
            return 0
        if not self._ended_badly:
            found = f"; {WATCHER} found violations" if self._violated else ""
            self._screen.line(f"{stopped}; all nodes have ended{found}")
            return 1 if self._violated else 0
        for name, how in self._ended_badly.items():
            self._report_end(name, f"{how} when everything was stopped")
        self._screen.line(f"{stopped}; not all nodes have ended well")
        return 1

    def _report_end(self, name: str, how: str) -> None:
        """Somebody's end, and what he said last."""
        last_lines = self._processes[name].last_lines
        said = "Its last lines:" if last_lines else "It had printed nothing."
        self._screen.line(f"{self._who(name)} {how}. {said}")
        for text in last_lines:
            self._screen.line(f"  {text}")

    def _who(self, name: str) -> str:
        """The process ``name``: who died in it if that is known, and who was in it, if several were."""
        group = self._groups.get(name)
        if group is None or len(group.packages) == 1:
            return name
        dead = self._dead_node.get(name)
        others = [package.name for package in group.packages if package.name != dead]
        return f"{dead or name} ({f'in {name}, ' if dead else ''}with {first_of(others)})"


def _nodes_are(description: LaunchDescription) -> str:
    count = len(description.nodes)
    return "1 node is" if count == 1 else f"{count} nodes are"
