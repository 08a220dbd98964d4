"""Checking several recordings, each in a process of its own, with a bar that shows how far they are."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from queue import Empty
from typing import Any

from moon.monitor.subject import Monitored, Subject, read_subject
from moon.offline.engine import EmptyRecordingError, check_recording
from moon.offline.expected import expected_entries
from moon.offline.result import CheckResult
from moon.offline.view import View
from moon.recording.reader import RecordingError

_REFRESH_S = 0.2

Outcome = CheckResult | str
"""A result, or why there is none."""
Advance = Callable[[int], None]


def check_all(
    paths: Sequence[Path],
    subject: Subject,
    monitored: Monitored,
    jobs: int,
    with_timelines: bool,
    view: View,
) -> Iterator[tuple[Path, Outcome]]:
    """Each of ``paths`` with what was found, in their order.

    Args:
        paths: the recordings.
        subject: the names of what is monitored.
        monitored: the same, read.
        jobs: how many are checked at once.
        with_timelines: whether results are to have them.
        view: which part of each, and by which time.
    """
    with _bar(paths) as advance:
        if jobs == 1 or len(paths) == 1:
            for path in paths:
                yield path, _check(path, subject, monitored, with_timelines, view, advance)
        else:
            yield from _side_by_side(paths, subject, jobs, with_timelines, view, advance)


def _check(
    path: Path,
    subject: Subject,
    monitored: Monitored,
    with_timelines: bool,
    view: View,
    advance: Advance,
) -> Outcome:
    try:
        return check_recording(path, subject, monitored, with_timelines, advance, view)
    except (RecordingError, EmptyRecordingError) as error:
        return str(error)


# --- several processes -----------------------------------------------------------------------------


class _Worker:
    """What a process keeps from one recording to the next."""

    monitored: Monitored
    subject: Subject
    progress: Any


def _begin(subject: Subject, progress: Any) -> None:
    _Worker.subject, _Worker.progress = subject, progress
    _Worker.monitored = read_subject(subject)


def _work(path: Path, with_timelines: bool, view: View) -> Outcome:
    worker = _Worker
    return _check(path, worker.subject, worker.monitored, with_timelines, view, worker.progress.put)


def _side_by_side(
    paths: Sequence[Path],
    subject: Subject,
    jobs: int,
    with_timelines: bool,
    view: View,
    advance: Advance,
) -> Iterator[tuple[Path, Outcome]]:
    # a policy's tree has threads, and behaviortreepy its own: a fork would have halves of them
    context = multiprocessing.get_context("spawn")
    progress = context.Queue()
    with ProcessPoolExecutor(
        min(jobs, len(paths)), context, initializer=_begin, initargs=(subject, progress)
    ) as pool:
        futures = [pool.submit(_work, path, with_timelines, view) for path in paths]
        for path, future in zip(paths, futures, strict=True):
            while not future.done():
                wait([future], _REFRESH_S)
                _drain(progress, advance)
            yield path, _outcome(path, future)


def _outcome(path: Path, future: Future[Outcome]) -> Outcome:
    try:
        return future.result()
    except BrokenProcessPool:
        return f"{path}: the process that checked it was killed (too little memory?)"


def _drain(progress: Any, advance: Advance) -> None:
    while True:
        try:
            advance(progress.get_nowait())
        except Empty:
            return


# --- the bar ---------------------------------------------------------------------------------------


@contextmanager
def _bar(paths: Sequence[Path]) -> Iterator[Advance]:
    """A progress bar on standard error, if that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    expected = [expected_entries(path) for path in paths]
    total = None if None in expected else sum(count or 0 for count in expected)
    columns = (
        TextColumn("checking"),
        BarColumn(),
        TextColumn("{task.completed:,.0f} entries"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("checking", total=total)
        yield lambda count: progress.advance(task, count)
