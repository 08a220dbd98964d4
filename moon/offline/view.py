"""Which part of a recording is judged, and by which of its times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import datetime

import msgspec
from msgspec.structs import replace

from moon.judge import Gap
from moon.recording.entries import Began, Entry, NodeChange
from moon.sources.time_choice import TimeChoice

NS = 1_000_000_000
_LONGEST_S = 86_400 * 365
"""So many seconds or fewer count from the beginning of the recording, more from the epoch."""


class InstantError(ValueError):
    """A text that names no instant; the text says what would."""


class Instant(msgspec.Struct, frozen=True):
    """An instant of a recording.

    Attributes:
        ns: since the epoch, or since the recording begins.
        is_relative: whether it is the latter.
    """

    ns: int
    is_relative: bool

    def of(self, first_ns: int) -> int:
        """The same since the epoch, in a recording that begins at ``first_ns``."""
        return self.ns + first_ns if self.is_relative else self.ns


def instant(text: str) -> Instant:
    """The instant that ``text`` names: seconds since the beginning or since the epoch, or ISO 8601.

    Raises:
        InstantError: it names none.
    """
    try:
        seconds = float(text)
    except ValueError:
        try:
            when = datetime.fromisoformat(text).timestamp()
        except (ValueError, OverflowError, OSError):
            raise InstantError(
                f"`{text}` is no instant; expected seconds since the recording begins or since the epoch, "
                "or a date and time such as 2026-01-31T12:00:00"
            ) from None
        return Instant(round(when * NS), False)
    if not 0 <= seconds < 2**63 / NS:
        raise InstantError(
            f"`{text}` is no instant: it lies before the beginning, or after all time"
        )
    return Instant(round(seconds * NS), seconds <= _LONGEST_S)


class View(msgspec.Struct, frozen=True):
    """What of a recording is judged.

    Attributes:
        time: by which of its times; by default that is decided by evidence.
        from_, to: what is before and after is left out; None: nothing is.
    """

    time: TimeChoice = TimeChoice()
    from_: Instant | None = None
    to: Instant | None = None

    @property
    def is_part(self) -> bool:
        """Whether something may be left out."""
        return self.from_ is not None or self.to is not None


class Part:
    """The entries of a recording that a view has.

    Args:
        view: which.

    Attributes:
        ends_ns: where it was cut off (ns); 0: it ends with the recording.
        begins_ns: what happened before was left out (ns); 0: nothing was.
        why_empty: the reason, if nothing is in it.
    """

    def __init__(self, view: View) -> None:
        self._view = view
        self.ends_ns = self.begins_ns = 0
        self.why_empty = "nothing is in that part of it" if view.is_part else "it holds nothing"

    def of(self, entries: Iterable[Entry | Gap]) -> Iterator[Entry | Gap]:
        """Those of ``entries``; who was up before they begin is told at their beginning."""
        first_ns = -1
        from_ns, to_ns = 0, 1 << 63
        began: Began | None = None
        up: dict[str, NodeChange] = {}
        is_in = self._view.from_ is None
        for entry in entries:
            at_ns = entry.until_ns if isinstance(entry, Gap) else entry.received_ns
            if first_ns < 0:
                first_ns = at_ns
                from_ns = self._view.from_.of(first_ns) if self._view.from_ else 0
                to_ns = self._view.to.of(first_ns) if self._view.to else to_ns
                if to_ns < from_ns:
                    self.why_empty = "--from is after --to; expected the earlier instant first"
                    return
            if at_ns > to_ns and not isinstance(entry, Gap):
                self.ends_ns = to_ns
                return
            if not is_in and at_ns < from_ns:
                if isinstance(entry, Began):
                    began = entry
                elif isinstance(entry, NodeChange):
                    if entry.up:
                        up[entry.node] = entry
                    else:
                        up.pop(entry.node, None)
                else:
                    self.begins_ns = from_ns
                continue
            if not is_in:
                is_in = True
                if began is not None:
                    yield replace(began, received_ns=from_ns, whole=True)
                for change in up.values():
                    yield replace(change, received_ns=from_ns, reported=True)
            yield entry
