"""What the tests take for left over in shared memory is nobody's."""

from __future__ import annotations

import atexit
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.transports import shared_memory

BUSY = """
import mmap, sys
with open(sys.argv[1], "r+b") as file, open(sys.argv[2], "rb"):
    held = mmap.mmap(file.fileno(), 0)
    print("ready", flush=True)
    while True:
        for other in [open("/dev/null") for _ in range(8)]:
            other.close()
"""
"""Has one file mapped and one open, and opens and closes others all the time, as who imports modules does."""


@pytest.fixture
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in place of /dev/shm."""
    monkeypatch.setattr(shared_memory, "SHARED", tmp_path)
    monkeypatch.setattr(shared_memory, "_later", set())
    return tmp_path


def make(shared: Path, *names: str) -> list[Path]:
    paths = [shared / name for name in names]
    for path in paths:
        path.write_bytes(bytes(4096))
    return paths


@pytest.fixture
def held(shared: Path) -> Iterator[list[Path]]:
    """Files that another process uses."""
    paths = make(shared, "fastrtps_port7001", "fastrtps_port7001_el")
    with subprocess.Popen(
        [sys.executable, "-c", BUSY, *map(str, paths)], stdout=subprocess.PIPE, text=True
    ) as busy:
        assert busy.stdout is not None
        assert busy.stdout.readline() == "ready\n"
        yield paths
        busy.kill()


def test_what_a_busy_process_uses_is_in_use(shared: Path, held: list[Path]) -> None:
    make(shared, "fastrtps_port7002")
    for _ in range(50):
        assert shared_memory.unused() == {"fastrtps_port7002"}


def test_mailboxes_of_the_own_domain_go_at_once(shared: Path) -> None:
    make(shared, "fastrtps_port7661", "sem.fastrtps_port7661_mutex", "fastrtps_port8000")
    shared_memory.remove_mailboxes(1, before=set())
    assert {path.name for path in shared.iterdir()} == {"fastrtps_port8000"}


def test_those_of_any_domain_go_when_nobody_can_be_about_to_use_them(
    shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(shared, "fastrtps_port7003")
    monkeypatch.setattr(atexit, "register", lambda work: work)
    shared_memory.remove_mailboxes(1, before=set())
    assert list(shared.iterdir())
    monkeypatch.setattr(shared_memory, "SETTLED_S", -1.0)
    shared_memory.remove_mailboxes(1, before=set(shared_memory.unused()))
    assert not list(shared.iterdir())


def test_what_was_there_before_stays(shared: Path) -> None:
    make(shared, "fastrtps_port7661", "fastrtps_port7003")
    shared_memory.remove_mailboxes(1, before=shared_memory.unused())
    assert len(list(shared.iterdir())) == 2
