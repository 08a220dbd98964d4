"""rosbag2's folders and files, whoever recorded them; no ROS is needed.

A folder has a ``metadata.yaml`` that names its files and says how they are compressed (rosbag2 writes
it last: the folder of a recorder that was killed has none). Files are SQLite or MCAP, and may be
compressed as a whole (``.zstd``) or message by message.
"""

from __future__ import annotations

import io
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from m2c.diagnostics import DiagnosticLog
from moon import yaml_tree
from moon.recording import mcap_file, sqlite_file
from moon.recording.mcap_file import McapFile
from moon.recording.sorting import Sorting
from moon.recording.sqlite_file import SqliteFile
from moon.recording.stored import (
    LZ4_MAGIC,
    ZSTD_MAGIC,
    Storage,
    StoredChannel,
    StoredMessage,
    TooLargeError,
    Unpacked,
    plural,
)

METADATA = "metadata.yaml"
_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_HEAD_BYTES = 16

MAX_RATIO = 1000
"""A compressed SQLite file is unpacked to a temporary one; if it grows by more, it is a bomb."""
_ALWAYS_BYTES = 256 * 1024 * 1024
"""A file up to this size is unpacked whatever its ratio."""
_PIECE_BYTES = 1024 * 1024

Wanted = Callable[[StoredChannel], bool]


class BagFiles:
    """The files of one bag, read one after another.

    Args:
        path: a folder, or one file.

    Attributes:
        files: those that there are, in order.
        faults: what could not be read so far.
        topics: those that the files declare, as far as they were read, and the type of each.
        offers: what was offered on each, as it is written there (``offers.offer_of``).
        is_of_two: whether one of the files was written behind another, in one, as far as they were read.
        missing: between which times of recording (ns) something was left out, as far as they were read.
    """

    def __init__(self, path: Path) -> None:
        self.faults: list[str] = []
        self.topics: dict[str, str] = {}
        self.offers: dict[str, set[str]] = {}
        self.files = self._in_folder(path) if path.is_dir() else [path]
        self.is_of_two = False
        self.missing: list[tuple[int, int]] = []
        self._sorting: Sorting | None = Sorting()

    def messages(self, wanted: Wanted) -> Iterator[StoredMessage]:
        """The messages of the channels that are ``wanted``, in the order of reception."""
        for path in self.files:
            try:
                yield from self._messages_in(path, wanted)
            except OSError as error:
                self.faults.append(f"{path}: cannot be read: {error.strerror or error}")
            except TooLargeError as error:
                self.faults.append(f"{path}: {error}")
        if self.late:
            self.faults.append(f"{plural(self.late, 'message')} stood far from their place in time")

    @property
    def late(self) -> int:
        """How many messages stood far from their place in time, so far, although no clock was set back."""
        sorting = self._sorting
        return 0 if sorting is None or sorting.set_back else sorting.late

    def leading_metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The named maps at the beginning of the first file, if that is MCAP."""
        for path in self.files[:1]:
            with path.open("rb") as opened:
                packed = opened.read(len(ZSTD_MAGIC)) == ZSTD_MAGIC
            with Unpacked(path) if packed else path.open("rb", buffering=0) as raw:
                return mcap_file.leading_metadata(io.BufferedReader(raw))
        return {}

    def keep_order(self) -> None:
        """Hand on what the files hold in their own order: it is that in which it was received."""
        self._sorting = None

    def _in_folder(self, folder: Path) -> list[Path]:
        listed = self._listed(folder)
        found = sorted(
            (path for path in folder.iterdir() if path.name.endswith(_SUFFIXES)), key=_natural
        )
        if listed is None:
            return found
        files = [folder / name for name in listed]
        for path in files:
            if not path.exists():
                self.faults.append(f"{path}: is named in {METADATA}, and is not there")
        return [path for path in files if path.exists()]

    def _listed(self, folder: Path) -> list[str] | None:
        """The files that the metadata name; None if they do not tell."""
        path = folder / METADATA
        if not path.exists():
            self.faults.append(
                f"{path}: is missing (rosbag2 writes it when it ends): the files are read in the "
                "order of their names"
            )
            return None
        log = DiagnosticLog()
        found = yaml_tree.read_yaml(path, log)
        for name in ("rosbag2_bagfile_information", "relative_file_paths"):
            found = found.entries.get(name) if isinstance(found, yaml_tree.Mapping) else None
        if not isinstance(found, yaml_tree.Sequence):
            why = log.diagnostics[0].message if log.diagnostics else "it does not name them"
            self.faults.append(f"{path}: {why}: the files are read in the order of their names")
            return None
        # a file of the bag is in its folder, whatever the metadata say
        return [Path(item.text).name for item in found.items if isinstance(item, yaml_tree.Scalar)]

    def _messages_in(self, path: Path, wanted: Wanted) -> Iterator[StoredMessage]:
        with path.open("rb") as opened:
            head = opened.read(_HEAD_BYTES)
        if head.startswith(ZSTD_MAGIC):
            yield from self._compressed(path, wanted)
        elif head.startswith(mcap_file.MAGIC):
            with path.open("rb") as opened:
                yield from self._read(McapFile(opened, str(path), path.stat().st_size), wanted)
        elif head.startswith(sqlite_file.MAGIC):
            yield from self._read(SqliteFile(path), wanted)
        elif head.startswith(LZ4_MAGIC):
            self.faults.append(f"{path}: is compressed by lz4; unpack it with `lz4 -d {path.name}`")
        elif not head:
            self.faults.append(f"{path}: is empty (0 bytes)")
        else:
            self.faults.append(f"{path}: is neither MCAP nor SQLite; it begins with {head[:8]!r}")

    def _compressed(self, path: Path, wanted: Wanted) -> Iterator[StoredMessage]:
        with io.BufferedReader(Unpacked(path)) as opened:
            head = opened.read(_HEAD_BYTES)
        if head.startswith(mcap_file.MAGIC):
            with Unpacked(path) as raw:
                file = McapFile(io.BufferedReader(raw), str(path), path.stat().st_size)
                yield from self._read(file, wanted)
                self._damage(path, raw)
        elif head.startswith(sqlite_file.MAGIC):
            with tempfile.TemporaryDirectory(prefix="moon-") as folder:
                unpacked = Path(folder, path.name.removesuffix(".zstd"))
                self._unpack(path, unpacked)
                stored = SqliteFile(unpacked, str(path), path.stat().st_size)
                yield from self._read(stored, wanted)
        else:
            self.faults.append(
                f"{path}: holds neither MCAP nor SQLite; it begins with {head[:8]!r}"
            )

    def _unpack(self, path: Path, into: Path) -> None:
        """SQLite needs a file to seek in. What is cut off at the end is left out, and reported."""
        limit = max(_ALWAYS_BYTES, MAX_RATIO * path.stat().st_size)
        limit = min(limit, shutil.disk_usage(into.parent).free // 2)
        made = 0
        with Unpacked(path) as source, into.open("wb") as target:
            while piece := source.read(_PIECE_BYTES):
                made += len(piece)
                if made > limit:
                    raise TooLargeError(f"it would be larger than {limit} bytes")
                target.write(piece)
            self._damage(path, source)

    def _damage(self, path: Path, file: Unpacked) -> None:
        if file.fault:
            self.faults.append(f"{path}: {file.fault}: what comes before was read")

    def _share_with(self, file: Storage) -> None:
        """What is found is reported as it is met."""
        file.faults, file.topics, file.offers = self.faults, self.topics, self.offers

    def _read(self, file: Storage, wanted: Wanted) -> Iterator[StoredMessage]:
        self._share_with(file)
        found = file.messages(wanted)
        yield from found if self._sorting is None else self._sorting(found)
        self.is_of_two = self.is_of_two or file.is_of_two
        self.missing += file.missing


def _natural(path: Path) -> list[tuple[str, int]]:
    """``run_2`` before ``run_10``."""
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", path.name)]
