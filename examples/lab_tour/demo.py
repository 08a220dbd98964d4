"""The lab tour, shown: models checked, nodes generated, the system run on Zenoh and tapped live.

Run by `make demo`. Ends by itself with a summary; exit code 0 if the tour went as it should.
"""

from __future__ import annotations

import collections
import contextlib
import enum
import json
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

SYSTEM = Path(__file__).parent / "system.xml"
FAULTS = Path(__file__).parent / "faults" / "run.py"
TICKS = 125
"""25 s at the system's five ticks a second: a whole tour, about 21 s, and the start of the next."""
BIN = Path(sys.executable).parent
QUIET = ("/policy/ticks", "/feedback", "/status", "/tick", "/BlackboardComponent/GetInt")
"""Ends of channels that are counted but not shown: there are a hundred of them a second."""
BOOKKEEPING = ("goal_id", "goal_info", "goals_canceling", "stamp", "return_code")
"""Fields that are not shown."""


def heading(text: str) -> None:
    """A title for the next part of the demo."""
    print(f"\n\033[1m{text}\033[0m" if sys.stdout.isatty() else f"\n{text}", flush=True)


def step(*command: str) -> None:
    """Run one command of m2c, shown as a person would type it; its failure ends the demo."""
    shown = " ".join(command)
    print(f"$ {shown}", flush=True)
    began = time.perf_counter()
    subprocess.run([str(BIN / command[0]), *command[1:]], check=True)
    print(f"  ({time.perf_counter() - began:.2f} s)", flush=True)


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
    """What the tap heard: counted, and told where it matters."""

    def __init__(self) -> None:
        self.lines = 0
        self.kinds: collections.Counter[str] = collections.Counter()
        self.trips_us: list[float] = []
        self.reached: dict[Milestone, float] = {}
        """Seconds from the first tick of the tree to the first time of each milestone."""
        self._first_tick_ns = 0
        self._last: dict[tuple[str, str], str] = {}

    def hear(self, line: dict[str, Any]) -> None:
        """Take one line of the tap."""
        self.lines += 1
        self.kinds[line["kind"]] += 1
        channel, data = line["channel"], line.get("data") or {}
        if channel.endswith("/tick") and line.get("round_trip_us"):
            self.trips_us.append(line["round_trip_us"])
        self._notice(channel, line["kind"], data, line["stamp_ns"])
        text = ", ".join(f"{key}: {json.dumps(value)}" for key, value in plain(data).items())
        if not channel.endswith(QUIET) and self._is_news(channel, line["kind"], text):
            arrow = {"message": "•", "request": "→", "response": "←"}.get(line["kind"], "✗")
            print(f"    tap  {channel:<50} {arrow} {text}".rstrip(), flush=True)

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
            print(self.told(milestone), flush=True)

    def told(self, milestone: Milestone) -> str:
        """A milestone that was reached, and when."""
        return f"  ★ {self.reached[milestone]:5.1f} s  {milestone.value}"

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


def main() -> int:
    """Run the demo."""
    heading("1. Check the models")
    step("m2c", "check", "--strict", str(SYSTEM))
    with tempfile.TemporaryDirectory(prefix="lab-tour-") as scratch:
        heading("2. Generate the nodes")
        step("m2c", "generate", "--transport", "zenoh", str(SYSTEM), "-o", scratch)
        heading(
            f"3. Run the tour on Zenoh for {TICKS} ticks, tapped live; repeated values are not shown"
        )
        story, tap_notes, code = run_tapped(scratch)
    heading(
        "4. Put the paper's six faults in, one at a time: every model is monitored, in virtual time"
    )
    found = find_faults()
    heading("5. Measure what monitoring costs: a short part of examples/overhead, on Zenoh")
    costs = measure_costs()
    heading("Summary")
    for milestone in sorted(story.reached, key=story.reached.__getitem__):
        print(story.told(milestone))
    linked = [int(note.split()[2]) for note in tap_notes if note.startswith("linked to")]
    print(f"  the tap was linked to {max(linked, default=0)} nodes, and none of them waited for it")
    counts = ", ".join(f"{count} {kind}s" for kind, count in sorted(story.kinds.items()))
    print(f"  it received {story.lines} events: {counts}")
    if story.trips_us:
        middle = statistics.median(story.trips_us)
        print(
            f"  a tick of a skill took {middle:,.0f} µs (median of {len(story.trips_us)}, tapped);"
        )
        print("  the paper's monitors in the middle add 50,000 to 310,000 µs")
    for line in costs:
        print(f"  {line}")
    print(f"  the paper's faults: {'6 of 6 found, no false alarm' if found else 'NOT all found'}")
    if not found:
        return 1
    if story.missing or code:
        print(f"  NOT complete: {'; '.join(story.missing) or f'm2c run exited with {code}'}")
        return 1
    print(f"  the tour was complete: {story.reached[Milestone.RESET]:.0f} s, none of it missing")
    return 0


def find_faults() -> bool:
    """Run the six faults with all models monitored; whether each was found where it is."""
    print(f"$ python {FAULTS} --transport simulated", flush=True)
    command = [sys.executable, str(FAULTS), "--transport", "simulated"]
    return subprocess.run(command, stderr=subprocess.DEVNULL, check=False).returncode == 0


def measure_costs() -> list[str]:
    """Three lines on what monitoring costs a tick; what went wrong, if it could not be measured."""
    print("$ python -m examples.overhead --summary", flush=True)
    command = [sys.executable, "-m", "examples.overhead", "--summary"]
    done = subprocess.run(
        command, cwd=SYSTEM.parents[2], capture_output=True, text=True, check=False
    )
    return (done.stdout if done.returncode == 0 else done.stderr).splitlines()[-3:]


def run_tapped(folder: str) -> tuple[Story, list[str], int]:
    """Run the system with a tap; what was heard, what the tap said, the run's exit code."""
    endpoint = free_endpoint()
    story = Story()
    notes: list[str] = []
    print(f"$ m2c run {folder} --ticks {TICKS} --quiet & moon tap --json", flush=True)
    command = [str(BIN / "m2c"), "run", folder, "--ticks", str(TICKS), "--quiet"]
    running = subprocess.Popen(
        [*command, "--endpoint", endpoint], stdout=subprocess.PIPE, text=True
    )
    assert running.stdout is not None
    tap: subprocess.Popen[str] | None = None
    threads: list[threading.Thread] = []
    try:
        for text in running.stdout:
            print(f"  run  {text}", end="", flush=True)
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
    return story, notes, code


def _hear(tap: subprocess.Popen[str], story: Story) -> None:
    assert tap.stdout is not None
    for line in tap.stdout:
        story.hear(json.loads(line))


def _note(tap: subprocess.Popen[str], notes: list[str]) -> None:
    assert tap.stderr is not None
    notes += [line.rstrip("\n") for line in tap.stderr]


if __name__ == "__main__":
    sys.exit(main())
