"""What the tests take for left over in shared memory is nobody's."""

from __future__ import annotations

import os
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


def test_mailboxes_of_a_domain_go(shared: Path) -> None:
    others = make(shared, "fastrtps_port7900", "fastrtps_port7003", "fastrtps_00ff00ff00ff00ff")
    make(shared, "fastrtps_port7661", "fastrtps_port7661_el", "sem.fastrtps_port7661_mutex")
    shared_memory.remove_mailboxes(shared_memory.ports_of(1), before=set())
    assert sorted(shared.iterdir()) == sorted(others)


def test_those_of_all_domains_go(shared: Path) -> None:
    others = make(shared, "fastrtps_port7400", "fastrtps_port7661")
    make(shared, "fastrtps_port7003", "fastrtps_port7399_el")
    shared_memory.remove_mailboxes(shared_memory.SHARED_PORTS, before=set())
    assert sorted(shared.iterdir()) == others


def test_what_was_there_before_or_is_in_use_stays(shared: Path, held: list[Path]) -> None:
    before = make(shared, "fastrtps_port7003")
    shared_memory.remove_mailboxes(shared_memory.SHARED_PORTS, before=shared_memory.unused())
    shared_memory.remove_mailboxes(shared_memory.SHARED_PORTS, before={"fastrtps_port7003"})
    assert sorted(shared.iterdir()) == sorted([*held, *before])


SEPARATE = """
import subprocess, sys
from tests.transports import shared_memory
is_own = shared_memory.separate()
(shared_memory.SHARED / sys.argv[1]).touch()
subprocess.run(["test", "-e", shared_memory.SHARED / sys.argv[1]], check=True)
print(is_own)
"""


def test_what_stands_in_shared_memory_of_ones_own_is_seen_by_nobody_else(tmp_path: Path) -> None:
    name = f"{tmp_path.parent.name}-{tmp_path.name}"
    others = {key: value for key, value in os.environ.items() if key != shared_memory.OWN}
    command = [sys.executable, "-c", SEPARATE, name]
    done = subprocess.run(command, env=others, capture_output=True, text=True, check=True)
    seen = shared_memory.SHARED / name
    is_seen = seen.exists()
    seen.unlink(missing_ok=True)
    assert done.stdout.strip() == str(not is_seen)
