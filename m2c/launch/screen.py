"""What a running system shows: lines of its processes, and its tree ticking.

On a terminal the tree is a picture that stays in place below the lines; elsewhere each tick is a
line. For programs everything is a line of JSON.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from m2c.json_lines import is_versioned, versioned_line
from m2c.launch.watching import WATCHER
from m2c.logs import logged
from m2c.policy.program import Policy
from m2c.policy.runner import TreeTick
from m2c.printable import printable
from m2c.terminal import show, show_painted

if TYPE_CHECKING:
    from rich.console import Console

    from m2c.launch.picture import TreePicture

_MARKS = {"SUCCESS": "ok", "FAILURE": "no", "RUNNING": "..", "HALTED": "halted"}

_NS = 10**9
REFRESHES_PER_S = 10
"""How often the picture is drawn; ticks in between are counted, not drawn."""


class Said(msgspec.Struct, frozen=True):
    """A line that a node has printed or logged.

    Attributes:
        node: its name, or that of a process.
        text: the line.
        stamp_ns: when, in ns since the epoch.
        is_virtual: whether that is virtual time, which is shown before the line.
    """

    node: str
    text: str
    stamp_ns: int
    is_virtual: bool = False

    def day(self) -> str:
        """Its date."""
        return time.strftime("%Y-%m-%d", time.localtime(self.stamp_ns // _NS))

    def clock(self) -> str:
        """Its time of day, to the microsecond."""
        clock = time.strftime("%H:%M:%S", time.localtime(self.stamp_ns // _NS))
        return f"{clock}.{self.stamp_ns % _NS // 1000:06d}"

    def shown(self, width: int) -> str:
        """The line behind the name, which is as wide as the longest is."""
        return f"{self.node:>{width}} | {f'{self.clock()} ' if self.is_virtual else ''}{self.text}"


class Screen(Protocol):
    """Where a running system is shown; callable from any thread."""

    def line(self, text: str) -> None:
        """Show one line, of the run itself."""
        ...

    def said(self, said: Said, width: int) -> None:
        """Show a line of a node; ``width`` is that of the longest name."""
        ...

    def tick(self, tick: TreeTick) -> None:
        """Show one tick of the tree."""
        ...


class Lines:
    """One line for everything, at once."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet

    def line(self, text: str) -> None:
        """Show one line."""
        show(text)

    def said(self, said: Said, width: int) -> None:
        """Show a line of a node."""
        show(said.shown(width))

    def tick(self, tick: TreeTick) -> None:
        """Show one tick of the tree, unless quiet."""
        if not self._quiet:
            self.line(f"tick {tick.tick:4d}  {tick.status:<7}  {ticked_leaves(tick)}")


class JsonLines:
    """An object a line, with the time and the kind of what happened (``event``).

    Args:
        quiet: no ticks.
        now_ns: the time, in ns since the epoch.
    """

    def __init__(self, quiet: bool, now_ns: Callable[[], int]) -> None:
        self._quiet = quiet
        self._now_ns = now_ns

    def line(self, text: str) -> None:
        """``run``: what happens to the run."""
        self._write("run", self._now_ns(), text=text)

    def said(self, said: Said, width: int) -> None:
        """``output``: a line of a node; what watches the run writes such objects itself."""
        if said.node == WATCHER and is_versioned(said.text):
            show_painted(said.text)
        else:
            by = logged(said.text)
            level = None if by is None else by.level
            self._write("output", said.stamp_ns, node=said.node, level=level, text=said.text)

    def tick(self, tick: TreeTick) -> None:
        """``tick``: one tick of the tree, unless quiet."""
        if not self._quiet:
            self._write("tick", self._now_ns(), **msgspec.to_builtins(tick))

    def _write(self, event: str, stamp_ns: int, **content: Any) -> None:
        fields = {"event": event, "stamp_ns": stamp_ns, **content}
        show_painted(versioned_line(fields).decode())


def ticked_leaves(tick: TreeTick) -> str:
    """The leaves that ``tick`` reached: ``BatteryLevel ok  IsPoiDone1 no  GoToPoi ..``."""
    return "  ".join(
        f"{leaf.name} {_MARKS[leaf.status]}" for leaf in tick.leaves if leaf.status in _MARKS
    )


class Guarded:
    """Another screen, until it cannot be written to; then nothing is shown any more.

    Args:
        screen: the other one.
        failed: told once, on whatever thread showed something.
    """

    def __init__(self, screen: Screen, failed: Callable[[OSError], None]) -> None:
        self._screen: Screen | None = screen
        self._failed = failed

    def line(self, text: str) -> None:
        """Show one line."""
        self._show(lambda screen: screen.line(text))

    def said(self, said: Said, width: int) -> None:
        """Show a line of a node."""
        self._show(lambda screen: screen.said(said, width))

    def tick(self, tick: TreeTick) -> None:
        """Show one tick of the tree."""
        self._show(lambda screen: screen.tick(tick))

    def _show(self, show: Callable[[Screen], None]) -> None:
        screen = self._screen
        if screen is None:
            return
        try:
            show(screen)
        except OSError as error:
            self._screen = None
            self._failed(error)


@contextlib.contextmanager
def screen_for(
    policy: Policy | None,
    quiet: bool,
    console: Console | None = None,
    *,
    as_json: bool = False,
    now_ns: Callable[[], int] = time.time_ns,
) -> Iterator[Screen]:
    """The picture of ``policy`` if standard output is a terminal, lines otherwise or if ``quiet``.

    Args:
        policy: the tree to draw; None: there is none.
        quiet: do not show ticks.
        console: where to draw; standard output by default.
        as_json: an object a line.
        now_ns: the time that objects have.
    """
    if as_json:
        yield JsonLines(quiet, now_ns)
        return
    if policy is None or quiet or (console is None and not sys.stdout.isatty()):
        yield Lines(quiet)
        return
    from rich.console import Console
    from rich.live import Live

    from m2c.launch.picture import TreePicture

    picture = TreePicture(policy)
    console = console or Console()
    live = Live(get_renderable=picture.render, console=console, refresh_per_second=REFRESHES_PER_S)
    live.start()
    try:
        yield _Picture(picture, live.console)
    finally:
        with contextlib.suppress(OSError):  # a terminal that is gone need not look as it did before
            live.stop()


class _Picture:
    def __init__(self, picture: TreePicture, console: Console) -> None:
        self._picture = picture
        self._console = console

    def line(self, text: str) -> None:
        from rich.text import Text

        self._console.print(Text(printable(text)), soft_wrap=True)

    def said(self, said: Said, width: int) -> None:
        self.line(said.shown(width))

    def tick(self, tick: TreeTick) -> None:
        self._picture.show(tick)
