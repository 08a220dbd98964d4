"""The way to the terminal: what a command tells its user passes here, and is safe to show then.

Nothing else prints (ruff's T201 and TID251 see to it), except the pictures that rich redraws in place:
those are made of :class:`rich.text.Text`, of texts that were made printable.
"""

from __future__ import annotations

import sys
from typing import NoReturn, TextIO

from m2c.printable import printable


def show(*lines: str) -> None:
    """Write ``lines`` on standard output: one line each, whatever is in it."""
    show_painted(*map(printable, lines))


def say(*lines: str) -> None:
    """Write ``lines`` on standard error: one line each, whatever is in it."""
    show_painted(*map(printable, lines), stream=sys.stderr)


def fail(*lines: str) -> NoReturn:
    """End the process with exit code 2: it could not do what was asked, for the reason in ``lines``."""
    first, *others = lines
    say(f"error: {first}", *others)
    sys.exit(2)


def show_painted(*lines: str, stream: TextIO | None = None) -> None:
    """Write lines that have our own colours in them; the texts between were made printable before.

    Args:
        lines: what is written, at once.
        stream: where to; standard output by default.
    """
    out = sys.stdout if stream is None else stream
    encoding = out.encoding or "utf-8"
    text = "".join(f"{line}\n" for line in lines)
    out.write(text.encode(encoding, "backslashreplace").decode(encoding))
    out.flush()
