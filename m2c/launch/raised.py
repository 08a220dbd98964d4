"""What a node's code raised, in a line."""

from __future__ import annotations

import traceback
from pathlib import Path

_HERE = Path(__file__).parents[2]
_OURS = (f"{_HERE / 'm2c'}/", f"{_HERE / 'transports'}/", "<frozen ")
"""How the files of frames begin that are of no node's own code."""


def described(error: Exception) -> str:
    """``error`` in one line, with the line of code that raised it: of the node's own, where there is one."""
    text = f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    if not frames or isinstance(error, SyntaxError):  # which names its place
        return text
    own = [frame for frame in frames if not frame.filename.startswith(_OURS)]
    last = (own or frames)[-1]
    module = last.filename.removeprefix("<").partition("#")[0]  # m2c.simulation.program names it so
    return f"{text}, in {module}, line {last.lineno}: {last.line}"
