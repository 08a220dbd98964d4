"""Paths that somebody wrote: what stands there, without a hang and without more than one reason."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from m2c.model.file_size import size_of

MAX_ENTRIES = 100_000
"""Files and folders below one that is searched: ROS 2's own packages have a tenth of that."""
_TOO_LARGE = f"has more than {MAX_ENTRIES} files below it; name a folder in it"


def why_no_file(path: Path) -> str:
    """Why there is no file to be read at ``path``; "" if there is one."""
    try:
        size_of(path)
    except OSError as error:
        return error.strerror or str(error)
    return os.strerror(errno.EISDIR) if os.path.isdir(path) else ""


def why_no_folder(path: Path) -> str:
    """Why ``path`` is no folder that can be searched; "" if it is one."""
    if not os.path.isdir(path):
        return "is not a folder" if os.path.exists(path) else "does not exist"
    try:
        entries_below(path)
    except OSError as error:
        return str(error.strerror)
    return ""


def entries_below(folder: Path) -> list[Path]:
    """The files and folders below ``folder``, sorted; links are named, not followed.

    Raises:
        OSError: they are more than ``MAX_ENTRIES``, as in ``/``.
    """
    found: list[Path] = []
    for parent, folders, files in os.walk(folder):
        found += [Path(parent, name) for name in (*folders, *files)]
        if len(found) > MAX_ENTRIES:
            raise OSError(errno.EFBIG, _TOO_LARGE)
    return sorted(found)
