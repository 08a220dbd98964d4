"""What Zenoh says when it refuses a link or a message, in our words, and not more often than one can read.

Zenoh's access control says at its level ``trace`` only what it refuses, and there also what it allows, which
costs each message; so by default it is heard that something was refused, and not what.
"""

from __future__ import annotations

import collections
import contextlib
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator

_LINKS = "zenoh_link_tls::unicast"
_MESSAGES = "zenoh::net::routing::interceptor"
_RULES = f"{_MESSAGES}::access_control"
_OF_LAUNCHER = f"{_LINKS}=warn"
_OF_NODES = f"{_LINKS}=warn,{_MESSAGES}=trace,{_RULES}=off"
"""Zenoh's log as ``RUST_LOG`` names it."""
_WHICH = f"RUST_LOG={_MESSAGES}=trace"
"""What has Zenoh say whose message it was, and on which key."""
_VARIABLE = "RUST_LOG"
_STANDARD_OUTPUT = 1
_PERIOD_S = 60.0
"""What is refused for the same reason is said so often: who is refused a link tries again every second."""
_MOST_REASONS = 20
"""So many reasons are told apart."""
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_SAID = re.compile(r"\S+Z +[A-Z]+ (?P<thread>.*?)(?P<source>zenoh[\w:]*): (?P<text>.*)")
_RECEIVING = "rx-"
"""How Zenoh names the threads on which it receives. A message kept back on another one was not refused: it
is our own, for a new peer of which Zenoh does not yet know what it has declared."""
_HINT = re.compile(r"\. Hint: .*")
"""What Zenoh advises whatever the reason is."""


def ask_for_refusals() -> bool:
    """Have Zenoh say in this process which links it refuses, unless ``RUST_LOG`` says what it is to say.

    Returns:
        Whether it will.
    """
    if _VARIABLE in os.environ:
        return False
    os.environ[_VARIABLE] = _OF_LAUNCHER
    return True


def ask_nodes_for_refusals() -> None:
    """Have Zenoh say the same, and when it refuses a message, in processes started from now on."""
    os.environ[_VARIABLE] = _OF_NODES


@contextlib.contextmanager
def asked_as_nodes_are() -> Iterator[None]:
    """What is started meanwhile says what nodes say, though the launcher has yet to connect."""
    of_launcher = os.environ.get(_VARIABLE)
    if of_launcher != _OF_LAUNCHER:
        yield
        return
    ask_nodes_for_refusals()
    try:
        yield
    finally:
        os.environ[_VARIABLE] = of_launcher


@contextlib.contextmanager
def own_refusals(show: Callable[[str], None]) -> Iterator[None]:
    """What Zenoh says in this process of refusals, which it writes on standard output, is read meanwhile.

    Python's own standard output stays where it is.

    Args:
        show: called with each sentence, and each other line that Zenoh writes, on a thread of its own.
    """
    reading, writing = os.pipe()
    before, kept = sys.stdout, os.dup(_STANDARD_OUTPUT)
    sys.stdout = os.fdopen(os.dup(kept), "w", encoding=before.encoding, errors=before.errors)
    os.dup2(writing, _STANDARD_OUTPUT)
    os.close(writing)
    refusals = Refusals()

    def read() -> None:
        with open(reading, encoding="utf-8", errors="replace") as lines:
            for line in lines:
                shown = refusals.instead(line.rstrip("\n"))
                if shown is not None:
                    show(shown)

    reader = threading.Thread(target=read, name="refusals", daemon=True)
    reader.start()
    try:
        yield
    finally:
        os.dup2(kept, _STANDARD_OUTPUT)  # nobody writes into the pipe any more: its reader ends
        os.close(kept)
        reader.join()
        with contextlib.suppress(OSError):  # it is gone, or the disk is full: it was said before
            sys.stdout.close()
        sys.stdout = before


class Refusals:
    """Reads what one process says. Where the user has asked Zenoh for something, that is shown as it is."""

    def __init__(self) -> None:
        self._is_asked = os.environ.get(_VARIABLE) in (_OF_NODES, _OF_LAUNCHER)
        self._next_s: dict[tuple[str, str], float] = {}
        """When it may be said again, for each kind of refusal and reason."""
        self._unsaid: collections.Counter[tuple[str, str]] = collections.Counter()

    def instead(self, line: str) -> str | None:
        """What is shown instead of ``line``: itself, a sentence, or nothing.

        Args:
            line: of the process's output.
        """
        is_zenoh = self._is_asked and "zenoh" in line
        said = _SAID.fullmatch(_COLOURS.sub("", line)) if is_zenoh else None
        if said is None or said["source"] not in (_LINKS, _MESSAGES):
            return line
        kind, now_s = said["source"], time.monotonic()
        if kind == _MESSAGES and not said["thread"].startswith(_RECEIVING):
            return None
        reason = _HINT.sub("", said["text"]) if kind == _LINKS else ""
        key = kind, reason if len(self._next_s) < _MOST_REASONS else ""
        self._unsaid[key] += 1
        if now_s < self._next_s.get(key, now_s):
            return None
        self._next_s[key] = now_s + _PERIOD_S
        count = self._unsaid.pop(key)
        if kind == _LINKS:
            who = "somebody without a valid certificate of this system"
            return f"refused {_several(count, 'link')} to {who}: {reason}"
        return (
            f"refused {_several(count, 'message')} that the sender's certificate does not allow; "
            f"{_WHICH} says which"
        )


def _several(count: int, noun: str) -> str:
    return f"a {noun}" if count == 1 else f"{count} {noun}s"
