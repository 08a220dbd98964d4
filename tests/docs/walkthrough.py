"""Pages that are followed to the letter: files are written, commands run, in one shell, as the text says.

A fenced block with a language is a file, named by the backquoted path with which the paragraph before it
begins. In a block without one, a line that begins with ``$`` is a command, and what follows is its output;
``...`` stands for any lines.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from tests.docs.test_examples_in_documents import BLOCK, commands_of

MARK = "the command has ended"
MOST_S = 600.0
"""What no command takes: interfaces are built in minutes on a busy machine."""
DEFAULT_PORT = "127.0.0.1:7447"
OWN_PORT = """\
meet() {
  case "$*" in
    *simulated*|*ros2*) ;;
    *--secure*) set -- "$@" --endpoint "tls/$PORT" ;;
    "m2c run"*|"moon tap"*|"moon record"*|"moon monitor"*) set -- "$@" --endpoint "tcp/$PORT" ;;
  esac
  if [ "$BASHPID" = "$$" ]; then command "$@"; else exec "$@"; fi  # in the background it is what is killed
}
m2c() { meet m2c "$@"; }
moon() { meet moon "$@"; }
"""
"""Has the nodes of this test meet where nobody else does."""
NUMBER = re.compile(r"\d+(?:[.:,]\d+)*")
TOOK = re.compile(r"in \d+\.\d+ s")
VARYING = (
    "m2c run ",
    "m2c doctor ",
    "moon check ",
    "moon record ",
    "moon tap ",
    "moon keys ",
    "cat ",
)
"""Commands that show what happened in real time, or what is installed: their numbers vary."""


class File(msgspec.Struct, frozen=True):
    """A file that a page has its reader write."""

    path: str
    text: str


class Command(msgspec.Struct, frozen=True):
    """A command of a page, and the lines that it shows below."""

    text: str
    shown: tuple[str, ...]


def steps(page: Path) -> Iterator[File | Command]:
    """What ``page`` has its reader do, in order."""
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        language, content = block.groups()
        paragraph = text[: block.start()].rstrip().rpartition("\n\n")[2]
        named = re.match(r"`([\w./-]+)`", paragraph)
        if not language:
            for command, shown in commands_of(content):
                yield Command(command, tuple(shown))
        else:
            assert named is not None, f"{page.name}: which file is this?\n{content}"
            yield File(named[1], content)


def difference(command: Command, said: Sequence[str]) -> str:
    """What ``command`` said if it is not what the page shows, else nothing."""
    varies = command.text.startswith(VARYING) and "simulated" not in command.text
    plain = [_plain(line, varies) for line in said]
    lines = [_plain(line, varies) for line in command.shown]
    pattern = "".join(r"(?:.*\n)*?" if line == "..." else re.escape(line) + r"\n" for line in lines)
    if re.fullmatch(pattern, "".join(f"{line}\n" for line in plain)):
        return ""
    return "\n".join([f"$ {command.text}", *said])


def _plain(line: str, varies: bool) -> str:
    line = TOOK.sub("in # s", line)
    if varies and line != "...":
        line = re.sub(r"\s+", " ", NUMBER.sub("#", line)).strip()
    return line.rstrip()


class Shell(AbstractContextManager["Shell"]):
    """One shell that runs command after command; what they start ends with it.

    Args:
        folder: where it begins.
        environment: its variables, and nothing else.
        port: address and port where nodes meet instead of at the default ones.
    """

    def __init__(self, folder: Path, environment: dict[str, str], port: str) -> None:
        self.folder = folder
        self._port = port
        self._process = subprocess.Popen(
            ["bash", "--noprofile", "--norc"],
            cwd=folder,
            env={**environment, "PORT": port},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.run(OWN_PORT)

    def write(self, file: File) -> None:
        """Write a file below the folder in which the shell is now."""
        (here,) = self.run("pwd")
        path = Path(here) / file.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(file.text, encoding="utf-8")

    def run(self, command: str) -> list[str]:
        """Run it; the lines that it prints."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(
            f"{command}\n_code=$?; printf '\\n%s\\n' '{MARK}'; (exit $_code)\n"
        )
        self._process.stdin.flush()
        said: list[str] = []
        ender = threading.Timer(MOST_S, self._end)
        ender.start()
        try:
            for line in self._process.stdout:
                if line.rstrip("\n") == MARK:
                    break
                said.append(line.rstrip("\n").replace(self._port, DEFAULT_PORT))
            else:
                raise AssertionError("\n".join([f"does not end: {command}", *said]))
        finally:
            ender.cancel()
        if said and not said[-1]:
            said.pop()
        return said

    def _end(self) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        self._end()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()
