"""Callers that wait in a simulated world, and are let go when it is closed."""

from __future__ import annotations

from transports.simulated.tasks import Task, TaskAbandonedError


def test_an_abandoned_task_that_waits_again_is_let_go_again() -> None:
    ends: list[str] = []

    def work() -> None:
        for _ in range(3):
            try:
                task.pause()
            except TaskAbandonedError:  # as C++ does, which cannot pass it on
                ends.append("let go")

    task = Task(work, "caller")
    task.resume()
    task.abandon()
    assert ends == ["let go"] * 3
