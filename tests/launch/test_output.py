"""What several processes write at once: each line arrives whole, behind the name of who wrote it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.launch.system import LIMIT_S

NAMES = "abcdef"
LINES = 100

WRITER = """
import os
import sys

name, count, length = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
for number in range(count):
    line = f"{name}{number:04d}{name * length}\\n".encode()
    for start in range(0, len(line), 3001):  # lines come in pieces, on either stream
        os.write(1 + number % 2, line[start : start + 3001])
"""

LAUNCHER = """
import sys
import threading
from pathlib import Path

from m2c.launch.process import Module, NodeProcess
from m2c.launch.screen import Lines

folder, names, *arguments = sys.argv[1:]
screen = Lines()
ended = threading.Semaphore(0)
for name in names:
    NodeProcess(
        name, Module("writer", [Path(folder)], [name, *arguments]),
        lambda name, text: screen.line(f"{name} | {text}"),
        lambda name, code: ended.release(),
    )
for _ in names:
    ended.acquire()
"""


@pytest.mark.parametrize("length", [100, 20_000, 200_000])
def test_lines_that_processes_write_at_once_arrive_whole_and_in_order(
    length: int, tmp_path: Path
) -> None:
    package = tmp_path / "writer"
    package.mkdir()
    (package / "__main__.py").write_text(WRITER)
    command = [sys.executable, "-c", LAUNCHER, tmp_path, NAMES, LINES, length]
    ran = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=LIMIT_S, check=True
    )
    told: dict[str, list[int]] = {name: [] for name in NAMES}
    for line in ran.stdout.splitlines():
        found = re.fullmatch(r"([a-f]) \| \1(\d{4})(\1+)", line)
        assert found is not None, f"{line[:60]} … {line[-60:]}"
        assert len(found[3]) == length
        told[found[1]].append(int(found[2]))
    assert told == {name: list(range(LINES)) for name in NAMES}


def test_a_file_of_the_folder_where_it_is_run_takes_no_package_s_place(tmp_path: Path) -> None:
    package, here = tmp_path / "generated" / "writer", tmp_path / "here"
    package.mkdir(parents=True)
    here.mkdir()
    (package / "__main__.py").write_text(WRITER)
    (here / "writer.py").write_text("print('the file of a person, called as the package')\n")
    command = [sys.executable, "-c", LAUNCHER, package.parent, "a", 1, 3]
    ran = subprocess.run(
        list(map(str, command)),
        cwd=here,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=True,
    )
    assert ran.stdout == "a | a0000aaa\n"
