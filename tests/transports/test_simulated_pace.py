"""Virtual time that keeps to real time."""

from __future__ import annotations

import functools
import signal
import threading
from collections.abc import Callable

import pytest

from transports.simulated import SimulatedTransport, SimulatedWorld
from transports.simulated.pace import Pace

AN_AGE = 1e-9
"""A speed at which nothing that is due later ever happens."""


def by_thread(wake: Callable[[], None]) -> None:
    threading.Timer(0.0, wake).start()


def by_signal(wake: Callable[[], None]) -> None:
    """On the very thread that waits."""

    def came(*_: object) -> None:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        wake()

    signal.signal(signal.SIGALRM, came)
    signal.setitimer(signal.ITIMER_REAL, 0.02)


@pytest.mark.parametrize("waken", [by_thread, by_signal])
def test_a_world_that_waits_for_real_time_can_be_woken(
    waken: Callable[[Callable[[], None]], None],
) -> None:
    world = SimulatedWorld()
    happened: list[object] = []
    world.schedule(10**9, happened.append, None)
    over = threading.Event()

    def wake() -> None:
        over.set()
        world.wake()

    world.keep_pace(AN_AGE)
    waken(wake)
    assert world.run(over.is_set, world.now_ns + 2 * 10**9)
    assert not happened


def test_what_another_thread_posts_to_a_world_that_waits_happens() -> None:
    world = SimulatedWorld()
    node = SimulatedTransport(world, "node")
    world.keep_pace(AN_AGE)
    threading.Timer(0.0, functools.partial(node.post, node.close)).start()
    assert world.run_until(lambda: not node.alive, 1.0)


def test_a_world_that_keeps_pace_does_the_same_as_one_that_does_not() -> None:
    def stamps(speed: float | None) -> list[int]:
        world = SimulatedWorld(seed=3)
        node = SimulatedTransport(world, "node")
        found: list[int] = []
        node.every(0.001, lambda: found.append(world.now_ns))
        world.keep_pace(speed)
        world.run_for(0.01)
        return found

    assert stamps(1000.0) == stamps(None)
    assert len(stamps(None)) == 10


def test_time_left_is_real_time_and_what_was_missed_is_caught_up_with() -> None:
    now_s = 100.0
    pace = Pace(2.0, 5 * 10**9, lambda: now_s)
    assert pace.left_s(9 * 10**9) == 2.0
    now_s = 103.0
    assert pace.left_s(9 * 10**9) == -1.0
    assert pace.left_s(13 * 10**9) == 1.0
    assert pace.left_s(10**18) == 3600.0


def test_a_world_says_in_whose_handler_something_was_raised() -> None:
    world = SimulatedWorld()
    node = SimulatedTransport(world, "clumsy")

    def stumble() -> None:
        raise ZeroDivisionError

    node.after(1.0, stumble)
    with pytest.raises(ZeroDivisionError):
        world.run_for(2.0)
    assert world.failed == "clumsy"
