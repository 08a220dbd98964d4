"""The order of all tests: files with slow ones first, so that none of them runs alone at the end.
And their shared memory: of their own where that is permitted, and what they leave in it together.
And garbage: it is seldom looked for.
And hypothesis: the same examples every time, so that the suite gives the same answer twice. Fresh ones
are for ``make soak``; what they find is kept as ``@example`` beside the test.
"""

from __future__ import annotations

import shlex
import signal
from collections import Counter

import hypothesis
import pytest

from m2c.rosidl.build import missing_tools
from tests import garbage
from tests.transports import shared_memory

SUITE, SOAK = "suite", "soak"
hypothesis.settings.register_profile(SUITE, derandomize=True, deadline=None, database=None)
hypothesis.settings.register_profile(
    SOAK, derandomize=False, deadline=None, print_blob=True, database=None
)
hypothesis.settings.load_profile(SUITE)  # --hypothesis-profile comes later

_BEFORE = pytest.StashKey[set[str]]()
_IS_OWN = pytest.StashKey[bool]()


def pytest_configure(config: pytest.Config) -> None:
    # nohup(1) has the one ignored, a shell's `&` the other, also by what tests start: what is asked to end by
    # Ctrl-C would be waited for until it is killed
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not hasattr(config, "workerinput"):  # those of pytest-xdist start later, and inherit it
        config.stash[_IS_OWN] = shared_memory.separate()
        config.stash[_BEFORE] = shared_memory.unused()


def pytest_report_header(config: pytest.Config) -> str | None:
    is_own = config.stash.get(_IS_OWN, None)
    if is_own is None:
        return None
    whose = (
        "the tests' own" if is_own else "that of all processes (only root can have it otherwise)"
    )
    return f"shared memory: {whose}"


def pytest_unconfigure(config: pytest.Config) -> None:
    before = config.stash.get(_BEFORE, None)
    if before is not None:  # all tests have ended, those of pytest-xdist's workers too
        shared_memory.remove_mailboxes(shared_memory.SHARED_PORTS, before)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)  # stable: else in the order of collection
    if missing := missing_tools():
        left_out = pytest.mark.skip(reason=f"for ROS 2's packages there is no {', '.join(missing)}")
        for item in items:
            if item.get_closest_marker("ros2") or item.path.parent.name == "rosidl":
                item.add_marker(left_out)


def pytest_collection_finish() -> None:
    garbage.look_seldom()


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Where the time went, what was left out, and how the examples that a seed found are found again."""
    _show_slowest(terminalreporter)
    _show_left_out(terminalreporter)
    seed = config.getoption("--hypothesis-seed")
    if seed is None:
        return
    profile = config.getoption("--hypothesis-profile") or SUITE
    for report in terminalreporter.stats.get("failed", []):
        command = ["pytest", report.nodeid, "--hypothesis-profile", profile]
        terminalreporter.line(
            f"this repeats it: {shlex.join([*command, '--hypothesis-seed', str(seed)])}"
        )


SLOWEST = 10
"""So many files are shown where more than as many were run."""


def _show_slowest(terminalreporter: pytest.TerminalReporter) -> None:
    """The files whose tests took longest, with their fixtures, in seconds."""
    seconds = Counter[str]()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                seconds[report.nodeid.partition("::")[0]] += report.duration
    if len(seconds) <= SLOWEST:
        return
    terminalreporter.section(f"slowest files, of {seconds.total():.0f} s")
    for name, duration in seconds.most_common(SLOWEST):
        terminalreporter.line(f"{duration:6.1f} s  {name}")


def _show_left_out(terminalreporter: pytest.TerminalReporter) -> None:
    """How many tests were skipped for which reason."""
    reasons = Counter[str]()
    for report in terminalreporter.stats.get("skipped", []):
        if isinstance(report.longrepr, tuple):
            reasons[report.longrepr[2].removeprefix("Skipped: ")] += 1
    for reason, count in reasons.most_common():
        terminalreporter.line(f"left out: {count} {'test' if count == 1 else 'tests'}: {reason}")
