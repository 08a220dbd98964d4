"""Signals that come before there is anything to stop."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from transports.stop_signals import StopSignals

ALL = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """The process has its own handlers again afterwards."""
    before = [signal.getsignal(number) for number in ALL]
    yield
    for number, handler in zip(ALL, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", ALL)
def test_a_signal_that_comes_too_early_stops_what_there_is_to_stop_later(
    number: signal.Signals,
) -> None:
    signals = StopSignals()
    assert not signals.asked
    signal.raise_signal(number)
    stopped: list[str] = []
    signals.call(lambda: stopped.append("stopped"))
    assert signals.asked
    assert stopped == ["stopped"]


def test_every_signal_stops_again() -> None:
    signals = StopSignals(again_s=0.0)
    stopped: list[str] = []
    signals.call(lambda: stopped.append("stopped"))
    assert stopped == []
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGTERM)
    assert stopped == ["stopped", "stopped"]


def test_the_second_signal_asks_for_more() -> None:
    signals = StopSignals(again_s=0.0)
    done: list[object] = []
    signals.call(lambda: done.append("stopped"), again=done.append)
    for number in ALL:
        signal.raise_signal(number)
    assert done == ["stopped", signal.SIGTERM, signal.SIGHUP]


def test_two_signals_at_once_as_timeout_sends_them_are_one() -> None:
    signals = StopSignals()
    done: list[object] = []
    signals.call(lambda: done.append("stopped"), again=done.append)
    signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGTERM)
    assert done == ["stopped"]


@pytest.mark.parametrize("number", ALL)
def test_a_second_signal_ends_a_process_that_has_nothing_to_stop_yet(
    number: signal.Signals,
) -> None:
    code = (
        "import signal\n"
        "from transports.stop_signals import StopSignals\n"
        "StopSignals(again_s=0.0)\n"
        f"signal.raise_signal({int(number)})\n"
        "print('goes on', flush=True)\n"
        f"signal.raise_signal({int(number)})\n"
        "print('still there', flush=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, check=False, timeout=60
    )
    assert done.stdout == "goes on\n"
    assert done.returncode == -number


def test_who_connects_and_who_waits_keep_the_same_signals() -> None:
    connecting = StopSignals()
    assert StopSignals.kept() is connecting
    signal.raise_signal(signal.SIGINT)
    stopped: list[str] = []
    StopSignals.kept().call(lambda: stopped.append("stopped"))
    assert stopped == ["stopped"]


def test_who_keeps_no_signals_begins_to() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert isinstance(StopSignals.kept(), StopSignals)
