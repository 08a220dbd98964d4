"""rosbag2's SQLite files (.db3), all versions of their schema, opened so that nothing is written."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from moon.recording.offers import OFFERED, note_offer
from moon.recording.stored import (
    MAX_BYTES,
    Allowance,
    StoredChannel,
    StoredMessage,
    TooLargeError,
    absolute,
    plural,
)

MAGIC = b"SQLite format 3\0"

_TABLES = ("topics", "messages")
_MAX_TOPICS = 100_000
_MAX_DEFINITION = 1024 * 1024
_STEPS = 10_000
"""Instructions of SQLite after which it is asked whether it is to go on."""
_STEPS_OF_ROW = 10
"""A row takes 6 of them by the index of stamps, 12 where it has to be sorted."""


class SqliteFile:
    """One .db3 file; see ``stored.Storage``.

    Args:
        path: the file.
        name: how it is called where something is wrong with it; by default its path.
        size: of the file as it is stored, in bytes, by default its own: it bounds how many messages are read.
    """

    def __init__(self, path: Path, name: str = "", size: int | None = None) -> None:
        self.faults: list[str] = []
        self.metadata: dict[str, Mapping[str, str]] = {}
        self.topics: dict[str, str] = {}
        self.offers: dict[str, set[str]] = {}
        self.is_of_two = False
        self.missing: list[tuple[int, int]] = []
        self._path = path
        self._name = name or str(path)
        beside = self._beside = Path(f"{path}-wal")
        self._size = path.stat().st_size + (beside.stat().st_size if beside.exists() else 0)
        self._allowance = Allowance(self._size if size is None else size)
        self._too_many = ""

    def messages(self, wanted: Callable[[StoredChannel], bool]) -> Iterator[StoredMessage]:
        """The messages of the channels that are ``wanted``, in the order in which they were written."""
        try:
            connection = self._connect()
        except sqlite3.Error as error:
            self._fault(f"it cannot be opened: {error}")
            return
        try:
            channels = self._channels(connection)
            if channels is None:
                self._fault("it is an SQLite file, but no rosbag2 one: no topics and messages")
                return
            self.topics.update((it.topic, it.type_name) for it in channels.values())
            kept = {number: channel for number, channel in channels.items() if wanted(channel)}
            yield from self._read(connection, kept)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self._fault(self._too_many or f"the file is damaged: {error}")
        finally:
            connection.close()

    def _connect(self) -> sqlite3.Connection:
        """Read only; what a recorder that was killed left beside the file is read too, if it can be."""
        # a path may hold `?` or `#`, which mean something in a URI
        uri = self._path.resolve().as_uri()
        beside, connection = self._beside, None
        if beside.exists() and beside.stat().st_size:
            try:
                connection = sqlite3.connect(f"{uri}?mode=ro", uri=True)
                connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
            except sqlite3.Error as error:
                self._fault(f"{beside.name}, which belongs to it, cannot be read: {error}")
                connection = None
        if connection is None:
            connection = sqlite3.connect(f"{uri}?mode=ro&immutable=1", uri=True)
        # a stranger's schema: no functions of it run, no value is larger than it may be
        connection.execute("PRAGMA trusted_schema=OFF")
        longest = min(max(self._size, _MAX_DEFINITION), MAX_BYTES)  # what is in a file is no longer
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, longest)
        # pages that point at one another can make more rows than there are, even before the first
        connection.set_progress_handler(self._work, _STEPS)
        return connection

    def _work(self) -> bool:
        """``_STEPS`` instructions were executed; whether that is enough."""
        try:
            self._allowance.use(_STEPS // _STEPS_OF_ROW)
        except TooLargeError as error:
            self._too_many = str(error)
        return bool(self._too_many)

    def _channels(self, connection: sqlite3.Connection) -> dict[int, StoredChannel] | None:
        kinds = dict(
            connection.execute(
                "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND name IN (?, ?)",
                _TABLES,
            )
        )
        if len(kinds) < len(_TABLES) or any(
            str(text).upper().startswith("CREATE VIRTUAL") for text in kinds.values()
        ):
            return None
        for table in _TABLES:  # columns that are computed are as long as their expressions want
            if any(row[-1] for row in connection.execute(f"PRAGMA table_xinfo({table})")):
                return None
        definitions: dict[str, tuple[str, str]] = {}
        if connection.execute("PRAGMA table_info(message_definitions)").fetchall():
            for name, encoding, text in connection.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ).fetchmany(_MAX_TOPICS):
                if len(str(text)) <= _MAX_DEFINITION:
                    definitions[str(name)] = (str(encoding), str(text))
        found = {}
        if OFFERED in [row[1] for row in connection.execute("PRAGMA table_info(topics)")]:
            for topic, text in connection.execute(
                "SELECT name, offered_qos_profiles FROM topics"
            ).fetchmany(_MAX_TOPICS):
                note_offer(self.offers, absolute(str(topic)), str(text))
        for number, topic, type_name, encoding in connection.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        ).fetchmany(_MAX_TOPICS):
            # the definition of an event's service is stored under the service's name
            base = str(type_name).removesuffix("_Event")
            defined = definitions.get(str(type_name)) or definitions.get(base) or ("", "")
            found[number] = StoredChannel(
                absolute(str(topic)), str(type_name), str(encoding), *defined
            )
        return found

    def _read(
        self, connection: sqlite3.Connection, channels: Mapping[int, StoredChannel]
    ) -> Iterator[StoredMessage]:
        """In the order of rows, as it was received; where these are damaged, what its index still finds."""
        last_row, delivered = -1, 0
        try:
            for row, number, stamp_ns, data in connection.execute(
                "SELECT rowid, topic_id, timestamp, data FROM messages ORDER BY rowid"
            ):
                made = self._message(channels, number, stamp_ns, data)
                if made is not None:
                    last_row, delivered = row, delivered + 1
                    yield made
        except sqlite3.DatabaseError as error:
            if self._too_many:
                raise
            what = f"after {plural(delivered, 'message')} the file is damaged: {error}"
            self._fault(f"{what}; what else is found in it follows")
            rows = connection.execute(
                "SELECT topic_id, timestamp, data FROM messages WHERE rowid > ? ORDER BY timestamp",
                (last_row,),
            )
            for number, stamp_ns, data in rows:
                made = self._message(channels, number, stamp_ns, data)
                if made is not None:
                    yield made

    def _message(
        self, channels: Mapping[int, StoredChannel], number: Any, stamp_ns: Any, data: Any
    ) -> StoredMessage | None:
        channel = channels.get(number)
        if channel is None or type(stamp_ns) is not int or type(data) is not bytes:
            return None
        return StoredMessage(channel, stamp_ns, 0, 0, data)

    def _fault(self, what: str) -> None:
        self.faults.append(f"{self._name}: {what}")
