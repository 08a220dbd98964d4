"""Memory that nobody uses any more, back to the operating system.

The judges of a robot are thousands of small pieces, allocated by the threads of all robots in turn. When
they are freed, the C library keeps the pages for the next ones: with many robots that pass, a monitor grows.
"""

from __future__ import annotations

import ctypes
import os


def give_back() -> None:
    """Give back what is free; a C library other than glibc keeps it. Takes some ms."""
    if os.name != "posix":
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
