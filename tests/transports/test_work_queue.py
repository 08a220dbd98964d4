"""Waiting for work, and for no longer than is asked, however short that is."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from queue import Empty

import pytest

from transports.simulated import SimulatedWorld
from transports.work_queue import WorkQueue
from transports.zenoh_link.executor import Executor

pytestmark = pytest.mark.slow

PATIENCE_S = 60.0


@pytest.fixture(autouse=True)
def _interrupted() -> object:
    """Threads are taken off the processor as often as can be, so that deadlines pass in between."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def ends(work: Callable[[], None], rivals: int = 2) -> bool:
    """Whether ``work`` ends, with other threads that are busy meanwhile."""
    over = threading.Event()
    threads = [threading.Thread(target=_be_busy, args=[over], daemon=True) for _ in range(rivals)]
    worker = threading.Thread(target=work, daemon=True)
    for thread in (*threads, worker):
        thread.start()
    worker.join(PATIENCE_S)
    over.set()
    return not worker.is_alive()


def _be_busy(over: threading.Event) -> None:
    while not over.is_set():
        sum(range(100))


def test_a_wait_of_nanoseconds_ends() -> None:
    """``queue.SimpleQueue`` waits for ever in some of 100,000 (CPython 3.11 and 3.12)."""
    queue: WorkQueue[int] = WorkQueue()
    empty = []

    def wait() -> None:
        for number in range(100_000):
            try:
                queue.get((number % 50) * 1e-9)
            except Empty:
                empty.append(number)

    assert ends(wait)
    assert len(empty) == 100_000


def test_timers_of_an_idle_executor_fire_however_soon_they_are_due() -> None:
    executor = Executor()
    left = iter(range(30_000))

    def again() -> None:
        number = next(left, None)
        if number is None:
            executor.close()
        else:
            executor.after(number % 40 * 1e-7, again)

    executor.after(0.0, again)
    assert ends(executor.spin)


def test_virtual_time_that_keeps_pace_goes_on_however_soon_something_is_due() -> None:
    world = SimulatedWorld(1)
    world.keep_pace(1e6)  # a millisecond of its time is a nanosecond
    done = []

    def again(_: object) -> None:
        done.append(None)
        if len(done) < 30_000:
            world.schedule(1_000_000, again, None)

    world.schedule(0, again, None)
    assert ends(lambda: world.run_for(1e4))
    assert len(done) == 30_000


def test_what_is_put_is_taken_in_order_by_who_waits() -> None:
    queue: WorkQueue[int] = WorkQueue()
    taken: list[int] = []

    def take() -> None:
        taken.extend(queue.get(None if number % 2 else 30.0) for number in range(20_000))

    worker = threading.Thread(target=take, daemon=True)
    worker.start()
    for number in range(20_000):
        queue.put(number)
    worker.join(PATIENCE_S)
    assert taken == list(range(20_000))


def test_nothing_of_several_threads_is_lost() -> None:
    queue: WorkQueue[int] = WorkQueue()
    taken: list[int] = []
    puts = [
        threading.Thread(target=lambda: [queue.put(n) for n in range(5_000)], daemon=True)
        for _ in range(4)
    ]

    def take() -> None:
        for _ in range(20_000):
            taken.append(queue.get())

    for thread in puts:
        thread.start()
    assert ends(take, rivals=0)
    assert sorted(taken) == sorted(list(range(5_000)) * 4)


def test_a_signals_handler_may_put_while_its_own_thread_waits_or_puts() -> None:
    queue: WorkQueue[str] = WorkQueue()
    before = signal.signal(signal.SIGALRM, lambda *_: queue.put("alarm"))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05, 0.001)
        assert queue.get(30.0) == "alarm"
        for _ in range(20_000):
            queue.put("work")
        for _ in range(20_000):
            queue.get(30.0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_it_says_whether_it_is_empty() -> None:
    queue: WorkQueue[int] = WorkQueue()
    assert queue.empty()
    queue.put(1)
    assert not queue.empty()
    assert queue.get(0.0) == 1
    with pytest.raises(Empty):
        queue.get(0.0)
    with pytest.raises(Empty):
        queue.get(-1.0)
