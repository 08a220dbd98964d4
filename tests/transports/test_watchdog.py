"""A process whose middleware does not return is ended, whoever holds Python's lock, and says why."""

from __future__ import annotations

import subprocess
import sys

import pytest

from transports.watchdog import EXIT_CODE

BEGIN = """
import ctypes, resource, threading
from transports.watchdog import ended_after
hold = ctypes.PyDLL(None).pause  # with the interpreter's lock in hand, and for ever
"""
HELD = """
with ended_after(0.2, "closing"):
    hold()
"""
WAITING = """
with ended_after(0.2, "closing"):
    threading.Event().wait()
"""
ON_A_THREAD = """
def close():
    with ended_after(0.2, "closing"):
        hold()
threading.Thread(target=close).start()
"""
TWO_AT_ONCE = """
def close():
    with ended_after(60, "another"):
        hold()
with ended_after(0.2, "closing"):
    threading.Thread(target=close).start()
    hold()
"""
AFTER_ONE_THAT_ENDED = """
with ended_after(1, "what is done"):
    pass
with ended_after(2, "closing"):
    hold()
"""
AFTER_ONE_THAT_FAILED = """
try:
    with ended_after(1, "what has failed"):
        raise OSError
except OSError:
    with ended_after(2, "closing"):
        hold()
"""
NO_TIMER_IS_LEFT = """
resource.setrlimit(resource.RLIMIT_SIGPENDING, (0, 0))
with ended_after(0.2, "closing"):
    print("closed")
"""


def ends(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BEGIN + code],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    ("code", "limit"),
    [
        pytest.param(HELD, "0.2", id="held"),
        pytest.param(WAITING, "0.2", id="waiting"),
        pytest.param(ON_A_THREAD, "0.2", id="on a thread"),
        pytest.param(TWO_AT_ONCE, "0.2", id="two at once"),
        pytest.param(AFTER_ONE_THAT_ENDED, "2", id="after one that ended"),
        pytest.param(AFTER_ONE_THAT_FAILED, "2", id="after one that failed"),
    ],
)
def test_what_takes_too_long_ends_its_process_with_one_line(code: str, limit: str) -> None:
    done = ends(code)
    (line,) = done.stderr.splitlines()
    assert line.endswith(f": closing takes longer than {limit} s; the process is ended")
    assert done.returncode == EXIT_CODE


def test_what_is_said_is_text_whatever_is_in_it() -> None:
    done = ends(HELD.replace("closing", "100 % of %s %n"))
    assert ": 100 % of %s %n takes longer" in done.stderr
    assert done.returncode == EXIT_CODE


def test_without_a_timer_it_is_done_unwatched() -> None:
    done = ends(NO_TIMER_IS_LEFT)
    assert (done.returncode, done.stdout, done.stderr) == (0, "closed\n", "")
