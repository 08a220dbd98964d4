"""rosbag2's SQLite files (.db3), all versions of their schema, opened so that nothing is written."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from moon.recording.offers import OFFERED, note_offer
from moon.recording.stored import MAX_BYTES, StoredChannel, StoredMessage, plural

MAGIC = b"SQLite format 3\0"

_TABLES = ("topics", "messages")
_MAX_TOPICS = 100_000
_MAX_DEFINITION = 1024 * 1024


class SqliteFile:
    """One .db3 file; see ``stored.Storage``.

    Args:
        path: the file.
        name: how it is called where something is wrong with it; by default its path.
    """

    def __init__(self, path: Path, name: str = "") -> None:
        self.faults: list[str] = []
        self.metadata: dict[str, Mapping[str, str]] = {}
        self.topics: set[str] = set()
        self.offers: dict[str, set[str]] = {}
        self._path = path
        self._name = name or str(path)

    def messages(self, wanted: Callable[[StoredChannel], bool]) -> Iterator[StoredMessage]:
        """The messages of the channels that are ``wanted``, in the order of their stamps."""
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
            self.topics.update(channel.topic for channel in channels.values())
            kept = {number: channel for number, channel in channels.items() if wanted(channel)}
            yield from self._read(connection, kept)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self._fault(f"the file is damaged: {error}")
        finally:
            connection.close()

    def _connect(self) -> sqlite3.Connection:
        """Read only; what a recorder that was killed left beside the file is read too, if it can be."""
        # a path may hold `?` or `#`, which mean something in a URI
        uri = self._path.resolve().as_uri()
        beside = Path(f"{self._path}-wal")
        connection = None
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
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_BYTES)
        return connection

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
                note_offer(self.offers, str(topic), str(text))
        for number, topic, type_name, encoding in connection.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        ).fetchmany(_MAX_TOPICS):
            # the definition of an event's service is stored under the service's name
            base = str(type_name).removesuffix("_Event")
            defined = definitions.get(str(type_name)) or definitions.get(base) or ("", "")
            found[number] = StoredChannel(str(topic), str(type_name), str(encoding), *defined)
        return found

    def _read(
        self, connection: sqlite3.Connection, channels: Mapping[int, StoredChannel]
    ) -> Iterator[StoredMessage]:
        """By the index of stamps; where that is damaged, what else is found in the table."""
        last_ns, delivered = -1, 0
        try:
            for number, stamp_ns, data in connection.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp"
            ):
                made = self._message(channels, number, stamp_ns, data)
                if made is not None:
                    last_ns, delivered = made.received_ns, delivered + 1
                    yield made
        except sqlite3.DatabaseError as error:
            what = f"after {plural(delivered, 'message')} the file is damaged: {error}"
            self._fault(f"{what}; what else is found in it follows")
            rows = connection.execute(
                "SELECT topic_id, timestamp, data FROM messages NOT INDEXED "
                "WHERE timestamp > ? ORDER BY rowid",
                (last_ns,),
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
