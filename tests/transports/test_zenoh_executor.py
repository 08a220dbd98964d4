"""What is due and what has come, in the order in which it should have been done."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from transports.zenoh_link.executor import Executor


class HeldUp:
    """A queue whose reader is held up: it wakes late, and something has come meanwhile."""

    def __init__(self, executor: Executor, work: Any) -> None:
        self._work = [work]
        self._queue = executor._queue
        executor._queue = self  # type: ignore[assignment]  # a thread cannot be held up at will

    def get(self, timeout: float | None = None) -> Any:
        if not self._work or not self._queue.empty():
            return self._queue.get(timeout=timeout)
        late = time.monotonic() + (timeout or 0.0) + 0.01
        while time.monotonic() < late:
            pass
        return self._work.pop()


def test_a_timer_that_was_slept_through_comes_before_what_came_meanwhile():
    executor = Executor()
    done: list[str] = []
    HeldUp(executor, (done.append, "work"))
    executor.after(0.005, lambda: done.append("timer"))
    executor.spin(lambda: len(done) == 2)
    assert done == ["timer", "work"]


def test_a_timer_that_another_one_cancels_does_not_run_though_both_were_slept_through():
    executor = Executor()
    done: list[str] = []
    HeldUp(executor, (done.append, "work"))
    executor.after(0.005, lambda: (done.append("first"), second.cancel()))
    second = executor.after(0.006, lambda: done.append("second"))
    executor.spin(lambda: "work" in done)
    assert done == ["first", "work"]


WAITS_FOR_A_SIGNAL = """
import signal, sys, threading
from transports.stop_signals import StopSignals
from transports.zenoh_link.executor import Executor

def receive_it():
    sys.stdin.readline()
    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)

executor = Executor()
StopSignals().call(executor.close)
executor.post(lambda: print("waits", flush=True))
threading.Thread(target=receive_it).start()
executor.spin()
print("ended")
"""


def test_a_signal_that_does_not_interrupt_the_wait_ends_it_all_the_same():
    """As one that comes when the main thread has looked for signals, and does not wait yet."""
    process = subprocess.Popen(
        [sys.executable, "-c", WAITS_FOR_A_SIGNAL],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "waits\n"
        status = Path(f"/proc/{process.pid}/status")  # of the main thread
        while "State:\tS" not in status.read_text():
            os.sched_yield()
        said, _ = process.communicate("now\n", timeout=30)
        assert said == "ended\n"
        assert process.returncode == 0
    finally:
        process.kill()
        process.wait()
