"""The way to the terminal: what a command tells its user passes here, and is safe to show then.

Nothing else prints (ruff's T201 and TID251 see to it), except the pictures that rich redraws in place:
those are made of :class:`rich.text.Text`, of texts that were made printable.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
import threading
from typing import NoReturn, TextIO

from m2c.printable import printable

_WRITING = threading.RLock()
"""Held while lines are written: each process of a running system has a thread that shows its output, and
Python's text streams are not made for several (a line longer than their buffer was broken by another's).
A signal's handler may have something to say while its own thread writes: hence a reentrant lock."""
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_BEFORE = re.compile(r" *(?:[^ ]+(?: [^ ]+)? {2,})?")
"""What stands before a line's text: spaces, and a word or two that say what it is."""
_LEAST_INDENT = 4
_LEAST_COLUMNS = 20
"""Of a terminal that lines are folded for: it may say that it has none."""
_NAMES = {"<stdout>": "standard output", "<stderr>": "standard error"}


def show(*lines: str) -> None:
    """Write ``lines`` on standard output: one line each, whatever is in it."""
    show_painted(*map(printable, lines))


def say(*lines: str) -> None:
    """Write ``lines`` on standard error: one line each, whatever is in it.

    Where that is a terminal that is gone, or a full disk, nobody is told: what is done goes on.
    """
    with contextlib.suppress(OSError):
        show_painted(*map(printable, lines), stream=sys.stderr)


def fail(*lines: str) -> NoReturn:
    """End the process with exit code 2: it could not do what was asked, for the reason in ``lines``."""
    first, *others = lines
    say(f"error: {first}", *others)
    sys.exit(2)


def show_painted(*lines: str, stream: TextIO | None = None) -> None:
    """Write lines that have our own colours in them; the texts between were made printable before.

    On whatever thread: they arrive whole, and none of another thread between them.

    Args:
        lines: what is written, at once.
        stream: where to; standard output by default.

    Raises:
        BrokenPipeError: nobody reads it any more.
        OSError: it cannot be written, with the name of the stream as ``filename``.
    """
    out = sys.stdout if stream is None else stream
    encoding = out.encoding or "utf-8"
    text = "".join(f"{line}\n" for line in lines)
    try:
        with _WRITING:
            out.write(text.encode(encoding, "backslashreplace").decode(encoding))
            out.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        name = getattr(out, "name", "")
        raise OSError(error.errno, error.strerror, _NAMES.get(name, name)) from error


def give_up(error: OSError) -> NoReturn:
    """End the process with exit code 2: the system refused something, and nobody knew what to do then."""
    where = f"{error.filename}: " if error.filename else ""
    say(f"error: {where}{error.strerror or error}")
    write_to_nobody()
    sys.exit(2)


def has_colour(stream: TextIO | None = None) -> bool:
    """Whether lines on ``stream``, by default standard output, are coloured.

    They are on a terminal, unless the environment's ``NO_COLOR`` is not empty (no-color.org).
    """
    out = sys.stdout if stream is None else stream
    return out.isatty() and not os.environ.get("NO_COLOR")


def folded(line: str, indent: int | None = None, stream: TextIO | None = None) -> list[str]:
    """``line`` as lines that fit the terminal, all but the first indented; as it is in a file or a pipe.

    Args:
        line: its colours (SGR) take no room.
        indent: spaces before each line but the first, less where these would leave no room; by default as
            many as the text of the first has before it, a first word with two spaces behind it included.
        stream: where it is to be written; standard output by default.
    """
    out = sys.stdout if stream is None else stream
    if not out.isatty():
        return [line]
    columns = max(shutil.get_terminal_size().columns, _LEAST_COLUMNS)
    if indent is None:
        before = _BEFORE.match(_COLOUR.sub("", line))
        indent = max(len(before[0]) if before else 0, _LEAST_INDENT)
    margin = " " * min(indent, columns // 2)
    lines, used = [""], 0
    for found in re.findall(r" *[^ ]+", line):
        word = found
        if used + _shown(word) > columns and lines[-1].strip():
            word = margin + word.lstrip(" ")
            lines.append("")
            used = 0
        lines[-1] += word
        used += _shown(word)
    return lines


def _shown(text: str) -> int:
    """The columns that ``text`` takes."""
    return len(_COLOUR.sub("", text))


def write_to_nobody() -> None:
    """Let what is still buffered go nowhere: Python would complain of it when it ends, with exit code 120."""
    with contextlib.suppress(
        OSError
    ):  # no file can be opened: then it was not the output that failed
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere, stream.fileno())
