"""How large a file is, before any of it is read."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def size_of(path: Path) -> int:
    """The bytes of the file at ``path``.

    Raises:
        OSError: there is none, or it is a pipe or a device: reading one may never end.
    """
    try:
        found = path.stat()
    except ValueError:  # what Python says of a NUL character in a path
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL)) from None
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OSError(errno.EINVAL, "a pipe or a device, which may never end; save it as a file")
    return found.st_size
