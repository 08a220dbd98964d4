"""What the tap says of itself: from whom it receives, what it missed. Each thing once, not each second."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from m2c.suggestions import first_of

_COUNT = re.compile(r"\b(\d+) (?:message|call)s?\b")
"""What grows in a sentence about messages that were missed."""
_MOST_NAMED = 8
"""Nodes that are new, or gone, by name; of more, so many and a number."""


class Standing:
    """Which of a tap's problems are to be taken seriously.

    Those with a number of messages at once; others (a node that is not linked) if they are still there at the
    next look: links come up one after the other.
    """

    def __init__(self) -> None:
        self._before: frozenset[str] = frozenset()

    def look(self, sentences: Sequence[str]) -> list[str]:
        """Those of ``sentences``."""
        found = [text for text in sentences if text in self._before or _COUNT.search(text)]
        self._before = frozenset(sentences)
        return found


class Notices:
    """Says what changed of a listener's links and problems.

    Args:
        say: prints a line.
        is_first: whether the nodes are started once it listens: it is not said that none is there yet.
    """

    def __init__(self, say: Callable[[str], None], *, is_first: bool = False) -> None:
        self._say = say
        self._is_first = is_first
        self._peers: tuple[str, ...] = ()
        self._looks = 0
        self._warned: dict[str, int] = {}
        self._standing = Standing()

    def links(self, peers: Sequence[str]) -> None:
        """Say to how many nodes the tap is linked, and which are new or gone, if that changed."""
        now = tuple(sorted(peers))
        self._looks += 1
        if now == self._peers:
            is_second = self._looks == 2  # the first may come before the first answer
            if not now and is_second and not self._is_first:
                self._say(
                    "not linked to any node yet: nothing can be received until one starts; "
                    "is this the endpoint where the nodes meet?"
                )
            return
        new, gone = (
            sorted(set(now).difference(self._peers)),
            sorted(set(self._peers).difference(now)),
        )
        if not now:
            self._say("no longer linked to any node")
        else:
            signs = ("+ ", "- ") if self._peers else ("", "")
            changes = [
                f"{sign}{first_of(names, _MOST_NAMED)}"
                for sign, names in zip(signs, (new, gone), strict=True)
                if names
            ]
            nodes = f"{len(now)} node{'s' * (len(now) != 1)}"
            self._say(f"linked to {nodes}: {'; '.join(changes)}")
        self._peers = now

    def problems(self, sentences: Sequence[str]) -> None:
        """Warn of what is new, and of a number of messages when it has doubled since the last warning."""
        for sentence in self._standing.look(sentences):
            problem, count = _parts(sentence)
            before = self._warned.get(problem)
            if before is None or (count and count >= 2 * before):
                self._warn(sentence, problem, count)

    def last_problems(self, sentences: Sequence[str]) -> None:
        """At the end: warn of what is new, and say numbers that have grown as they are now."""
        for sentence in self._standing.look(sentences):
            problem, count = _parts(sentence)
            if self._warned.get(problem) != count:
                self._warn(sentence, problem, count)

    def _warn(self, sentence: str, problem: str, count: int) -> None:
        self._warned[problem] = count
        self._say(f"warning: {sentence}")


def _parts(sentence: str) -> tuple[str, int]:
    """A problem without its number of messages, and that number (0 where there is none)."""
    found = _COUNT.search(sentence)
    if found is None:
        return sentence, 0
    return sentence[: found.start()] + sentence[found.end() :], int(found[1])
