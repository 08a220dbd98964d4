"""Verdicts as lines of JSON in a file that survives the monitor."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from m2c.json_lines import versioned_line
from moon.verdict import Verdict


class VerdictFile:
    """Appends a line for each verdict to the file at ``path``.

    Each line is one ``write(2)``: whatever ends the monitor, even SIGKILL, what it had reported is in the
    file, and no line is half there. (A line that an earlier run could not finish, on a full disk, is
    ended first.)

    Raises:
        OSError: it cannot be opened, or not written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
        self._file = os.open(path, flags, 0o644)
        about = os.fstat(self._file)
        size = about.st_size if stat.S_ISREG(about.st_mode) else 0
        if size and os.pread(self._file, 1, size - 1) != b"\n":
            self._write(b"\n")

    def take(self, verdict: Verdict) -> None:
        """Write ``verdict``."""
        self._write(versioned_line(verdict) + b"\n")

    def close(self) -> None:
        """Close the file; idempotent."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write(self, line: bytes) -> None:
        try:
            written = os.write(self._file, line)
            if written < len(line):  # a full disk takes a part
                os.write(self._file, line[written:])
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error
