"""What the tap says of itself: whom it hears, what it missed. Each thing once, not each second."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

_COUNT = re.compile(r"\b(\d+) (?:message|call)s?\b")
"""What grows in a sentence about messages that were missed."""


class Notices:
    """Says what changed of a listener's links and problems."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._peers: tuple[str, ...] = ()
        self._looks = 0
        self._said: dict[str, int] = {}
        self._standing: frozenset[str] = frozenset()

    def links(self, peers: Sequence[str]) -> None:
        """Say to which nodes the tap is linked, if that changed."""
        now = tuple(sorted(peers))
        self._looks += 1
        if now == self._peers:
            if not now and self._looks == 2:  # the first look may come before the first answer
                self._say(
                    "not linked to any node yet: nothing can be heard until one comes up; "
                    "is this the endpoint where the nodes meet?"
                )
            return
        self._peers = now
        if now:
            self._say(f"linked to {len(now)} node{'s' * (len(now) != 1)}: {', '.join(now)}")
        else:
            self._say("no longer linked to any node")

    def problems(self, sentences: Sequence[str]) -> None:
        """Warn of what is new, and of a number of messages when it has doubled since last said.

        A problem without a number (a node that is not linked) is given until the next look to go
        away by itself: links come up one after the other.
        """
        for sentence in sentences:
            problem, count = _told_apart(sentence)
            said = self._said.get(problem)
            if count:
                if count >= 2 * (said or 0):
                    self._warn(sentence, problem, count)
            elif said is None and sentence in self._standing:
                self._warn(sentence, problem, count)
        self._standing = frozenset(sentences)

    def last_problems(self, sentences: Sequence[str]) -> None:
        """At the end: warn of what is new, and say numbers that have grown as they are now."""
        for sentence in sentences:
            problem, count = _told_apart(sentence)
            if self._said.get(problem) != count and (count or sentence in self._standing):
                self._warn(sentence, problem, count)

    def _warn(self, sentence: str, problem: str, count: int) -> None:
        self._said[problem] = count
        self._say(f"warning: {sentence}")


def _told_apart(sentence: str) -> tuple[str, int]:
    """A problem without its number of messages, and that number (0 where there is none)."""
    found = _COUNT.search(sentence)
    if found is None:
        return sentence, 0
    return sentence[: found.start()] + sentence[found.end() :], int(found[1])
