"""What a node's code raised, as its author reads it: by frames of that code, not of what calls it."""

from __future__ import annotations

import os
import sysconfig
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from m2c.printable import near

_HERE = Path(__file__).parents[1]
_OURS = (f"{_HERE / 'm2c'}/", f"{_HERE / 'transports'}/", "<frozen ")
"""How the files of frames begin that are of no node's own code."""
_LIBRARIES = tuple(
    f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")
)


def described(error: Exception) -> str:
    """``error`` in one line, with the line of code that raised it: of the node's own, where there is one."""
    text = f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    if not frames or isinstance(error, SyntaxError):  # which names its place
        return text
    return f"{text}, in {_place(frames)}"


def traceback_of(error: BaseException) -> str:
    """The traceback of ``error`` and of what it came of, each without frames of m2c and of transports, unless
    there are no others.
    """
    told = traceback.TracebackException.from_exception(error)
    part: traceback.TracebackException | None = told
    while part is not None:
        own = [frame for frame in part.stack if not frame.filename.startswith(_OURS)]
        part.stack = traceback.StackSummary.from_list(own or part.stack)
        part = part.__cause__ or part.__context__
    return "".join(told.format()).rstrip("\n")


def where(frame: FrameType | None) -> str:
    """Where code stands that ``frame`` is the innermost frame of: ``worker.py, line 7: time.sleep(9)``."""
    frames = traceback.extract_stack(frame)
    return _place(frames) if frames else "an unknown place"


def _place(frames: Sequence[traceback.FrameSummary]) -> str:
    """The innermost of the node's own; with none, the innermost that is not ours."""
    outside = [frame for frame in frames if not frame.filename.startswith(_OURS)]
    own = [frame for frame in outside if not frame.filename.startswith(_LIBRARIES)]
    last = (own or outside or frames)[-1]
    module = last.filename.removeprefix("<").partition("#")[0]  # m2c.simulation.program names it so
    return f"{near(module) if os.path.isabs(module) else module}, line {last.lineno}: {last.line}"
