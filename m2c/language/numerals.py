"""Numbers as people write them in models, policies and properties.

They are decimal, of the digits 0 to 9: Python's own ``int`` and ``float`` would also take ``1_0`` and the
digits of other scripts, which no other tool reads.
"""

from __future__ import annotations

import re

_INTEGER = re.compile(r"\s*[+-]?[0-9]{1,400}\s*")
_DECIMAL = re.compile(r"\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?\s*")
_NOT_FINITE = re.compile(r"\s*[+-]?(inf|infinity|nan)\s*", re.IGNORECASE | re.ASCII)


def integer(text: str) -> int | None:
    """The integer that ``text`` is; None if it is none."""
    return int(text) if _INTEGER.fullmatch(text) else None


def decimal(text: str) -> float | None:
    """The number that ``text`` is, ``inf`` and ``nan`` among them as C has it; None if it is none."""
    is_number = _DECIMAL.fullmatch(text) or _NOT_FINITE.fullmatch(text)
    return float(text) if is_number else None
