"""The ``moon tap`` command."""

from __future__ import annotations

import fnmatch
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import click

KINDS = ("message", "request", "response", "unanswered")
UNANSWERED_AFTER_S = 10.0
"""A request without a response is shown as unanswered after this long."""
REFRESH_S = 1.0


@click.command()
@click.argument("channels", nargs=-1)
@click.option("--transport", default="zenoh", show_default=True, help="The middleware.")
@click.option("--endpoint", multiple=True, help="Where to connect, e.g. tcp/127.0.0.1:7447.")
@click.option(
    "--zenoh-config", type=click.Path(path_type=Path, exists=True), help="Zenoh configuration file."
)
@click.option("--namespace", default="", help="Prefix of every channel.")
@click.option("--node", multiple=True, help="Only what this node sends, asks or answers (glob).")
@click.option("--kind", multiple=True, type=click.Choice(KINDS), help="Only this kind of event.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line, for pipes.")
@click.option("--stats", is_flag=True, help="Rates and latencies per channel instead of a stream.")
@click.option("--for", "seconds", type=float, help="Stop after this many seconds.")
@click.option("--count", type=int, help="Stop after this many lines.")
def tap(
    channels: tuple[str, ...],
    transport: str,
    endpoint: tuple[str, ...],
    zenoh_config: Path | None,
    namespace: str,
    node: tuple[str, ...],
    kind: tuple[str, ...],
    as_json: bool,
    stats: bool,
    seconds: float | None,
    count: int | None,
) -> None:
    """Watch everything that happens: topics, service calls, actions; decoded and matched.

    CHANNELS are globs such as '/BatteryLevelSkill/*'; without any, everything is shown. A response
    is shown with its round-trip time. The tap is passive: no node waits for it or knows of it.

    Example: moon tap '/NavigationComponent/**' --endpoint tcp/127.0.0.1:7447
    """
    from transports.interface import TransportError
    from transports.registry import connect

    options = {
        "endpoint": ",".join(endpoint),
        "config": str(zenoh_config) if zenoh_config is not None else "",
        "namespace": namespace,
    }
    options = {name: value for name, value in options.items() if value}
    try:
        connection = connect(transport, f"moon_tap_{os.getpid()}", options)
    except TransportError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(2)
    shown = _Shown(channels, node, kind, as_json, stats, count, connection.close)
    try:
        listener = connection.tap([], shown.observe)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: connection.post(connection.close))
        problems: set[str] = set()

        def look_around() -> None:
            shown.refresh(connection.now_ns())
            for problem in listener.problems():
                if problem not in problems:
                    problems.add(problem)
                    click.echo(f"warning: {problem}", err=True)
            peers = tuple(sorted(listener.peers()))
            if peers != shown.peers:
                shown.peers = peers
                click.echo(
                    f"linked to {len(peers)} nodes: {', '.join(peers) or 'none yet'}", err=True
                )

        connection.every(REFRESH_S, look_around)
        if seconds is not None:
            connection.after(seconds, connection.close)
        connection.spin()
        shown.refresh(connection.now_ns())
        shown.finish()
        listener.close()
    except TransportError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(2)
    except BrokenPipeError:
        # whoever read the pipe has gone; nothing more can be said on it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        connection.close()


class _Shown:
    """Filters what was heard and prints it."""

    def __init__(
        self,
        channels: tuple[str, ...],
        nodes: tuple[str, ...],
        kinds: tuple[str, ...],
        as_json: bool,
        stats: bool,
        count: int | None,
        stop: Callable[[], None],
    ) -> None:
        import msgspec

        from moon.tap.render import Renderer
        from moon.tap.statistics import Statistics
        from moon.tap.stream import CallMatcher

        self._channels = channels
        self._nodes = nodes
        self._kinds = kinds
        self._as_json = as_json
        self._stats = stats
        self._left = count
        self._stop = stop
        self._matcher = CallMatcher()
        self._renderer = Renderer(sys.stdout.isatty())
        self._statistics = Statistics()
        self._encode = msgspec.json.Encoder().encode
        self._drawn = 0
        self.peers: tuple[str, ...] = ()

    def observe(self, seen):  # type: ignore[no-untyped-def]
        line = self._matcher.feed(seen)
        if line is not None:
            self._show(line)

    def _matches(self, line) -> bool:  # type: ignore[no-untyped-def]
        if self._kinds and line.kind not in self._kinds:
            return False
        if self._channels and not any(matches(line.channel, glob) for glob in self._channels):
            return False
        nodes = (line.source, line.client)
        return not self._nodes or any(
            fnmatch.fnmatchcase(name, glob) for name in nodes for glob in self._nodes
        )

    def _show(self, line) -> None:  # type: ignore[no-untyped-def]
        if not self._matches(line) or self._left == 0:
            return
        if self._stats:
            self._statistics.add(line)
        elif self._as_json:
            print(self._encode(line).decode(), flush=True)
        else:
            print(self._renderer.text(line), flush=True)
        if self._left is not None:
            self._left -= 1
            if self._left == 0:
                self._stop()

    def refresh(self, now_ns: int) -> None:
        """Show late calls, and the statistics anew."""
        for line in self._matcher.answered_unheard(now_ns):
            self._show(line)
        for line in self._matcher.unanswered(now_ns, UNANSWERED_AFTER_S):
            self._show(line)
        if self._stats and sys.stdout.isatty():
            self._draw()

    def _draw(self) -> None:
        from moon.tap.statistics import table

        lines = table(self._statistics)
        if self._drawn:
            print(f"\x1b[{self._drawn}A\x1b[J", end="")
        print("\n".join(lines), flush=True)
        self._drawn = len(lines)

    def finish(self) -> None:
        """The last table of statistics."""
        if self._stats:
            self._draw()


def matches(channel: str, glob: str) -> bool:
    """Whether ``channel`` matches ``glob``: ``*`` within one part of the name, ``**`` across parts."""
    import re

    pattern = "".join(
        ".*" if piece == "**" else "[^/]*" if piece == "*" else re.escape(piece)
        for piece in re.split(r"(\*\*|\*)", glob)
    )
    return re.fullmatch(pattern, channel) is not None
