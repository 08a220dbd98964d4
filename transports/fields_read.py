"""Which fields of messages are read: who decodes a message need not make what nobody looks at."""

from __future__ import annotations

import sys
from collections.abc import Callable

Paths = frozenset[tuple[str, ...]]
"""Fields of a message that are read, each by the names that lead to it, through sequences, too."""
FieldsRead = Callable[[str], Paths | None]
"""Those of the messages on a channel, of requests and responses of a service; None: all."""
UNREAD_KEPT = 256
"""So many elements are kept of a sequence of which nothing is read: as many as a text shows of it."""


def inside(read: Paths | None, name: str) -> Paths | None:
    """What is read of the field ``name``."""
    if read is None:
        return None
    found = frozenset(path[1:] for path in read if path[:1] == (name,))
    return None if () in found else found


def kept(read: Paths | None) -> int:
    """How many elements of a sequence are kept of which ``read`` is read."""
    return sys.maxsize if read is None or read else UNREAD_KEPT


def of_event(read: Paths | None) -> Paths | None:
    """What is read of a service's event, where ``read`` is of its requests and responses."""
    if read is None:
        return None
    contents = (("info",), ("error",), *((part, *path) for part in _CONTENTS for path in read))
    return frozenset(contents)


_CONTENTS = ("request", "response")
