"""The lab tour, shown: models checked, nodes generated, the system run on Zenoh and tapped live.

Run by `make demo`. Ends by itself with a summary; exit code 0 if the tour went as it should.
"""

from __future__ import annotations

import collections
import contextlib
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
TICKS = 125
"""25 s at the system's five ticks a second: a whole tour, and the battery below 30 %."""
BIN = Path(sys.executable).parent
QUIET = ("/policy/ticks", "/feedback", "/status", "/tick", "/BlackboardComponent/GetInt")
"""Ends of channels that are counted but not shown: there are a hundred of them a second."""


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


class Story:
    """What the tap heard: counted, and told where it matters."""

    def __init__(self) -> None:
        self.lines = 0
        self.kinds: collections.Counter[str] = collections.Counter()
        self.trips_us: list[float] = []
        self.visited: list[int] = []
        self.milestones: list[str] = []
        self.leaves: set[str] = set()
        self._alarm = False

    def hear(self, line: dict[str, Any]) -> None:
        """Take one line of the tap."""
        self.lines += 1
        self.kinds[line["kind"]] += 1
        channel, data = line["channel"], line.get("data") or {}
        if channel.endswith("/tick") and line.get("round_trip_us"):
            self.trips_us.append(line["round_trip_us"])
        self._notice(channel, line["kind"], data)
        if not channel.endswith(QUIET):
            text = ", ".join(f"{key}: {value}" for key, value in data.items() if key != "goal_id")
            arrow = {"message": "•", "request": "→", "response": "←"}.get(line["kind"], "✗")
            print(f"    tap  {channel:<44} {arrow} {text}"[:118], flush=True)

    def _notice(self, channel: str, kind: str, data: dict[str, Any]) -> None:
        if channel == "/policy/ticks":
            for leaf in data["leaves"]:
                if leaf["status"] != "FAILURE":
                    self._once(leaf["name"])
        elif channel == "/BlackboardComponent/SetInt" and kind == "request" and data["value"] == 1:
            self.visited.append(data["key"])
            self.tell(f"point of interest {data['key']} visited")
        elif channel == "/NotifyUserComponent/alarm" and data["data"] and not self._alarm:
            self._alarm = True
            self.tell("battery below 30 %: the user was alarmed")

    def _once(self, leaf: str) -> None:
        if leaf not in self.leaves:
            self.leaves.add(leaf)
            if leaf == "Wait":
                self.tell("the visitors fell behind: the robot waits, its drive is canceled")
            elif leaf == "Reset":
                self.tell("both points visited: the tour starts anew")

    def tell(self, text: str) -> None:
        """A milestone."""
        self.milestones.append(text)
        print(f"  ★ {text}", flush=True)

    @property
    def missing(self) -> list[str]:
        """What a complete tour has and this one did not."""
        wanted = {
            "point of interest 1": 1 in self.visited,
            "point of interest 2": 2 in self.visited,
            "waiting for visitors": "Wait" in self.leaves,
            "the alarm": self._alarm,
            "the reset": "Reset" in self.leaves,
        }
        return [name for name, seen in wanted.items() if not seen]


def main() -> int:
    """Run the demo."""
    heading("1. Check the models")
    step("m2c", "check", "--strict", str(SYSTEM))
    with tempfile.TemporaryDirectory(prefix="lab-tour-") as scratch:
        heading("2. Generate the nodes")
        step("m2c", "generate", "--transport", "zenoh", str(SYSTEM), "-o", scratch)
        heading(f"3. Run the tour on Zenoh for {TICKS} ticks, tapped live")
        story, tap_notes, code = run_tapped(scratch)
    heading("Summary")
    for text in story.milestones:
        print(f"  ★ {text}")
    linked = [int(note.split()[2]) for note in tap_notes if note.startswith("linked to")]
    print(f"  the tap was linked to {max(linked, default=0)} nodes, and none of them waited for it")
    counts = ", ".join(f"{count} {kind}s" for kind, count in sorted(story.kinds.items()))
    print(f"  it heard {story.lines} events: {counts}")
    if story.trips_us:
        middle = statistics.median(story.trips_us)
        print(
            f"  a tick of a skill took {middle:,.0f} µs (median of {len(story.trips_us)}, tapped);"
        )
        print("  the paper's monitors in the middle add 50,000 to 310,000 µs")
    if story.missing or code:
        print(f"  NOT complete: {', '.join(story.missing) or f'm2c run exited with {code}'}")
        return 1
    print("  the tour was complete")
    return 0


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
