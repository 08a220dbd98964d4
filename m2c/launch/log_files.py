"""``m2c run --log-dir``: what each node prints and logs, in a file of its own."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import IO

from m2c.launch.description import LaunchError
from m2c.launch.screen import Said
from m2c.printable import printable
from m2c.terminal import say


class LogFiles:
    """A file for each node, ``<node>.log``, to which lines are added, each behind its time.

    Args:
        folder: where they are; it is made. None: nothing is kept.

    Raises:
        LaunchError: ``folder`` cannot be made.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._files: dict[str, IO[str]] = {}
        self._lock = threading.Lock()
        try:
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LaunchError(f"--log-dir {folder}: {error.strerror}") from error

    def write(self, said: Said) -> None:
        """Add a line; where it cannot be written, that is said, and no more is kept. Any thread."""
        day = "" if said.is_virtual else f"{said.day()} "
        with self._lock:
            if self._folder is None:
                return
            try:
                if said.node not in self._files:
                    path = self._folder / f"{said.node}.log"
                    self._files[said.node] = path.open("a", encoding="utf-8", buffering=1)
                self._files[said.node].write(f"{day}{said.clock()} {printable(said.text)}\n")
            except OSError as error:
                say(f"warning: --log-dir {self._folder}: {error.strerror}; no more is kept there")
                self._folder = None

    def close(self) -> None:
        """Close the files; nothing is kept any more."""
        with self._lock:
            self._folder = None
            for file in self._files.values():
                file.close()
