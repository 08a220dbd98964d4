"""Opening a recording, whatever its form: recognised by what is in it, not by its name."""

from __future__ import annotations

import io
from collections.abc import Callable, Generator, Iterable, Iterator
from pathlib import Path

from msgspec.structs import replace

from m2c.language.datatypes import Structure
from m2c.model.file_size import size_of
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Machine
from m2c.model.paths import meant
from m2c.model.system import System
from moon.recording import mcap_file, sqlite_file
from moon.recording.attribution import Attribution
from moon.recording.contents import Contents, is_clock, named
from moon.recording.conversion import Conversion
from moon.recording.definitions import Definitions
from moon.recording.entries import Began, Ended, Entry
from moon.recording.format import FORMAT_NAME, Form, form_of
from moon.recording.jsonlines import JsonLines
from moon.recording.offers import Offer, offer_of, publishers_in
from moon.recording.rosbag import BagFiles
from moon.recording.sorting import Sorting
from moon.recording.stored import LZ4_MAGIC, ZSTD_MAGIC, StoredChannel, StoredMessage, Unpacked
from transports.fields_read import FieldsRead
from transports.interface import Observation
from transports.service_events import EVENT_SUFFIX

_HEAD_BYTES = 4096
_ROS1_MAGIC = b"#ROSBAG V"
_FORMS = "an MCAP file, a rosbag2 folder or its SQLite file, or a log of JSON lines"

Wanted = Callable[[str], bool]
"""Whether the observations of a channel are wanted; others are not decoded."""


class RecordingError(Exception):
    """A path that is no recording at all; the text says what it is, and what would be right."""


class Recording:
    """One recording, opened by :meth:`open` to be read once from front to back.

    Nothing of it is kept in memory.

    Attributes:
        path: where it is.
        form: what it is: ``moon recording``, ``rosbag2``, ``JSON lines``.
        contents: what was found in it, as far as it was read.
        ended: whether what was read last says that the recorder stopped in good order.
        is_of_two: whether a second run is in the file: another file is behind it, or a recorder began or
            ended after one had ended.
    """

    def __init__(self, path: Path, form: str, library: InterfaceLibrary | None) -> None:
        self.path = path
        self.form = form
        self.contents = Contents()
        self.ended = False
        self._at_end = False
        self._source: Generator[Entry, None, None] | None = None
        self._bag = None if form == JSON_LINES else BagFiles(path)
        if form == OWN and self._bag is not None:
            self._bag.keep_order()
        self._definitions = Definitions(library)
        self._conversion = Conversion(self._definitions)
        self._lines: JsonLines | None = None
        self._lines_order = Sorting()
        self.is_of_two = False

    @classmethod
    def open(cls, path: Path | str, library: InterfaceLibrary | None = None) -> Recording:
        """Open the recording at ``path``.

        Args:
            path: what ``moon record`` or ``ros2 bag record`` wrote (a file or a folder), or a log of
                JSON lines.
            library: types of messages that the recording itself does not define; those of models
                are ``System.library``.

        Raises:
            RecordingError: there is none, or nothing of it can be read.
        """
        return open_recording(Path(path), library)

    def entries(
        self, wanted: Wanted | None = None, fields_read: FieldsRead | None = None
    ) -> Iterator[Entry]:
        """What was recorded, in the order in which it was received; to be asked for once.

        Damage ends nothing but what is damaged: ``faults`` reports it. Where something of our own
        recording is missing, the recorder begins once more (:class:`moon.recording.entries.Began`).

        Args:
            wanted: whether the observations on a channel are wanted; by default all are.
            fields_read: the names that lead to the fields that are read, by channel: of the sequences in its
                messages that are not, only the beginning need be there. None, or what returns None: all.
        """
        if fields_read is not None:
            self._conversion.fields_read = fields_read
        note, has_ended = self.contents.note, False
        self._source = source = (
            self._read_lines() if self._bag is None else self._read_bag(wanted or _everything)
        )
        for entry in source:
            if type(entry) is not Observation:
                if has_ended and isinstance(entry, Began | Ended):
                    self.is_of_two = True
                has_ended = has_ended or isinstance(entry, Ended)
                self.ended = isinstance(entry, Ended)
                yield entry
            elif wanted is None or wanted(entry.channel):
                note(entry)
                yield entry
        if self._bag is not None and self._bag.is_of_two:
            self.is_of_two = True
        self._at_end = True

    def close(self) -> None:
        """End reading, wherever it is; idempotent."""
        if self._source is not None:
            self._source.close()

    def __enter__(self) -> Recording:
        """Itself."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close it, whatever was raised."""
        self.close()

    def faults(self) -> list[str]:
        """What could not be read so far, one sentence each, with its place in the file."""
        if self._lines is not None:
            return list(self._lines.faults)
        if self._bag is None:
            return []
        found = [*self._bag.faults, *self._conversion.undecodable()]
        if self.form == OWN and self._at_end and not self.ended:
            found.append(f"{self.path}: it was cut off: its recorder did not end it in good order")
        return found

    @property
    def missing(self) -> tuple[tuple[int, int], ...]:
        """Between which times of reception (ns) a part of it was left out, if it was read to its end."""
        return () if self._bag is None else tuple(self._bag.missing)

    def take_missed(self) -> list[StoredMessage]:
        """The messages that could not be decoded since this was asked last, without their bytes."""
        missed, self._conversion.missed = self._conversion.missed, []
        return missed

    def limits(self, on_arrival: bool = False) -> list[str]:
        """What cannot be concluded from what was read so far, one sentence each.

        Args:
            on_arrival: whether messages are taken to have happened when they were recorded, although the
                file has another stamp.
        """
        found = self.contents.limits()
        on_arrival = on_arrival or (self.form == ROSBAG and self.contents.on_arrival)
        if on_arrival and self.form != JSON_LINES and self.contents.count:
            found.append(
                "messages on topics are stamped when they were recorded, not when they were published: "
                "their order against other channels is known to the latency bound"
            )
        if self._conversion.hollow:
            found.append(
                f"the events of {named(self._conversion.hollow)} carry no contents: they were recorded "
                "with ServiceIntrospectionState.METADATA instead of CONTENTS"
            )
        if self._lines is not None:
            found.append(
                "a log of JSON lines has no types: what is in it is taken as it is, and its times "
                "may be whole seconds"
            )
        return found

    def attributed(
        self,
        system: System,
        machines: Iterable[Machine],
        on_arrival: bool,
        is_ordered: bool = True,
        other_time: str = "",
    ) -> Attribution:
        """Who did what, if this is a bag and was read to its end; see :class:`Attribution`."""
        topics: Iterable[str] = self._bag.topics if self._bag is not None else ()
        if self.form == OWN:
            topics = self.contents.topics()
        return Attribution(
            self.contents, topics, system, machines, on_arrival, is_ordered, other_time
        )

    @property
    def late(self) -> int:
        """How many entries stand far from their place in time, so far as it was read."""
        if self._lines is not None:
            return 0 if self._lines_order.set_back else self._lines_order.late
        return self._bag.late if self._bag is not None else 0

    def topics(self) -> list[str]:
        """The channels that were recorded, as far as it was read."""
        topics: Iterable[str] = self._bag.topics if self._bag is not None else ()
        found = {topic.removesuffix(EVENT_SUFFIX) for topic in topics}
        return sorted(found | self.contents.channels.keys())

    def clocks(self) -> list[str]:
        """The topics with the time of a simulation, as far as it was read."""
        found = {name: it.type_name for name, it in self.contents.channels.items()}
        topics = found | (self._bag.topics if self._bag is not None else {})
        return sorted(name for name, type_name in topics.items() if is_clock(name, type_name))

    def offer(self, topic: str) -> Offer:
        """What the publishers of ``topic`` offered, as far as that was read; the usual if it is not known."""
        return offer_of(self._bag.offers.get(topic, ())) if self._bag is not None else Offer()

    def publishers(self, topic: str) -> int:
        """How many publish on ``topic`` at least, as far as that was read; 0 if nothing says so."""
        return publishers_in(self._bag.offers.get(topic, ())) if self._bag is not None else 0

    def structure(self, type_name: str) -> Structure:
        """The type ``type_name``, of which something was read; UnknownTypeError if it is not defined."""
        return self._definitions.structure(type_name)

    def _read_bag(self, wanted: Wanted) -> Generator[Entry, None, None]:
        bag, convert = self._bag, self._conversion
        assert bag is not None

        def of_interest(channel: StoredChannel) -> bool:
            form = form_of(channel.metadata)
            if form in (None, Form.OBSERVATION):
                return wanted(channel.topic.removesuffix(EVENT_SUFFIX))
            return form is not Form.COPY

        began: Began | None = None
        faults, missing = bag.faults, 0
        for message in bag.messages(of_interest):
            entry = convert(message)
            if entry is None:
                continue
            if type(entry) is Began:
                began, missing = entry, len(faults) + convert.left_out
            elif len(faults) + convert.left_out != missing:
                missing = len(faults) + convert.left_out
                if began is not None:
                    yield replace(began, received_ns=message.received_ns)
            yield entry

    def _read_lines(self) -> Generator[Entry, None, None]:
        with self.path.open("rb") as opened:
            packed = opened.read(len(ZSTD_MAGIC)) == ZSTD_MAGIC
        raw = Unpacked(self.path) if packed else self.path.open("rb", buffering=0)
        with raw, io.BufferedReader(raw) as lines:
            self._lines = JsonLines(lines, str(self.path))
            yield from self._lines_order(self._lines.observations())
            self._lines.finish(raw.fault if isinstance(raw, Unpacked) else "")


OWN = "moon recording"
ROSBAG = "rosbag2"
JSON_LINES = "JSON lines"


def open_recording(path: Path, library: InterfaceLibrary | None = None) -> Recording:
    """The recording at ``path``.

    Args:
        path: an MCAP file, a rosbag2 folder or one of its files, or a log of JSON lines.
        library: types of messages that the recording itself does not define.

    Raises:
        RecordingError: there is none, or nothing of it can be read.
    """
    try:
        form = _form_of(path)
    except OSError as error:
        what = f"{path}: cannot be read: {error.strerror or error}"
        near = meant(path)
        raise RecordingError(f"{what}; {near}" if near else what) from error
    return Recording(path, form, library)


def _form_of(path: Path) -> str:
    if path.is_dir():
        found = BagFiles(path)
        if not found.files:
            what = "; ".join(found.faults) or "it has no .mcap or .db3 file"
            raise RecordingError(f"{path}: a folder that is no recording: {what}")
        return OWN if FORMAT_NAME in found.leading_metadata() else ROSBAG
    size_of(path)  # a pipe or a device may never end
    with path.open("rb") as opened:
        head = opened.read(_HEAD_BYTES)
    if not head:
        raise RecordingError(f"{path}: is empty (0 bytes); a recording is {_FORMS}")
    if head.startswith(ZSTD_MAGIC):
        with Unpacked(path) as raw:
            head = io.BufferedReader(raw).read(_HEAD_BYTES)
            if not head:
                raise RecordingError(f"{path}: byte 0: {raw.fault or 'it is empty'}")
    for magic, what in ((mcap_file.MAGIC, "an MCAP"), (sqlite_file.MAGIC, "an SQLite")):
        if head.startswith(magic):
            return OWN if FORMAT_NAME in BagFiles(path).leading_metadata() else ROSBAG
        if magic.startswith(head):
            raise RecordingError(
                f"{path}: byte {len(head)}: the file ends within the first bytes of {what} file"
            )
    if head.startswith(LZ4_MAGIC):
        raise RecordingError(f"{path}: is compressed by lz4; unpack it with `lz4 -d {path.name}`")
    if head.startswith(_ROS1_MAGIC):
        raise RecordingError(
            f"{path}: is a bag of ROS 1; make it one of ROS 2: rosbags-convert --src {path.name} "
            f"--dst {path.stem}"
        )
    if head.lstrip(b" \t\r\n\xef\xbb\xbf").startswith(b"{"):
        return JSON_LINES
    raise RecordingError(f"{path}: is no recording (begins with {head[:8]!r}); expected {_FORMS}")


def _everything(_: str) -> bool:
    return True
