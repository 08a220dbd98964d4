"""What a running system shows: lines of its processes, and its tree ticking.

On a terminal the tree is a picture that stays in place below the lines; elsewhere each tick is a
line.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Protocol

from m2c.policy.program import Policy
from m2c.policy.runner import TreeTick
from m2c.printable import printable
from m2c.terminal import show

if TYPE_CHECKING:
    from rich.console import Console

    from m2c.launch.picture import TreePicture

_MARKS = {"SUCCESS": "ok", "FAILURE": "no", "RUNNING": "..", "HALTED": "halted"}

REFRESHES_PER_S = 10
"""How often the picture is drawn; ticks in between are counted, not drawn."""


class Screen(Protocol):
    """Where a running system is shown; callable from any thread."""

    def line(self, text: str) -> None:
        """Show one line."""
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

    def tick(self, tick: TreeTick) -> None:
        """Show one tick of the tree, unless quiet."""
        if not self._quiet:
            self.line(f"tick {tick.tick:4d}  {tick.status:<7}  {ticked_leaves(tick)}")


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
    policy: Policy | None, quiet: bool, console: Console | None = None
) -> Iterator[Screen]:
    """The picture of ``policy`` if standard output is a terminal, lines otherwise or if ``quiet``.

    Args:
        policy: the tree to draw; None: there is none.
        quiet: do not show ticks.
        console: where to draw; standard output by default.
    """
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

    def tick(self, tick: TreeTick) -> None:
        self._picture.show(tick)
