"""Commands on a terminal of their own, and what a terminal may be told by them."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import threading
from pathlib import Path

WAIT_S = 60.0
"""How long a test waits for what must happen; only a failing test waits that long."""
BIN = Path(sys.executable).parent

HOSTILE = (
    "\x1b]0;owned\x07\x1b[13A\x1b[8m\x1bc\x9b31m\x90q\x9c\x7f\b\r\n0 violations, all is well\u2028"
    "\u202egnp\u2066\u200f\u061c\u200b\ufeff\u00ad"
)
"""Sets the window's title, moves up, conceals, resets, draws, erases, forges a line, turns text round."""
SHOWN = r"\x1b]0;owned\x07\x1b[13A\x1b[8m\x1bc\x9b31m"
"""How that begins where it is shown."""
IN_XML = "&#x9b;31m&#x9d;0;owned&#x9c;&#10;forged: line&#x202e;&#x2066;&#x200b;"
"""What XML 1.0 has of it (2.2): C1 controls, ends of lines, format characters."""

_OURS = re.compile(r"\x1b\[[0-9;]*m|\x1b\[\d*[ABK]|\x1b\[\?25[lh]|[\r\n]")
"""Colours (SGR), going up and down, clearing a line, the cursor's look, and ends of lines (ECMA-48)."""


class OnTerminal:
    """A command of ours that runs on a terminal, 60 lines high."""

    def __init__(self, *command: object, cwd: Path | None = None, columns: int = 250) -> None:
        self._seen = b""
        self._changed = threading.Condition()
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 60, columns, 0, 0))
        environment = {**os.environ, "TERM": "xterm-256color", "PYTHONIOENCODING": "utf-8"}
        for name in ("NO_COLOR", "COLUMNS", "LINES"):  # the terminal's own size counts
            environment.pop(name, None)
        self.process = subprocess.Popen(
            [str(BIN / str(command[0])), *map(str, command[1:])],
            stdin=theirs, stdout=theirs, stderr=theirs, env=environment, cwd=cwd,
        )  # fmt: skip
        os.close(theirs)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        self._watchdog = threading.Timer(WAIT_S, self.process.kill)
        self._watchdog.start()

    def _read(self) -> None:
        while True:
            try:
                more = os.read(self._ours, 65536)
            except OSError:  # the other side is closed: the process has ended
                more = b""
            with self._changed:
                self._seen += more
                self._over = not more
                self._changed.notify_all()
            if not more:
                return

    _over = False

    @property
    def text(self) -> str:
        """All that the terminal was sent."""
        return self._seen.decode()

    def until(self, words: str) -> None:
        """Wait until the terminal was sent ``words``."""
        with self._changed:
            self._changed.wait_for(lambda: words.encode() in self._seen or self._over, WAIT_S)
        assert words in self.text, self._seen

    def end(self, number: signal.Signals | None = None) -> int:
        """Its exit code, after ``number`` was sent (None: it ends by itself)."""
        if number is not None:
            self.process.send_signal(number)
        code = self.process.wait(WAIT_S)
        self._watchdog.cancel()
        self._reader.join(WAIT_S)
        os.close(self._ours)
        return code


def require_harmless(text: str) -> None:
    """That a terminal which is sent ``text`` obeys nobody but us."""
    for line in _OURS.sub("\n", text).split("\n"):
        assert line.isprintable(), ascii(line)
        assert not line.startswith(("0 violations, all", "forged"))
    assert "\x1b[13A" not in text
    assert "\x1b[8m" not in text
    assert "Traceback" not in text
