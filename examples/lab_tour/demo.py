"""The lab tour, shown: what monitoring finds and costs, and a tour on Zenoh, tapped live.

Run by `make demo`; `make demo TAP=1` shows what the tap hears, too. Models are checked, nodes generated
and run; then the result is shown, in one screen. Exit code 0: the tour was complete, each fault found.
"""

from __future__ import annotations

import argparse
import contextlib
import enum
import functools
import json
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import textwrap
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TextIO

ROOT = Path(__file__).parents[2]
SYSTEM = "examples/lab_tour/system.xml"
"""From ROOT, as all that is run here."""
TICKS = 125
"""25 s at the system's five ticks a second: a whole tour, about 21 s, and the start of the next."""
STEPS = 7
SHORT = 50
"""Characters of a command before what it says, on a terminal."""
BIN = Path(sys.executable).parent
FAULT = "AlarmSkill=examples/lab_tour/faults/T4-AlarmSkill.scxml"
"""Whose run is shown as a page: the skill answers, and alarms nobody."""
MADE = Path("build/demo")
"""The folder of what the demo leaves."""
QUIET = ("/policy/ticks", "/feedback", "/status", "/tick", "/BlackboardComponent/GetInt")
"""Ends of channels that are counted but not shown: there are a hundred of them a second."""
BOOKKEEPING = ("goal_id", "goal_info", "goals_canceling", "stamp", "return_code")
"""Fields that are not shown."""


class StepError(Exception):
    """A command of the demo failed; the text is what it said."""


class Progress:
    """What is being done: one line that is overwritten on a terminal, elsewhere a line for each step.

    Args:
        stream: where to say it.
        overwrites: whether each line takes the place of the one before it.
    """

    def __init__(self, stream: TextIO, *, overwrites: bool) -> None:
        self._stream = stream
        self._overwrites = overwrites
        self._steps = 0
        self._step = ""

    def step(self, command: str) -> None:
        """The next step begins."""
        self._steps += 1
        self._step = f"[{self._steps}/{STEPS}] {command}"
        if self._overwrites:
            self._show(self._step)
        else:
            print(self._step, file=self._stream, flush=True)

    def detail(self, text: str) -> None:
        """What the step has come to, for who watches."""
        if self._overwrites:
            self._show(f"{self._step[:SHORT]}: {text.strip()}")

    def done(self) -> None:
        """Nothing is being done any more: the line is cleared."""
        if self._overwrites:
            self._show("")

    def _show(self, text: str) -> None:
        width = shutil.get_terminal_size().columns - 1
        self._stream.write(f"\r\x1b[2K{text[:width]}")
        self._stream.flush()


class Ran(NamedTuple):
    """A command that was run: its exit code, and the lines that it printed."""

    code: int
    lines: list[str]


def run_step(progress: Progress, *command: str, may_find: bool = False) -> Ran:
    """Run a command of the project as a person would type it.

    Args:
        progress: is told.
        command: m2c, moon or python, and its arguments.
        may_find: whether exit code 1, something was found, is no failure.

    Raises:
        StepError: it failed.
    """
    progress.step(shlex.join(command))
    lines: list[str] = []
    with (
        tempfile.TemporaryFile("w+") as said,
        subprocess.Popen(
            [str(BIN / command[0]), *command[1:]],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
        ) as running,
    ):
        assert running.stdout is not None
        for line in running.stdout:
            lines.append(line.rstrip("\n"))
            progress.detail(lines[-1])
        if running.wait() not in ((0, 1) if may_find else (0,)):
            said.seek(0)
            text = "\n".join([f"$ {shlex.join(command)}", *lines, said.read().rstrip()])
            raise StepError(text)
    return Ran(running.returncode, lines)


def free_endpoint() -> str:
    """A loopback endpoint that nobody uses at the moment."""
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class Milestone(enum.Enum):
    """What a complete tour has, in the words of the summary; the reset ends it."""

    POI_1 = "point of interest 1 visited"
    POI_2 = "point of interest 2 visited"
    WAIT = "the visitors fell behind: the robot waits, its drive is canceled"
    ALARM = "battery below 30 %: the user was alarmed"
    RESET = "both points visited: the tour starts anew"


class Story:
    """What the tap heard: counted, and told where it matters.

    Args:
        tell: is given what happens, a line each.
        is_full: whether that is all that is new, and not only the milestones.
    """

    def __init__(self, tell: Callable[[str], None] = print, *, is_full: bool = False) -> None:
        self.lines = 0
        self.reached: dict[Milestone, float] = {}
        """Seconds from the first tick of the tree to the first time of each milestone."""
        self._say = tell
        self._is_full = is_full
        self._first_tick_ns = 0
        self._last: dict[tuple[str, str], str] = {}

    def hear(self, line: dict[str, Any]) -> None:
        """Take one line of the tap."""
        self.lines += 1
        channel, data = line["channel"], line.get("data") or {}
        self._notice(channel, line["kind"], data, line["stamp_ns"])
        text = ", ".join(f"{key}: {json.dumps(value)}" for key, value in plain(data).items())
        is_quiet = not self._is_full or channel.endswith(QUIET)
        if not is_quiet and self._is_news(channel, line["kind"], text):
            arrow = {"message": "•", "request": "→", "response": "←"}.get(line["kind"], "✗")
            self._say(f"    tap  {channel:<50} {arrow} {text}".rstrip())

    def _is_news(self, channel: str, kind: str, text: str) -> bool:
        """Whether to show this: a reactive tree asks the same thing again at every tick."""
        before, self._last[channel, kind] = self._last.get((channel, kind)), text
        return before != text or "/_action/" in channel or channel.endswith("/halt")

    def _notice(self, channel: str, kind: str, data: dict[str, Any], stamp_ns: int) -> None:
        if channel == "/policy/ticks":
            self._first_tick_ns = self._first_tick_ns or stamp_ns
            acting = {leaf["name"] for leaf in data["leaves"] if leaf["status"] != "FAILURE"}
            if "Wait" in acting:
                self._tell(Milestone.WAIT, stamp_ns)
            if "Reset" in acting:
                self._tell(Milestone.RESET, stamp_ns)
        elif channel == "/BlackboardComponent/SetInt" and kind == "request" and data["value"] == 1:
            visited = Milestone.POI_1 if data["key"] == 1 else Milestone.POI_2
            self._tell(visited, stamp_ns)
        elif channel == "/NotifyUserComponent/alarm" and data["data"]:
            self._tell(Milestone.ALARM, stamp_ns)

    def _tell(self, milestone: Milestone, stamp_ns: int) -> None:
        if milestone not in self.reached:
            self.reached[milestone] = (stamp_ns - self._first_tick_ns) / 1e9
            self._say(f"  {self.told(milestone)}")

    def told(self, milestone: Milestone) -> str:
        """A milestone that was reached, and when."""
        return f"★ {self.reached[milestone]:5.1f} s  {milestone.value}"

    @property
    def missing(self) -> list[str]:
        """What a complete tour has and this one did not have before it started anew."""
        ended = self.reached.get(Milestone.RESET, 0.0)
        return [
            milestone.value
            for milestone in Milestone
            if self.reached.get(milestone, float("inf")) > ended
        ]


def plain(data: dict[str, Any]) -> dict[str, Any]:
    """The fields that a person reads: without identifiers and stamps of goals."""
    return {key: value for key, value in data.items() if key not in BOOKKEEPING}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="The lab tour: run, tapped, broken, measured.")
    parser.add_argument("--tap", action="store_true", help="show what the tap hears, too")
    shows_tap = parser.parse_args(arguments).tap
    progress = Progress(sys.stderr, overwrites=sys.stderr.isatty() and not shows_tap)
    told = functools.partial(print, flush=True) if shows_tap else progress.detail
    story = Story(told, is_full=shows_tap)
    try:
        with tempfile.TemporaryDirectory(prefix="lab-tour-") as scratch:
            run_step(progress, "m2c", "check", "--strict", SYSTEM)
            run_step(progress, "m2c", "generate", "--transport", "zenoh", SYSTEM, "-o", scratch)
            nodes, code = run_tapped(scratch, story, progress)
        faults = ("examples/lab_tour/faults/run.py", "--transport", "simulated", "--brief")
        found = run_step(progress, "python", *faults, may_find=True)
        costs = run_step(progress, "python", "-m", "examples.overhead", "--summary")
        report = make_report(progress)
    except StepError as error:
        progress.done()
        print(error)
        return 1
    progress.done()
    show(found.lines[0], found.lines[1:])
    show("What monitoring costs, on Zenoh", costs.lines)
    complete = f"the tour was complete; {story.lines} events of {nodes} nodes were tapped"
    wrong = "; ".join(story.missing) or (f"m2c run exited with {code}" if code else "")
    milestones = sorted(story.reached, key=story.reached.__getitem__)
    ended = f"NOT complete: {wrong}" if wrong else complete
    show(
        "The tour, run on Zenoh (all that its tap hears: make demo TAP=1)",
        [*map(story.told, milestones), ended],
    )
    print(f"The report of T4, for a browser: {from_here(report)}")
    print(f"A system of your own: . {from_here(BIN / 'activate')} && m2c new my_robot")
    print("The way there, in an hour: docs/tutorial/README.md")
    return 1 if found.code or wrong else 0


def show(title: str, lines: Sequence[str]) -> None:
    """A part of the result; what is too long for the terminal goes on below."""
    width = shutil.get_terminal_size((100, 24)).columns
    print(f"\033[1m{title}\033[0m" if sys.stdout.isatty() else title)
    for line in lines:
        print(textwrap.fill(line, width, initial_indent="  ", subsequent_indent="    "))


def from_here(path: Path) -> Path:
    """``path`` as a person types it."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def make_report(progress: Progress) -> Path:
    """Record the tour with a fault, in virtual time; the page of what is found in it."""
    (ROOT / MADE).mkdir(parents=True, exist_ok=True)
    run, report = str(MADE / "run.mcap"), str(MADE / "report.html")
    (ROOT / run).unlink(missing_ok=True)  # of the demo before
    how = ("--transport", "simulated", "--ticks", str(TICKS), "--quiet")
    run_step(progress, "m2c", "run", SYSTEM, *how, "--replace", FAULT, "--record", run)
    run_step(progress, "moon", "check", run, SYSTEM, "--report", report, may_find=True)
    return ROOT / report


def run_tapped(folder: str, story: Story, progress: Progress) -> tuple[int, int]:
    """Run the system with a tap; to how many nodes that was linked, and the run's exit code."""
    endpoint = free_endpoint()
    notes: list[str] = []
    progress.step(f"m2c run {folder} --ticks {TICKS} --quiet & moon tap --json")
    command = [str(BIN / "m2c"), "run", folder, "--ticks", str(TICKS), "--quiet"]
    running = subprocess.Popen(
        [*command, "--endpoint", endpoint], stdout=subprocess.PIPE, text=True
    )
    assert running.stdout is not None
    tap: subprocess.Popen[str] | None = None
    threads: list[threading.Thread] = []
    try:
        for text in running.stdout:
            progress.detail(text.rstrip("\n"))
            if tap is None:
                tap = subprocess.Popen(
                    [str(BIN / "moon"), "tap", "--json", "--endpoint", endpoint],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                )
                threads = [
                    threading.Thread(target=_hear, args=(tap, story)),
                    threading.Thread(target=_note, args=(tap, notes)),
                ]
                for thread in threads:
                    thread.start()
        code = running.wait()
    finally:
        running.terminate()
        if tap is not None:
            tap.send_signal(signal.SIGINT)
            for thread in threads:
                thread.join()
            tap.wait()
    linked = [int(note.split()[2]) for note in notes if note.startswith("linked to")]
    return max(linked, default=0), code


def _hear(tap: subprocess.Popen[str], story: Story) -> None:
    assert tap.stdout is not None
    for line in tap.stdout:
        story.hear(json.loads(line))


def _note(tap: subprocess.Popen[str], notes: list[str]) -> None:
    assert tap.stderr is not None
    notes += [line.rstrip("\n") for line in tap.stderr]


if __name__ == "__main__":
    sys.exit(main())
