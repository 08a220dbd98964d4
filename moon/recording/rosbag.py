"""rosbag2's folders and files, whoever recorded them; no ROS is needed.

A folder has a ``metadata.yaml`` that names its files and says how they are compressed (rosbag2 writes
it last: the folder of a recorder that was killed has none). Files are SQLite or MCAP, and may be
compressed as a whole (``.zstd``) or message by message.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

from moon.recording import mcap_file, sqlite_file
from moon.recording.mcap_file import McapFile
from moon.recording.sorting import Sorting
from moon.recording.sqlite_file import SqliteFile
from moon.recording.stored import (
    ZSTD_MAGIC,
    StoredChannel,
    StoredMessage,
    TooLargeError,
    ZstdError,
    open_zstd,
    plural,
)

METADATA = "metadata.yaml"
_MAX_METADATA = 16 * 1024 * 1024
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
        stamped_on_arrival: whether no message says when it was published.
    """

    def __init__(self, path: Path) -> None:
        self.faults: list[str] = []
        self.stamped_on_arrival = False
        self.files = self._in_folder(path) if path.is_dir() else [path]
        self._sorting = Sorting()

    def messages(self, wanted: Wanted) -> Iterator[StoredMessage]:
        """The messages of the channels that are ``wanted``, in the order of reception."""
        for path in self.files:
            try:
                yield from self._messages_in(path, wanted)
            except OSError as error:
                self.faults.append(f"{path}: cannot be read: {error.strerror or error}")
            except (ZstdError, EOFError, TooLargeError) as error:
                self.faults.append(f"{path}: its compression is damaged: {error}")
        if self._sorting.late:
            self.faults.append(
                f"{plural(self._sorting.late, 'message')} stood far from their place in time"
            )

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
        found = self._metadata(path)
        information = found.get("rosbag2_bagfile_information") if isinstance(found, dict) else None
        names = information.get("relative_file_paths") if isinstance(information, dict) else None
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            self.faults.append(f"{path}: does not name the files; they are read by their names")
            return None
        # a file of the bag is in its folder, whatever the metadata say
        return [Path(name).name for name in cast("list[str]", names)]

    def _metadata(self, path: Path) -> Any:
        from ruamel.yaml import YAML
        from ruamel.yaml.error import YAMLError

        try:
            with path.open("rb") as opened:
                text = opened.read(_MAX_METADATA + 1)
            if len(text) > _MAX_METADATA:
                self.faults.append(f"{path}: has more than {_MAX_METADATA} bytes")
                return None
            return YAML(typ="safe").load(text.decode())
        except (OSError, YAMLError, ValueError, RecursionError) as error:
            what = " ".join(str(error).split())
            self.faults.append(f"{path}: cannot be read: {what[:200]}")
            return None

    def _messages_in(self, path: Path, wanted: Wanted) -> Iterator[StoredMessage]:
        with path.open("rb") as opened:
            head = opened.read(_HEAD_BYTES)
        if head.startswith(ZSTD_MAGIC):
            yield from self._compressed(path, wanted)
        elif head.startswith(mcap_file.MAGIC):
            with path.open("rb") as opened:
                yield from self._mcap(McapFile(opened, str(path)), wanted)
        elif head.startswith(sqlite_file.MAGIC):
            yield from self._sqlite(SqliteFile(path), wanted)
        elif not head:
            self.faults.append(f"{path}: is empty (0 bytes)")
        else:
            self.faults.append(f"{path}: is neither MCAP nor SQLite; it begins with {head[:8]!r}")

    def _compressed(self, path: Path, wanted: Wanted) -> Iterator[StoredMessage]:
        with open_zstd(path) as opened:
            head = opened.read(_HEAD_BYTES)
        if head.startswith(mcap_file.MAGIC):
            with open_zstd(path) as opened:
                yield from self._mcap(McapFile(opened, str(path)), wanted)
        elif head.startswith(sqlite_file.MAGIC):
            with tempfile.TemporaryDirectory(prefix="moon-") as folder:
                unpacked = Path(folder, path.name.removesuffix(".zstd"))
                self._unpack(path, unpacked)
                yield from self._sqlite(SqliteFile(unpacked, str(path)), wanted)
        else:
            self.faults.append(
                f"{path}: holds neither MCAP nor SQLite; it begins with {head[:8]!r}"
            )

    def _unpack(self, path: Path, into: Path) -> None:
        """SQLite needs a file to seek in. What is cut off at the end is left out, and said."""
        limit = max(_ALWAYS_BYTES, MAX_RATIO * path.stat().st_size)
        limit = min(limit, shutil.disk_usage(into.parent).free // 2)
        made = 0
        with open_zstd(path) as source, into.open("wb") as target:
            while True:
                try:
                    piece = source.read(_PIECE_BYTES)
                except (ZstdError, EOFError) as error:
                    self.faults.append(f"{path}: its compression is damaged: {error}")
                    return
                if not piece:
                    return
                made += len(piece)
                if made > limit:
                    raise TooLargeError(f"it would be larger than {limit} bytes")
                target.write(piece)

    def _mcap(self, file: McapFile, wanted: Wanted) -> Iterator[StoredMessage]:
        try:
            yield from self._sorting(file.messages(wanted))
        finally:
            self.faults += file.faults

    def _sqlite(self, file: SqliteFile, wanted: Wanted) -> Iterator[StoredMessage]:
        self.stamped_on_arrival = True
        try:
            yield from file.messages(wanted)
        finally:
            self.faults += file.faults


def _natural(path: Path) -> list[tuple[str, int]]:
    """``run_2`` before ``run_10``."""
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", path.name)]
