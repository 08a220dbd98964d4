"""Text of others, so that it is safe to show, and paths, so that they are short.

Names in models and files, what comes from the wire and what nodes log may hold anything: sequences that
command a terminal (ECMA-48: ESC and its relatives among the C0 and C1 controls), ends of lines that begin a
line of somebody else's, marks that reorder what is read (Unicode Standard Annex 9) or that take no room.
"""

from __future__ import annotations

import os
from pathlib import Path


def printable(text: str) -> str:
    r"""``text`` on one line, with an escape such as ``\x1b`` or ``\u202e`` for what cannot be seen.

    That is every character that Unicode counts among "other" (controls, formats, surrogates, unassigned)
    and "separators" except the space: those for which :meth:`str.isprintable` does not hold.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def near(place: str | Path) -> str:
    """``place``, a path or ``file:line:column``, as seen from the current folder, where that is shorter."""
    written = str(place)
    seen = os.path.relpath(written)
    return seen if len(seen) < len(written) else written
