"""Recordings of every form, damaged at random: whatever it is, a check ends, and says what it could not read.

``python -m tests.recording.damage --seconds 600 --seed 0`` prints the seed of every case that ends in
anything but a result or a refusal, or takes too long; exit code 1 then. ``--first SEED --cases 1``
repeats one.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rosbags.rosbag2 import CompressionMode, StoragePlugin

from moon.monitor.subject import Subject, read_subject
from moon.offline.engine import EmptyRecordingError, check_recording
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.mcap_file import MAGIC
from moon.recording.mcap_writing import Compression
from moon.recording.reader import RecordingError, open_recording
from moon.recording.writer import RecordingWriter
from tests.recording import bags
from tests.recordings.make import HERE as GOLDEN
from transports.interface import Observation, ObservationKind

TOUR = Path(__file__).parents[2] / "examples" / "lab_tour"
RUNS = ("ros2-T2", "zenoh-T1")
LIMIT_S = 60.0
"""A check of so few kB that takes longer is taken for one that does not end."""

_CHUNK, _CRC_AT, _FRAME = 6, 24, struct.Struct("<BQ")
_PIECES = (b"9" * 5000, b"1e400", b"-", b"[", b"{" * 1000, b'"', bytes(64), b"\xff" * 64)


def forms(folder: Path) -> dict[str, bytes]:
    """The runs in every form, by file name, made in ``folder``; chunks of MCAP have no checksums."""
    made: dict[str, bytes] = {}
    for run in RUNS:
        source = GOLDEN / f"{run}.mcap"
        entries = list(open_recording(source).entries())
        plain = folder / f"{run}-own.mcap"
        writer = RecordingWriter(plain, Definitions(), Compression.NONE)
        for entry in entries:
            writer.add(entry)
        writer.close()
        made[plain.name] = _without_checksums(plain.read_bytes())
        for plugin, mode in (
            (StoragePlugin.MCAP, CompressionMode.NONE),
            (StoragePlugin.SQLITE3, CompressionMode.NONE),
            (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        ):
            bag = bags.foreign(source, folder / f"{run}-{plugin.name}-{mode.name}", plugin, mode)
            (file,) = (path for path in bag.iterdir() if path.name != "metadata.yaml")
            content = file.read_bytes()
            made[f"{bag.name}{file.suffix}"] = (
                _without_checksums(content) if plugin is StoragePlugin.MCAP else content
            )
        lines = (_line(item) for item in entries if isinstance(item, Observation))
        made[f"{run}.jsonl"] = "".join(f"{line}\n" for line in lines).encode()
    return made


def _line(seen: Observation) -> str:
    fields: dict[str, object] = {"time": seen.stamp_ns / 1e9}
    if seen.kind is ObservationKind.MESSAGE:
        fields |= {**(seen.data or {}), "topic": seen.channel}
    else:
        asks = seen.kind in (ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED)
        fields |= {"service": seen.channel, "request" if asks else "response": seen.data}
    return json.dumps(fields)


def _without_checksums(content: bytes) -> bytes:
    """An MCAP file whose damaged chunks are read."""
    changed, place = bytearray(content), len(MAGIC)
    while place + _FRAME.size <= len(content):
        opcode, length = _FRAME.unpack_from(content, place)
        place += _FRAME.size
        if opcode == _CHUNK:
            changed[place + _CRC_AT : place + _CRC_AT + 4] = bytes(4)
        place += length
    return bytes(changed)


def damaged(content: bytes, choice: random.Random) -> bytes:
    """``content`` with a few bits, numbers and pieces changed, left out, repeated or moved."""
    made = bytearray(content)
    for _ in range(choice.choice((1, 1, 1, 2, 4, 16))):
        at = choice.randrange(len(made))
        match choice.randrange(8):
            case 0:
                made[at] ^= 1 << choice.randrange(8)
            case 1:
                made[at] = choice.choice((0, 1, 127, 128, 255))
            case 2:
                form = choice.choice(("<Q", ">Q"))
                made[at : at + 8] = struct.pack(form, 1 << choice.randrange(64))
            case 3:
                made[at : at + 4] = struct.pack("<I", choice.choice((0, 2**31, 2**32 - 1)))
            case 4:
                del made[at : at + choice.randrange(1, 200)]
            case 5:
                made[at:at] = made[at : at + choice.randrange(1, 400)]
            case 6:
                source, count = choice.randrange(len(made)), choice.randrange(1, 100)
                made[at : at + count] = made[source : source + count]
            case _:
                made[at:at] = choice.choice(_PIECES)
    return bytes(made)


class Checks:
    """Checks damaged recordings.

    Args:
        folder: for files.
        models: whether machines are judged, not only properties.
    """

    def __init__(self, folder: Path, models: bool) -> None:
        self._folder = folder
        self._forms = forms(folder)
        models_of = (TOUR / "system.xml",) if models else ()
        self._subject = Subject(models_of, (TOUR / "properties.yaml",), (), (), (), Bounds())

    def check(self, seed: int) -> None:
        """One case; whatever it raises should not be raised."""
        choice = random.Random(seed)
        name = choice.choice(sorted(self._forms))
        path = self._folder / f"damaged{Path(name).suffix}"
        path.write_bytes(damaged(self._forms[name], choice))
        with suppress(RecordingError, EmptyRecordingError):
            check_recording(path, self._subject, read_subject(self._subject), True)


@contextmanager
def _limited() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"it takes longer than {LIMIT_S:g} s")

    signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def main() -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--cases", type=int, default=sys.maxsize)
    parser.add_argument("--seed", "--first", type=int, default=0, help="of the first case")
    arguments = parser.parse_args()
    end, failures, count = time.monotonic() + arguments.seconds, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        checks = Checks(Path(folder), models=True)
        while time.monotonic() < end and count < arguments.cases:
            seed = arguments.seed + count
            try:
                with _limited():
                    checks.check(seed)
            except Exception:
                failures += 1
                print(f"seed {seed}:", flush=True)
                traceback.print_exc()
            count += 1
    print(f"{count} damaged recordings, {failures} not checked as they should be", flush=True)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
