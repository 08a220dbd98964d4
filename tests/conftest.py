"""The order of all tests: files with slow ones first, so that none of them runs alone at the end.
And what they leave in shared memory together.
"""

from __future__ import annotations

import pytest

from tests.transports import shared_memory

_BEFORE = pytest.StashKey[set[str]]()


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.stash[_BEFORE] = shared_memory.unused()


def pytest_unconfigure(config: pytest.Config) -> None:
    before = config.stash.get(_BEFORE, None)
    if before is not None:  # all tests have ended, those of pytest-xdist's workers too
        shared_memory.remove_mailboxes(shared_memory.SHARED_PORTS, before)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)  # stable: else in the order of collection
