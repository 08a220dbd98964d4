"""What arrived and could not be used: counted by channel and source, and reported once for each.

Whoever reaches the middleware can send anything, as often as it likes. So what a decoder refuses must
neither end the process nor fill its log or its memory.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Iterator

MOST_PLACES = 256
"""Channels and sources that are distinguished; their names come from the wire, and never end."""
MOST_SHOWN = 200
"""Characters of a name or a reason that a line of the log shows."""
_AGAIN = 1000
"""What goes on is reported again each time it has become so many times as much."""


class Refusals:
    """Counts what one node refused, and says so.

    Args:
        log: where it is reported.
    """

    def __init__(self, log: logging.Logger | logging.LoggerAdapter[logging.Logger]) -> None:
        self._log = log
        self._lock = threading.Lock()
        self._counts: dict[tuple[str, str], int] = {}
        self.total = 0
        """How much was refused so far."""

    def refuse(self, channel: str, source: str, why: object) -> None:
        """Count what came on ``channel`` and could not be used; from any thread.

        Args:
            channel: where it came from: a topic, a service, or the middleware's own key.
            source: who sent it; empty if it does not say.
            why: what is wrong with it.
        """
        channel, source = place = shown(channel), shown(source)
        with self._lock:
            self.total += 1
            counts = self._counts
            known = place in counts
            if not known and len(counts) >= MOST_PLACES:
                place = ("", "")
            counts[place] = count = counts.get(place, 0) + 1
        if place != (channel, source):
            if count == 1:
                self._log.warning(
                    "more than %d senders of what cannot be used: the others are not reported one by one",
                    MOST_PLACES,
                )
        elif _is_reported(count):
            self._log.warning(
                "%s: message from %s dropped: %s%s",
                channel,
                source or "an unnamed node",
                shown(str(why)),
                "" if count == 1 else f" ({count:,} so far)",
            )

    @contextlib.contextmanager
    def contained(self, channel: str) -> Iterator[None]:
        """Refuse what makes the middleware's own code raise.

        For callbacks that are not this project's (rclpy's parameter services raise at a type of parameter
        that does not exist): what they raise cannot be known. What is ours says what it raises.
        """
        try:
            yield
        except Exception as error:
            self._log.debug("%s", shown(channel), exc_info=error)
            self.refuse(channel, "", f"{type(error).__name__}: {error}")

    def count(self, channel: str, source: str = "") -> int:
        """How much was refused that came on ``channel`` from ``source``."""
        with self._lock:
            return self._counts.get((shown(channel), shown(source)), 0)


def _is_reported(count: int) -> bool:
    while count % _AGAIN == 0:
        count //= _AGAIN
    return count == 1


def shown(text: str) -> str:
    r"""``text`` from the wire, shortened, on one line, with escapes such as ``\x1b`` for what is not seen."""
    if len(text) > MOST_SHOWN:
        text = text[:MOST_SHOWN] + "…"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
