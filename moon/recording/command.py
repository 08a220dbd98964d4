"""The ``moon record`` command."""

from __future__ import annotations

import contextlib
import functools
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from m2c.inputs import DecimalRange, interface_folders, options_as
from m2c.printable import printable
from m2c.terminal import fail, say
from moon.connection import (
    Network,
    Watching,
    connected,
    library_in,
    network_options,
    ready_option,
    say_ready,
    system_beside,
    when_ending,
)

if TYPE_CHECKING:
    from moon.recording.definitions import Definitions
    from moon.recording.writer import RecordingWriter, Split

_SIZES = {"kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_TIMES = {"s": 1, "min": 60, "h": 3600}
_AMOUNT = re.compile(r"([0-9]+(?:\.[0-9]+)?) ?([A-Za-z]+)")
SETTLING_S = 0.4
"""Recording goes on for so long: `moon check` judges what it knows nothing older than to be missing, which
takes two latency bounds."""
_LEAST_BYTES = 1_000_000
"""Smaller files would hold less than a chunk."""


class RecordOptions(NamedTuple):  # msgspec's would cost each --help its import
    """The command line of ``moon record``; what was not given is None or empty.

    Attributes:
        channels: globs of what is recorded; all if empty.
        output: the file or folder to write.
        network: where the system runs.
        interfaces: folders of interface packages.
        split: after how much a new file begins.
        compression: of the file.
        ready_fd: the open file that is told when everything is subscribed to.
        seconds: after how many it ends.
    """

    channels: tuple[str, ...]
    output: Path
    network: Network
    interfaces: tuple[Path, ...]
    split: str | None
    compression: str
    ready_fd: int | None
    seconds: float | None


@click.command()
@click.argument("channels", nargs=-1)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="RUN.mcap",
    help="The file (with --split: the folder) to write.",
)
@network_options
@interface_folders
@click.option(
    "--split",
    metavar="SIZE|DURATION",
    help="Go on in a new file after so much: 500MB, 2GB, 90s, 10min, 1h.",
)
@click.option(
    "--compression",
    type=click.Choice(["none", "zstd", "lz4"]),
    default="zstd",
    show_default=True,
    help="How to compress the file.",
)
@ready_option
@click.option(
    "--for",
    "seconds",
    type=DecimalRange(min=0, min_open=True),
    help="Stop after this many seconds.",
)
@options_as(RecordOptions)
def record(options: RecordOptions) -> None:
    """Record everything that happens to an MCAP file, as `ros2 bag record` would, and more.

    CHANNELS are globs such as '/BatteryLevelSkill/*' (`**` crosses parts of a name; an action stands
    for all its parts); without any, everything is recorded. ROS 2's tools find topics, service calls and
    actions in the file; `moon check` also finds who sent what, and in which order. Types come from
    --interfaces, on ROS 2 from the sourced installation too.

    Exit code 0, or 2 if it could not record.

    \b
    Example:
      moon record -o run.mcap --interfaces examples/lab_tour/interfaces --for 60
    """
    from moon.feed.clock import NS, clock_nobody_sets
    from moon.recording.mcap_writing import Compression
    from moon.recording.recorder import Recorder
    from moon.recording.writer import RecordingWriter
    from moon.tap.completeness import when_complete
    from moon.tap.notices import Notices
    from moon.tap.selection import GlobError, check

    channels, output, network = options.channels, options.output, options.network
    try:
        for glob in channels:
            check(glob)
    except GlobError as error:
        raise click.BadParameter(str(error), param_hint="CHANNELS") from error
    limit = _split(options.split) if options.split is not None else None
    if output.exists():
        fail(f"{output}: is there already; a recording is not written over")
    definitions = _definitions(options.interfaces, network.transport)
    with connected(network, "moon_record", writing="the recording") as connection:
        try:
            writer = RecordingWriter(output, definitions, Compression(options.compression), limit)
        except FileExistsError:
            fail(f"{output}: is there already; a recording is not written over")
        try:
            clock = clock_nobody_sets(connection)
            recorder = Recorder(connection, network.transport, writer, channels, say)
            start_ns = clock()
            recorder.start()
            when_ending(options.ready_fd, connection, recorder.ending)
            listener = recorder.listener
            assert listener is not None
            ready = functools.partial(say_ready, options.ready_fd, connection.node)
            when_complete(connection, listener, ready, lambda: None)
            notices = Notices(say, is_first=options.ready_fd is not None)
            line = _Line(writer)

            def look_around() -> None:
                recorder.look_around()
                notices.links(listener.peers())
                notices.problems(listener.problems())
                line.show((clock() - start_ns) / NS)

            with contextlib.suppress(BrokenPipeError):  # a recording ends as well as any other then
                Watching(connection).run(look_around, options.seconds, settling_s=SETTLING_S)
            recorder.finish()
            notices.last_problems(listener.problems())
            line.finish((clock() - start_ns) / NS)
        finally:
            writer.close()
    for sentence in writer.unknown_types():
        say(f"note: {sentence}")


class _Line:
    """One line on standard error, on a terminal: rate and size."""

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self._live = sys.stderr.isatty() and system_beside() is None
        self._before = (0.0, 0)

    def show(self, seconds: float) -> None:
        """How it stands after ``seconds``."""
        if not self._live:
            return
        before_s, before = self._before
        count = self._writer.observations
        rate = (count - before) / max(seconds - before_s, 1e-3)
        self._before = (seconds, count)
        text = f"{seconds:.0f} s  {count:,} observations ({rate:,.0f}/s)  {self._size()}"
        _write_over(text)

    def finish(self, seconds: float) -> None:
        """The end."""
        if self._live:
            _write_over("")
        count = self._writer.observations
        say(
            f"recorded {count:,} observation{'s' * (count != 1)} in {seconds:.1f} s to "
            f"{self._writer.path} ({self._size()})"
        )

    def _size(self) -> str:
        return size_text(self._writer.bytes_written)


def _write_over(text: str) -> None:
    """Put ``text`` in the place of the line that the cursor is in."""
    with contextlib.suppress(OSError):  # a terminal that is gone is no reason to end
        sys.stderr.write(f"\r\x1b[2K{printable(text)}")
        sys.stderr.flush()


def size_text(count: int) -> str:
    """``count`` bytes in words: ``1.5 MB``."""
    for unit, size in reversed(_SIZES.items()):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} bytes"


def _split(text: str) -> Split:
    from moon.recording.writer import Split

    found = _AMOUNT.fullmatch(text)
    if found is not None:
        number, unit = float(found[1]), found[2]
        if unit in _TIMES and number > 0:
            return Split(seconds=number * _TIMES[unit])
        if unit in _SIZES and number * _SIZES[unit] >= _LEAST_BYTES:
            return Split(size=round(number * _SIZES[unit]))
    raise click.BadParameter(
        f"{text!r} is neither a size of 1MB or more nor a duration; write 500MB, 2GB, 90s, 10min or 1h",
        param_hint="--split",
    )


def _definitions(interfaces: tuple[Path, ...], transport: str) -> Definitions:
    """The types in ``interfaces``, and those of a sourced ROS 2."""
    from moon.recording.definitions import Definitions

    return Definitions(library_in(interfaces, transport))
